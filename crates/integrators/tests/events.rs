//! Dry friction, stops and impacts against motions that are known.

use std::convert::Infallible;
use std::f64::consts::PI;

use approx::assert_abs_diff_eq;
use integrators::event::{
    At, ContactError, ContactSystem, Coulomb, Direction, Event, EventKind, EventRollOut,
    EventRollOutError, EventStepper, Friction, Law, LawFault, Limits, Masses, roll_out_events,
};
use integrators::problems::StickSlip;
use integrators::{Ode, Rk4, Rotation, roll_out};
use nalgebra::DMatrix;
use proptest::prelude::*;

/// States at `samples` + 1 equal times from 0 to `end`.
fn motion<S: ContactSystem<Input = ()>>(
    system: &S,
    laws: Vec<Law>,
    (end, samples, substeps): (f64, usize, usize),
    initial: &[f64],
) -> EventRollOut
where
    S::Error: std::fmt::Debug,
{
    let times: Vec<f64> = (0..=samples)
        .map(|k| end * k as f64 / samples as f64)
        .collect();
    roll_out_events(system, laws, &times, &vec![(); samples], substeps, initial).unwrap()
}

/// Masses m with the force f(t, q, v).
fn masses<const N: usize>(
    m: [f64; N],
    f: impl Fn(f64, &[f64], &[f64]) -> [f64; N] + Sync,
) -> impl ContactSystem<Input = (), Error = Infallible, Memory = ()> {
    Masses::new(N, move |t, (q, v), _u: &(), mass, force| {
        for i in 0..N {
            mass[(i, i)] = m[i];
        }
        force.copy_from_slice(&f(t, q, v));
        Ok(())
    })
}

fn kinds(events: &[Event], of: impl Fn(EventKind) -> bool) -> Vec<Event> {
    events.iter().copied().filter(|e| of(e.kind)).collect()
}

fn impacts(events: &[Event]) -> Vec<(f64, f64, f64)> {
    events
        .iter()
        .filter_map(|event| match event.kind {
            EventKind::Impact { before, after } => Some((event.time, before, after)),
            _ => None,
        })
        .collect()
}

/// Slope of the least-squares line through (a, b).
fn slope(points: &[(f64, f64)]) -> f64 {
    let n = points.len() as f64;
    let mean_a = points.iter().map(|p| p.0).sum::<f64>() / n;
    let mean_b = points.iter().map(|p| p.1).sum::<f64>() / n;
    let cov: f64 = points.iter().map(|p| (p.0 - mean_a) * (p.1 - mean_b)).sum();
    let var: f64 = points.iter().map(|p| (p.0 - mean_a).powi(2)).sum();
    cov / var
}

// ---- dry friction -----------------------------------------------------------------------------------------------------------------

const SPRING: (f64, f64, f64) = (1.3, 40.0, 2.1); // m, k, F

fn spring_mass() -> impl ContactSystem<Input = (), Error = Infallible, Memory = ()> {
    let (m, k, _) = SPRING;
    masses([m], move |_, q, _| [-k * q[0]])
}

#[test]
fn amplitude_falls_by_2f_over_k_each_half_swing_until_it_sticks() {
    let (m, k, f) = SPRING;
    let half = PI / (k / m).sqrt();
    let law = Law::friction(&[1.0], Coulomb::new(f));
    let rolled = motion(
        &spring_mass(),
        vec![law],
        (11.3 * half, 40, 400),
        &[1.0, 0.0],
    );
    // It begins from rest: the first slide is no event but the state of the start. Ten half swings, the last one from 0.055 m, where
    // the spring still pulls more than F, to −0.05 m, where it does not.
    let turns = kinds(&rolled.events, |kind| kind != EventKind::Sticks);
    assert_eq!(turns.len(), 9);
    for (n, event) in turns.iter().enumerate() {
        let n = n as f64 + 1.0;
        assert_abs_diff_eq!(event.time, n * half, epsilon = 1e-9);
        let next = if n % 2.0 == 1.0 {
            Direction::Positive
        } else {
            Direction::Negative
        };
        assert_eq!(event.kind, EventKind::Slides(next));
    }
    let last = rolled.events.last().unwrap();
    assert_eq!(last.kind, EventKind::Sticks);
    assert_abs_diff_eq!(last.time, 10.0 * half, epsilon = 1e-9);
    let end = rolled.states.last().unwrap();
    assert_abs_diff_eq!(end[0], 1.0 - 10.0 * 2.0 * f / k, epsilon = 1e-9);
    assert_eq!(end[1], 0.0);
}

