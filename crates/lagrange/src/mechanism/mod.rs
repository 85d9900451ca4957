//! Kinematic trees: rigid bodies joined by joints of one coordinate each.

mod inertia;
mod joint;
mod recursion;
mod shortcuts;
mod tree;

pub use inertia::Inertia;
pub use joint::{Joint, JointKind, Limits, Mimic};
pub use tree::{Body, Link, Tree};

pub(crate) use joint::JointSpec;
pub(crate) use tree::LinkSpec;
