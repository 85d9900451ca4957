use super::{DrivenInputs, Hybrid, Placed};
use crate::effect::{Action, Between, Grid, Signal};

/// Instants closer than this part of the largest time are one.
const SAME: f64 = 1e-12;

/// The inputs of one recording between the instants at which they jump, for steps that adapt: no step straddles a jump.
#[derive(Debug, Clone, PartialEq)]
pub struct HeldInputs {
    /// The forces between one instant and the next; a step of the grid is not a step of a method here.
    pub inputs: DrivenInputs,
    /// Which bounds of the grid are the samples.
    pub samples: Vec<usize>,
    /// For each step of the grid the first one from which on the same forces are held without a change.
    pub held: Vec<usize>,
}

/// Behind a lag and between smooth samples inputs are held for no longer than this, s.
const PIECE: f64 = 1e-3;
/// At most so many pieces of a sample interval.
const MOST_PIECES: usize = 1000;

impl Hybrid {
    /// The inputs of a recording sampled at `t` with values `u` (one column an input, one value a sample, held until the next), as forces
    /// between the instants at which they jump: the samples, and T s after them for an input that comes T s late. Before the recording
    /// starts an input is taken as its first value. Behind a lag, or smooth between its samples, an input is never constant: it is taken
    /// as its mean over every millisecond.
    ///
    /// ```
    /// use pinode_nn::effect::{Action, registry};
    /// use pinode_nn::hybrid::{Hybrid, Placed};
    /// use pinode_nn::model::Model;
    ///
    /// # let dir = tempfile::tempdir()?;
    /// # let path = dir.path().join("block.toml");
    /// # std::fs::write(&path, r#"
    /// # name = "block"
    /// # lagrangian = { coordinates = ["x"], kinetic = "0.5*x_dot^2", potential = "0" }
    /// # [[input]]
    /// # name = "push"
    /// # joint = "x"
    /// # [[effect]]
    /// # kind = "input_delay"
    /// # input = "push"
    /// # delay = 0.025
    /// # "#)?;
    /// let hybrid = Hybrid::of(&Model::load(&path)?); // the push acts 25 ms late
    /// let held = hybrid.hold(&[0.0, 0.01, 0.02, 0.03], &[vec![1.0, 3.0, 3.0, 3.0]], &hybrid.theta());
    /// assert_eq!(held.inputs.grid.bounds, [0.0, 0.01, 0.02, 0.03]); // 3 N come at 35 ms
    /// assert_eq!(held.held, [0, 0, 0]);
    ///
    /// let held = hybrid.hold(&[0.0, 0.02, 0.06], &[vec![1.0, 3.0, 3.0]], &hybrid.theta());
    /// assert_eq!(held.inputs.grid.bounds, [0.0, 0.02, 0.045, 0.06]);
    /// assert_eq!(held.inputs.forces[0].value, [1.0, 1.0, 3.0]);
    /// assert_eq!(held.held, [0, 0, 2]);
    /// assert_eq!(held.samples, [0, 1, 3]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn hold(&self, t: &[f64], u: &[Vec<f64>], theta: &[f64]) -> HeldInputs {
        let remembers = |effect: &Placed| match effect.kind.action {
            Action::Drive(law) => law.remembers(),
            _ => false,
        };
        let smooth = self.between.contains(&Between::Smooth);
        if !smooth && !self.effects.iter().any(remembers) {
            return self.hold_between(t, u, theta);
        }
        let longest = t.windows(2).map(|p| p[1] - p[0]).fold(0.0, f64::max);
        let pieces = ((longest / PIECE).ceil() as usize).clamp(1, MOST_PIECES);
        let fine = Grid::new(t, pieces);
        let u: Vec<Vec<f64>> = u
            .iter()
            .zip(&self.between)
            .map(|(u, between)| {
                let mut means = between.over_steps(&fine, u);
                means.extend(u.last());
                means
            })
            .collect();
        let held = self.hold_between(&fine.bounds, &u, theta);
        HeldInputs {
            samples: held.samples.iter().copied().step_by(pieces).collect(),
            ..held
        }
    }

    /// [`hold`](Self::hold) where inputs are constant between jumps.
    fn hold_between(&self, t: &[f64], u: &[Vec<f64>], theta: &[f64]) -> HeldInputs {
        let late: Vec<f64> = (0..u.len()).map(|i| self.delay(i, theta)).collect();
        let (bounds, samples) = instants(t, u, &late);
        let sampled = Grid::new(t, 1);
        let forces: Vec<Signal> = u
            .iter()
            .zip(&late)
            .enumerate()
            .map(|(input, (u, late))| {
                let value = (0..sampled.steps())
                    .map(|k| u.get(k).copied().unwrap_or(f64::NAN))
                    .collect();
                let mut signal = Signal {
                    value,
                    by_parameter: Vec::new(),
                };
                self.pass_at_once(input, &sampled, theta, &mut signal);
                signal.value = bounds
                    .windows(2)
                    .map(|pair| {
                        let middle = pair.iter().sum::<f64>() / 2.0 - late;
                        let sample = t.partition_point(|t| *t <= middle).saturating_sub(1);
                        signal.value.get(sample).copied().unwrap_or(f64::NAN)
                    })
                    .collect();
                signal
            })
            .collect();
        let mut held: Vec<usize> = Vec::with_capacity(bounds.len());
        for step in 0..bounds.len().saturating_sub(1) {
            let first = match held.last() {
                Some(&first)
                    if forces
                        .iter()
                        .all(|force| force.value.get(step) == force.value.get(first)) =>
                {
                    first
                }
                _ => step,
            };
            held.push(first);
        }
        HeldInputs {
            inputs: DrivenInputs {
                grid: Grid::of_steps(bounds),
                forces,
            },
            samples,
            held,
        }
    }

    /// How much later an input acts than it is logged, s.
    fn delay(&self, input: usize, theta: &[f64]) -> f64 {
        let laws = self.effects.iter().zip(&self.ranges);
        laws.filter(|(effect, _)| effect.target == input)
            .filter_map(|(effect, range)| match effect.kind.action {
                Action::Drive(law) => law.delay(theta.get(range.clone())?),
                _ => None,
            })
            .sum()
    }

    /// What the drive and the gain make of an input, but for delays: they commute with all that acts at once.
    fn pass_at_once(&self, input: usize, grid: &Grid, theta: &[f64], signal: &mut Signal) {
        for (effect, range) in self.effects.iter().zip(&self.ranges) {
            if let Action::Drive(law) = effect.kind.action
                && effect.target == input
                && let Some(p) = theta.get(range.clone())
                && law.delay(p).is_none()
            {
                law.pass(grid, p, None, signal);
            }
        }
        self.amplify(input, theta, &[], signal);
    }
}

