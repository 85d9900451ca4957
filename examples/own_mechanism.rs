//! A mechanism of your own: write down its energies in Rust, the equations of motion follow.
//! Here a mass on a spring that swings: r is the length of the spring (m), theta its angle from hanging (rad).
//! Run it with `cargo run --example own_mechanism`.

use std::error::Error;

use integrators::{Ode, Rk4, roll_out};
use lagrange::{Dynamics, Lagrangian, Mechanics, Scalar};

struct SwingingSpring {
    mass: f64,      // kg
    stiffness: f64, // N/m
    rest: f64,      // m
}

impl Lagrangian for SwingingSpring {
    fn dof(&self) -> usize {
        2
    }
    /// T = ½ m (ṙ² + r² θ̇²)
    fn kinetic<D: Scalar>(&self, q: &[D], v: &[D]) -> D {
        (v[0] * v[0] + q[0] * q[0] * v[1] * v[1]) * (0.5 * self.mass)
    }
    /// V = ½ k (r − r₀)² − m g r cos θ
    fn potential<D: Scalar>(&self, q: &[D]) -> D {
        let stretch = q[0] - self.rest;
        stretch * stretch * (0.5 * self.stiffness) - q[0] * q[1].cos() * (9.81 * self.mass)
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let spring = Dynamics::of(SwingingSpring {
        mass: 0.5,
        stiffness: 40.0,
        rest: 0.3,
    });

    // x = (r, theta, ṙ, θ̇); 2 s in samples of 0.1 s, 50 steps each, with friction −0.02 N·m·s/rad · θ̇.
    let times: Vec<f64> = (0..=20).map(|k| 0.1 * f64::from(k)).collect();
    let motion = Ode::new(4, |_t, x: &[f64], _u: &(), dx: &mut [f64]| {
        let (q, v) = x.split_at(2);
        let force = [0.0, -0.02 * v[1]];
        dx[..2].copy_from_slice(v);
        dx[2..].copy_from_slice(spring.forward_dynamics(q, v, &force)?.as_slice());
        Ok::<(), lagrange::Error>(())
    });
    let start = [0.42, 0.8, 0.0, 0.0];
    let states = roll_out(&motion, Rk4::default(), &times, &[(); 20], 50, &start)?;

    println!("   t (s)    r (m)  theta (rad)  T + V (J)");
    for (t, x) in times.iter().zip(&states) {
        let (r, theta, energy) = (x[0], x[1], spring.total_energy(&x[..2], &x[2..])?);
        println!("{t:8.1} {r:8.4} {theta:12.4} {energy:10.5}");
    }
    Ok(())
}
