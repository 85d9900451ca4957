//! An axis whose drive gives or plays, as whoever built it knows it: one mass, of motor and load or of the load alone, and a sensor on either.
//!
//! J v̇_m = u − T − c v_m,  m v̇ = T − d v,  T of a spring and a damper between them, or of teeth that touch beyond half a gap.

use std::f64::consts::TAU;

use pinode_nn::diagnose::verdict::{Diagnosis, NamedEffect, Verdict};
use pinode_nn::log::Log;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::pendulum::{diagnosed, parsed, recorded, stepped};

const MOTOR: f64 = 0.8;
const LOAD: f64 = 1.7;
const VISCOUS: f64 = 3.0;
const NOISE: f64 = 1e-5;

/// Where the sensor is, and what the model's mass is of.
#[derive(Debug, Clone, Copy)]
struct Layout {
    on_motor: bool,
    in_mass: bool,
}

/// The axis as a rigid one.
fn model(layout: Layout) -> String {
    with_friction(layout, VISCOUS)
}

/// The same with this viscous friction.
fn with_friction(layout: Layout, viscous: f64) -> String {
    let mass = LOAD + if layout.in_mass { MOTOR } else { 0.0 };
    format!(
        "name = \"axis\"\n\
         [lagrangian]\ncoordinates = [\"x\"]\nkinetic = \"0.5*m*x_dot^2\"\npotential = \"0*x\"\nparameters = {{ m = {mass} }}\n\
         [tolerance]\nparameters = {{ m = 0.02 }}\n\
         [[input]]\nname = \"motor\"\njoint = \"x\"\n\
         [[effect]]\nkind = \"viscous_friction\"\njoint = \"x\"\ncoefficient = {viscous}\n\
         [sensor.x]\nposition_noise = {NOISE:e}\nvelocity = \"none\"\n"
    )
}

/// 30 s at 200 Hz: the motor follows sums of sines by a feedback of its own sensor, with friction c of the motor and d of the load. `between` is T, of the stretch and its rate.
fn log(layout: Layout, [c, d]: [f64; 2], between: impl Fn(f64, f64) -> f64) -> Log {
    const STEPS: u32 = 100;
    let t: Vec<f64> = (0..6000).map(|k| 5e-3 * f64::from(k)).collect();
    let mut random = ChaCha8Rng::seed_from_u64(7);
    let mut noise = || -> f64 { StandardNormal.sample(&mut random) };
    let (mut q, mut u) = (Vec::new(), Vec::new());
    let mut state = [0.0; 4];
    for &t in &t {
        let wave = |k: i32| {
            let turns = (0.3 + 0.9 * f64::from(k)) * t;
            (TAU * turns + f64::from(k)).sin() / f64::from(1 + k)
        };
        let wanted: f64 = 0.1 * (0..7).map(wave).sum::<f64>();
        // Beyond the swing of the drive it is stirred a little as well.
        let stirred = 0.6 * (TAU * (4.0 + 0.4 * t) * t).sin();
        let push = 150.0 * (wanted - state[0]) - 12.0 * state[2] + stirred;
        let [motor, load] = [state[0], state[1]];
        q.push(if layout.on_motor { motor } else { load } + NOISE * noise());
        u.push(push);
        for _ in 0..STEPS {
            state = stepped(state, 5e-3 / f64::from(STEPS), |[motor, load, vm, v]| {
                let pull = between(motor - load, vm - v);
                [vm, v, (push - pull - c * vm) / MOTOR, (pull - d * v) / LOAD]
            });
        }
    }
    recorded(t, vec![q], vec![u])
}

/// The only effect, read where it should be.
fn only(found: &Diagnosis, layout: Layout) -> &NamedEffect {
    assert_eq!(found.verdict, Verdict::EffectsFound, "{layout:?}");
    let [effect] = found.effects.as_slice() else {
        panic!("{layout:?}: {:?}", found.effects);
    };
    let told = |flag: &str| effect.parameters.contains_key(flag);
    assert_eq!(told("sensor_on_motor"), layout.on_motor, "{layout:?}");
    effect
}

fn assert_told(effect: &NamedEffect, name: &str, truth: f64, within: f64) {
    let told = &effect.parameters[name];
    let off = (told.value - truth).abs();
    assert!(off < within * truth, "{name}: {told:?} for {truth}");
    let std = told.std.unwrap();
    assert!(off < 4.0 * std, "{name}: {told:?} for {truth}");
}

