//! Find, name and add the physics that a simulation is missing, from measured data.
//!
//! A [`Model`](model::Model) is a TOML file: a mechanism (URDF, or its energies as text), inputs, known effects, sensors, and how well
//! all this is known. A [`Log`](log::Log) is a file in CSV, Parquet or MCAP. The model's equations of motion are
//!
//! M(q) v̇ + C(q, v) v + G(q) = Q = Σ gains · inputs + Σ effects,
//!
//! SI units throughout. [`diagnose`](diagnose::diagnose) fits the model to windows of the log ([`shooting`]), tries every
//! [`effect`] on every joint and input, accepts what explains windows that no fit has seen, and writes the new model:
//!
//! ```no_run
//! use pinode_nn::{diagnose::diagnose, log::Log, model::Model};
//!
//! let model = Model::load("cart.toml".as_ref())?;
//! let log = Log::read("log.csv".as_ref(), &model)?;
//! let outcome = diagnose(&model, &[log], &[], "out".as_ref(), 0, &|stage| eprintln!("{stage}"))?;
//! println!("{:?}: {} effects", outcome.diagnosis.verdict, outcome.diagnosis.effects.len());
//! # Ok::<(), pinode_nn::Error>(())
//! ```
//!
//! [`hybrid`] is the model as it is simulated, with exact derivatives; [`motion`] makes systems for `integrators` of mechanisms;
//! [`free_run`] and [`evaluate`](mod@evaluate) run it over a log. Fits smooth dry friction; [`contact_run`] runs a model with friction that
//! sticks, and [`smoothing`] says how far the two are apart; [`coarse`] says where the steps of a simulation are too long. [`band`] says how far measurements may be from an ensemble of networks. [`environment`] makes an environment of a model, to find a controller on.
//! [`poses`] is what becomes of floating bodies in logs.
//! Feature `cli` (default): the program `pinode` and the HTML report. Feature `adaptive` (default): `adaptive_run`, free runs whose steps
//! adapt to the motion, also where it is stiff. Features `parquet` and `mcap` (default): logs in these formats.
#[cfg(feature = "adaptive")]
pub mod adaptive_run;
pub mod band;
#[cfg(feature = "cli")]
pub mod cli;
pub mod coarse;
pub mod contact_run;
pub mod diagnose;
pub mod effect;
pub mod environment;
pub mod evaluate;
pub mod free_run;
pub mod hybrid;
pub mod learnt;
pub mod log;
pub mod model;
pub mod motion;
pub mod network;
pub mod poses;
#[cfg(feature = "cli")]
pub mod report;
pub mod shooting;
pub mod smoothing;
pub mod spread;
pub mod train;

mod bins;
mod digits;
mod disk;
mod entries;
mod error;
#[cfg(feature = "cli")]
mod limits;
mod naming;
mod past;
mod processor;
mod typical;

pub use disk::write_atomically;
pub use error::{Error, Unmoved};

/// The code in the front page runs.
#[cfg(doctest)]
#[doc = include_str!("../../../README.md")]
struct FrontPage;
