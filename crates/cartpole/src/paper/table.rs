//! The paper's numbers (Roehrl et al. 2020, Tables 1 and 2), and those of a recording beside them.

use crate::rig::Recording;

/// How many samples the paper trains with: 8 minutes at 50 Hz.
pub const SAMPLES: usize = 24_271;
/// How many samples a recording for tests has: 3 minutes at 50 Hz. The paper does not tell.
pub const TEST_SAMPLES: usize = 9_000;
/// m_c, kg (Table 2).
pub const CART_MASS: f64 = 0.466;
/// m_p, kg (Table 2).
pub const POLE_MASS: f64 = 0.06;
/// m_s, kg (Table 2), at the tip of the pole.
pub const TIP_MASS: f64 = 0.012;
/// l, m (Table 2).
pub const POLE_LENGTH: f64 = 0.201;
/// μ_c (Table 2), over the constant normal force (m_c + m_p + m_s) g of eq. 13.
pub const CART_FRICTION: f64 = 0.0408;
/// μ_p, N·m·s/rad (Table 2).
pub const POLE_FRICTION: f64 = 0.0020;
/// g, m/s² (Table 2).
pub const GRAVITY: f64 = 9.81;

/// One line of Table 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Statistics {
    /// The column of the log.
    pub name: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// Mean.
    pub mean: f64,
    /// Standard deviation.
    pub std: f64,
    /// Least value.
    pub min: f64,
    /// Largest value.
    pub max: f64,
}

/// Names and units of the four columns.
const COLUMNS: [(&str, &str); 4] = [
    ("q.slider", "m"),
    ("q.pole", "rad"),
    ("v.slider", "m/s"),
    ("v.pole", "rad/s"),
];

/// A line of Table 1.
const fn line(column: usize, [mean, std, min, max]: [f64; 4]) -> Statistics {
    let (name, unit) = COLUMNS[column];
    Statistics {
        name,
        unit,
        mean,
        std,
        min,
        max,
    }
}

/// Roehrl et al. 2020, Table 1: x, φ in [0, 2π), ẋ, φ̇ of the 24,271 samples.
///
/// φ̇ h is −27° and 21° at its extremes and the largest φ is 358.667°: the coarsest encoder with a step that divides 3° and of which all three
/// are multiples has 1080 counts, 1/3°.
pub const TABLE_1: [Statistics; 4] = [
    line(0, [0.024, 0.126, -0.325, 0.276]),
    line(1, [3.290, 1.823, 0.0, 6.260]),
    line(2, [0.0, 0.430, -4.398, 4.141]),
    line(3, [-0.328, 6.742, -23.562, 18.326]),
];

/// The statistics of a log, in the order of [`TABLE_1`].
pub fn statistics(log: &Recording) -> [Statistics; 4] {
    let columns = [&log.q[0], &log.q[1], &log.v[0], &log.v[1]];
    let mut all = TABLE_1;
    for (column, values) in columns.into_iter().enumerate() {
        let rows = values.len() as f64;
        let mean = values.iter().sum::<f64>() / rows;
        let variance = values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / rows;
        let min = values.iter().copied().fold(f64::INFINITY, f64::min);
        let max = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        all[column] = line(column, [mean, variance.sqrt(), min, max]);
    }
    all
}

impl Statistics {
    /// How far mean, standard deviation and the two extremes are from those of `other`, as shares of the latter; means and extremes that
    /// are smaller than its standard deviation as shares of that.
    pub fn departures(&self, other: &Self) -> [f64; 4] {
        let share = |ours: f64, theirs: f64| (ours - theirs).abs() / theirs.abs().max(other.std);
        [
            share(self.mean, other.mean),
            (self.std - other.std).abs() / other.std,
            share(self.min, other.min),
            share(self.max, other.max),
        ]
    }
}
