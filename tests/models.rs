//! The mechanisms of `models/`: every file loads, and where one mechanism is there from its bodies and from its energies, both give
//! the same equations of motion.

use std::path::{Path, PathBuf};

use integrators::Rk4;
use lagrange::{Mechanics, state};
use pinode_nn::model::{EffectEntry, Model, Target};

fn models() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models")
}

fn load(path: &str) -> Model {
    Model::load(&models().join(path)).unwrap_or_else(|e| panic!("{path}: {e}"))
}

/// Every model file under `models/`, as `folder/file.toml`.
fn all() -> Vec<String> {
    let mut paths = Vec::new();
    for folder in models().read_dir().unwrap() {
        for file in folder.unwrap().path().read_dir().unwrap() {
            let path = file.unwrap().path();
            // These set up virtual rigs: they are no models.
            let rig = path.ends_with("rig.toml") || path.ends_with("paper.toml");
            if path.extension().is_some_and(|e| e == "toml") && !rig {
                let path = path.strip_prefix(models()).unwrap();
                paths.push(path.to_str().unwrap().to_owned());
            }
        }
    }
    paths.sort();
    paths
}

#[test]
fn every_model_loads_with_no_warning_but_those_meant() {
    let all = all();
    assert!(all.len() > 20, "{all:?}");
    for path in all {
        let model = load(&path);
        // The cross pieces of the platform's joints are left without mass on purpose.
        let massless = |message: &str| {
            path == "stewart/stewart.toml" && message.ends_with("it counts as massless")
        };
        let mut warnings = model.warnings.iter().flat_map(|w| &w.list);
        assert!(
            warnings.all(|w| massless(&w.message)),
            "{path}: {:?}",
            model.warnings
        );
        assert!(!model.name.is_empty(), "{path} has no name");
    }
}

/// Models of one mechanism, from a URDF and from energies.
const TWICE: &[&str] = &[
    "single_pendulum",
    "double_pendulum",
    "triple_pendulum",
    "spherical_pendulum",
    "elastic_pendulum",
    "furuta_pendulum",
    "bead_on_hoop",
    "elastic_joint",
    "gripper",
];

/// Numbers that do not repeat, within ± `range`.
fn generic(k: u32, n: usize, range: f64) -> Vec<f64> {
    let k = f64::from(k);
    (0..n)
        .map(|i| range * (1.3 * i as f64 + 0.7 * k * k + 0.4 * k + 0.2).sin())
        .collect()
}

fn is_spring(effect: &EffectEntry) -> bool {
    effect.kind.name == "linear_spring"
}

/// Q of the springs among the effects at `q`: a spring that a URDF cannot hold.
fn spring_force(model: &Model, q: &[f64]) -> Vec<f64> {
    let mut force = vec![0.0; model.mechanics.nv()];
    for effect in model.effects.iter().filter(|e| is_spring(e)) {
        let Target::Coordinate(i) = effect.target else {
            panic!("a spring that is not on a coordinate")
        };
        force[i] -= effect.values[0] * (q[i] - effect.values[1]);
    }
    force
}

