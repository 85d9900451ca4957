//! Free runs whose steps adapt: beside fixed steps, energy, stiff mechanisms, inputs that are held, closed loops, what is refused.

use std::path::Path;
use std::sync::Arc;

use integrators::adaptive::Settings;
use integrators::adaptive::{AdaptiveError, ArgumentError, Inputs, Method, RollOut, roll_out};
use integrators::{Space, System};
use lagrange::Mechanics;
use pinode_nn::Error;
use pinode_nn::adaptive_run::{AdaptiveRun, absolute_tolerances, simulate_adaptively};
use pinode_nn::free_run::simulate;
use pinode_nn::hybrid::Hybrid;
use pinode_nn::model::Model;
use pinode_nn::motion::Motion;
use rayon::prelude::*;

fn model(path: &str) -> Model {
    let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models");
    Model::load(&models.join(path)).unwrap_or_else(|e| panic!("{path}: {e}"))
}

/// A model from text.
fn written(text: &str) -> Model {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("m.toml");
    std::fs::write(&path, text).unwrap();
    Model::load(&path).unwrap_or_else(|e| panic!("{e}"))
}

fn samples(count: u32, interval: f64) -> Vec<f64> {
    (0..=count).map(|k| interval * f64::from(k)).collect()
}

fn rolled(by: (Method, f64), model: &Model, t: &[f64], u: &[Vec<f64>], initial: &[f64]) -> RollOut {
    simulate_adaptively(by, model, "0", t, u, initial).unwrap_or_else(|e| panic!("{by:?}: {e}"))
}

/// The largest difference of two trajectories, entry by entry.
fn apart(a: &[Vec<f64>], b: &[Vec<f64>]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter()
        .flatten()
        .zip(b.iter().flatten())
        .fold(0.0, |most: f64, (a, b)| most.max((a - b).abs()))
}

/// A method, rtol, and how far its trajectory may be off.
type Case = (Method, f64, f64);

#[test]
fn a_double_pendulum_meets_runge_and_kutta_at_a_very_small_step() {
    let model = model("double_pendulum/double_pendulum_text.toml");
    let (t, initial) = (samples(150, 0.02), [0.6, -0.4, 0.0, 0.0]);
    let reference = simulate(&model, "0", &t, &[], &initial, 1e-4).unwrap();
    let cases: [Case; 6] = [
        (Method::Automatic, 1e-9, 1e-6),
        (Method::Tsit5, 1e-9, 1e-6),
        (Method::Bdf, 1e-9, 1e-5),
        (Method::Esdirk34, 1e-9, 1e-5),
        (Method::TrBdf2, 1e-7, 1e-3),
        (Method::Automatic, 1e-4, 1e-1),
    ];
    for (method, relative, most) in cases {
        let rolled = rolled((method, relative), &model, &t, &[], &initial);
        let off = apart(&reference, &rolled.states);
        assert!(off < most, "{method:?} at {relative}: {off}");
    }
}

/// Torques of all motors jump at every sample; the friction of its gears is smooth, but hardly.
#[test]
fn an_arm_under_inputs_that_jump_meets_runge_and_kutta_at_a_very_small_step() {
    let model = model("arm7/arm7.toml");
    let t = samples(25, 0.02);
    let u: Vec<Vec<f64>> = (0..7)
        .map(|i| {
            let wave = |t: &f64| (3.0 - 0.4 * f64::from(i)) * (7.0 * t + f64::from(i)).sin();
            t.iter().map(wave).collect()
        })
        .collect();
    let mut initial = vec![0.3, 0.5, -0.2, 0.9, 0.1, -0.6, 0.2];
    initial.resize(14, 0.0);
    let reference = simulate(&model, "0", &t, &u, &initial, 2e-5).unwrap();
    for (method, relative, most) in [
        (Method::Automatic, 1e-8, 1e-5),
        (Method::Tsit5, 1e-8, 1e-5),
        (Method::Esdirk34, 1e-7, 1e-4),
    ] {
        let rolled = rolled((method, relative), &model, &t, &u, &initial);
        let off = apart(&reference, &rolled.states);
        assert!(off < most, "{method:?} at {relative}: {off}");
        // Once for each of 25 inputs, and again where the method changes.
        assert!(rolled.statistics.starts >= 25, "{:?}", rolled.statistics);
    }
}

