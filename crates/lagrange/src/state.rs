//! The configuration manifold: what can be done with q as a whole, whatever its coordinates are.
//!
//! A list of [`Coordinate`]s says what q and v are made of. A coordinate of one number adds: q ⊕ Δ = q + Δ. A pose (position p and
//! unit quaternion, rotation R) moves by a twist Δ = (v, ω) in the moved body's axes, as a body does that keeps this velocity for
//! a unit of time: p ⊕ Δ = p + R V(ω) v and R ⊕ Δ = R exp(ω×), with V = ∫₀¹ exp(s ω×) ds.
//!
//! ```
//! use lagrange::{Coordinate, state};
//!
//! let base = Coordinate { name: "base".into(), joint: "base".into(), angular: false, wraps: false, floating: true };
//! let hinge = Coordinate { name: "hinge".into(), joint: "hinge".into(), angular: true, wraps: true, floating: false };
//! let coordinates = [base, hinge];
//! let q = state::neutral(&coordinates);
//! assert_eq!(q, [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0]);
//!
//! // Half a circle of radius 1 to the left in the plane z = 0, and the hinge by 0.1 rad.
//! let pi = std::f64::consts::PI;
//! let moved = state::integrate(&coordinates, &q, &[pi, 0.0, 0.0, 0.0, 0.0, pi, 0.1])?;
//! assert!(moved[0].abs() < 1e-15 && (moved[1] - 2.0).abs() < 1e-15 && (moved[6] - 1.0).abs() < 1e-15);
//! let back = state::difference(&coordinates, &moved, &q)?;
//! assert!((back[0] + pi).abs() < 1e-12 && (back[6] + 0.1).abs() < 1e-15);
//! # Ok::<(), lagrange::Error>(())
//! ```

use std::f64::consts::{PI, TAU};

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use crate::{Coordinate, Error};

/// Length of q.
pub fn nq(coordinates: &[Coordinate]) -> usize {
    coordinates.iter().map(Coordinate::nq).sum()
}

/// Length of v: the degrees of freedom.
pub fn nv(coordinates: &[Coordinate]) -> usize {
    coordinates.iter().map(Coordinate::nv).sum()
}

/// The configuration of all zeros, with quaternions 1 0 0 0.
pub fn neutral(coordinates: &[Coordinate]) -> Vec<f64> {
    let mut q = vec![0.0; nq(coordinates)];
    neutral_into(coordinates, &mut q);
    q
}

/// [`neutral`] without taking memory.
///
/// # Panics
/// When `out` is not as long as q.
pub fn neutral_into(coordinates: &[Coordinate], out: &mut [f64]) {
    assert_eq!(out.len(), nq(coordinates), "length of q");
    out.fill(0.0);
    for (at, _) in starts(coordinates).filter(|(_, c)| c.floating) {
        out[at.q + 3] = 1.0;
    }
}

/// q ⊕ Δ, with Δ = v·dt or any other small or large motion: one-coordinate entries add (angles are not wrapped), poses move by the
/// twist Δ, and their quaternions become of length 1.
///
/// # Errors
/// When a slice has the wrong length or an entry that is not finite.
pub fn integrate(coordinates: &[Coordinate], q: &[f64], motion: &[f64]) -> Result<Vec<f64>, Error> {
    check("q", q, nq(coordinates))?;
    check("motion", motion, nv(coordinates))?;
    let mut out = vec![0.0; q.len()];
    integrate_into(coordinates, q, motion, &mut out);
    Ok(out)
}

/// [`integrate`] without checks and without taking memory.
///
/// # Panics
/// When a slice has the wrong length.
pub fn integrate_into(coordinates: &[Coordinate], q: &[f64], motion: &[f64], out: &mut [f64]) {
    assert_eq!(q.len(), nq(coordinates), "length of q");
    assert_eq!(motion.len(), nv(coordinates), "length of the motion");
    assert_eq!(out.len(), q.len(), "length of the result");
    for (at, coordinate) in starts(coordinates) {
        if !coordinate.floating {
            out[at.q] = q[at.q] + motion[at.v];
            continue;
        }
        let (position, turn) = pose(&q[at.q..]);
        let (v, w) = twist(&motion[at.v..]);
        let moved = position + turn * swept(&w, &v);
        write_pose(&moved, turn * exponential(&w), &mut out[at.q..]);
    }
}

