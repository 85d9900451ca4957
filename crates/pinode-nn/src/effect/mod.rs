//! Effects: everything that makes Q beside the inputs.
//!
//! An effect is known (it stands in the model), found (the diagnosis put it there) or a candidate (the diagnosis tries it).
//! Each kind is one file with its formula, its parameters and its derivatives, and one line in [`registry`]; a crate of your own
//! [registers](registry::register) its kinds there.
//!
//! There are six actions. A [`JointForce`] is a generalized force on one coordinate, a function of that coordinate's q and v.
//! Where it is dry friction spread over a smoothing velocity it also has the set-valued law itself, [`DryFriction`]; an end stop has
//! the hard one that it is the compliance of, [`RigidStop`].
//! A [`MemoryForce`] has states of its own; on a joint it acts beside all else, as a transmission it stands between an input and its
//! joint. A [`DriveLaw`] changes an input on its way: a causal pass over the whole input signal. A [`Distortion`] is a sensor's.
//! An [`Inertial`] one changes M, C and G; so does a transmission whose motor the mechanism has in its masses.

mod between;
mod distortion;
mod drive;
mod dual;
mod inertial;
mod joint_force;
mod kind;
mod law;
mod memory;
pub mod registry;

mod actuator_lag;
mod added_mass;
mod asymmetric_coulomb_friction;
mod asymmetric_viscous_friction;
mod backlash;
mod centre_of_mass;
mod constant_force;
mod coulomb_friction;
mod cubic_spring;
mod dahl_friction;
mod elastic_transmission;
mod end_stop;
mod gravity_tilt;
mod hysteresis;
mod input_dead_zone;
mod input_delay;
mod input_gain_error;
mod input_offset;
mod input_saturation;
mod linear_spring;
mod link_inertia;
mod load_dependent_friction;
mod lugre_friction;
mod payload;
mod periodic_force;
mod pointwise;
mod position_dependent_friction;
mod quadratic_drag;
mod reflected_inertia;
mod sensor_delay;
mod sensor_offset;
mod sensor_scale;
mod stribeck_friction;
mod viscous_friction;

pub use between::Between;
pub use distortion::Distortion;
pub use drive::{DriveLaw, Grid, Signal};
pub use inertial::{Inertial, Misplaced, tilt_direction};
pub(crate) use inertial::{about_joint, moved, tilts};
pub use joint_force::{
    DryFriction, ForceLaw, JointForce, JointForceDerivatives, OnCoordinate, RigidStop, smooth_sign,
};
pub use kind::{
    Action, ActsOn, Family, Kind, LeftOut, ParameterSpec, Probe, Quantity, Scales, Struck,
};
pub(crate) use law::{At, Column, Law, Room};
pub(crate) use memory::MOST_STATES;
pub use memory::{MemoryDerivatives, MemoryForce, MemoryLaw, Motor, Seen, WithMemory};
pub use pointwise::{Pointwise, PointwiseLaw};

/// Velocity over which a sign change of friction is spread unless the model says otherwise: 3 mm/s, or 10 mrad/s on an angle. A tenth of it in a model
/// that is [stepped implicitly](crate::hybrid::Hybrid::is_stiff).
pub fn default_smoothing(angular: bool) -> f64 {
    if angular { 1e-2 } else { 3e-3 }
}
