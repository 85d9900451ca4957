//! The linear equations of a stage, of eight states at once.

use lagrange::LANES;
use pulp::NullaryFnOnce;

use crate::hybrid::Lane;

/// W δ = y − y_b − g f for δ, which takes the place of f in `change`.
pub(super) struct Change<'a> {
    pub sizes: (usize, usize),
    pub g: Lane,
    pub from: &'a [Lane],
    pub y: &'a [Lane],
    pub linear: &'a [Lane],
    pub response: &'a [Lane],
    /// At the linearisation and now.
    pub slopes: (&'a [Lane], &'a [Lane]),
    pub matrix: &'a mut [Lane],
    pub change: &'a mut [Lane],
}

impl NullaryFnOnce for Change<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let (n, nx) = self.sizes;
        let below = nx - n;
        let g = self.g;
        for ((f, y), from) in self.change.iter_mut().zip(self.y).zip(self.from) {
            for (lane, f) in f.iter_mut().enumerate() {
                *f = y[lane] - from[lane] - g[lane] * *f;
            }
        }
        fill(self.sizes, g, self.linear, self.matrix);
        for (j, (then, now)) in self.slopes.0.iter().zip(self.slopes.1).enumerate() {
            for i in 0..n {
                let (w, r) = (&mut self.matrix[i * below + j], &self.response[j * n + i]);
                for lane in 0..LANES {
                    w[lane] -= g[lane] * r[lane] * (now[lane] - then[lane]);
                }
            }
        }
        factorise(self.matrix, below);
        solve(self.matrix, below, self.change);
    }
}

/// The derivatives of a stage, column after column behind that of x.
pub(super) struct Columns<'a> {
    pub sizes: (usize, usize),
    pub g: Lane,
    pub linear: &'a [Lane],
    pub response: &'a [Lane],
    pub matrix: &'a mut [Lane],
    pub from: &'a [Lane],
    pub to: &'a mut [Lane],
}

impl NullaryFnOnce for Columns<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let (n, nx) = self.sizes;
        let below = nx - n;
        let g = self.g;
        fill(self.sizes, g, self.linear, self.matrix);
        factorise(self.matrix, below);
        let columns = self.from.chunks_exact(nx).zip(self.to.chunks_exact_mut(nx));
        let of_theta = self.linear.len() / below - nx;
        for (column, (from, to)) in columns.enumerate().skip(1) {
            let (q, y) = to.split_at_mut(n);
            y.copy_from_slice(&from[n..]);
            for (i, y) in y.iter_mut().enumerate() {
                // Behind the columns of x₀ are those of θ, then those of Q and of ḣ.
                let mut rate = match column.checked_sub(1 + nx) {
                    None => [0.0; LANES],
                    Some(k) if k < of_theta => self.linear[(nx + k) * below + i],
                    Some(k) if k < of_theta + n => match i < n {
                        true => self.response[(k - of_theta) * n + i],
                        false => [0.0; LANES],
                    },
                    Some(k) if k - of_theta == i => [1.0; LANES],
                    Some(_) => [0.0; LANES],
                };
                for (j, s) in from[..n].iter().enumerate() {
                    let by = &self.linear[j * below + i];
                    for lane in 0..LANES {
                        rate[lane] += by[lane] * s[lane];
                    }
                }
                for lane in 0..LANES {
                    y[lane] += g[lane] * rate[lane];
                }
            }
            solve(self.matrix, below, y);
            for ((q, v), from) in q.iter_mut().zip(&*y).zip(from) {
                for lane in 0..LANES {
                    q[lane] = from[lane] + g[lane] * v[lane];
                }
            }
        }
    }
}

/// W = I − g ∂f/∂y − g² ∂f/∂q (∂v/∂y), row after row, of ∂f/∂(q, y), column after column.
#[inline(always)]
fn fill((n, nx): (usize, usize), g: Lane, linear: &[Lane], matrix: &mut [Lane]) {
    let below = nx - n;
    for i in 0..below {
        for j in 0..below {
            let by_y = &linear[(n + j) * below + i];
            let unit = if i == j { 1.0 } else { 0.0 };
            let mut w: Lane = std::array::from_fn(|lane| unit - g[lane] * by_y[lane]);
            if j < n {
                let by_q = &linear[j * below + i];
                for lane in 0..LANES {
                    w[lane] -= g[lane] * g[lane] * by_q[lane];
                }
            }
            matrix[i * below + j] = w;
        }
    }
}

/// L U = W in place. Without pivots: W is I + γh M⁻¹ K with K the slopes of friction, which a scaling of rows and columns makes symmetric
/// and positive, but for what is small with the step and where friction falls with the speed.
#[inline(always)]
fn factorise(w: &mut [Lane], n: usize) {
    for k in 0..n {
        let (above, rows) = w.split_at_mut((k + 1) * n);
        let pivot = &above[k * n..];
        let inverse = pivot[k].map(|p| 1.0 / p);
        for row in rows.chunks_exact_mut(n) {
            let mut factor = row[k];
            for lane in 0..LANES {
                factor[lane] *= inverse[lane];
            }
            row[k] = factor;
            for (to, from) in row[k + 1..].iter_mut().zip(&pivot[k + 1..]) {
                for lane in 0..LANES {
                    to[lane] -= factor[lane] * from[lane];
                }
            }
        }
    }
}

/// x with L U x = b in place.
#[inline(always)]
fn solve(lu: &[Lane], n: usize, x: &mut [Lane]) {
    for i in 0..n {
        let mut sum = x[i];
        for k in 0..i {
            let (l, x) = (&lu[i * n + k], &x[k]);
            for lane in 0..LANES {
                sum[lane] -= l[lane] * x[lane];
            }
        }
        x[i] = sum;
    }
    for i in (0..n).rev() {
        let mut sum = x[i];
        for k in i + 1..n {
            let (u, x) = (&lu[i * n + k], &x[k]);
            for lane in 0..LANES {
                sum[lane] -= u[lane] * x[lane];
            }
        }
        let diagonal = &lu[i * n + i];
        for lane in 0..LANES {
            sum[lane] /= diagonal[lane];
        }
        x[i] = sum;
    }
}
