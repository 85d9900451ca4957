use super::Problem;
use super::formula::{Formula, system_of_formula};
use crate::Flat;

/// Robertson's chemical reaction of three species, x = [A, B, C], from (1, 0, 0):
///
/// - Ȧ = −k₁ A + k₃ B C
/// - Ḃ = k₁ A − k₃ B C − k₂ B²
/// - Ċ = k₂ B²
///
/// with k₁ = 0.04, k₂ = 3·10⁷ and k₃ = 10⁴ a second: eigenvalues from 0 to −10⁴, and A + B + C stays 1. Its constants are the k.
///
/// The solution is known at 0, at 0.4, 4, 40, 400 and 4000 s (Taylor series of degree 24 in numbers of 113 bits, `tests/references/taylor.c`,
/// the same 22 digits with other steps), and at 10¹¹ s, from the test set for IVP solvers of Bari (Mazzia and Magherini, 2008, problem `rober`).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Robertson {
    /// k₁, k₂, k₃, 1/s.
    pub rates: [f64; 3],
}

impl Default for Robertson {
    fn default() -> Self {
        Robertson { rates: RATES }
    }
}

const RATES: [f64; 3] = [0.04, 3e7, 1e4];

const KNOWN: [(f64, [f64; 3]); 7] = [
    (0.0, [1.0, 0.0, 0.0]),
    (
        0.4,
        [
            0.985_172_113_860_989_9,
            3.386_395_378_974_904e-5,
            0.014_794_022_185_220_388,
        ],
    ),
    (
        4.0,
        [
            0.905_518_678_584_253_9,
            2.240_475_687_560_201e-5,
            0.094_458_916_658_870_49,
        ],
    ),
    (
        40.0,
        [
            0.715_827_068_719_405,
            9.185_534_764_557_764e-6,
            0.284_163_745_745_830_37,
        ],
    ),
    (
        400.0,
        [
            0.450_518_668_471_102_45,
            3.222_901_441_674_611_5e-6,
            0.549_478_108_627_455_9,
        ],
    ),
    (
        4000.0,
        [
            0.183_202_257_776_709_3,
            8.942_371_252_775_91e-7,
            0.816_796_847_986_165_4,
        ],
    ),
    (
        1e11,
        [
            2.083_340_149_701_255e-8,
            8.333_360_770_334_713e-14,
            0.999_999_979_166_505,
        ],
    ),
];

impl Formula<3, 3> for Robertson {
    fn rate(&self, _t: f64, x: &[f64]) -> [f64; 3] {
        let [k1, k2, k3] = self.rates;
        let (first, second, third) = (k1 * x[0], k2 * x[1] * x[1], k3 * x[1] * x[2]);
        [third - first, first - third - second, second]
    }
    fn by_state(&self, _t: f64, x: &[f64]) -> [[f64; 3]; 3] {
        let [k1, k2, k3] = self.rates;
        let (second, by_b, by_c) = (2.0 * k2 * x[1], k3 * x[2], k3 * x[1]);
        [
            [-k1, by_b, by_c],
            [k1, -by_b - second, -by_c],
            [0.0, second, 0.0],
        ]
    }
    fn by_constants(&self, _t: f64, x: &[f64]) -> [[f64; 3]; 3] {
        let (first, second, third) = (x[0], x[1] * x[1], x[1] * x[2]);
        [
            [-first, 0.0, third],
            [first, -second, -third],
            [0.0, second, 0.0],
        ]
    }
}

system_of_formula!(Robertson, 3, 3, Flat = Flat::new(3));

impl Robertson {
    /// The times of known states, 0 first, s.
    pub fn known_times() -> impl Iterator<Item = f64> {
        KNOWN.iter().map(|(t, _)| *t)
    }
}

impl Problem for Robertson {
    fn name(&self) -> &'static str {
        "Robertson"
    }
    fn initial(&self) -> Vec<f64> {
        vec![1.0, 0.0, 0.0]
    }
    fn span(&self) -> f64 {
        40.0
    }
    fn solution(&self, t: f64) -> Option<Vec<f64>> {
        if t != 0.0 && self.rates != RATES {
            return None;
        }
        let known = KNOWN.iter().find(|(known, _)| *known == t)?;
        Some(known.1.to_vec())
    }
}
