//! The forward pass: y = φ(W x + b), panel by panel.

use pulp::{Simd, WithSimd};

use super::mlp::Mlp;
use super::real::{Real, row, row_mut, vectors};
use super::shape::{Activation, Layer, Shape};
use super::tanh::tanh_of;
use super::tape::{PANEL, Row, Tape, clear_padding};

/// Vectors of a row that a tile of registers takes at once.
pub(super) const WIDTH: usize = 2;

impl<T: Real> Mlp<T> {
    /// Values of all layers in `slot`, from the inputs there.
    ///
    /// # Panics
    ///
    /// If the tape is of another shape or has no such slot.
    pub fn forward(&self, tape: &mut Tape<T>, slot: usize) {
        check(self.shape(), tape, slot);
        let processor = tape.processor;
        processor.run(Forward {
            mlp: self,
            tape,
            slot,
        });
    }
}

/// Panics unless `tape` was made for `shape` and has `slot`.
pub(super) fn check<T: Real>(shape: &Shape, tape: &Tape<T>, slot: usize) {
    assert!(
        tape.sizes == shape.sizes() && slot < tape.slots(),
        "the tape is of another shape than the network, or has no slot {slot}"
    );
}

/// [`Mlp::forward`].
pub(super) struct Forward<'a, T> {
    pub mlp: &'a Mlp<T>,
    pub tape: &'a mut Tape<T>,
    pub slot: usize,
}

impl<T: Real> WithSimd for Forward<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, s: S) {
        let Forward { mlp, tape, slot } = self;
        let (panels, columns) = (tape.panels, tape.columns());
        let first = slot * panels;
        let inputs = tape.sizes[0];
        clear_padding(
            &mut tape.values[0][first * inputs..][..panels * inputs],
            panels,
            columns,
        );
        for panel in 0..panels {
            let chunks = chunks::<T, S>(columns - panel * PANEL);
            for (index, layer) in mlp.shape().layers().enumerate() {
                let (before, after) = tape.values.split_at_mut(index + 1);
                let x = &before[index][(first + panel) * layer.inputs..][..layer.inputs];
                let y = &mut after[0][(first + panel) * layer.outputs..][..layer.outputs];
                evaluate(s, mlp.parameters(), &layer, x, y, chunks);
            }
        }
    }
}

/// How many chunks of [`WIDTH`] vectors the first `columns` states of a panel fill.
#[inline(always)]
pub(super) fn chunks<T: Real, S: Simd>(columns: usize) -> usize {
    let all = vectors::<T, S>() / WIDTH;
    all.min(columns.div_ceil(WIDTH * T::lanes::<S>()))
}

/// Chunk `chunk` of a row.
#[inline(always)]
pub(super) fn chunk_of<T: Real, S: Simd>(of: &Row<T>, chunk: usize) -> &[T::Vector<S>; WIDTH] {
    &row::<T, S>(of).as_chunks().0[chunk]
}

/// Chunk `chunk` of a row.
#[inline(always)]
pub(super) fn chunk_of_mut<T: Real, S: Simd>(
    of: &mut Row<T>,
    chunk: usize,
) -> &mut [T::Vector<S>; WIDTH] {
    &mut row_mut::<T, S>(of).as_chunks_mut().0[chunk]
}

/// One layer of one panel.
#[inline(always)]
fn evaluate<T: Real, S: Simd>(
    s: S,
    parameters: &[T],
    layer: &Layer,
    x: &[Row<T>],
    y: &mut [Row<T>],
    chunks: usize,
) {
    let relu = layer.activation == Activation::Relu;
    let weights = &parameters[layer.weight_range()];
    let biases = &parameters[layer.bias_range()];
    let mut from = 0;
    macro_rules! tiles {
        ($n:literal) => {
            while layer.outputs - from >= $n {
                let weights = &weights[from * layer.inputs..][..$n * layer.inputs];
                tile::<T, S, $n>(s, weights, &biases[from..], x, &mut y[from..], chunks, relu);
                from += $n;
            }
        };
    }
    if S::REGISTER_COUNT >= 32 {
        tiles!(10);
    }
    tiles!(5);
    tiles!(2);
    tiles!(1);
    if layer.activation == Activation::Tanh {
        for y in y {
            for y in &mut row_mut::<T, S>(y)[..chunks * WIDTH] {
                *y = tanh_of::<T, S>(s, *y);
            }
        }
    }
}

/// N outputs.
#[inline(always)]
fn tile<T: Real, S: Simd, const N: usize>(
    s: S,
    weights: &[T],
    biases: &[T],
    x: &[Row<T>],
    y: &mut [Row<T>],
    chunks: usize,
    relu: bool,
) {
    let (Some(biases), Some(y)) = (biases.first_chunk::<N>(), y.first_chunk_mut::<N>()) else {
        return;
    };
    let inputs = x.len();
    let weights: [&[T]; N] = std::array::from_fn(|n| &weights[n * inputs..][..inputs]);
    for chunk in 0..chunks {
        let mut sums = [[T::splat(s, T::default()); WIDTH]; N];
        for n in 0..N {
            sums[n] = [T::splat(s, biases[n]); WIDTH];
        }
        for (k, x) in x.iter().enumerate() {
            let x = chunk_of::<T, S>(x, chunk);
            for n in 0..N {
                let w = T::splat(s, weights[n][k]);
                for v in 0..WIDTH {
                    sums[n][v] = T::mul_add(s, w, x[v], sums[n][v]);
                }
            }
        }
        if relu {
            for sum in sums.as_flattened_mut() {
                *sum = T::positive_part(s, *sum);
            }
        }
        for n in 0..N {
            *chunk_of_mut::<T, S>(&mut y[n], chunk) = sums[n];
        }
    }
}
