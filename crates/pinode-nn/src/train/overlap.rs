//! What of a network's force known effects could explain, which is kept out of it.
//!
//! At the samples that are learnt from let f be the network's force and Φ = ∂Q/∂p that of the parameters p of forces of position and velocity, which
//! nothing holds and which can do what the network can, both on the joints that it acts on. What the effects could take over of it is Φ a,
//!
//! a = argmin |f − Φ a|², and |Φ a|²/|f|² is the [`share`](Overlap::share) that it overlaps.
//!
//! Loss and motion hardly change when p ← p + a and f ← f − Φ a: how the two share the force is not in the data, and without a rule p says nothing. The
//! rule is that f is orthogonal to Φ (Györök et al., Orthogonal projection-based regularization for efficient model augmentation, L4DC 2025). Their
//! penalty needs a weight; here the effects take over what they can whenever they are fitted, and the network is shown f − Φ a.

use nalgebra::{Cholesky, DMatrix, DVector};
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;

use super::adam::Adam;
use super::adjoint::Learner;
use super::data::Recordings;
use crate::effect::Action;
use crate::hybrid::ConstantId;
use crate::learnt::{LearntForce, Output};
use crate::network::{GROUP, Mlp, Real, Tape};

/// At most so many samples are compared.
const SAMPLES: usize = 1024;
/// Less than this is no overlap.
const LEAST: f64 = 1e-3;
/// Directions of p that move the force by less than this part of what others do are not told apart; nor is a motion from another one, by its squares.
const ALIKE: f64 = 1e-6;
/// The network is shown what is left for it so many times, in batches of so many samples, by steps of Adam's that begin with this one and fall to nothing …
const ROUNDS: usize = 60;
const BATCH: usize = 128;
const RATE: f64 = 2e-3;
/// … or until it has it to this part of what was taken over, root mean square. What it cannot come close to, for it does not see what the effects
/// follow, stays with it.
const CLOSE: f64 = 0.03;
const CLOSE_ENOUGH: f64 = 0.15;

/// What known effects could explain of a network's force.
pub(super) struct Overlap {
    /// |Φ a|²/|f|², of what bounds let the effects take over.
    pub share: f64,
    /// Places in θ, and a.
    shifts: Vec<(usize, f64)>,
    /// What the network sees at the samples, one row a sample.
    seen: Vec<Vec<f64>>,
    /// Φ a there, one row a sample with a force an output.
    taken: Vec<Vec<f64>>,
}

impl Recordings {
    /// What the effects of the model beside a network's force could explain of it; none where none of them can do what it can, or it does nothing.
    pub fn overlap(&self, force: &LearntForce) -> Option<Overlap> {
        let hybrid = &self.hybrid;
        let constants = hybrid.constants();
        // What follows the past of motion or input no network sees that has no past itself.
        let is_open = |i: &usize| {
            let constant = &constants[*i];
            let of_force = match constant.id {
                ConstantId::Effect(e, _) => {
                    matches!(hybrid.effects()[e].kind.action, Action::Joint(_))
                }
                _ => false,
            };
            of_force && constant.tolerance.is_infinite()
        };
        let free: Vec<usize> = hybrid.free().into_iter().filter(is_open).collect();
        if free.is_empty() {
            return None;
        }
        let samples = self.seen_samples();
        let stride = samples.len().div_ceil(SAMPLES).max(1);
        let samples: Vec<(usize, usize)> = samples.into_iter().step_by(stride).collect();
        let seen = self.values_at(&samples, force.features());
        let f: Vec<f64> = seen.iter().flat_map(|values| force.at(values)).collect();
        let f = DVector::from_vec(f);
        let (free, phi) = self.in_reach(&samples, free, force.outputs());
        let whole = f.norm_squared();
        if free.is_empty() || !(whole > 0.0 && whole.is_finite()) {
            return None;
        }
        // Parameters of all units side by side.
        let sizes: Vec<f64> = phi.column_iter().map(|c| c.norm()).collect();
        let scaled = DMatrix::from_fn(phi.nrows(), free.len(), |i, k| phi[(i, k)] / sizes[k]);
        let a = scaled.svd(true, true).solve(&f, ALIKE).ok()?;
        let shift = |k: usize| {
            let constant = &constants[free[k]];
            let now = self.theta[free[k]];
            (now + a[k] / sizes[k]).clamp(constant.lower, constant.upper) - now
        };
        let a = DVector::from_fn(free.len(), |k, _| shift(k));
        let taken = &phi * &a;
        let rows = taken.as_slice().chunks(force.outputs().len());
        Some(Overlap {
            share: (1.0 - (&f - &taken).norm_squared() / whole).max(0.0),
            shifts: free.into_iter().zip(a.iter().copied()).collect(),
            taken: rows.map(<[f64]>::to_vec).collect(),
            seen,
        })
    }

