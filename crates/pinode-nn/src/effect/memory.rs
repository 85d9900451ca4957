//! Forces with a memory: states of their own that go on with the motion, with exact derivatives.
//!
//! Q_j = force(q_j, v_j, f, h; p),  ḣ = rate(q_j, v_j, f, h; p)
//!
//! h are the states of the effect, f the force of the inputs. On a joint, f is the sum of what the inputs put on it, which acts beside
//! Q_j. A transmission stands between one input and its joint: f is the force of that input, which acts on the joint no more: Q_j does.

use lagrange::{LANES, Lanes, Scalar};
use num_dual::DualSVec64;
use pulp::NullaryFnOnce;

use super::Scales;
use super::dual::Dual;
use crate::processor::Processor;

/// What a law with a memory sees of the world.
#[derive(Debug, Clone, Copy)]
pub struct Seen<'a, D> {
    /// Position of the joint, m or rad.
    pub q: D,
    /// Its velocity, m/s or rad/s.
    pub v: D,
    /// Force of the inputs, N or N·m.
    pub f: D,
    /// The states of the effect.
    pub h: &'a [D],
}

/// A law with a memory, written over the scalar.
pub trait MemoryLaw: Send + Sync + 'static {
    /// Number of states h; may be none for a law that only needs f.
    fn states(&self) -> usize;

    /// Which parameter is an inertia that moves by itself and that the mechanism has in the joint: M_jj counts without it.
    fn taken_from_joint(&self) -> Option<usize> {
        None
    }

    /// Whether the law never decides by a number: it asks for no [`Scalar::re`], and calls no `min`, `max`, `pow` or `inverse_above`, which do. Such laws
    /// are evaluated for eight states at once.
    fn takes_lanes(&self) -> bool {
        false
    }

    /// Q_j, N or N·m. `smoothing` is the velocity over which a sign change of friction is spread, m/s or rad/s.
    fn force<D: Scalar>(&self, seen: &Seen<'_, D>, p: &[D], smoothing: f64) -> D;

    /// ḣ, into `rate`, as long as there are states.
    fn rate<D: Scalar>(&self, seen: &Seen<'_, D>, p: &[D], smoothing: f64, rate: &mut [D]);

    /// h to start with where nothing of before is known: that of a steady motion with velocity v under f where there is one, else that of
    /// rest; into `h`.
    fn start(&self, v: f64, f: f64, p: &[f64], h: &mut [f64]);

    /// By how much h may differ at the start of a window from where a pass over the whole recording puts it: standard deviations, into
    /// `spread`, for forces of the size `force` and speeds of the size `speed`.
    fn spread(&self, force: f64, speed: f64, p: &[f64], spread: &mut [f64]);

    /// By how much h still may differ from there once p is fitted, where that is less: the pass is as good as the motion is known, its positions
    /// to `noise`; `spread` has what [`spread`](Self::spread) says. Nothing less, unless a law says so.
    fn stray(&self, _noise: f64, _p: &[f64], _spread: &mut [f64]) {}

    /// Whether its parameters make it what it is called, in a motion of these scales: beyond, it does what another kind is the name of. `true` unless
    /// a law says otherwise.
    fn is_itself(&self, _scales: &Scales, _p: &[f64]) -> bool {
        true
    }

    /// The fastest rate by which h settles or swings at speeds of the size `speed`, 1/s, for a body of `mass` kg or kg·m²: what the
    /// integration step must resolve.
    fn fastest(&self, speed: f64, mass: f64, p: &[f64]) -> f64;
}

/// A [`MemoryLaw`] behind a pointer.
pub trait MemoryForce: Send + Sync {
    /// See [`MemoryLaw::states`].
    fn states(&self) -> usize;
    /// See [`MemoryLaw::taken_from_joint`].
    fn taken_from_joint(&self) -> Option<usize>;
    /// Q_j, and ḣ into `rate`.
    fn evaluate(&self, seen: &Seen<'_, f64>, p: &[f64], smoothing: f64, rate: &mut [f64]) -> f64;
    /// Q_j and ḣ, row after row, and their derivatives.
    fn derivatives(
        &self,
        seen: &Seen<'_, f64>,
        p: &[f64],
        smoothing: f64,
        out: &mut MemoryDerivatives,
    );
    /// As [`evaluate`](Self::evaluate) of eight states: the values in `out`, whose derivatives are then of no use.
    fn evaluate_eight(
        &self,
        seen: &Seen<'_, [f64; LANES]>,
        p: &[f64],
        smoothing: f64,
        out: &mut MemoryDerivatives<[f64; LANES]>,
    );
    /// As [`derivatives`](Self::derivatives) of eight states.
    fn derivatives_of_eight(
        &self,
        seen: &Seen<'_, [f64; LANES]>,
        p: &[f64],
        smoothing: f64,
        out: &mut MemoryDerivatives<[f64; LANES]>,
    );
    /// See [`MemoryLaw::start`].
    fn start(&self, v: f64, f: f64, p: &[f64], h: &mut [f64]);
    /// See [`MemoryLaw::spread`].
    fn spread(&self, force: f64, speed: f64, p: &[f64], spread: &mut [f64]);
    /// See [`MemoryLaw::stray`].
    fn stray(&self, noise: f64, p: &[f64], spread: &mut [f64]);
    /// See [`MemoryLaw::is_itself`].
    fn is_itself(&self, scales: &Scales, p: &[f64]) -> bool;
    /// See [`MemoryLaw::fastest`].
    fn fastest(&self, speed: f64, mass: f64, p: &[f64]) -> f64;
}

/// Makes a [`MemoryForce`] of a [`MemoryLaw`]: derivatives by dual numbers.
pub struct WithMemory<L>(pub L);

/// What bends with the motion is where the motion is, to so many times the noise of its positions.
pub(super) const STRAY: f64 = 2.0;

/// No law has more states.
pub const MOST_STATES: usize = 4;
/// No law has more parameters.
pub(super) const MOST_PARAMETERS: usize = 8;
const ROWS: usize = 1 + MOST_STATES;
const COLUMNS: usize = 3 + MOST_STATES + MOST_PARAMETERS;

/// Values and derivatives of a [`MemoryForce`]: row 0 is Q_j, row 1 + i is ḣ_i. Entries are numbers, or `[f64; LANES]` for eight states.
#[derive(Debug, Clone, PartialEq)]
pub struct MemoryDerivatives<T = f64> {
    states: usize,
    value: [T; ROWS],
    by: [[T; COLUMNS]; ROWS],
}

impl Default for MemoryDerivatives {
    fn default() -> Self {
        Self::filled(0.0)
    }
}

impl Default for MemoryDerivatives<[f64; LANES]> {
    fn default() -> Self {
        Self::filled([0.0; LANES])
    }
}

impl<T: Copy> MemoryDerivatives<T> {
    fn filled(zero: T) -> Self {
        MemoryDerivatives {
            states: 0,
            value: [zero; ROWS],
            by: [[zero; COLUMNS]; ROWS],
        }
    }

    /// Q_j for row 0, ḣ_i for row 1 + i.
    pub fn value(&self, row: usize) -> T {
        self.value[row]
    }
    /// By q_j.
    pub fn by_q(&self, row: usize) -> T {
        self.by[row][0]
    }
    /// By v_j.
    pub fn by_v(&self, row: usize) -> T {
        self.by[row][1]
    }
    /// By f.
    pub fn by_f(&self, row: usize) -> T {
        self.by[row][2]
    }
    /// By each of h.
    pub fn by_h(&self, row: usize) -> &[T] {
        &self.by[row][3..3 + self.states]
    }
    /// By each parameter.
    pub fn by_p(&self, row: usize) -> &[T] {
        &self.by[row][3 + self.states..]
    }
}

/// Splits q, v, f, h … and p … into what a law takes.
#[inline(always)]
fn call<L: MemoryLaw, D: Scalar>(law: &L, arguments: &[D], smoothing: f64, rate: &mut [D]) -> D {
    let states = law.states();
    let (h, p) = arguments[3..].split_at(states);
    let seen = Seen {
        q: arguments[0],
        v: arguments[1],
        f: arguments[2],
        h,
    };
    law.rate(&seen, p, smoothing, &mut rate[..states]);
    law.force(&seen, p, smoothing)
}

/// Q_j, ḣ and their derivatives in at most `N` variables, by one evaluation of the law.
fn gradients<L: MemoryLaw, const N: usize>(
    law: &L,
    seen: &Seen<'_, f64>,
    p: &[f64],
    smoothing: f64,
    out: &mut MemoryDerivatives,
) {
    let states = law.states();
    let columns = 3 + states + p.len();
    let zero = DualSVec64::<N>::from_re(0.0);
    let mut arguments = [zero; COLUMNS];
    let values = [seen.q, seen.v, seen.f].into_iter();
    let values = values
        .chain(seen.h.iter().copied())
        .chain(p.iter().copied());
    for (column, (argument, value)) in arguments.iter_mut().zip(values).enumerate() {
        *argument = DualSVec64::from_re(value).derivative(column);
    }
    let mut rate = [zero; MOST_STATES];
    let force = call(law, &arguments[..columns], smoothing, &mut rate);
    out.states = states;
    for (row, dual) in std::iter::once(&force).chain(&rate[..states]).enumerate() {
        out.value[row] = dual.re;
        let by = dual.eps.0.map_or([0.0; N], Into::into);
        for (to, by) in out.by[row].iter_mut().zip(by.iter().take(columns)) {
            *to = *by;
        }
    }
}

/// [`gradients`] of eight states, by numbers with as many lanes, in the first `N` of at most `M` variables.
struct GradientsOfEight<'a, L, const N: usize, const M: usize> {
    law: &'a L,
    seen: &'a Seen<'a, [f64; LANES]>,
    p: &'a [f64],
    smoothing: f64,
    out: &'a mut MemoryDerivatives<[f64; LANES]>,
}

impl<L: MemoryLaw, const N: usize, const M: usize> NullaryFnOnce for GradientsOfEight<'_, L, N, M> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        type Number<const N: usize> = Dual<Lanes<false>, N>;
        let GradientsOfEight {
            law,
            seen,
            p,
            smoothing,
            out,
        } = self;
        let states = law.states();
        let columns = 3 + states + p.len();
        let mut arguments = [Number::<N>::zero(); M];
        let values = [seen.q, seen.v, seen.f].into_iter();
        let values = values.chain(seen.h.iter().copied());
        let values = values.chain(p.iter().map(|p| [*p; LANES]));
        for (column, (argument, value)) in arguments.iter_mut().zip(values).enumerate() {
            *argument = Dual::variable(Lanes(value), column);
        }
        let mut rate = [Number::<N>::zero(); MOST_STATES];
        let force = call(law, &arguments[..columns], smoothing, &mut rate);
        out.states = states;
        for (row, dual) in std::iter::once(&force).chain(&rate[..states]).enumerate() {
            out.value[row] = dual.re.0;
            for (to, by) in out.by[row].iter_mut().zip(dual.eps.iter().take(columns)) {
                *to = by.0;
            }
        }
    }
}

