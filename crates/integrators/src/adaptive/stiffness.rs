//! When to change between an explicit and an implicit method.
//!
//! An explicit method is stable on ẋ = λ x only for steps h with h λ in a bounded region, which for Tsit5 reaches to −3.5 on the real
//! axis. Where accuracy would allow more, its steps settle on that boundary, at h ρ ≈ 3.5 for the spectral radius ρ of ∂f/∂x
//! (Shampine 1977, "Stiffness and nonstiff differential equation solvers II"; Hairer and Wanner, "Solving Ordinary Differential
//! Equations II", IV.2). Two stages of a step of Tsit5 stand at its end, and the ratio of the difference of their rates to their
//! own difference estimates ρ at no cost. The way back compares what the two methods cost a second of motion: the explicit one with
//! the step that ρ of the exact Jacobian allows, the implicit one as it goes (Petzold 1983, "Automatic selection of methods for
//! solving stiff and nonstiff systems of ordinary differential equations", does the same for multistep methods).

use nalgebra::DMatrix;

/// −h λ at the end of the stability region of Tsit5 on the real axis.
const BOUNDARY: f64 = 3.5;

/// A step is bounded by stability from this part of the boundary on.
const NEAR: f64 = 0.75;

/// Steps in a row near the boundary before an implicit method is tried.
const PATIENCE: usize = 4;

/// Steps away from the boundary that make earlier ones near it forgotten.
const CALM: usize = 6;

/// Steps on the boundary still to come below which a change does not pay: what an implicit method needs to get going.
const WORTHWHILE: f64 = 40.0;

/// Evaluations in a step of Tsit5.
const EXPLICIT_COST: f64 = 6.0;

/// Implicit steps in a row that the explicit method would make cheaper before it is tried.
const CHEAPER: usize = 3;

/// Steps after a change in which it can prove wrong.
const TRIAL: usize = 30;

/// What the steps so far say about stiffness.
#[derive(Debug, Clone)]
pub(super) struct Watch {
    near: usize,
    calm: usize,
    cheaper: usize,
    /// Steps since the last change.
    since: usize,
    /// Grows while changes to the implicit method prove wrong.
    patience: usize,
    /// Grows while changes to the explicit method prove wrong.
    reluctance: usize,
    /// Seconds an evaluation that the method before the last change made.
    before: Option<f64>,
    /// Seconds and evaluations since the last change.
    progress: (f64, f64),
    /// Of the implicit steps: seconds and evaluations, forgotten slowly.
    average: (f64, f64),
    radius: f64,
    radius_of: usize,
}

impl Watch {
    pub fn new() -> Self {
        Watch {
            near: 0,
            calm: 0,
            cheaper: 0,
            since: 0,
            patience: PATIENCE,
            reluctance: CHEAPER,
            before: None,
            progress: (0.0, 0.0),
            average: (0.0, 0.0),
            radius: f64::INFINITY,
            radius_of: 0,
        }
    }

    fn changed(&mut self) {
        self.near = 0;
        self.calm = 0;
        self.cheaper = 0;
        self.since = 0;
        self.progress = (0.0, 0.0);
        self.average = (0.0, 0.0);
    }

    /// Whether to go on with an implicit method, after an explicit step of `h` that cost `cost` evaluations with `slope` as the
    /// estimate of ρ and `remaining` seconds to the end.
    pub fn explicit_step(&mut self, h: f64, cost: f64, slope: Option<f64>, remaining: f64) -> bool {
        self.since += 1;
        self.progress.0 += h;
        self.progress.1 += cost;
        if slope.is_some_and(|slope| h * slope > NEAR * BOUNDARY) {
            self.near += 1;
            self.calm = 0;
        } else {
            self.calm += 1;
            if self.calm >= CALM {
                self.near = 0;
            }
        }
        let speed = self.progress.0 / self.progress.1;
        if self.near >= self.patience && remaining / h > WORTHWHILE {
            self.before = Some(h / EXPLICIT_COST);
            self.changed();
            return true;
        }
        // The implicit method made more of an evaluation than this one does after the change.
        if self.since == 8 && self.before.is_some_and(|before| speed < 0.7 * before) {
            self.reluctance = (2 * self.reluctance).min(200);
            self.before = None;
            self.changed();
            return true;
        }
        if self.since == TRIAL {
            self.before = None;
            self.reluctance = CHEAPER;
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
        self.since += 1;
        let keep = 0.8;
        self.average.0 = keep * self.average.0 + h;
        self.average.1 = keep * self.average.1 + cost;
        if count != self.radius_of {
            self.radius = spectral_radius(jacobian);
            self.radius_of = count;
        }
        let stable = NEAR * BOUNDARY / self.radius;
        let speed = self.average.0 / self.average.1;
        if stable / EXPLICIT_COST > speed {
            self.cheaper += 1;
        } else {
            self.cheaper = 0;
            if self.since > TRIAL {
                self.patience = PATIENCE;
                self.reluctance = CHEAPER;
            }
        }
        if self.cheaper < self.reluctance {
            return None;
        }
        if self.since <= TRIAL {
            self.patience = (2 * self.patience).min(200);
        }
        self.before = Some(speed);
        self.changed();
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
