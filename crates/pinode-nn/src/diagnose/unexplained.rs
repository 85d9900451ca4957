//! What is left when no effect explains it: the residual force of the worst coordinate as a function of what it depends on.
//!
//! All shares are adjusted correlation ratios, η² = 1 − [RSS/(n − B)] / [TSS/(n − 1)] over B bins: 0 in the mean for a signal that says
//! nothing, however many bins. What part of the force is the noise of its reconstruction no signal can explain.

use super::advise::spoken;
use super::curves::ResidualForce;
use super::remainder::Remainder;
use super::signals::{TIED, clipped, relative};
use super::study::{Fitted, Study};
use super::verdict::{ForceCurve, Memory, NearShape, SharedSignal, Unexplained};
use crate::bins::{binned, cell_means, explained_by};
use crate::digits::number;
use crate::effect::{Action, registry};
use crate::learnt::Quantity;

/// Points of the curve, and bins of each signal where two or three are taken together.
const POINTS: usize = 24;
const BINS_OF_TWO: usize = 8;
const BINS_OF_THREE: usize = 5;
/// Fewer samples say nothing.
const FEWEST: usize = 300;
/// A second signal has to explain so much more, and the past so much of what the present leaves.
const WORTH: f64 = 0.1;
/// So many library shapes are listed.
const LISTED: usize = 3;
/// How far back the past is asked, s at the usual pace.
const PAST: [f64; 2] = [0.1, 0.25];

/// A signal at the looked-at samples.
struct Signal {
    name: String,
    unit: String,
    values: Vec<f64>,
    /// What a network sees of it; time is nothing that a force follows.
    quantities: Vec<Quantity>,
}

impl Signal {
    /// Its share as it is compared with that of others: one of two coordinates has to explain more than one of each by itself.
    fn merit(&self, share: f64) -> f64 {
        match self.quantities.len() {
            2.. => share - TIED,
            _ => share,
        }
    }
}

/// Describes what a fitted model leaves on the coordinate of `residual`, which is the `c`th; `left` is what it follows from, where the
/// windows show that. The signals that it follows most come with it.
pub fn describe(
    study: &Study,
    fitted: &Fitted,
    (residual, c): (&ResidualForce, usize),
    left: Option<&Remainder>,
    inputs: &[String],
) -> Option<(Unexplained, Vec<Quantity>)> {
    let force = clipped(&residual.force);
    if force.len() < FEWEST {
        return None;
    }
    let places = places(study, residual);
    let present = present(study, fitted, &places, inputs);
    let mut explained: Vec<(usize, f64)> = present
        .iter()
        .enumerate()
        .map(|(s, signal)| (s, explained_by(&force, &[&signal.values], POINTS / 2)))
        .collect();
    let merit = |&(s, share): &(usize, f64)| present[s].merit(share);
    explained.sort_by(|a, b| merit(b).total_cmp(&merit(a)));
    let &(best, alone) = explained.first()?;

    let of_two = |s: usize| {
        explained_by(
            &force,
            &[&present[best].values, &present[s].values],
            BINS_OF_TWO,
        )
    };
    let second = (0..present.len())
        .filter(|&s| s != best)
        .map(|s| (s, of_two(s)))
        .max_by(|a, b| merit(a).total_cmp(&merit(b)))
        .filter(|&(_, both)| both > alone + WORTH);
    let coordinates = fitted.hybrid.mechanics().coordinates();
    let names: Vec<&str> = coordinates.iter().map(|c| c.name.as_str()).collect();
    let memory = memory(
        study,
        residual,
        &force,
        &places,
        &present,
        (best, second.map(|s| s.0)),
        (&names, inputs),
    );
    let curve = curve(&force, &present[best]);
    let unit = residual.unit.clone();
    let share = |s: usize, share: f64| SharedSignal {
        signal: present[s].name.clone(),
        unit: present[s].unit.clone(),
        share,
    };
    let mut unexplained = Unexplained {
        coordinate: residual.coordinate.clone(),
        rms: (force.iter().map(|f| f * f).sum::<f64>() / force.len() as f64).sqrt(),
        unit,
        depends_on: explained
            .iter()
            .take(5)
            .map(|&(s, x)| share(s, x))
            .collect(),
        together_with: second.map(|(s, both)| share(s, both)),
        odd_share: odd_share(&curve),
        memory,
        curve,
        nearest: nearest(study, fitted, &force, &places, c),
        follows: None,
        learnt: None,
        sentences: Vec::new(),
    };
    let follows_most = (alone > WORTH).then_some(best).into_iter();
    let signals = follows_most
        .chain(second.map(|s| s.0))
        .flat_map(|s| present[s].quantities.clone())
        .collect();
    if let Some(left) = left {
        let follows = left.words(coordinates);
        unexplained.sentences.push(format!(
            "A law is missing that follows {follows}: a curve without a formula, fitted to four fifths of the windows, explains the rest \
             better by {:.2} nats a sample, {:.0} standard errors.",
            left.gain_per_sample, left.z
        ));
        unexplained.follows = Some(follows);
    }
    unexplained.sentences.extend(sentences(&unexplained));
    Some((unexplained, signals))
}