#[test]
fn bodies_and_energies_give_the_same_equations_of_motion() {
    for name in TWICE {
        let bodies = load(&format!("{name}/{name}.toml"));
        let energies = load(&format!("{name}/{name}_text.toml"));
        let (a, b) = (&bodies.mechanics, &energies.mechanics);
        let names = |model: &Model| -> Vec<(String, &'static str)> {
            let coordinates = model.mechanics.coordinates().iter();
            coordinates.map(|c| (c.name.clone(), c.unit())).collect()
        };
        assert_eq!(names(&bodies), names(&energies), "{name}");
        let friction: Vec<_> = bodies.effects.iter().filter(|e| !is_spring(e)).collect();
        assert_eq!(friction, energies.effects.iter().collect::<Vec<_>>());
        assert_eq!(bodies.inputs, energies.inputs, "{name}");

        let n = a.nv();
        for k in 0..50 {
            let (q, v, force) = (
                generic(k, n, 3.0),
                generic(k + 100, n, 5.0),
                generic(k + 200, n, 2.0),
            );
            // The same to 1e-12 of the largest entry of `scale`, the terms that a sum is made of.
            let close = |what: &str, found: &[f64], expected: &[f64], scale: &[f64]| {
                let size = scale.iter().fold(0.0, |s: f64, x| s.max(x.abs()));
                for (f, e) in found.iter().zip(expected) {
                    // Written so that NaN fails.
                    assert!(
                        (f - e).abs() <= 1e-12 * size,
                        "{name}, {what} at {q:?}, {v:?}: {found:?} against {expected:?}"
                    );
                }
            };
            let mass = b.mass_matrix(&q).unwrap();
            let (found, expected) = (a.mass_matrix(&q).unwrap(), mass.as_slice());
            close("M", found.as_slice(), expected, expected);
            // C is of the size of M v: where it vanishes, there is no smaller scale.
            let momentum: Vec<f64> = mass.iter().map(|m| 5.0 * m).collect();
            let found = a.coriolis_matrix(&q, &v).unwrap();
            let expected = b.coriolis_matrix(&q, &v).unwrap();
            close("C", found.as_slice(), expected.as_slice(), &momentum);
            let spring = spring_force(&bodies, &q);
            let mut found = a.gravity_force(&q).unwrap();
            found.iter_mut().zip(&spring).for_each(|(g, f)| *g -= f);
            let expected = b.gravity_force(&q).unwrap();
            let weight = [expected.amax().max(0.1)];
            close("G", found.as_slice(), expected.as_slice(), &weight);
            let with_spring: Vec<f64> = force.iter().zip(&spring).map(|(f, s)| f + s).collect();
            let found = a.forward_dynamics(&q, &v, &with_spring).unwrap();
            let expected = b.forward_dynamics(&q, &v, &force).unwrap();
            // What rounding of the force does to v̇ grows with the condition of M.
            let condition = mass.clone().singular_values();
            let grown = expected.amax() * (condition.max() / condition.min() * 1e-4).max(1.0);
            close("v̇", found.as_slice(), expected.as_slice(), &[grown]);
            let kinetic = b.kinetic_energy(&q, &v).unwrap();
            close(
                "T",
                &[a.kinetic_energy(&q, &v).unwrap()],
                &[kinetic],
                &[kinetic],
            );
        }
        // V up to a constant, with that of the springs.
        let potential = |model: &Model, q: &[f64]| {
            let springs = model.effects.iter().filter(|e| is_spring(e));
            let stored: f64 = springs
                .map(|e| {
                    let Target::Coordinate(i) = e.target else {
                        panic!("a spring that is not on a coordinate")
                    };
                    0.5 * e.values[0] * (q[i] - e.values[1]).powi(2)
                })
                .sum();
            model.mechanics.potential_energy(q).unwrap() + stored
        };
        let difference = |q: &[f64]| potential(&bodies, q) - potential(&energies, q);
        let (here, there) = (generic(7, n, 0.3), generic(8, n, 0.3));
        assert!(
            difference(&here).abs() < 1e-12,
            "{name}: {}",
            difference(&here)
        );
        assert!(difference(&there).abs() < 1e-12, "{name}");
    }
}

/// Advances (q, v) under the generalized force `force` of q by `steps` steps of `h`; `watch` sees every state.
fn roll(
    mechanics: &dyn Mechanics,
    force: impl Fn(&[f64]) -> Vec<f64>,
    x: &mut [f64],
    h: f64,
    steps: usize,
    mut watch: impl FnMut(&[f64]),
) {
    let (nq, nv) = (mechanics.nq(), mechanics.nv());
    let coordinates = mechanics.coordinates();
    let mut rk4 = Rk4::new(nq + nv);
    for k in 0..steps {
        rk4.step(k as f64 * h, h, x, |_t, x, dx| {
            let (q, v) = x.split_at(nq);
            state::position_rate_into(coordinates, q, v, &mut dx[..nq]);
            let a = mechanics.forward_dynamics(q, v, &force(q))?;
            dx[nq..].copy_from_slice(a.as_slice());
            Ok::<(), lagrange::Error>(())
        })
        .unwrap();
        state::normalize(coordinates, &mut x[..nq]);
        watch(x);
    }
}

