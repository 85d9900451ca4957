//! Roll-outs whose steps adapt to the motion, also where it is stiff; behind the feature `adaptive`.
//!
//! The solvers are `diffsol`'s. What is here is what they lack: the choice between the explicit and the implicit one while the motion
//! goes on ([`Method::Automatic`]), inputs that are held between samples, states that turn, exact Jacobians from
//! [`Differentiable`](crate::Differentiable), and errors that say what to change.
//!
//! | method | order | what for |
//! |---|---|---|
//! | [`Tsit5`](Method::Tsit5) | 5 | motions that are not stiff |
//! | [`TrBdf2`](Method::TrBdf2) | 2 | stiff, coarse tolerances |
//! | [`Esdirk34`](Method::Esdirk34) | 3 | stiff, and inputs that jump often: a step needs no past |
//! | [`Bdf`](Method::Bdf) | 1 to 5 | stiff and smooth for long, fine tolerances |
//! | [`Automatic`](Method::Automatic) | | Tsit5 while steps are bounded by accuracy, an implicit one while they are by stability, at a tenth of the tolerance |

mod chart;
mod engine;
mod equations;
mod error;
mod roll_out;
mod settings;
mod start;
mod statistics;
mod stiffness;

pub use error::{AdaptiveError, ArgumentError, Refusal};
pub use roll_out::{Inputs, RollOut, roll_out};
pub use settings::{Method, Settings};
pub use statistics::{Statistics, Switch};