/// (recording, sample) of each looked-at time.
fn places(study: &Study, residual: &ResidualForce) -> Vec<(usize, usize)> {
    let at = residual.run.iter().zip(&residual.t);
    at.map(|(&run, &t)| (run, sample_at(study, run, t)))
        .collect()
}

fn sample_at(study: &Study, run: usize, t: f64) -> usize {
    let times = &study.observations.runs[run].t;
    times.partition_point(|&x| x < t).min(times.len() - 1)
}

/// Positions, velocities, inputs and time.
fn present(
    study: &Study,
    fitted: &Fitted,
    places: &[(usize, usize)],
    inputs: &[String],
) -> Vec<Signal> {
    let mut signals = Vec::new();
    for (c, coordinate) in fitted.hybrid.mechanics().coordinates().iter().enumerate() {
        let unit = coordinate.unit();
        let of = |columns: fn(&super::smooth::Smoothed) -> &Vec<Vec<f64>>| {
            let at = |&(run, k): &(usize, usize)| columns(&study.smoothed[run])[c][k];
            places.iter().map(at).collect()
        };
        signals.push(Signal {
            name: format!("velocity of {}", coordinate.name),
            unit: format!("{unit}/s"),
            values: of(|s| &s.v),
            quantities: vec![Quantity::Velocity(c)],
        });
        signals.push(Signal {
            name: format!("position of {}", coordinate.name),
            unit: unit.to_owned(),
            values: of(|s| &s.q),
            quantities: vec![Quantity::Position(c)],
        });
    }
    let coordinates = fitted.hybrid.mechanics().coordinates();
    for (c, of_pair) in relative(coordinates) {
        let between = |of: fn(&super::smooth::Smoothed) -> &Vec<Vec<f64>>| {
            let at = |&(run, k): &(usize, usize)| {
                let columns = of(&study.smoothed[run]);
                columns[c + 1][k] - columns[c][k]
            };
            places.iter().map(at).collect()
        };
        let unit = coordinates[c].unit();
        signals.push(Signal {
            name: format!("velocity of {of_pair}"),
            unit: format!("{unit}/s"),
            values: between(|s| &s.v),
            quantities: vec![Quantity::Velocity(c + 1), Quantity::Velocity(c)],
        });
        signals.push(Signal {
            name: format!("position of {of_pair}"),
            unit: unit.to_owned(),
            values: between(|s| &s.q),
            quantities: vec![Quantity::Position(c + 1), Quantity::Position(c)],
        });
    }
    for (i, name) in inputs.iter().enumerate() {
        let at = |&(run, k): &(usize, usize)| study.observations.runs[run].u[i][k];
        signals.push(Signal {
            name: format!("input {name}"),
            unit: String::new(),
            values: places.iter().map(at).collect(),
            quantities: vec![Quantity::Input { input: i, back: 0 }],
        });
    }
    signals.push(Signal {
        name: "time".to_owned(),
        unit: "s".to_owned(),
        values: places
            .iter()
            .map(|&(run, k)| study.observations.runs[run].t[k])
            .collect(),
        quantities: Vec::new(),
    });
    signals
}

