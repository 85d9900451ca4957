//! Stops and impacts against motions that are known.

use approx::assert_abs_diff_eq;
use integrators::event::{EventKind, Law};

use super::*;

#[test]
fn a_bouncing_ball_strikes_at_the_times_of_the_geometric_series() {
    let (g, e, height) = (9.81, 0.7, 2.0);
    let ball = masses([0.4], |_, _, _| [-0.4 * 9.81]);
    let rolled = motion(
        &ball,
        vec![Law::stop(&[1.0], 0.0, e)],
        (6.0, 60, 5),
        &[height, 0.0],
    );
    let fall = (2.0 * height / g).sqrt();
    let struck = impacts(&rolled.events);
    // tₙ = t₀ (1 + 2 e + … + 2 eⁿ), until the rebound is slower than 1e-9 m/s.
    let slow = (1e-9 / (g * fall)).ln() / f64::ln(e);
    assert_eq!(struck.len(), slow.ceil() as usize);
    let mut time = fall;
    for (n, (at, before, after)) in struck.iter().enumerate() {
        assert_abs_diff_eq!(*at, time, epsilon = 1e-11);
        assert_abs_diff_eq!(*before, -g * fall * e.powi(n as i32), epsilon = 1e-10);
        if n + 1 < struck.len() {
            assert_abs_diff_eq!(*after, -e * before, epsilon = 1e-15);
        }
        time += 2.0 * fall * e.powi(n as i32 + 1);
    }
    let rest = kinds(&rolled.events, |kind| kind == EventKind::Rests);
    assert_eq!(rest.len(), 1);
    assert_abs_diff_eq!(rest[0].time, fall * (1.0 + e) / (1.0 - e), epsilon = 2e-9);
    assert_eq!(rolled.states.last().unwrap()[..], [0.0, 0.0]);
}

#[test]
fn a_body_between_two_walls_keeps_its_time() {
    // 1 m between the walls, from the middle; e = 0.9 at the right one, 1 at the left one.
    let free = masses([2.0], |_, _, _| [0.0]);
    let laws = || vec![Law::stop(&[1.0], 0.5, 1.0), Law::stop(&[-1.0], 0.5, 0.9)];
    let rolled = motion(&free, laws(), (10.0, 11, 9), &[0.0, 2.0]);
    let mut expected = Vec::new();
    let (mut time, mut speed, mut right) = (0.25, 2.0_f64, true);
    while time < 10.0 {
        expected.push(time);
        speed *= if right { 0.9 } else { 1.0 };
        right = !right;
        time += 1.0 / speed;
    }
    let struck = impacts(&rolled.events);
    assert_eq!(struck.len(), expected.len());
    for ((at, ..), exact) in struck.iter().zip(expected) {
        assert_abs_diff_eq!(*at, exact, epsilon = 1e-11);
    }
    for x in &rolled.states {
        assert!(x[0].abs() <= 0.5 + 1e-14);
    }
}

#[test]
fn a_leaning_body_leaves_its_stop_when_it_is_pulled() {
    // f = −2 + 3 t: λ = 2 − 3 t until t = 2/3, then m v̇ = 3 (t − 2/3).
    let leaning = masses([0.5], |t, _, _| [-2.0 + 3.0 * t]);
    let rolled = motion(
        &leaning,
        vec![Law::stop(&[1.0], -1.0, 0.3)],
        (2.0, 1, 4),
        &[1.0, 0.0],
    );
    assert_eq!(rolled.events.len(), 1);
    assert_eq!(rolled.events[0].kind, EventKind::LetsGo);
    assert_abs_diff_eq!(rolled.events[0].time, 2.0 / 3.0, epsilon = 1e-11);
    let since = 2.0 - 2.0 / 3.0;
    assert_abs_diff_eq!(
        rolled.states[1][0],
        1.0 + f64::powi(since, 3),
        epsilon = 1e-11
    );
}

