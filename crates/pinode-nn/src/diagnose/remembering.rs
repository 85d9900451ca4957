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
    let promising = screened.iter().filter(|s| s.t2 > LEAST_T2.0);
    let near = promising
        .take(SECOND_CHOICES)
        .filter_map(|s| near(study, base, s, ahead));
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

/// A screened candidate that is not far behind in some of the windows, to be fitted to all from where it came to there.
fn near(
    study: &Study,
    base: &Fitted,
    screened: &Screened,
    ahead: Option<(&Study, &Fitted)>,
) -> Option<Screened> {
    let Some((own, found)) = ahead.filter(|_| !screened.starts.is_empty()) else {
        return Some(screened.clone());
    };
    let (of_found, found) = own.some_windows(found, SHARE);
    let start = found.start(found.inside.theta.clone());
    let found = of_found.fit(found.hybrid.clone(), start, 0, 0);
    let (some, there) = study.some_windows(base, SHARE);
    let theta = base.inside.theta.as_slice();
    let begun = (&there, &base.hybrid, theta);
    let candidate = screened.candidate;
    let begun = best_of_starts(&some, begun, candidate, &screened.starts)?;
    let start = begun.start(begun.inside.theta.clone());
    let tried = some.fit(begun.hybrid.clone(), start, 0, ITERATIONS);
    let share = some.windows.fit.len() as f64 / study.windows.fit.len().max(1) as f64;
    let index = position(&tried, &candidate)?;
    let p = tried.inside.theta[tried.hybrid.range(index)].to_vec();
    (tried.score(0) > found.score(0) - share * FAR_BEHIND).then(|| Screened {
        starts: vec![p],
        ..screened.clone()
    })
}
