//! The swinging Atwood machine: a string over two pulleys, a weight at each end, and the lighter one swings. q = (length of the
//! string on its side, m; its angle from hanging, rad). Where the other is three times as heavy, a second quantity stays beside
//! T + V: r² θ̇ (ṙ cos θ/2 − ½ r θ̇ sin θ/2) + g r² sin θ/2 cos² θ/2 (Tufillaro, Am. J. Phys. 54, 1986).
use lagrange::{Dynamics, Error, Lagrangian, Mechanics, Scalar};
use std::array::from_fn;

struct Machine(f64, f64); // the heavy and the light weight, kg
impl Lagrangian for Machine {
    fn dof(&self) -> usize {
        2
    }
    fn kinetic<D: Scalar>(&self, q: &[D], v: &[D]) -> D {
        v[0] * v[0] * (0.5 * (self.0 + self.1)) + (q[0] * v[1]).powi(2) * (0.5 * self.1)
    }
    fn potential<D: Scalar>(&self, q: &[D]) -> D {
        (q[0] * self.0 - q[0] * q[1].cos() * self.1) * 9.81
    }
}
fn main() -> Result<(), Error> {
    let machine = Dynamics::of(Machine(3.0, 1.0));
    let rate = |x: [f64; 4]| {
        (machine.forward_dynamics(&x[..2], &x[2..], &[0.0; 2])).map(|a| [x[2], x[3], a[0], a[1]])
    };
    let (h, mut x) = (1e-3, [1.0, 1.5, 0.0, 0.0]); // x = (r, θ, ṙ, θ̇)
    for k in 0..=4000 {
        let ([r, _, dr, turn], (sin, cos)) = (x, (0.5 * x[1]).sin_cos());
        let second = r * r * (turn * (dr * cos - 0.5 * r * turn * sin) + 9.81 * sin * cos * cos);
        let (t, energy) = (h * k as f64, machine.total_energy(&x[..2], &x[2..])?);
        if k % 500 == 0 {
            println!("{t:.1} s: x = {x:8.4?}, T + V = {energy:.8} J, second = {second:.8}");
        }
        let k1 = rate(x)?; // a step of the classical Runge-Kutta method
        let k2 = rate(from_fn(|i| x[i] + 0.5 * h * k1[i]))?;
        let k3 = rate(from_fn(|i| x[i] + 0.5 * h * k2[i]))?;
        let k4 = rate(from_fn(|i| x[i] + h * k3[i]))?;
        x = from_fn(|i| x[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]));
    }
    Ok(())
}
