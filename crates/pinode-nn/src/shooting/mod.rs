//! The multiple-shooting fit: short windows with free initial states, one common θ.
//!
//! Long roll-outs of a mechanism forget their start and diverge near unstable points; windows of about half a second do not.
//! Positions are compared, and velocities where they are measured and not differences of positions.

mod eight;
mod fit;
mod normal;
mod observation;
pub(crate) mod problem;
mod roll;
mod settle;
mod single_steps;
mod stiff;
mod stuck;
mod variation;
mod window;

pub(crate) use eight::{Member, roll_all};
pub use fit::{Fit, FitOptions, fit};
pub(crate) use normal::{Accumulator, Residual};
pub use normal::{Reduced, WindowNormal};
pub use observation::{Channel, Finer, Observations, ObservedRun, wrap_angle};
pub use problem::HiddenPrior;
pub(crate) use roll::over_samples;
pub use roll::{Diverged, Roller, Trajectory};
pub(crate) use single_steps::roll_steps;
pub(crate) use variation::{By, SmallForce, Variation};
pub use window::{Window, Windows, consecutive};
