//! Dry friction that sticks in free runs of models, and the smoothed friction of fits against it.

use std::path::{Path, PathBuf};

use integrators::event::{Direction, EventKind};
use pinode_nn::Error;
use pinode_nn::contact_run::roll_contacts;
use pinode_nn::diagnose::{Outcome, diagnose};
use pinode_nn::effect::{Action, registry};
use pinode_nn::evaluate::Options;
use pinode_nn::free_run::{Scheme, simulate_by};
use pinode_nn::hybrid::Hybrid;
use pinode_nn::log::{Log, Run};
use pinode_nn::model::Model;
use pinode_nn::motion::NotFree;
use pinode_nn::smoothing::{NOTICEABLE, VISIBLE, check};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

const PI: f64 = std::f64::consts::PI;

fn model(path: &str) -> Model {
    let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models");
    Model::load(&models.join(path)).unwrap_or_else(|e| panic!("{path}: {e}"))
}

/// The cart-pole with this smoothing velocity of its Coulomb friction, m/s.
fn cartpole(smoothing: Option<f64>) -> Model {
    let mut model = model("cartpole/cartpole.toml");
    let dry = model.effects.iter_mut().find(|e| e.kind.dry().is_some());
    dry.unwrap().smoothing = smoothing;
    model
}

fn coulomb(model: &Model) -> f64 {
    let dry = model.effects.iter().find(|e| e.kind.dry().is_some());
    dry.unwrap().values[0]
}

/// A block of 1 kg on a table, pushed by `push`, with these effects on `x`.
fn block(noise: f64, effects: &str) -> Model {
    let text = format!(
        "name = \"block\"\n\
         lagrangian = {{ coordinates = [\"x\"], kinetic = \"0.5*x_dot^2\", potential = \"0\" }}\n\
         [[input]]\nname = \"push\"\njoint = \"x\"\n\
         [sensor.x]\nposition_noise = {noise:e}\nvelocity = \"none\"\n\
         [tolerance]\ngain = 0.0\n\
         {effects}"
    );
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("block.toml");
    std::fs::write(&path, text).unwrap();
    Model::load(&path).unwrap_or_else(|e| panic!("{e}"))
}

fn times(seconds: f64) -> Vec<f64> {
    (0..=(seconds / 0.02).round() as usize)
        .map(|k| 0.02 * k as f64)
        .collect()
}

fn simulated(
    scheme: Scheme,
    model: &Model,
    t: &[f64],
    u: &[f64],
    initial: &[f64],
) -> Vec<Vec<f64>> {
    let u = vec![u.to_vec(); model.inputs.len()];
    simulate_by(scheme, model, "0", t, &u, initial, 1e-3).unwrap_or_else(|e| panic!("{e}"))
}

/// States as a recording without noise.
fn log(t: &[f64], u: &[f64], states: &[Vec<f64>]) -> Log {
    let n = states[0].len() / 2;
    let column = |i: usize| states.iter().map(|x| x[i]).collect::<Vec<f64>>();
    Log {
        path: PathBuf::from("log.csv"),
        sha256: String::new(),
        runs: vec![Run {
            id: "0".into(),
            t: t.to_vec(),
            q: (0..n).map(column).collect(),
            v: (n..2 * n).map(|i| Some(column(i))).collect(),
            u: vec![u.to_vec()],
        }],
        warnings: Vec::new(),
    }
}

/// Every kind that `smoothing` changes has the law that it smooths; away from rest the two are the same.
#[test]
fn smoothed_friction_is_the_set_valued_law_away_from_rest() {
    const SMOOTHING: f64 = 3e-3;
    let p = [0.4, 0.7, 0.3, 0.2];
    let mut dry = 0;
    for kind in registry::ALL {
        let Action::Joint(law) = kind.action else {
            assert!(kind.dry().is_none());
            continue;
        };
        let p = &p[..kind.parameters.len()];
        let smoothed = |v: f64| law.force(0.1, v, p, SMOOTHING);
        let Some(friction) = kind.dry() else {
            for v in [0.0, 1e-3, -0.1] {
                assert_eq!(
                    smoothed(v),
                    law.force(0.1, v, p, 2.0 * SMOOTHING),
                    "{kind:?}"
                );
            }
            continue;
        };
        dry += 1;
        for speed in [0.1, 0.5, 2.0] {
            for direction in [Direction::Positive, Direction::Negative] {
                let set = -direction.sign() * friction.size(direction, 0.1, speed, p);
                let found = smoothed(direction.sign() * speed);
                assert!((found - set).abs() < 1e-14, "{kind:?}: {found} for {set}");
            }
        }
    }
    assert_eq!(dry, 4);
}

