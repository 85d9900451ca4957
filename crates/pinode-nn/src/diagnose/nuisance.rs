//! What constants owe to one that is held.
//!
//! Some things no fit moves, as over how wide a range of speeds dry friction changes its sign; of others, as of the motor behind a spring, no parabola about the best fit knows how far
//! they may go. What is made up for by other constants where such a thing is held somewhere else is a part of their errors. With l(w) the log-likelihood of the best fit with w, a parabola about its top, one standard error of w moves θ by
//! |θ(w′) − θ(w)| / √(2 (l(w) − l(w′))).

use super::study::Fitted;

/// What loses less than these nats is as good as the best.
const AS_GOOD: f64 = 0.5;

/// Adds to what constants owe, in the order of `best.inside.free`, what they do by an `other` fit that has `lost` so many nats against the best.
pub fn owe(owed: &mut [f64], (best, other): (&Fitted, &Fitted), lost: f64) {
    let standard = 1.0 / (2.0 * lost.max(AS_GOOD)).sqrt();
    for (owed, &i) in owed.iter_mut().zip(&best.inside.free) {
        let moved = (other.inside.theta[i] - best.inside.theta[i]).abs();
        *owed = owed.max(moved * standard);
    }
}
