//! What constants of the model and parameters of its effects explain by themselves: fitted before a network, and without one.

use nalgebra::{Cholesky, DMatrix, DVector};
use serde::Serialize;

use super::data::{OVERLAP, Recordings};
use crate::Error;
use crate::digits::{exponent, fixed};
use crate::hybrid::{ConstantId, Hybrid};
use crate::learnt::LearntForce;
use crate::shooting::{Fit, FitOptions, Roller, Trajectory, Window, fit};

/// Windows with free starts have at least so many sample intervals: what a shorter one tells of θ is lost in its start.
const SHORTEST: usize = 20;
/// Steps of a fit of states to their windows.
pub(super) const STATE_STEPS: usize = 3;
/// Steps of a fit of constants, and of one beside a network: the next one is near.
const FIT_STEPS: usize = 20;
const STEPS_BESIDE: usize = 3;
/// Constants that a fit stretches by more nats than this, two standard deviations, beside the half that each of them is off by as a rule, make up for what is missing, and that is the
/// network's to learn.
const STRETCHED: f64 = 2.0;
/// A constant that would move by so many tolerances is told.
const FAR_OFF: f64 = 2.0;
/// A fit from measured states ends when the loss falls by less than this share.
const ENOUGH: f64 = 1e-9;

/// A constant that the model knows, fitted beside a network.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Known {
    /// What it is, for people.
    pub name: String,
    /// Its value in the model as given.
    pub given: f64,
    /// Its value beside the network.
    pub fitted: f64,
    /// What the model takes for possible, as a standard deviation about the given value.
    pub tolerance: f64,
}

impl Known {
    /// By how many tolerances it has moved.
    pub fn tolerances(&self) -> f64 {
        ((self.fitted - self.given) / self.tolerance).abs()
    }

    /// What it is, where it was and is, to the third digit of its tolerance, and how far that is.
    pub fn moved(&self) -> String {
        let decimals = 2 - exponent(self.tolerance, 2);
        format!(
            "{} from {} to {}, {:.2} times its tolerance",
            self.name,
            fixed(self.given, decimals),
            fixed(self.fitted, decimals),
            self.tolerances()
        )
    }
}

impl Recordings {
    /// θ_free by least squares over windows whose initial states are free, `within` [reason](STRETCHED) or however far.
    pub fn fit_from_free_states(&mut self, within: bool) {
        let length = self.horizon.max(SHORTEST);
        let [windows, _] = self.cut(length, length);
        let states = self.states(&windows);
        let steps = [STATE_STEPS, FIT_STEPS];
        let hybrid = self.hybrid.clone();
        match within {
            true => self.fit_within_reason(&hybrid, &windows, states, steps),
            false if hybrid.free().is_empty() => {}
            false => {
                let fitted = self.fit_constants(&hybrid, &windows, states, steps, &hybrid.free());
                self.set_theta(fitted.theta);
            }
        }
    }

    /// The same beside `network`, from the starts as they are and within reason.
    pub fn fit_beside(&mut self, network: LearntForce) {
        let mut hybrid = self.hybrid.clone();
        hybrid.add_network(network.into());
        let every = |of: usize| (0..of).step_by(OVERLAP);
        let seen = &self.seen;
        let windows: Vec<Window> = every(seen.windows.len()).map(|k| seen.windows[k]).collect();
        let states = every(seen.windows.len()).map(|k| seen.starts[k].clone());
        self.fit_within_reason(&hybrid, &windows, states.collect(), [1, STEPS_BESIDE]);
    }

    /// Fits the constants and the parameters of effects; where that [stretches](STRETCHED) what is known, the parameters alone, beside constants as the model gives them.
    fn fit_within_reason(
        &mut self,
        hybrid: &Hybrid,
        windows: &[Window],
        states: Vec<Vec<f64>>,
        steps: [usize; 2],
    ) {
        let free = hybrid.free();
        if free.is_empty() {
            return;
        }
        let fitted = self.fit_constants(hybrid, windows, states.clone(), steps, &free);
        let (known, unknown): (Vec<usize>, Vec<usize>) =
            free.into_iter().partition(|&i| self.makes_force(i));
        let off = |&i: &usize| (fitted.theta[i] - self.given[i]) / hybrid.constants()[i].tolerance;
        let stretch: f64 = known.iter().map(|i| 0.5 * off(i).powi(2)).sum();
        if stretch <= STRETCHED + 0.5 * known.len() as f64 {
            self.held_back.clear();
            self.set_theta(fitted.theta);
            return;
        }
        self.held_back = known.iter().map(|&i| (i, fitted.theta[i])).collect();
        for i in known {
            self.theta[i] = self.given[i];
        }
        let theta = match unknown.is_empty() {
            true => self.theta.clone(),
            false => {
                self.fit_constants(hybrid, windows, states, steps, &unknown)
                    .theta
            }
        };
        self.set_theta(theta);
    }