/// A sensor on the motor had left no name at all, and a motor within the mass a spring ten times too soft with a motor twenty times too light.
#[test]
fn an_elastic_drive_is_told_wherever_its_sensor_is_and_its_motor_counts() {
    let (stiffness, damping) = (2500.0, 3.0);
    for (on_motor, in_mass) in [(false, false), (false, true), (true, false), (true, true)] {
        let layout = Layout { on_motor, in_mass };
        let log = log(layout, [0.0, VISCOUS], |e, rate| {
            stiffness * e + damping * rate
        });
        let found = diagnosed(&parsed(&model(layout)), log);
        let effect = only(&found, layout);
        assert_eq!(effect.kind, "elastic_transmission", "{layout:?}");
        let told = effect.parameters.contains_key("motor_in_mass");
        assert_eq!(told, in_mass, "{layout:?}");
        // Of a load alone what swings the same does nearly the same.
        let within = if on_motor { 0.01 } else { 0.15 };
        assert_told(effect, "stiffness", stiffness, within);
        assert_told(effect, "motor_inertia", MOTOR, within);
        assert!(found.gap.after < 2.0 * found.gap.expected, "{layout:?}");
    }
}

/// Of a load with next to no friction, u/x = (d s + k) / (M s² (μ s² + d s + k)), M the whole mass and 1/μ = 1/J + 1/m: what swings, and not what is the motor's. Errors of 2 % had
/// been told of springs ten times too soft.
#[test]
fn a_motor_that_does_not_show_is_said_not_to() {
    let (stiffness, damping, viscous) = (2500.0, 3.0, 0.05);
    let layout = Layout {
        on_motor: false,
        in_mass: true,
    };
    let log = log(layout, [0.0, viscous], |e, rate| {
        stiffness * e + damping * rate
    });
    let found = diagnosed(&parsed(&with_friction(layout, viscous)), log);
    let effect = only(&found, layout);
    assert_eq!(effect.kind, "elastic_transmission");
    assert!(effect.parameters.contains_key("motor_in_mass"));
    for (name, truth) in [("stiffness", stiffness), ("motor_inertia", MOTOR)] {
        let told = &effect.parameters[name];
        let std = told.std.unwrap();
        assert!(std > 0.3 * told.value, "{name}: {told:?}");
        assert!(std < 3.0 * told.value, "{name}: {told:?}");
        assert!(
            (told.value - truth).abs() < 3.0 * std,
            "{name}: {told:?} for {truth}"
        );
    }
    let frequency = (stiffness * (1.0 / MOTOR + 1.0 / LOAD)).sqrt() / TAU;
    let said = found.advice.iter().find_map(|advice| {
        let said = advice.split_once("swings like, ")?.1;
        said.split_once(" ±")?.0.parse::<f64>().ok()
    });
    let said = said.unwrap_or_else(|| panic!("{:?}", found.advice));
    assert!(
        (said / frequency - 1.0).abs() < 0.01,
        "{said} Hz for {frequency}"
    );
}

/// Teeth are taken to be 75 times softer than these at first, with which blows last nine times as long. How hard they are is told to a factor of four.
#[test]
fn the_teeth_of_a_play_are_told_where_blows_show_them() {
    let (gap, stiffness, damping) = (1e-3, 3e6, 900.0);
    let teeth = |e: f64, rate: f64| match e.abs() - gap / 2.0 {
        // They push and do not hold.
        over if over > 0.0 => {
            let pushes = stiffness * over + damping * rate * e.signum();
            pushes.max(0.0) * e.signum()
        }
        _ => 0.0,
    };
    let layout = Layout {
        on_motor: true,
        in_mass: true,
    };
    let found = diagnosed(&parsed(&model(layout)), log(layout, [0.0, VISCOUS], teeth));
    let effect = only(&found, layout);
    assert_eq!(effect.kind, "backlash");
    for (name, truth, within) in [("gap", gap, 0.1), ("motor_inertia", MOTOR, 0.1)] {
        let told = &effect.parameters[name];
        let off = (told.value / truth - 1.0).abs();
        assert!(off < within, "{name}: {told:?} for {truth}");
    }
    let told = &effect.parameters["stiffness"];
    assert!(told.std.is_some(), "{told:?}");
    assert!(
        (told.value / stiffness).ln().abs() < 4.0_f64.ln(),
        "{told:?}"
    );
}

/// A rigid axis has its friction where it moves. It had been left on the load, and the input was slow as well, > 99 %.
#[test]
fn friction_of_the_motor_is_no_lag() {
    let (stiffness, damping) = (2500.0, 3.0);
    let layout = Layout {
        on_motor: true,
        in_mass: true,
    };
    let log = log(layout, [VISCOUS, 0.0], |e, rate| {
        stiffness * e + damping * rate
    });
    let found = diagnosed(&parsed(&model(layout)), log);
    let effect = only(&found, layout);
    assert_eq!(effect.kind, "elastic_transmission");
    assert_told(effect, "motor_friction", VISCOUS, 0.1);
    assert_told(effect, "motor_inertia", MOTOR, 0.1);
    let left = found.constants.iter().find(|c| c.name.contains("viscous"));
    let left = left.unwrap_or_else(|| panic!("{:?}", found.constants));
    assert!(left.fitted.abs() < 0.1 * VISCOUS, "{left:?}");
}