/// The motion Δ that takes `from` to `to`: from ⊕ Δ = to, by the short way round. Coordinates that wrap differ by an angle in
/// [−π, π], and so do poses turn by at most π.
///
/// # Errors
/// When a slice has the wrong length or an entry that is not finite.
pub fn difference(coordinates: &[Coordinate], from: &[f64], to: &[f64]) -> Result<Vec<f64>, Error> {
    check("from", from, nq(coordinates))?;
    check("to", to, nq(coordinates))?;
    let mut out = vec![0.0; nv(coordinates)];
    difference_into(coordinates, from, to, &mut out);
    Ok(out)
}

/// [`difference`] without checks and without taking memory.
///
/// # Panics
/// When a slice has the wrong length.
pub fn difference_into(coordinates: &[Coordinate], from: &[f64], to: &[f64], out: &mut [f64]) {
    assert_eq!(from.len(), nq(coordinates), "length of the first q");
    assert_eq!(to.len(), from.len(), "length of the second q");
    assert_eq!(out.len(), nv(coordinates), "length of the result");
    for (at, coordinate) in starts(coordinates) {
        if !coordinate.floating {
            let apart = to[at.q] - from[at.q];
            out[at.v] = if coordinate.wraps {
                short_way(apart)
            } else {
                apart
            };
            continue;
        }
        let (p, turn) = pose(&from[at.q..]);
        let (to_p, to_turn) = pose(&to[at.q..]);
        let w = logarithm(&(turn.inverse() * to_turn));
        let v = unswept(&w, &(turn.inverse() * (to_p - p)));
        out[at.v..at.v + 3].copy_from_slice(v.as_slice());
        out[at.v + 3..at.v + 6].copy_from_slice(w.as_slice());
    }
}

/// q̇ at the velocity `v`: v itself, and for a pose ṗ = R v and the quaternion's rate ½ (quaternion) ∘ (0, ω). The quaternion is
/// taken as it stands.
///
/// # Errors
/// When a slice has the wrong length or an entry that is not finite.
pub fn position_rate(coordinates: &[Coordinate], q: &[f64], v: &[f64]) -> Result<Vec<f64>, Error> {
    check("q", q, nq(coordinates))?;
    check("v", v, nv(coordinates))?;
    let mut out = vec![0.0; q.len()];
    position_rate_into(coordinates, q, v, &mut out);
    Ok(out)
}

/// [`position_rate`] without checks and without taking memory.
///
/// # Panics
/// When a slice has the wrong length.
pub fn position_rate_into(coordinates: &[Coordinate], q: &[f64], v: &[f64], out: &mut [f64]) {
    assert_eq!(q.len(), nq(coordinates), "length of q");
    assert_eq!(v.len(), nv(coordinates), "length of v");
    assert_eq!(out.len(), q.len(), "length of the result");
    for (at, coordinate) in starts(coordinates) {
        if !coordinate.floating {
            out[at.q] = v[at.v];
            continue;
        }
        let quaternion = quaternion(&q[at.q..]);
        let (v, w) = twist(&v[at.v..]);
        let turn = UnitQuaternion::new_unchecked(quaternion);
        let rate = quaternion * Quaternion::from_imag(w) * 0.5;
        write_quaternion(&(turn * v), &rate, &mut out[at.q..]);
    }
}

