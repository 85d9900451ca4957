//! How far residuals exceed the noise of the sensors.

use super::study::{Fitted, Study};
use super::verdict::Gap;
use super::width::is_soft;
use crate::hybrid::{Hybrid, Placed};
use crate::shooting::Channel;

/// Residual over sensor noise beyond which a model does not explain the data: on a displacement, on an angle.
const UNEXPLAINED: (f64, f64) = (1.6, 5.0);

/// A window strays where its residual is so many times that limit. A model whose windows stray in so large a part, and so many of them at least, does
/// not explain the data either: what strikes now and then is not in the middle of the residuals.
const STRAYS: f64 = 5.0;
const OFTEN: f64 = 0.05;
const FEWEST: usize = 3;

/// The limit of the residual of each channel, in the channel's unit.
fn limits(study: &Study, fitted: &Fitted) -> Vec<f64> {
    let (linear, angular) = UNEXPLAINED;
    let coordinates = fitted.hybrid.mechanics().coordinates();
    let channels = study.observations.channels.iter();
    let limit = |channel: &Channel| match coordinates[channel.coordinate].angular {
        true => angular * channel.noise,
        false => linear * channel.noise,
    };
    channels.map(limit).collect()
}

/// The largest residual of a channel over its limit.
fn misfit(study: &Study, fitted: &Fitted) -> f64 {
    let limits = limits(study, fitted).into_iter();
    let sigma = fitted.inside.sigma.iter();
    sigma
        .zip(limits)
        .map(|(sigma, limit)| sigma / limit)
        .fold(0.0, f64::max)
}

/// In how many of the windows, seen and held out, each channel strays from a fitted model; and the number of windows.
fn straying(study: &Study, fitted: &Fitted) -> (Vec<usize>, usize) {
    let windows = || fitted.inside.squares.iter().chain(&fitted.outside.squares);
    let limits = limits(study, fitted).into_iter().enumerate();
    let of_channel = |(c, limit): (usize, f64)| {
        let strays = |(sum, n): (f64, usize)| {
            sum.is_nan() || sum > (STRAYS * limit).powi(2) * n.max(1) as f64
        };
        windows().filter(|window| strays(window[c])).count()
    };
    (limits.map(of_channel).collect(), windows().count())
}

/// Share of the windows, seen and held out, in which each channel strays from a fitted model.
pub fn strays(study: &Study, fitted: &Fitted) -> Vec<f64> {
    let (straying, windows) = straying(study, fitted);
    let share = |count: usize| count as f64 / windows.max(1) as f64;
    straying.into_iter().map(share).collect()
}

/// Whether a residual is larger than its limit, so many times the noise of its sensor, or too many windows stray.
pub fn is_unexplained(study: &Study, fitted: &Fitted) -> bool {
    let (straying, windows) = straying(study, fitted);
    let many = |count: usize| count >= FEWEST && count as f64 > OFTEN * windows as f64;
    misfit(study, fitted) > 1.0 || straying.into_iter().any(many)
}

/// Free runs that err by more noises than the first do not bear a model out, nor do those that err by more than the second and so many times
/// as much as with the constants that were given, and by more than is expected of their starts.
const FAR: f64 = 10.0;
const WORSE: (f64, f64) = (5.0, 1.5);

/// Where something was found, free runs that err by more noises than [`FAR`] and still by this share of what they did say that it is not all: what bounces
/// or tumbles makes up to half of that of the errors of a right model's start.
const STILL: f64 = 0.15;
/// So do those that err by more noises than the first where they, or the fits to the windows, leave more than this share. Where less is left what was found
/// is most of it: no model of a real drive comes down to what a fine encoder resolves.
const ASTRAY: (f64, f64) = (50.0, 0.05);

/// What is within so many times what the noise and their starts make of a right model, to first order, is no sign of a wrong one.
const AS_EXPECTED: f64 = 2.0;

/// … and what is so many times as much is one, where it is known as well as that, and more than this share of what it was is left: the friction of a real drive, in quanta of its encoder, leaves less.
const FAR_FROM_EXPECTED: (f64, f64) = (6.0, 0.01);