    /// Of the parameters `free` those that move the mechanism as some force on the `outputs` does, at every sample, and Φ: these forces, sample after
    /// sample an output a row.
    ///
    /// With B = ∂v̇/∂Q of the outputs and M = L Lᵀ, Φ is the least |Lᵀ (∂v̇/∂p − B Φ)|². It is ∂Q/∂p where an effect sits on the same joint, and under
    /// constraints what one elsewhere does there.
    fn in_reach(
        &self,
        samples: &[(usize, usize)],
        free: Vec<usize>,
        outputs: &[Output],
    ) -> (Vec<usize>, DMatrix<f64>) {
        let hybrid = &self.hybrid;
        let (n, first) = (hybrid.nv(), 2 * hybrid.nv() + hybrid.nh());
        let runs = self.observations.runs.iter();
        let inputs: Vec<_> = runs
            .map(|run| hybrid.drive(&run.t, &run.u, self.substeps, &self.theta, &free))
            .collect();
        let mut memory = hybrid.memory(&free);
        let mut mass = DMatrix::zeros(n, n);
        let mut phi = DMatrix::zeros(samples.len() * outputs.len(), free.len());
        let (mut moved, mut missed) = (vec![0.0; free.len()], vec![0.0; free.len()]);
        for (k, &(run, sample)) in samples.iter().enumerate() {
            let x = self.state(run, sample);
            let (state, step) = (hybrid.parts(&x), self.substeps * sample);
            let known =
                hybrid.linearize(state, &self.theta, &free, &inputs[run], step, &mut memory);
            hybrid.mass_matrix_into(state.q, &self.theta, &mut memory, &mut mass);
            let (Ok(()), Some(factor)) = (known, Cholesky::new(mass.clone())) else {
                continue;
            };
            let l = factor.l();
            let by_p = l.tr_mul(&memory.linear.view((0, first), (n, free.len())));
            let responses = outputs.iter().map(|output| {
                let v = hybrid.start_of(output.coordinate).v;
                l.tr_mul(&memory.response().column(v))
            });
            let b = DMatrix::from_columns(&responses.collect::<Vec<_>>());
            let Ok(forces) = b.clone().svd(true, true).solve(&by_p, ALIKE) else {
                continue;
            };
            let rest = &by_p - &b * &forces;
            for (p, (moved, missed)) in moved.iter_mut().zip(&mut missed).enumerate() {
                *moved += by_p.column(p).norm_squared();
                *missed += rest.column(p).norm_squared();
            }
            phi.rows_mut(k * outputs.len(), outputs.len())
                .copy_from(&forces);
        }
        let can = |p: &usize| {
            let finite = phi.column(*p).iter().all(|x| x.is_finite());
            finite && moved[*p] > 0.0 && missed[*p] <= ALIKE * moved[*p]
        };
        let kept: Vec<usize> = (0..free.len()).filter(can).collect();
        let phi = phi.select_columns(&kept);
        (kept.into_iter().map(|p| free[p]).collect(), phi)
    }

    /// Lets the effects take over what they can explain of a network's `force`, that of `learner`, which is shown what is left; whether there was
    /// anything. `seed` orders the samples.
    pub fn take_over<T: Real>(
        &mut self,
        force: &LearntForce,
        learner: &mut Learner<T>,
        seed: u64,
    ) -> bool {
        let overlap = self.overlap(force);
        let Some(overlap) = overlap.filter(|overlap| overlap.share > LEAST) else {
            return false;
        };
        let before = learner.network.clone();
        if !overlap.show_rest(learner, seed) {
            learner.network = before;
            return false;
        }
        let mut theta = self.theta.clone();
        for (place, shift) in &overlap.shifts {
            theta[*place] += shift;
        }
        self.set_theta(theta);
        true
    }
}

