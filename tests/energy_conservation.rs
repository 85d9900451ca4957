//! Without applied forces the total energy T + V stays; what the integrator loses falls with the fourth power of its step.

use std::path::Path;

use crate::common::load::tree;
use crate::common::motion::advance;
use crate::common::random_tree::{body, urdf};
use crate::common::written::{cart_pole_as_text, double_pendulum_as_text, model};
use lagrange::mechanism::Tree;
use lagrange::urdf::Options;
use lagrange::{Dynamics, Mechanics};
use proptest::collection::vec;
use proptest::strategy::{Strategy, ValueTree};
use proptest::test_runner::TestRunner;

fn energy(mechanics: &impl Mechanics, x: &[f64]) -> f64 {
    let (q, v) = x.split_at(mechanics.nq());
    mechanics.total_energy(q, v).unwrap()
}

/// The largest |E(t) − E(0)| of `steps` steps of `h`, in units of the energy that moves: the largest T.
fn drift(mechanics: &impl Mechanics, initial: &[f64], h: f64, steps: usize) -> f64 {
    let start = energy(mechanics, initial);
    let p = mechanics.nominal();
    let (mut worst, mut moving) = (0.0_f64, 0.0_f64);
    let mut x = initial.to_vec();
    advance(mechanics, &mut x, h, steps, |x| {
        let (q, v) = x.split_at(mechanics.nq());
        let kinetic = mechanics.kinetic_energy_with(q, v, &p);
        let potential = mechanics.potential_energy_with(q, &p);
        worst = worst.max((kinetic + potential - start).abs());
        moving = moving.max(kinetic);
        assert!(worst.is_finite());
    })
    .unwrap();
    worst / moving
}

/// Energy over 10⁵ steps, and how its error over a short time falls when the step is halved.
fn keeps_its_energy(name: &str, mechanics: &impl Mechanics, initial: &[f64], h: f64, bound: f64) {
    let long = drift(mechanics, initial, h, 100_000);
    // The order needs steps so long that rounding is negligible, and a time short against the growth of errors in chaos.
    let coarse = 8.0 * h;
    let errors = [1, 2, 4].map(|halving| {
        let steps = 64 * halving;
        drift(mechanics, initial, coarse / halving as f64, steps)
    });
    let order = (errors[0] / errors[2]).log2() / 2.0;
    eprintln!(
        "{name}: drift {long:.1e} over {} s, order {order:.2}, {errors:?}",
        h * 1e5
    );
    assert!(long < bound, "{name}: {long:e}");
    // The error of the state is of order 4, and so is the part of the energy error that comes and goes. The part that stays is of
    // order 5: on a harmonic motion a step changes the amplitude by −(ωh)⁶/144. So 4 is the least, and more is no fault.
    assert!(order > 3.7, "{name}: order {order}, {errors:?}");
}

#[test]
fn the_cart_pole_keeps_its_energy() {
    let initial = [0.0, 2.0, 0.3, 1.0];
    let bodies = model("cartpole/cartpole.urdf");
    keeps_its_energy("cart-pole (URDF)", &bodies, &initial, 1e-3, 2e-8);
    keeps_its_energy(
        "cart-pole (text)",
        &cart_pole_as_text(),
        &initial,
        1e-3,
        1e-7,
    );
}

#[test]
fn the_double_pendulum_keeps_its_energy() {
    let initial = [1.0, -0.5, 0.0, 1.0];
    let bodies = model("double_pendulum/double_pendulum.urdf");
    keeps_its_energy("double pendulum (URDF)", &bodies, &initial, 1e-3, 2e-8);
    let text = double_pendulum_as_text();
    keeps_its_energy("double pendulum (text)", &text, &initial, 1e-3, 2e-8);
}

