//! Friction with a memory in place of what was found.
//!
//! What is found first may be a small part of what friction with a memory does. It is dear to fit, and what was found by itself is ahead of it where there is none: what stays
//! far behind that in some of the windows is not fitted to all.

use super::accept::accept;
use super::found::position;
use super::refine::{FAR_BEHIND, ITERATIONS, SHARE, best_of_starts, rank};
use super::screen::{self, Screened};
use super::step::{LEAST_T2, Report, SECOND_CHOICES, Step, is_second_choice, refine_dear};
use super::study::{Fitted, Study};

/// A step that asks for friction with a memory beside `base`, where it accepts some, in place of what was found: one effect that is `ahead` in its own study, or several,
/// beside which there may be more to be found here as well.
pub fn remembering(
    study: &Study,
    base: &Fitted,
    ahead: Option<(&Study, &Fitted)>,
    seed: u64,
    report: Report,
) -> Option<Step> {
    report("asking for friction with a memory instead");
    let screened = screen::screen(study, base, is_second_choice).ranked;
    let goal = ahead.map_or(f64::NEG_INFINITY, |(_, found)| {
        let (own, other) = (&found.inside.free, &base.inside.free);
        found.score(own.len().saturating_sub(other.len()))
    });
    // What is not far behind in some of the windows.
    let least = ahead.map(|(own, found)| {
        let (some, there) = own.some_windows(found, SHARE);
        let start = there.start(there.inside.theta.clone());
        let share = some.windows.fit.len() as f64 / own.windows.fit.len().max(1) as f64;
        some.fit(there.hybrid, start, 0, 0).score(0) - share * FAR_BEHIND
    });
    let promising = screened.iter().filter(|s| s.t2 > LEAST_T2.0);
    let promising = promising.take(SECOND_CHOICES);
    let near = promising.filter_map(|s| match least {
        Some(least) if !s.starts.is_empty() => near(study, base, s, least),
        _ => Some(s.clone()),
    });
    let near: Vec<Screened> = near.collect();
    let mut contenders = refine_dear(study, base, near.iter(), goal, report);
    contenders.retain(|c| c.score > goal - FAR_BEHIND);
    rank(&mut contenders, seed);
    let accepted = accept(study, base, &mut contenders, (false, seed))?;
    Some(Step {
        screened,
        contenders,
        accepted: Some(accepted),
    })
}

/// A screened candidate that has a score of at `least` so much in some of the windows, to be fitted to all from where it came to there.
fn near(study: &Study, base: &Fitted, screened: &Screened, least: f64) -> Option<Screened> {
    let (some, there) = study.some_windows(base, SHARE);
    let from = (&there, &base.hybrid, base.inside.theta.as_slice());
    let candidate = screened.candidate;
    let begun = best_of_starts(&some, from, candidate, &screened.starts)?;
    let start = begun.start(begun.inside.theta.clone());
    let tried = some.fit(begun.hybrid, start, 0, ITERATIONS);
    let index = position(&tried, &candidate)?;
    let p = tried.inside.theta[tried.hybrid.range(index)].to_vec();
    (tried.score(0) > least).then(|| Screened {
        starts: vec![p],
        ..screened.clone()
    })
}
