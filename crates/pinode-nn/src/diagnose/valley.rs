//! Motors of all sizes that do much the same.
//!
//! Of a drive whose load alone is read a log shows what it swings like, k (1/J + 1/m) and d/k, or for how long a play leaves the motor without force, g J; J by itself shows by what
//! little else depends on it. Iterations creep along that valley, so that motors of other sizes are tried.

use super::candidate::Candidate;
use super::found::position;
use super::refine::best;
use super::study::{Fitted, Study};
use crate::effect::{Kind, Motor, ParameterSpec, Quantity};

/// Motors by these factors larger and smaller are tried, each as often as one gains so many nats but no more often than so, by fits of so many iterations.
const NEARER: [f64; 2] = [1.3, 1.08];
const MOST: usize = 8;
const WORTH: f64 = 0.5;
const FURTHER: usize = 8;

/// The spring and the damper of a drive, where fits may move them.
fn spring(kind: &Kind) -> impl Iterator<Item = usize> {
    let parameters = kind.parameters.iter().enumerate();
    let of_spring = parameters.filter(|(_, spec)| {
        !spec.held && matches!(spec.quantity, Quantity::Stiffness | Quantity::Damping)
    });
    of_spring.map(|(k, _)| k)
}

/// The drive at `p` with another motor, of this `inertia`, that swings as fast and dies away as soon, before a joint that moves `mass`: with the same
/// k (1/J + 1/m) and d/k. `None` where fits leave the spring alone.
pub fn swinging(
    (kind, motor): (&Kind, Motor),
    (p, mass): (&[f64], f64),
    inertia: f64,
    flags: &[(usize, f64)],
) -> Option<Vec<f64>> {
    spring(kind).next()?;
    let mut other = laid_out(p, flags);
    other[motor.inertia] = inertia;
    let times = motor.inverse(mass, p) / motor.inverse(mass, &other);
    spring(kind).for_each(|k| other[k] *= times);
    Some(other)
}

/// The parameters `p` with these values of flags.
pub fn laid_out(p: &[f64], flags: &[(usize, f64)]) -> Vec<f64> {
    let mut p = p.to_vec();
    flags.iter().for_each(|&(flag, yes)| p[flag] = yes);
    p
}

/// The drive at `p` with another motor, of this `inertia`, that does nearly the same: one that [swings](swinging) the same; or of a play, whose motor without force crosses a wider
/// gap in the same time, with the same g J.
fn much_the_same(
    (kind, motor): (&Kind, Motor),
    (p, mass): (&[f64], f64),
    inertia: f64,
) -> Option<Vec<f64>> {
    let gap = |spec: &ParameterSpec| spec.quantity == Quantity::Displacement;
    let Some(gap) = kind.parameters.iter().position(gap) else {
        return swinging((kind, motor), (p, mass), inertia, &[]);
    };
    let mut other = p.to_vec();
    other[motor.inertia] = inertia;
    other[gap] *= p[motor.inertia] / inertia;
    Some(other)
}

/// A fit with another motor that does much the same: of a load alone a log shows little but what it swings like, and iterations creep along what does the same.
pub fn along_the_valley(study: &Study, mut fitted: Fitted, drive: &Candidate) -> Fitted {
    let (kind, Some(motor)) = (drive.kind, drive.kind.motor()) else {
        return fitted;
    };
    let mass = drive.scales(&fitted.hybrid, &study.scales).free_mass;
    let inertia = |fitted: &Fitted| {
        let index = position(fitted, drive)?;
        Some(fitted.inside.theta[fitted.hybrid.range(index).start + motor.inertia])
    };
    let with = |fitted: &Fitted, inertia: f64| {
        let range = fitted.hybrid.range(position(fitted, drive)?);
        let p = &fitted.inside.theta[range.clone()];
        let other = much_the_same((kind, motor), (p, mass), inertia)?;
        let mut theta = fitted.inside.theta.clone();
        theta[range].copy_from_slice(&other);
        Some(study.fit(fitted.hybrid.clone(), fitted.start(theta), 1, FURTHER))
    };
    for factor in NEARER {
        for _ in 0..MOST {
            let Some(own) = inertia(&fitted) else {
                break;
            };
            let others = [factor, 1.0 / factor].map(|factor| with(&fitted, factor * own));
            let better = best(others.into_iter().flatten().collect());
            match better.filter(|other| other.score(0) > fitted.score(0) + WORTH) {
                Some(better) => fitted = better,
                None => break,
            }
        }
    }
    fitted
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::effect::registry;

    /// ω² = k (1/J + 1/m) and d/k stay; of a motor within the mass m is what that leaves.
    #[test]
    fn motors_of_all_sizes_swing_the_same() {
        let kind = registry::find("elastic_transmission").unwrap();
        let motor = kind.motor().unwrap();
        let (p, mass) = ([80.0, 0.4, 0.3, 0.0, 0.0, 0.0], 2.0);
        for within in [0.0, 1.0] {
            let flags = [(motor.within.unwrap(), within)];
            let other = swinging((kind, motor), (&p, mass), 0.7, &flags).unwrap();
            let left = mass - within * 0.7;
            let [before, after] = [
                p[0] * (1.0 / p[2] + 1.0 / mass),
                other[0] * (1.0 / 0.7 + 1.0 / left),
            ];
            assert!((before / after - 1.0).abs() < 1e-12, "{other:?}");
            assert!((other[1] / other[0] - p[1] / p[0]).abs() < 1e-15);
            assert_eq!((other[2], other[4]), (0.7, within));
        }
    }

    #[test]
    fn a_lighter_motor_crosses_a_wider_play_in_the_same_time() {
        let kind = registry::find("backlash").unwrap();
        let motor = kind.motor().unwrap();
        let p = [0.01, 8e3, 5.0, 0.3, 0.0];
        let other = much_the_same((kind, motor), (&p, 2.0), 0.2).unwrap();
        let expected = [0.015, 8e3, 5.0, 0.2, 0.0];
        for (found, expected) in other.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-12, "{other:?}");
        }
    }
}
