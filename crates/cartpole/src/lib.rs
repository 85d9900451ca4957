//! The cart-pole of the PINODE paper (Roehrl et al. 2020): a virtual test rig that hides an effect, for the missing-physics
//! workflow to find.
//!
//! The [`rig`] makes logs; it shares nothing with the code that explains them but M, C and G from the crate `lagrange`.
//! Everything that it takes is in one file, [`config::Config`]. [`joints`] are rigs of other mechanisms.
//! The [`program`] tells the whole story, and [`score`] how
//! often it ends well.
pub mod config;
pub mod joints;
pub mod paper;
pub mod program;
pub mod rig;
pub mod score;