impl Overlap {
    /// Teaches f − Φ a to the network, by regression: Σ (y − y′)²/n → min, y in units of the outputs' scales. Whether it came close.
    fn show_rest<T: Real>(&self, learner: &mut Learner<T>, seed: u64) -> bool {
        let Learner {
            network,
            features,
            outputs,
        } = learner;
        let scaled = |values: &Vec<f64>| -> Vec<f64> {
            let both = features.iter().zip(values);
            both.map(|(f, x)| (x - f.offset) / f.width).collect()
        };
        let z: Vec<Vec<f64>> = self.seen.iter().map(scaled).collect();
        let before: Mlp<f64> = network.convert();
        let rest = |(z, taken): (&Vec<f64>, &Vec<f64>)| -> Vec<f64> {
            let parts = taken.iter().zip(outputs.iter());
            let y = before.evaluate(z);
            y.iter()
                .zip(parts)
                .map(|(y, (q, o))| y - q / o.scale)
                .collect()
        };
        let wanted: Vec<Vec<f64>> = z.iter().zip(&self.taken).map(rest).collect();
        let taken = self.taken.iter().flatten().zip(outputs.iter().cycle());
        let size: f64 = taken.map(|(q, o)| (q / o.scale).powi(2)).sum();
        let mut adam = Adam::new(network.parameters().len());
        let mut gradient = vec![T::from_f64(0.0); network.parameters().len()];
        let mut tape = Tape::new(network.shape(), BATCH, 1);
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut order: Vec<usize> = (0..z.len()).collect();
        let mut squares = f64::INFINITY;
        for round in 0..ROUNDS {
            order.shuffle(&mut rng);
            let rate = RATE * (1.0 - round as f64 / ROUNDS as f64);
            squares = 0.0;
            for batch in order.chunks(BATCH) {
                for place in 0..tape.groups() * GROUP {
                    let (group, lane) = (place / GROUP, place % GROUP);
                    let Some(&k) = batch.get(place) else {
                        continue;
                    };
                    for (row, &z) in z[k].iter().enumerate() {
                        tape.input_mut(0, row, group)[lane] = T::from_f64(z);
                    }
                }
                network.forward(&mut tape, 0);
                for place in 0..tape.groups() * GROUP {
                    let (group, lane) = (place / GROUP, place % GROUP);
                    for o in 0..outputs.len() {
                        let wanted = batch.get(place).and_then(|&k| wanted.get(k)?.get(o));
                        let found = tape.output(0, o, group)[lane].to_f64();
                        let error = wanted.map_or(0.0, |wanted| found - wanted);
                        squares += error * error;
                        tape.seed_mut(0, o, group)[lane] = T::from_f64(2.0 * error);
                    }
                }
                network.backward(&mut tape, 0);
                gradient.fill(T::from_f64(0.0));
                network.add_gradient(&tape, 0..1, &mut gradient);
                let scale = 1.0 / batch.len() as f64;
                adam.step(rate, scale, &gradient, network.parameters_mut());
            }
            if squares < CLOSE * CLOSE * size {
                break;
            }
        }
        squares < CLOSE_ENOUGH * CLOSE_ENOUGH * size
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::panic)]

    use super::super::session::Session;
    use super::super::session_tests::{log_of, sledge};
    use super::super::{Options, Training, train};
    use super::*;
    use crate::bins::pseudo;
    use crate::log::Log;
    use crate::model::Model;
    use crate::network::Activation;

    /// The velocity of x = sin t + 0.4 sin 2.3 t, m/s, and its rate.
    fn motion(t: f64) -> [f64; 2] {
        let w = 2.3;
        let v = t.cos() + 0.4 * w * (w * t).cos();
        [v, -t.sin() - 0.4 * w * w * (w * t).sin()]
    }

    /// What brakes 2 kg, N at v m/s.
    fn brake(v: f64) -> f64 {
        0.5 * v + 0.8 * v.powi(3)
    }

    /// The sledge with viscous friction of 0.1 N·s/m, and a log of one that [`brake`] brakes.
    fn braked() -> (Model, Log) {
        let viscous = Model::parse(
            "sledge.toml".as_ref(),
            format!(
                "{}\n[[effect]]\nkind = \"viscous_friction\"\njoint = \"x\"\ncoefficient = 0.1\n",
                include_str!("../../tests/data/known_sledge.toml")
            ),
        );
        let push = |t: f64| {
            let [v, a] = motion(t);
            2.0 * a + brake(v)
        };
        let read = |t: f64| {
            let noise = 1e-3 * 3.0_f64.sqrt() * pseudo((50.0 * t).round() as usize, 0.3);
            t.sin() + 0.4 * (2.3 * t).sin() + noise
        };
        let log = log_of("log.csv", 0.02, 60.0, &sledge(), (&read, &push));
        (viscous.unwrap(), log)
    }

    fn options() -> Options {
        Options {
            units: vec![16],
            hidden: Activation::Tanh,
            quantities: vec![crate::learnt::Quantity::Velocity(0)],
            rate: 5e-3,
            epochs: 80,
            single: false,
            ..Options::new(vec![0])
        }
    }

    /// Whatever a network has come to, the force of both stays what it was where they are, and none of it is the effects' that the network has.
    #[test]
    fn what_effects_take_over_of_a_network_leaves_the_force_as_it_was() {
        let (model, log) = braked();
        let (training, options) = (
            Training {
                model: &model,
                logs: std::slice::from_ref(&log),
                held_out: &[],
            },
            options(),
        );
        let mut session = Session::<f64>::new(&training, &options).unwrap();
        // A network of its own mind.
        for weight in session.learner.network.parameters_mut() {
            *weight *= 3.0;
        }
        let Session {
            recordings,
            learner,
            ..
        } = &mut session;
        let place = recordings.hybrid.free()[0];
        let learnt = |learner: &Learner<f64>| {
            let (network, features) = (learner.network.clone(), learner.features.clone());
            LearntForce::new(network, features, learner.outputs.clone(), false).unwrap()
        };
        let force = |recordings: &Recordings, learner: &Learner<f64>, v: f64| {
            [learnt(learner).at(&[v])[0], -recordings.theta[place] * v]
        };
        let overlap = |recordings: &Recordings, learner: &Learner<f64>| {
            recordings.overlap(&learnt(learner)).unwrap().share
        };
        let speeds: Vec<f64> = (-10..=10).map(|k| 0.15 * f64::from(k)).collect();
        let all = |recordings: &Recordings, learner: &Learner<f64>| -> Vec<[f64; 2]> {
            let at = |&v: &f64| force(recordings, learner, v);
            speeds.iter().map(at).collect()
        };
        let before = all(recordings, learner);
        let share = overlap(recordings, learner);
        assert!(share > 0.5, "a network of a velocity alone: {share}");
        assert!(recordings.take_over(&learnt(learner), learner, 1));
        let left = overlap(recordings, learner);
        assert!(left < 0.02 * share, "{share} {left}");
        let largest = before.iter().fold(0.0_f64, |m, f| m.max(f[0].abs()));
        for (before, after) in before.iter().zip(all(recordings, learner)) {
            let changed = (before[0] + before[1]) - (after[0] + after[1]);
            assert!(changed.abs() < 0.05 * largest, "{before:?} {after:?}");
        }
    }

    /// How much of a force is viscous friction's, Σ v f/Σ v², is known of a motion: the fit says that and not what a training happened to leave it.
    #[test]
    fn a_coefficient_beside_a_network_is_all_that_its_law_could_explain() {
        let (model, log) = braked();
        let training = Training {
            model: &model,
            logs: &[log],
            held_out: &[],
        };
        let trained = train(&training, &options(), None, &mut |_| Ok(())).unwrap();
        let share = trained.overlap.unwrap();
        assert!(share < 5e-3, "{share}");
        let speeds = (0..6000).map(|k| motion(0.01 * f64::from(k))[0]);
        let (along, own) = speeds.fold((0.0, 0.0), |(along, own), v| {
            (along + v * brake(v), own + v * v)
        });
        let coefficient = trained.revision.effects[0].0.values[0];
        let expected = along / own;
        assert!(
            (coefficient / expected - 1.0).abs() < 0.02,
            "{coefficient} for {expected}"
        );
    }
}