type Any = Motion<Arc<dyn Mechanics>>;

/// The mechanics of a model, without its effects.
fn motion(path: &str) -> Any {
    let model = model(path);
    Motion::new(model.mechanics.clone())
        .with_constants(model.parameter_values)
        .unwrap()
}

fn energy(motion: &Any, x: &[f64]) -> f64 {
    let (mechanics, p) = (motion.mechanics(), motion.constants());
    let (q, v) = x.split_at(mechanics.nq());
    mechanics.kinetic_energy_with(q, v, p) + mechanics.potential_energy_with(q, p)
}

/// The quadruped of the models in flight, `away` from the origin along every axis.
fn flying(away: f64) -> Vec<f64> {
    let mut state = vec![away, away, away];
    let turn = nalgebra::UnitQuaternion::from_euler_angles(0.4, 0.2, -0.8);
    state.extend([turn.w, turn.i, turn.j, turn.k]);
    state.extend([
        0.3, -0.9, 0.1, 0.8, -0.4, 0.6, 0.2, -0.5, 0.4, -0.2, 0.9, 0.1,
    ]);
    state.resize(19, 0.0);
    state.extend([0.4, -0.2, 0.9, 2.0, -3.0, 1.0]);
    state.extend([
        3.0, -4.0, 2.0, 5.0, -3.0, 1.0, -2.0, 4.0, 1.0, -1.0, 2.0, 3.0,
    ]);
    state
}

#[test]
fn a_free_quadruped_keeps_its_energy_and_its_quaternion_stays_of_length_one() {
    let motion = motion("quadruped/quadruped.toml");
    let initial = flying(0.0);
    let (first, nv) = (energy(&motion, &initial), motion.mechanics().nv());
    // Closer together than steps: most states come from interpolants.
    let (t, no_force) = (samples(200, 0.002), vec![0.0; nv]);
    let kinetic = motion.mechanics().kinetic_energy_with(
        &initial[..motion.mechanics().nq()],
        &initial[motion.mechanics().nq()..],
        motion.constants(),
    );
    let fixed = integrators::roll_out(
        &motion,
        integrators::Rk4::default(),
        &t,
        &vec![no_force.clone(); 200],
        20,
        &initial,
    )
    .unwrap();
    for (method, most) in [
        (Method::Automatic, 1e-6),
        (Method::Tsit5, 1e-6),
        (Method::Bdf, 1e-5),
        (Method::Esdirk34, 1e-5),
    ] {
        let settings = Settings::new(method, 1e-8, 1e-11);
        let input = Inputs::Constant(&no_force);
        let rolled = roll_out(&motion, &settings, &t, input, &initial).unwrap();
        assert!(rolled.statistics.steps < 2000, "{:?}", rolled.statistics);
        let mut off = vec![0.0; 2 * nv];
        for (x, reference) in rolled.states.iter().zip(&fixed) {
            let drift = (energy(&motion, x) - first).abs() / kinetic;
            assert!(drift < most, "{method:?}: energy off by {drift} of T");
            let length = x[3..7].iter().map(|q| q * q).sum::<f64>().sqrt();
            assert!((length - 1.0).abs() < 1e-14, "{method:?}: {length}");
            motion.space().difference_into(reference, x, &mut off);
            let off = off.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
            assert!(off < 100.0 * most, "{method:?}: {off}");
        }
    }
}

