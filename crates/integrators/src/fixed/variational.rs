//! The midpoint rule of a discrete Lagrangian.

use super::broyden::Broyden;
use super::{Method, StepError};
use crate::space::series::{Work, sum};
use crate::{Mechanical, Space};

/// Order of [`Variational`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Order {
    /// One step a step.
    Two,
    /// Five steps of order 2, of lengths γ, γ, 1 − 4γ, γ, γ with γ = 1/(4 − 4^{1/3}) (Suzuki, Phys. Lett. A 146, 1990).
    #[default]
    Four,
}

/// A variational integrator for any mass matrix and any space: symplectic, time-symmetric, and in a system with symmetries and Q = 0
/// it keeps the momenta that belong to them. The energy stays near its value as long as one cares to look.
///
/// It makes the sum over the steps of L_d = h L(q_m, v) stationary, with q_k ⊕ h v = q_{k+1} and q_m = q_k ⊕ h/2 v. With μ = ∂L/∂v and
/// F = ∂L/∂q + Q at (t + h/2, q_m, v), and A = ad of h/2 v, the momenta before and after a step are
///
/// - p_k = (A e^{−A} / sinh A)ᵀ μ − h ((e^A + 1)⁻¹)ᵀ F
/// - p_{k+1} = (A e^A / sinh A)ᵀ μ + h ((1 + e^{−A})⁻¹)ᵀ F
///
/// which are μ ∓ h/2 F where space is flat: there it is the implicit midpoint rule in (q, p), Gauss and Legendre's of one stage. (Marsden
/// and West, "Discrete mechanics and variational integrators", Acta Numerica 2001; the operators are the derivatives of q_m and v in the
/// two ends.) The first is solved for v to rounding by Broyden's method from v ← v + M⁻¹ (p_k − its right-hand side), which converges
/// for steps that are short beside the periods of the motion.
///
/// The series of the operators are cut after A¹⁵: where positions turn, form and momenta are kept to rounding in steps of up to a radian.
///
/// Of a body that travels and turns, q a pose and v its velocities in its own axes, the attitude is worse than by Runge and Kutta's method: what is
/// kept of the angular momentum is that about the origin, x × p + spin. A step is a screw with constant v, the position errs across p by
/// its truncation, and the spin takes what x × p is off by: |p| times that error. A body of 2 kg that spins with 10 rad/s, in steps of 1 ms, after 3 s:
/// at 20, 60 and 200 m/s x is off its line by 3.5e-9, 9.2e-8 and 3.2e-6 m, and the spin by 7.0e-7, 5.5e-5 and 6.5e-3 of itself, about as speed⁴;
/// with half the step, at 200 m/s, by 4.9e-4 (Runge and Kutta's of order 4: 5e-11). Take that, or shorter steps, for what flies fast.
///
/// Forces that depend on v and q are allowed, and act as they should; the energy then is what they make of it.
#[derive(Debug, Clone)]
pub struct Variational {
    order: Order,
    /// p_k, then p_{k+1}.
    momentum: Vec<f64>,
    velocity: Vec<f64>,
    middle: Vec<f64>,
    next: Vec<f64>,
    motion: Vec<f64>,
    of_velocity: Vec<f64>,
    force: Vec<f64>,
    residual: Vec<f64>,
    carried: Vec<f64>,
    /// q of the step under way.
    start: Vec<f64>,
    work: Work,
    broyden: Broyden,
}

/// A change of v, relative to the larger of v and the guess, that is rounding. The guess is there for steps across a turning point,
/// whose v is a small difference of large terms.
const CONVERGED: f64 = 4.0 * f64::EPSILON;
/// Changes of which none is a new smallest one for so many iterations are accepted below this size: the rounding of M⁻¹ where M is
/// badly conditioned.
const STAGNANT: (usize, f64) = (5, 1e-9);
/// A velocity so many times larger than the guess and the first change is not on its way to a solution.
const STRAY: f64 = 100.0;
const MOST_ITERATIONS: usize = 40;

