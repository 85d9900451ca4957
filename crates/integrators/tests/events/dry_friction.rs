//! Dry friction against motions that are known.

use std::convert::Infallible;
use std::f64::consts::PI;

use approx::assert_abs_diff_eq;
use integrators::event::{ContactSystem, Coulomb, Direction, EventKind, Law};
use integrators::problems::StickSlip;

use super::*;

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