#[test]
fn pendulums_keep_their_energy() {
    for (name, initial, h) in [
        ("single_pendulum", &[2.5, 0.0][..], 1e-3),
        ("triple_pendulum", &[1.0, -0.5, 0.7, 0.0, 1.0, 0.0], 2.5e-4),
        ("spherical_pendulum", &[0.9, 0.3, 0.4, 1.2], 1e-3),
        ("furuta_pendulum", &[0.0, 2.0, 3.0, 0.5], 5e-4),
        ("bead_on_hoop", &[0.0, 0.5, 12.0, 1.0], 1e-3),
        ("elastic_joint", &[0.4, 1.0, 2.0, -1.0], 1e-3),
    ] {
        let bodies = model(&format!("{name}/{name}.urdf"));
        keeps_its_energy(name, &bodies, initial, h, 2e-8);
    }
}

#[test]
fn the_seven_joint_arm_keeps_its_energy() {
    let initial = [
        [0.3, 0.8, -0.4, 1.2, 0.5, -0.6, 0.2],
        [0.5, -0.3, 0.4, 0.2, -0.6, 0.5, 1.0],
    ];
    let arm = model("arm7/arm7.urdf");
    keeps_its_energy("arm7", &arm, &initial.concat(), 2e-4, 2e-8);
}

#[test]
fn the_legs_of_the_quadruped_keep_their_energy() {
    // Roll, hip and knee of every leg.
    let (q, v) = (
        [0.2, 0.6, -1.2].repeat(4),
        [
            [0.5, 1.0, -1.0],
            [-0.5, 0.0, 2.0],
            [1.0, -1.0, 0.0],
            [0.0, 0.3, 0.4],
        ],
    );
    let quadruped = model("quadruped/quadruped.urdf");
    keeps_its_energy(
        "quadruped",
        &quadruped,
        &[q, v.concat()].concat(),
        2e-4,
        2e-8,
    );
}

#[test]
fn the_tumbling_quadruped_keeps_its_energy() {
    let path = "../../models/quadruped/quadruped.urdf";
    let text = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(path)).unwrap();
    // In weightlessness: its fall would add an energy beside which no other shows.
    let options = Options {
        floating_base: true,
        gravity: [0.0; 3],
        ..Options::default()
    };
    let pose = [0.0, 0.0, 1.0, 0.8, 0.0, 0.6, 0.0];
    let twist = [1.0, 0.5, 4.0, 2.0, -1.0, 3.0];
    let legs = [
        [0.2, 0.6, -1.2].repeat(4),
        [0.5, 1.0, -1.0, -0.5, 0.0, 2.0].repeat(2),
    ];
    let initial = [&pose[..], &legs[0], &twist, &legs[1]].concat();
    keeps_its_energy(
        "tumbling quadruped",
        &tree(&text, &options),
        &initial,
        5e-4,
        2e-8,
    );
}

#[test]
fn the_gripper_keeps_its_energy_through_its_couplings() {
    let initial = [0.0, 0.4, 2.0, 1.0];
    keeps_its_energy(
        "gripper",
        &model("gripper/gripper.urdf"),
        &initial,
        1e-4,
        2e-8,
    );
}

/// Four hinges about oblique axes.
fn random_tree() -> Dynamics<Tree> {
    let mut runner = TestRunner::deterministic();
    let bodies = vec(body(&["continuous"]), 4)
        .new_tree(&mut runner)
        .unwrap()
        .current();
    tree(&urdf(&bodies), &Options::default())
}

#[test]
fn a_tree_about_oblique_axes_keeps_its_energy() {
    let initial = [0.3, -0.4, 0.5, 0.1, 0.5, -0.5, 0.3, 0.2];
    keeps_its_energy("tree", &random_tree(), &initial, 1e-3, 2e-8);
}

#[test]
fn the_error_of_the_state_falls_with_the_fourth_power_of_the_step() {
    let mechanics = random_tree();
    let initial = [0.3, -0.4, 0.5, 0.1, 0.5, -0.5, 0.3, 0.2];
    let end = |steps: usize| {
        let mut x = initial;
        advance(&mechanics, &mut x, 0.4 / steps as f64, steps, |_| ()).unwrap();
        x
    };
    let fine = end(3200);
    let errors = [50, 100, 200].map(|steps| {
        let x = end(steps);
        let each = x.iter().zip(&fine).map(|(a, b)| (a - b).abs());
        each.fold(0.0, f64::max)
    });
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!((3.7..4.3).contains(&order), "order {order}, {errors:?}");
    }
}