    /// Whether an entry of θ is known and what it does is a force, as a gain's and a mass's is, and no zero's of a sensor: a network could do its work.
    fn makes_force(&self, index: usize) -> bool {
        let is_zero = matches!(self.hybrid.constants()[index].id, ConstantId::Zero(_));
        self.is_known(index) && !is_zero
    }

    /// Whether the model says how well it knows an entry of θ.
    fn is_known(&self, index: usize) -> bool {
        self.hybrid.constants()[index].tolerance.is_finite()
    }

    /// What is known and was free, as it is in `theta`.
    pub(super) fn known(&self, theta: &[f64], inputs: &[String]) -> Vec<Known> {
        let known = self.hybrid.free().into_iter().filter(|&i| self.is_known(i));
        known.map(|i| self.known_at(i, theta[i], inputs)).collect()
    }

    fn known_at(&self, index: usize, fitted: f64, inputs: &[String]) -> Known {
        Known {
            name: self.hybrid.describe(index, inputs),
            given: self.given[index],
            fitted,
            tolerance: self.hybrid.constants()[index].tolerance,
        }
    }

    /// Said of known constants that would have been stretched beyond reason: the network has learnt what they would have done, whatever that is. Those that would be far off, or the farthest.
    pub(super) fn in_words(&self, held_back: &[(usize, f64)], inputs: &[String]) -> Option<String> {
        let would_be = |&(i, fitted): &(usize, f64)| self.known_at(i, fitted, inputs);
        let mut far: Vec<Known> = held_back.iter().map(would_be).collect();
        far.sort_by(|a, b| b.tolerances().total_cmp(&a.tolerances()));
        let count = far
            .iter()
            .filter(|known| known.tolerances() > FAR_OFF)
            .count();
        far.truncate(count.max(1));
        let far: Vec<String> = far.iter().map(Known::moved).collect();
        (!far.is_empty()).then(|| {
            format!(
                "a fit of the constants would move {}: they are as the model has them, and what they are off by is in the network's force; measure them, or say in \
                 `[tolerance]` what is possible",
                far.join(", and ")
            )
        })
    }

    /// A fit of the constants `free`: `steps` of the states alone, and of all.
    fn fit_constants(
        &self,
        hybrid: &Hybrid,
        windows: &[Window],
        states: Vec<Vec<f64>>,
        steps: [usize; 2],
        free: &[usize],
    ) -> Fit {
        // The tolerances are about what the model says.
        let mut hybrid = hybrid.clone();
        hybrid.set_theta(&self.given);
        fit(
            &hybrid,
            &self.observations,
            windows,
            free,
            self.theta.clone(),
            states,
            self.noise(),
            &self.hidden_prior(windows),
            &FitOptions {
                substeps: self.substeps,
                iterations: steps[1],
                state_iterations: steps[0],
            },
        )
    }

    /// θ_free by the loss itself from the starts as they are: Gauss and Newton's method, damped, with the tolerances as priors in units of the
    /// mean loss. With one step from measured states it is the paper's fit of a pure ODE (Roehrl et al. 2020, eq. 13).
    ///
    /// # Errors
    /// [`Error::Unfittable`] when no window has a motion.
    pub fn fit_from_starts(&mut self) -> Result<(), Error> {
        let free = self.hybrid.free();
        if free.is_empty() {
            return Ok(());
        }
        let mut at = self.equations(&free, &self.theta)?;
        let mut damping = 1e-9;
        for _ in 0..FIT_STEPS {
            let mut theta = self.theta.clone();
            let Some(step) = at.step(damping) else {
                break;
            };
            for (&index, step) in free.iter().zip(step.iter()) {
                let constant = &self.hybrid.constants()[index];
                theta[index] = (theta[index] + step).clamp(constant.lower, constant.upper);
            }
            self.drive_with(&theta, &free);
            let new = self.equations(&free, &theta)?;
            let gain = 1.0 - new.loss / at.loss;
            if gain <= 0.0 {
                damping = (damping * 100.0).max(1e-4);
                if damping > 1e6 {
                    break;
                }
                continue;
            }
            damping *= 0.1;
            (self.theta, at) = (theta, new);
            if gain < ENOUGH {
                break;
            }
        }
        self.set_theta(self.theta.clone());
        Ok(())
    }

