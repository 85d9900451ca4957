//! Linear algebra of eight states at once: small dense systems, lane k of every entry for state k.
//!
//! Matrices are stored column after column.

use crate::lanes::{LANES, Lanes};
use crate::processor::{Processor, Task};
use crate::tree::LEAST_PIVOT;
use crate::{Scalar, trace};

/// Memory of calls for eight states that are not made joint by joint; grows when it is first asked for.
#[derive(Debug, Clone)]
pub(crate) struct Eight {
    pub registers: trace::LaneRegisters,
    /// That of M.
    pub factor: LaneFactor,
    pub force: Vec<[f64; LANES]>,
    /// Derivatives of which gradients are products.
    pub derivatives: Vec<[f64; LANES]>,
}

impl Default for Eight {
    fn default() -> Self {
        Eight {
            registers: trace::LaneRegisters::default(),
            factor: LaneFactor::new(0),
            force: Vec::new(),
            derivatives: Vec::new(),
        }
    }
}

impl Eight {
    /// Room for M and the bias force.
    pub fn grow(&mut self, nv: usize) {
        self.factor.n = nv;
        self.factor.entries.resize(nv * nv, [0.0; LANES]);
        self.force.resize(nv, [0.0; LANES]);
    }
}

/// L D Lᵀ of eight symmetric positive definite matrices, in place of them: lane k of every entry is that of matrix k.
///
/// ```
/// use lagrange::{LANES, LaneFactor};
///
/// // M = [2, 1; 1, 1 + k] for k = 0 … 7, and x with M x = (3, 2 + k).
/// let k = std::array::from_fn(|k| k as f64);
/// let mut factor = LaneFactor::new(2);
/// let entries = [[2.0; LANES], [1.0; LANES], [1.0; LANES], k.map(|k| 1.0 + k)];
/// factor.entries_mut().copy_from_slice(&entries);
/// factor.factorise();
/// let mut x = [[3.0; LANES], k.map(|k| 2.0 + k)];
/// factor.solve(&mut x);
/// assert!(x.as_flattened().iter().all(|x| (x - 1.0).abs() < 1e-14));
/// ```
#[derive(Debug, Clone)]
pub struct LaneFactor {
    pub(crate) processor: Processor,
    n: usize,
    /// The matrices, then their factors.
    pub(crate) entries: Vec<[f64; LANES]>,
}

impl LaneFactor {
    /// For matrices of `n` rows; zeros.
    pub fn new(n: usize) -> Self {
        LaneFactor {
            processor: Processor::here(),
            n,
            entries: vec![[0.0; LANES]; n * n],
        }
    }

    /// The matrices, column after column, both triangles: to be written before [`factorise`](Self::factorise).
    pub fn entries_mut(&mut self) -> &mut [[f64; LANES]] {
        &mut self.entries
    }

    /// The factors, in place; NaN on the diagonal in the lanes in which a matrix has no inverse.
    pub fn factorise(&mut self) {
        let (n, mass) = (self.n, &mut self.entries);
        self.processor.run(Factorise { n, mass });
    }

    /// The inverse times each column, in place, after [`factorise`](Self::factorise).
    pub fn solve(&self, columns: &mut [[f64; LANES]]) {
        let (n, factor) = (self.n, &self.entries);
        self.processor.run(Solve { n, factor, columns });
    }
}

#[inline(always)]
fn at<const F: bool>(a: &[[f64; LANES]], index: usize) -> Lanes<F> {
    Lanes(a[index])
}

/// A = L D Lᵀ in place, A symmetric with both triangles filled: D⁻¹ on the diagonal, L D below it and Lᵀ above.
struct Factorise<'a> {
    n: usize,
    mass: &'a mut [[f64; LANES]],
}

impl Task for Factorise<'_> {
    #[inline(always)]
    fn run<const F: bool>(self) {
        let Factorise { n, mass: a } = self;
        for j in 0..n {
            for i in j..n {
                let mut sum = at::<F>(a, j * n + i);
                for k in 0..j {
                    sum = (-at::<F>(a, k * n + i)).times_plus(at(a, j * n + k), sum);
                }
                if i == j {
                    let whole = at::<F>(a, j * n + j);
                    // An infinite pivot has no inverse either.
                    let inverse = sum.inverse_above(whole * LEAST_PIVOT) + sum * 0.0;
                    a[j * n + j] = inverse.0;
                } else {
                    a[j * n + i] = sum.0;
                    a[i * n + j] = (sum * at(a, j * n + j)).0;
                }
            }
        }
    }
}