/// No applied force, for coordinates of one number each.
fn free(q: &[f64]) -> Vec<f64> {
    vec![0.0; q.len()]
}

/// T + V stays, with the springs that a URDF cannot hold and without other forces: over 2 s, or less where something swings fast.
#[test]
fn every_model_keeps_its_energy() {
    for path in all() {
        // A motor works on the driven hoop: what stays there has a test of its own.
        let driven = path == "bead_on_hoop/driven.toml";
        // Closed loops start in states that fit together, in tests of their own.
        let closed = ["four_bar", "slider_crank", "stewart"].map(|name| path.starts_with(name));
        if driven || closed.contains(&true) {
            continue;
        }
        let model = load(&path);
        let mechanics = &*model.mechanics;
        let (nq, nv) = (mechanics.nq(), mechanics.nv());
        // What swings at 436 rad/s (an electric circuit) or 120 rad/s needs short steps.
        let h = match path.split('/').next() {
            Some("silverbox") => 2e-5,
            Some("elastic_joint") => 5e-5,
            _ => 2e-4,
        };
        let stored = |q: &[f64]| -> f64 {
            let springs = model.effects.iter().filter(|e| is_spring(e));
            springs
                .map(|e| match e.target {
                    Target::Coordinate(i) => 0.5 * e.values[0] * (q[i] - e.values[1]).powi(2),
                    Target::Input(_) | Target::Link(_) => 0.0,
                })
                .sum()
        };
        let energies = |x: &[f64]| {
            let (q, v) = x.split_at(nq);
            let kinetic = mechanics.kinetic_energy(q, v).unwrap();
            let potential = mechanics.potential_energy(q).unwrap();
            (kinetic, kinetic + potential + stored(q))
        };
        // From 0.3 everywhere, where no mechanism is singular.
        let coordinates = mechanics.coordinates();
        let zero = state::neutral(coordinates);
        let q = state::integrate(coordinates, &zero, &vec![0.3; nv]).unwrap();
        let mut x = [q, generic(3, nv, 0.5)].concat();
        let start = energies(&x).1;
        let (mut worst, mut moving) = (0.0_f64, 0.0_f64);
        roll(
            mechanics,
            |q| spring_force(&model, q),
            &mut x,
            h,
            10_000,
            |x| {
                let (kinetic, total) = energies(x);
                moving = moving.max(kinetic);
                worst = worst.max((total - start).abs());
                assert!(total.is_finite(), "{path} at {x:?}");
            },
        );
        eprintln!(
            "{path}: T + V changes by {:.1e} of the largest T, {moving:.3} J",
            worst / moving
        );
        assert!(
            worst < 1e-8 * moving,
            "{path}: {worst} J, T up to {moving} J"
        );
    }
}

#[test]
fn the_bead_on_a_free_hoop_keeps_energy_and_angular_momentum() {
    let model = load("bead_on_hoop/bead_on_hoop.toml");
    let mechanics = &model.mechanics;
    let invariants = |x: &[f64]| {
        let (q, v) = x.split_at(2);
        let mass = mechanics.mass_matrix(q).unwrap();
        let momentum = mass[(0, 0)] * v[0] + mass[(0, 1)] * v[1];
        [mechanics.total_energy(q, v).unwrap(), momentum]
    };
    let mut x = [0.0, 0.5, 12.0, 1.0];
    let start = invariants(&x);
    let mut slowest = x[2];
    roll(&**mechanics, free, &mut x, 1e-3, 5000, |x| {
        let now = invariants(x);
        assert!((now[0] - start[0]).abs() < 1e-8 * start[0].abs(), "{now:?}");
        assert!((now[1] - start[1]).abs() < 1e-9 * start[1].abs(), "{now:?}");
        slowest = slowest.min(x[2]);
    });
    // The bead climbs, and the hoop turns visibly more slowly.
    assert!(slowest < 11.5, "{slowest}");
}

