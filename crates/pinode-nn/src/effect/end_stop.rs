//! End stop: with the depth p = q − q₊ > 0 beyond `upper` and its rate ṗ = v,
//!
//! Q = −k p (1 + c ṗ / (k p + c |ṗ|)),
//!
//! and the same from the other side beyond `lower`, p = q₋ − q, ṗ = −v, Q = +k p (…); 0 in between.
//!
//! k in N/m or N·m/rad, c in N·s/m or N·m·s/rad, q₋ and q₊ in m or rad. This is the spring and damper k p + c ṗ where c |ṗ| is small
//! beside k p, kept between 0 and 2 k p: the stop pushes and never pulls. The plain sum jumps by c ṗ when the stop is touched, and
//! roll-outs have no derivative in the place of a force that jumps; this force is continuous.
//!
//! The force grows in proportion with p and ṗ together. So a body of mass m that strikes with the speed v leaves with e v at every v,
//! where e depends on ζ = c / (2 √(k m)) alone. In the plane of √k p and √m ṗ, in polar coordinates,
//!
//! ln e = −∫₀^{π/2} 2ζ s² c [1/(c + 2ζ s³) + 1/(c + 2ζ s³ + 4ζ s c²)] dθ, s = sin θ, c = cos θ,
//!
//! e = 1 − πζ + … for small ζ as of the linear damper, in proportion to 1/∛ζ for large ζ. The rigid stop with this [restitution](RigidStop::restitution) is what it becomes
//! for k → ∞ at the same ζ, but for the time of contact of about π √(m/k).
//!
//! **A stop on one side** leaves the other key out. The joint limits of a URDF are no stops: they say where a controller should keep
//! the joint, not what is hit there nor how hard it is.

use lagrange::Scalar;

use super::{
    Action, Family, ForceLaw, Kind, LeftOut, OnCoordinate, ParameterSpec, Probe, Quantity,
    RigidStop, Scales, Struck,
};

struct EndStop;

/// What gives for longer than this, s at the usual pace, is a spring and no stop.
const LONGEST_BLOW: f64 = 0.25;
/// How far within the range soft stops are looked for, in parts of the reach.
const SOFT: f64 = 0.05;
/// A blow that the samples do not resolve is taken to last so many times the time within which it is over: fits start from both, for hard
/// stops are nearer to the truth and softer ones easier to fit.
const LASTING: [f64; 2] = [1.0, 4.0];
/// ζ of which a restitution is looked for, on a logarithmic scale: e = 0.99 to 0.12.
const DAMPED: (f64, f64) = (3e-3, 100.0);

/// Added to a force that may be 0, and divides 0.
const NOT_ZERO: f64 = 1e-300;

/// The force of the stop on what is `depth` in it, or less than nothing, and goes on with `rate`, at least 0.
fn push<D: Scalar>(depth: D, rate: D, stiffness: D, damping: D) -> D {
    // NaN goes on to where it is seen. What just touches has the slopes of what is in the stop: fits start there.
    let (spring, damper) = (stiffness * depth.max(D::zero()), damping * rate);
    spring + spring * damper / (spring + damper.abs() + NOT_ZERO)
}

impl ForceLaw for EndStop {
    fn force<D: Scalar>(&self, q: D, v: D, p: &[D], _smoothing: D) -> D {
        push(p[0] - q, -v, p[2], p[3]) - push(q - p[1], v, p[2], p[3])
    }

    /// It turns the motion round at once: a blow of the mass m on the stiffness k lasts π √(m/k).
    fn is_itself(&self, scales: &Scales, p: &[f64]) -> bool {
        std::f64::consts::PI * (scales.mass / p[2]).sqrt() < LONGEST_BLOW * scales.pace
    }

    fn stop(&self) -> Option<&dyn RigidStop> {
        Some(self)
    }
}

/// Intervals of Simpson's rule; e is exact to 1e-6 for ζ from 1e-3 to 1e3.
const INTERVALS: u32 = 512;

