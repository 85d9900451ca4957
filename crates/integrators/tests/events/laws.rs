//! Laws that depend on each other, limits, errors.

use approx::assert_abs_diff_eq;
use integrators::event::{
    At, ContactError, Coulomb, Direction, EventStepper, Friction, Law, LawFault, Limits, Masses,
};

use super::*;

#[test]
fn laws_that_say_the_same_hold_together() {
    // Two frictions of 1 N and 2 N on one block hold 3 N; a third law says the same by another vector.
    let moved = |force: f64| {
        let pushed = masses([1.0], move |_, _, _| [force]);
        let laws = vec![
            Law::friction(&[1.0], Coulomb::new(1.0)),
            Law::friction(&[1.0], Coulomb::new(1.5)),
            Law::friction(&[-2.0], Coulomb::new(0.25)),
        ];
        let rolled = motion(&pushed, laws, (1.0, 2, 10), &[0.0, 0.0]);
        rolled.states[2][0]
    };
    assert_eq!(moved(2.99), 0.0);
    assert_eq!(moved(-2.99), 0.0);
    assert_abs_diff_eq!(moved(4.0), 0.5, epsilon = 1e-12);
    assert_abs_diff_eq!(moved(-4.0), -0.5, epsilon = 1e-12);

    // Two equal floors, and a wall on each side with nothing between.
    let falling = masses([1.0, 1.0], |t, _, _| [-9.81, (7.0 * t).sin()]);
    let laws = vec![
        Law::stop(&[1.0, 0.0], 0.0, 0.5),
        Law::stop(&[1.0, 0.0], 0.0, 0.5),
        Law::stop(&[0.0, 1.0], 0.0, 0.5),
        Law::stop(&[0.0, -1.0], 0.0, 0.5),
    ];
    let rolled = motion(&falling, laws, (4.0, 8, 50), &[1.0, 0.0, 0.0, 0.0]);
    assert_eq!(rolled.states[8], [0.0; 4]);
}

#[test]
fn friction_levels_may_depend_on_the_state() {
    // On a strip with friction 1 + x.
    struct Strip;
    impl Friction for Strip {
        fn sliding(&self, _: Direction, _: f64, at: At<'_>) -> f64 {
            1.0 + at.q[0]
        }
    }
    let block = masses([1.0], |_, _, _| [0.0]);
    let rolled = motion(
        &block,
        vec![Law::friction(&[1.0], Strip)],
        (3.0, 3, 500),
        &[0.0, 1.0],
    );
    // v²/2 = 1/2 − x − x²/2: rest where (1 + x)² = 2.
    let end = rolled.states.last().unwrap();
    assert_abs_diff_eq!(end[0], 2.0_f64.sqrt() - 1.0, epsilon = 1e-10);
    assert_eq!(end[1], 0.0);
}

#[test]
fn impacts_without_end_close_after_the_stated_number() {
    let ball = masses([1.0], |_, _, _| [-9.81]);
    let mut stepper = EventStepper::new(&ball, vec![Law::stop(&[1.0], 0.0, 0.999)])
        .unwrap()
        .with_limits(Limits {
            most_impacts: 20,
            ..Limits::default()
        });
    let mut x = [0.01, 0.0];
    stepper
        .advance(&ball, (0.0, 100.0, 1), &(), &mut x)
        .unwrap();
    assert_eq!(impacts(stepper.events()).len(), 21);
    assert_eq!(x, [0.0, 0.0]);
}

/// Of three equal balls that touch the first strikes the second, the third parts already: they exchange their velocities one after the other, in one
/// instant. A stop that parts and gives an impulse all the same would raise the energy, here from 5 to 17/3.
#[test]
fn a_blow_beside_a_stop_that_parts_gains_no_energy() {
    let balls = masses([1.0; 3], |_, _, _| [0.0; 3]);
    let after = |most_impacts: usize| {
        let touch = |w: [f64; 3]| Law::stop(&w, 0.0, 1.0);
        let laws = vec![touch([-1.0, 1.0, 0.0]), touch([0.0, -1.0, 1.0])];
        let mut stepper = EventStepper::new(&balls, laws)
            .unwrap()
            .with_limits(Limits {
                most_impacts,
                ..Limits::default()
            });
        let mut x = [0.0, 0.0, 0.0, 3.0, 0.0, 1.0];
        stepper.advance(&balls, (0.0, 0.1, 1), &(), &mut x).unwrap();
        ([x[3], x[4], x[5]], impacts(stepper.events()))
    };
    let (v, blows) = after(100);
    for (v, expected) in v.iter().zip([0.0, 1.0, 3.0]) {
        assert_abs_diff_eq!(*v, expected, epsilon = 1e-12);
    }
    assert_eq!(blows, [(0.0, -3.0, 3.0), (0.0, -2.0, 2.0)]);
    // The second blow of the instant is the last that may be: it has no rebound.
    let (v, blows) = after(1);
    for (v, expected) in v.iter().zip([0.0, 2.0, 2.0]) {
        assert_abs_diff_eq!(*v, expected, epsilon = 1e-12);
    }
    assert_eq!(blows, [(0.0, -3.0, 3.0), (0.0, -2.0, 0.0)]);
}

