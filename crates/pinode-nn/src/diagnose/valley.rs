//! Motors of all sizes that do much the same.
//!
//! Of a drive whose load alone is read a log shows what it swings like, k (1/J + 1/m) and d/k, or for how long a play leaves the motor without force, g J; J by itself shows by what
//! little else depends on it. Iterations creep along that valley, and standard errors take it for straight: so that motors of other sizes are tried, each held while all else is
//! fitted, and what the best of those would move by is a part of the errors (the profile likelihood, Venzon & Moolgavkar, "A method for computing profile-likelihood-based
//! confidence intervals", Applied Statistics 37, 1988).

use std::f64::consts::{PI, TAU};

use super::candidate::Candidate;
use super::found::position;
use super::nuisance::owe;
use super::refine::best;
use super::study::{Fitted, Study};
use crate::effect::{Kind, Motor, ParameterSpec, Quantity};
use crate::hybrid::Placed;

/// Motors by these factors larger and smaller are tried, each as often as one gains so many nats but no more often than so, by fits of so many iterations.
const NEARER: [f64; 2] = [1.3, 1.08];
const MOST: usize = 8;
const WORTH: f64 = 0.5;
const FURTHER: usize = 8;
/// Motors so many times larger and smaller are held, one after the other until the data notice it, by so many nats.
const SIZES: [f64; 5] = [1.02, 1.1, 1.5, 4.0, 20.0];
const NOTICED: f64 = 1.0;
/// What loses more nats than these is too far away to say anything of errors.
const FAR: f64 = 10.0;
/// A motor whose inertia is off by this share of it, one standard error, is not known.
const UNKNOWN: f64 = 0.3;

/// The spring and the damper of a drive, where fits may move them.
fn spring(kind: &Kind) -> impl Iterator<Item = usize> {
    let parameters = kind.parameters.iter().enumerate();
    let of_spring = parameters.filter(|(_, spec)| {
        !spec.held && matches!(spec.quantity, Quantity::Stiffness | Quantity::Damping)
    });
    of_spring.map(|(k, _)| k)
}

/// The play of a drive that has one.
fn gap(kind: &Kind) -> Option<usize> {
    let is_gap = |spec: &ParameterSpec| spec.quantity == Quantity::Displacement;
    kind.parameters.iter().position(is_gap)
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
    let Some(gap) = gap(kind) else {
        return swinging((kind, motor), (p, mass), inertia, &[]);
    };
    let mut other = p.to_vec();
    other[motor.inertia] = inertia;
    other[gap] *= p[motor.inertia] / inertia;
    Some(other)
}

/// A drive of a fitted model that has a motor, and where its constants are in θ.
struct Drive {
    kind: &'static Kind,
    motor: Motor,
    first: usize,
    mass: f64,
}

impl Drive {
    fn of(study: &Study, fitted: &Fitted, drive: &Candidate) -> Option<Self> {
        Some(Drive {
            kind: drive.kind,
            motor: drive.kind.motor()?,
            first: fitted.hybrid.range(position(fitted, drive)?).start,
            mass: drive.scales(&fitted.hybrid, &study.scales).free_mass,
        })
    }

    fn constants<'a>(&self, fitted: &'a Fitted) -> &'a [f64] {
        &fitted.inside.theta[self.first..self.first + self.kind.parameters.len()]
    }

    /// The index of the motor's inertia in θ.
    fn index(&self) -> usize {
        self.first + self.motor.inertia
    }

    fn inertia(&self, fitted: &Fitted) -> f64 {
        fitted.inside.theta[self.index()]
    }

    /// How fast load and motor swing against each other on a spring, rad/s; `None` of a play.
    fn rate(&self, fitted: &Fitted) -> Option<f64> {
        let p = self.constants(fitted);
        let stiffness = self.spring(Quantity::Stiffness)?;
        gap(self.kind)
            .is_none()
            .then(|| (p[stiffness] * self.motor.inverse(self.mass, p)).sqrt())
    }

    /// The index of the stiffness or the damping among the constants.
    fn spring(&self, quantity: Quantity) -> Option<usize> {
        spring(self.kind).find(|&k| self.kind.parameters[k].quantity == quantity)
    }

    /// The best fit with a motor of this `inertia`, from where the drive does much the same.
    fn held_at(&self, study: &Study, fitted: &Fitted, inertia: f64) -> Option<Fitted> {
        let p = self.constants(fitted);
        let other = much_the_same((self.kind, self.motor), (p, self.mass), inertia)?;
        let mut theta = fitted.inside.theta.clone();
        theta[self.first..self.first + p.len()].copy_from_slice(&other);
        let mut hybrid = fitted.hybrid.clone();
        hybrid.constants_mut()[self.index()].tolerance = 0.0;
        Some(study.fit(hybrid, fitted.start(theta), 1, FURTHER))
    }
}

