//! The kinds there are. A new kind is one file beside this one and one line here.

use super::Kind;

/// All kinds, in the order of contract and reports.
pub static ALL: &[&Kind] = &[
    &super::viscous_friction::KIND,
    &super::coulomb_friction::KIND,
    &super::asymmetric_coulomb_friction::KIND,
    &super::stribeck_friction::KIND,
    &super::quadratic_drag::KIND,
    &super::linear_spring::KIND,
    &super::cubic_spring::KIND,
    &super::constant_force::KIND,
    &super::end_stop::KIND,
    &super::input_gain_error::KIND,
    &super::input_delay::KIND,
];

/// The kind called `name`.
pub fn find(name: &str) -> Option<&'static Kind> {
    ALL.iter().copied().find(|kind| kind.name == name)
}