/// What the past says of the force where position, velocity and what it depends on most are known already.
fn memory(
    study: &Study,
    residual: &ResidualForce,
    force: &[f64],
    places: &[(usize, usize)],
    present: &[Signal],
    (best, second): (usize, Option<usize>),
    (names, inputs): (&[&str], &[String]),
) -> Memory {
    let mut given: Vec<&[f64]> = vec![&present[best].values];
    given.extend(second.map(|s| present[s].values.as_slice()));
    // The present in full, as far as three signals tell it: the coordinate's own velocity and position come first.
    for name in ["velocity", "position"] {
        let own = format!("{name} of {}", residual.coordinate);
        let signal = present.iter().find(|s| s.name == own);
        let new = signal.filter(|s| !given.iter().any(|g| std::ptr::eq(*g, s.values.as_slice())));
        if given.len() < 3 {
            given.extend(new.map(|s| s.values.as_slice()));
        }
    }
    let bins = if given.len() > 2 {
        BINS_OF_THREE
    } else {
        BINS_OF_TWO
    };
    let (means, _) = cell_means(force, &given, bins);
    let kept: Vec<usize> = (0..force.len()).filter(|&k| means[k].is_some()).collect();
    let left: Vec<f64> = kept
        .iter()
        .map(|&k| force[k] - means[k].unwrap_or(0.0))
        .collect();
    let mut past: Vec<(String, Vec<f64>)> = Vec::new();
    for back in PAST.map(|usual| study.pace.long(usual)) {
        let earlier = |k: usize| {
            let (run, sample) = places[k];
            let t = study.observations.runs[run].t[sample];
            (run, sample_at(study, run, t - back), sample)
        };
        for (c, name) in names.iter().enumerate() {
            let change = |&k: &usize| {
                let (run, then, now) = earlier(k);
                let v = &study.smoothed[run].v[c];
                v[now] - v[then]
            };
            past.push((
                format!("change of the velocity of {name} over {back} s"),
                kept.iter().map(change).collect(),
            ));
        }
        for (i, name) in inputs.iter().enumerate() {
            let change = |&k: &usize| {
                let (run, then, now) = earlier(k);
                let u = &study.observations.runs[run].u[i];
                u[now] - u[then]
            };
            past.push((
                format!("change of input {name} over {back} s"),
                kept.iter().map(change).collect(),
            ));
        }
    }
    let best = past
        .iter()
        .map(|(name, values)| (name, explained_by(&left, &[values], POINTS / 2)))
        .max_by(|a, b| a.1.total_cmp(&b.1));
    match best {
        Some((name, share)) => Memory {
            present: share > WORTH,
            share,
            by: name.clone(),
        },
        None => Memory::default(),
    }
}

/// Means over quantile bins of the best signal.
fn curve(force: &[f64], signal: &Signal) -> ForceCurve {
    let bins = binned(&signal.values, POINTS);
    let mut sums = vec![[0.0; 4]; POINTS];
    for ((&bin, &f), &x) in bins.iter().zip(force).zip(&signal.values) {
        let sum = &mut sums[bin];
        sum[0] += 1.0;
        sum[1] += x;
        sum[2] += f;
        sum[3] += f * f;
    }
    sums.retain(|s| s[0] > 1.0);
    ForceCurve {
        signal: signal.name.clone(),
        unit: signal.unit.clone(),
        at: sums.iter().map(|s| s[1] / s[0]).collect(),
        force: sums.iter().map(|s| s[2] / s[0]).collect(),
        std: sums
            .iter()
            .map(|[n, _, f, square]| ((square / n - (f / n).powi(2)).max(0.0) / (n - 1.0)).sqrt())
            .collect(),
    }
}

/// The odd part's share of a curve about 0, over the speeds or sizes that it has on both sides. `None`: it has one side only.
fn odd_share(curve: &ForceCurve) -> Option<f64> {
    let at = |x: f64| -> Option<f64> {
        let k = curve.at.partition_point(|&a| a < x);
        let (a, b) = (curve.at.get(k.checked_sub(1)?)?, curve.at.get(k)?);
        let part = (x - a) / (b - a).max(f64::MIN_POSITIVE);
        Some(curve.force[k - 1] + part * (curve.force[k] - curve.force[k - 1]))
    };
    let mut pairs = Vec::new();
    for &x in curve.at.iter().filter(|x| **x > 0.0) {
        if let (Some(right), Some(left)) = (at(x), at(-x)) {
            pairs.push((0.5 * (right - left), 0.5 * (right + left)));
        }
    }
    if pairs.len() < 4 {
        return None;
    }
    let n = pairs.len() as f64;
    let even_mean = pairs.iter().map(|p| p.1).sum::<f64>() / n;
    let odd: f64 = pairs.iter().map(|p| p.0 * p.0).sum();
    let even: f64 = pairs.iter().map(|p| (p.1 - even_mean).powi(2)).sum();
    Some(odd / (odd + even).max(f64::MIN_POSITIVE))
}

