//! Kinematic trees: rigid bodies joined by joints.

mod angles;
mod assemble;
mod inertia;
mod jacobian;
mod joint;
mod link_force;
mod node;
mod placement;
mod poses;
mod recursion;
mod rounding;
mod shortcuts;
mod tree;
mod variants;

pub use angles::{Angles, Axis, PoseForm};
pub use inertia::{Inertia, Inertial};
pub use jacobian::Poses;
pub use joint::{Joint, JointKind, Limits, Mimic};
pub use link_force::{LinkForce, LinkForceEntry, LinkForceMemory};
pub use placement::Placement;
pub use tree::{Body, Link, Tree};

pub(crate) use assemble::{BASE, LinkSpec};
pub(crate) use joint::JointSpec;
pub(crate) use node::Freedom;