/// Makes the quaternions of length 1; one that is zero or not finite becomes 1 0 0 0.
///
/// # Panics
/// When `q` has the wrong length.
pub fn normalize(coordinates: &[Coordinate], q: &mut [f64]) {
    assert_eq!(q.len(), nq(coordinates), "length of q");
    for (at, _) in starts(coordinates).filter(|(_, c)| c.floating) {
        let (p, turn) = pose(&q[at.q..]);
        write_quaternion(&p, &turn, &mut q[at.q..]);
    }
}

/// That every quaternion in `q` is of length 1 to 1e-6; `q` is long enough.
///
/// # Errors
/// [`Error::NotUnit`] for the first that is not.
pub fn check_unit(coordinates: &[Coordinate], q: &[f64]) -> Result<(), Error> {
    let mut first = 0;
    for coordinate in coordinates {
        if coordinate.floating
            && let Some(quaternion) = q.get(first + 3..first + 7)
        {
            let length = quaternion.iter().map(|x| x * x).sum::<f64>().sqrt();
            let index = first + 3;
            if length.is_nan() || (length - 1.0).abs() > 1e-6 {
                return Err(Error::NotUnit { index, length });
            }
        }
        first += coordinate.nq();
    }
    Ok(())
}

/// A configuration at random, from numbers that `uniform` draws evenly from [0, 1): angles from [−π, π), displacements and
/// positions from [−1, 1) m, and every orientation as likely as any other.
///
/// ```
/// use lagrange::{Coordinate, state};
///
/// let hinge = Coordinate { name: "hinge".into(), joint: "hinge".into(), angular: true, wraps: true, floating: false };
/// let mut draws = [0.75].into_iter();
/// let q = state::random(&[hinge], || draws.next().unwrap_or(0.5));
/// assert_eq!(q, [std::f64::consts::FRAC_PI_2]);
/// ```
pub fn random(coordinates: &[Coordinate], mut uniform: impl FnMut() -> f64) -> Vec<f64> {
    let mut q = vec![0.0; nq(coordinates)];
    for (at, coordinate) in starts(coordinates) {
        if !coordinate.floating {
            let range = if coordinate.angular { PI } else { 1.0 };
            q[at.q] = range * (2.0 * uniform() - 1.0);
            continue;
        }
        let p = Vector3::from_fn(|_, _| 2.0 * uniform() - 1.0);
        // Two angles, and the share of the length that each of their planes has.
        let (share, first, second) = (uniform(), TAU * uniform(), TAU * uniform());
        let ((a, b), (c, d)) = (first.sin_cos(), second.sin_cos());
        let (r, s) = ((1.0 - share).sqrt(), share.sqrt());
        let turn = Quaternion::new(s * d, r * a, r * b, s * c);
        write_quaternion(&p, &unit(turn), &mut q[at.q..]);
    }
    q
}

/// First indices of a coordinate in q and in v.
#[derive(Clone, Copy)]
struct Start {
    q: usize,
    v: usize,
}

fn starts(coordinates: &[Coordinate]) -> impl Iterator<Item = (Start, &Coordinate)> {
    let mut next = Start { q: 0, v: 0 };
    coordinates.iter().map(move |coordinate| {
        let here = next;
        next.q += coordinate.nq();
        next.v += coordinate.nv();
        (here, coordinate)
    })
}

fn check(what: &'static str, x: &[f64], expected: usize) -> Result<(), Error> {
    if x.len() != expected {
        return Err(Error::Dimension {
            what,
            found: x.len(),
            expected,
        });
    }
    match x.iter().position(|x| !x.is_finite()) {
        Some(index) => Err(Error::NotFinite {
            what,
            index,
            value: x[index],
        }),
        None => Ok(()),
    }
}

/// The quaternion of a pose, as it stands.
fn quaternion(q: &[f64]) -> Quaternion<f64> {
    Quaternion::new(q[3], q[4], q[5], q[6])
}

/// Position and orientation, of length 1.
fn pose(q: &[f64]) -> (Vector3<f64>, UnitQuaternion<f64>) {
    (Vector3::new(q[0], q[1], q[2]), unit(quaternion(q)))
}