/// The laws of the library on this coordinate whose force is most like this one, by correlation.
fn nearest(
    study: &Study,
    fitted: &Fitted,
    force: &[f64],
    places: &[(usize, usize)],
    c: usize,
) -> Vec<NearShape> {
    let coordinate = &fitted.hybrid.mechanics().coordinates()[c];
    let smoothing = fitted.hybrid.default_smoothing(c);
    let mut shapes: Vec<NearShape> = Vec::new();
    for kind in registry::all() {
        let Action::Joint(law) = kind.action else {
            continue;
        };
        // Beside what it would take the place of, a kind is tried for itself.
        let probes = (kind.probes)(&study.scales[c], &[]);
        let correlation = probes
            .iter()
            .map(|probe| {
                let made: Vec<f64> = places
                    .iter()
                    .map(|&(run, k)| {
                        let (q, v) = (study.smoothed[run].q[c][k], study.smoothed[run].v[c][k]);
                        law.force(q, v, &probe.perturbed, smoothing)
                            - law.force(q, v, &probe.neutral, smoothing)
                    })
                    .collect();
                correlation(force, &made)
            })
            .max_by(|a, b| a.abs().total_cmp(&b.abs()));
        if let Some(correlation) = correlation.filter(|r| r.is_finite()) {
            shapes.push(NearShape {
                kind: kind.name.into(),
                target: coordinate.name.clone(),
                correlation,
            });
        }
    }
    shapes.sort_by(|a, b| b.correlation.abs().total_cmp(&a.correlation.abs()));
    shapes.truncate(LISTED);
    shapes
}

fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let n = a.len().max(1) as f64;
    let (a_mean, b_mean) = (a.iter().sum::<f64>() / n, b.iter().sum::<f64>() / n);
    let (mut ab, mut aa, mut bb) = (0.0, 0.0, 0.0);
    for (a, b) in a.iter().zip(b) {
        ab += (a - a_mean) * (b - b_mean);
        aa += (a - a_mean).powi(2);
        bb += (b - b_mean).powi(2);
    }
    match aa * bb > 0.0 {
        true => ab / (aa * bb).sqrt(),
        false => f64::NAN,
    }
}

fn sentences(u: &Unexplained) -> Vec<String> {
    let mut said = Vec::new();
    let percent = |x: f64| format!("{:.0} %", 100.0 * x);
    let Some(best) = u.depends_on.first() else {
        return said;
    };
    let rms = match u.rms < 0.01 {
        true => format!("{:.2e}", u.rms),
        false => format!("{:.3}", u.rms),
    };
    said.push(match best.share < WORTH {
        true => format!(
            "On `{}` a force of {rms} {} (root mean square) is unexplained, and no signal by itself explains a tenth of its variance.",
            u.coordinate, u.unit
        ),
        false => format!(
            "On `{}` a force of {rms} {} (root mean square) is unexplained; {} of its variance follow the {}.",
            u.coordinate,
            u.unit,
            percent(best.share),
            best.signal
        ),
    });
    if best.share >= WORTH {
        if let Some(second) = &u.together_with {
            said.push(format!(
                "Together with the {} they are {}.",
                second.signal,
                percent(second.share)
            ));
        }
        if let Some(odd) = u.odd_share {
            said.push(match odd {
                x if x > 0.8 => format!("It is odd in the {}.", best.signal),
                x if x < 0.2 => format!("It is even in the {}, but for a constant.", best.signal),
                x => format!(
                    "It is neither odd nor even in the {} ({} odd).",
                    best.signal,
                    percent(x)
                ),
            });
        }
        if let (Some(from), Some(to)) = (u.curve.at.first(), u.curve.at.last()) {
            let unit = match u.curve.unit.as_str() {
                "" => String::new(),
                unit => format!(" {unit}"),
            };
            said.push(format!(
                "That is known from {} to {}{unit} and not beyond.",
                number(*from),
                number(*to)
            ));
        }
    }
    if u.memory.present {
        said.push(format!(
            "It has a memory: where position, velocity and that signal are the same, the {} explains {} of what is left.",
            u.memory.by,
            percent(u.memory.share)
        ));
    } else if u.follows.is_none() {
        said.push("No memory is seen: the recent past says nothing that position, velocity and that signal do not.".to_owned());
    }
    let near: Vec<String> = u
        .nearest
        .iter()
        .map(|s| format!("{} ({:+.2})", spoken(&s.kind), s.correlation))
        .collect();
    if !near.is_empty() {
        said.push(format!(
            "Nearest shapes of the library, by correlation: {}.",
            near.join(", ")
        ));
    }
    said
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bins::pseudo;

    #[test]
    fn an_odd_curve_is_odd_and_an_even_one_even_whatever_its_constant() {
        let of = |f: fn(f64) -> f64| {
            let values: Vec<f64> = (0..2000).map(|k| pseudo(k, 0.3)).collect();
            let force: Vec<f64> = values.iter().map(|&x| f(x)).collect();
            let signal = Signal {
                name: "velocity".into(),
                unit: "m/s".into(),
                values,
                quantities: Vec::new(),
            };
            odd_share(&curve(&force, &signal)).unwrap_or(f64::NAN)
        };
        assert!(of(|x| x.powi(3) - 2.0 * x) > 0.95);
        assert!(of(|x| 3.0 + x * x) < 0.05);
    }
}