/// A X = B in place, with what [`Factorise`] has made of A.
struct Solve<'a> {
    n: usize,
    factor: &'a [[f64; LANES]],
    columns: &'a mut [[f64; LANES]],
}

impl Task for Solve<'_> {
    #[inline(always)]
    fn run<const F: bool>(self) {
        let Solve { n, factor, columns } = self;
        for x in columns.chunks_exact_mut(n.max(1)) {
            for i in 0..n {
                let mut sum = at::<F>(x, i);
                for k in 0..i {
                    sum = (-at::<F>(factor, i * n + k)).times_plus(at(x, k), sum);
                }
                x[i] = sum.0;
            }
            for i in (0..n).rev() {
                let mut sum = at::<F>(x, i) * at(factor, i * n + i);
                for k in i + 1..n {
                    sum = (-at::<F>(factor, k * n + i)).times_plus(at(x, k), sum);
                }
                x[i] = sum.0;
            }
        }
    }
}

/// wᵀ A, into `to`.
pub(crate) fn product(
    processor: Processor,
    weight: &[[f64; LANES]],
    by: &[[f64; LANES]],
    to: &mut [[f64; LANES]],
) {
    processor.run(Product { weight, by, to });
}

struct Product<'a> {
    weight: &'a [[f64; LANES]],
    by: &'a [[f64; LANES]],
    to: &'a mut [[f64; LANES]],
}

impl Task for Product<'_> {
    #[inline(always)]
    fn run<const F: bool>(self) {
        let Product { weight, by, to } = self;
        let n = weight.len();
        for (j, to) in to.iter_mut().enumerate() {
            let mut sum = Lanes::<F>([0.0; LANES]);
            for i in 0..n {
                sum = at::<F>(by, j * n + i).times_plus(at(weight, i), sum);
            }
            *to = sum.0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Entry (i, j) of M in lane k.
    fn mass(i: usize, j: usize, k: usize) -> f64 {
        let off = 1.0 / (1.0 + (i + j) as f64 + k as f64);
        if i == j { 2.0 + off } else { off }
    }

    fn factor(n: usize) -> LaneFactor {
        let mut factor = LaneFactor::new(n);
        for j in 0..n {
            for i in 0..n {
                factor.entries[j * n + i] = std::array::from_fn(|k| mass(i, j, k));
            }
        }
        factor
    }

    #[test]
    fn the_factor_of_eight_matrices_solves_for_two_columns() {
        let n = 5;
        let mut factor = factor(n);
        let b: Vec<[f64; LANES]> = (0..2 * n)
            .map(|i| std::array::from_fn(|k| (i as f64 - 3.0) * (k as f64 + 0.5)))
            .collect();
        let mut x = b.clone();
        factor.factorise();
        factor.solve(&mut x);
        for c in 0..2 {
            for i in 0..n {
                for k in 0..LANES {
                    let row: f64 = (0..n).map(|j| mass(i, j, k) * x[c * n + j][k]).sum();
                    assert!((row - b[c * n + i][k]).abs() < 1e-13 * 40.0);
                }
            }
        }
    }

    #[test]
    fn only_the_lanes_without_an_inverse_are_no_numbers() {
        let n = 3;
        let mut factor = factor(n);
        // Rows 1 and 2 alike in lane 2, an infinite mass in lane 4, a negative one in lane 6.
        for (i, j) in [(1, 1), (1, 2), (2, 1), (2, 2)] {
            factor.entries[j * n + i][2] = 2.0;
        }
        factor.entries[2][2] = factor.entries[1][2];
        factor.entries[2 * n][2] = factor.entries[n][2];
        factor.entries[n + 1][4] = f64::INFINITY;
        factor.entries[0][6] = -1.0;
        let mut x = vec![[1.0; LANES]; n];
        factor.factorise();
        factor.solve(&mut x);
        for k in 0..LANES {
            let finite = x.iter().all(|x| x[k].is_finite());
            assert_eq!(finite, ![2, 4, 6].contains(&k), "lane {k}: {x:?}");
        }
    }
}