#[test]
fn without_dry_friction_contacts_are_the_runge_kutta_method() {
    let mut smooth = cartpole(None);
    smooth.effects.retain(|e| e.kind.dry().is_none());
    for (model, initial, seconds) in [
        (smooth, vec![0.1, 2.0, -0.3, 1.0], 2.0),
        (
            model("double_pendulum/double_pendulum_text.toml"),
            vec![1.0, -0.5, 0.2, 0.4],
            2.0,
        ),
        (model("quadruped/quadruped.toml"), Vec::new(), 0.3),
    ] {
        let t = times(seconds);
        let u: Vec<f64> = t.iter().map(|t| 0.5 * (7.0 * t).sin()).collect();
        let initial = match initial.is_empty() {
            false => initial,
            true => {
                let mut x = model.mechanics.neutral();
                x.extend((0..model.mechanics.nv()).map(|i| 0.3 * (i as f64).sin()));
                x
            }
        };
        let a = simulated(Scheme::Rk4, &model, &t, &u, &initial);
        let b = simulated(Scheme::Contacts, &model, &t, &u, &initial);
        assert_eq!(a.len(), b.len());
        for (a, b) in a.iter().flatten().zip(b.iter().flatten()) {
            assert!(
                (a - b).abs() < 1e-10 * (1.0 + a.abs()),
                "{}: {a}, {b}",
                model.name
            );
        }
    }
}

/// Mostly sliding, with stops of the cart in between: the difference goes to 0 in proportion to the smoothing velocity.
#[test]
fn smoothed_friction_goes_to_the_set_valued_law_with_its_smoothing() {
    let t = times(3.0);
    let u: Vec<f64> = t.iter().map(|t| 0.8 * (4.0 * t).sin()).collect();
    let states = simulated(
        Scheme::Contacts,
        &cartpole(None),
        &t,
        &u,
        &[0.0, PI, 0.0, 0.0],
    );
    let log = [log(&t, &u, &states)];
    let options = Options {
        windows: 20,
        longest_step: 1e-4,
        ..Options::default()
    };
    let largest = |smoothing: f64| {
        let found = check(&cartpole(Some(smoothing)), &log, &options).unwrap();
        assert_eq!((found.windows, found.stopped), (20, 0));
        let largest: Vec<f64> = found.coordinates.iter().map(|c| c.largest).collect();
        eprintln!("smoothing {smoothing} m/s: {largest:?} times the noise");
        largest
    };
    let found = [6e-3, 1.5e-3, 3.75e-4].map(largest);
    for pair in found.windows(2) {
        for (coarse, fine) in pair[0].iter().zip(&pair[1]) {
            let factor = coarse / fine;
            assert!(
                (3.0..5.5).contains(&factor),
                "a quarter of the smoothing: {factor}"
            );
        }
    }
}

#[test]
fn a_lively_log_does_not_show_the_smoothing() {
    let t = times(6.0);
    let u: Vec<f64> = t
        .iter()
        .map(|t| 3.0 * (5.0 * t).sin() + 1.5 * (13.0 * t).cos())
        .collect();
    let model = cartpole(None);
    let states = simulated(Scheme::Contacts, &model, &t, &u, &[0.0, PI, 0.0, 0.0]);
    let options = Options {
        windows: 100,
        ..Options::default()
    };
    let found = check(&model, &[log(&t, &u, &states)], &options).unwrap();
    eprintln!("{found:?}");
    assert_eq!(found.stopped, 0);
    assert_eq!(found.visible().count(), 0);
    for c in &found.coordinates {
        assert!(c.rms < 0.1, "{}: {}", c.name, c.rms);
    }
}

/// Held at nine tenths of its friction the cart stands still and its smoothed model creeps with ε artanh 0.9.
#[test]
fn a_log_that_holds_still_shows_that_smoothed_friction_creeps() {
    let model = cartpole(None);
    let t = times(4.0);
    let u = vec![0.9 * coulomb(&model); t.len()];
    let states = simulated(Scheme::Contacts, &model, &t, &u, &[0.1, PI, 0.0, 0.0]);
    // At rest to the last digit.
    assert!(states.iter().all(|x| x[0] == 0.1 && x[2] == 0.0));
    let options = Options {
        windows: 1,
        ..Options::default()
    };
    let found = check(&model, &[log(&t, &u, &states)], &options).unwrap();
    let slider = &found.coordinates[0];
    eprintln!("{found:?}");
    assert_eq!(found.visible().next(), Some(slider));
    let creep = 3e-3 * 0.9_f64.atanh() * options.horizon / slider.noise;
    assert!(
        (0.9 * creep..1.05 * creep).contains(&slider.largest),
        "{} for {creep}",
        slider.largest
    );
    // 0.3 noise at 4.4 mm/s, after the some 10 ms in which it begins to creep.
    let start = slider.starts.unwrap();
    let alone = NOTICEABLE * slider.noise / (3e-3 * 0.9_f64.atanh());
    assert_eq!(start.run, 0);
    assert!(
        (alone..alone + 0.04).contains(&start.t),
        "{} for {alone}",
        start.t
    );
}