#[test]
fn stick_slip_on_a_belt_has_its_period() {
    let problem = StickSlip {
        mass: 2.0,
        stiffness: 50.0,
        belt: 0.3,
        sliding: 4.0,
        breakaway: 7.0,
    };
    let end = 10.4 * problem.period();
    let rolled = motion(
        &problem.system(),
        vec![problem.law()],
        (end, 400, 40),
        &problem.initial(),
    );
    for (k, x) in rolled.states.iter().enumerate() {
        let exact = problem.solution(end * k as f64 / 400.0);
        assert_abs_diff_eq!(x[0], exact[0], epsilon = 1e-9);
        assert_abs_diff_eq!(x[1], exact[1], epsilon = 2e-8);
    }
    let releases = kinds(&rolled.events, |kind| matches!(kind, EventKind::Slides(_)));
    let catches = kinds(&rolled.events, |kind| kind == EventKind::Sticks);
    assert!(releases.len() >= 10 && catches.len() >= 10);
    for pair in releases.windows(2) {
        assert_abs_diff_eq!(
            pair[1].time - pair[0].time,
            problem.period(),
            epsilon = 1e-9
        );
    }
    for (n, event) in catches.iter().enumerate() {
        let exact = n as f64 * problem.period() + problem.slip_time();
        assert_abs_diff_eq!(event.time, exact, epsilon = 1e-9);
    }
}

#[test]
fn error_falls_with_the_fourth_power_of_the_step_across_events() {
    // A swing that turns eight times with friction that depends on the speed, struck by a stop on one side, against a fine run.
    let size = |_: Direction, speed: f64| 0.8 + 0.5 * (-(speed / 1.5).powi(2)).exp();
    let laws = || vec![Law::friction(&[1.0], size), Law::stop(&[1.0], 0.31, 0.8)];
    let run = |steps: usize| {
        let rolled = motion(&spring_mass(), laws(), (3.3, 1, steps), &[1.0, 0.0]);
        assert!(rolled.events.len() >= 8, "{:?}", rolled.events);
        rolled.states[1].clone()
    };
    let exact = run(40_000);
    let points: Vec<(f64, f64)> = [150, 190, 240, 305, 390, 495, 630, 800]
        .map(|steps| {
            let x = run(steps);
            let error = (x[0] - exact[0]).hypot(x[1] - exact[1]);
            ((1.0 / steps as f64).ln(), error.ln())
        })
        .to_vec();
    let order = slope(&points);
    assert!((3.7..4.6).contains(&order), "order {order}: {points:?}");
}

#[test]
fn what_sticks_lets_go_when_the_force_reaches_breakaway_and_not_at_the_next_step() {
    // P = r t on a block with breakaway F_s, sliding F_d: free at F_s/r, then m v̇ = r t − F_d.
    let (m, r, held, braked) = (0.7, 3.0, 2.5, 2.0);
    let block = masses([m], move |t, _, _| [r * t]);
    let law = Law::friction(
        &[1.0],
        Coulomb {
            sliding: braked,
            breakaway: held,
        },
    );
    let rolled = motion(&block, vec![law], (2.0, 1, 3), &[0.4, 0.0]);
    assert_eq!(rolled.events.len(), 1);
    let free = held / r;
    assert_abs_diff_eq!(rolled.events[0].time, free, epsilon = 1e-11);
    let speed = (r * (4.0 - free * free) / 2.0 - braked * (2.0 - free)) / m;
    assert_abs_diff_eq!(rolled.states[1][1], speed, epsilon = 1e-10);
}

