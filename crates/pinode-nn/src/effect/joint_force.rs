//! Forces on one coordinate, with exact derivatives.

use integrators::event::Direction;
use lagrange::{Scalar, Traced};

use super::Scales;
use super::dual::Dual;

/// A force law written over the scalar: Q_j = force(q_j, v_j; p), on the right-hand side of M v̇ + C v + G = Q.
///
/// It is recorded once and run as a program, with its derivatives and on eight states at once. A law that asks for the value of a number
/// ([`Scalar::re`]) to decide by it has no record, nor has one of thousands of operations: it is evaluated on dual numbers, state by state, which takes
/// several times as long. What depends on a direction can be written by `abs` and `sign`. To be recorded the law is run once where `re` is NaN: it must
/// come to an end there.
pub trait ForceLaw: Send + Sync + 'static {
    /// The generalized force, N or N·m. `smoothing` is the velocity over which a sign change of friction is spread, m/s or rad/s.
    fn force<D: Scalar>(&self, q: D, v: D, p: &[D], smoothing: D) -> D;

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
pub fn smooth_sign<D: Scalar>(v: D, smoothing: D) -> D {
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
    /// Q_j and its derivatives, by dual numbers; `by_p` is as long as `p`.
    fn derivatives(
        &self,
        q: f64,
        v: f64,
        p: &[f64],
        smoothing: f64,
        by_p: &mut [f64],
    ) -> JointForceDerivatives;
    /// Writes down Q_j of (q, v, f, p …, smoothing), one number; of the force f of the inputs it does not depend.
    fn record(&self, arguments: &[Traced]) -> Vec<Traced>;
    /// See [`ForceLaw::is_itself`].
    fn is_itself(&self, scales: &Scales, p: &[f64]) -> bool;
    /// See [`ForceLaw::normalise`].
    fn normalise(&self, p: &mut [f64]);
    /// See [`ForceLaw::dry`].
    fn dry(&self) -> Option<&dyn DryFriction>;
    /// See [`ForceLaw::stop`].
    fn stop(&self) -> Option<&dyn RigidStop>;
}

/// Makes a [`JointForce`] of a [`ForceLaw`].
pub struct OnCoordinate<L>(pub L);

/// No law has more parameters.
pub(super) const MOST_PARAMETERS: usize = 8;
/// q, v and the parameters.
const MOST_VARIABLES: usize = 2 + MOST_PARAMETERS;

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
        type Number = Dual<MOST_VARIABLES>;
        let mut lifted = [Number::zero(); MOST_PARAMETERS];
        let lifted = &mut lifted[..p.len()];
        for (k, (dual, &value)) in lifted.iter_mut().zip(p).enumerate() {
            *dual = Number::variable(value, 2 + k);
        }
        let (q, v) = (Number::variable(q, 0), Number::variable(v, 1));
        let force = self.0.force(q, v, lifted, Number::constant(smoothing));
        by_p.copy_from_slice(&force.eps[2..2 + by_p.len()]);
        JointForceDerivatives {
            force: force.re,
            by_q: force.eps[0],
            by_v: force.eps[1],
        }
    }

    fn record(&self, arguments: &[Traced]) -> Vec<Traced> {
        let [q, v, _, p @ .., smoothing] = arguments else {
            return Vec::new();
        };
        vec![self.0.force(*q, *v, p, *smoothing)]
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
