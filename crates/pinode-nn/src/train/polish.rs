//! The last rounds of a training: L-BFGS (Liu and Nocedal 1989) on all windows at once.
//!
//! Adam's steps follow gradients of a few windows and end where these disagree. A round of the polish begins at the best weights W so far and goes down
//! F(W, x₀) = Σ J / n, the sum over all windows a sample, by a few steps of L-BFGS with the line search of Moré and Thuente (1994). Starts that are
//! fitted are free in it, as x₀ = x̄₀ + √κ L⁻ᵀ z: L Lᵀ is Gauss and Newton's curvature of F in a start where the round begins, κ that of F along its
//! gradient in W, so that all unknowns are of the same scale. Rounds end when one brings nothing on the windows held out. Each has a memory of its own:
//! weights and starts are all that a checkpoint needs.

use std::cell::RefCell;

use argmin::core::{CostFunction, Executor, Gradient};
use argmin::solver::linesearch::MoreThuenteLineSearch;
use argmin::solver::quasinewton::LBFGS;
use nalgebra::{DMatrix, DVector};

use super::Start;
use super::loss::FAR;
use super::session::{Epoch, Session};
use crate::Error;
use crate::network::Real;

/// Steps of a round, and how many of them L-BFGS remembers.
const STEPS: u64 = 20;
const REMEMBERED: usize = 20;
/// So many steps bring the starts to rest before a round.
const SETTLING: usize = 3;
/// μ of the curvature of a start.
const DAMPING: f64 = 1e-3;
/// κ is measured over this part of the length of W.
const PROBE: f64 = 1e-4;
/// A line search ends when it knows the step to this part.
const WIDTH: f64 = 0.1;

impl<T: Real> Session<'_, T> {
    /// A round of the polish: from the best weights so far down the loss of all windows.
    ///
    /// # Errors
    /// As [`epoch`](Self::epoch).
    pub(super) fn polish(&mut self) -> Result<Epoch, Error> {
        self.return_to_best();
        let mut profile = Profile::new(self)?;
        let weights = profile.session.learner.network.parameters().iter();
        let mut first: Vec<f64> = weights.map(|w| w.to_f64()).collect();
        first.resize(first.len() + profile.free * profile.scales.len(), 0.0);
        profile.scale(&first)?;
        let profile = RefCell::new(profile);
        // Whatever it ends with, the best of the weights that it asked for are kept.
        let ended = solver().and_then(|solver| {
            Executor::new(Objective(&profile), solver)
                .configure(|state| state.param(first).max_iters(STEPS))
                .run()
                .map(|_| ())
        });
        let mut profile = profile.into_inner();
        let Some(best) = profile.best.take() else {
            let fault = ended.err().map(|fault| fault.downcast());
            let nothing = || Error::Training("the best weights have no loss".to_owned());
            return Err(fault.and_then(Result::ok).unwrap_or_else(nothing));
        };
        let at = profile.look(best.x)?;
        let session = profile.session;
        if profile.free > 0 {
            // The network is another one: how well starts did with the one before says nothing.
            session.recordings.seen.trust_all();
            session.recordings.held_out.trust_all();
        }
        session.end_epoch(at.loss, at.diverged, None)
    }
}

type Vector = Vec<f64>;
type LineSearch = MoreThuenteLineSearch<Vector, Vector, f64>;

fn solver() -> Result<LBFGS<LineSearch, Vector, Vector, f64>, argmin::core::Error> {
    let search = LineSearch::new().with_width_tolerance(WIDTH)?;
    Ok(LBFGS::new(search, REMEMBERED))
}

/// F at some x = (W, z).
#[derive(Clone)]
struct Place {
    x: Vector,
    /// F/κ; a window that leaves the range of mechanisms counts as one far away.
    value: f64,
    gradient: Vector,
    /// The sum without these windows, and their number.
    loss: f64,
    diverged: usize,
}

