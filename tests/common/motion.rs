//! Motion without applied forces, Q = 0.

use integrators::Rk4;
use lagrange::{Error, Mechanics, state};
use nalgebra::DVector;

/// Advances x = (q, v) by `steps` steps of `h` with the classical Runge-Kutta method; quaternions are made of length 1 after every step,
/// then `watch` sees the state.
pub fn advance(
    mechanics: &impl Mechanics,
    x: &mut [f64],
    h: f64,
    steps: usize,
    mut watch: impl FnMut(&[f64]),
) -> Result<(), Error> {
    let (nq, nv) = (mechanics.nq(), mechanics.nv());
    let coordinates = mechanics.coordinates();
    let p = mechanics.nominal();
    let mut work = mechanics.workspace();
    let mut a = DVector::zeros(nv);
    let mut rk4 = Rk4::new(nq + nv);
    for k in 0..steps {
        rk4.step(k as f64 * h, h, x, |_t, x, dx| {
            let (q, v) = x.split_at(nq);
            a.fill(0.0);
            mechanics.forward_dynamics_into(q, v, &p, &mut work, &mut a)?;
            state::position_rate_into(coordinates, q, v, &mut dx[..nq]);
            dx[nq..].copy_from_slice(a.as_slice());
            Ok::<(), Error>(())
        })?;
        state::normalize(coordinates, &mut x[..nq]);
        watch(x);
    }
    Ok(())
}