impl RigidStop for EndStop {
    fn places(&self, p: &[f64]) -> [Option<f64>; 2] {
        let there = |place: f64| (place.is_finite() && p[2] > 0.0).then_some(place);
        [there(p[0]), there(p[1])]
    }

    fn restitution(&self, mass: f64, p: &[f64]) -> f64 {
        restitution(0.5 * p[3] / (p[2] * mass).sqrt())
    }

    fn rate(&self, mass: f64, p: &[f64]) -> f64 {
        match self.places(p) {
            [None, None] => 0.0,
            _ => (p[2] / mass).sqrt(),
        }
    }

    fn harder(&self, scales: &Scales, p: &[f64], factor: f64) -> Vec<f64> {
        let e = self.restitution(scales.mass, p);
        let shorter = std::f64::consts::PI / self.rate(scales.mass, p) * (1.0 - 1.0 / factor);
        let [below, above] = scales
            .struck
            .map(|end| end.map_or(0.0, |end| end.ahead(e, shorter)));
        vec![
            p[0] - below,
            p[1] + above,
            factor * factor * p[2],
            factor * p[3],
        ]
    }

    fn struck(&self, scales: &Scales) -> Vec<Vec<f64>> {
        let ends = || scales.struck.iter().flatten();
        let count = ends().count();
        if count == 0 {
            return Vec::new();
        }
        let zeta = damping_of(ends().map(|end| end.restitution).sum::<f64>() / count as f64);
        let starts = LASTING.map(|factor| {
            let lasting =
                |end: &Struck| (factor * end.within).min(0.9 * LONGEST_BLOW * scales.pace);
            let rate = std::f64::consts::PI / ends().map(lasting).fold(0.0, f64::max);
            let place = |end: &Struck| (end.place, end.ahead(end.restitution, lasting(end)));
            let [lower, upper] = scales.struck.map(|end| end.as_ref().map(place));
            vec![
                lower.map_or(f64::NEG_INFINITY, |(place, before)| place + before),
                upper.map_or(f64::INFINITY, |(place, before)| place - before),
                scales.mass * rate * rate,
                2.0 * zeta * scales.mass * rate,
            ]
        });
        starts.to_vec()
    }
}

/// e of a blow that is damped by ζ.
fn restitution(zeta: f64) -> f64 {
    if zeta == 0.0 {
        return 1.0;
    }
    // θ = π/2 (3 t² − 2 t³): more points where the integrand turns, at the ends.
    let integrand = |t: f64| {
        let (sin, cos) = (std::f64::consts::FRAC_PI_2 * t * t * (3.0 - 2.0 * t)).sin_cos();
        let slope = std::f64::consts::FRAC_PI_2 * 6.0 * t * (1.0 - t);
        let slow = cos + 2.0 * zeta * sin.powi(3);
        let fast = slow + 4.0 * zeta * sin * cos * cos;
        2.0 * zeta * sin * sin * cos * (1.0 / slow + 1.0 / fast) * slope
    };
    let h = 1.0 / f64::from(INTERVALS);
    // 0 at both ends.
    let inner = (1..INTERVALS).map(|i| {
        let weight = if i % 2 == 1 { 4.0 } else { 2.0 };
        weight * integrand(f64::from(i) * h)
    });
    (-inner.sum::<f64>() * h / 3.0).exp()
}

/// The ζ of a restitution, within [`DAMPED`].
fn damping_of(wanted: f64) -> f64 {
    let (mut low, mut high) = (DAMPED.0.ln(), DAMPED.1.ln());
    // A thousandth of ζ.
    while high - low > 1e-3 {
        let middle = 0.5 * (low + high);
        match restitution(middle.exp()) > wanted {
            true => low = middle,
            false => high = middle,
        }
    }
    (0.5 * (low + high)).exp()
}

