//! When to change between an explicit and an implicit method.
//!
//! An explicit method is stable on ẋ = λ x only for steps h with h λ in a bounded region, which for Tsit5 reaches to −3.5 on the real
//! axis. Where accuracy would allow more, its steps settle on that boundary, at h ρ ≈ 3.5 for the spectral radius ρ of ∂f/∂x
//! (Shampine 1977, "Stiffness and nonstiff differential equation solvers II"; Hairer and Wanner, "Solving Ordinary Differential
//! Equations II", IV.2). Two stages of a step of Tsit5 stand at its end, and the ratio of the difference of their rates to their
//! own difference estimates ρ at no cost. Already at h ρ ≈ 1 components that have decayed can hold the step back by their part in
//! the error estimate.
//!
//! So the explicit method is left after [`PATIENCE`] steps in a row near the boundary (or tried again by it), or [`LONG_PATIENCE`]
//! steps in a row with h ρ above [`MODERATE`]; and that is a trial. The implicit method stays if within [`WARM_UP`] steps it makes
//! [`MARGIN`] times as many seconds an evaluation as the explicit one made, and goes as soon as it is clear that it does not. The
//! way back is a trial too. It begins where the step that ρ of the exact Jacobian leaves to the explicit method would make
//! [`BETTER`] times as much of an evaluation as the implicit steps do (Petzold 1983, "Automatic selection of methods for solving stiff
//! and nonstiff systems of ordinary differential equations", compares steps in this way between multistep methods), and ends after
//! [`SHORT`] steps if they make less than those did. Every trial that fails, and every change that is taken back before [`TENURE`]
//! steps, makes the next one come later by a factor of two.
//!
//! The two are compared at the same error, not at the same tolerance: with one tolerance an implicit method ends with an error some ten
//! times that of Tsit5, and where both make parts of a motion, the evaluations that went into the better part would be lost. So the
//! implicit method steps at [`TIGHTER`] times the tolerance.
//!
//! What is compared is evaluations, not time: the same numbers make the same decisions. A Jacobian, a factorisation, a solution and a
//! step count some of them. For linear algebra that depends on how many operations an evaluation takes, which is not known; what is
//! known is that it does something for each entry of its Jacobian that is not 0.

use nalgebra::DMatrix;

/// −h λ at the end of the stability region of Tsit5 on the real axis.
pub(super) const BOUNDARY: f64 = 3.5;

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

/// Explicit steps still to come below which a change does not pay, for few directions of motion.
const WORTHWHILE: f64 = 40.0;

/// Directions of motion that make a trial as expensive again.
const MANY: f64 = 8.0;

/// How far beyond stability a first step that is accurate has to be for the implicit method to begin.
const FAR_BEYOND: f64 = 10.0;

/// Implicit steps after which a trial is judged.
const WARM_UP: usize = 40;

/// Implicit steps after which a trial may have been won.
const EARLY: usize = 8;

/// Implicit steps after which a trial may have been lost.
const LATE: usize = 15;

/// The part of what has to be made below which it has.
const HOPELESS: f64 = 0.25;

/// Explicit steps after which a trial is judged.
const SHORT: usize = 6;

/// Implicit steps in a row that the explicit method would make cheaper before it is tried.
const CHEAPER: usize = 4;

/// How many times cheaper that has to be.
const BETTER: f64 = 2.0;

/// How many times the seconds an evaluation of the explicit method the implicit one has to make.
const MARGIN: f64 = 1.2;

/// A change that is taken back before so many steps was none.
const TENURE: usize = 60;

/// Failed trials delay the next one by this factor at most.
const LATEST: usize = 64;

/// The tolerance of the implicit method beside that of the explicit one.
pub(super) const TIGHTER: f64 = 0.1;

/// Evaluations in a step of Tsit5.
const EXPLICIT: f64 = 6.0;

/// What a step costs beside its evaluations, in evaluations.
const STEP: f64 = 1.0;

/// Operations of an evaluation for each entry of its Jacobian that is not 0: two, a product and a sum, where forces are linear, and many where they are
/// those of a mechanism.
const OPERATIONS: f64 = 6.0;

/// What a step took.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Taken {
    /// Its length, s.
    pub h: f64,
    pub evaluations: usize,
    pub jacobians: usize,
    pub factorizations: usize,
    /// How often it was tried again.
    pub rejected: usize,
}

