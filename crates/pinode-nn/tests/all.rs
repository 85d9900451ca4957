//! The tests of this crate's public face and of its program in one program, which is built faster than one each; `motion_memory` counts
//! for itself.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)] // helpers of tests

#[cfg(feature = "adaptive")]
mod adaptive;
mod backlash;
#[path = "../../../tests/bad_models_and_logs.rs"]
mod bad_models_and_logs;
mod cli;
mod coarse_steps;
mod contacts;
mod conventions;
mod data_faults;
mod diagnose_command;
mod drive_layouts;
mod end_stops;
mod ensembles;
mod equations_command;
mod export_command;
mod floating;
mod floating_logs;
mod inertial;
mod joint_limits;
mod late_inputs;
mod left_training;
mod link_inputs;
mod log_formats;
mod model_files;
#[path = "../../../tests/models.rs"]
mod models;
mod motion;
mod not_quadratic;
#[cfg(feature = "cli")]
#[path = "../../../tests/oracles_through_the_program.rs"]
mod oracles_through_the_program;
#[cfg(feature = "cli")]
mod program;
mod real_logs;
mod sensitivities;
mod train_beside;
mod train_command;
mod train_linkages;
mod what_is_told;
