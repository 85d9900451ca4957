//! What a log can show, before anything is fitted.
//!
//! A force p f(t) on a coordinate of inertia m moves it by p δ(t), δ̈ = f/m, beside what the model knows. Within a window the initial
//! position and velocity are free: what is left of δ without its straight line, over the sensor's noise σ, is the information
//! I = Σ (δ⊥/σ)², and p is not seen below 4/√I, the deviation that a finding needs. This holds at best: free masses and gains take
//! their part. Two forces whose δ⊥ are nearly proportional look alike in the log.

use super::super::advise::spoken;
use super::super::smooth::Smoothed;
use super::super::verdict::{Alike, CoordinateExcitation, Excitation, InputExcitation, Limit};
use crate::digits::number;
use crate::effect::{Quantity, Scales, smooth_sign};
use crate::hybrid::Hybrid;
use crate::shooting::{Observations, Window};

/// Deviations of noise that a finding needs.
const FINDING: f64 = 4.0;
/// Forces whose motions are correlated more than this look alike.
const ALIKE: f64 = 0.97;
/// An input below this part of its largest size is at zero.
const ZERO: f64 = 1e-3;

/// A force of unit size on a coordinate, of its (q − centre, v).
type Shape = fn(f64, f64, f64) -> f64;

/// Name of the kind, its parameter, what that measures, and the force.
const SHAPES: [(&str, &str, Quantity, Shape); 6] = [
    (
        "viscous_friction",
        "coefficient",
        Quantity::Damping,
        |_, v, _| v,
    ),
    (
        "coulomb_friction",
        "force",
        Quantity::Force,
        |_, v, smoothing| smooth_sign(v, smoothing),
    ),
    (
        "quadratic_drag",
        "coefficient",
        Quantity::QuadraticDamping,
        |_, v, _| v * v.abs(),
    ),
    (
        "linear_spring",
        "stiffness",
        Quantity::Stiffness,
        |q, _, _| q,
    ),
    (
        "cubic_spring",
        "stiffness",
        Quantity::CubicStiffness,
        |q, _, _| q * q * q,
    ),
    ("constant_force", "force", Quantity::Force, |_, _, _| 1.0),
];

/// What the recordings excite, over these windows.
pub fn excitation(
    hybrid: &Hybrid,
    observations: &Observations,
    smoothed: &[Smoothed],
    scales: &[Scales],
    windows: &[Window],
    inputs: &[String],
) -> Excitation {
    let coordinates = hybrid.mechanics().coordinates();
    let mut excitation = Excitation::default();
    for (c, coordinate) in coordinates.iter().enumerate() {
        let q = || smoothed.iter().flat_map(|s| &s.q[c]).copied();
        let square = |of: fn(&Smoothed) -> &Vec<Vec<f64>>| -> f64 {
            smoothed.iter().flat_map(|s| &of(s)[c]).map(|x| x * x).sum()
        };
        let speed = square(|s| &s.v);
        let reversals = smoothed.iter().map(|s| reversals(&s.v[c], scales[c].speed));
        excitation.coordinates.push(CoordinateExcitation {
            name: coordinate.name.clone(),
            unit: coordinate.unit().into(),
            range: [
                q().fold(f64::INFINITY, f64::min),
                q().fold(f64::NEG_INFINITY, f64::max),
            ],
            speed: scales[c].speed,
            reversals: reversals.sum(),
            mean_frequency: match speed > 0.0 {
                true => (square(|s| &s.a) / speed).sqrt() / (2.0 * std::f64::consts::PI),
                false => 0.0,
            },
        });
        limits_on(
            c,
            hybrid,
            observations,
            smoothed,
            scales,
            windows,
            &mut excitation,
        );
    }
    for (i, name) in inputs.iter().enumerate() {
        let u = || {
            observations
                .runs
                .iter()
                .flat_map(move |run| &run.u[i])
                .copied()
        };
        let largest = u().fold(0.0_f64, |m, u| m.max(u.abs()));
        let count = u().count().max(1) as f64;
        excitation.inputs.push(InputExcitation {
            name: name.clone(),
            range: [
                u().fold(f64::INFINITY, f64::min),
                u().fold(f64::NEG_INFINITY, f64::max),
            ],
            zero_share: u().filter(|u| u.abs() <= ZERO * largest).count() as f64 / count,
        });
    }
    excitation.sentences = sentences(&excitation);
    excitation
}

/// How often a velocity changes its sign and then exceeds a twentieth of the usual speed.
fn reversals(v: &[f64], speed: f64) -> usize {
    let mut side = 0.0;
    let mut count = 0;
    for &v in v.iter().filter(|v| v.abs() > 0.05 * speed) {
        count += usize::from(side * v < 0.0);
        side = v;
    }
    count
}

