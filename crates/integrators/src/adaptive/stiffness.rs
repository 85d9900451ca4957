//! When to change between an explicit and an implicit method.
//!
//! An explicit method is stable on ẋ = λ x only for steps h with h λ in a bounded region, which for Tsit5 reaches to −3.5 on the real
//! axis. Where accuracy would allow more, its steps settle on that boundary, at h ρ ≈ 3.5 for the spectral radius ρ of ∂f/∂x
//! (Shampine 1977, "Stiffness and nonstiff differential equation solvers II"; Hairer and Wanner, "Solving Ordinary Differential
//! Equations II", IV.2). Two stages of a step of Tsit5 stand at its end, and the ratio of the difference of their rates to their
//! own difference estimates ρ at no cost. Already at h ρ ≈ 1 components that have decayed can hold the step back by their part in
//! the error estimate.
//!
//! So the explicit method is left after [`PATIENCE`] steps in a row near the boundary, or [`LONG_PATIENCE`] steps in a row with h ρ
//! above [`MODERATE`]; and that is a trial. After [`WARM_UP`] steps the implicit method has found its order and its step, and it stays
//! if it makes [`MARGIN`] times as many seconds an evaluation as the explicit one made: at the same tolerance the explicit one is the
//! more accurate, and that factor is what it takes to make up for it. The way back is a trial too. It begins where the step that ρ of
//! the exact Jacobian leaves to the explicit method would make more of an evaluation than the implicit steps do (Petzold 1983,
//! "Automatic selection of methods for solving stiff and nonstiff systems of ordinary differential equations", compares steps in
//! this way between multistep methods), and ends after [`SHORT`] steps if they do not. Every trial that fails makes the next one come
//! later by a factor of two.
//!
//! What is compared is evaluations, of which a Jacobian and a step count some, not time: the same numbers make the same decisions.

use nalgebra::DMatrix;

/// −h λ at the end of the stability region of Tsit5 on the real axis.
const BOUNDARY: f64 = 3.5;

/// A step is near the boundary from this part of it on.
const NEAR: f64 = 0.75;

/// Steps near the boundary before the implicit method is tried.
const PATIENCE: usize = 4;

/// Steps away from the boundary that make earlier ones near it forgotten.
const CALM: usize = 6;

/// h ρ from which on steps may be held back by what has decayed.
const MODERATE: f64 = 1.0;

/// Steps in a row above [`MODERATE`] before the implicit method is tried.
const LONG_PATIENCE: usize = 15;

/// Explicit steps still to come below which a change does not pay.
const WORTHWHILE: f64 = 40.0;

/// Implicit steps after which a trial is judged.
const WARM_UP: usize = 40;

/// Explicit steps after which a trial is judged.
const SHORT: usize = 6;

/// Implicit steps in a row that the explicit method would make cheaper before it is tried.
const CHEAPER: usize = 4;

/// How many times the seconds an evaluation of the explicit method the implicit one has to make.
const MARGIN: f64 = 1.8;

/// Failed trials delay the next one by this factor at most.
const LATEST: usize = 64;

/// Evaluations in a step of Tsit5.
const EXPLICIT: f64 = 6.0;

/// What a step costs beside its evaluations, in evaluations.
pub(super) const STEP: f64 = 1.0;

/// What a Jacobian costs, in evaluations, for `n` directions of motion: a forward pass of derivatives.
pub(super) fn jacobian_cost(n: usize) -> f64 {
    1.0 + 0.5 * n as f64
}

/// What the steps so far say about stiffness.
#[derive(Debug, Clone)]
pub(super) struct Watch {
    near: usize,
    calm: usize,
    moderate: usize,
    cheaper: usize,
    /// Steps since the last change.
    since: usize,
    /// On trial: seconds an evaluation that have to be made.
    to_beat: Option<f64>,
    /// What failed trials of the implicit method delay the next one by.
    patience: usize,
    /// The same for the explicit method.
    reluctance: usize,
    /// Seconds and evaluations, forgotten with every step.
    recent: (f64, f64),
    /// The last explicit step.
    explicit_h: f64,
    radius: f64,
    radius_of: usize,
}

impl Watch {
    pub fn new() -> Self {
        Watch {
            near: 0,
            calm: 0,
            moderate: 0,
            cheaper: 0,
            since: 0,
            to_beat: None,
            patience: 1,
            reluctance: 1,
            recent: (0.0, 0.0),
            explicit_h: 0.0,
            radius: f64::INFINITY,
            radius_of: 0,
        }
    }

    /// Seconds an evaluation, lately.
    fn speed(&self) -> f64 {
        self.recent.0 / self.recent.1
    }

