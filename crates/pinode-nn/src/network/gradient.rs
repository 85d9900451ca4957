//! The gradient in the parameters: dW_l += Σ δ_l y_{l−1}ᵀ, db_l += Σ δ_l, over states and slots.

use std::ops::Range;

use pulp::{Simd, WithSimd};

use super::kernel::check;
use super::mlp::Mlp;
use super::real::{Real, row, vectors};
use super::tape::{GROUP, Row, Tape};

/// Bytes of values and adjoints that are gone through together: every tile reads them, so they have to stay in the second cache.
const BLOCK: usize = 512 * 1024;
/// Fewer panels are not gone through together: adding up the lanes at the end would take too much of the time.
const LEAST: usize = 16;

impl<T: Real> Mlp<T> {
    /// Adds ∂J/∂parameters of all states of `slots` to `gradient`, in the order of the parameters; after [`backward`](Self::backward).
    ///
    /// # Panics
    ///
    /// If the tape is of another shape or has no such slots, or `gradient` is not as long as the parameters.
    pub fn add_gradient(&self, tape: &Tape<T>, slots: Range<usize>, gradient: &mut [T]) {
        assert_eq!(gradient.len(), self.parameters().len());
        if slots.is_empty() {
            return;
        }
        check(self.shape(), tape, slots.end - 1);
        tape.processor.run(AddGradient {
            mlp: self,
            tape,
            slots,
            gradient,
        });
    }
}

impl<T: Real> Mlp<T> {
    /// ∂J/∂parameters of each state of `group` in `slot` by itself, parameter after parameter to `each`; after [`backward`](Self::backward).
    ///
    /// # Panics
    ///
    /// If the tape is of another shape or has no such slot or group.
    pub fn each_gradient(
        &self,
        tape: &Tape<T>,
        slot: usize,
        group: usize,
        mut each: impl FnMut(usize, &[T; GROUP]),
    ) {
        check(self.shape(), tape, slot);
        for (index, layer) in self.shape().layers().enumerate() {
            for output in 0..layer.outputs {
                let delta = tape.delta(slot, index + 1, output, group);
                for input in 0..layer.inputs {
                    let x = tape.value(slot, index, input, group);
                    let both =
                        std::array::from_fn(|k| T::from_f64(delta[k].to_f64() * x[k].to_f64()));
                    each(layer.weights + output * layer.inputs + input, &both);
                }
                each(layer.biases + output, delta);
            }
        }
    }
}

/// [`Mlp::add_gradient`].
pub(super) struct AddGradient<'a, T> {
    pub mlp: &'a Mlp<T>,
    pub tape: &'a Tape<T>,
    pub slots: Range<usize>,
    pub gradient: &'a mut [T],
}

impl<T: Real> WithSimd for AddGradient<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, s: S) {
        let AddGradient {
            mlp,
            tape,
            slots,
            gradient,
        } = self;
        let (start, end) = (slots.start * tape.panels, slots.end * tape.panels);
        for (index, layer) in mlp.shape().layers().enumerate() {
            let x = &tape.values[index][start * layer.inputs..end * layer.inputs];
            let delta = &tape.deltas[index + 1][start * layer.outputs..end * layer.outputs];
            let block = (BLOCK / size_of::<Row<T>>() / (layer.inputs + layer.outputs)).max(LEAST);
            let delta = delta.chunks(block * layer.outputs);
            for (x, delta) in x.chunks(block * layer.inputs).zip(delta) {
                let x = Panels {
                    rows: x,
                    each: layer.inputs,
                };
                let delta = Panels {
                    rows: delta,
                    each: layer.outputs,
                };
                weights(s, delta, x, &mut gradient[layer.weight_range()]);
                biases(s, delta, &mut gradient[layer.bias_range()]);
            }
        }
    }
}

/// Panels of `each` rows.
#[derive(Clone, Copy)]
struct Panels<'a, T> {
    rows: &'a [Row<T>],
    each: usize,
}

/// dW of one layer.
#[inline(always)]
fn weights<T: Real, S: Simd>(s: S, delta: Panels<'_, T>, x: Panels<'_, T>, gradient: &mut [T]) {
    let mut o = 0;
    macro_rules! columns {
        ($rows:literal, $columns:literal, $i:ident) => {
            while x.each - $i >= $columns {
                tile::<T, S, $rows, $columns>(s, delta, o, x, $i, gradient);
                $i += $columns;
            }
        };
    }
    macro_rules! rows {
        ($rows:literal) => {
            while delta.each - o >= $rows {
                let mut i = 0;
                if S::REGISTER_COUNT >= 32 {
                    columns!($rows, 5, i);
                }
                columns!($rows, 3, i);
                columns!($rows, 1, i);
                o += $rows;
            }
        };
    }
    if S::REGISTER_COUNT >= 32 {
        rows!(5);
    }
    rows!(3);
    rows!(1);
}

/// dW of O outputs and I inputs, from `o` and `i` on.
#[inline(always)]
fn tile<T: Real, S: Simd, const O: usize, const I: usize>(
    s: S,
    delta: Panels<'_, T>,
    o: usize,
    x: Panels<'_, T>,
    i: usize,
    gradient: &mut [T],
) {
    let mut sums = [[T::splat(s, T::default()); I]; O];
    let inputs = x.each;
    let panels = delta
        .rows
        .chunks_exact(delta.each)
        .zip(x.rows.chunks_exact(x.each));
    for (delta, x) in panels {
        let (delta, x) = (&delta[o..o + O], &x[i..i + I]);
        for v in 0..vectors::<T, S>() {
            let x: [T::Vector<S>; I] = std::array::from_fn(|i| row::<T, S>(&x[i])[v]);
            for o in 0..O {
                let delta = row::<T, S>(&delta[o])[v];
                for i in 0..I {
                    sums[o][i] = T::mul_add(s, delta, x[i], sums[o][i]);
                }
            }
        }
    }
    for (o, sums) in (o..).zip(&sums) {
        let gradient = &mut gradient[o * inputs + i..][..I];
        for (to, sum) in gradient.iter_mut().zip(sums) {
            *to = T::sum(s, *sum, *to);
        }
    }
}

/// db of one layer.
#[inline(always)]
fn biases<T: Real, S: Simd>(s: S, delta: Panels<'_, T>, gradient: &mut [T]) {
    let mut o = 0;
    macro_rules! rows {
        ($rows:literal) => {
            while delta.each - o >= $rows {
                let mut sums = [T::splat(s, T::default()); $rows];
                for delta in delta.rows.chunks_exact(delta.each) {
                    let delta = &delta[o..o + $rows];
                    for v in 0..vectors::<T, S>() {
                        for (sum, delta) in sums.iter_mut().zip(delta) {
                            *sum = T::add(s, *sum, row::<T, S>(delta)[v]);
                        }
                    }
                }
                for (to, sum) in gradient[o..].iter_mut().zip(sums) {
                    *to = T::sum(s, sum, *to);
                }
                o += $rows;
            }
        };
    }
    rows!(10);
    rows!(1);
}