/// See [`GradientsOfEight`].
fn gradients_of_eight<L: MemoryLaw, const N: usize, const M: usize>(
    law: &L,
    seen: &Seen<'_, [f64; LANES]>,
    p: &[f64],
    smoothing: f64,
    out: &mut MemoryDerivatives<[f64; LANES]>,
) {
    Processor::here().run(GradientsOfEight::<L, N, M> {
        law,
        seen,
        p,
        smoothing,
        out,
    });
}

/// What `each` finds at eight states, one after the other: values, and derivatives where there are some.
fn one_by_one(
    seen: &Seen<'_, [f64; LANES]>,
    out: &mut MemoryDerivatives<[f64; LANES]>,
    each: impl Fn(&Seen<'_, f64>, &mut MemoryDerivatives),
) {
    let mut one = MemoryDerivatives::default();
    for lane in 0..LANES {
        let mut h = [0.0; MOST_STATES];
        for (to, from) in h.iter_mut().zip(seen.h) {
            *to = from[lane];
        }
        let here = Seen {
            q: seen.q[lane],
            v: seen.v[lane],
            f: seen.f[lane],
            h: &h[..seen.h.len()],
        };
        each(&here, &mut one);
        out.states = one.states;
        for (to, from) in out.value.iter_mut().zip(one.value) {
            to[lane] = from;
        }
        let to = out.by.as_flattened_mut().iter_mut();
        for (to, from) in to.zip(one.by.as_flattened()) {
            to[lane] = *from;
        }
    }
}

impl<L: MemoryLaw> MemoryForce for WithMemory<L> {
    fn states(&self) -> usize {
        self.0.states()
    }

    fn taken_from_joint(&self) -> Option<usize> {
        self.0.taken_from_joint()
    }

    fn evaluate(&self, seen: &Seen<'_, f64>, p: &[f64], smoothing: f64, rate: &mut [f64]) -> f64 {
        self.0.rate(seen, p, smoothing, rate);
        self.0.force(seen, p, smoothing)
    }

    fn derivatives(
        &self,
        seen: &Seen<'_, f64>,
        p: &[f64],
        smoothing: f64,
        out: &mut MemoryDerivatives,
    ) {
        // Numbers as short as hold the derivatives.
        match 3 + self.0.states() + p.len() {
            0..=6 => gradients::<L, 6>(&self.0, seen, p, smoothing, out),
            7..=8 => gradients::<L, 8>(&self.0, seen, p, smoothing, out),
            9..=10 => gradients::<L, 10>(&self.0, seen, p, smoothing, out),
            _ => gradients::<L, COLUMNS>(&self.0, seen, p, smoothing, out),
        }
    }

    fn evaluate_eight(
        &self,
        seen: &Seen<'_, [f64; LANES]>,
        p: &[f64],
        smoothing: f64,
        out: &mut MemoryDerivatives<[f64; LANES]>,
    ) {
        if self.0.takes_lanes() {
            return gradients_of_eight::<L, 0, COLUMNS>(&self.0, seen, p, smoothing, out);
        }
        one_by_one(seen, out, |seen, one| {
            let [force, rate @ ..] = &mut one.value;
            *force = self.evaluate(seen, p, smoothing, &mut rate[..seen.h.len()]);
        });
    }

    fn derivatives_of_eight(
        &self,
        seen: &Seen<'_, [f64; LANES]>,
        p: &[f64],
        smoothing: f64,
        out: &mut MemoryDerivatives<[f64; LANES]>,
    ) {
        if !self.0.takes_lanes() {
            return one_by_one(seen, out, |seen, one| {
                self.derivatives(seen, p, smoothing, one);
            });
        }
        match 3 + self.0.states() + p.len() {
            0..=6 => gradients_of_eight::<L, 6, 6>(&self.0, seen, p, smoothing, out),
            7..=8 => gradients_of_eight::<L, 8, 8>(&self.0, seen, p, smoothing, out),
            9..=10 => gradients_of_eight::<L, 10, 10>(&self.0, seen, p, smoothing, out),
            _ => gradients_of_eight::<L, COLUMNS, COLUMNS>(&self.0, seen, p, smoothing, out),
        }
    }

    fn start(&self, v: f64, f: f64, p: &[f64], h: &mut [f64]) {
        self.0.start(v, f, p, h);
    }

    fn spread(&self, force: f64, speed: f64, p: &[f64], spread: &mut [f64]) {
        self.0.spread(force, speed, p, spread);
    }

    fn stray(&self, noise: f64, p: &[f64], spread: &mut [f64]) {
        self.0.stray(noise, p, spread);
    }

    fn is_itself(&self, scales: &Scales, p: &[f64]) -> bool {
        self.0.is_itself(scales, p)
    }

    fn fastest(&self, speed: f64, mass: f64, p: &[f64]) -> f64 {
        self.0.fastest(speed, mass, p)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effect::registry;

    /// A law that decides by a number.
    struct Branching;

    impl MemoryLaw for Branching {
        fn states(&self) -> usize {
            1
        }
        fn force<D: Scalar>(&self, seen: &Seen<'_, D>, p: &[D], _: f64) -> D {
            match seen.v.re() > 0.0 {
                true => p[0] * seen.h[0],
                false => p[1] * seen.v * seen.q,
            }
        }
        fn rate<D: Scalar>(&self, seen: &Seen<'_, D>, p: &[D], _: f64, rate: &mut [D]) {
            rate[0] = seen.f * p[0] - seen.h[0];
        }
        fn start(&self, _: f64, _: f64, _: &[f64], _: &mut [f64]) {}
        fn spread(&self, _: f64, _: f64, _: &[f64], _: &mut [f64]) {}
        fn fastest(&self, _: f64, _: f64, _: &[f64]) -> f64 {
            0.0
        }
    }

    /// How far eight states at once are from the same ones by themselves, relative to the size of each number.
    fn distance(law: &dyn MemoryForce, p: &[f64]) -> f64 {
        let of = |phase: f64| std::array::from_fn(|lane| (phase + 2.3 * lane as f64).sin());
        let h: Vec<[f64; LANES]> = (0..law.states()).map(|i| of(5.0 + i as f64)).collect();
        let [q, v, f] = [0.1, 0.9, 2.0].map(of);
        let seen = Seen { q, v, f, h: &h };
        let mut eight = MemoryDerivatives::<[f64; LANES]>::default();
        let mut values = eight.clone();
        law.derivatives_of_eight(&seen, p, 0.01, &mut eight);
        law.evaluate_eight(&seen, p, 0.01, &mut values);
        let mut worst = 0.0_f64;
        let mut compare = |a: f64, b: f64| worst = worst.max((a - b).abs() / (1.0 + b.abs()));
        for lane in 0..LANES {
            let h: Vec<f64> = h.iter().map(|h| h[lane]).collect();
            let here = Seen {
                q: q[lane],
                v: v[lane],
                f: f[lane],
                h: &h,
            };
            let mut one = MemoryDerivatives::default();
            law.derivatives(&here, p, 0.01, &mut one);
            for row in 0..=law.states() {
                compare(values.value(row)[lane], one.value(row));
                compare(eight.value(row)[lane], one.value(row));
                compare(eight.by_q(row)[lane], one.by_q(row));
                compare(eight.by_v(row)[lane], one.by_v(row));
                compare(eight.by_f(row)[lane], one.by_f(row));
                for (eight, one) in eight.by_h(row).iter().zip(one.by_h(row)) {
                    compare(eight[lane], *one);
                }
                for (eight, one) in eight.by_p(row).iter().zip(one.by_p(row)).take(p.len()) {
                    compare(eight[lane], *one);
                }
            }
        }
        worst
    }

    #[test]
    fn laws_at_eight_states_are_those_at_each() {
        let mut seen = Vec::new();
        for kind in registry::all() {
            let Some(law) = kind.memory() else {
                continue;
            };
            let count = kind.parameters.len();
            let p: Vec<f64> = (0..count).map(|k| 0.7 + 0.4 * k as f64).collect();
            let distance = distance(law, &p);
            assert!(distance < 1e-12, "{}: {distance:e}", kind.name);
            seen.push(kind.name);
        }
        assert!(seen.len() >= 6, "{seen:?}");
        assert!(distance(&WithMemory(Branching), &[0.7, 1.1]) < 1e-12);
    }
}
