//! Effects: everything that makes Q beside the inputs.
//!
//! An effect is known (it stands in the model), found (the diagnosis put it there) or a candidate (the diagnosis tries it).
//! Each kind is one file with its formula, its parameters and its derivatives, and one line in [`registry`].
//!
//! Two actions exist. A [`JointForce`] is a generalized force on one coordinate, a function of that coordinate's q and v.
//! Where it is dry friction spread over a smoothing velocity it also has the set-valued law itself, [`DryFriction`];
//! an end stop has the hard one that it is the compliance of, [`RigidStop`].
//! A [`DriveLaw`] changes an input on its way to the joint: a causal pass over the whole input signal.

mod drive;
mod joint_force;
mod kind;
pub mod registry;

mod asymmetric_coulomb_friction;
mod constant_force;
mod coulomb_friction;
mod cubic_spring;
mod end_stop;
mod input_delay;
mod input_gain_error;
mod linear_spring;
mod quadratic_drag;
mod stribeck_friction;
mod viscous_friction;

pub use drive::{DriveLaw, Grid, Signal};
pub use joint_force::{
    DryFriction, ForceLaw, JointForce, JointForceDerivatives, OnCoordinate, RigidStop, smooth_sign,
};
pub use kind::{Action, Family, Kind, ParameterSpec, Probe, Quantity, Scales};

/// Velocity over which a sign change of friction is spread unless the model says otherwise: 3 mm/s, or 10 mrad/s on an angle.
pub fn default_smoothing(angular: bool) -> f64 {
    if angular { 1e-2 } else { 3e-3 }
}
