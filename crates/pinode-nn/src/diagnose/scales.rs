//! How large the motion in a log is.

use super::blows::struck;
use super::rests::held;
use super::smooth::Smoothed;
use crate::effect::Scales;
use crate::hybrid::Hybrid;
use crate::shooting::Observations;

/// What is smooth enough for a parabola, over what is enough for a cubic on either side of its middle.
const FREE: f64 = 5.0 / 3.0;

/// The scales of the motion, one a coordinate, smoothed over `half_width` s.
pub fn scales(
    hybrid: &Hybrid,
    (smoothed, half_width): (&[Smoothed], f64),
    observations: &Observations,
) -> Vec<Scales> {
    let nv = hybrid.nv();
    let theta = hybrid.theta();
    let mut memory = hybrid.memory(&[]);
    let mut mass = nalgebra::DMatrix::zeros(nv, nv);
    let held = held(hybrid, smoothed, observations);
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
            let own = (0..hybrid.inputs()).filter(|&i| hybrid.moves(i, c));
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
                struck: struck(observations, c, FREE * half_width),
                held: held[c],
            }
        })
        .collect()
}
