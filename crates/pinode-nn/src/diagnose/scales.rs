//! How large the motion in a log is.

use std::ops::Deref;

use nalgebra::Cholesky;

use super::blows::struck;
use super::pace::Pace;
use super::rests::held;
use super::smooth::Smoothed;
use crate::effect::Scales;
use crate::hybrid::Hybrid;
use crate::shooting::Observations;

/// What is smooth enough for a parabola, over what is enough for a cubic on either side of its middle.
const FREE: f64 = 5.0 / 3.0;

/// The scales of the motion, one a coordinate, and the sizes of the inputs: what is asked of one of them is measured by that one, for others may be in other
/// units.
#[derive(Debug, Clone)]
pub struct MotionScales {
    coordinates: Vec<Scales>,
    /// Root mean square and largest size, as logged.
    inputs: Vec<[f64; 2]>,
}

impl Deref for MotionScales {
    type Target = [Scales];

    fn deref(&self) -> &[Scales] {
        &self.coordinates
    }
}

impl MotionScales {
    /// Root mean square of an input as logged.
    pub fn usual_input(&self, input: usize) -> f64 {
        self.inputs[input][0]
    }

    /// Those of a coordinate with the size of an input.
    pub fn of_input(&self, input: usize, coordinate: usize) -> Scales {
        let [input, largest_input] = self.inputs[input];
        Scales {
            input,
            largest_input,
            ..self.coordinates[coordinate]
        }
    }
}

/// Root mean square and largest size.
fn size<'a>(u: impl Iterator<Item = &'a f64>) -> [f64; 2] {
    let (mut square, mut largest, mut count) = (0.0, 0.0_f64, 0.0);
    for u in u {
        square += u * u;
        largest = largest.max(u.abs());
        count += 1.0;
    }
    [(square / f64::max(count, 1.0)).sqrt(), largest]
}

/// The scales of the motion of this pace.
pub fn scales(
    hybrid: &Hybrid,
    (smoothed, pace): (&[Smoothed], &Pace),
    observations: &Observations,
) -> MotionScales {
    let nv = hybrid.nv();
    let theta = hybrid.theta();
    let mut memory = hybrid.memory(&[]);
    let mut mass = nalgebra::DMatrix::zeros(nv, nv);
    let held = held(hybrid, smoothed, observations);
    let logged = |i: usize| observations.runs.iter().flat_map(move |run| &run.u[i]);
    // Of a motor that the model already has by itself, which was taken out of M_cc and so, one for one, out of what moves.
    let taken = |c: usize| -> f64 {
        let effects = hybrid.effects().iter().enumerate();
        let own = effects.filter(|(_, e)| hybrid.coordinate_of(e.kind, e.target) == c);
        let within = own.filter_map(|(index, e)| {
            let motor = e.kind.motor()?;
            motor.inertia_within(&theta[hybrid.range(index)])
        });
        within.sum()
    };
    let coordinates = (0..nv)
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
            let (mut entry, mut freed) = (0.0, 0.0);
            let mut n = 0.0;
            for s in smoothed {
                let stride = (s.q[c].len() / 500).max(1);
                for k in (0..s.q[c].len()).step_by(stride) {
                    let state = s.state(k);
                    hybrid.mass_matrix_into(&state[..nv], &theta, &mut memory, &mut mass);
                    square += (mass[(c, c)] * s.a[c][k]).powi(2);
                    entry += mass[(c, c)];
                    let inverse = Cholesky::new(mass.clone()).map(|m| m.inverse()[(c, c)]);
                    freed += inverse.map_or(mass[(c, c)], |inverse| 1.0 / inverse);
                    n += 1.0;
                }
            }
            let own = (0..hybrid.inputs()).filter(|&i| hybrid.acts_on_joint(i, c));
            let [input, largest_input] = size(own.flat_map(logged));
            let positive = |x: f64| if x > 0.0 { x } else { 1.0 };
            Scales {
                centre: 0.5 * (low + high),
                reach: positive(0.5 * (high - low)),
                speed: positive(speed.get(speed.len() * 19 / 20).copied().unwrap_or(0.0)),
                force: positive((square / f64::max(n, 1.0)).sqrt()),
                mass: positive(entry / f64::max(n, 1.0)),
                free_mass: positive(freed / f64::max(n, 1.0)) + taken(c),
                input,
                largest_input,
                noise: observations
                    .channels
                    .get(c)
                    .map_or(f64::INFINITY, |own| own.noise),
                struck: struck(observations, c, FREE * pace.half_width()),
                held: held[c],
                pace: pace.times(),
            }
        })
        .collect();
    MotionScales {
        coordinates,
        inputs: (0..hybrid.inputs()).map(|i| size(logged(i))).collect(),
    }
}
