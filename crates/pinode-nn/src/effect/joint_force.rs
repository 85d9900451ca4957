//! Forces on one coordinate, with exact derivatives.

use integrators::event::Direction;
use lagrange::{LANES, Lanes, Scalar};
use pulp::NullaryFnOnce;

use super::Scales;
use super::dual::Dual;
use crate::processor::Processor;

/// A force law written over the scalar: Q_j = force(q_j, v_j; p), on the right-hand side of M v̇ + C v + G = Q.
pub trait ForceLaw: Send + Sync + 'static {
    /// The generalized force, N or N·m. `smoothing` is the velocity over which a sign change of friction is spread, m/s or rad/s.
    fn force<D: Scalar>(&self, q: D, v: D, p: &[D], smoothing: f64) -> D;

    /// Whether the force is evaluated for eight states at once, as sines are fast: the law never decides by a number, see
    /// [`MemoryLaw::takes_lanes`](super::MemoryLaw::takes_lanes). `false` unless a law says otherwise.
    fn takes_lanes(&self) -> bool {
        false
    }

    /// Whether its parameters make it what it is called, in a motion of these scales: beyond, it does what another kind is the name of. `true` unless
    /// a law says otherwise.
    fn is_itself(&self, _scales: &Scales, _p: &[f64]) -> bool {
        true
    }

    /// The same law by the parameters that people write, where several sets of them are one: an amplitude that is positive, an angle within a turn. As
    /// they are unless a law says otherwise.
    fn normalise(&self, _p: &mut [f64]) {}

    /// The set-valued law that `smoothing` makes a function; `None` (the default) where the force is one without it.
    fn dry(&self) -> Option<&dyn DryFriction> {
        None
    }

    /// The rigid stops that the force is the compliance of; `None` (the default) for other forces.
    fn stop(&self) -> Option<&dyn RigidStop> {
        None
    }
}

/// Dry friction before it is smoothed: Q_j = −F₊(v_j) for v_j > 0, F₋(|v_j|) for v_j < 0, and anything in [−F₊(0), F₋(0)] at rest.
pub trait DryFriction: Send + Sync {
    /// F ≥ 0 against a slide in `direction` at q_j = `q` with `speed` = |v_j|, N or N·m; smooth in the speed, also a little below 0.
    fn size(&self, direction: Direction, q: f64, speed: f64, p: &[f64]) -> f64;

    /// Parameters of friction that would hold a joint as a log's rests show; none where it has none, or where another law is simpler.
    fn holding(&self, _scales: &Scales) -> Vec<Vec<f64>> {
        Vec::new()
    }
}

/// Stops at the ends of a coordinate's way as hard ones: q_j stays between the two places, and a blow turns the speed v of approach
/// into e v.
pub trait RigidStop: Send + Sync {
    /// The lower and the upper place, m or rad; `None` where there is no stop.
    fn places(&self, p: &[f64]) -> [Option<f64>; 2];

    /// e in [0, 1] where the coordinate moves with the effective `mass` 1/(M⁻¹)_jj, kg or kg·m².
    fn restitution(&self, mass: f64, p: &[f64]) -> f64;

    /// Rate of the swing that half a blow is of, for that mass, 1/s; 0 where there is no stop.
    fn rate(&self, mass: f64, p: &[f64]) -> f64;

    /// Parameters with which blows are so many times shorter, to what a log's motion shows of them as nearly the same as can be.
    fn harder(&self, scales: &Scales, p: &[f64], factor: f64) -> Vec<f64>;

    /// Parameters of stops that would deal the blows by which a log's motion is turned back; none where it has none.
    fn struck(&self, scales: &Scales) -> Vec<Vec<f64>>;
}

/// sgn(v) spread over `smoothing`: tanh(v / smoothing).
#[inline(always)]
pub fn smooth_sign<D: Scalar>(v: D, smoothing: f64) -> D {
    (v / smoothing).tanh()
}

/// The value and derivatives of a [`JointForce`]; those in the parameters go to a slice of the caller's.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct JointForceDerivatives {
    /// Q_j.
    pub force: f64,
    /// ∂Q_j/∂q_j.
    pub by_q: f64,
    /// ∂Q_j/∂v_j.
    pub by_v: f64,
}

/// A [`ForceLaw`] behind a pointer.
pub trait JointForce: Send + Sync {
    /// Q_j(q_j, v_j; p).
    fn force(&self, q: f64, v: f64, p: &[f64], smoothing: f64) -> f64;
    /// Q_j and its derivatives; `by_p` is as long as `p`.
    fn derivatives(
        &self,
        q: f64,
        v: f64,
        p: &[f64],
        smoothing: f64,
        by_p: &mut [f64],
    ) -> JointForceDerivatives;
    /// Q_j of eight states.
    fn force_of_eight(
        &self,
        q: &[f64; LANES],
        v: &[f64; LANES],
        p: &[f64],
        smoothing: f64,
    ) -> [f64; LANES];
    /// (Q_j, ∂Q_j/∂v_j) of eight states.
    fn slopes_of_eight(
        &self,
        q: &[f64; LANES],
        v: &[f64; LANES],
        p: &[f64],
        smoothing: f64,
    ) -> [[f64; LANES]; 2];
    /// (Q_j, ∂Q_j/∂q_j, ∂Q_j/∂v_j) of eight states, and the derivatives in the parameters; `by_p` is as long as `p`.
    fn derivatives_of_eight(
        &self,
        q: &[f64; LANES],
        v: &[f64; LANES],
        p: &[f64],
        smoothing: f64,
        by_p: &mut [[f64; LANES]],
    ) -> [[f64; LANES]; 3] {
        let mut out = [[0.0; LANES]; 3];
        let mut own = [0.0; MOST_PARAMETERS];
        let own = &mut own[..p.len()];
        for lane in 0..LANES {
            let at = self.derivatives(q[lane], v[lane], p, smoothing, own);
            for (to, from) in out.iter_mut().zip([at.force, at.by_q, at.by_v]) {
                to[lane] = from;
            }
            for (to, from) in by_p.iter_mut().zip(&*own) {
                to[lane] = *from;
            }
        }
        out
    }
    /// See [`ForceLaw::is_itself`].
    fn is_itself(&self, scales: &Scales, p: &[f64]) -> bool;
    /// See [`ForceLaw::normalise`].
    fn normalise(&self, p: &mut [f64]);
    /// See [`ForceLaw::dry`].
    fn dry(&self) -> Option<&dyn DryFriction>;
    /// See [`ForceLaw::stop`].
    fn stop(&self) -> Option<&dyn RigidStop>;
}