/// Whether free runs err by more than the errors of their starts make.
fn is_more_than_expected(gap: &Gap) -> bool {
    // Where it is not known what is expected, all is more.
    gap.after.is_nan() || gap.expected.is_nan() || gap.after > AS_EXPECTED * gap.expected
}

/// Whether free runs over the unseen part contradict a model that the seen one does not.
pub fn is_contradicted(gap: &Gap) -> bool {
    let is_far = gap.after > FAR || (gap.after > WORSE.0 && gap.after > WORSE.1 * gap.before);
    is_far && is_more_than_expected(gap)
}

/// Whether they contradict one with something that was found, which leaves this share of the misfit of the windows.
pub fn is_not_all(gap: &Gap, windows_leave: f64) -> bool {
    let (astray, share) = ASTRAY;
    let leave = gap.after / gap.before;
    // What diverges before and after leaves all.
    let is_more = |leave: f64, share: f64| leave.is_nan() || leave > share;
    let is_far = (gap.after > FAR && is_more(leave, STILL))
        || (gap.after > astray && (is_more(leave, share) || is_more(windows_leave, share)));
    is_far && is_more_than_expected(gap)
}

/// Whether free runs of a model with something that was found, in which nothing sticks, strikes or remembers, err by far more than their starts make: of such a model it is known what that is.
pub fn is_far_from_expected(gap: &Gap, model: &Hybrid) -> bool {
    let is_smooth = |e: &Placed| {
        let sticks = e.kind.dry().is_some() && !is_soft(model, e);
        !sticks && e.kind.stop().is_none() && e.kind.states() == 0
    };
    let (times, share) = FAR_FROM_EXPECTED;
    gap.after > FAR
        && gap.after > times * gap.expected
        && gap.after > share * gap.before
        && model.effects().iter().all(is_smooth)
}

/// The share of the errors of free runs that is explained, on a logarithmic scale, down to what the noise and their starts make: 1 where no more is left.
pub fn explained_of(gap: &Gap) -> f64 {
    let floor = gap.expected.max(1.0);
    share_explained(gap.before / floor, gap.after / floor)
}

/// The share of ln `before` that `after` is less by: 1 where no more than 1 is left.
fn share_explained(before: f64, after: f64) -> f64 {
    if after <= 1.0 {
        1.0
    } else if after < before {
        (before / after).ln() / before.ln()
    } else {
        0.0
    }
}

/// The share of the misfit of `null` that `model` leaves in its windows: 0 where it leaves what is within its limits.
pub fn leaves(study: &Study, null: &Fitted, model: &Fitted) -> f64 {
    let (before, after) = (misfit(study, null), misfit(study, model));
    match after > 1.0 {
        true => after / before,
        false => 0.0,
    }
}

/// The share of the misfit of `null` that `model` explains, on a logarithmic scale: 1 where what is left does not exceed
/// its limits, 0 where nothing is explained. A name for a small part of a large misfit may stand in for what is really missing.
pub fn explained(study: &Study, null: &Fitted, model: &Fitted) -> f64 {
    share_explained(misfit(study, null), misfit(study, model))
}

#[cfg(test)]
mod tests {
    use super::super::candidate::Candidate;
    use super::super::pushes::tests::prepared;
    use super::super::setup::Prepared;
    use super::*;

    fn gap(before: f64, after: f64) -> Gap {
        Gap {
            horizon_s: 0.6,
            windows: 16,
            coordinates: Vec::new(),
            before,
            after,
            expected: 2.0,
            noise_floor: 1.0,
            horizons: Vec::new(),
            regions: Vec::new(),
        }
    }

    #[test]
    fn free_runs_that_became_worse_or_stayed_far_from_the_noise_contradict_a_model() {
        for (before, after, contradicted) in [
            (1.1, 1.1, false),
            (200.0, 4.5, false),
            (5.8, 6.0, false), // estimated starts
            (3.2, 6.0, true),
            (40.7, 120.0, true),
            (416.0, 74.0, true),
        ] {
            let said = is_contradicted(&gap(before, after));
            assert_eq!(said, contradicted, "{before} {after}");
        }
    }