#[test]
fn a_block_on_an_incline_does_not_creep() {
    // Shaken up to 0.999 of what holds it, on one coordinate and by what is between two.
    let shaken = masses([1.0, 3.0], |t, _, _| {
        [0.9 + 0.099 * (17.0 * t).sin(), 0.5 * (5.0 * t).cos()]
    });
    let laws = vec![
        Law::friction(&[1.0, 0.0], Coulomb::new(1.0)),
        Law::friction(&[0.0, 1.0], Coulomb::new(1.0)),
    ];
    let rolled = motion(&shaken, laws, (100.0, 1, 100_000), &[0.3, -0.7, 0.0, 0.0]);
    assert_eq!(rolled.states[1], [0.3, -0.7, 0.0, 0.0]);
    assert!(rolled.events.is_empty());

    let laws = vec![
        Law::friction(&[1.0, -1.0], Coulomb::new(1.0)),
        Law::friction(&[0.3, 1.0], Coulomb::new(3.0)),
    ];
    let rolled = motion(&shaken, laws, (100.0, 1, 100_000), &[0.3, -0.7, 0.0, 0.0]);
    assert!(rolled.events.is_empty());
    let end = &rolled.states[1];
    // 1e5 roundings of the velocity, none of them kept.
    assert_abs_diff_eq!(end[0], 0.3, epsilon = 1e-13);
    assert_abs_diff_eq!(end[1], -0.7, epsilon = 1e-13);
}

#[test]
fn a_block_on_a_plank_reaches_its_speed_and_both_stop_together() {
    // Friction f between them, less than f₀ under the plank can break: while they move together each needs less than f.
    let (m1, m2, f, f0, v0) = (2.0, 0.5, 1.5, 0.9, 3.0);
    let laws = vec![
        Law::friction(&[1.0, 0.0], Coulomb::new(f0)),
        Law::friction(&[1.0, -1.0], Coulomb::new(f)),
    ];
    let free = masses([m1, m2], |_, _, _| [0.0, 0.0]);
    let rolled = motion(&free, laws, (12.0, 7, 50), &[0.0, 0.0, v0, 0.0]);
    let (a1, a2) = (-(f + f0) / m1, f / m2);
    let together = v0 / (a2 - a1);
    let common = a2 * together;
    let end = together + common * (m1 + m2) / f0;
    let sticks = kinds(&rolled.events, |kind| kind == EventKind::Sticks);
    assert_eq!(sticks.len(), 2, "{:?}", rolled.events);
    assert_eq!((sticks[0].law, sticks[1].law), (1, 0));
    assert_abs_diff_eq!(sticks[0].time, together, epsilon = 1e-12);
    assert_abs_diff_eq!(sticks[1].time, end, epsilon = 1e-11);
    let way = common * common * (m1 + m2) / (2.0 * f0);
    let last = rolled.states.last().unwrap();
    let plank = v0 * together + a1 * together * together / 2.0 + way;
    let block = a2 * together * together / 2.0 + way;
    assert_abs_diff_eq!(last[0], plank, epsilon = 1e-11);
    assert_abs_diff_eq!(last[1], block, epsilon = 1e-11);
    assert_eq!(last[2..], [0.0, 0.0]);
}

#[test]
fn a_chain_of_blocks_loses_its_energy_to_friction_and_comes_to_rest() {
    const N: usize = 8;
    let k = 30.0;
    let levels: [f64; N] = std::array::from_fn(|i| 0.3 + 0.1 * i as f64);
    let m: [f64; N] = std::array::from_fn(|i| 1.0 + 0.2 * (i % 3) as f64);
    let spring_forces = move |q: &[f64]| -> [f64; N] {
        std::array::from_fn(|i| {
            let left = if i > 0 { q[i - 1] - q[i] } else { 0.0 };
            let right = if i + 1 < N { q[i + 1] - q[i] } else { 0.0 };
            k * (left + right)
        })
    };
    let chain = masses(m, move |_, q, _| spring_forces(q));
    let laws = (0..N)
        .map(|i| {
            let mut w = [0.0; N];
            w[i] = 1.0;
            Law::friction(&w, Coulomb::new(levels[i]))
        })
        .collect();
    let mut start = vec![0.0; 2 * N];
    start[N] = 4.0;
    start[N + 5] = -2.0;
    let rolled = motion(&chain, laws, (10.0, 10_000, 1), &start);
    let energy = |x: &[f64]| {
        let kinetic: f64 = (0..N).map(|i| 0.5 * m[i] * x[N + i] * x[N + i]).sum();
        let strain: f64 = (1..N).map(|i| 0.5 * k * (x[i] - x[i - 1]).powi(2)).sum();
        kinetic + strain
    };
    let mut work = 0.0;
    for pair in rolled.states.windows(2) {
        assert!(energy(&pair[1]) <= energy(&pair[0]) + 1e-11);
        work += (0..N)
            .map(|i| levels[i] * (pair[1][i] - pair[0][i]).abs())
            .sum::<f64>();
    }
    let end = rolled.states.last().unwrap();
    assert_eq!(end[N..], [0.0; N]);
    for (force, level) in spring_forces(end).iter().zip(levels) {
        assert!(force.abs() <= level * (1.0 + 1e-9), "{force} on {level}");
    }
    // Turns inside of a millisecond are missed in the sum of ways.
    assert_abs_diff_eq!(energy(&start) - energy(end), work, epsilon = 1e-4);
}