    fn step(&mut self, h: f64, cost: f64) {
        const KEPT: f64 = 0.88;
        self.since += 1;
        self.recent = (KEPT * self.recent.0 + h, KEPT * self.recent.1 + cost);
    }

    /// Forgets the steps of the method before, and asks of the next one to beat a speed.
    fn change(&mut self, to_beat: Option<f64>) {
        (self.near, self.calm, self.moderate, self.cheaper) = (0, 0, 0, 0);
        self.since = 0;
        self.recent = (0.0, 0.0);
        self.to_beat = to_beat;
    }

    /// Whether to go on with the implicit method, after an explicit step of `h` that cost `cost` evaluations with `slope` as the
    /// estimate of ρ and `remaining` seconds to the end.
    pub fn explicit_step(&mut self, h: f64, cost: f64, slope: Option<f64>, remaining: f64) -> bool {
        self.step(h, cost);
        self.explicit_h = h;
        if let Some(to_beat) = self.to_beat
            && self.since >= SHORT
        {
            if self.speed() < to_beat {
                self.reluctance = (2 * self.reluctance).min(LATEST);
                self.change(None);
                return true;
            }
            self.reluctance = 1;
            self.to_beat = None;
        }
        let product = h * slope.unwrap_or(0.0);
        if product > NEAR * BOUNDARY {
            self.near += 1;
            self.calm = 0;
        } else {
            self.calm += 1;
            if self.calm >= CALM {
                self.near = 0;
            }
        }
        self.moderate = if product > MODERATE {
            self.moderate + 1
        } else {
            0
        };
        let enough =
            self.near >= self.patience * PATIENCE || self.moderate >= self.patience * LONG_PATIENCE;
        if enough && remaining > WORTHWHILE * h {
            self.change(Some(MARGIN * self.speed()));
            return true;
        }
        false
    }

    /// The step to go on with by the explicit method, if so, after an implicit step of `h` that cost `cost` evaluations; the
    /// `count`-th Jacobian is `jacobian`.
    pub fn implicit_step(
        &mut self,
        h: f64,
        cost: f64,
        (count, jacobian): (usize, &DMatrix<f64>),
    ) -> Option<f64> {
        self.step(h, cost);
        if self.since < WARM_UP {
            return None;
        }
        if count != self.radius_of {
            self.radius = spectral_radius(jacobian);
            self.radius_of = count;
        }
        let stable = NEAR * BOUNDARY / self.radius;
        let speed = self.speed();
        if let Some(to_beat) = self.to_beat.take() {
            if speed < to_beat {
                self.patience = (2 * self.patience).min(LATEST);
                self.change(None);
                return Some(stable.min(self.explicit_h));
            }
            self.patience = 1;
        }
        if stable / (EXPLICIT + STEP) > speed {
            self.cheaper += 1;
        } else {
            self.cheaper = 0;
        }
        if self.cheaper < CHEAPER * self.reluctance {
            return None;
        }
        self.change(Some(speed / MARGIN));
        Some(stable.min(h))
    }
}

/// The spectral radius of a matrix, from above: ‖Aᵏ‖^(1/k) with k = 64 (Gelfand), at most n^(1/64) too large.
fn spectral_radius(matrix: &DMatrix<f64>) -> f64 {
    let mut power = matrix.clone();
    // ρ = exp(log_scale) ‖power‖^(1/k).
    let (mut log_scale, mut k) = (0.0, 1.0);
    for _ in 0..6 {
        let size = power.norm();
        if size == 0.0 {
            return 0.0;
        }
        power /= size;
        log_scale += size.ln() / k;
        power = &power * &power;
        k *= 2.0;
    }
    let size = power.norm();
    if size == 0.0 {
        return 0.0;
    }
    (log_scale + size.ln() / k).exp()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spectral_radius_of_known_matrices() {
        let real = DMatrix::from_row_slice(2, 2, &[-3.0, 1.0, 0.0, -1000.0]);
        approx::assert_relative_eq!(spectral_radius(&real), 1000.0, max_relative = 0.02);
        // Eigenvalues ±2 i.
        let turning = DMatrix::from_row_slice(2, 2, &[0.0, 4.0, -1.0, 0.0]);
        approx::assert_relative_eq!(spectral_radius(&turning), 2.0, max_relative = 0.02);
        let nilpotent = DMatrix::from_row_slice(2, 2, &[0.0, 1e6, 0.0, 0.0]);
        assert_eq!(spectral_radius(&nilpotent), 0.0);
        // Far from normal: eigenvalue 1 twice.
        let shear = DMatrix::from_row_slice(2, 2, &[1.0, 1e3, 0.0, 1.0]);
        assert!((1.0..1.3).contains(&spectral_radius(&shear)));
    }
}