#[test]
fn a_cart_that_sticks_stays_while_its_pole_swings() {
    let model = cartpole(None);
    let t = times(3.0);
    let initial = [0.2, PI + 0.05, 0.0, 0.0];
    let states = simulated(Scheme::Contacts, &model, &t, &vec![0.0; t.len()], &initial);
    assert!(states.iter().all(|x| x[0] == 0.2 && x[2] == 0.0));
    let swing = states.iter().map(|x| x[1] - PI).fold(0.0, f64::min);
    assert!(swing < -0.03, "{swing}");
}

#[test]
fn a_slide_ends_at_the_instant_of_its_formula() {
    // v = 0.5 − F t, x = 0.5 t − F t²/2
    let model = block(
        3e-4,
        "[[effect]]\nkind = \"coulomb_friction\"\njoint = \"x\"\nforce = 0.3\n",
    );
    let hybrid = Hybrid::of(&model);
    let (t, theta) = (times(4.0), hybrid.theta());
    let inputs = hybrid.drive(&t, &[vec![0.0; t.len()]], 3, &theta, &[]);
    let motion = roll_contacts(&hybrid, &theta, &inputs, (0, t.len()), &[0.0, 0.5]).unwrap();
    let [event] = motion.events[..] else {
        panic!("{:?}", motion.events)
    };
    assert_eq!((event.law, event.kind), (0, EventKind::Sticks));
    assert!((event.time - 0.5 / 0.3).abs() < 1e-12, "{}", event.time);
    let end = motion.states.last().unwrap();
    assert!(
        (end[0] - 0.125 / 0.3).abs() < 1e-12 && end[1] == 0.0,
        "{end:?}"
    );
}

/// Coulomb, Stribeck and asymmetric friction on one joint hold the sum of their levels, and slide against that of their curves.
#[test]
fn dry_frictions_on_one_joint_add() {
    let model = block(
        3e-4,
        "[[effect]]\nkind = \"coulomb_friction\"\njoint = \"x\"\nforce = 1.0\n\
         [[effect]]\nkind = \"stribeck_friction\"\njoint = \"x\"\n\
         coulomb_force = 0.5\nstatic_force = 0.8\nstribeck_velocity = 0.05\n\
         [[effect]]\nkind = \"asymmetric_coulomb_friction\"\njoint = \"x\"\n\
         force_positive = 0.1\nforce_negative = 0.4\n",
    );
    let t = times(0.2);
    let pushed = |u: f64| {
        let states = simulated(Scheme::Contacts, &model, &t, &vec![u; t.len()], &[0.0; 2]);
        states.last().unwrap().clone()
    };
    for (holds, slides) in [(1.899, 1.901), (-2.199, -2.201)] {
        assert_eq!(pushed(holds), [0.0, 0.0]);
        assert!(pushed(slides)[1] * slides > 0.0, "{slides}");
    }
    // Fast, the hump is gone: v̇ = −(1 + 0.5 + 0.1).
    let states = simulated(
        Scheme::Contacts,
        &model,
        &t,
        &vec![0.0; t.len()],
        &[0.0, 2.0],
    );
    let end = states.last().unwrap();
    assert!((end[1] - (2.0 - 1.6 * 0.2)).abs() < 1e-12, "{end:?}");
}

#[test]
fn under_constraints_contacts_are_refused() {
    let model = model("four_bar/four_bar_text.toml");
    let t = times(0.1);
    let x = vec![0.0; 2 * model.mechanics.nv()];
    let u = vec![vec![0.0; t.len()]; model.inputs.len()];
    let refused = simulate_by(Scheme::Contacts, &model, "0", &t, &u, &x, 1e-3);
    let Err(Error::NotFree(NotFree::Constrained { .. })) = refused else {
        panic!("{refused:?}")
    };
}

/// A viscous force too stiff for the step lets friction chatter, of which a made-up motion would come: it is refused.
#[test]
fn friction_that_chatters_is_an_error() {
    let model = block(
        3e-4,
        "[[effect]]\nkind = \"coulomb_friction\"\njoint = \"x\"\nforce = 2.0\n\
         [[effect]]\nkind = \"linear_spring\"\njoint = \"x\"\nstiffness = 40.0\nrest = 0.0\n\
         [[effect]]\nkind = \"viscous_friction\"\njoint = \"x\"\ncoefficient = 5e5\n",
    );
    let t = times(1.0);
    let u = vec![vec![0.0; t.len()]];
    let rolled = simulate_by(Scheme::Contacts, &model, "0", &t, &u, &[1.0, 0.0], 1e-3);
    let error = rolled.unwrap_err().to_string();
    assert!(
        error.contains("`x`") && error.contains("shorter steps"),
        "{error}"
    );
}