#[test]
fn a_quadruped_a_kilometre_away_takes_the_steps_of_one_at_the_origin() {
    let model = model("quadruped/quadruped.toml");
    let t = samples(20, 0.01);
    let steps = |away| {
        let by = (Method::Automatic, 1e-6);
        rolled(by, &model, &t, &[], &flying(away)).statistics.steps as f64
    };
    let (near, far) = (steps(0.0), steps(1e3));
    assert!((near - far).abs() <= 0.02 * near, "{near} {far}");
}

/// 1 kg on a rod that is a spring of 10⁶ N/m beside a damper of 2·10⁴ N·s/m: its length has the rates −50/s and −19950/s.
const STIFF: &str = r#"
name = "pendulum on a stiff rod"
[lagrangian]
coordinates = ["phi", "r"]
angles      = ["phi"]
kinetic     = "0.5*m*(r_dot^2 + r^2*phi_dot^2)"
potential   = "-m*g*r*cos(phi)"
parameters  = { m = 1.0, g = 9.81 }
[[input]]
name  = "motor"
joint = "phi"
[[effect]]
kind  = "linear_spring"
joint = "r"
stiffness = 1e6
rest  = 1.0
[[effect]]
kind  = "viscous_friction"
joint = "r"
coefficient = 2e4
"#;

/// Explicit steps are bounded by stability, h · 19950/s < 3.5.
#[test]
fn a_stiff_rod_makes_steps_implicit_which_are_far_fewer() {
    let model = written(STIFF);
    let (t, initial) = (samples(100, 0.1), [1.0, 1.0, 0.0, 0.0]);
    let still = vec![vec![0.0; t.len()]];
    // The motor pushes to and fro, and changes every second.
    let jumping: Vec<f64> = (0..t.len())
        .map(|k| if (k / 10) % 2 == 0 { 2.0 } else { -2.0 })
        .collect();
    for (u, implicit) in [(still, Method::Bdf), (vec![jumping], Method::Esdirk34)] {
        let explicit = rolled((Method::Tsit5, 1e-6), &model, &t, &u, &initial);
        assert!(explicit.statistics.steps > 50_000);
        let automatic = rolled((Method::Automatic, 1e-6), &model, &t, &u, &initial);
        let took = &automatic.statistics;
        assert!(
            20 * took.steps < explicit.statistics.steps,
            "{implicit:?}: {took:?}"
        );
        let methods: Vec<Method> = took.switches.iter().map(|switch| switch.to).collect();
        assert_eq!(methods.first(), Some(&Method::Tsit5));
        assert!(methods.contains(&implicit), "{methods:?}");
        let off = apart(&automatic.states, &explicit.states);
        assert!(off < 1e-3, "{implicit:?}: {off}");
    }
}

/// A crank-rocker with a viscous brake on its rocker that takes all speed from it within a fraction of a millisecond.
#[test]
fn a_braked_four_bar_makes_steps_implicit_and_stays_closed() {
    let text = std::fs::read_to_string(
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/four_bar/four_bar_text.toml"),
    )
    .unwrap();
    let brake = "\n[[effect]]\nkind = 'viscous_friction'\njoint = 'rocker'\ncoefficient = 50.0\n";
    let model = written(&(text + brake));
    let (t, initial) = (samples(20, 0.1), closed(&model, 0.4, 0.0));
    let u = vec![vec![0.3; t.len()]];
    let explicit = rolled((Method::Tsit5, 1e-6), &model, &t, &u, &initial);
    let automatic = rolled((Method::Automatic, 1e-6), &model, &t, &u, &initial);
    assert!(
        4 * automatic.statistics.steps < explicit.statistics.steps,
        "{:?} {:?}",
        automatic.statistics,
        explicit.statistics
    );
    let off = apart(&automatic.states, &explicit.states);
    assert!(off < 1e-3, "{off}");
    assert!(opening(&model, &automatic.states) < 1e-5);
}

/// A state of the four-bar on its constraints, with its crank at some angle and speed.
fn closed(model: &Model, crank: f64, speed: f64) -> Vec<f64> {
    let constraints = model.mechanics.constraints().unwrap();
    let (q, v) = ([crank, 0.0, 0.0], [speed, 0.0, 0.0]);
    let (q, v) = constraints
        .project_with(&q, &v, &[], &model.parameter_values)
        .unwrap();
    [q, v].concat()
}

