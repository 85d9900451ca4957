//! Bands of a coordinate in which its sensor is blind.
//!
//! All large residuals lie in one band, and without its readings the windows that pass through fit on both sides of it: nothing has
//! pushed there.

use super::super::study::{Fitted, Study};
use super::super::verdict::DataFault;
use super::second_look::{Look, Residual, Residuals, robust};
use crate::shooting::{Observations, wrap_angle};

/// A band is looked for among so many parts of the range.
const PARTS: usize = 40;
/// It is at most so many of them wide.
const WIDEST: usize = 6;
/// It holds this share of all large residuals, of which there are at least so many.
const SHARE: f64 = 0.9;
const FEWEST: usize = 20;
/// This share of the residuals in it is large.
const DENSE: f64 = 0.4;
/// So many windows pass through it, with so many samples on either side.
const PASSES: usize = 3;
const EITHER_SIDE: usize = 4;

/// Adds the bands in which sensors are blind to `look`.
pub fn blind_bands(study: &Study, fitted: &Fitted, residuals: &Residuals, look: &mut Look) {
    let coordinates = fitted.hybrid.mechanics().coordinates();
    for (c, coordinate) in coordinates.iter().enumerate() {
        let Some(band) = Band::of(residuals, c, coordinate.angular) else {
            continue;
        };
        let mut observations = look.observations.clone();
        let mut stretches = Vec::new();
        for (r, run) in observations.runs.iter_mut().enumerate() {
            let mut hidden: Vec<bool> = run.y[c].iter().map(|&y| band.holds(y)).collect();
            let own = residuals.windows.iter().zip(&residuals.sizes);
            for (_, lists) in own.filter(|(w, _)| w.run == r) {
                for x in lists.iter().flat_map(|lists| &lists[c]) {
                    hidden[x.sample] |= band.holds(x.expected);
                }
            }
            for k in 0..hidden.len() {
                if hidden[k] {
                    run.valid[c][k] = false;
                    if k == 0 || !hidden[k - 1] {
                        stretches.push([run.t[k], run.t[k]]);
                    } else if let Some(last) = stretches.last_mut() {
                        last[1] = run.t[k];
                    }
                }
            }
        }
        if !passes_undisturbed(study, fitted, &observations, c) {
            continue;
        }
        look.observations = observations;
        let unit = coordinate.unit();
        look.faults.push(DataFault {
            kind: "blind_zone".into(),
            column: format!("q.{}", coordinate.name),
            detail: format!(
                "{} of {} large residuals lie between {:.3} and {:.3} {unit}, and the motion comes out of there undisturbed: it is the \
                 sensor that does not see there; its readings in this band are left out",
                band.inside, band.large, band.from, band.to
            ),
            when: stretches.into_iter().take(super::MOST_LISTED).collect(),
        });
    }
}

/// A band of readings.
struct Band {
    from: f64,
    to: f64,
    circle: bool,
    /// Large residuals in it, and all large ones.
    inside: usize,
    large: usize,
}

impl Band {
    fn holds(&self, y: f64) -> bool {
        let y = if self.circle { wrap_angle(y) } else { y };
        match self.from <= self.to {
            true => (self.from..=self.to).contains(&y),
            false => y >= self.from || y <= self.to,
        }
    }

    /// The narrowest band with nearly all large residuals of channel `c`.
    fn of(residuals: &Residuals, c: usize, angular: bool) -> Option<Band> {
        let all: Vec<Residual> = residuals
            .sizes
            .iter()
            .flatten()
            .flat_map(|lists| &lists[c])
            .copied()
            .collect();
        let limit = 6.0 * robust(all.iter().map(|x| x.size)).max(1.0);
        let expected = || all.iter().map(|x| x.expected);
        let low = expected().fold(f64::INFINITY, f64::min);
        let high = expected().fold(f64::NEG_INFINITY, f64::max);
        let turn = 2.0 * std::f64::consts::PI;
        let circle = angular && high - low > turn;
        let (low, width) = match circle {
            true => (-std::f64::consts::PI, turn),
            false => (low, high - low),
        };
        if width.is_nan() || width <= 0.0 {
            return None;
        }
        let part = |y: f64| {
            let y = if circle { wrap_angle(y) } else { y };
            (((y - low) / width * PARTS as f64) as usize).min(PARTS - 1)
        };
        let (mut large, mut count) = ([0_usize; PARTS], [0_usize; PARTS]);
        for x in &all {
            count[part(x.expected)] += 1;
            large[part(x.expected)] += usize::from(x.size > limit);
        }
        let total: usize = large.iter().sum();
        if total < FEWEST || 4 * total > all.len() {
            return None;
        }
        (1..=WIDEST).find_map(|wide| {
            let starts = if circle { PARTS } else { PARTS + 1 - wide };
            let sum = |of: &[usize; PARTS], first: usize| -> usize {
                (first..first + wide).map(|k| of[k % PARTS]).sum()
            };
            let first = (0..starts).max_by_key(|&first| sum(&large, first))?;
            let (inside, there) = (sum(&large, first), sum(&count, first));
            let step = width / PARTS as f64;
            let edge = |k: usize| {
                let y = low + k as f64 * step;
                if circle && k.is_multiple_of(PARTS) && k > 0 {
                    low + width
                } else if circle {
                    wrap_angle(y)
                } else {
                    y
                }
            };
            let dense = inside as f64 > DENSE * there as f64;
            (inside as f64 >= SHARE * total as f64 && dense).then(|| Band {
                from: edge(first),
                to: edge(first + wide),
                circle,
                inside,
                large: total,
            })
        })
    }
}

/// Whether, without the hidden readings, the windows that pass through a band fit on both sides of it.
fn passes_undisturbed(
    study: &Study,
    fitted: &Fitted,
    observations: &Observations,
    c: usize,
) -> bool {
    let masked = Study {
        observations: observations.clone(),
        ..study.clone()
    };
    let start = fitted.start(fitted.inside.theta.clone());
    let refitted = masked.fit(fitted.hybrid.clone(), start, 2, 8);
    let residuals = Residuals::of(&masked, &refitted);
    let all = residuals.sizes.iter().flatten().flat_map(|lists| &lists[c]);
    let limit = 5.0 * robust(all.map(|x| x.size)).max(1.0);
    let mut passing = 0;
    let (mut samples, mut large) = (0, 0);
    for (window, lists) in residuals.windows.iter().zip(&residuals.sizes) {
        let valid = &observations.runs[window.run].valid[c][window.first..][..window.count];
        let first = valid.iter().position(|v| !v).unwrap_or(0);
        let last = valid.iter().rposition(|v| !v).unwrap_or(0);
        if first < EITHER_SIDE || last + EITHER_SIDE >= window.count {
            continue;
        }
        let Some(lists) = lists else {
            return false;
        };
        passing += 1;
        samples += lists[c].len();
        large += lists[c].iter().filter(|x| x.size > limit).count();
    }
    passing >= PASSES && 20 * large < samples
}