/// The kind `end_stop`.
pub static KIND: Kind = Kind {
    name: "end_stop",
    family: Family::Conservative,
    summary: "stop at the end of the way, with a spring and a damper",
    parameters: &[
        ParameterSpec::new(
            "lower",
            Quantity::Displacement,
            (f64::NEG_INFINITY, f64::INFINITY),
            f64::NEG_INFINITY,
        )
        .left_out_as(LeftOut::Value(f64::NEG_INFINITY)),
        ParameterSpec::new(
            "upper",
            Quantity::Displacement,
            (f64::NEG_INFINITY, f64::INFINITY),
            f64::INFINITY,
        )
        .left_out_as(LeftOut::Value(f64::INFINITY)),
        ParameterSpec::new("stiffness", Quantity::Stiffness, (0.0, f64::INFINITY), 0.0),
        ParameterSpec::new("damping", Quantity::Damping, (0.0, f64::INFINITY), 0.0),
    ],
    action: Action::Joint(&OnCoordinate(EndStop)),
    contains: &[],
    // Motion that a stop turned back lies before it: soft ones are just inside of the range that the log covers.
    probes: |scales, _| {
        let soft = scales.small_force() / (SOFT * scales.reach);
        let way = (1.0 - SOFT) * scales.reach;
        let sides = [(false, true), (true, false), (true, true)];
        let probes = sides.map(|(low, high)| {
            let place = |there: bool, way: f64| match there {
                true => scales.centre + way,
                false => f64::INFINITY * way,
            };
            let (lower, upper) = (place(low, -way), place(high, way));
            Probe {
                neutral: vec![lower, upper, 0.0, 0.0],
                perturbed: vec![lower, upper, soft, 0.0],
            }
        });
        probes.to_vec()
    },
};

#[cfg(test)]
mod tests {
    use super::*;

    const K: f64 = 2.0e4;

    fn force(q: f64, v: f64, c: f64) -> f64 {
        EndStop.force(q, v, &[-0.2, 0.3, K, c], 1e-3)
    }

    /// The speed after the blow of a mass that strikes with `speed`, by small steps of Heun's method.
    fn rebound(mass: f64, damping: f64, speed: f64) -> f64 {
        let acceleration = |q: f64, v: f64| force(q, v, damping) / mass;
        let h = 1e-6 * (mass / 0.5).sqrt();
        let (mut q, mut v) = (0.3, speed);
        loop {
            let a = acceleration(q, v);
            let (q_e, v_e) = (q + h * v, v + h * a);
            q += 0.5 * h * (v + v_e);
            v += 0.5 * h * (a + acceleration(q_e, v_e));
            if q <= 0.3 && v <= 0.0 {
                return -v;
            }
        }
    }

    #[test]
    fn a_stop_pushes_from_both_sides_and_never_pulls() {
        for c in [0.0, 50.0, 5e3] {
            for v in [-2.0, -0.1, 0.0, 0.1, 2.0] {
                assert_eq!(force(0.1, v, c), 0.0);
                for depth in [1e-9, 1e-4, 1e-2] {
                    let (up, low) = (force(0.3 + depth, v, c), force(-0.2 - depth, v, c));
                    assert!(
                        (-2.0 * K * depth..=0.0).contains(&(up * (1.0 - 1e-6))),
                        "{up}"
                    );
                    assert!(
                        (0.0..=2.0 * K * depth).contains(&(low * (1.0 - 1e-6))),
                        "{low}"
                    );
                }
            }
        }
        // Slow against its spring it is the spring and damper.
        let slow = force(0.31, 1e-4, 50.0);
        assert!((slow + K * 0.01 + 50.0 * 1e-4).abs() < 1e-6, "{slow}");
    }

