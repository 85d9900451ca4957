//! Drive laws that change the input at each instant by itself.

use super::{DriveLaw, Grid, Signal};

/// A law u → g(u; p) with one parameter.
pub trait PointwiseLaw: Send + Sync + 'static {
    /// g, ∂g/∂u and ∂g/∂p.
    fn at(&self, u: f64, p: f64) -> (f64, f64, f64);
}

/// Makes a [`DriveLaw`] of a [`PointwiseLaw`].
pub struct Pointwise<L>(pub L);

impl<L: PointwiseLaw> DriveLaw for Pointwise<L> {
    fn pass(&self, _grid: &Grid, p: &[f64], first: Option<usize>, signal: &mut Signal) {
        let mut own = Vec::with_capacity(if first.is_some() {
            signal.value.len()
        } else {
            0
        });
        for (step, u) in signal.value.iter_mut().enumerate() {
            let (value, by_u, by_p) = self.0.at(*u, p[0]);
            *u = value;
            for (_, derivative) in &mut signal.by_parameter {
                derivative[step] *= by_u;
            }
            if first.is_some() {
                own.push(by_p);
            }
        }
        if let Some(index) = first {
            signal.by_parameter.push((index, own));
        }
    }
}
