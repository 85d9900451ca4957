//! Models that are heavier than what they stand for: less mass and less inertia have their names too.

use super::pendulum::*;
use pinode_nn::diagnose::diagnose;
use pinode_nn::diagnose::verdict::Diagnosis;
use pinode_nn::log::{Log, Run};
use pinode_nn::model::Model;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// The only effect that was found, of this kind, and its only parameter.
fn only(found: &Diagnosis, kind: &str) -> (f64, f64) {
    let [effect] = found.effects.as_slice() else {
        panic!("{:?}", found.effects);
    };
    assert_eq!(effect.kind, kind, "{effect:?}");
    assert!(!effect.beside_fixed, "{effect:?}");
    let parameter = effect.parameters.values().next().unwrap();
    (parameter.value, parameter.std.unwrap())
}

/// The weight is right, so that no shorter pendulum would do.
#[test]
fn a_pendulum_with_less_inertia_than_its_model_is_told_so() {
    let truth = 0.9 * INERTIA;
    // What `log` divides by its own inertia.
    let law = |_, [phi, v]: [f64; 2], u: f64| {
        let weight = WEIGHT * phi.sin();
        weight + (u - VISCOUS * v - weight) * INERTIA / truth
    };
    let found = diagnosed(&model(true), log(21, law));
    let (less, error) = only(&found, "reflected_inertia");
    let off = less - (truth - INERTIA);
    assert!(off.abs() < 3.0 * error && error < 2e-4, "{less} ± {error}");
    assert!(found.gap.after < 2.0, "{:?}", found.gap);
    assert!(!may_be_elastic(&found));
}

fn may_be_elastic(found: &Diagnosis) -> bool {
    let mut names = found.effects.iter().flat_map(|e| &e.indistinguishable_from);
    let named = names.any(|name| name.kind == "elastic_transmission");
    let told = |advice: &String| advice.contains("behind an elastic transmission: a spring of");
    assert_eq!(named, found.advice.iter().any(told), "{:?}", found.advice);
    named
}

/// The rotor of its motor, on a rigid shaft. That the shaft is rigid nobody can know.
#[test]
fn the_inertia_of_a_motor_may_be_behind_a_stiff_spring() {
    let truth = 1.3 * INERTIA;
    let law = |_, [phi, v]: [f64; 2], u: f64| {
        let weight = WEIGHT * phi.sin();
        weight + (u - VISCOUS * v - weight) * INERTIA / truth
    };
    let found = diagnosed(&model(true), log(21, law));
    let (more, error) = only(&found, "reflected_inertia");
    let off = more - (truth - INERTIA);
    assert!(off.abs() < 3.0 * error, "{more} ± {error}");
    assert!(may_be_elastic(&found), "{:?}", found.effects);
}

const HEAVY: f64 = 1.0;
const LIGHT: f64 = 0.8;
const SPRING: f64 = 20.0;
const DAMPING: f64 = 0.6;

/// A block on a spring that is known: m ẍ = u − k x − c ẋ, 60 s at 50 Hz, u held.
fn block() -> Log {
    let mut draws = ChaCha8Rng::seed_from_u64(22);
    let mut noise = || -> f64 { StandardNormal.sample(&mut draws) };
    let t: Vec<f64> = (0..3000).map(|k| 0.02 * f64::from(k)).collect();
    let force = |t: f64| 2.0 * (1.1 * t).sin() + 2.0 * (3.7 * t).sin() + 1.5 * (8.3 * t).cos();
    let u: Vec<f64> = t.iter().map(|&t| force(t)).collect();
    let (mut x, mut v) = (0.0, 0.0);
    let mut q = Vec::new();
    for &u in &u {
        q.push(x + 1e-3 * noise());
        let rate = |x: f64, v: f64| (v, (u - SPRING * x - DAMPING * v) / LIGHT);
        for _ in 0..20 {
            let h = 1e-3;
            let a = rate(x, v);
            let b = rate(x + 0.5 * h * a.0, v + 0.5 * h * a.1);
            let c = rate(x + 0.5 * h * b.0, v + 0.5 * h * b.1);
            let d = rate(x + h * c.0, v + h * c.1);
            x += h / 6.0 * (a.0 + 2.0 * b.0 + 2.0 * c.0 + d.0);
            v += h / 6.0 * (a.1 + 2.0 * b.1 + 2.0 * c.1 + d.1);
        }
    }
    log_of(t, vec![q], u)
}