/// Linear and angular part.
fn twist(v: &[f64]) -> (Vector3<f64>, Vector3<f64>) {
    (
        Vector3::new(v[0], v[1], v[2]),
        Vector3::new(v[3], v[4], v[5]),
    )
}

fn write_pose(p: &Vector3<f64>, turn: UnitQuaternion<f64>, out: &mut [f64]) {
    write_quaternion(p, &unit(turn.into_inner()), out);
}

fn write_quaternion(p: &Vector3<f64>, turn: &Quaternion<f64>, out: &mut [f64]) {
    out[..7].copy_from_slice(&[p.x, p.y, p.z, turn.w, turn.i, turn.j, turn.k]);
}

/// Divided by its length; 1 0 0 0 where there is none.
fn unit(quaternion: Quaternion<f64>) -> UnitQuaternion<f64> {
    // By the largest entry first: the length neither overflows nor vanishes.
    let largest = quaternion.coords.amax();
    if largest > 0.0 && quaternion.coords.iter().all(|x| x.is_finite()) {
        let scaled = quaternion / largest;
        UnitQuaternion::new_unchecked(scaled / scaled.norm())
    } else {
        UnitQuaternion::identity()
    }
}

/// The angle in [−π, π] that is `angle` but for whole turns.
fn short_way(angle: f64) -> f64 {
    if angle.abs() <= PI {
        return angle;
    }
    angle - TAU * (angle / TAU).round()
}

/// exp(ω×).
fn exponential(w: &Vector3<f64>) -> UnitQuaternion<f64> {
    let angle = w.norm();
    let (sin, cos) = (0.5 * angle).sin_cos();
    // sin(x/2)/x, which is ½ where x² is below rounding.
    let share = if angle > 1e-8 { sin / angle } else { 0.5 };
    UnitQuaternion::new_unchecked(Quaternion::from_parts(cos, w * share))
}

/// The ω of at most π with exp(ω×) = R.
fn logarithm(turn: &UnitQuaternion<f64>) -> Vector3<f64> {
    // The quaternions ±x are the same rotation; the one with w ≥ 0 turns by at most π.
    let (w, u) = match (turn.w, turn.imag()) {
        (w, u) if w < 0.0 => (-w, -u),
        same => same,
    };
    let sin = u.x.hypot(u.y).hypot(u.z);
    if sin > 0.0 {
        u * (2.0 * sin.atan2(w) / sin)
    } else {
        Vector3::zeros()
    }
}

/// V(ω) v = v + (1 − cos θ)/θ² ω × v + (θ − sin θ)/θ³ ω × (ω × v), with θ = |ω|.
fn swept(w: &Vector3<f64>, v: &Vector3<f64>) -> Vector3<f64> {
    let angle = w.norm();
    let (a, b) = if angle < 1e-2 {
        let x = angle * angle;
        (
            0.5 - x / 24.0 * (1.0 - x / 30.0 * (1.0 - x / 56.0)),
            1.0 / 6.0 - x / 120.0 * (1.0 - x / 42.0 * (1.0 - x / 72.0)),
        )
    } else {
        let half = (0.5 * angle).sin() / angle;
        (2.0 * half * half, (angle - angle.sin()) / angle.powi(3))
    };
    let wv = w.cross(v);
    v + wv * a + w.cross(&wv) * b
}