#[test]
fn the_bead_on_a_driven_hoop_keeps_jacobis_integral_and_finds_its_height() {
    let model = load("bead_on_hoop/driven.toml");
    let mechanics = &model.mechanics;
    let (m, r, rate, g) = (0.05_f64, 0.15_f64, 10.0_f64, 9.81_f64);
    // T2 - T0 + V
    let integral = |x: &[f64]| {
        let moving = mechanics.kinetic_energy(&x[..1], &x[1..]).unwrap();
        let turning = mechanics.kinetic_energy(&x[..1], &[0.0]).unwrap();
        moving - 2.0 * turning + mechanics.potential_energy(&x[..1]).unwrap()
    };
    let mut x = [0.4, 0.0];
    let (start, energy) = (
        integral(&x),
        mechanics.total_energy(&[0.4], &[0.0]).unwrap(),
    );
    let mut work = 0.0_f64;
    roll(&**mechanics, free, &mut x, 1e-3, 5000, |x| {
        let now = integral(x);
        assert!((now - start).abs() < 1e-9, "{now} against {start}");
        let total = mechanics.total_energy(&x[..1], &x[1..]).unwrap();
        work = work.max((total - energy).abs());
    });
    assert!(work > 1e-2, "the motor does work: {work} J");
    // By hand: T0 = ½ m (Ω R sin θ)², and the bead rests where m R² Ω² sin θ cos θ = m g R sin θ.
    let turning = mechanics.kinetic_energy(&[0.7], &[0.0]).unwrap();
    assert!((turning - 0.5 * m * (rate * r * 0.7_f64.sin()).powi(2)).abs() < 1e-15);
    let height = (g / (rate * rate * r)).acos();
    let rest = mechanics
        .forward_dynamics(&[height], &[0.0], &[0.0])
        .unwrap();
    assert!(rest[0].abs() < 1e-12, "{rest}");
    let lowest = mechanics.forward_dynamics(&[1e-3], &[0.0], &[0.0]).unwrap();
    assert!(lowest[0] > 0.0, "the lowest point is unstable: {lowest}");
}

#[test]
fn the_chart_of_the_spherical_pendulum_ends_where_the_ball_lies_on_the_first_hinge() {
    let model = load("spherical_pendulum/spherical_pendulum.toml");
    let roll = |pitch: f64| model.mechanics.mass_matrix(&[0.3, pitch]).unwrap()[(0, 0)];
    let (hanging, lying) = (roll(0.0), roll(std::f64::consts::FRAC_PI_2));
    // Ball and cross piece about the hinge: 2/5 m r² + J.
    assert!(
        (lying - (0.4 * 0.7 * 0.0277_f64.powi(2) + 2e-6)).abs() < 1e-9,
        "{lying}"
    );
    assert!(hanging / lying > 1e3, "{hanging} against {lying}");
}

#[test]
fn the_coupled_fingers_of_the_gripper_move_as_one() {
    let model = load("gripper/gripper.toml");
    let names: Vec<&str> = model
        .mechanics
        .coordinates()
        .iter()
        .map(|c| c.name.as_str())
        .collect();
    assert_eq!(names, ["wrist", "grip"]);
    // By symmetry the wrist does not feel the fingers: M is diagonal, and G of the wrist is 0.
    for grip in [0.0, 0.3, 0.8] {
        let q = [0.7, grip];
        let mass = model.mechanics.mass_matrix(&q).unwrap();
        assert!(mass[(0, 1)].abs() < 1e-15, "{mass}");
        assert!(model.mechanics.gravity_force(&q).unwrap()[0].abs() < 1e-15);
    }
}