// ---- stops ------------------------------------------------------------------------------------------------------------------------

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

// ---- both -------------------------------------------------------------------------------------------------------------------------

/// Two point masses of 1 kg on rods of 1 m; angles from hanging, the second one relative to the first.
fn double_pendulum(q: &[f64], v: &[f64]) -> (DMatrix<f64>, [f64; 2]) {
    let (g, cos, sin) = (9.81, q[1].cos(), q[1].sin());
    let mass = nalgebra::dmatrix![3.0 + 2.0 * cos, 1.0 + cos; 1.0 + cos, 1.0];
    let coriolis = [-sin * (2.0 * v[0] * v[1] + v[1] * v[1]), sin * v[0] * v[0]];
    let (s1, s12) = (q[0].sin(), (q[0] + q[1]).sin());
    let gravity = [g * (2.0 * s1 + s12), g * s12];
    (mass, [-coriolis[0] - gravity[0], -coriolis[1] - gravity[1]])
}

fn double_pendulum_energy(x: &[f64]) -> f64 {
    let (mass, _) = double_pendulum(&x[..2], &x[2..]);
    let v = nalgebra::dvector![x[2], x[3]];
    0.5 * v.dot(&(mass * &v)) - 9.81 * (2.0 * x[0].cos() + (x[0] + x[1]).cos())
}

fn double_pendulum_system() -> impl ContactSystem<Input = (), Error = Infallible, Memory = ()> {
    Masses::new(2, |_t, (q, v), _u: &(), mass, force| {
        let (m, f) = double_pendulum(q, v);
        mass.copy_from(&m);
        force.copy_from_slice(&f);
        Ok(())
    })
}

fn both_joints(force: f64) -> Vec<Law> {
    vec![
        Law::friction(&[1.0, 0.0], Coulomb::new(force)),
        Law::friction(&[0.0, 1.0], Coulomb::new(force)),
    ]
}

#[test]
fn energy_never_rises_under_friction_and_stops() {
    let start = [2.8, 0.5, 0.0, -1.0];
    let mut laws = both_joints(0.8);
    laws.push(Law::stop(&[0.0, 1.0], 0.6, 0.7));
    laws.push(Law::stop(&[0.0, -1.0], 0.6, 0.7));
    laws.push(Law::stop(&[1.0, 1.0], 2.0, 0.7));
    let rolled = motion(&double_pendulum_system(), laws, (60.0, 6000, 20), &start);
    assert!(impacts(&rolled.events).len() > 5);
    for pair in rolled.states.windows(2) {
        let (before, after) = (
            double_pendulum_energy(&pair[0]),
            double_pendulum_energy(&pair[1]),
        );
        assert!(after <= before + 1e-9, "{before} J then {after} J");
        assert!(pair[1][1].abs() <= 0.6 + 1e-12);
    }
    // It comes to rest, off the vertical as friction allows.
    assert_eq!(rolled.states.last().unwrap()[2..], [0.0, 0.0]);
}

#[test]
fn smoothed_friction_tends_to_the_set_as_its_width_goes_to_0() {
    // F tanh(v/ε) in both joints of the double pendulum, over slides, turns and moments of rest.
    let force = 1.0;
    let start = [1.2, -0.4, 0.0, 0.0];
    let set = motion(
        &double_pendulum_system(),
        both_joints(force),
        (3.0, 1, 3000),
        &start,
    );
    assert!(set.events.len() > 6, "{:?}", set.events);
    let errors = [1e-1, 1e-2, 1e-3].map(|width| {
        let smoothed = Ode::new(4, move |_t, x: &[f64], _u: &(), dx: &mut [f64]| {
            let (q, v) = x.split_at(2);
            let (m, f) = double_pendulum(q, v);
            let rhs = nalgebra::dvector![
                f[0] - force * (v[0] / width).tanh(),
                f[1] - force * (v[1] / width).tanh()
            ];
            let a = m.cholesky().unwrap().solve(&rhs);
            dx.copy_from_slice(&[v[0], v[1], a[0], a[1]]);
            Ok::<(), Infallible>(())
        });
        let end = roll_out(
            &smoothed,
            Rk4::default(),
            &[0.0, 3.0],
            &[()],
            30_000,
            &start,
        )
        .unwrap()
        .remove(1);
        (0..2)
            .map(|i| (end[i] - set.states[1][i]).abs())
            .fold(0.0, f64::max)
    });
    eprintln!("widths 0.1, 0.01, 0.001 rad/s: off by {errors:?} rad");
    assert!(errors[1] < 0.3 * errors[0], "{errors:?}");
    assert!(errors[2] < 0.3 * errors[1], "{errors:?}");
    assert!(errors[2] < 1e-3, "{errors:?}");
}

