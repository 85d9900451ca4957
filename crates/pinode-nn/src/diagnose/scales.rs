//! How large the motion in a log is.

use super::smooth::Smoothed;
use crate::effect::Scales;
use crate::hybrid::Hybrid;
use crate::shooting::Observations;

/// The scales of the motion, one a coordinate.
pub fn scales(hybrid: &Hybrid, smoothed: &[Smoothed], observations: &Observations) -> Vec<Scales> {
    let nv = hybrid.nv();
    let theta = hybrid.theta();
    let mut memory = hybrid.memory(&[]);
    let mut mass = nalgebra::DMatrix::zeros(nv, nv);
    (0..nv)
        .map(|c| {
            let q = || smoothed.iter().flat_map(|s| &s.q[c]).copied();
            let low = q().fold(f64::INFINITY, f64::min);
            let high = q().fold(f64::NEG_INFINITY, f64::max);
            let mut speed: Vec<f64> = smoothed
                .iter()
                .flat_map(|s| &s.v[c])
                .map(|v| v.abs())
                .collect();
            speed.sort_by(f64::total_cmp);
            let mut square = 0.0;
            let mut entry = 0.0;
            let mut n = 0.0;
            for s in smoothed {
                let stride = (s.q[c].len() / 500).max(1);
                for k in (0..s.q[c].len()).step_by(stride) {
                    let state = s.state(k);
                    hybrid.mass_matrix_into(&state[..nv], &theta, &mut memory, &mut mass);
                    square += (mass[(c, c)] * s.a[c][k]).powi(2);
                    entry += mass[(c, c)];
                    n += 1.0;
                }
            }
            let own = (0..hybrid.inputs()).filter(|&i| hybrid.input_coordinates()[i] == c);
            let inputs = own.flat_map(|i| observations.runs.iter().flat_map(move |run| &run.u[i]));
            let (mut input, mut largest, mut count) = (0.0, 0.0_f64, 0.0);
            for u in inputs {
                input += u * u;
                largest = largest.max(u.abs());
                count += 1.0;
            }
            let positive = |x: f64| if x > 0.0 { x } else { 1.0 };
            Scales {
                centre: 0.5 * (low + high),
                reach: positive(0.5 * (high - low)),
                speed: positive(speed.get(speed.len() * 19 / 20).copied().unwrap_or(0.0)),
                force: positive((square / f64::max(n, 1.0)).sqrt()),
                mass: positive(entry / f64::max(n, 1.0)),
                input: (input / f64::max(count, 1.0)).sqrt(),
                largest_input: largest,
                noise: observations
                    .channels
                    .get(c)
                    .map_or(f64::INFINITY, |own| own.noise),
                blows: blows(smoothed, c, (low, high)),
            }
        })
        .collect()
}

/// Within this part of half the range a motion is at its end.
const END: f64 = 0.04;
/// So many samples there may be accelerated harder.
const FEW: usize = 4;

/// [`Scales::blows`] of a coordinate that ranges from `low` to `high`.
fn blows(smoothed: &[Smoothed], c: usize, (low, high): (f64, f64)) -> f64 {
    let samples = || smoothed.iter().flat_map(|s| s.q[c].iter().zip(&s.a[c]));
    let margin = END * 0.5 * (high - low);
    let mut all: Vec<f64> = samples().map(|(_, a)| a.abs()).collect();
    let inwards = samples().filter_map(|(&q, &a)| match (q - low < margin, high - q < margin) {
        (true, _) => Some(a),
        (_, true) => Some(-a),
        _ => None,
    });
    let mut inwards: Vec<f64> = inwards.collect();
    all.sort_by(f64::total_cmp);
    inwards.sort_by(|a, b| b.total_cmp(a));
    let usual = all.get(all.len() * 19 / 20).copied().unwrap_or(0.0);
    match inwards.get(FEW) {
        Some(hard) if usual > 0.0 => hard / usual,
        _ => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A motion of amplitude 1 with these accelerations where it turns, ω² elsewhere.
    fn turned(at_ends: f64) -> Smoothed {
        let phase = |k: usize| std::f64::consts::TAU * k as f64 / 100.0;
        let q: Vec<f64> = (0..2000).map(|k| phase(k).sin()).collect();
        let a = q.iter().map(|q| match q.abs() > 0.999 {
            true => -at_ends * q.signum(),
            false => -q,
        });
        Smoothed {
            a: vec![a.collect()],
            v: vec![(0..2000).map(|k| phase(k).cos()).collect()],
            q: vec![q],
        }
    }

    #[test]
    fn what_is_struck_at_its_ends_is_turned_harder_than_what_swings() {
        let of = |at_ends: f64| blows(&[turned(at_ends)], 0, (-1.0, 1.0));
        assert!((of(1.0) - 1.0).abs() < 0.01, "{}", of(1.0));
        assert!(of(8.0) > 2.0, "{}", of(8.0));
        // Thrown outwards is not struck.
        assert!(of(-8.0) < 1.01, "{}", of(-8.0));
        assert_eq!(blows(&[], 0, (0.0, 1.0)), 0.0);
    }
}