    #[test]
    fn the_restitution_is_that_of_the_compliant_blow_at_every_speed() {
        for (mass, damping) in [(0.5, 2.0), (0.5, 40.0), (2.0, 100.0), (0.5, 1e3)] {
            let e = EndStop.restitution(mass, &[-0.2, 0.3, K, damping]);
            for speed in [0.02, 0.7] {
                let found = rebound(mass, damping, speed) / speed;
                assert!((found - e).abs() < 1e-4, "{mass} kg: {found} for {e}");
            }
        }
        assert_eq!(EndStop.restitution(1.0, &[0.0, 1.0, K, 0.0]), 1.0);
        // The rest is of the order ζ² ln ζ.
        let little = EndStop.restitution(1.0, &[0.0, 1.0, 1.0, 2e-3]);
        assert!(
            (little - (1.0 - std::f64::consts::PI * 1e-3)).abs() < 1e-4,
            "{little}"
        );
        // Much damping: in proportion to 1/∛ζ.
        let [much, more] = [2e3, 16e3].map(|c| EndStop.restitution(1.0, &[0.0, 1.0, 1.0, c]));
        assert!((much / more - 2.0).abs() < 0.02, "{much}, {more}");
    }

    #[test]
    fn fits_start_at_hard_stops_where_the_motion_shows_blows() {
        let scales = |struck| Scales {
            centre: 0.1,
            reach: 0.2,
            speed: 1.0,
            force: 4.0,
            mass: 0.5,
            free_mass: 0.5,
            input: 2.0,
            largest_input: 5.0,
            noise: 1e-3,
            struck,
            held: 0.0,
            pace: 1.0,
        };
        let end = |place: f64| Struck {
            place,
            speed: 0.8,
            restitution: 0.6,
            within: 0.02,
        };
        assert!(KIND.suggested(&scales([None; 2])).is_empty());
        let both = KIND.suggested(&scales([Some(end(-0.1)), Some(end(0.3))]));
        let one = KIND.suggested(&scales([None, Some(end(0.3))]));
        for p in both.iter().chain(&one) {
            assert!(EndStop.is_itself(&scales([None; 2]), p), "{p:?}");
            let e = EndStop.restitution(0.5, p);
            assert!((e - 0.6).abs() < 1e-3, "{e}");
            assert!((0.27..0.3).contains(&p[1]), "{p:?}");
        }
        assert!(both.iter().all(|p| (-0.1..-0.07).contains(&p[0])));
        assert!(one.iter().all(|p| p[0] == f64::NEG_INFINITY));
        // Harder still it is the same stop, nearer to its place.
        let harder = EndStop.harder(&scales([None, Some(end(0.3))]), &one[0], 4.0);
        assert!((EndStop.restitution(0.5, &harder) - 0.6).abs() < 1e-3);
        assert!((0.3 - harder[1] - 0.25 * (0.3 - one[0][1])).abs() < 1e-4);
        assert_eq!(
            (harder[0], harder[2]),
            (f64::NEG_INFINITY, 16.0 * one[0][2])
        );
        // From the place of the harder one a body of 0.8 m/s is back with 0.48 m/s when it would be from the rigid one.
        let p = &one[0];
        let (strikes, lasts) = ((0.3 - p[1]) / 0.8, (0.3 - p[1]) / 0.48);
        let lasting = std::f64::consts::PI * (0.5 / p[2]).sqrt();
        assert!((strikes + lasts - lasting).abs() < 1e-12);
    }

    #[test]
    fn a_side_without_a_stop_has_no_force_and_no_derivative() {
        let one_sided = [f64::NEG_INFINITY, 0.3, K, 10.0];
        assert_eq!(EndStop.places(&one_sided), [None, Some(0.3)]);
        let Action::Joint(law) = KIND.action else {
            unreachable!()
        };
        let mut by = [f64::NAN; 4];
        let at = law.derivatives(-1e6, -1.0, &one_sided, 1e-3, &mut by);
        assert_eq!((at.force, at.by_q, at.by_v, by), (0.0, 0.0, 0.0, [0.0; 4]));
        let at = law.derivatives(0.3001, 0.2, &one_sided, 1e-3, &mut by);
        assert!(at.force < 0.0 && by[0] == 0.0 && by[1] > 0.0 && by[3] < 0.0);
    }
}