/// F of all windows of a session.
struct Profile<'s, 'a, T: Real> {
    session: &'s mut Session<'a, T>,
    all: Vec<usize>,
    /// Entries of a start that are free.
    free: usize,
    /// x̄₀.
    starts: Vec<Vec<f64>>,
    /// L of every window.
    scales: Vec<DMatrix<f64>>,
    kappa: f64,
    best: Option<Place>,
    last: Option<Place>,
}

impl<'s, 'a, T: Real> Profile<'s, 'a, T> {
    /// At the network of the session, whose starts come to rest.
    fn new(session: &'s mut Session<'a, T>) -> Result<Self, Error> {
        let all: Vec<usize> = (0..session.windows()).collect();
        let free = match session.options.start {
            Start::Fitted => session.recordings.seen.visible,
            Start::Measured { .. } => 0,
        };
        let mut scales = Vec::new();
        if free > 0 {
            // The same whatever was done before, so that a training goes on to the same bits.
            session.recordings.seen.trust_all();
            session.recordings.loss.far = Some(FAR);
            for _ in 0..SETTLING {
                for batch in all.chunks(session.options.batch) {
                    session.sum_up::<true>(batch)?;
                    session.move_starts(batch);
                }
            }
            session.see_as_far();
            let terms = session.terms(all.len());
            for batch in all.chunks(session.options.batch) {
                session.sum_up::<true>(batch)?;
                for k in 0..batch.len() {
                    let (chunk, k) = session.chunk_of(k);
                    scales.push(chunk.factor_of_curvature(k, DAMPING, free) / terms.sqrt());
                }
            }
        }
        Ok(Profile {
            starts: session.recordings.seen.starts.clone(),
            session,
            all,
            free,
            scales,
            kappa: 1.0,
            best: None,
            last: None,
        })
    }

    /// Measures κ = |∇F(W + ε g) − ∇F(W)| / ε at x with g = ∇F(W), in W alone.
    fn scale(&mut self, x: &[f64]) -> Result<(), Error> {
        let weights = self.session.gradient.len();
        let length = |x: &[f64]| x.iter().map(|x| x * x).sum::<f64>().sqrt();
        let here = self.look(x.to_vec())?.gradient;
        let (size, slope) = (length(&x[..weights]), length(&here[..weights]));
        let epsilon = PROBE * size / slope;
        let mut there = x.to_vec();
        for (x, g) in there.iter_mut().zip(&here[..weights]) {
            *x -= epsilon * g;
        }
        let there = self.look(there)?.gradient;
        let change: Vec<f64> = here.iter().zip(&there).map(|(a, b)| a - b).collect();
        let kappa = length(&change[..weights]) / (epsilon * slope);
        if kappa > 0.0 && kappa.is_finite() {
            self.kappa = kappa;
        }
        Ok(())
    }

    /// F there, which the session is at after that.
    fn look(&mut self, x: Vector) -> Result<Place, Error> {
        let session = &mut *self.session;
        let terms = session.terms(self.all.len());
        let weights = session.gradient.len();
        let (free, root) = (self.free, self.kappa.sqrt());
        let parameters = session.learner.network.parameters_mut();
        for (to, &weight) in parameters.iter_mut().zip(&x) {
            *to = T::from_f64(weight);
        }
        for (k, l) in self.scales.iter().enumerate() {
            let mut step = DVector::from_column_slice(&x[weights + k * free..][..free]);
            l.tr_solve_lower_triangular_mut(&mut step);
            let start = &mut session.recordings.seen.starts[k];
            for ((to, from), step) in start.iter_mut().zip(&self.starts[k]).zip(&step) {
                *to = from + root * step;
            }
        }
        let mut gradient = vec![0.0; x.len()];
        let (mut loss, mut diverged) = (0.0, 0);
        for batch in self.all.chunks(session.options.batch) {
            let (sum, lost) = session.sum_up::<false>(batch)?;
            loss += sum;
            diverged += lost;
            for (to, from) in gradient.iter_mut().zip(&session.gradient) {
                *to += from.to_f64();
            }
            if free == 0 {
                continue;
            }
            for (k, &window) in batch.iter().enumerate() {
                let (chunk, k) = session.chunk_of(k);
                let mut by_z = DVector::from_column_slice(&chunk.by_start_of(k)[..free]);
                self.scales[window].solve_lower_triangular_mut(&mut by_z);
                for (to, by) in gradient[weights + window * free..].iter_mut().zip(&by_z) {
                    *to = root * by;
                }
            }
        }
        let unit = terms * self.kappa;
        gradient.iter_mut().for_each(|g| *g /= unit);
        Ok(Place {
            x,
            value: (loss + diverged as f64 * session.lost()) / unit,
            gradient,
            loss,
            diverged,
        })
    }