/// The samples and the instants between them at which late inputs jump, in order, and which of them are the samples.
fn instants(t: &[f64], u: &[Vec<f64>], late: &[f64]) -> (Vec<f64>, Vec<usize>) {
    let all = || (t.to_vec(), (0..t.len()).collect());
    let (Some(first), Some(last)) = (t.first(), t.last()) else {
        return all();
    };
    // What is wrong with the times is said where they are used.
    if !t.is_sorted_by(|a, b| a < b) {
        return all();
    }
    let mut jumps = Vec::new();
    for (u, &late) in u.iter().zip(late) {
        if late > 0.0 {
            for (t, pair) in t.iter().skip(1).zip(u.windows(2)) {
                if pair.first() != pair.last() && t + late < *last {
                    jumps.push(t + late);
                }
            }
        }
    }
    if jumps.is_empty() {
        return all();
    }
    jumps.sort_by(f64::total_cmp);
    let same = SAME * first.abs().max(last.abs());
    let (mut bounds, mut samples) = (Vec::new(), Vec::new());
    let mut jumps = jumps.into_iter().peekable();
    for &sample in t {
        while let Some(jump) = jumps.next_if(|jump| *jump <= sample + same) {
            let after = bounds.last().is_none_or(|last| jump > last + same);
            if after && jump < sample - same {
                bounds.push(jump);
            }
        }
        samples.push(bounds.len());
        bounds.push(sample);
    }
    (bounds, samples)
}