#[test]
fn what_is_no_law_and_what_is_no_number_is_refused() {
    let free = masses([1.0], |_, _, _| [0.0]);
    let moving = [1.0, 1.0];
    let fault = |law: Law| match refusal(&free, vec![law], &moving) {
        ContactError::Law { law: 0, fault } => fault,
        other => panic!("{other:?}"),
    };
    assert!(matches!(
        fault(Law::stop(&[1.0, 0.0], 0.0, 0.5)),
        LawFault::Length {
            found: 2,
            expected: 1,
            ..
        }
    ));
    assert_eq!(fault(Law::stop(&[0.0], 0.0, 0.5)), LawFault::NoDirection);
    assert_eq!(
        fault(Law::stop(&[1.0], 0.0, 1.5)),
        LawFault::Restitution { value: 1.5 }
    );
    assert!(matches!(
        fault(Law::stop(&[1.0], f64::NAN, 0.5)),
        LawFault::NotFinite { .. }
    ));
    assert!(matches!(
        fault(Law::friction(&[1.0], Coulomb::new(1.0)).on_belt(f64::INFINITY)),
        LawFault::NotFinite { .. }
    ));

    let size = |value| vec![Law::friction(&[1.0], Coulomb::new(value))];
    for value in [f64::NAN, -1.0, f64::INFINITY] {
        for start in [[0.0, 1.0], [0.0, 0.0]] {
            let error = refusal(&free, size(value), &start);
            assert!(
                matches!(error, ContactError::Friction { law: 0, .. }),
                "{error}"
            );
        }
    }
    let pushed = masses([1.0], |_, _, _| [1.5]);
    let falls = Coulomb {
        sliding: 2.0,
        breakaway: 1.0,
    };
    let error = refusal(&pushed, vec![Law::friction(&[1.0], falls)], &[0.0, 0.0]);
    assert!(
        matches!(error, ContactError::Breakaway { law: 0, .. }),
        "{error}"
    );

    let floor = || vec![Law::stop(&[1.0], 0.0, 0.5)];
    let error = refusal(&free, floor(), &[-0.1, 0.0]);
    assert!(
        matches!(
            error,
            ContactError::Penetration {
                law: 0,
                gap: -0.1,
                ..
            }
        ),
        "{error}"
    );
    let error = refusal(&free, floor(), &[f64::NAN, 0.0]);
    assert!(
        matches!(error, ContactError::NotFinite { component: 0, .. }),
        "{error}"
    );
    let error = refusal(&free, floor(), &[0.0]);
    assert!(
        matches!(
            error,
            ContactError::State {
                found: 1,
                expected: 2
            }
        ),
        "{error}"
    );

    let no_number = masses([1.0], |t, _, _| [if t > 0.5 { f64::NAN } else { 0.0 }]);
    for laws in [floor(), size(1.0)] {
        for start in [[1.0, 0.0], [1.0, 1.0]] {
            let error = refusal(&no_number, laws.clone(), &start);
            assert!(
                matches!(
                    error,
                    ContactError::NotFinite { .. }
                        | ContactError::Reaction { .. }
                        | ContactError::Complementarity { .. }
                ),
                "{error}"
            );
        }
    }
    let massless = masses([0.0], |_, _, _| [1.0]);
    let error = refusal(&massless, floor(), &[1.0, 0.0]);
    assert!(
        matches!(error, ContactError::Mass { coordinate: 0, .. }),
        "{error}"
    );
}

#[test]
fn the_error_of_a_mechanism_comes_back_with_its_time() {
    let fails = Masses::new(1, |t, (_q, _v), _u: &(), mass, force| {
        mass[(0, 0)] = 1.0;
        force[0] = 0.0;
        if t > 0.55 { Err("no more") } else { Ok(()) }
    });
    let error = refusal(&fails, vec![], &[0.0, 1.0]);
    assert!(
        matches!(error, ContactError::System { time, source: "no more" } if (0.55..0.61).contains(&time)),
        "{error:?}"
    );
}