/// A block that is pushed to and fro and stands still under a push in between: its diagnosis makes the friction sharper until it does not
/// creep, and says that it creeps where the model says how sharp it is.
#[test]
fn a_diagnosis_says_where_smoothed_friction_creeps() {
    const FORCE: f64 = 2.0;
    const NOISE: f64 = 1e-4;
    let effect = "[[effect]]\nkind = \"coulomb_friction\"\njoint = \"x\"\nforce = 2.0\n";
    let model = block(NOISE, effect);
    let t = times(40.0);
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut push = 0.0;
    let u: Vec<f64> = (0..t.len())
        .map(|k| {
            if k % 20 == 0 {
                let strong = k % 60 == 0;
                let side = if k % 120 < 60 { 1.0 } else { -1.0 };
                push = side
                    * FORCE
                    * if strong {
                        rng.random_range(1.2..2.5)
                    } else {
                        0.9
                    };
            }
            push
        })
        .collect();
    let states = simulated(Scheme::Contacts, &model, &t, &u, &[0.0, 0.0]);
    let mut text = "t,q.x,u.push\n".to_owned();
    for ((t, u), x) in t.iter().zip(&u).zip(&states) {
        let noise: f64 = rng.sample(StandardNormal);
        text += &format!("{t},{},{u}\n", x[0] + NOISE * noise);
    }
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("log.csv");
    std::fs::write(&path, text).unwrap();
    let diagnosed = |model: &Model| {
        let log = Log::read(&path, model).unwrap();
        diagnose(model, &[log], &[], dir.path(), 0, &|_| {}).unwrap()
    };
    let said = |outcome: &Outcome| {
        let about = |a: &String| a.contains("friction that sticks") && a.contains("`q.x`");
        outcome.diagnosis.advice.iter().any(about)
    };
    let creeps = |outcome: &Outcome| {
        let found = outcome.diagnosis.numerics.set_valued.as_ref().unwrap();
        assert_eq!((found.windows, found.stopped), (24, 0));
        found.coordinates[0].rms
    };
    let sharp = diagnosed(&model);
    let left = creeps(&sharp);
    assert!(left < VISIBLE && !said(&sharp), "{left}");
    let written = Model::load(&sharp.model).unwrap().effects[0].smoothing;
    assert!(written.unwrap() < 2e-3, "{written:?}");

    let smooth = diagnosed(&block(NOISE, &format!("{effect}smoothing = 0.003\n")));
    assert!(creeps(&smooth) > VISIBLE && said(&smooth));
    let written = Model::load(&smooth.model).unwrap().effects[0].smoothing;
    assert_eq!(written, Some(3e-3));
}

#[cfg(feature = "cli")]
#[test]
fn simulate_by_contacts_writes_a_cart_that_holds_still() {
    let dir = tempfile::tempdir().unwrap();
    let cartpole =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/cartpole/cartpole.toml");
    // The cart slides to rest in some 0.7 s, then 0.1 N push and do not move it.
    let mut text = "t,q.slider,q.pole,v.slider,v.pole,u.motor\n".to_owned();
    for t in times(2.0) {
        let u = if t < 1.5 { 0.0 } else { 0.1 };
        text += &format!("{t},{},{PI},0.2,0,{u}\n", 0.2 * t);
    }
    std::fs::write(dir.path().join("log.csv"), text).unwrap();
    let last = |method: &str| -> Vec<f64> {
        let output = std::process::Command::new(env!("CARGO_BIN_EXE_pinode"))
            .current_dir(dir.path())
            .arg("simulate")
            .arg(&cartpole)
            .args(["--log", "log.csv", "--initial", "0,3.141592653589793,0.2,0"])
            .args(["--method", method, "--out", "out.csv"])
            .output()
            .unwrap();
        assert!(output.status.success(), "{output:?}");
        let rows = std::fs::read_to_string(dir.path().join("out.csv")).unwrap();
        let columns = |line: &str| line.split(',').map(|x| x.parse().unwrap_or(0.0)).collect();
        let rows: Vec<Vec<f64>> = rows.lines().skip(1).map(columns).collect();
        let moved = rows[75..].iter().map(|row| (row[1] - rows[75][1]).abs());
        vec![moved.fold(0.0, f64::max), rows[rows.len() - 1][3]]
    };
    assert_eq!(last("contacts"), [0.0, 0.0]);
    assert!(last("rk4")[0] > 1e-4);
}