    #[test]
    fn what_is_expected_of_a_right_model_contradicts_none() {
        let unstable = |after: f64, expected: f64| Gap {
            expected,
            ..gap(24.0, after)
        };
        assert!(!is_contradicted(&unstable(24.5, 22.9)));
        assert!(!is_not_all(&unstable(24.5, 22.9), 0.5));
        assert!(is_contradicted(&unstable(60.0, 22.9)));
        // Where nothing is known of it the errors speak.
        assert!(is_contradicted(&unstable(24.5, f64::NAN)));
        assert!(is_not_all(&unstable(24.5, f64::NAN), 0.5));
    }

    /// What is expected is 2.
    #[test]
    fn the_share_of_free_runs_that_is_explained_is_that_of_orders_of_magnitude() {
        for (before, after, share) in [
            (200.0, 20.0, 0.5),
            (200.0, 2.0, 1.0),
            (200.0, 1.5, 1.0),
            (200.0, 200.0, 0.0),
            (200.0, 300.0, 0.0),
        ] {
            let explained = explained_of(&gap(before, after));
            assert!(
                (explained - share).abs() < 1e-12,
                "{before} {after} {explained}"
            );
        }
        let unknown = Gap {
            expected: f64::NAN,
            ..gap(100.0, 10.0)
        };
        assert!(
            (explained_of(&unknown) - 0.5).abs() < 1e-12,
            "down to the noise"
        );
    }

    #[test]
    fn free_runs_far_from_expected_say_that_something_is_left_where_nothing_sticks() {
        let (_dir, Prepared { null, .. }) = prepared(0.0);
        let with = |name: &str, values: &[f64], wider: f64| {
            let candidate = Candidate::named(name, 0);
            let (hybrid, _) = candidate.place(&null.hybrid, &null.inside.theta, values);
            hybrid.with_smoothing_scale(wider)
        };
        let smooth = with("quadratic_drag", &[0.3], 1.0);
        assert!(is_far_from_expected(&gap(1400.0, 27.5), &smooth));
        assert!(
            !is_far_from_expected(&gap(1400.0, 11.5), &smooth),
            "of 2 expected"
        );
        let of_a_real_drive = gap(2.17e6, 1.62e4);
        assert!(!is_far_from_expected(&of_a_real_drive, &smooth));
        let dry = |wider: f64| with("coulomb_friction", &[0.3], wider);
        assert!(
            !is_far_from_expected(&gap(1400.0, 27.5), &dry(1.0)),
            "it sticks"
        );
        assert!(
            is_far_from_expected(&gap(1400.0, 27.5), &dry(30.0)),
            "a film"
        );
        let bristles = with("dahl_friction", &[20.0, 0.3], 1.0);
        assert!(!is_far_from_expected(&gap(1400.0, 27.5), &bristles));
    }

    #[test]
    fn what_was_found_is_not_all_where_free_runs_or_windows_keep_a_part_of_their_errors() {
        for (before, after, windows_leave, not_all) in [
            (258.0, 22.6, 0.0, false),  // an end stop under a cart-pole
            (728.0, 10.1, 0.0, false),  // viscous friction on both joints of an arm
            (3.0, 9.0, 0.0, false),     // little, and within what starts make
            (39.5, 11.0, 0.0, true),    // one of three
            (65.6, 12.6, 0.0, true),    // one of two
            (1440.0, 94.0, 0.0, true),  // a stand-in for a mass that the model has no link for
            (2.6e8, 2.8e5, 0.14, true), // a motor that cannot follow, under feedback
            (f64::INFINITY, f64::INFINITY, 0.0, true),
            (2.17e6, 1.62e4, 0.036, false), // the frictions of a real drive, in quanta of its encoder
        ] {
            let said = is_not_all(&gap(before, after), windows_leave);
            assert_eq!(said, not_all, "{before} {after} {windows_leave}");
        }
    }
}