/// x e^{−x}/sinh x = 2x/(e^{2x} − 1), by Bernoulli's numbers Bₙ: (2x)ⁿ Bₙ/n!; with the odd term's other sign x e^x/sinh x.
const BERNOULLI: [f64; 17] = [
    1.0,
    -1.0,
    4.0 / 12.0,
    0.0,
    -16.0 / 720.0,
    0.0,
    64.0 / 30_240.0,
    0.0,
    -256.0 / 1_209_600.0,
    0.0,
    1024.0 / 47_900_160.0,
    0.0,
    -4096.0 * 691.0 / 1_307_674_368_000.0,
    0.0,
    16_384.0 / 74_724_249_600.0,
    0.0,
    -65_536.0 * 3617.0 / 10_670_622_842_880_000.0,
];

/// 1/(e^x + 1) = ½ − ½ tanh(x/2); with the other sign of all but the first 1/(1 + e^{−x}).
const LOGISTIC: [f64; 16] = [
    0.5,
    -0.25,
    0.0,
    1.0 / 48.0,
    0.0,
    -1.0 / 480.0,
    0.0,
    17.0 / 80_640.0,
    0.0,
    -31.0 / 1_451_520.0,
    0.0,
    691.0 / 319_334_400.0,
    0.0,
    -5461.0 / 24_908_083_200.0,
    0.0,
    929_569.0 / 41_845_579_776_000.0,
];

/// The largest size of an entry; NaN where there is one.
fn largest(x: &[f64]) -> f64 {
    x.iter().fold(0.0, |largest: f64, x| {
        // f64::max would let a NaN go.
        if largest.is_nan() || x.abs() <= largest {
            largest
        } else {
            x.abs()
        }
    })
}

impl Variational {
    /// With memory for a system.
    pub fn new<S: Mechanical>(system: &S, order: Order) -> Self {
        let (nq, nv) = (system.positions().dim(), system.positions().tangent_dim());
        Variational {
            order,
            momentum: vec![0.0; nv],
            velocity: vec![0.0; nv],
            middle: vec![0.0; nq],
            next: vec![0.0; nq],
            motion: vec![0.0; nv],
            of_velocity: vec![0.0; nv],
            force: vec![0.0; nv],
            residual: vec![0.0; nv],
            carried: vec![0.0; nv],
            start: vec![0.0; nq],
            work: Work::new(nv),
            broyden: Broyden::new(nv),
        }
    }

    /// μ and F for the velocity of the step.
    fn at_middle<S: Mechanical>(
        &mut self,
        system: &S,
        (t, h): (f64, f64),
        u: &S::Input,
        memory: &mut S::Memory,
        q: &[f64],
    ) -> Result<(), S::Error> {
        for (d, v) in self.motion.iter_mut().zip(&self.velocity) {
            *d = 0.5 * h * v;
        }
        system
            .positions()
            .move_into(q, &self.motion, &mut self.middle);
        let at = (self.middle.as_slice(), self.velocity.as_slice());
        system.momentum(at, memory, &mut self.of_velocity)?;
        system.position_force(t + 0.5 * h, at, u, memory, &mut self.force)
    }

    /// The momentum at one end of the step, into `residual`: `side` is −1 for its beginning and 1 for its end.
    fn end_momentum<S: Mechanical>(&mut self, system: &S, h: f64, side: f64) {
        let space = system.positions();
        if space.is_flat() {
            for ((p, m), f) in self
                .residual
                .iter_mut()
                .zip(&self.of_velocity)
                .zip(&self.force)
            {
                *p = m + side * 0.5 * h * f;
            }
            return;
        }
        // The series for the end of the step are those for its beginning at −A: `motion` then is −h/2 v.
        for (d, v) in self.motion.iter_mut().zip(&self.velocity) {
            *d = -side * 0.5 * h * v;
        }
        let (motion, work) = (&self.motion, &mut self.work);
        let mut apply = |x: &[f64], y: &mut [f64]| space.cobracket_into(motion, x, y);
        let curved = space.curved();
        sum(
            &BERNOULLI,
            (&self.of_velocity, curved.clone()),
            work,
            &mut self.residual,
            &mut apply,
        );
        sum(
            &LOGISTIC,
            (&self.force, curved),
            work,
            &mut self.carried,
            &mut apply,
        );
        for (p, f) in self.residual.iter_mut().zip(&self.carried) {
            *p += side * h * f;
        }
    }