/// One recording of positions.
fn log_of(t: Vec<f64>, q: Vec<Vec<f64>>, u: Vec<f64>) -> Log {
    Log {
        path: "log.csv".into(),
        sha256: String::new(),
        runs: vec![Run {
            id: "0".into(),
            v: vec![None; q.len()],
            q,
            u: vec![u],
            t,
        }],
        warnings: Vec::new(),
    }
}

#[test]
fn a_block_that_is_lighter_than_its_model_is_told_so_and_the_new_model_can_be_read() {
    let dir = tempfile::tempdir().unwrap();
    let urdf = format!(
        r#"<robot name="block"><link name="rail"/>
  <link name="block"><inertial><mass value="{HEAVY}"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
  <joint name="slide" type="prismatic"><parent link="rail"/><child link="block"/><axis xyz="1 0 0"/>
    <limit lower="-9" upper="9" effort="9" velocity="9"/></joint></robot>"#
    );
    std::fs::write(dir.path().join("block.urdf"), urdf).unwrap();
    let text = |more: &str| {
        format!(
            "urdf = \"block.urdf\"\n[[input]]\nname = \"motor\"\njoint = \"slide\"\n\
             [[effect]]\nkind = \"linear_spring\"\njoint = \"slide\"\nstiffness = {SPRING}\nrest = 0.0\nfixed = true\n\
             [[effect]]\nkind = \"viscous_friction\"\njoint = \"slide\"\ncoefficient = {DAMPING}\nfixed = true\n{more}"
        )
    };
    let path = dir.path().join("block.toml");
    let given = Model::parse(&path, text("")).unwrap_or_else(|e| panic!("{e}"));
    let out = dir.path().join("out");
    let outcome =
        diagnose(&given, &[block()], &[], &out, 0, &|_| ()).unwrap_or_else(|e| panic!("{e}"));
    let found = &outcome.diagnosis;
    let [effect] = found.effects.as_slice() else {
        panic!("{:?}", found.effects);
    };
    // On one slide a mass and a rotor's inertia are the same.
    let same = ["added_mass", "reflected_inertia"];
    assert!(same.contains(&effect.kind.as_str()), "{effect:?}");
    let other = &effect.indistinguishable_from;
    assert!(
        other.iter().any(|n| same.contains(&n.kind.as_str())),
        "{other:?}"
    );
    // With what its tolerance of 2 % takes.
    let scale = found
        .constants
        .iter()
        .find(|c| c.name.contains("mass scale"))
        .unwrap();
    let mass = HEAVY * scale.fitted + effect.parameters.values().next().unwrap().value;
    assert!((mass - LIGHT).abs() < 0.004, "{mass}");
    assert!(found.gap.after < 2.0, "{:?}", found.gap);
    Model::load(&outcome.model).unwrap_or_else(|e| panic!("{e}"));

    let less = |mass: f64| {
        text(&format!(
            "[[effect]]\nkind = \"added_mass\"\nlink = \"block\"\nmass = {mass}\n"
        ))
    };
    assert!(Model::parse(&path, less(-0.85)).is_ok());
    let refused = Model::parse(&path, less(-0.95)).err().unwrap().to_string();
    assert!(refused.contains("at least -0.9 kg"), "{refused}");
}

const CART: f64 = 1.0;
const POLE: f64 = 0.3;
const LENGTH: f64 = 0.25;
const RUBS: [f64; 2] = [2.0, 4e-3];

