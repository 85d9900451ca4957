//! Where the entries of matrices go, one by one.

use super::dispatch::Width;
use super::plan::Plan;
use crate::Scalar;
use crate::lanes::{LANES, Lanes, Single};

/// Takes what the algorithms find; what is not overridden is not wanted. (No closures: those would not be compiled for the
/// processor at hand.)
pub trait Sink<D: Scalar> {
    /// Adds to M, by indices in v.
    #[inline(always)]
    fn mass(&mut self, _row: usize, _column: usize, _entry: D) {}
    /// Adds to C, by indices in v.
    #[inline(always)]
    fn coriolis(&mut self, _row: usize, _column: usize, _entry: D) {}
    /// Adds to G, by index in v.
    #[inline(always)]
    fn gravity(&mut self, _row: usize, _entry: D) {}
    /// Adds to ∂Q/∂q, by degrees of freedom.
    #[inline(always)]
    fn by_q(&mut self, _row: usize, _column: usize, _entry: D) {}
    /// Adds to ∂Q/∂v, by degrees of freedom.
    #[inline(always)]
    fn by_v(&mut self, _row: usize, _column: usize, _entry: D) {}
}

/// A matrix (or, with one column, a vector), column after column; entries between joints that share no body stay 0.
pub struct Columns<'a, T, const F: bool> {
    entries: &'a mut [T],
    rows: usize,
    /// Whether each entry comes once: no joint follows another.
    once: bool,
}

impl<'a, T: Width, const F: bool> Columns<'a, T, F> {
    #[inline(always)]
    pub fn new(plan: &Plan, entries: &'a mut [T]) -> Self {
        entries.fill(T::default());
        Columns {
            entries,
            rows: plan.nv,
            once: plan.independent,
        }
    }

    /// A square matrix. Of eight states, only what stays 0 is written beforehand.
    #[inline(always)]
    pub fn square(plan: &Plan, entries: &'a mut [T]) -> Self {
        if !(T::IS_EIGHT && plan.independent) {
            return Self::new(plan, entries);
        }
        for (k, dof) in plan.dofs.iter().enumerate() {
            for other in &plan.dofs[..k] {
                if other.end <= k {
                    entries[dof.v * plan.nv + other.v] = T::default();
                    entries[other.v * plan.nv + dof.v] = T::default();
                }
            }
        }
        Columns {
            entries,
            rows: plan.nv,
            once: true,
        }
    }

    #[inline(always)]
    fn add(&mut self, row: usize, column: usize, entry: T::Number<F>) {
        let to = &mut self.entries[column * self.rows + row];
        if self.once {
            *to = T::drop(entry);
        } else {
            *to = T::drop(to.lift() + entry);
        }
    }
}

/// M.
pub struct Mass<'a, T, const F: bool>(pub Columns<'a, T, F>);

impl<T: Width, const F: bool> Sink<T::Number<F>> for Mass<'_, T, F> {
    #[inline(always)]
    fn mass(&mut self, row: usize, column: usize, entry: T::Number<F>) {
        self.0.add(row, column, entry);
    }
}

/// C.
pub struct Coriolis<'a, T, const F: bool>(pub Columns<'a, T, F>);

impl<T: Width, const F: bool> Sink<T::Number<F>> for Coriolis<'_, T, F> {
    #[inline(always)]
    fn coriolis(&mut self, row: usize, column: usize, entry: T::Number<F>) {
        self.0.add(row, column, entry);
    }
}

/// M, C and G.
pub struct Terms<'a, T, const F: bool> {
    pub mass: Columns<'a, T, F>,
    pub coriolis: Columns<'a, T, F>,
    pub gravity: Columns<'a, T, F>,
}

impl<T: Width, const F: bool> Sink<T::Number<F>> for Terms<'_, T, F> {
    #[inline(always)]
    fn mass(&mut self, row: usize, column: usize, entry: T::Number<F>) {
        self.mass.add(row, column, entry);
    }
    #[inline(always)]
    fn coriolis(&mut self, row: usize, column: usize, entry: T::Number<F>) {
        self.coriolis.add(row, column, entry);
    }
    #[inline(always)]
    fn gravity(&mut self, row: usize, entry: T::Number<F>) {
        self.gravity.add(row, 0, entry);
    }
}

/// ∂Q/∂q and ∂Q/∂v.
pub struct Derivatives<'a, T, const F: bool> {
    pub plan: &'a Plan,
    pub by_q: Columns<'a, T, F>,
    pub by_v: Columns<'a, T, F>,
}

impl<T: Width, const F: bool> Sink<T::Number<F>> for Derivatives<'_, T, F> {
    #[inline(always)]
    fn by_q(&mut self, row: usize, column: usize, entry: T::Number<F>) {
        let dofs = &self.plan.dofs;
        self.by_q.add(dofs[row].v, dofs[column].v, entry);
    }
    #[inline(always)]
    fn by_v(&mut self, row: usize, column: usize, entry: T::Number<F>) {
        let dofs = &self.plan.dofs;
        self.by_v.add(dofs[row].v, dofs[column].v, entry);
    }
}

/// −∂Q/∂q, −∂Q/∂v and 1 side by side, row after row in the order of the degrees of freedom, eight numbers together.
pub struct Sides<'a, const F: bool> {
    rows: &'a mut [Lanes<F>],
    width: usize,
    count: usize,
}

impl<'a, const F: bool> Sides<'a, F> {
    /// Of a row.
    pub fn width(plan: &Plan) -> usize {
        (3 * plan.dofs.len()).div_ceil(LANES)
    }

    #[inline(always)]
    pub fn new(plan: &Plan, rows: &'a mut [Lanes<F>]) -> Self {
        rows.fill(Lanes::constant(0.0));
        let mut sides = Sides {
            rows,
            width: Self::width(plan),
            count: plan.dofs.len(),
        };
        for k in 0..sides.count {
            *sides.at(k, 2 * sides.count + k) = 1.0;
        }
        sides
    }

    #[inline(always)]
    fn at(&mut self, row: usize, column: usize) -> &mut f64 {
        &mut self.rows[row * self.width + column / LANES].0[column % LANES]
    }
}

impl<const F: bool> Sink<Single<F>> for Sides<'_, F> {
    #[inline(always)]
    fn by_q(&mut self, row: usize, column: usize, entry: Single<F>) {
        *self.at(row, column) = -entry.0;
    }
    #[inline(always)]
    fn by_v(&mut self, row: usize, column: usize, entry: Single<F>) {
        *self.at(row, self.count + column) = -entry.0;
    }
}

/// [`Sides`] of eight states: a row is 3 n numbers, and each of them eight.
pub struct Wide<'a, const F: bool> {
    rows: &'a mut [Lanes<F>],
    count: usize,
}

impl<'a, const F: bool> Wide<'a, F> {
    #[inline(always)]
    pub fn new(plan: &Plan, rows: &'a mut [Lanes<F>]) -> Self {
        rows.fill(Lanes::constant(0.0));
        let count = plan.dofs.len();
        for k in 0..count {
            rows[k * 3 * count + 2 * count + k] = Lanes::constant(1.0);
        }
        Wide { rows, count }
    }
}

impl<const F: bool> Sink<Lanes<F>> for Wide<'_, F> {
    #[inline(always)]
    fn by_q(&mut self, row: usize, column: usize, entry: Lanes<F>) {
        self.rows[row * 3 * self.count + column] = -entry;
    }
    #[inline(always)]
    fn by_v(&mut self, row: usize, column: usize, entry: Lanes<F>) {
        self.rows[(row * 3 + 1) * self.count + column] = -entry;
    }
}