    /// The normal equations of the loss at θ.
    fn equations(&self, free: &[usize], theta: &[f64]) -> Result<Equations, Error> {
        let n = free.len();
        let (hybrid, horizon) = (&self.hybrid, self.horizon);
        let nx = hybrid.nx();
        let mut roller = Roller::new(hybrid, free);
        let columns = roller.columns();
        let mut trajectory = Trajectory::default();
        let mut out = Equations {
            matrix: DMatrix::zeros(n, n),
            gradient: DVector::zeros(n),
            loss: 0.0,
        };
        let mut terms = 0;
        for index in 0..self.seen.windows.len() {
            let member = self.member(&self.seen, index);
            let span = (member.first, horizon + 1);
            let rolled = roller.roll_with_sensitivities(
                theta,
                member.inputs,
                span,
                member.start,
                &mut trajectory,
            );
            if rolled.is_err() {
                continue;
            }
            for sample in self.loss.first..=horizon {
                let x = &trajectory.states[sample * nx..][..nx];
                let s = &trajectory.sensitivities[sample * nx * columns..][..nx * columns];
                let row = |i: usize| DVector::from_fn(n, |k, _| s[(nx + k) * nx + i]);
                let all = |i, weight: f64, residual: f64| {
                    let row = row(i);
                    out.loss += weight * residual * residual;
                    out.gradient.axpy(weight * residual, &row, 1.0);
                    out.matrix.ger(weight, &row, &row, 1.0);
                };
                let at = member.first + sample;
                self.loss.residuals(member.target, at, |i| x[i], all);
                terms += 1;
            }
        }
        if terms == 0 {
            let windows = self.seen.windows.len();
            return Err(Error::Unfittable {
                diverged: windows,
                windows,
            });
        }
        let mean = out.loss / f64::from(terms);
        for (k, &index) in free.iter().enumerate() {
            let constant = &hybrid.constants()[index];
            if constant.tolerance.is_finite() {
                let weight = mean / constant.tolerance.powi(2);
                let residual = constant.value - theta[index];
                out.loss += weight * residual * residual;
                out.gradient[k] += weight * residual;
                out.matrix[(k, k)] += weight;
            }
        }
        Ok(out)
    }
}

/// A Δθ = g, and the loss.
struct Equations {
    matrix: DMatrix<f64>,
    gradient: DVector<f64>,
    loss: f64,
}

impl Equations {
    /// Δθ, with `damping` relative to the diagonal; what moves nothing stays.
    fn step(&self, damping: f64) -> Option<DVector<f64>> {
        let n = self.gradient.len();
        let scale = |k: usize| match self.matrix[(k, k)] {
            square if square > 1e-300 => square.sqrt(),
            _ => f64::INFINITY,
        };
        let matrix = DMatrix::from_fn(n, n, |i, j| match i == j {
            true => 1.0 + damping,
            false => self.matrix[(i, j)] / (scale(i) * scale(j)),
        });
        let rhs = DVector::from_fn(n, |i, _| self.gradient[i] / scale(i));
        let solved = Cholesky::new(matrix)?.solve(&rhs);
        Some(DVector::from_fn(n, |i, _| solved[i] / scale(i)))
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::super::session_tests::{SLEDGE, log_of};
    use super::super::{Options, Session, Training};
    use super::*;
    use crate::model::Model;

    /// x = sin t of 2 kg on a spring of 1 N/m that nobody knows: 2 ẍ + x = u, u = −sin t, which is 2 ẍ = g u with a gain g of 2.
    #[test]
    fn what_is_missing_does_not_move_a_gain_that_is_known_but_where_there_is_no_network() {
        let text = SLEDGE.replace("gain = 0.0", "gain = 0.02");
        let model = Model::parse("sledge.toml".as_ref(), text).unwrap();
        let logs = [log_of(
            "log.csv",
            0.02,
            30.0,
            &model,
            (&f64::sin, &|t| -t.sin()),
        )];
        let options = Options::new(vec![0]);
        let inputs = ["push".to_owned()];
        let gain = |found: &Recordings| {
            let [gain] = found.known(&found.theta, &inputs).try_into().unwrap();
            (gain, found.in_words(&found.held_back, &inputs))
        };
        let alone = Recordings::new(&model, [&logs, &[]], &options, false).unwrap();
        let (baseline, said) = gain(&alone);
        // So far the tolerance lets it go.
        assert!(baseline.fitted > 1.5, "{baseline:?}");
        assert_eq!(said, None);
        let training = Training {
            model: &model,
            logs: &logs,
            held_out: &[],
        };
        let session = Session::<f32>::new(&training, &options).unwrap();
        let (beside, said) = gain(&session.recordings);
        assert_eq!(beside.fitted, 1.0);
        let said = said.unwrap_or_default();
        assert!(
            said.contains("gain of input `push` from 1.0000 to 1.7"),
            "{said}"
        );
    }
}
