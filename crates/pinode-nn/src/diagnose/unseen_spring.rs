//! How soft a spring between a motor and its joint may be and not show.
//!
//! A motor that drives a joint by a rigid shaft adds its inertia to the joint's; by a spring it is an elastic transmission, of which that is the limit
//! k → ∞. Data that show the inertia may say nothing of a stiff spring, and a name that leaves it out must not say that there is none. So elastic
//! transmissions are fitted in place of the inertia, from springs of several stiffnesses and to some of the windows; the softest that does as well there
//! and in all of them is told.

use rayon::prelude::*;

use super::candidate::Candidate;
use super::comparison::Comparison;
use super::found::{Found, position, stripped};
use super::refine::{ITERATIONS, SHARE};
use super::study::{Fitted, Study};
use crate::effect::registry;

/// The springs that are tried, by the frequencies at which motor and joint swing against each other on them, rad/s …
const FREQUENCIES: [f64; 5] = [40.0, 60.0, 80.0, 110.0, 160.0];
/// … and how far they are damped, of the critical damping.
const DAMPING: f64 = 0.2;
/// What D states explain of noise is ½ χ² of D degrees of freedom, ½ D and √(½ D) more or less: so many times that is no difference.
const FAR_OFF: f64 = 2.0;

/// A spring that does not show.
#[derive(Debug, Clone, PartialEq)]
pub struct UnseenSpring {
    /// The elastic transmission, of the input that the motor is.
    pub candidate: Candidate,
    /// The least stiffness that was found to do as well, N/m or N·m/rad.
    pub stiffness: f64,
}

/// The spring by which an inertia that was found may be driven and not show, and the model with it; none where that explains more than the inertia does, or
/// where nothing drives the joint.
pub fn unseen_spring(
    study: &Study,
    null: &Fitted,
    current: &Fitted,
    found: &Found,
) -> Option<(UnseenSpring, Fitted)> {
    let inertia = registry::find("reflected_inertia")?;
    let kind = registry::find("elastic_transmission").filter(|k| !study.without.contains(k))?;
    if found.candidate.kind != inertia {
        return None;
    }
    let index = position(current, &found.candidate)?;
    let target = found.candidate.target;
    let own = current.inside.theta.get(current.hybrid.range(index).start);
    // Less inertia than the model has is no motor.
    let own = own.copied().filter(|inertia| *inertia > 0.0)?;
    let (hybrid, theta) = stripped(null, current, index);
    let drives =
        |input: &usize| !hybrid.is_on_link(*input) && hybrid.coordinate_of(kind, *input) == target;
    let mut inputs = (0..hybrid.inputs()).filter(drives);
    // Of several motors on one joint nobody knows whose inertia it is.
    let input = inputs.next().filter(|_| inputs.next().is_none())?;
    let candidate = Candidate {
        kind,
        target: input,
    };
    let scales = candidate.scales(&hybrid, &study.scales);
    let reduced = own * scales.free_mass / (own + scales.free_mass);
    let start = |frequency: f64| {
        let stiffness = frequency * frequency * reduced;
        let damping = 2.0 * DAMPING * frequency * reduced;
        vec![stiffness, damping, own, 0.0, 0.0, 0.0]
    };
    // What does not do as well in some of the windows hardly does in all; of what does, the softest there is asked there first.
    let (some, there) = study.some_windows(current, SHARE);
    let there = some.fit(
        there.hybrid.clone(),
        there.start(there.inside.theta.clone()),
        0,
        0,
    );
    let fitted = FREQUENCIES.par_iter().map(|&frequency| {
        let (hybrid, theta) = candidate.place(&hybrid, &theta, &start(frequency));
        some.fit(hybrid, there.start(theta), 1, ITERATIONS)
    });
    let fitted: Vec<Fitted> = fitted.collect();
    let stiffness = |elastic: &Fitted| {
        let place = elastic.hybrid.range(position(elastic, &candidate)?).start;
        elastic.inside.theta.get(place).copied()
    };
    let as_good = fitted
        .into_iter()
        .filter(|elastic| is_as_good(elastic, &there));
    let mut springs: Vec<(f64, Fitted)> = as_good
        .filter_map(|elastic| Some((stiffness(&elastic)?, elastic)))
        .collect();
    springs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (stiffness, elastic) = springs.into_iter().find_map(|(_, elastic)| {
        let begun = current.start(elastic.inside.theta);
        let elastic = study.fit(elastic.hybrid, begun, 1, ITERATIONS);
        is_as_good(&elastic, current).then_some((stiffness(&elastic)?, elastic))
    })?;
    let spring = UnseenSpring {
        candidate,
        stiffness,
    };
    Some((spring, elastic))
}

/// Whether a spring does as well as a rigid shaft, and does not explain more.
fn is_as_good(elastic: &Fitted, rigid: &Fitted) -> bool {
    let lead = Comparison::of(elastic, rigid);
    // Where a window determines the motor's state by itself, that costs a nat and explains half of one of its noise.
    let determined = |fitted: &Fitted| fitted.inside.determined.iter().sum::<f64>();
    let paid = 0.5 * (determined(elastic) - determined(rigid));
    lead.total() + paid > -FAR_OFF * paid.max(0.0).sqrt() && !lead.explains()
}