/// Makes a [`JointForce`] of a [`ForceLaw`]: derivatives by dual numbers.
pub struct OnCoordinate<L>(pub L);

/// No law has more parameters.
pub(super) const MOST_PARAMETERS: usize = 8;
/// q, v and the parameters.
const MOST_VARIABLES: usize = 2 + MOST_PARAMETERS;

/// The force and its derivatives in q, v and p, at most `N` of them, by one evaluation of the law.
fn gradient<L: ForceLaw, const N: usize>(
    law: &L,
    [q, v]: [f64; 2],
    p: &[f64],
    smoothing: f64,
    by_p: &mut [f64],
) -> JointForceDerivatives {
    let mut lifted = [Dual::<f64, N>::zero(); MOST_PARAMETERS];
    let lifted = &mut lifted[..p.len()];
    for (k, (dual, &value)) in lifted.iter_mut().zip(p).enumerate() {
        *dual = Dual::variable(value, 2 + k);
    }
    let force = law.force(
        Dual::variable(q, 0),
        Dual::variable(v, 1),
        lifted,
        smoothing,
    );
    by_p.copy_from_slice(&force.eps[2..2 + by_p.len()]);
    JointForceDerivatives {
        force: force.re,
        by_q: force.eps[0],
        by_v: force.eps[1],
    }
}

/// The force at eight states, by numbers with as many lanes.
struct ForceOfEight<'a, L> {
    law: &'a L,
    /// q and v.
    at: [&'a [f64; LANES]; 2],
    p: &'a [f64],
    smoothing: f64,
}

impl<L: ForceLaw> NullaryFnOnce for ForceOfEight<'_, L> {
    type Output = [f64; LANES];

    #[inline(always)]
    fn call(self) -> [f64; LANES] {
        let mut lifted = [Lanes::<false>::constant(0.0); MOST_PARAMETERS];
        let lifted = &mut lifted[..self.p.len()];
        for (lanes, &value) in lifted.iter_mut().zip(self.p) {
            *lanes = Lanes::constant(value);
        }
        let [q, v] = self.at.map(|x| Lanes(*x));
        self.law.force(q, v, lifted, self.smoothing).0
    }
}

impl<L: ForceLaw> JointForce for OnCoordinate<L> {
    fn force(&self, q: f64, v: f64, p: &[f64], smoothing: f64) -> f64 {
        self.0.force(q, v, p, smoothing)
    }

    fn derivatives(
        &self,
        q: f64,
        v: f64,
        p: &[f64],
        smoothing: f64,
        by_p: &mut [f64],
    ) -> JointForceDerivatives {
        // Numbers as short as hold the derivatives.
        match p.len() {
            0..=2 => gradient::<L, 4>(&self.0, [q, v], p, smoothing, by_p),
            3..=4 => gradient::<L, 6>(&self.0, [q, v], p, smoothing, by_p),
            _ => gradient::<L, MOST_VARIABLES>(&self.0, [q, v], p, smoothing, by_p),
        }
    }

    fn force_of_eight(
        &self,
        q: &[f64; LANES],
        v: &[f64; LANES],
        p: &[f64],
        smoothing: f64,
    ) -> [f64; LANES] {
        if !self.0.takes_lanes() {
            return std::array::from_fn(|lane| self.force(q[lane], v[lane], p, smoothing));
        }
        let law = &self.0;
        Processor::here().run(ForceOfEight {
            law,
            at: [q, v],
            p,
            smoothing,
        })
    }

    fn slopes_of_eight(
        &self,
        q: &[f64; LANES],
        v: &[f64; LANES],
        p: &[f64],
        smoothing: f64,
    ) -> [[f64; LANES]; 2] {
        let mut lifted = [Dual::<f64, 1>::zero(); MOST_PARAMETERS];
        let lifted = &mut lifted[..p.len()];
        for (dual, &value) in lifted.iter_mut().zip(p) {
            *dual = Dual::constant(value);
        }
        let mut out = [[0.0; LANES]; 2];
        for lane in 0..LANES {
            let (q, v) = (Dual::constant(q[lane]), Dual::variable(v[lane], 0));
            let force = self.0.force(q, v, lifted, smoothing);
            (out[0][lane], out[1][lane]) = (force.re, force.eps[0]);
        }
        out
    }

    fn is_itself(&self, scales: &Scales, p: &[f64]) -> bool {
        self.0.is_itself(scales, p)
    }

    fn normalise(&self, p: &mut [f64]) {
        self.0.normalise(p);
    }

    fn dry(&self) -> Option<&dyn DryFriction> {
        self.0.dry()
    }

    fn stop(&self) -> Option<&dyn RigidStop> {
        self.0.stop()
    }
}
