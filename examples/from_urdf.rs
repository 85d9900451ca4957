//! A mechanism from a URDF: its equations of motion at one state, and a free motion that keeps its energy.
//!
//! Run it with `cargo run --example from_urdf`, with the path of another URDF if you like.

use std::error::Error;

use integrators::{Ode, Rk4, roll_out};
use lagrange::urdf::{self, Options};
use lagrange::{Dynamics, Mechanics};

fn main() -> Result<(), Box<dyn Error>> {
    let models = concat!(env!("CARGO_MANIFEST_DIR"), "/../../models");
    let path = std::env::args()
        .nth(1)
        .unwrap_or_else(|| format!("{models}/double_pendulum/double_pendulum.urdf"));
    let options = Options {
        source: path.clone(),
        ..Options::default()
    };
    let urdf = urdf::read(&std::fs::read_to_string(&path)?, &options)?;
    for warning in &urdf.warnings {
        eprintln!("warning: {warning}");
    }
    let coordinates = urdf.tree.coordinates().to_vec();
    let robot = Dynamics::new(urdf.tree, coordinates)?;
    for (i, coordinate) in robot.coordinates().iter().enumerate() {
        println!("q[{i}]: {} in {}", coordinate.name, coordinate.unit());
    }

    // M(q) v̇ + C(q, v) v + G(q) = Q
    let n = robot.nv();
    let (q, v) = (vec![0.5; n], vec![1.0; n]);
    println!("M(q){:.5}", robot.mass_matrix(&q)?);
    println!("C(q, v){:.5}", robot.coriolis_matrix(&q, &v)?);
    println!("G(q){:.5}", robot.gravity_force(&q)?);

    // Free motion, Q = 0, for 1 s.
    let times: Vec<f64> = (0..=10).map(|k| 0.1 * f64::from(k)).collect();
    let free = vec![0.0; n];
    let motion = Ode::new(2 * n, |_t, x: &[f64], _u: &(), dx: &mut [f64]| {
        let (q, v) = x.split_at(n);
        dx[..n].copy_from_slice(v);
        dx[n..].copy_from_slice(robot.forward_dynamics(q, v, &free)?.as_slice());
        Ok::<(), lagrange::Error>(())
    });
    let initial = [q, v].concat();
    let states = roll_out(&motion, Rk4::default(), &times, &[(); 10], 100, &initial)?;
    let energy = |x: &[f64]| robot.total_energy(&x[..n], &x[n..]);
    let start = energy(&states[0])?;
    for (t, x) in times.iter().zip(&states) {
        println!(
            "t = {t:.1} s, q = {:.4?}, T + V − start = {:+.1e} J",
            &x[..n],
            energy(x)? - start
        );
    }
    Ok(())
}
