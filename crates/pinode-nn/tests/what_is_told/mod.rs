//! What a diagnosis tells of logs that no constant law explains, or that hold a mistake of who recorded them. The logs come from an
//! integrator of their own here, of a pendulum's closed form.

mod axes;
mod balanced;
mod carts;
mod clocks;
mod coupled;
mod drives;
mod duals;
mod exact;
mod hidden;
mod inertias;
mod known;
mod late_or_slow;
mod paces;
mod payload;
mod pendulum;
mod resting;
mod ringing;
mod short;
mod sticking;
mod walls;

use pinode_nn::diagnose::verdict::Verdict;

use pinode_nn::log::Log;

use pendulum::*;

/// As one of a motion that is a thousand times as slow it may be meant too; the model says that it is not.
#[test]
fn milliseconds_for_seconds_are_read_as_milliseconds() {
    let law = |_, [_, v]: [f64; 2], u| u - VISCOUS * v - 0.05 * v * v.abs();
    let mut log = log(6, law);
    log.runs[0].t.iter_mut().for_each(|t| *t *= 1000.0);
    let found = diagnosed(&model(false), log);
    let fault = found.data_faults.iter().find(|f| f.kind == "convention");
    let fault = fault.unwrap_or_else(|| panic!("{:?}", found.data_faults));
    assert_eq!(fault.column, "t");
    assert!(fault.detail.contains("is in ms"), "{}", fault.detail);
    let [effect] = found.effects.as_slice() else {
        panic!("{:?}", found.effects);
    };
    assert_eq!(effect.kind, "quadratic_drag");
    let coefficient = &effect.parameters["coefficient"];
    assert!(
        (coefficient.value - 0.05).abs() < 4.0 * coefficient.std.unwrap(),
        "{coefficient:?}"
    );
}

/// A second log of another day, which has its own SHA.
fn of_another_day(mut log: Log) -> Log {
    log.sha256 = "another".into();
    log
}

#[test]
fn a_name_that_another_day_contradicts_is_said_with_what_it_is_there() {
    const STIFFNESS: f64 = 0.2;
    let with_spring = log_of_swings(1, |_, [q, v], u| u - VISCOUS * v - STIFFNESS * q);
    let without = log_of_swings(2, |_, [_, v], u| u - VISCOUS * v);
    let found = diagnosed_beside(&model(false), with_spring, &[of_another_day(without)]);
    assert!(found.effects.is_empty(), "{:?}", found.effects);
    let told = |words: &str| advises(&found, words);
    assert!(
        told("linear spring on `phi` explains"),
        "{:?}",
        found.advice
    );
    assert!(
        told("the part held out contradicts it: there it is"),
        "{:?}",
        found.advice
    );
}

#[test]
fn two_delays_of_two_days_are_both_said() {
    let late = |by: f64| move |t: f64| 0.5 * torque(((t - by).max(0.0) / 0.02).floor() * 0.02);
    let day =
        |seed: u64, by: f64| log_of_swings(seed, move |t, [_, v], _| late(by)(t) - VISCOUS * v);
    let found = diagnosed_beside(&model(false), day(1, 0.08), &[of_another_day(day(2, 0.02))]);
    let said = found.advice.iter().find(|a| a.contains("contradicts it"));
    let said = said.unwrap_or_else(|| panic!("{:?} {:?}", found.verdict, found.advice));
    for (behind, delay) in [("`delay` = ", 0.08), ("there it is ", 0.02)] {
        let number = said.split(behind).nth(1).and_then(|s| s.split(' ').next());
        let number: f64 = number.unwrap().parse().unwrap();
        assert!((number - delay).abs() < 2e-3, "{said}");
    }
    assert!(!said.contains("  "), "{said}");
}

#[test]
fn an_input_of_the_wrong_sign_is_said_to_count_the_other_way_round() {
    let found = diagnosed(&model(false), log(1, |_, [_, v], u| -u - VISCOUS * v));
    let [fault] = found.data_faults.as_slice() else {
        panic!("{:?}", found.data_faults);
    };
    assert_eq!(
        (fault.kind.as_str(), fault.column.as_str()),
        ("convention", "u.motor")
    );
    assert_eq!(found.verdict, Verdict::DataFault);
    assert!(found.gap.after < 3.0, "{:?}", found.gap);
}

/// No sign makes up for a motor that is turned round and has a third of its strength: that is an effect, and the advice asks for the sign.
#[test]
fn a_weak_input_of_the_wrong_sign_is_said_to_be_reversed() {
    let found = diagnosed(&model(false), log(1, |_, [_, v], u| -0.3 * u - VISCOUS * v));
    let [effect] = found.effects.as_slice() else {
        panic!("{:?}", found.effects);
    };
    assert_eq!(effect.kind, "input_gain_error");
    let gain = effect.parameters["gain"].value;
    assert!((gain + 1.3).abs() < 0.02, "{gain}");
    assert!(advises(&found, "the other way round"), "{:?}", found.advice);
    assert!(found.gap.after < 3.0, "{:?}", found.gap);
}

