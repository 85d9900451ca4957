//! The inputs of a recording as forces.

use super::Hybrid;
use crate::effect::{Action, Grid, Signal};
use crate::learnt::Quantity;

/// The inputs of one recording on its integration grid, after the drives, times their gains.
#[derive(Debug, Clone, PartialEq)]
pub struct DrivenInputs {
    /// The integration steps.
    pub grid: Grid,
    /// One signal an input, N or N·m, with derivatives in θ.
    pub forces: Vec<Signal>,
}

impl Hybrid {
    /// The inputs of a recording sampled at `t` with values `u` (one column an input), as forces on the integration grid, with
    /// derivatives in those entries of θ that are in `free`.
    pub fn drive(
        &self,
        t: &[f64],
        u: &[Vec<f64>],
        substeps: usize,
        theta: &[f64],
        free: &[usize],
    ) -> DrivenInputs {
        self.drive_on(Grid::new(t, substeps), u, theta, free)
    }

    /// The same on a grid with other steps.
    pub fn drive_on(
        &self,
        grid: Grid,
        u: &[Vec<f64>],
        theta: &[f64],
        free: &[usize],
    ) -> DrivenInputs {
        let forces = u
            .iter()
            .enumerate()
            .map(|(input, u)| {
                let mut signal = Signal {
                    value: self.between[input].over_steps(&grid, u),
                    by_parameter: Vec::new(),
                };
                for (effect, range) in self.effects.iter().zip(&self.ranges) {
                    if let Action::Drive(law) = effect.kind.action
                        && effect.target == input
                    {
                        let first = free.contains(&range.start).then_some(range.start);
                        law.pass(&grid, &theta[range.clone()], first, &mut signal);
                    }
                }
                self.amplify(input, theta, free, &mut signal);
                signal
            })
            .collect();
        DrivenInputs { grid, forces }
    }

    /// Times the gain.
    pub(super) fn amplify(&self, input: usize, theta: &[f64], free: &[usize], signal: &mut Signal) {
        let index = self.gain_index(input);
        let gain = theta[index];
        for (_, derivative) in &mut signal.by_parameter {
            derivative.iter_mut().for_each(|d| *d *= gain);
        }
        if free.contains(&index) {
            signal.by_parameter.push((index, signal.value.clone()));
        }
        signal.value.iter_mut().for_each(|u| *u *= gain);
    }

    /// How long ago, s, what an input was may still matter to the motion, `interval` s a sample; `None` where a law of its drive does not know.
    pub(crate) fn past(&self, interval: f64, theta: &[f64]) -> Option<f64> {
        let mut drives = vec![0.0; self.inputs()];
        for (effect, range) in self.effects.iter().zip(&self.ranges) {
            if let Action::Drive(law) = effect.kind.action {
                drives[effect.target] += law.past(&theta[range.clone()])?;
            }
        }
        let back = self
            .networks
            .iter()
            .flat_map(|network| network.features())
            .map(|feature| match feature.quantity {
                Quantity::Input { back, .. } => back,
                _ => 0,
            })
            .max();
        let longest = drives.into_iter().fold(0.0, f64::max);
        Some(longest + back.unwrap_or(0) as f64 * interval)
    }
}
