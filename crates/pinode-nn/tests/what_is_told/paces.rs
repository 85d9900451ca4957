//! The same motion many times as slowly or as fast. With times s-fold, inertias s²-fold and viscous coefficients s-fold all forces are as they were.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::pendulum::*;
use pinode_nn::log::Log;
use pinode_nn::model::Model;

/// From here to a ship that rolls once a minute, and to a reed.
const PACES: [f64; 2] = [64.0, 1.0 / 64.0];

fn model_at(pace: f64) -> Model {
    parsed(&text_of(INERTIA * pace * pace, VISCOUS * pace, false))
}

fn at(pace: f64, mut log: Log) -> Log {
    log.runs[0].t.iter_mut().for_each(|t| *t *= pace);
    log
}

#[test]
fn a_late_input_is_found_in_slow_motion_and_in_fast() {
    const LATE: f64 = 0.07;
    let late = |t: f64| torque(((t - LATE).max(0.0) / 0.02).floor() * 0.02);
    for pace in PACES {
        let log = log_of_swings(3, |t, [_, v], _| 0.5 * late(t) - VISCOUS * v);
        let found = diagnosed(&model_at(pace), at(pace, log));
        let [effect] = found.effects.as_slice() else {
            panic!("{pace}: {:?}", found.effects);
        };
        assert_eq!(effect.kind, "input_delay", "{pace}");
        let delay = &effect.parameters["delay"];
        let off = delay.value / pace - LATE;
        assert!(off.abs() < 1e-3, "{pace}: {delay:?}");
        assert!(found.gap.after < 0.2 * found.gap.before, "{:?}", found.gap);
    }
}

#[test]
fn friction_is_found_in_slow_motion_and_in_fast() {
    const FORCE: f64 = 0.05;
    for pace in PACES {
        let law = |_, [_, v]: [f64; 2], u| u - VISCOUS * v - FORCE * (v / 1e-3).tanh();
        let found = diagnosed(&model_at(pace), at(pace, log_of_swings(5, law)));
        let [effect] = found.effects.as_slice() else {
            panic!("{pace}: {:?}", found.effects);
        };
        assert_eq!(effect.kind, "coulomb_friction", "{pace}");
        let force = &effect.parameters["force"];
        assert!(
            (force.value - FORCE).abs() < 0.02 * FORCE,
            "{pace}: {force:?}"
        );
        assert!(found.gap.after < 0.2 * found.gap.before, "{:?}", found.gap);
    }
}

#[test]
fn nothing_is_found_in_an_exact_model_of_slow_motion_and_of_fast() {
    for pace in PACES {
        let log = log_of_swings(7, |_, [_, v], u| u - VISCOUS * v);
        let found = diagnosed(&model_at(pace), at(pace, log));
        assert!(found.effects.is_empty(), "{pace}: {:?}", found.effects);
        assert!(
            found.unexplained.is_none(),
            "{pace}: {:?}",
            found.unexplained
        );
    }
}

/// A mass on a spring, five swings a second, under a force that steps twice in three of them: means of it over 5 ms, which are
/// enough of a cart-pole, are no such steps.
#[test]
fn nothing_is_found_in_an_exact_model_that_is_pushed_by_steps_within_a_few_milliseconds() {
    let (interval, stiffness, damping) = (1.25e-3, 986.96, 18.85);
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let (mut x, mut u) = ([0.0, 0.0], 0.0);
    let mut run = log_of_swings(0, |_, _, u| u).runs.remove(0);
    run.t = (0..9600).map(|k| interval * f64::from(k)).collect();
    (run.q, run.u) = (vec![Vec::new()], vec![Vec::new()]);
    for k in 0..9600 {
        if k % 107 == 0 {
            u = rng.random_range(-900.0..900.0);
        }
        let noise: f64 = StandardNormal.sample(&mut rng);
        run.q[0].push(x[0] + NOISE * noise);
        run.u[0].push(u);
        // Steps of the second order, 1/8000 of a swing long.
        let h = interval / 50.0;
        let rates = |x: [f64; 2]| [x[1], u - stiffness * x[0] - damping * x[1]];
        for _ in 0..50 {
            let a = rates(x);
            let b = rates([x[0] + 0.5 * h * a[0], x[1] + 0.5 * h * a[1]]);
            x = [x[0] + h * b[0], x[1] + h * b[1]];
        }
    }
    let model = parsed(&format!(
        "name = \"reed\"\n\
         lagrangian = {{ coordinates = [\"x\"], kinetic = \"0.5*x_dot^2\", potential = \"0.5*{stiffness}*x^2\" }}\n\
         [[input]]\nname = \"push\"\njoint = \"x\"\n\
         [[effect]]\nkind = \"viscous_friction\"\njoint = \"x\"\ncoefficient = {damping}\n\
         [sensor.x]\nposition_noise = {NOISE:e}\nvelocity = \"none\"\n"
    ));
    let mut log = log_of_swings(0, |_, _, u| u);
    log.runs = vec![run];
    let found = diagnosed(&model, log);
    assert!(found.effects.is_empty(), "{:?}", found.effects);
    assert!(found.unexplained.is_none(), "{:?}", found.unexplained);
    assert!(found.gap.after < 1.5, "{:?}", found.gap);
}