#[test]
fn a_body_that_spins_on_the_sphere_of_its_poses_stops_when_coulomb_says() {
    struct Spinning {
        space: Rotation,
    }
    impl ContactSystem for Spinning {
        type Positions = Rotation;
        type Input = ();
        type Memory = ();
        type Error = Infallible;
        fn positions(&self) -> &Rotation {
            &self.space
        }
        fn memory(&self) {}
        fn mass_and_force(
            &self,
            _: f64,
            _: (&[f64], &[f64]),
            (): &(),
            (): &mut (),
            mass: &mut DMatrix<f64>,
            force: &mut [f64],
        ) -> Result<(), Infallible> {
            mass.fill_with_identity();
            mass[(2, 2)] = 0.5;
            force.fill(0.0);
            Ok(())
        }
    }
    let spinning = Spinning { space: Rotation };
    let law = Law::friction(&[0.0, 0.0, 1.0], Coulomb::new(0.2));
    let start = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 3.0];
    let long = [2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 3.0];
    let refused = refusal(&spinning, vec![], &long);
    assert!(
        matches!(refused, ContactError::OffSpace { distance: 1.0, .. }),
        "{refused}"
    );
    let rolled = motion(&spinning, vec![law], (10.0, 1, 100), &start);
    assert_abs_diff_eq!(rolled.events[0].time, 0.5 * 3.0 / 0.2, epsilon = 1e-12);
    let end = &rolled.states[1];
    assert_eq!(end[6], 0.0);
    // The angle is I ω²/(2 F), half of it in the quaternion.
    let half: f64 = 0.5 * 0.5 * 9.0 / (2.0 * 0.2);
    assert_abs_diff_eq!(end[0].abs(), half.cos().abs(), epsilon = 1e-9);
}

/// Wagons between two walls, friction under each and between neighbours that are also buffers and coupled by springs: they keep their places and
/// never gain energy.
fn wagons(
    e: f64,
    m: [f64; 4],
    level: [f64; 4],
    between: [f64; 3],
    v: [f64; 4],
    stiffness: f64,
) -> Result<(), TestCaseError> {
    let spring = move |q: &[f64]| stiffness * (q[3] - q[0] - 1.2);
    let wagons = masses(m, move |_, q, _| [spring(q), 0.0, 0.0, -spring(q)]);
    let mut laws = Vec::new();
    for i in 0..4 {
        let mut w = [0.0; 4];
        w[i] = 1.0;
        laws.push(Law::friction(
            &w,
            Coulomb {
                sliding: 0.7 * level[i],
                breakaway: level[i],
            },
        ));
    }
    for i in 0..3 {
        let mut w = [0.0; 4];
        (w[i], w[i + 1]) = (-1.0, 1.0);
        laws.push(Law::friction(&w, Coulomb::new(between[i])));
        laws.push(Law::stop(&w, -0.25, e));
    }
    laws.push(Law::stop(&[1.0, 0.0, 0.0, 0.0], 0.3, e));
    laws.push(Law::stop(&[0.0, 0.0, 0.0, -1.0], 1.5, e));
    let start = [0.0, 0.4, 0.8, 1.2, v[0], v[1], v[2], v[3]];
    let rolled = motion(&wagons, laws, (5.0, 500, 4), &start);
    let energy = |x: &[f64]| {
        let kinetic: f64 = (0..4).map(|i| 0.5 * m[i] * x[4 + i] * x[4 + i]).sum();
        kinetic + 0.5 * stiffness * (x[3] - x[0] - 1.2).powi(2)
    };
    for pair in rolled.states.windows(2) {
        let x = &pair[1];
        prop_assert!(
            energy(x) <= energy(&pair[0]) + 1e-8,
            "{} J then {} J",
            energy(&pair[0]),
            energy(x)
        );
        prop_assert!(x[0] >= -0.3 - 1e-12 && x[3] <= 1.5 + 1e-12);
        for i in 0..3 {
            prop_assert!(x[i + 1] - x[i] >= 0.25 - 1e-12);
        }
    }
    Ok(())
}

