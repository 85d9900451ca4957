//! The kinds there are. A new kind is one file beside this one and one line here.

use super::Kind;

/// All kinds, in the order of contract and reports.
pub static ALL: &[&Kind] = &[
    &super::viscous_friction::KIND,
    &super::coulomb_friction::KIND,
    &super::asymmetric_coulomb_friction::KIND,
    &super::asymmetric_viscous_friction::KIND,
    &super::stribeck_friction::KIND,
    &super::quadratic_drag::KIND,
    &super::load_dependent_friction::KIND,
    &super::position_dependent_friction::KIND,
    &super::linear_spring::KIND,
    &super::cubic_spring::KIND,
    &super::constant_force::KIND,
    &super::gravity_tilt::KIND,
    &super::end_stop::KIND,
    &super::periodic_force::KIND,
    &super::input_gain_error::KIND,
    &super::input_offset::KIND,
    &super::input_delay::KIND,
    &super::actuator_lag::KIND,
    &super::input_dead_zone::KIND,
    &super::input_saturation::KIND,
    &super::backlash::KIND,
    &super::elastic_transmission::KIND,
    &super::added_mass::KIND,
    &super::reflected_inertia::KIND,
    &super::sensor_offset::KIND,
    &super::sensor_scale::KIND,
    &super::sensor_delay::KIND,
    &super::dahl_friction::KIND,
    &super::lugre_friction::KIND,
    &super::hysteresis::KIND,
];

/// The kind called `name`.
pub fn find(name: &str) -> Option<&'static Kind> {
    ALL.iter().copied().find(|kind| kind.name == name)
}