impl Taken {
    /// In evaluations, without linear algebra.
    fn explicit_cost(&self) -> f64 {
        STEP + self.evaluations as f64
    }

    /// In evaluations. A Jacobian of n directions counts 1 + n/2 of them, a forward pass of derivatives; a factorisation takes 2n³/3
    /// operations, and with each evaluation comes a solution, of 2n².
    fn implicit_cost(&self, jacobian: &DMatrix<f64>) -> f64 {
        let n = jacobian.nrows() as f64;
        let entries = jacobian.iter().filter(|entry| **entry != 0.0).count() as f64;
        let operations = OPERATIONS * entries.max(n);
        let solution = 2.0 * n * n / operations;
        let factorization = 2.0 / 3.0 * n.powi(3) / operations;
        STEP + (1.0 + solution) * self.evaluations as f64
            + (1.0 + 0.5 * n) * self.jacobians as f64
            + factorization * self.factorizations as f64
    }
}

/// What the steps so far say about stiffness.
#[derive(Debug, Clone)]
pub(super) struct Watch {
    directions: f64,
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

/// One more failure, or none lately.
fn longer(delay: usize, failed: bool) -> usize {
    if failed { (2 * delay).min(LATEST) } else { 1 }
}

impl Watch {
    pub fn new(directions: usize) -> Self {
        Watch {
            directions: directions as f64,
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

    /// Whether the implicit method begins, on trial: a first step of `h`, which accuracy allows, is far beyond stability for an
    /// estimate of ρ.
    pub fn begins_stiff(&mut self, h: f64, radius: f64) -> bool {
        let stiff = h * radius > FAR_BEYOND * BOUNDARY;
        if stiff {
            self.explicit_h = NEAR * BOUNDARY / radius;
            self.change(Some(MARGIN * self.explicit_h / (EXPLICIT + STEP)));
        }
        stiff
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

    /// Whether to go on with the implicit method after an explicit step, with `slope` as the estimate of ρ and `remaining` seconds to
    /// the end.
    pub fn explicit_step(&mut self, taken: Taken, slope: Option<f64>, remaining: f64) -> bool {
        let h = taken.h;
        self.step(h, taken.explicit_cost());
        self.explicit_h = h;
        if let Some(to_beat) = self.to_beat
            && self.since >= SHORT
        {
            if self.speed() < to_beat {
                self.reluctance = longer(self.reluctance, true);
                self.change(None);
                return true;
            }
            self.to_beat = None;
        }
        let product = h * slope.unwrap_or(0.0);
        // Shortened twice is more than a change of the motion does.
        let held_back = taken.rejected > 1 || (taken.rejected > 0 && product > MODERATE);
        if held_back || product > NEAR * BOUNDARY {
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
        if enough && remaining > WORTHWHILE * (1.0 + self.directions / MANY) * h {
            self.reluctance = longer(self.reluctance, self.since < TENURE);
            self.change(Some(MARGIN * self.speed()));
            return true;
        }
        false
    }

    /// The step to go on with by the explicit method, if so, after an implicit step; the `count`-th Jacobian is `jacobian`.
    pub fn implicit_step(
        &mut self,
        taken: Taken,
        (count, jacobian): (usize, &DMatrix<f64>),
    ) -> Option<f64> {
        self.step(taken.h, taken.implicit_cost(jacobian));
        if count != self.radius_of {
            self.radius = spectral_radius(jacobian);
            self.radius_of = count;
        }
        let stable = NEAR * BOUNDARY / self.radius;
        let speed = self.speed();
        if let Some(to_beat) = self.to_beat {
            let lost = self.since >= WARM_UP || (self.since >= LATE && speed < HOPELESS * to_beat);
            if self.since >= EARLY && speed >= to_beat {
                self.to_beat = None;
            } else if lost {
                self.patience = longer(self.patience, true);
                self.change(None);
                return Some(stable.min(self.explicit_h));
            } else {
                return None;
            }
        }
        if stable / (EXPLICIT + STEP) > BETTER * speed {
            self.cheaper += 1;
        } else {
            self.cheaper = 0;
        }
        if self.cheaper < CHEAPER * self.reluctance {
            return None;
        }
        self.patience = longer(self.patience, self.since < TENURE);
        self.change(Some(speed));
        Some(stable.min(taken.h))
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