/// The largest |φ|, m.
fn opening(model: &Model, states: &[Vec<f64>]) -> f64 {
    let constraints = model.mechanics.constraints().unwrap();
    let mut work = model.mechanics.workspace();
    let mut residual = nalgebra::DVector::zeros(constraints.names().len());
    let mut most = 0.0_f64;
    for x in states {
        let q = &x[..model.mechanics.nq()];
        constraints.residual_into(q, &model.parameter_values, &mut work, &mut residual);
        most = most.max(residual.amax());
    }
    most
}

#[test]
fn a_four_bar_turns_as_by_runge_and_kutta_and_stays_closed() {
    for path in ["four_bar/four_bar.toml", "four_bar/four_bar_text.toml"] {
        let model = model(path);
        let (t, initial) = (samples(50, 0.02), closed(&model, 0.4, 6.0));
        let u = vec![vec![0.0; t.len()]];
        let reference = simulate(&model, "0", &t, &u, &initial, 1e-4).unwrap();
        let cases: [Case; 4] = [
            (Method::Automatic, 1e-9, 1e-6),
            (Method::Tsit5, 1e-9, 1e-6),
            (Method::Esdirk34, 1e-10, 1e-4),
            (Method::Bdf, 1e-10, 1e-4),
        ];
        for (method, relative, most) in cases {
            let rolled = rolled((method, relative), &model, &t, &u, &initial);
            let off = apart(&reference, &rolled.states);
            assert!(off < most, "{path}, {method:?}: {off}");
            let open = opening(&model, &rolled.states);
            assert!(open < 1e-2 * most, "{path}, {method:?}: open by {open} m");
        }
    }
}

/// A block on a table, pushed; `late` s after it is logged.
fn block(late: f64) -> Model {
    written(&format!(
        "name = 'block'\nlagrangian = {{ coordinates = ['x'], kinetic = '0.5*x_dot^2', potential = '0' }}\n\
         [[input]]\nname = 'push'\njoint = 'x'\n[[effect]]\nkind = 'input_delay'\ninput = 'push'\ndelay = {late}\n"
    ))
}

/// x = Σ Δu (t − t_jump)²/2 of a free mass has no error in steps of order two and more that end at the jumps, and one of the size of the
/// jump in a step across.
#[test]
fn no_step_straddles_a_jump_of_the_input_however_late_it_comes() {
    let t = [0.0, 0.1, 0.25, 0.3, 0.7, 1.0];
    let u = vec![vec![1.0, -4.0, -4.0, 6.0, 0.0, 5.0]];
    for late in [0.0, 0.05, 0.0137, 0.29] {
        let jumps = [(0.0, 1.0), (0.1, -5.0), (0.3, 10.0), (0.7, -6.0)];
        for method in [Method::Automatic, Method::Tsit5, Method::Esdirk34] {
            // Loose: that steps are long is the point.
            let rolled = rolled((method, 0.5), &block(late), &t, &u, &[0.0, 0.0]);
            for (x, &t) in rolled.states.iter().zip(&t) {
                let (mut position, mut velocity) = (0.0, 0.0);
                for (k, (at, by)) in jumps.into_iter().enumerate() {
                    // Before it starts, the first value is held.
                    let since = if k == 0 { t } else { (t - at - late).max(0.0) };
                    position += 0.5 * by * since * since;
                    velocity += by * since;
                }
                let off = (x[0] - position).abs().max((x[1] - velocity).abs());
                assert!(off < 1e-12, "{method:?}, {late} s late, at {t} s: {off}");
            }
            assert!(rolled.statistics.steps < 100, "{:?}", rolled.statistics);
        }
    }
}

