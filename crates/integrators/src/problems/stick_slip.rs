use std::convert::Infallible;

use crate::event::{ContactSystem, Coulomb, Law, Masses};

/// A mass m on a belt of speed V, held by a spring k: m ẍ = −k x + λ with dry friction λ, which brakes less than it holds.
///
/// x = [x, ẋ]. The mass rides on the belt until the spring pulls as much as friction holds, at x = F_s/k; it then slips back, slower
/// than the belt, on an arc of a circle of (x, ẋ/ω) about F_d/k, where ω = √(k/m), and is caught by the belt where the arc comes back to
/// the speed V, at x = (2 F_d − F_s)/k. That is a limit cycle, on which the solution starts at the end of the ride.
///
/// ```
/// use integrators::event::roll_out_events;
/// use integrators::problems::StickSlip;
///
/// let problem = StickSlip { mass: 2.0, stiffness: 50.0, belt: 0.3, sliding: 4.0, breakaway: 7.0 };
/// let end = 1.5 * problem.period();
/// let motion = roll_out_events(
///     &problem.system(), vec![problem.law()], &[0.0, end], &[()], 2000, &problem.initial(),
/// )?;
/// assert!((motion.states[1][0] - problem.solution(end)[0]).abs() < 1e-9);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StickSlip {
    /// m, kg.
    pub mass: f64,
    /// k, N/m.
    pub stiffness: f64,
    /// V > 0, m/s.
    pub belt: f64,
    /// F_d, N, at least 0.
    pub sliding: f64,
    /// F_s > F_d, N.
    pub breakaway: f64,
}

impl StickSlip {
    /// ω, rad/s.
    pub fn frequency(&self) -> f64 {
        (self.stiffness / self.mass).sqrt()
    }

    /// From the centre of the arc to either end of the ride, m.
    fn reach(&self) -> f64 {
        (self.breakaway - self.sliding) / self.stiffness
    }

    /// The angle on the arc between the end of the ride and the belt's direction at rest, rad.
    fn angle(&self) -> f64 {
        self.belt.atan2(self.frequency() * self.reach())
    }

    /// How long it slips, s: (π + 2 atan(V/(ω (F_s − F_d)/k)))/ω.
    pub fn slip_time(&self) -> f64 {
        (std::f64::consts::PI + 2.0 * self.angle()) / self.frequency()
    }

    /// The period, s: the slip and the ride of 2 (F_s − F_d)/(k V).
    pub fn period(&self) -> f64 {
        self.slip_time() + 2.0 * self.reach() / self.belt
    }

    /// x(0): at the end of the ride, with the speed of the belt.
    pub fn initial(&self) -> Vec<f64> {
        vec![self.breakaway / self.stiffness, self.belt]
    }

    /// x(t) for t ≥ 0.
    pub fn solution(&self, t: f64) -> Vec<f64> {
        let (omega, reach) = (self.frequency(), self.reach());
        let centre = self.sliding / self.stiffness;
        let phase = t.rem_euclid(self.period());
        if phase < self.slip_time() {
            let radius = reach.hypot(self.belt / omega);
            let (sin, cos) = (omega * phase - self.angle()).sin_cos();
            vec![centre + radius * cos, -omega * radius * sin]
        } else {
            let ride = phase - self.slip_time();
            vec![centre - reach + self.belt * ride, self.belt]
        }
    }

    /// The mass and the spring.
    pub fn system(&self) -> impl ContactSystem<Input = (), Error = Infallible> + use<> {
        let StickSlip {
            mass, stiffness, ..
        } = *self;
        Masses::new(1, move |_t, (q, _v), _u: &(), m, force| {
            m[(0, 0)] = mass;
            force[0] = -stiffness * q[0];
            Ok(())
        })
    }

    /// The friction on the belt.
    pub fn law(&self) -> Law {
        let size = Coulomb {
            sliding: self.sliding,
            breakaway: self.breakaway,
        };
        Law::friction(&[1.0], size).on_belt(self.belt)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solution_joins_its_arcs_and_obeys_the_equation() {
        let problem = StickSlip {
            mass: 2.0,
            stiffness: 50.0,
            belt: 0.3,
            sliding: 4.0,
            breakaway: 7.0,
        };
        let close = |a: Vec<f64>, b: Vec<f64>, bound: f64| {
            assert!(
                (a[0] - b[0]).abs() < bound && (a[1] - b[1]).abs() < bound,
                "{a:?} {b:?}"
            );
        };
        let (slip, period) = (problem.slip_time(), problem.period());
        close(problem.solution(0.0), problem.initial(), 1e-14);
        close(
            problem.solution(slip - 1e-12),
            problem.solution(slip + 1e-12),
            1e-10,
        );
        close(problem.solution(period - 1e-12), problem.initial(), 1e-10);
        let h = 1e-4;
        for i in 1..20 {
            let t = slip * f64::from(i) / 20.0;
            let [before, at, after] = [t - h, t, t + h].map(|t| problem.solution(t));
            let acceleration = (after[1] - before[1]) / (2.0 * h);
            let force = -problem.stiffness * at[0] + problem.sliding;
            approx::assert_abs_diff_eq!(problem.mass * acceleration, force, epsilon = 1e-5);
            approx::assert_abs_diff_eq!((after[0] - before[0]) / (2.0 * h), at[1], epsilon = 1e-6);
        }
    }
}