/// A cart with a pole that hangs from it, of this mass and the inertia about its centre of a rod's, 60 s at 50 Hz, u held:
/// (M + m) ẍ + m l (φ̈ cos φ − φ̇² sin φ) = u − c ẋ and (J + m l²) φ̈ + m l ẍ cos φ + m g l sin φ = −b φ̇.
fn cart_with_a_pole_of(mass: f64) -> Log {
    let mut draws = ChaCha8Rng::seed_from_u64(23);
    let mut noise = || -> f64 { StandardNormal.sample(&mut draws) };
    let t: Vec<f64> = (0..3000).map(|k| 0.02 * f64::from(k)).collect();
    let force =
        |t: f64| 3.0 * (1.9 * t).sin() + 4.0 * (4.3 * t + 1.0).sin() + 4.0 * (7.7 * t + 2.0).cos();
    let u: Vec<f64> = t.iter().map(|&t| force(t)).collect();
    let (first, about) = (mass * LENGTH, mass * LENGTH * LENGTH * 4.0 / 3.0);
    let rate = |[_, phi, v, w]: [f64; 4], u: f64| {
        let (sin, cos) = phi.sin_cos();
        let push = u - RUBS[0] * v + first * w * w * sin;
        let turn = -RUBS[1] * w - first * 9.81 * sin;
        let determinant = (CART + mass) * about - (first * cos).powi(2);
        let a = (push * about - turn * first * cos) / determinant;
        let alpha = (turn * (CART + mass) - push * first * cos) / determinant;
        [v, w, a, alpha]
    };
    let mut s = [0.0, 0.1, 0.0, 0.0];
    let mut q = vec![Vec::new(), Vec::new()];
    for &u in &u {
        q[0].push(s[0] + 3e-4 * noise());
        q[1].push(s[1] + 1e-3 * noise());
        for _ in 0..20 {
            let h = 1e-3;
            let ahead = |by: f64, k: [f64; 4]| [0, 1, 2, 3].map(|i| s[i] + by * k[i]);
            let a = rate(s, u);
            let b = rate(ahead(0.5 * h, a), u);
            let c = rate(ahead(0.5 * h, b), u);
            let d = rate(ahead(h, c), u);
            s = [0, 1, 2, 3].map(|i| s[i] + h / 6.0 * (a[i] + 2.0 * (b[i] + c[i]) + d[i]));
        }
    }
    log_of(t, q, u)
}

/// Its mass and its inertia: gain, masses and frictions that all move a little would do the same.
#[test]
fn a_link_that_is_lighter_as_a_whole_is_a_constant_and_no_gain_error() {
    let inertia = POLE * LENGTH * LENGTH / 3.0;
    let dir = tempfile::tempdir().unwrap();
    let urdf = format!(
        r#"<robot name="cartpole"><link name="rail"/>
  <link name="cart"><inertial><mass value="{CART}"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
  <link name="pole"><inertial><origin xyz="0 0 -{LENGTH}"/><mass value="{POLE}"/>
    <inertia ixx="{inertia}" ixy="0" ixz="0" iyy="{inertia}" iyz="0" izz="{inertia}"/></inertial></link>
  <joint name="slide" type="prismatic"><parent link="rail"/><child link="cart"/><axis xyz="1 0 0"/>
    <limit lower="-99" upper="99" effort="99" velocity="99"/></joint>
  <joint name="hinge" type="continuous"><parent link="cart"/><child link="pole"/><axis xyz="0 -1 0"/></joint></robot>"#
    );
    std::fs::write(dir.path().join("cartpole.urdf"), urdf).unwrap();
    let [slide, hinge] = RUBS;
    let text = format!(
        "urdf = \"cartpole.urdf\"\n[[input]]\nname = \"motor\"\njoint = \"slide\"\n\
         [[effect]]\nkind = \"viscous_friction\"\njoint = \"slide\"\ncoefficient = {slide}\n\
         [[effect]]\nkind = \"viscous_friction\"\njoint = \"hinge\"\ncoefficient = {hinge}\n"
    );
    let given = Model::parse(&dir.path().join("cartpole.toml"), text).unwrap();
    for share in [0.8, 1.25] {
        let found = diagnosed(&given, cart_with_a_pole_of(share * POLE));
        assert!(found.effects.is_empty(), "{share}: {:?}", found.effects);
        let of = |name: &str| {
            let mut constants = found.constants.iter();
            constants.find(|c| c.name.contains(name)).unwrap()
        };
        let pole = of("mass scale of `pole`");
        let off = (pole.fitted - share).abs();
        assert!(off < 3.0 * pole.std.unwrap() && off < 0.02, "{pole:?}");
        assert!(
            advises(&found, "mass scale of `pole`"),
            "{:?}",
            found.advice
        );
        let cart = of("mass scale of `cart`");
        assert!(cart.tolerances().abs() < 2.0, "{cart:?}");
        assert!(found.gap.after < 2.0, "{:?}", found.gap);
    }
}