/// ẍ = sin ωt from rest: ẋ = (1 − cos ωt)/ω, x = t/ω − sin ωt/ω². Held inputs come half a sample late.
#[test]
fn an_input_that_is_smooth_between_its_samples_moves_a_mass_as_the_wave_that_was_sampled() {
    let omega = std::f64::consts::TAU / 0.9;
    let t = samples(90, 0.1);
    let u = vec![t.iter().map(|t| (omega * t).sin()).collect()];
    let off = |states: &[Vec<f64>]| {
        let away = states.iter().zip(&t).map(|(x, t)| {
            let (sine, cosine) = (omega * t).sin_cos();
            let position = (t - sine / omega) / omega;
            let velocity = (1.0 - cosine) / omega;
            (x[0] - position).abs().max((x[1] - velocity).abs())
        });
        away.fold(0.0, f64::max)
    };
    let by = |between: &str| {
        let model = written(&format!(
            "name = 'block'\nlagrangian = {{ coordinates = ['x'], kinetic = '0.5*x_dot^2', potential = '0' }}\n\
             [[input]]\nname = 'push'\njoint = 'x'\nbetween_samples = '{between}'\n"
        ));
        let fixed = simulate(&model, "0", &t, &u, &[0.0, 0.0], 1e-3).unwrap();
        let adaptive = rolled((Method::Automatic, 1e-6), &model, &t, &u, &[0.0, 0.0]);
        [off(&fixed), off(&adaptive.states)]
    };
    let (smooth, held) = (by("smooth"), by("held"));
    assert!(smooth.iter().all(|off| *off < 3e-3), "{smooth:?}");
    assert!(held.iter().all(|off| *off > 3e-2), "{held:?}");
}

#[test]
fn samples_of_a_constant_input_may_be_anywhere() {
    let (stiff, cart) = (written(STIFF), model("cartpole/cartpole.toml"));
    let (even, uneven) = (samples(40, 0.05), vec![0.0, 0.05, 0.3, 1.05, 1.1, 2.0]);
    let common = |t: &[f64], states: &[Vec<f64>]| -> Vec<Vec<f64>> {
        uneven
            .iter()
            .map(|wanted| {
                let k = t.iter().position(|t| (t - wanted).abs() < 1e-9).unwrap();
                states[k].clone()
            })
            .collect()
    };
    let uneven_of_even = {
        // The same instants to the last digit.
        let near = |wanted: &f64| *even.iter().find(|t| (*t - wanted).abs() < 1e-9).unwrap();
        uneven.iter().map(near).collect::<Vec<f64>>()
    };
    for (model, initial) in [
        (&stiff, [1.0, 1.0, 0.0, 0.0]),
        (&cart, [0.0, 2.0, 0.0, 0.0]),
    ] {
        for method in [
            Method::Automatic,
            Method::Tsit5,
            Method::TrBdf2,
            Method::Esdirk34,
            Method::Bdf,
        ] {
            let roll = |t: &[f64]| {
                let u = vec![vec![0.7; t.len()]];
                rolled((method, 1e-6), model, t, &u, &initial).states
            };
            let a = common(&even, &roll(&even));
            let b = roll(&uneven_of_even);
            assert_eq!(a, b, "{method:?} on {}", model.name);
        }
    }
}

#[test]
fn the_same_run_has_the_same_bits_on_any_number_of_threads() {
    let model = written(STIFF);
    let hybrid = Hybrid::of(&model);
    let t = samples(20, 0.05);
    let u = vec![t.iter().map(|t| (9.0 * t).sin()).collect::<Vec<f64>>()];
    let run = AdaptiveRun::new(&hybrid, &t, &u);
    let settings = run.settings(Method::Automatic, 1e-6);
    let from = |k: u32| [0.1 * f64::from(k), 1.0, 0.0, 0.0];
    let alone: Vec<RollOut> = (0..8)
        .map(|k| run.roll(&settings, &from(k)).unwrap())
        .collect();
    for threads in [1, 3, 8] {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        let together: Vec<RollOut> = pool.install(|| {
            (0..8_u32)
                .into_par_iter()
                .map(|k| run.roll(&settings, &from(k)).unwrap())
                .collect()
        });
        assert_eq!(alone, together, "{threads} threads");
    }
}