fn limits_on(
    c: usize,
    hybrid: &Hybrid,
    observations: &Observations,
    smoothed: &[Smoothed],
    scales: &[Scales],
    windows: &[Window],
    excitation: &mut Excitation,
) {
    const N: usize = SHAPES.len();
    let coordinate = &hybrid.mechanics().coordinates()[c];
    let Some(noise) = observations.channels.get(c).map(|channel| channel.noise) else {
        return;
    };
    let smoothing = hybrid.default_smoothing(c);
    let mut products = [[0.0; N]; N];
    for window in windows {
        let t = &observations.runs[window.run].t[window.first..window.first + window.count];
        let states = &smoothed[window.run];
        let moved = SHAPES.map(|(.., shape)| {
            let force: Vec<f64> = (window.first..window.first + window.count)
                .map(|k| shape(states.q[c][k] - scales[c].centre, states.v[c][k], smoothing))
                .collect();
            without_line(t, &twice_integrated(t, &force, scales[c].mass))
        });
        for (i, row) in products.iter_mut().enumerate() {
            for (j, sum) in row.iter_mut().enumerate() {
                let product: f64 = moved[i].iter().zip(&moved[j]).map(|(a, b)| a * b).sum();
                *sum += product / (noise * noise);
            }
        }
    }
    for (i, (kind, parameter, quantity, _)) in SHAPES.iter().enumerate() {
        let information = products[i][i];
        excitation.limits.push(Limit {
            kind: (*kind).into(),
            target: coordinate.name.clone(),
            parameter: (*parameter).into(),
            least: (information > 0.0).then(|| FINDING / information.sqrt()),
            unit: quantity.unit(coordinate.angular).into(),
        });
        for (j, (other, ..)) in SHAPES.iter().enumerate().take(i) {
            let correlation = products[i][j] / (information * products[j][j]).sqrt();
            if correlation.abs() > ALIKE {
                excitation.alike.push(Alike {
                    target: coordinate.name.clone(),
                    kinds: [(*other).into(), (*kind).into()],
                    correlation,
                });
            }
        }
    }
}

/// ∬ force/mass over the times `t`, from rest at the first; the force straight between samples.
fn twice_integrated(t: &[f64], force: &[f64], mass: f64) -> Vec<f64> {
    let (mut x, mut v) = (0.0, 0.0);
    let mut out = vec![0.0];
    for (t, f) in t.windows(2).zip(force.windows(2)) {
        let h = t[1] - t[0];
        x += v * h + h * h * (2.0 * f[0] + f[1]) / (6.0 * mass);
        v += 0.5 * h * (f[0] + f[1]) / mass;
        out.push(x);
    }
    out
}

/// What is left of `y` without the straight line that fits it best.
fn without_line(t: &[f64], y: &[f64]) -> Vec<f64> {
    let n = t.len().max(1) as f64;
    let (t_mean, y_mean) = (t.iter().sum::<f64>() / n, y.iter().sum::<f64>() / n);
    let square: f64 = t.iter().map(|t| (t - t_mean).powi(2)).sum();
    let product: f64 = t.iter().zip(y).map(|(t, y)| (t - t_mean) * y).sum();
    let slope = if square > 0.0 { product / square } else { 0.0 };
    t.iter()
        .zip(y)
        .map(|(t, y)| y - y_mean - slope * (t - t_mean))
        .collect()
}

fn capital(words: &str) -> String {
    let mut letters = words.chars();
    let first = letters.next().map(|c| c.to_uppercase().to_string());
    first.unwrap_or_default() + letters.as_str()
}

/// The same in words: only what has been computed.
fn sentences(excitation: &Excitation) -> Vec<String> {
    let mut said = Vec::new();
    for c in &excitation.coordinates {
        let turns = match c.reversals {
            0 => "never turns round: friction and a constant force look alike".to_owned(),
            1 => "turns round once".to_owned(),
            n => format!("turns round {n} times"),
        };
        said.push(format!(
            "`{}` moves from {} to {} {unit}, 95 % of the time slower than {} {unit}/s, and {turns}.",
            c.name,
            number(c.range[0]),
            number(c.range[1]),
            number(c.speed),
            unit = c.unit
        ));
        let own = excitation.limits.iter().filter(|l| l.target == c.name);
        let seen: Vec<String> = own
            .clone()
            .filter_map(|l| {
                let least = l.least?;
                Some(format!("{} {least:.1e} {}", spoken(&l.kind), l.unit))
            })
            .collect();
        if !seen.is_empty() {
            said.push(format!(
                "Below these sizes nothing on `{}` can be seen in these data: {}.",
                c.name,
                seen.join(", ")
            ));
        }
        for l in own.filter(|l| l.least.is_none()) {
            said.push(format!(
                "No {} on `{}` can be seen in these data.",
                spoken(&l.kind),
                c.name
            ));
        }
    }
    for alike in &excitation.alike {
        let [a, b] = alike.kinds.each_ref().map(|kind| spoken(kind));
        said.push(format!(
            "{} and {b} on `{}` move it alike here (correlation {:.3}): they are hard to tell apart.",
            capital(&a), alike.target, alike.correlation
        ));
    }
    for input in &excitation.inputs {
        said.push(format!(
            "Input `{}` goes from {} to {} and is zero in {:.0} % of the samples.",
            input.name,
            number(input.range[0]),
            number(input.range[1]),
            100.0 * input.zero_share
        ));
    }
    said
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_constant_force_bends_the_path_by_what_galilei_says() {
        let t: Vec<f64> = (0..31).map(|k| 0.02 * k as f64).collect();
        let x = twice_integrated(&t, &[3.0; 31], 2.0);
        for (t, x) in t.iter().zip(&x) {
            assert!((x - 0.75 * t * t).abs() < 1e-12);
        }
        let rest = without_line(&t, &x);
        assert!(rest.iter().sum::<f64>().abs() < 1e-12);
        assert!(rest[0] > 0.0 && rest[15] < 0.0 && rest[30] > 0.0);
    }

    #[test]
    fn a_velocity_that_never_changes_sign_does_not_reverse() {
        assert_eq!(reversals(&[1.0, 0.5, 0.01, -0.01, 0.4], 1.0), 0);
        assert_eq!(reversals(&[1.0, 0.5, -0.5, -1.0, 0.4], 1.0), 2);
    }
}
