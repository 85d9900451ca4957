use super::Problem;
use super::formula::{Formula, system_of_formula};
use crate::Flat;

/// Van der Pol's relaxation oscillator in the scaling of Hairer and Wanner ("Solving Ordinary Differential Equations II", IV.1):
/// ẏ = z, ε ż = (1 − y²) z − y, from (2, 0); x = [y, z]. Its constant is ε.
///
/// The factor 1/ε before (1 − y²) z is the μ of many texts, 10⁶ here. In the unscaled equation ÿ = μ (1 − y²) ẏ − y it is μ² and time
/// counts in units of μ = 1/√ε. The fast eigenvalue begins at −3·10⁶.
///
/// The solution is known at 0 and, for ε = 10⁻⁶, at 2, two jumps later: by Taylor series of degree 24 in numbers of 113 bits (`tests/references/taylor.c`), with
/// the same 25 digits for 10⁶ and for 2·10⁶ steps. The test set for IVP solvers of Bari (Mazzia and Magherini, 2008, problem
/// `vdpol`) gives (1.706167732170483, −0.8928097010247975), which is this but for 2·10⁻¹⁴.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VanDerPol {
    /// ε.
    pub epsilon: f64,
}

impl Default for VanDerPol {
    fn default() -> Self {
        VanDerPol { epsilon: EPSILON }
    }
}

const EPSILON: f64 = 1e-6;
const SPAN: f64 = 2.0;
const AT_SPAN: [f64; 2] = [1.706_167_732_170_465, -0.892_809_701_024_816_5];

impl Formula<2, 1> for VanDerPol {
    fn rate(&self, _t: f64, x: &[f64]) -> [f64; 2] {
        [x[1], ((1.0 - x[0] * x[0]) * x[1] - x[0]) / self.epsilon]
    }
    fn by_state(&self, _t: f64, x: &[f64]) -> [[f64; 2]; 2] {
        [
            [0.0, 1.0],
            [
                (-2.0 * x[0] * x[1] - 1.0) / self.epsilon,
                (1.0 - x[0] * x[0]) / self.epsilon,
            ],
        ]
    }
    fn by_constants(&self, _t: f64, x: &[f64]) -> [[f64; 1]; 2] {
        let [_, rate] = Formula::rate(self, 0.0, x);
        [[0.0], [-rate / self.epsilon]]
    }
}

system_of_formula!(VanDerPol, 2, 1, Flat = Flat::new(2));

impl Problem for VanDerPol {
    fn name(&self) -> &'static str {
        "van der Pol"
    }
    fn initial(&self) -> Vec<f64> {
        vec![2.0, 0.0]
    }
    fn span(&self) -> f64 {
        SPAN
    }
    fn solution(&self, t: f64) -> Option<Vec<f64>> {
        if t == 0.0 {
            Some(self.initial())
        } else if t == SPAN && self.epsilon == EPSILON {
            Some(AT_SPAN.to_vec())
        } else {
            None
        }
    }
}