const RUBBING: &str = r#"
name = "two blocks on springs"
lagrangian = { coordinates = ["quick", "slow"], kinetic = "0.5*(quick_dot^2 + slow_dot^2)", potential = "5e3*quick^2 + 0.5*slow^2" }
"#;

#[test]
fn a_coordinate_that_need_not_be_known_does_not_hold_the_steps_back() {
    let model = written(RUBBING);
    let hybrid = Hybrid::of(&model);
    let t = samples(10, 0.5);
    let run = AdaptiveRun::new(&hybrid, &t, &[]);
    let settings = run.settings(Method::Tsit5, 1e-8);
    let initial = [0.01, 1.0, 0.0, 0.0];
    let all = run.roll(&settings, &initial).unwrap();
    let mut absolute = settings.absolute.clone();
    (absolute[0], absolute[2]) = (1e3, 1e3);
    let one = settings.with_absolute(&absolute);
    let one = run.roll(&one, &initial).unwrap();
    assert!(
        3 * one.statistics.steps < all.statistics.steps,
        "{:?} {:?}",
        one.statistics,
        all.statistics
    );
    for (x, t) in one.states.iter().zip(&t) {
        assert!((x[1] - t.cos()).abs() < 1e-5, "{} at {t}", x[1]);
    }
}

#[test]
fn absolute_tolerances_are_those_of_the_coordinate() {
    let friction =
        "[[effect]]\nkind = 'coulomb_friction'\njoint = 'slow'\nforce = 0.1\nsmoothing = 1e-4\n";
    let hybrid = Hybrid::of(&written(&(RUBBING.to_owned() + friction)));
    let found = absolute_tolerances(&hybrid, 1e-2);
    for (found, expected) in found.iter().zip([1e-5, 1e-5, 1e-5, 1e-6]) {
        assert!((found - expected).abs() < 1e-18, "{found} {expected}");
    }
    let quadruped = Hybrid::of(&model("quadruped/quadruped.toml"));
    assert_eq!(absolute_tolerances(&quadruped, 1e-2).len(), 36);
}

#[test]
fn what_stops_a_run_is_named() {
    let one = |potential: &str, kinetic: &str| {
        written(&format!(
            "name = 'm'\nlagrangian = {{ coordinates = ['x'], kinetic = '{kinetic}', potential = '{potential}' }}\n"
        ))
    };
    let t = samples(10, 1.0);
    let run = |model: &Model, t: &[f64], relative: f64, initial: &[f64]| {
        simulate_adaptively((Method::Automatic, relative), model, "7", t, &[], initial)
    };
    let unstable = one("-x^4", "0.5*x_dot^2");
    let diverged = run(&unstable, &t, 1e-6, &[1.0, 1.0]).unwrap_err();
    assert!(diverged.to_string().contains("run `7`"), "{diverged}");
    let singular = one("x", "(1-x)^2*x_dot^2");
    let stopped = run(&singular, &t, 1e-6, &[1.0, 0.0]).unwrap_err();
    assert!(
        matches!(&stopped, Error::Stopped { time, .. } if *time == 0.0),
        "{stopped}"
    );

    let still = one("0", "0.5*x_dot^2");
    let wrong = run(&still, &[0.0, 2.0, 1.0], 2.0, &[0.0]).unwrap_err();
    let Error::Adaptive { cause, .. } = &wrong else {
        panic!("{wrong}")
    };
    let AdaptiveError::Arguments(faults) = &**cause else {
        panic!("{cause}")
    };
    let expected = [
        ArgumentError::Relative { value: 2.0 },
        ArgumentError::Times {
            index: 2,
            time: 1.0,
            previous: 2.0,
        },
        ArgumentError::InitialLength {
            found: 1,
            expected: 2,
        },
    ];
    assert_eq!(faults[..], expected);
}
