//! Forces with a memory: states of their own that go on with the motion, with exact derivatives.
//!
//! Q_j = force(q_j, v_j, f, h; p),  ḣ = rate(q_j, v_j, f, h; p)
//!
//! h are the states of the effect, f the force of the inputs. On a joint, f is the sum of what the inputs put on it, which acts beside
//! Q_j. A transmission stands between one input and its joint: f is the force of that input, which acts on the joint no more: Q_j does.

use lagrange::{Scalar, Traced};

use super::Scales;
use super::dual::Dual;

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

/// A motor that moves by itself between an input and the joint, at q_j + e with the velocity v_m: where its parameters are among those of the law.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Motor {
    /// Its inertia J, seen at the joint.
    pub inertia: usize,
    /// Whether the mechanism has J in the joint, so that M_jj counts without it; `None`: it always has.
    pub within: Option<usize>,
    /// Whether the joint's sensor is on the motor and reads q_j + e.
    pub read: usize,
}

/// Whether a yes or a no is a yes.
fn is_set(p: &[f64], flag: usize) -> bool {
    p.get(flag).is_some_and(|&x| x != 0.0)
}

impl Motor {
    /// Whether the joint's sensor is on it.
    pub fn is_read(&self, p: &[f64]) -> bool {
        is_set(p, self.read)
    }

    /// J, where the mechanism has it in the joint.
    pub fn inertia_within(&self, p: &[f64]) -> Option<f64> {
        let is_within = self.within.is_none_or(|within| is_set(p, within));
        is_within.then(|| p.get(self.inertia).copied())?
    }

    /// 1/J + 1/m, what swings against the motor being m of a joint of `mass`.
    pub fn inverse(&self, mass: f64, p: &[f64]) -> f64 {
        let inertia = p[self.inertia];
        let left = mass - self.inertia_within(p).unwrap_or(0.0);
        // As much as all is no motor; of what is left nothing is known then.
        let beside = if left > 0.0 { left } else { mass };
        1.0 / inertia + 1.0 / beside
    }
}

/// A law with a memory, written over the scalar; recorded as a [`ForceLaw`](super::ForceLaw) is.
pub trait MemoryLaw: Send + Sync + 'static {
    /// Number of states h; may be none for a law that only needs f.
    fn states(&self) -> usize;

    /// The motor of a transmission that has one: its states h begin with the stretch e and the motor's velocity v_m. None, unless a law says
    /// otherwise.
    fn motor(&self) -> Option<Motor> {
        None
    }

    /// Q_j, N or N·m. `smoothing` is the velocity over which a sign change of friction is spread, m/s or rad/s.
    fn force<D: Scalar>(&self, seen: &Seen<'_, D>, p: &[D], smoothing: D) -> D;

    /// ḣ, into `rate`, as long as there are states.
    fn rate<D: Scalar>(&self, seen: &Seen<'_, D>, p: &[D], smoothing: D, rate: &mut [D]);

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
    /// See [`MemoryLaw::motor`].
    fn motor(&self) -> Option<Motor>;
    /// Q_j, and ḣ into `rate`.
    fn evaluate(&self, seen: &Seen<'_, f64>, p: &[f64], smoothing: f64, rate: &mut [f64]) -> f64;
    /// Q_j and ḣ, row after row, and their derivatives, by dual numbers.
    fn derivatives(
        &self,
        seen: &Seen<'_, f64>,
        p: &[f64],
        smoothing: f64,
        out: &mut MemoryDerivatives,
    );
    /// Writes down Q_j and ḣ of (q, v, f, h …, p …, smoothing), one number more than there are states.
    fn record(&self, arguments: &[Traced]) -> Vec<Traced>;
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

/// Makes a [`MemoryForce`] of a [`MemoryLaw`].
pub struct WithMemory<L>(pub L);

/// What bends with the motion is where the motion is, to so many times the noise of its positions.
pub(super) const STRAY: f64 = 2.0;

/// No law has more states.
pub const MOST_STATES: usize = 4;
/// No law has more parameters.
pub(super) const MOST_PARAMETERS: usize = 8;
const ROWS: usize = 1 + MOST_STATES;
const COLUMNS: usize = 3 + MOST_STATES + MOST_PARAMETERS;

/// Values and derivatives of a [`MemoryForce`]: row 0 is Q_j, row 1 + i is ḣ_i; columns are q_j, v_j, f, each of h and each parameter.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MemoryDerivatives {
    value: [f64; ROWS],
    by: [[f64; COLUMNS]; ROWS],
}

impl MemoryDerivatives {
    /// Q_j for row 0, ḣ_i for row 1 + i.
    pub fn value(&self, row: usize) -> f64 {
        self.value[row]
    }

    /// Its derivatives; 0 beyond the columns of the law.
    pub fn by(&self, row: usize) -> &[f64] {
        &self.by[row]
    }
}

/// Q_j, and ḣ into `rate`, of q, v, f, h … and p ….
fn call<L: MemoryLaw, D: Scalar>(law: &L, arguments: &[D], smoothing: D, rate: &mut [D]) -> D {
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

impl<L: MemoryLaw> MemoryForce for WithMemory<L> {
    fn states(&self) -> usize {
        self.0.states()
    }

    fn motor(&self) -> Option<Motor> {
        self.0.motor()
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
        type Number = Dual<COLUMNS>;
        let states = self.0.states();
        let columns = 3 + states + p.len();
        let mut arguments = [Number::zero(); COLUMNS];
        let values = [seen.q, seen.v, seen.f].into_iter();
        let values = values
            .chain(seen.h.iter().copied())
            .chain(p.iter().copied());
        for (column, (argument, value)) in arguments.iter_mut().zip(values).enumerate() {
            *argument = Number::variable(value, column);
        }
        let mut rate = [Number::zero(); MOST_STATES];
        let smoothing = Number::constant(smoothing);
        let force = call(&self.0, &arguments[..columns], smoothing, &mut rate);
        for (row, dual) in std::iter::once(&force).chain(&rate[..states]).enumerate() {
            (out.value[row], out.by[row]) = (dual.re, dual.eps);
        }
    }

    fn record(&self, arguments: &[Traced]) -> Vec<Traced> {
        let Some((smoothing, arguments)) = arguments.split_last() else {
            return Vec::new();
        };
        let mut outputs = vec![Traced::zero(); 1 + self.0.states()];
        outputs[0] = call(&self.0, arguments, *smoothing, &mut outputs[1..]);
        outputs
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
