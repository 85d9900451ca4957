//! Motion without applied forces, Q = 0.

use integrators::Rk4;
use lagrange::{Error, Mechanics};
use nalgebra::DVector;

/// Advances x = (q, v) by `steps` steps of `h` with the classical Runge-Kutta method; `watch` sees the state after every step.
pub fn advance(
    mechanics: &impl Mechanics,
    x: &mut [f64],
    h: f64,
    steps: usize,
    mut watch: impl FnMut(&[f64]),
) -> Result<(), Error> {
    let n = mechanics.nv();
    let p = mechanics.nominal();
    let mut work = mechanics.workspace();
    let mut a = DVector::zeros(n);
    let mut rk4 = Rk4::new(2 * n);
    for k in 0..steps {
        rk4.step(k as f64 * h, h, x, |_t, x, dx| {
            let (q, v) = x.split_at(n);
            a.fill(0.0);
            mechanics.forward_dynamics_into(q, v, &p, &mut work, &mut a)?;
            dx[..n].copy_from_slice(v);
            dx[n..].copy_from_slice(a.as_slice());
            Ok::<(), Error>(())
        })?;
        watch(x);
    }
    Ok(())
}