/// Friction without a force, between two that a stop keeps together: their slip is a rounding, whose sign is no event.
#[test]
fn friction_without_a_force_between_what_a_stop_holds_has_no_events() {
    let m = [0.2, 0.2, 0.2904845399219593, 0.3216065888635652];
    let v = [0.0, 0.0, -3.0347354458073705, 0.0];
    wagons(0.0, m, [0.0; 4], [0.0; 3], v, 7.48145089272021).unwrap();
}

/// A row that comes to rest against a wall, dragged by its first wagon: what is left of the velocities when it does is no velocity.
#[test]
fn a_row_that_comes_to_rest_against_a_wall_is_at_rest() {
    let m = [
        2.3831899929624973,
        2.074047200794718,
        0.5689060208100719,
        0.2,
    ];
    let level = [
        1.1494165212867062,
        0.0,
        0.4928319787005553,
        0.9323171406671442,
    ];
    let between = [0.38512347232063127, 0.0, 0.35751104074406737];
    let v = [
        2.532963930748376,
        -0.5557187586571366,
        -1.8819602578726857,
        3.301897637017479,
    ];
    wagons(0.0, m, level, between, v, 4.604608731310259).unwrap();

    let m = [
        0.7055958277186799,
        2.947023473143335,
        2.415836135602838,
        2.453125012847393,
    ];
    let level = [
        0.9744566589442778,
        0.028708335066838703,
        0.1659695440801729,
        1.759823289634186,
    ];
    let between = [0.54686425761563, 0.2625085740224998, 0.6738450130632159];
    let v = [
        0.8685452048676139,
        1.1744109503870641,
        0.5620440510516641,
        0.3027314102817185,
    ];
    wagons(0.0, m, level, between, v, 1.4726693447843286).unwrap();
}

/// A row held by its wall and two frictions, whose last wagon goes on: the wall and the frictions are asked for one force of three.
#[test]
fn a_row_that_several_laws_hold_at_once_has_no_events_without_end() {
    let m = [
        2.331157453582583,
        2.1675211502149603,
        0.2,
        2.8932572195525594,
    ];
    let level = [
        0.0,
        0.9645845556467639,
        0.3323437121243217,
        0.7525598136353453,
    ];
    let between = [0.5661613817789697, 0.6708377183853138, 0.9068988017780928];
    let v = [
        -0.7716001583172356,
        -0.6756810676763598,
        -3.4624812978355552,
        2.2200699480710315,
    ];
    wagons(0.0, m, level, between, v, 15.675735763343253).unwrap();
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, cases: 64, ..ProptestConfig::default() })]

    /// Wagons between two walls, friction under each and between neighbours that are also buffers and coupled by springs.
    #[test]
    fn wagons_keep_their_places_and_never_gain_energy(
        e in prop_oneof![Just(0.0), Just(1.0), 0.0..1.0_f64],
        m in proptest::array::uniform4(0.2..3.0_f64),
        level in proptest::array::uniform4(0.0..2.0_f64),
        between in proptest::array::uniform3(0.0..1.0_f64),
        v in proptest::array::uniform4(-4.0..4.0_f64),
        stiffness in 0.0..20.0_f64,
    ) {
        wagons(e, m, level, between, v, stiffness)?;
    }
}

// ---- laws that depend on each other, limits, errors ----------------------------------------------------------------------------------

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

fn refusal<S: ContactSystem<Input = ()>>(
    system: &S,
    laws: Vec<Law>,
    initial: &[f64],
) -> ContactError<S::Error>
where
    S::Error: std::fmt::Debug,
{
    match roll_out_events(system, laws, &[0.0, 1.0], &[()], 10, initial).unwrap_err() {
        EventRollOutError::Contacts { source, .. } => source,
        other => panic!("{other:?}"),
    }
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

// ---- frictions that hold nothing, and arguments --------------------------------------------------------------------------------------

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
