//! The reverse pass: δ_l = φ_l′ · W_{l+1}ᵀ δ_{l+1}, panel by panel.

use pulp::{Simd, WithSimd};

use super::kernel::{WIDTH, check, chunk_of, chunk_of_mut, chunks};
use super::mlp::Mlp;
use super::real::Real;
use super::shape::Activation;
use super::tape::{PANEL, Row, Tape, clear_padding};

impl<T: Real> Mlp<T> {
    /// Adjoints of all layers in `slot`, the inputs among them, from the seeds there; after [`forward`](Self::forward) with the same
    /// parameters.
    ///
    /// # Panics
    ///
    /// If the tape is of another shape or has no such slot.
    pub fn backward(&self, tape: &mut Tape<T>, slot: usize) {
        check(self.shape(), tape, slot);
        let processor = tape.processor;
        processor.run(Backward {
            mlp: self,
            tape,
            slot,
        });
    }
}

/// [`Mlp::backward`].
pub(super) struct Backward<'a, T> {
    pub mlp: &'a Mlp<T>,
    pub tape: &'a mut Tape<T>,
    pub slot: usize,
}

impl<T: Real> WithSimd for Backward<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, s: S) {
        let Backward { mlp, tape, slot } = self;
        let (panels, columns) = (tape.panels, tape.columns());
        let last = tape.sizes.len() - 1;
        let outputs = tape.sizes[last];
        let at = slot * panels * outputs;
        let seeds = &mut tape.seeds[at..][..panels * outputs];
        clear_padding(seeds, panels, columns);
        for panel in 0..panels {
            let chunks = chunks::<T, S>(columns - panel * PANEL);
            let at = (slot * panels + panel) * outputs;
            let seeds = &tape.seeds[at..][..outputs];
            let values = &tape.values[last][at..][..outputs];
            let deltas = &mut tape.deltas[last][at..][..outputs];
            for ((delta, seed), value) in deltas.iter_mut().zip(seeds).zip(values) {
                for chunk in 0..chunks {
                    let (seed, y) = (
                        chunk_of::<T, S>(seed, chunk),
                        chunk_of::<T, S>(value, chunk),
                    );
                    let delta = chunk_of_mut::<T, S>(delta, chunk);
                    for v in 0..WIDTH {
                        delta[v] = times_slope::<T, S>(s, mlp.shape().output(), y[v], seed[v]);
                    }
                }
            }
        }
        for panel in 0..panels {
            let chunks = chunks::<T, S>(columns - panel * PANEL);
            let panel = slot * panels + panel;
            let mut above = last;
            let mut end = mlp.parameters().len();
            while above > 0 {
                let (inputs, outputs) = (tape.sizes[above - 1], tape.sizes[above]);
                let (lower, upper) = tape.deltas.split_at_mut(above);
                let delta = &upper[0][panel * outputs..][..outputs];
                let below = &mut lower[above - 1][panel * inputs..][..inputs];
                let y = &tape.values[above - 1][panel * inputs..][..inputs];
                let activation = match above {
                    1 => Activation::Identity,
                    _ => mlp.shape().hidden(),
                };
                let start = end - outputs * (inputs + 1);
                let weights = &mlp.parameters()[start..end - outputs];
                pull_back(s, weights, activation, delta, y, below, chunks);
                (above, end) = (above - 1, start);
            }
        }
    }
}

/// φ′ · x, from y = φ.
#[inline(always)]
fn times_slope<T: Real, S: Simd>(
    s: S,
    activation: Activation,
    y: T::Vector<S>,
    x: T::Vector<S>,
) -> T::Vector<S> {
    match activation {
        Activation::Identity => x,
        Activation::Relu => T::where_positive(s, y, x),
        Activation::Tanh => {
            let one = T::splat(s, T::from_f64(1.0));
            T::mul(s, x, T::sub(s, one, T::mul(s, y, y)))
        }
    }
}

/// Adjoints of one layer of one panel, of values `y`, from those of the layer above.
#[inline(always)]
fn pull_back<T: Real, S: Simd>(
    s: S,
    weights: &[T],
    activation: Activation,
    delta: &[Row<T>],
    y: &[Row<T>],
    below: &mut [Row<T>],
    chunks: usize,
) {
    let inputs = below.len();
    let mut from = 0;
    macro_rules! tiles {
        ($n:literal) => {
            while inputs - from >= $n {
                let below = &mut below[from..];
                tile::<T, S, $n>(
                    s,
                    weights,
                    inputs,
                    from,
                    activation,
                    delta,
                    &y[from..],
                    below,
                    chunks,
                );
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
}

/// N inputs.
#[inline(always)]
#[allow(clippy::too_many_arguments)]
fn tile<T: Real, S: Simd, const N: usize>(
    s: S,
    weights: &[T],
    inputs: usize,
    from: usize,
    activation: Activation,
    delta: &[Row<T>],
    y: &[Row<T>],
    below: &mut [Row<T>],
    chunks: usize,
) {
    let (Some(y), Some(below)) = (y.first_chunk::<N>(), below.first_chunk_mut::<N>()) else {
        return;
    };
    for chunk in 0..chunks {
        let mut sums = [[T::splat(s, T::default()); WIDTH]; N];
        for (w, delta) in weights.chunks_exact(inputs).zip(delta) {
            let delta = chunk_of::<T, S>(delta, chunk);
            let w = &w[from..from + N];
            for n in 0..N {
                let w = T::splat(s, w[n]);
                for v in 0..WIDTH {
                    sums[n][v] = T::mul_add(s, w, delta[v], sums[n][v]);
                }
            }
        }
        for n in 0..N {
            let y = chunk_of::<T, S>(&y[n], chunk);
            let below = chunk_of_mut::<T, S>(&mut below[n], chunk);
            for v in 0..WIDTH {
                below[v] = times_slope::<T, S>(s, activation, y[v], sums[n][v]);
            }
        }
    }
}
