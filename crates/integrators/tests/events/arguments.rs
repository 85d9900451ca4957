//! Frictions that hold nothing, and arguments.

use std::convert::Infallible;

use approx::assert_abs_diff_eq;
use integrators::event::{
    ContactError, Direction, EventRollOutError, EventStepper, Law, Limits, roll_out_events,
};
use integrators::{Ode, Rk4, roll_out};

use super::*;

/// A mass of 1 kg on 40 N/m, 0.3 m from rest: its energy after 3 s, by steps of 1 ms in so many samples.
fn energy_left(law: Law, samples: usize) -> f64 {
    let spring = masses([1.0], |_, q, _| [-40.0 * q[0]]);
    let rolled = motion(
        &spring,
        vec![law],
        (3.0, samples, 3000 / samples),
        &[0.3, 0.0],
    );
    let x = rolled.states.last().unwrap();
    0.5 * x[1] * x[1] + 20.0 * x[0] * x[0]
}

/// Friction that holds nothing at rest and something in motion turns with the motion within a sample too: drag, and the part of Stribeck's
/// curve that rises from 0. It is the same for one sample and for many.
#[test]
fn friction_without_breakaway_opposes_the_motion_whatever_the_samples() {
    type Size = fn(Direction, f64) -> f64;
    let drag: Size = |_, speed| 3.0 * speed * speed;
    let rising: Size = |_, speed| 2.0 * (1.0 - (-(speed / 0.1).powi(2)).exp());
    let viscous: Size = |_, speed| 0.7 * speed;
    for (size, name) in [(drag, "drag"), (rising, "rising"), (viscous, "viscous")] {
        let left = |samples| energy_left(Law::friction(&[1.0], size), samples);
        let (one, many) = (left(1), left(300));
        assert!(one < 1.8, "{name}: {one} J of 1.8 J");
        assert_abs_diff_eq!(one, many, epsilon = 1e-9);
        // The same as a force of the mechanism, which the law is while it slides.
        let smooth = Ode::new(2, move |_t, x: &[f64], _u: &(), dx: &mut [f64]| {
            let against = x[1].signum() * size(Direction::Positive, x[1].abs());
            dx.copy_from_slice(&[x[1], -40.0 * x[0] - against]);
            Ok::<(), Infallible>(())
        });
        let rolled = roll_out(
            &smooth,
            Rk4::default(),
            &[0.0, 3.0],
            &[()],
            30_000,
            &[0.3, 0.0],
        );
        let x = rolled.unwrap().remove(1);
        let expected = 0.5 * x[1] * x[1] + 20.0 * x[0] * x[0];
        assert_abs_diff_eq!(one, expected, epsilon = 1e-5);
    }
}

/// Coulomb's and a viscous force in one law: the formula is below 0 for speeds a little below 0, where only trial steps ask.
#[test]
fn a_friction_that_grows_with_speed_comes_to_rest_in_long_steps() {
    let law = Law::friction(&[1.0], |_: Direction, speed: f64| 0.1 + 5.0 * speed);
    let free = masses([1.0], |_, _, _| [0.0]);
    let rolled = motion(&free, vec![law], (2.0, 1, 40), &[0.0, 1.0]);
    // v̇ = −0.1 − 5 v from 1 m/s: at rest after ln(51)/5 s, at (1 − 0.02 ln 51)/5 m.
    let end = (1.0 - 0.02 * 51.0_f64.ln()) / 5.0;
    assert_abs_diff_eq!(rolled.states[1][0], end, epsilon = 1e-5);
    assert_eq!(rolled.states[1][1], 0.0);
}

#[test]
fn a_start_that_is_none_is_refused_even_for_one_sample() {
    let free = masses([1.0], |_, _, _| [0.0]);
    let refused = |x: &[f64]| {
        let floor = Law::stop(&[1.0], 0.0, 0.5);
        match roll_out_events(&free, vec![floor], &[0.0], &[], 1, x).unwrap_err() {
            EventRollOutError::Contacts { source, .. } => source,
            other => panic!("{other:?}"),
        }
    };
    assert!(matches!(
        refused(&[1.0]),
        ContactError::State {
            found: 1,
            expected: 2
        }
    ));
    assert!(matches!(
        refused(&[1.0, f64::NAN]),
        ContactError::NotFinite { component: 1, .. }
    ));
    assert!(matches!(
        refused(&[-1.0, 0.0]),
        ContactError::Penetration { .. }
    ));
}