    /// One step of order 2 from (q, momentum); `velocity` holds a guess, and then the velocity of the step.
    fn advance<S: Mechanical>(
        &mut self,
        system: &S,
        (t, h): (f64, f64),
        u: &S::Input,
        memory: &mut S::Memory,
        q: &mut [f64],
    ) -> Result<(), StepError<S::Error>> {
        let failed = StepError::RightHandSide;
        let guess = largest(&self.velocity);
        self.broyden.begin();
        let (mut smallest, mut since, mut reach) = (f64::INFINITY, 0, f64::INFINITY);
        for iterations in 1.. {
            self.at_middle(system, (t, h), u, memory, q)
                .map_err(failed)?;
            self.end_momentum(system, h, -1.0);
            for (r, p) in self.residual.iter_mut().zip(&self.momentum) {
                *r = p - *r;
            }
            system
                .velocity(&self.middle, memory, &mut self.residual)
                .map_err(failed)?;
            self.broyden.step(&mut self.residual);
            for (v, d) in self.velocity.iter_mut().zip(&self.residual) {
                *v += d;
            }
            let change = largest(&self.residual);
            let size = guess.max(largest(&self.velocity));
            if iterations == 1 {
                reach = STRAY * (guess + change);
            }
            // NaN is not less than anything.
            let sound = size <= reach && change < f64::INFINITY;
            if change < smallest {
                (smallest, since) = (change, 0);
            } else {
                since += 1;
            }
            let stagnant = since >= STAGNANT.0 && change <= STAGNANT.1 * size;
            if sound && (change <= CONVERGED * size || stagnant) {
                break;
            }
            if iterations == MOST_ITERATIONS || !sound {
                return Err(StepError::NoConvergence {
                    iterations,
                    change: change / size,
                });
            }
        }
        self.at_middle(system, (t, h), u, memory, q)
            .map_err(failed)?;
        self.end_momentum(system, h, 1.0);
        self.momentum.copy_from_slice(&self.residual);
        for (d, v) in self.motion.iter_mut().zip(&self.velocity) {
            *d = h * v;
        }
        system
            .positions()
            .move_into(q, &self.motion, &mut self.next);
        q.copy_from_slice(&self.next);
        Ok(())
    }
}

impl<S: Mechanical> Method<S> for Variational {
    fn step(
        &mut self,
        system: &S,
        t: f64,
        h: f64,
        u: &S::Input,
        memory: &mut S::Memory,
        x: &mut [f64],
    ) -> Result<(), StepError<S::Error>> {
        let nq = system.positions().dim();
        let mut q = std::mem::take(&mut self.start);
        q.clear();
        q.extend_from_slice(&x[..nq]);
        let done = self.compose(system, (t, h), u, memory, &mut q, &x[nq..]);
        if done.is_ok() {
            x[..nq].copy_from_slice(&q);
            x[nq..].copy_from_slice(&self.momentum);
        }
        self.start = q;
        done
    }
}

impl Variational {
    /// The steps of order 2 that make one step, from (q, v); `q` is moved, `momentum` becomes the new velocity.
    fn compose<S: Mechanical>(
        &mut self,
        system: &S,
        (t, h): (f64, f64),
        u: &S::Input,
        memory: &mut S::Memory,
        q: &mut [f64],
        v: &[f64],
    ) -> Result<(), StepError<S::Error>> {
        let failed = StepError::RightHandSide;
        system
            .momentum((q, v), memory, &mut self.momentum)
            .map_err(failed)?;
        self.velocity.copy_from_slice(v);
        let gamma = 1.0 / (4.0 - 4.0_f64.cbrt());
        let steps = [gamma, gamma, 1.0 - 4.0 * gamma, gamma, gamma];
        let parts: &[f64] = match self.order {
            Order::Two => &[1.0],
            Order::Four => &steps,
        };
        let mut from = t;
        for part in parts {
            self.advance(system, (from, part * h), u, memory, q)?;
            from += part * h;
        }
        system
            .velocity(q, memory, &mut self.momentum)
            .map_err(failed)
    }
}

#[cfg(test)]
mod tests {
    use super::largest;

    #[test]
    fn no_entry_hides_a_nan() {
        assert_eq!(largest(&[1.0, -3.0, 2.0]), 3.0);
        for x in [
            [f64::NAN, 1.0, 2.0],
            [1.0, f64::NAN, 2.0],
            [1.0, 2.0, f64::NAN],
        ] {
            assert!(largest(&x).is_nan());
        }
    }
}
