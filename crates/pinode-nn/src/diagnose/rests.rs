//! Rests that a log shows: how large the forces are under which a coordinate does not move.
//!
//! While q_j does not move though the model would, with the force r_j = Σ_i M_ji (v̇_i − v̇_i,model) that it lacks there, v̇_j = 0,
//!
//! |∬ r_j/M_jj dt² − line| ≫ noise ≥ |q_j − mean|,
//!
//! something holds it, by −r_j. A coordinate that turns round slowly stays within the noise as well; there r_j is small.

use nalgebra::DMatrix;

use super::smooth::{Smoothed, polynomial, unwrapped};
use crate::hybrid::{Hybrid, State};
use crate::shooting::Observations;

/// Readings at rest differ by so many times their noise at most.
const STILL: f64 = 6.0;
/// A rest has so many samples at least.
const FEWEST_SAMPLES: usize = 8;
/// Without what holds it the coordinate would have left the line by so many times the noise, root mean square.
const WOULD_MOVE: f64 = 5.0;
/// Fewer rests say nothing, nor do those of a coordinate that moves by no more than so many times the noise.
const FEWEST: usize = 5;
const MOVES: f64 = 20.0;
/// The forces that hold it are as large as this share of them: at the end of what looks like a rest it moves already.
const LARGE: f64 = 0.7;

/// The force that holds the coordinates of `hybrid`, with its constants as given, while they rest, N or N·m; 0 where none is seen to be held.
pub fn held(hybrid: &Hybrid, smoothed: &[Smoothed], observations: &Observations) -> Vec<f64> {
    let nv = hybrid.nv();
    let rests: Vec<Vec<Rest>> = (0..nv).map(|c| rests(observations, c)).collect();
    if rests.iter().all(|rests| rests.len() < FEWEST) {
        return vec![0.0; nv];
    }
    let lacking = Lacking::of(hybrid, smoothed, observations);
    let of_coordinate = |(c, rests): (usize, Vec<Rest>)| {
        let noise = observations.channels[c].noise;
        let holds = |rest: &&Rest| lacking.would_move(rest, c, observations) > WOULD_MOVE * noise;
        let held: Vec<&Rest> = rests.iter().filter(holds).collect();
        if held.len() < FEWEST {
            return 0.0;
        }
        let forces = held
            .iter()
            .flat_map(|rest| &lacking.force[rest.run][c][rest.first..rest.end]);
        let mut forces: Vec<f64> = forces.map(|f| f.abs()).collect();
        forces.sort_by(f64::total_cmp);
        let large = (LARGE * forces.len() as f64) as usize;
        forces.get(large).copied().unwrap_or(0.0)
    };
    rests.into_iter().enumerate().map(of_coordinate).collect()
}

/// Samples `first..end` of a recording in which a coordinate rests.
struct Rest {
    run: usize,
    first: usize,
    end: usize,
}

/// Where the `c`th coordinate rests, the longest stretches one after the other; none where it hardly ever moves.
fn rests(observations: &Observations, c: usize) -> Vec<Rest> {
    let channel = &observations.channels[c];
    let mut found = Vec::new();
    let mut range = [f64::INFINITY, f64::NEG_INFINITY];
    for (index, run) in observations.runs.iter().enumerate() {
        let y = match channel.wraps {
            true => unwrapped(&run.y[c]),
            false => run.y[c].clone(),
        };
        let mut first = 0;
        while first < y.len() {
            let (mut end, mut valid) = (first, 0);
            let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
            while end < y.len() {
                if run.valid[c][end] {
                    let (low, high) = (least.min(y[end]), most.max(y[end]));
                    if high - low > STILL * channel.noise {
                        break;
                    }
                    (least, most) = (low, high);
                    valid += 1;
                }
                end += 1;
            }
            range = [range[0].min(least), range[1].max(most)];
            // What is not read says nothing of a rest.
            if valid >= FEWEST_SAMPLES && 2 * valid > end - first {
                found.push(Rest {
                    run: index,
                    first,
                    end,
                });
            }
            first = end.max(first + 1);
        }
    }
    match range[1] - range[0] > MOVES * channel.noise {
        true => found,
        false => Vec::new(),
    }
}

/// What a model lacks at every sample of every recording, one a coordinate, where that rests: the force r_j, and r_j/M_jj.
struct Lacking {
    force: Vec<Vec<Vec<f64>>>,
    acceleration: Vec<Vec<Vec<f64>>>,
}

