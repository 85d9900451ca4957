//! Values and adjoints of all layers, for many states and several evaluations.

use super::real::Real;
use super::shape::Shape;
use crate::processor::Processor;

/// How many states a panel holds.
pub const PANEL: usize = 32;
/// How many states [`Tape::input_mut`] and its like give at once.
pub const GROUP: usize = 8;

/// One number of [`PANEL`] states.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(128))]
pub(super) struct Row<T>(pub [T; PANEL]);

/// Rows of one layer, `[slot][panel][row]`.
type Rows<T> = Vec<Row<T>>;

/// Room for `slots` evaluations of `columns` states each, with what the reverse pass needs of them.
///
/// States come in groups of [`GROUP`]: group g is the columns 8 g to 8 g + 7. The last group may reach beyond `columns`; those lanes are
/// nobody's: they are set to 0 by the passes, and add nothing to a gradient.
#[derive(Debug, Clone)]
pub struct Tape<T> {
    pub(super) sizes: Vec<usize>,
    columns: usize,
    slots: usize,
    pub(super) panels: usize,
    pub(super) processor: Processor,
    /// y_l of every layer, y_0 the inputs.
    pub(super) values: Vec<Rows<T>>,
    /// ∂/∂y_0 for l = 0, else ∂/∂(W_l y_{l−1} + b_l).
    pub(super) deltas: Vec<Rows<T>>,
    /// Adjoints of the outputs.
    pub(super) seeds: Rows<T>,
}

impl<T: Real> Tape<T> {
    /// All zeros.
    pub fn new(shape: &Shape, columns: usize, slots: usize) -> Tape<T> {
        let panels = columns.div_ceil(PANEL);
        let rows = |&size: &usize| vec![Row([T::default(); PANEL]); slots * panels * size];
        Tape {
            columns,
            slots,
            panels,
            processor: Processor::here(),
            values: shape.sizes().iter().map(rows).collect(),
            deltas: shape.sizes().iter().map(rows).collect(),
            seeds: rows(&shape.outputs()),
            sizes: shape.sizes().to_vec(),
        }
    }

    /// How many states a slot has.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// How many evaluations there is room for.
    pub fn slots(&self) -> usize {
        self.slots
    }

    /// How many groups of states a slot has, the last perhaps not full.
    pub fn groups(&self) -> usize {
        self.columns.div_ceil(GROUP)
    }

    /// Input `row` of the states of `group` in `slot`.
    ///
    /// # Panics
    ///
    /// If there is no such slot, row or group, as for the three methods below.
    pub fn input_mut(&mut self, slot: usize, row: usize, group: usize) -> &mut [T; GROUP] {
        let at = self.place(slot, row, group, self.sizes[0]);
        group_mut(&mut self.values[0][at], group)
    }

    /// Output `row` of the states of `group` in `slot`, as [`Mlp::forward`](super::Mlp::forward) left it.
    pub fn output(&self, slot: usize, row: usize, group: usize) -> &[T; GROUP] {
        let last = self.sizes.len() - 1;
        let at = self.place(slot, row, group, self.sizes[last]);
        group_of(&self.values[last][at], group)
    }

    /// The adjoint of output `row`, ∂J/∂y for some J, of the states of `group` in `slot`.
    pub fn seed_mut(&mut self, slot: usize, row: usize, group: usize) -> &mut [T; GROUP] {
        let last = self.sizes.len() - 1;
        let at = self.place(slot, row, group, self.sizes[last]);
        group_mut(&mut self.seeds[at], group)
    }

    /// The adjoint of input `row`, ∂J/∂x = Σ (∂y/∂x)ᵀ ∂J/∂y, of the states of `group` in `slot`, as
    /// [`Mlp::backward`](super::Mlp::backward) left it.
    pub fn input_gradient(&self, slot: usize, row: usize, group: usize) -> &[T; GROUP] {
        let at = self.place(slot, row, group, self.sizes[0]);
        group_of(&self.deltas[0][at], group)
    }

    /// What layer `layer` puts out in row `row`, 0 the inputs, of the states of `group` in `slot`.
    pub(super) fn value(&self, slot: usize, layer: usize, row: usize, group: usize) -> &[T; GROUP] {
        let at = self.place(slot, row, group, self.sizes[layer]);
        group_of(&self.values[layer][at], group)
    }

    /// The adjoint of the sums of layer `layer`, from 1, in row `row`.
    pub(super) fn delta(&self, slot: usize, layer: usize, row: usize, group: usize) -> &[T; GROUP] {
        let at = self.place(slot, row, group, self.sizes[layer]);
        group_of(&self.deltas[layer][at], group)
    }

    /// Where row `row` of `rows` is in a layer.
    fn place(&self, slot: usize, row: usize, group: usize, rows: usize) -> usize {
        assert!(
            slot < self.slots && row < rows && group < self.groups(),
            "no group {group} of row {row} in slot {slot} of the tape"
        );
        (slot * self.panels + group / (PANEL / GROUP)) * rows + row
    }
}

/// Sets the lanes beyond the first `columns` states of `rows`, a slot of `panels`, to 0.
pub(super) fn clear_padding<T: Real>(rows: &mut [Row<T>], panels: usize, columns: usize) {
    let used = columns % PANEL;
    if used > 0 {
        let last = rows.len() / panels * (panels - 1);
        for row in &mut rows[last..] {
            row.0[used..].fill(T::default());
        }
    }
}

fn group_of<T>(row: &Row<T>, group: usize) -> &[T; GROUP] {
    &row.0.as_chunks().0[group % (PANEL / GROUP)]
}

fn group_mut<T>(row: &mut Row<T>, group: usize) -> &mut [T; GROUP] {
    &mut row.0.as_chunks_mut().0[group % (PANEL / GROUP)]
}
