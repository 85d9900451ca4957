//! What the constants that were found owe to the length of the integration steps.
//!
//! Steps are chosen so that half of them move no roll-out by more than a part of the noise, before it is known what is missing. Ten thousand samples see a
//! tenth of that, and a drive that rings from sample to sample has its stiffness and its damping from it. Half of the steps change what is predicted by
//! Δ(θ); with r = y − ŷ(θ), the Gauss–Newton step of the fit to r − Δ from the optimum of that to r is
//!
//! δθ = −(Jᵀ J + P)⁻¹ Jᵀ Δ,
//!
//! the initial states eliminated, P what tolerances weigh: it takes one linearisation to know by how much each constant would move.

use nalgebra::DMatrix;

use super::linear::{AtWindow, Linearisation};
use super::refine::is_sensible;
use super::search::Search;
use super::step_length::rolled;
use super::study::{Fitted, MOST_SUBSTEPS, Study};
use crate::shooting::Trajectory;

/// Steps are halved where that moves a constant by more than this part of its standard error.
const MOVED: f64 = 0.25;
/// So often at most: what is not smooth hardly converges with the steps.
const HALVINGS: usize = 2;
/// Iterations of the fit with them.
const ITERATIONS: usize = 6;

/// By how much half the integration steps would move each free constant of a fitted model, in the order of `inside.free`.
fn moved(study: &Study, fitted: &Fitted) -> Vec<f64> {
    let (hybrid, free) = (&fitted.hybrid, fitted.inside.free.len());
    let finer = rolled(study, fitted, 2 * fitted.substeps);
    let linear = Linearisation::new(study, fitted);
    let by_half = |at: &AtWindow| {
        let of = |finer: &Trajectory| linear.change(at, (hybrid, linear.readings()), &finer.states);
        let none = || vec![0.0; at.residuals.len()];
        vec![finer[at.index].as_ref().map_or_else(none, of)]
    };
    let mut information = DMatrix::zeros(free + 1, free + 1);
    linear.each_window(1, by_half, |s, _| information += s);
    let follows = linear.by_nuisance(&information);
    follows.column(0).iter().map(|d| -d).collect()
}

/// The model that was found with steps so short that half of them would move none of its constants by more than [`MOVED`] standard errors, or a quarter as
/// long as they were, in the study with these. `None` where it has them already; of a stiff model, on which half of the steps has not been tried but for its
/// time; where it was found beside pushes, without which the constants would take these for their own; and where what was found is not what it is called with
/// them.
pub fn with_steps_as_short_as_it_shows(study: &Study, search: &Search) -> Option<(Study, Fitted)> {
    if search.pushed || search.found.is_empty() || search.model.hybrid.is_stiff() {
        return None;
    }
    let (mut study, mut fitted) = (study.clone(), search.model.clone());
    let mut is_shorter = false;
    for _ in 0..HALVINGS {
        if 2 * fitted.substeps * study.steps.about_rests > MOST_SUBSTEPS {
            break;
        }
        let moved = moved(&study, &fitted);
        let errors = fitted.standard_errors(&study).iter();
        let shows = |(moved, error): (&f64, &f64)| moved.abs() > MOVED * error;
        if !moved.iter().zip(errors).any(shows) {
            break;
        }
        study = study.with_half_the_steps();
        let start = fitted.start(fitted.inside.theta.clone());
        fitted = study.fit(fitted.hybrid.clone(), start, 1, ITERATIONS);
        is_shorter = true;
    }
    let is_itself = |found: &_| is_sensible(&study, found, &fitted);
    let stays = search.found.iter().map(|f| &f.candidate).all(is_itself);
    (is_shorter && stays).then_some((study, fitted))
}