    /// The same, remembered: a line search asks for the value, then for the gradient.
    fn at(&mut self, x: &[f64]) -> Result<&Place, Error> {
        let place = match self.last.take() {
            Some(last) if last.x == x => last,
            _ => self.look(x.to_vec())?,
        };
        let least = self.best.as_ref().map_or(f64::INFINITY, |best| best.value);
        if place.value < least {
            self.best = Some(place.clone());
        }
        Ok(self.last.insert(place))
    }
}

/// What L-BFGS asks.
struct Objective<'p, 's, 'a, T: Real>(&'p RefCell<Profile<'s, 'a, T>>);

impl<T: Real> CostFunction for Objective<'_, '_, '_, T> {
    type Param = Vector;
    type Output = f64;

    fn cost(&self, x: &Vector) -> Result<f64, argmin::core::Error> {
        Ok(self.0.borrow_mut().at(x)?.value)
    }
}

impl<T: Real> Gradient for Objective<'_, '_, '_, T> {
    type Param = Vector;
    type Gradient = Vector;

    fn gradient(&self, x: &Vector) -> Result<Vector, argmin::core::Error> {
        Ok(self.0.borrow_mut().at(x)?.gradient.clone())
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use proptest::prelude::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::StandardNormal;

    use super::super::session_tests::{log_of, sledge};
    use super::super::{Checkpoint, Options, Training, train};
    use super::*;
    use crate::log::Log;

    fn options(start: Start) -> Options {
        Options {
            units: vec![6],
            hidden: crate::network::Activation::Tanh,
            single: false,
            epochs: 4,
            polish: 3,
            start,
            ..Options::new(vec![0])
        }
    }

    const MEASURED: Start = Start::Measured {
        weights: [1.0, 1.0],
    };

    fn rms(x: &[f64]) -> f64 {
        (x.iter().map(|x| x * x).sum::<f64>() / x.len() as f64).sqrt()
    }

    /// x = sin t + ½ sin 2.3 t of 2 kg with a drag of 1.5 N·s/m that the model lacks, read to 1 mm.
    fn braked() -> Log {
        let noise = RefCell::new(ChaCha8Rng::seed_from_u64(1));
        let read = |t: f64| {
            let noise: f64 = noise.borrow_mut().sample(StandardNormal);
            t.sin() + 0.5 * (2.3 * t).sin() + 1e-3 * noise
        };
        let push = |t: f64| {
            let v = t.cos() + 1.15 * (2.3 * t).cos();
            let a = -t.sin() - 2.645 * (2.3 * t).sin();
            2.0 * a + 1.5 * v
        };
        log_of("log.csv", 0.02, 60.0, &sledge(), (&read, &push))
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, cases: 6, ..ProptestConfig::default() })]

        /// Of weights and starts together, at random places; differences of the fourth order.
        #[test]
        fn what_l_bfgs_is_told_is_the_gradient_of_what_it_minimises(seed in 0..1000_u64, fitted: bool) {
            let (model, logs) = (sledge(), [braked()]);
            let training = Training { model: &model, logs: &logs, held_out: &[] };
            let options = Options { seed, ..options(if fitted { Start::Fitted } else { MEASURED }) };
            let mut session = Session::<f64>::new(&training, &options).unwrap();
            session.epoch().unwrap();
            let weights: Vec<f64> = session.network().parameters().to_vec();
            let mut profile = Profile::new(&mut session).unwrap();
            let n = weights.len() + profile.free * profile.scales.len();
            prop_assert_eq!(n > weights.len(), fitted);
            let mut x = weights.clone();
            x.resize(n, 0.0);
            profile.scale(&x).unwrap();
            // Off the bottom of the starts.
            let place = |k: usize| (1.0 + k as f64 + seed as f64).sin();
            let scale = profile.look(x.clone()).unwrap().gradient;
            for (k, z) in x.iter_mut().enumerate().skip(weights.len()) {
                *z = 10.0 * rms(&scale) * place(k);
            }
            let here = profile.look(x.clone()).unwrap();
            let direction: Vec<f64> = (0..n).map(|k| place(7 * k)).collect();
            for (part, share) in [(0..weights.len(), 1e-4), (weights.len()..n, 1e-3)] {
                if part.is_empty() {
                    continue;
                }
                let h = share * rms(&x[part.clone()]);
                let mut at = |h: f64| {
                    let mut x = x.clone();
                    for k in part.clone() {
                        x[k] += h * direction[k];
                    }
                    profile.look(x).unwrap().value
                };
                let mut change = |h: f64| at(h) - at(-h);
                let expected = (8.0 * change(h) - change(2.0 * h)) / (12.0 * h);
                let parts = part.clone().map(|k| here.gradient[k] * direction[k]);
                let found: f64 = parts.sum();
                let size = rms(&here.gradient[part.clone()]) * (part.len() as f64).sqrt();
                prop_assert!((found - expected).abs() < 1e-6 * size, "{} {} {}", found, expected, size);
            }
        }
    }

    #[test]
    fn the_polish_goes_down_the_loss_where_adam_has_stopped_early() {
        let (model, logs) = (sledge(), [braked()]);
        let training = Training {
            model: &model,
            logs: &logs,
            held_out: &[],
        };
        for start in [Start::Fitted, MEASURED] {
            let options = options(start);
            let trained = train(&training, &options, None, &mut |_| Ok(())).unwrap();
            let (adam, rounds) = trained.history.split_at(4);
            assert!(adam.iter().all(|epoch| !epoch.polish) && !rounds.is_empty());
            assert!(rounds.iter().all(|round| round.polish && round.rate == 0.0));
            // Each but the last has brought something.
            let all = rounds.iter().rev().skip(1);
            assert!(all.clone().count() >= 1);
            assert!(
                all.zip(rounds.iter().rev().skip(2))
                    .all(|(b, a)| b.held_out < a.held_out)
            );
            let (before, after) = (
                adam[3].held_out,
                trained.history[trained.best_epoch - 1].held_out,
            );
            assert!(after < 0.5 * before, "{before} {after}");
        }
    }

    #[test]
    fn a_training_that_ends_in_its_polish_resumes_to_the_same_bits() {
        let (model, logs) = (sledge(), [braked()]);
        let training = Training {
            model: &model,
            logs: &logs,
            held_out: &[],
        };
        let options = options(Start::Fitted);
        let whole = train(&training, &options, None, &mut |_| Ok(())).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let mut checkpoint = Checkpoint {
            path: folder.path().join("checkpoint.safetensors"),
            resume: false,
        };
        for last in [4, 5] {
            let stopped = train(
                &training,
                &options,
                Some(&checkpoint),
                &mut |epoch| match epoch.epoch < last {
                    true => Ok(()),
                    false => Err(Error::Training("stop".to_owned())),
                },
            );
            assert!(stopped.is_err());
            checkpoint.resume = true;
            let went_on = train(&training, &options, Some(&checkpoint), &mut |_| Ok(())).unwrap();
            assert_eq!(went_on.history, whole.history);
            let weights =
                |trained: &super::super::Trained| trained.force.network().parameters().to_vec();
            assert!(weights(&went_on) == weights(&whole));
            checkpoint.resume = false;
        }
    }
}