#[test]
fn a_motor_that_weakens_is_said_to_change_with_time() {
    let weaker = |t: f64| 1.0 - 0.3 * t / 60.0;
    let found = diagnosed(
        &model(true),
        log_of_swings(2, |t, [_, v], u| weaker(t) * u - VISCOUS * v),
    );
    let change = found
        .change
        .as_ref()
        .unwrap_or_else(|| panic!("{:?}", found.advice));
    assert!(change.name.contains("gain"), "{change:?}");
    // It weakens: the gain error, or the gain, is higher before than after, by half of what it loses over the fitted 45 s.
    let loss = change.before - change.after;
    assert!((0.06..0.2).contains(&loss), "{change:?}");
    assert!((10.0..35.0).contains(&change.t), "{change:?}");
    assert!(
        advises(&found, "not one number over the log"),
        "{:?}",
        found.advice
    );
}

#[test]
fn what_stays_the_same_is_not_said_to_change() {
    let found = diagnosed(&model(false), log(3, |_, [_, v], u| 0.8 * u - VISCOUS * v));
    assert_eq!(found.change, None);
    assert_eq!(found.verdict, Verdict::EffectsFound);
}

#[test]
fn friction_that_warms_up_does_not_end_with_nothing_missing() {
    // The model's own friction moves to the mean of it, which serves the last quarter worse than what was given.
    let extra = |t: f64| 0.04 * (-t / 15.0).exp();
    let found = diagnosed(
        &model(false),
        log(4, |t, [_, v], u| u - (VISCOUS + extra(t)) * v),
    );
    assert_ne!(found.verdict, Verdict::NothingMissing, "{:?}", found.gap);
    assert!(
        advises(&found, "free runs over data that no fit has seen"),
        "{:?}",
        found.advice
    );
}

#[test]
fn known_friction_that_moves_far_is_said() {
    let found = diagnosed(&model(false), log(5, |_, [_, v], u| u - 0.03 * v));
    assert_eq!(found.verdict, Verdict::NothingMissing);
    assert!(
        advises(&found, "without `fixed = true`"),
        "{:?}",
        found.advice
    );
}

#[test]
fn a_stop_that_gives_for_a_sixth_of_a_second_is_a_stop() {
    // π √(m l²/k) = 0.172 s
    let (place, stiffness) = (0.1, 16.7);
    let pushes = |q: f64| -stiffness * (q - place).max(0.0);
    // What goes round has no ends: here it does not, by a motor of 0.4 times the torque.
    let swings = text(false)
        .replace(" angles = [\"phi\"],", "")
        .replace("name = \"motor\"", "name = \"motor\"\ngain = 0.4");
    let found = diagnosed(
        &parsed(&swings),
        log(7, |_, [q, v], u| 0.4 * u - VISCOUS * v + pushes(q)),
    );
    let [stop] = found.effects.as_slice() else {
        panic!("{:?}", found.effects);
    };
    assert_eq!(stop.kind, "end_stop");
    let value = |name: &str| stop.parameters[name].value;
    assert!((value("upper") - place).abs() < 2e-3, "{stop:?}");
    assert!(
        (value("stiffness") / stiffness - 1.0).abs() < 0.02,
        "{stop:?}"
    );
}

/// Drag of the second power, of a pendulum that swings out from 30 s on: in the last quarter there is next to none.
#[test]
fn what_is_held_out_at_rest_is_said_to_bear_nothing_out() {
    const DRIVEN_S: f64 = 29.99;
    let law = |t: f64, [_, v]: [f64; 2], u: f64| {
        let torque = if t < DRIVEN_S { u } else { 0.0 };
        torque - VISCOUS * v - 2e-3 * v * v.abs()
    };
    let mut log = log(31, law);
    let run = &mut log.runs[0];
    for (t, u) in run.t.iter().zip(&mut run.u[0]) {
        *u = if *t < DRIVEN_S { *u } else { 0.0 };
    }
    let found = diagnosed(&model(true), log);
    assert!(found.effects.is_empty(), "{:?}", found.effects);
    assert_eq!(found.verdict, Verdict::Unexplained);
    let told = found.advice.first().unwrap();
    assert!(
        told.starts_with("quadratic drag on `phi` explains"),
        "{told}"
    );
    assert!(
        told.contains("neither bears it out nor contradicts it"),
        "{told}"
    );
}