/// A fit with another motor that does much the same: of a load alone a log shows little but what it swings like, and iterations creep along what does the same.
pub fn along_the_valley(study: &Study, fitted: Fitted, drive: &Candidate) -> Fitted {
    let Some(drive) = Drive::of(study, &fitted, drive) else {
        return fitted;
    };
    let is_better = |other: &Fitted, fitted: &Fitted| other.score(0) > fitted.score(0) + WORTH;
    let mut furthest: Option<Fitted> = None;
    for factor in NEARER {
        for _ in 0..MOST {
            let from = furthest.as_ref().unwrap_or(&fitted);
            let own = drive.inertia(from);
            let others = [factor, 1.0 / factor].map(|f| drive.held_at(study, from, f * own));
            match best(others.into_iter().flatten().collect()) {
                Some(better) if is_better(&better, from) => furthest = Some(better),
                _ => break,
            }
        }
    }
    let Some(held) = furthest else {
        return fitted;
    };
    let start = held.start(held.inside.theta.clone());
    let freed = study.fit(fitted.hybrid.clone(), start, 1, FURTHER);
    match is_better(&freed, &fitted) {
        true => freed,
        false => fitted,
    }
}

/// By how much each of the constants that were free may be off, in the order of `inside.free`, because the motors of drives are not known better: what it [owes](owe) to them, by
/// the [nearest](SIZES) motors that the data notice.
pub fn owed(study: &Study, fitted: &Fitted) -> Vec<f64> {
    let mut owed = vec![0.0_f64; fitted.inside.free.len()];
    let effects = fitted.hybrid.effects().iter();
    let drives = effects.map(|placed| Candidate {
        kind: placed.kind,
        target: placed.target,
    });
    let drives = drives.filter_map(|drive| Drive::of(study, fitted, &drive));
    for drive in drives.filter(|drive| fitted.inside.free.contains(&drive.index())) {
        let own = drive.inertia(fitted);
        for larger in [true, false] {
            let mut from: Option<Fitted> = None;
            // What had not come to its end may be passed by what is held.
            let mut top = fitted.score(0);
            for size in SIZES {
                let inertia = if larger { own * size } else { own / size };
                let Some(other) = drive.held_at(study, from.as_ref().unwrap_or(fitted), inertia)
                else {
                    break;
                };
                top = top.max(other.score(0));
                let lost = top - other.score(0);
                if lost < FAR {
                    owe(&mut owed, (fitted, &other), lost);
                }
                if lost > NOTICED || lost.is_nan() {
                    break;
                }
                from = Some(other);
            }
        }
    }
    owed
}

/// Whether a drive of a fitted model swings on its spring no faster than samples can show, half to and fro from one to the next. A play does not swing.
pub fn shows(study: &Study, fitted: &Fitted, drive: &Candidate) -> bool {
    let rate = Drive::of(study, fitted, drive).and_then(|drive| drive.rate(fitted));
    rate.is_none_or(|rate| rate * study.interval < PI)
}

/// What the load of an elastic drive swings like against its motor, and how well that is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Swing {
    /// √(k (1/J + 1/m)) / 2π, Hz, and its standard error.
    pub frequency: (f64, f64),
    /// The damping, of the critical one.
    pub damping: f64,
}

/// What the drive of a fitted model swings like, where the data show little of its motor; `None` of a play, where the sensor is on the motor, and where another inertia than the
/// model's was found.
pub fn swing(study: &Study, fitted: &Fitted, candidate: &Candidate) -> Option<Swing> {
    let drive = Drive::of(study, fitted, candidate)?;
    let changes = |e: &Placed| !e.fixed && e.kind.inertial().is_some();
    if drive.motor.is_read(drive.constants(fitted)) || fitted.hybrid.effects().iter().any(changes) {
        return None;
    }
    let own = drive.inertia(fitted);
    if fitted.standard_error(study, drive.index())? < UNKNOWN * own {
        return None;
    }
    let (stiffness, damping) = (
        drive.spring(Quantity::Stiffness)?,
        drive.spring(Quantity::Damping)?,
    );
    let known = drive.held_at(study, fitted, own)?;
    let p = drive.constants(&known);
    let inverse = drive.motor.inverse(drive.mass, p);
    let rate = drive.rate(&known)?;
    let spread = known.standard_error(study, drive.first + stiffness)? / p[stiffness];
    Some(Swing {
        frequency: (rate / TAU, 0.5 * spread * rate / TAU),
        damping: 0.5 * p[damping] * inverse / rate,
    })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::super::pushes::tests::prepared;
    use super::super::setup::Prepared;
    use super::*;
    use crate::effect::registry;

    /// A delay of a stiff axis had been beside a drive that swung seven times from sample to sample.
    #[test]
    fn what_swings_faster_than_samples_show_is_no_drive() {
        let (_dir, Prepared { study, null, .. }) = prepared(0.0);
        let drive = Candidate::named("elastic_transmission", 0);
        let mass = drive.scales(&null.hybrid, &study.scales).free_mass;
        for (turns, is_shown) in [(0.4, true), (0.6, false)] {
            let rate = TAU * turns / study.interval;
            let inertia = 0.1 * mass;
            let stiffness = rate.powi(2) / (1.0 / inertia + 1.0 / mass);
            let p = [stiffness, 0.0, inertia, 0.0, 0.0, 0.0];
            let (hybrid, theta) = drive.place(&null.hybrid, &null.inside.theta, &p);
            let placed = study.fit(hybrid, null.start(theta), 0, 0);
            assert_eq!(shows(&study, &placed, &drive), is_shown, "{turns}");
        }
    }

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
