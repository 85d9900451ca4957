//! Backlash, whose motor the mechanism has in its masses: against models in which that is made by hand.

use std::path::Path;

use pinode_nn::hybrid::{Hybrid, State};
use pinode_nn::model::Model;
use pinode_nn::shooting::{Roller, Trajectory};

/// kg, of the cart.
const CART: f64 = 0.466;
/// kg, of the motor.
const MOTOR: f64 = 0.1;

/// The cart-pole without friction with a cart of this mass, and what `toml` says besides.
fn read(cart: f64, toml: &str) -> Result<Model, pinode_nn::Error> {
    let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/cartpole");
    let urdf = std::fs::read_to_string(models.join("cartpole.urdf")).unwrap();
    let own = format!("value=\"{CART}\"");
    assert_eq!(urdf.matches(&own).count(), 1);
    let dir = tempfile::tempdir().unwrap();
    let urdf = urdf.replace(&own, &format!("value=\"{cart}\""));
    std::fs::write(dir.path().join("robot.urdf"), urdf).unwrap();
    let input = "[[input]]\nname = \"motor\"\njoint = \"slider\"\n";
    let text = format!("urdf = \"robot.urdf\"\n{input}{toml}");
    Model::parse(&dir.path().join("model.toml"), text)
}

fn model(cart: f64, toml: &str) -> Hybrid {
    Hybrid::of(&read(cart, toml).unwrap_or_else(|e| panic!("{e}")))
}

fn backlash(values: &str) -> String {
    format!("[[effect]]\nkind = \"backlash\"\ninput = \"motor\"\n{values}\n")
}

/// (q, v, h) after 0.5 s under a push to and fro.
fn after_a_push(hybrid: &Hybrid, start: &[f64]) -> Vec<f64> {
    let t: Vec<f64> = (0..26).map(|k| 0.02 * f64::from(k)).collect();
    let u: Vec<f64> = t.iter().map(|t| 2.0 * (9.0 * t).sin()).collect();
    let theta = hybrid.theta();
    let inputs = hybrid.drive(&t, &[u], 400, &theta, &[]);
    let mut out = Trajectory::default();
    Roller::new(hybrid, &[])
        .roll(&theta, &inputs, (0, t.len()), start, &mut out)
        .unwrap();
    out.states[out.states.len() - hybrid.nx()..].to_vec()
}

#[test]
fn hard_teeth_without_play_leave_the_motion_as_it_is() {
    let start = [0.0, 2.0, 0.1, -1.0];
    let rigid = after_a_push(&model(CART, ""), &start);
    let distance = |stiffness: f64, damping: f64| {
        let values = format!(
            "gap = 0.0\nmotor_inertia = {MOTOR}\nstiffness = {stiffness}\ndamping = {damping}"
        );
        let with = model(CART, &backlash(&values));
        let found = after_a_push(&with, &[0.0, 2.0, 0.1, -1.0, 0.0, 0.1]);
        let squares = rigid.iter().zip(&found).map(|(a, b)| (a - b).powi(2));
        squares.sum::<f64>().sqrt()
    };
    // What teeth give is force over stiffness.
    let (soft, hard) = (distance(2e4, 40.0), distance(32e4, 160.0));
    assert!(soft < 2e-3 && soft / hard > 10.0, "{soft:e} {hard:e}");
    // A motor beside the cart's mass would be seen.
    let heavier = after_a_push(&model(CART + MOTOR, ""), &start);
    assert!((heavier[0] - rigid[0]).abs() > 100.0 * hard);
}

#[test]
fn within_the_play_the_rest_of_the_cart_moves_without_the_motor_and_its_force() {
    let values = format!("gap = 0.02\nmotor_inertia = {MOTOR}\nstiffness = 1e4\ndamping = 10.0");
    let (with, light) = (model(CART, &backlash(&values)), model(CART - MOTOR, ""));
    let acceleration = |hybrid: &Hybrid, u: f64, h: &[f64]| {
        let theta = hybrid.theta();
        let inputs = hybrid.drive(&[0.0, 1.0], &[vec![u; 2]], 1, &theta, &[]);
        let mut memory = hybrid.memory(&[]);
        let (q, v): (&[f64], &[f64]) = (&[0.1, 2.2], &[0.3, -2.0]);
        let state = State { q, v, h };
        hybrid
            .acceleration(state, &theta, &inputs, 0, &mut memory)
            .unwrap();
        memory.acceleration.as_slice().to_vec()
    };
    let expected = acceleration(&light, 0.0, &[]);
    // Up to the rounded corners of the teeth, and however fast the motor goes.
    for (place, speed) in [(0.0, 0.3), (0.0095, 0.3), (-0.0095, -1.0)] {
        let found = acceleration(&with, 3.0, &[place, speed]);
        for (a, b) in found.iter().zip(&expected) {
            assert!(
                (a - b).abs() < 1e-9 * (1.0 + b.abs()),
                "{place} m: {found:?} {expected:?}"
            );
        }
    }
    // In contact the teeth push.
    assert!(acceleration(&with, 3.0, &[0.0105, 0.3])[0] > expected[0] + 5.0);
}

#[test]
fn what_a_file_leaves_out_goes_with_the_inertia_of_the_joint() {
    let total = CART + 0.06 + 0.012;
    let model = read(CART, &backlash("gap = 0.004")).unwrap();
    let [gap, stiffness, damping, inertia, on_motor] = model.effects[0].values[..] else {
        panic!("{:?}", model.effects)
    };
    assert_eq!((gap, on_motor), (0.004, 0.0));
    assert!((inertia / total - 0.1).abs() < 1e-9, "{inertia} of {total}");
    assert!((stiffness / (160_000.0 * inertia) - 1.0).abs() < 1e-12);
    assert!((damping / (480.0 * inertia) - 1.0).abs() < 1e-12);
}

#[test]
fn a_motor_that_is_all_of_what_the_joint_moves_is_refused() {
    let error = read(CART, &backlash("gap = 0.004\nmotor_inertia = 0.6")).unwrap_err();
    let said = error.to_string();
    for part in ["motor_inertia = 0.6", "kg", "`slider`", "give less"] {
        assert!(said.contains(part), "{said}");
    }
}

/// A heavy joint asks for more stiffness than a model file can hold: what is left out stays within it, so that the file can be read again.
#[test]
fn what_a_file_leaves_out_stays_within_its_bounds() {
    let model = read(1e9, &backlash("gap = 0.004")).unwrap();
    for (spec, value) in model.effects[0]
        .kind
        .parameters
        .iter()
        .zip(&model.effects[0].values)
    {
        assert!(
            (spec.lower..=spec.upper).contains(value),
            "{}: {value}",
            spec.name
        );
    }
    assert_eq!(model.effects[0].values[1], 1e12);
}