/// V(ω)⁻¹ p = p − ½ ω × p + (1 − θ/2 cot θ/2)/θ² ω × (ω × p), for θ = |ω| of at most π.
fn unswept(w: &Vector3<f64>, p: &Vector3<f64>) -> Vector3<f64> {
    let angle = w.norm();
    let c = if angle < 1e-2 {
        let x = angle * angle;
        1.0 / 12.0 + x / 720.0 * (1.0 + x / 42.0 * (1.0 + x / 40.0))
    } else {
        let (sin, cos) = (0.5 * angle).sin_cos();
        (1.0 - 0.5 * angle * cos / sin) / (angle * angle)
    };
    let wp = w.cross(p);
    p - wp * 0.5 + w.cross(&wp) * c
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use proptest::collection::vec;
    use proptest::prelude::*;

    /// A slider, a pose, a hinge that wraps, another pose.
    fn coordinates() -> Vec<Coordinate> {
        let new = |name: &str, angular: bool, wraps: bool, floating: bool| Coordinate {
            name: name.into(),
            joint: name.into(),
            angular,
            wraps,
            floating,
        };
        vec![
            new("slider", false, false, false),
            new("base", false, false, true),
            new("hinge", true, true, false),
            new("drone", false, false, true),
        ]
    }

    fn configuration() -> impl Strategy<Value = Vec<f64>> {
        vec(0.0..1.0, 14).prop_map(|draws| {
            let mut draws = draws.into_iter();
            random(&coordinates(), || draws.next().unwrap_or(0.5))
        })
    }

    fn length(quaternion: &[f64]) -> f64 {
        quaternion.iter().map(|x| x * x).sum::<f64>().sqrt()
    }

    #[test]
    fn half_a_turn_has_a_difference_and_small_turns_keep_their_digits() {
        let coordinates = &coordinates()[1..2];
        let q = neutral(coordinates);
        for size in [
            PI, 3.0, 1.0, 1.01e-2, 0.99e-2, 1e-4, 1e-8, 1e-12, 1e-200, 0.0,
        ] {
            let w = Vector3::new(0.6, -0.64, 0.48) * size;
            let motion = [1.0, -2.0, 0.5, w.x, w.y, w.z];
            let moved = integrate(coordinates, &q, &motion).unwrap();
            let found = difference(coordinates, &q, &moved).unwrap();
            let sign = if found[3] * w.x < 0.0 { -1.0 } else { 1.0 }; // half a turn is both
            assert_relative_eq!(
                Vector3::from_column_slice(&found[3..]) * sign,
                w,
                max_relative = 1e-14
            );
            if size < PI {
                let v = Vector3::from_column_slice(&found[..3]);
                assert_relative_eq!(v, Vector3::new(1.0, -2.0, 0.5), max_relative = 1e-14);
            }
        }
    }

    #[test]
    fn angles_that_wrap_differ_by_the_short_way_round() {
        let coordinates = &coordinates()[2..3];
        let apart = |a: f64, b: f64| difference(coordinates, &[a], &[b]).unwrap()[0];
        assert_relative_eq!(apart(3.0, -3.0), TAU - 6.0, max_relative = 1e-15);
        assert_relative_eq!(apart(0.1, 7.0 * TAU), -0.1, max_relative = 1e-13);
        assert_eq!(apart(-1.0, 1.0), 2.0);
    }

    #[test]
    fn broken_quaternions_become_the_neutral_one_and_long_ones_short() {
        let coordinates = &coordinates()[1..2];
        for (given, expected) in [
            ([0.0; 4], [1.0, 0.0, 0.0, 0.0]),
            ([f64::NAN, 0.0, 0.0, 1.0], [1.0, 0.0, 0.0, 0.0]),
            ([0.0, 3e300, 0.0, 4e300], [0.0, 0.6, 0.0, 0.8]),
            ([0.0, 3e-300, 0.0, -4e-300], [0.0, 0.6, 0.0, -0.8]),
        ] {
            let mut q = [1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 0.0];
            q[3..].copy_from_slice(&given);
            normalize(coordinates, &mut q);
            assert_eq!(q[..3], [1.0, 2.0, 3.0]);
            for (found, expected) in q[3..].iter().zip(expected) {
                assert_relative_eq!(*found, expected, max_relative = 1e-15);
            }
        }
    }

    #[test]
    fn wrong_lengths_and_infinite_numbers_are_typed_errors() {
        let coordinates = coordinates();
        let q = neutral(&coordinates);
        let found = integrate(&coordinates, &q, &[0.0; 3]).unwrap_err();
        assert_eq!(
            found.to_string(),
            "motion has 3 entries, this mechanism takes 14"
        );
        let mut to = q.clone();
        to[2] = f64::INFINITY;
        assert!(matches!(
            difference(&coordinates, &q, &to),
            Err(Error::NotFinite {
                what: "to",
                index: 2,
                ..
            })
        ));
    }

    #[test]
    fn random_orientations_have_no_direction() {
        // Van der Corput's numbers in three bases: evenly spread.
        let van_der_corput = |mut i: u32, base: u32| {
            let (mut x, mut digit) = (0.0, 1.0);
            while i > 0 {
                digit /= f64::from(base);
                x += digit * f64::from(i % base);
                i /= base;
            }
            x
        };
        let coordinates = &coordinates()[1..2];
        let count = 4096;
        let mut mean = nalgebra::Matrix3::zeros();
        for i in 0..count {
            let mut draws = [0.5, 0.5, 0.5]
                .into_iter()
                .chain([2, 3, 5].map(|b| van_der_corput(i, b)));
            let q = random(coordinates, || draws.next().unwrap_or(0.5));
            let (_, turn) = pose(&q);
            mean += turn.to_rotation_matrix().into_inner() / f64::from(count);
        }
        assert!(mean.amax() < 5e-3, "{mean}");
    }

    proptest! {
        #[test]
        fn the_difference_takes_one_configuration_to_the_other(from in configuration(), to in configuration()) {
            let coordinates = coordinates();
            let motion = difference(&coordinates, &from, &to).unwrap();
            let found = integrate(&coordinates, &from, &motion).unwrap();
            let missed = difference(&coordinates, &found, &to).unwrap();
            // Near half a turn V⁻¹ is still well-conditioned: its norm is at most π/2.
            prop_assert!(missed.iter().all(|x| x.abs() < 2e-14), "{missed:?}");
        }

        #[test]
        fn a_motion_below_half_a_turn_is_found_again(q in configuration(), motion in vec(-1.7..1.7, 14)) {
            let coordinates = coordinates();
            let moved = integrate(&coordinates, &q, &motion).unwrap();
            let found = difference(&coordinates, &q, &moved).unwrap();
            for (found, given) in found.iter().zip(&motion) {
                prop_assert!((found - given).abs() < 2e-14, "{found} {given}");
            }
        }

        #[test]
        fn quaternions_stay_of_length_one(q in configuration(), motion in vec(-4.0..4.0, 14)) {
            let coordinates = coordinates();
            let mut q = q;
            for _ in 0..50 {
                q = integrate(&coordinates, &q, &motion).unwrap();
                prop_assert!((length(&q[4..8]) - 1.0).abs() <= 1e-15);
                prop_assert!((length(&q[12..]) - 1.0).abs() <= 1e-15);
            }
        }

        #[test]
        fn a_constant_velocity_is_followed_as_by_small_steps_of_the_rate(q in configuration(), v in vec(-2.0..2.0, 14)) {
            let coordinates = coordinates();
            let whole = integrate(&coordinates, &q, &v).unwrap();
            let rate = |q: &[f64]| position_rate(&coordinates, q, &v).unwrap();
            let along = |q: &[f64], k: &[f64], h: f64| -> Vec<f64> {
                q.iter().zip(k).map(|(q, k)| q + h * k).collect()
            };
            let (steps, mut x) = (400, q.clone());
            let h = 1.0 / f64::from(steps);
            for _ in 0..steps {
                let a = rate(&x);
                let b = rate(&along(&x, &a, 0.5 * h));
                let c = rate(&along(&x, &b, 0.5 * h));
                let d = rate(&along(&x, &c, h));
                for i in 0..x.len() {
                    x[i] += h / 6.0 * (a[i] + 2.0 * (b[i] + c[i]) + d[i]);
                }
            }
            for (found, expected) in whole.iter().zip(&x) {
                prop_assert!((found - expected).abs() < 1e-9, "{found} {expected}");
            }
        }
    }
}