/// Motor and load with a play of 0.2 between them.
fn backlash(e: f64) -> Vec<Law> {
    vec![
        Law::stop(&[1.0, -1.0], 0.1, e),
        Law::stop(&[-1.0, 1.0], 0.1, e),
    ]
}

#[test]
fn an_impact_in_backlash_keeps_momentum_and_loses_half_mu_1_minus_e2_dv2() {
    let (motor, load, e) = (0.2, 1.1, 0.6);
    let free = masses([motor, load], |_, _, _| [0.0, 0.0]);
    let start = [0.0, 0.03, 1.7, -0.4];
    let rolled = motion(&free, backlash(e), (0.12, 1, 7), &start);
    let struck = impacts(&rolled.events);
    assert_eq!(struck.len(), 1);
    // The gap of 0.13 closes at 2.1 a second.
    assert_abs_diff_eq!(struck[0].0, 0.13 / 2.1, epsilon = 1e-13);
    let end = &rolled.states[1];
    let momentum = |v: &[f64]| motor * v[0] + load * v[1];
    let energy = |v: &[f64]| 0.5 * (motor * v[0] * v[0] + load * v[1] * v[1]);
    assert_abs_diff_eq!(momentum(&end[2..]), momentum(&start[2..]), epsilon = 1e-14);
    let mu = motor * load / (motor + load);
    let lost = 0.5 * mu * (1.0 - e * e) * 2.1 * 2.1;
    assert_abs_diff_eq!(
        energy(&start[2..]) - energy(&end[2..]),
        lost,
        epsilon = 1e-13
    );
}

#[test]
fn a_motor_takes_its_load_along_through_the_backlash() {
    // A constant torque on the motor: free, a first blow, and at last both as one body on one side of the play.
    let (motor, load, torque) = (0.2, 1.1, 0.5);
    let driven = masses([motor, load], move |_, _, _| [torque, 0.0]);
    let rolled = motion(&driven, backlash(0.4), (8.0, 4, 200), &[0.0, 0.0, 0.0, 0.0]);
    let end = rolled.states.last().unwrap();
    assert_eq!(rolled.events.last().unwrap().kind, EventKind::Rests);
    assert_abs_diff_eq!(end[0] - end[1], 0.1, epsilon = 1e-14);
    assert_abs_diff_eq!(end[2], end[3], epsilon = 1e-14);
    // Momentum is the torque's impulse, whatever happened in between.
    assert_abs_diff_eq!(
        motor * end[2] + load * end[3],
        torque * 8.0,
        epsilon = 1e-12
    );
}

#[test]
fn a_ball_that_strikes_a_row_of_touching_balls_keeps_momentum_and_energy_does_not_rise() {
    let m = [1.0, 1.0, 2.0, 0.5];
    let row = masses(m, |_, _, _| [0.0; 4]);
    for e in [0.0, 0.5, 1.0] {
        let laws = (0..3)
            .map(|i| {
                let mut w = [0.0; 4];
                (w[i], w[i + 1]) = (-1.0, 1.0);
                Law::stop(&w, -0.1, e)
            })
            .collect();
        let start = [0.0, 0.3, 0.4, 0.5, 1.0, 0.0, 0.0, 0.0];
        let rolled = motion(&row, laws, (1.0, 1, 10), &start);
        let v = &rolled.states[1][4..];
        let momentum: f64 = v.iter().zip(m).map(|(v, m)| m * v).sum();
        let energy: f64 = v.iter().zip(m).map(|(v, m)| 0.5 * m * v * v).sum();
        assert_abs_diff_eq!(momentum, 1.0, epsilon = 1e-13);
        assert!(energy <= 0.5 + 1e-13, "e = {e}: {energy}");
        for pair in rolled.states[1][..4].windows(2) {
            assert!(pair[1] - pair[0] >= 0.1 - 1e-13);
        }
        if e == 0.0 {
            // All as one.
            for v in v {
                assert_abs_diff_eq!(*v, 1.0 / 4.5, epsilon = 1e-13);
            }
        }
    }
}