impl Lacking {
    fn of(hybrid: &Hybrid, smoothed: &[Smoothed], observations: &Observations) -> Self {
        let (nv, theta) = (hybrid.nv(), hybrid.theta());
        let mut memory = hybrid.memory(&[]);
        let mut mass = DMatrix::zeros(nv, nv);
        let mut lacking = Lacking {
            force: Vec::new(),
            acceleration: Vec::new(),
        };
        for (run, smooth) in observations.runs.iter().zip(smoothed) {
            let inputs = hybrid.drive(&run.t, &run.u, 1, &theta, &[]);
            let readings = hybrid.readings(&theta, &[]);
            let at = |sample: usize| smooth.behind(&readings, &run.t, sample);
            let hidden = hybrid.hidden_path(&theta, &inputs, &at);
            let n = run.t.len();
            let (mut force, mut acceleration) = (vec![vec![0.0; n]; nv], vec![vec![0.0; n]; nv]);
            for k in 0..n {
                let state = at(k);
                let (q, v) = state.split_at(nv);
                let state = State {
                    q,
                    v,
                    h: hidden.at(k),
                };
                // The last sample has no step behind it.
                let step = k.min(n.saturating_sub(2));
                let modelled = hybrid.acceleration(state, &theta, &inputs, step, &mut memory);
                if modelled.is_err() {
                    continue;
                }
                let modelled = memory.acceleration.clone();
                hybrid.mass_matrix_into(q, &theta, &mut memory, &mut mass);
                for c in 0..nv {
                    let apart = |j: usize| match j == c {
                        true => -modelled[j],
                        false => smooth.a[j][k] - modelled[j],
                    };
                    let r: f64 = (0..nv).map(|j| mass[(c, j)] * apart(j)).sum();
                    force[c][k] = r;
                    acceleration[c][k] = r / mass[(c, c)];
                }
            }
            lacking.force.push(force);
            lacking.acceleration.push(acceleration);
        }
        lacking
    }

    /// How far what holds a coordinate in a rest would take it from a line by itself, root mean square.
    fn would_move(&self, rest: &Rest, c: usize, observations: &Observations) -> f64 {
        let t = &observations.runs[rest.run].t[rest.first..rest.end];
        let a = &self.acceleration[rest.run][c][rest.first..rest.end];
        let (mut x, mut v) = (0.0, 0.0);
        let mut path = vec![(0.0, 0.0)];
        for ((pair, &a), &next) in t.windows(2).zip(a).zip(&a[1..]) {
            let dt = pair[1] - pair[0];
            let mean = 0.5 * (a + next);
            x += dt * (v + 0.5 * dt * mean);
            v += dt * mean;
            path.push((pair[1] - t[0], x));
        }
        let Some(line) = polynomial::<2>(path.iter().copied()) else {
            return 0.0;
        };
        let square = path
            .iter()
            .map(|(t, x)| (x - line[0] - line[1] * t).powi(2));
        (square.sum::<f64>() / path.len() as f64).sqrt()
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use std::path::Path;

    use super::super::smooth::smooth;
    use super::*;
    use crate::bins::pseudo;
    use crate::model::Model;
    use crate::shooting::{Channel, Finer, ObservedRun};

    const DT: f64 = 0.02;
    const NOISE: f64 = 1e-3;

    /// A mass of 2 kg on a rail, pushed with 3 N sin 2t, held by what dry friction of so many N lets through.
    fn pushed(friction: f64) -> (Hybrid, Vec<Smoothed>, Observations) {
        let text = "name = \"mass\"\n\
             lagrangian = { coordinates = [\"x\"], kinetic = \"0.5*2*x_dot^2\", potential = \"0\" }\n\
             [[input]]\nname = \"push\"\njoint = \"x\"\n[sensor.x]\nposition_noise = 1e-3\n";
        let model = Model::parse(Path::new("mass.toml"), text.to_owned()).unwrap();
        let (mut x, mut v, mut y, mut u) = (0.0, 0.0, Vec::new(), Vec::new());
        let t: Vec<f64> = (0..1500).map(|k| DT * f64::from(k)).collect();
        for (k, t) in t.iter().enumerate() {
            let push = 3.0 * (2.0 * t).sin();
            y.push(x + NOISE * 3.0_f64.sqrt() * pseudo(k, 0.3));
            u.push(push);
            for _ in 0..20 {
                let h = DT / 20.0;
                // What brings it to rest within the step, as far as there is so much friction.
                let stops = (2.0 * v / h + push).clamp(-friction, friction);
                v += h * (push - stops) / 2.0;
                x += h * v;
            }
        }
        let run = ObservedRun {
            finer: Finer::default(),
            valid: vec![vec![true; y.len()]],
            t,
            u: vec![u],
            y: vec![y],
        };
        let smoothed = vec![smooth(&run, &[false], 0.06)];
        let channels = vec![Channel {
            coordinate: 0,
            velocity: false,
            wraps: false,
            noise: NOISE,
        }];
        let runs = vec![run];
        (
            Hybrid::of(&model),
            smoothed,
            Observations { channels, runs },
        )
    }

    #[test]
    fn what_rests_under_a_changing_push_is_held_by_about_the_force_at_which_it_breaks_away() {
        let (hybrid, smoothed, observations) = pushed(2.0);
        let [force] = held(&hybrid, &smoothed, &observations)[..] else {
            panic!("one coordinate");
        };
        assert!((1.4..2.6).contains(&force), "{force}");
    }

    #[test]
    fn what_turns_round_without_friction_is_not_held() {
        let (hybrid, smoothed, observations) = pushed(0.0);
        assert_eq!(held(&hybrid, &smoothed, &observations), [0.0]);
    }
}