/// What a stepper did before does not change what it does from another state.
#[test]
fn a_stepper_that_was_used_steps_as_a_fresh_one() {
    let falling = masses([1.0], |_, _, _| [-9.81]);
    let limits = Limits {
        most_impacts: 5,
        ..Limits::default()
    };
    let fresh = || {
        let stepper = EventStepper::new(&falling, vec![Law::stop(&[1.0], 0.0, 0.5)]);
        stepper.unwrap().with_limits(limits)
    };
    let mut used = fresh();
    let mut x = [0.3, 0.0];
    used.advance(&falling, (0.0, 1.0, 1), &(), &mut x).unwrap();
    used.clear_events();
    let mut other = fresh();
    let (mut a, mut b) = ([0.0, -2.0], [0.0, -2.0]);
    used.advance(&falling, (0.0, 0.01, 1), &(), &mut a).unwrap();
    other
        .advance(&falling, (0.0, 0.01, 1), &(), &mut b)
        .unwrap();
    assert_eq!(a, b);
    assert!(a[1] > 0.8, "it rebounds: {a:?}");
    assert_eq!(used.events(), other.events());
}

/// A ball on the floor to the last digit but one may start; what is clearly behind it may not.
#[test]
fn a_start_behind_a_stop_by_rounding_is_one_on_it() {
    let falling = masses([1.0], |_, _, _| [-9.81]);
    let floor = || vec![Law::stop(&[1.0], 0.0, 0.5)];
    for depth in [1e-17, 1e-13] {
        let rolled = roll_out_events(&falling, floor(), &[0.0, 1.0], &[()], 3, &[-depth, 0.0]);
        assert_eq!(rolled.unwrap().states, vec![vec![0.0, 0.0]; 2]);
        // It strikes at once.
        let struck = motion(&falling, floor(), (0.01, 1, 1), &[-depth, -1.0]);
        assert_eq!(struck.events[0].time, 0.0);
        assert_abs_diff_eq!(struck.states[1][1], 0.5 - 9.81 * 0.01, epsilon = 1e-12);
    }
    let refused = refusal(&falling, floor(), &[-1e-11, 0.0]);
    assert!(matches!(refused, ContactError::Penetration { law: 0, .. }));
    let said = roll_out_events(&falling, floor(), &[0.0, 1.0], &[()], 3, &[-1.0, 0.0]);
    let said = said.unwrap_err().to_string();
    assert!(
        said.contains("the gap of law 0 is -1") && !said.contains("equations"),
        "{said}"
    );
}

/// e = 1/(1 + v m): the blow knows its speed and the mass that the other body, which gives way, leaves of 2 kg.
#[test]
fn a_restitution_of_the_blow_knows_its_speed_and_its_mass() {
    let pair = masses([2.0, 6.0], |_, _, _| [0.0, 0.0]);
    let law = Law::stop(&[-1.0, 1.0], 0.0, 0.0)
        .with_restitution(|strike| 1.0 / (1.0 + strike.speed * strike.mass));
    let rolled = motion(&pair, vec![law], (1.0, 1, 1), &[0.0, 0.4, 1.0, 0.0]);
    // 1/(1/2 + 1/6) = 1.5 kg at 1 m/s; the centre goes on with 1/4 m/s.
    let e = 1.0 / 2.5;
    let [_, _, slow, fast] = rolled.states[1][..] else {
        panic!("{:?}", rolled.states)
    };
    assert_abs_diff_eq!(fast - slow, e, epsilon = 1e-14);
    assert_abs_diff_eq!(2.0 * slow + 6.0 * fast, 2.0, epsilon = 1e-14);

    let wrong = Law::stop(&[-1.0, 1.0], 0.0, 0.0).with_restitution(|_| 1.5);
    let refused = refusal(&pair, vec![wrong], &[0.0, 0.4, 1.0, 0.0]);
    assert!(matches!(
        refused,
        ContactError::Restitution {
            law: 0,
            value: 1.5,
            ..
        }
    ));
}
