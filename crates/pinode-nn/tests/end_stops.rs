//! End stops: compliant in fits, hard in runs with contacts, and the two against each other and against closed forms.

use std::path::{Path, PathBuf};

use integrators::event::EventKind;
use pinode_nn::contact_run::{ContactRunError, roll_contacts};
use pinode_nn::diagnose::verdict::Verdict;
use pinode_nn::diagnose::{diagnose, diagnose_without};
use pinode_nn::effect::registry;
use pinode_nn::evaluate::Options;
use pinode_nn::free_run::{FreeRun, FreeRunError, NoSuchSpan, Scheme, simulate_by};
use pinode_nn::hybrid::{Hybrid, HybridContacts};
use pinode_nn::log::{Log, Run};
use pinode_nn::model::{Model, Revision};
use pinode_nn::shooting::Trajectory;
use pinode_nn::smoothing::check;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

const NOISE: f64 = 3e-4;

/// A block of 1 kg on a table, pushed by `push`, with these effects on `x`.
fn block_text(effects: &str) -> String {
    format!(
        "name = \"block\"\n\
         lagrangian = {{ coordinates = [\"x\"], kinetic = \"0.5*x_dot^2\", potential = \"0\" }}\n\
         [[input]]\nname = \"push\"\njoint = \"x\"\n\
         [sensor.x]\nposition_noise = {NOISE:e}\nvelocity = \"none\"\n\
         [tolerance]\ngain = 0.0\n\
         {effects}"
    )
}

fn block(effects: &str) -> Model {
    Model::parse(Path::new("block.toml"), block_text(effects)).unwrap_or_else(|e| panic!("{e}"))
}

fn stop(places: &str, stiffness: f64, damping: f64) -> String {
    format!(
        "[[effect]]\nkind = \"end_stop\"\njoint = \"x\"\n{places}\nstiffness = {stiffness:e}\ndamping = {damping:e}\n"
    )
}

/// e of 1 kg.
fn restitution(stiffness: f64, damping: f64) -> f64 {
    let stop = registry::find("end_stop").unwrap().stop().unwrap();
    stop.restitution(1.0, &[-1.0, 1.0, stiffness, damping])
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
    initial: [f64; 2],
) -> Vec<Vec<f64>> {
    simulate_by(scheme, model, "0", t, &[u.to_vec()], &initial, 1e-3)
        .unwrap_or_else(|e| panic!("{e}"))
}

#[test]
fn a_block_strikes_its_stops_at_the_times_of_its_restitution() {
    let model = block(&stop("lower = -0.1\nupper = 0.1", 1e4, 60.0));
    let hybrid = Hybrid::of(&model);
    let (t, theta) = (times(4.0), hybrid.theta());
    let inputs = hybrid.drive(&t, &[vec![0.0; t.len()]], 3, &theta, &[]);
    let motion = roll_contacts(&hybrid, &theta, &inputs, (0, t.len()), &[0.0, 0.5]).unwrap();
    let touches = HybridContacts::new(&hybrid, &theta, &inputs)
        .unwrap()
        .touches();
    let named: Vec<String> = touches.iter().map(ToString::to_string).collect();
    assert_eq!(named, ["lower end stop of `x`", "upper end stop of `x`"]);

    let e = restitution(1e4, 60.0);
    assert!((0.6..0.7).contains(&e), "{e}");
    let (mut time, mut speed) = (0.2, 0.5);
    let mut count = 0;
    for (k, event) in motion.events.iter().enumerate() {
        assert_eq!(event.law, (k + 1) % 2);
        assert!(
            (event.time - time).abs() < 1e-12,
            "{} for {time}",
            event.time
        );
        let EventKind::Impact { before, after } = event.kind else {
            panic!("{event:?}")
        };
        assert!((before + speed).abs() < 1e-13 && (after - e * speed).abs() < 1e-13);
        speed *= e;
        time += 0.2 / speed;
        count += 1;
    }
    assert!(count >= 3 && time > 4.0, "{count} blows");
}

#[test]
fn a_block_that_is_pushed_comes_to_rest_on_its_stop_and_leaves_it_when_pulled() {
    let model = block(&stop("upper = 0.1", 1e4, 60.0));
    let e = restitution(1e4, 60.0);
    // 2 N: it strikes after √(0.1) s and bounces for 2 e/(1 − e) of that.
    let first = 0.1_f64.sqrt();
    let rest = first * (1.0 + 2.0 * e / (1.0 - e));
    let t = times(2.4);
    let pulled = |t: f64| t > 1.99;
    let u: Vec<f64> = t
        .iter()
        .map(|&t| if pulled(t) { -1.0 } else { 2.0 })
        .collect();
    assert!(rest < 1.9);
    let states = simulated(Scheme::Contacts, &model, &t, &u, [0.0, 0.0]);
    for (t, x) in t.iter().zip(&states) {
        if (rest..2.001).contains(t) {
            assert_eq!(x[..], [0.1, 0.0], "t = {t}");
        }
        if pulled(*t) {
            let expected = 0.1 - 0.5 * (t - 2.0).powi(2);
            assert!((x[0] - expected).abs() < 1e-12, "t = {t}: {x:?}");
        }
    }
    let hybrid = Hybrid::of(&model);
    let theta = hybrid.theta();
    let inputs = hybrid.drive(&t, &[u], 3, &theta, &[]);
    let motion = roll_contacts(&hybrid, &theta, &inputs, (0, t.len()), &[0.0, 0.0]).unwrap();
    // Bounces lower than what is rounding in 0.1 m, 2e-14 m, are none.
    let rests = motion.events.iter().find(|e| e.kind == EventKind::Rests);
    assert!(
        (rests.unwrap().time - rest).abs() < 1e-6,
        "{rests:?} for {rest}"
    );
    let last = motion.events.last().unwrap();
    assert_eq!(last.kind, EventKind::LetsGo);
    assert!((last.time - 2.0).abs() < 1e-12, "{last:?}");
}

/// Behind the blow the two are apart by what the block would have gone in the time of contact, π √(m/k) about.
#[test]
fn a_compliant_stop_goes_to_the_hard_one_with_its_time_of_contact() {
    let t = times(0.6);
    let u = vec![0.0; t.len()];
    let apart = |stiffness: f64| {
        // The same ζ = 0.3.
        let model = block(&stop("upper = 0.1", stiffness, 0.6 * stiffness.sqrt()));
        let [compliant, hard] = [Scheme::Rk4, Scheme::Contacts]
            .map(|scheme| simulated(scheme, &model, &t, &u, [0.0, 0.5]).pop().unwrap());
        assert!(
            (compliant[1] - hard[1]).abs() < 1e-3,
            "{compliant:?} {hard:?}"
        );
        (compliant[0] - hard[0]) / (0.5 * (1.0 / stiffness).sqrt())
    };
    let found = [1e3, 1.6e4, 2.56e5].map(apart);
    eprintln!("apart by {found:?} speeds and times √(m/k)");
    for factor in found {
        assert!((0.8..1.25).contains(&(factor / found[0])), "{found:?}");
        assert!((0.5..3.2).contains(&factor), "{found:?}");
    }
}

/// The check of the smoothing is about friction: stops give on both sides, whatever their stiffness.
#[test]
fn the_check_of_smoothed_friction_leaves_stops_as_they_are() {
    let t = times(4.0);
    let u: Vec<f64> = t.iter().map(|t| 2.0 * (4.0 * t).sin()).collect();
    let soft = stop("lower = -0.1\nupper = 0.1", 300.0, 3.0);
    let friction = "[[effect]]\nkind = \"coulomb_friction\"\njoint = \"x\"\nforce = 0.05\n";
    for (effects, most) in [(soft.clone(), 1e-6), (soft.clone() + friction, 1.0)] {
        let model = block(&effects);
        let states = simulated(Scheme::Rk4, &model, &t, &u, [0.0, 0.0]);
        assert!(states.iter().any(|x| x[0] > 0.11));
        let log = Log {
            path: PathBuf::from("log.csv"),
            sha256: String::new(),
            runs: vec![Run {
                id: "0".into(),
                t: t.clone(),
                q: vec![states.iter().map(|x| x[0]).collect()],
                v: vec![Some(states.iter().map(|x| x[1]).collect())],
                u: vec![u.clone()],
            }],
            warnings: Vec::new(),
        };
        let options = Options {
            windows: 20,
            ..Options::default()
        };
        let found = check(&model, &[log], &options).unwrap();
        eprintln!("{found:?}");
        assert_eq!(found.stopped, 0);
        assert!(found.coordinates[0].rms < most);
    }
}

#[test]
fn a_stop_on_one_side_is_read_checked_and_written_back() {
    let model = block(&stop("upper = 0.1", 1e4, 60.0));
    assert_eq!(model.effects[0].values, [f64::NEG_INFINITY, 0.1, 1e4, 60.0]);
    let mut revision = Revision::of(&model);
    revision.effects[0].0.values[1] = 0.125;
    let dir = tempfile::tempdir().unwrap();
    let path = model
        .write_revision(dir.path(), "new.toml", &revision)
        .unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    assert!(
        text.contains("upper = 0.125") && !text.contains("lower"),
        "{text}"
    );
    assert_eq!(
        Model::load(&path).unwrap().effects,
        [revision.effects[0].0.clone()]
    );

    let refused = |places: &str| {
        let text = block_text(&stop(places, 1e4, 60.0));
        Model::parse(Path::new("block.toml"), text)
            .unwrap_err()
            .to_string()
    };
    let nowhere = refused("");
    assert!(
        nowhere.contains("give `lower`, `upper` or both"),
        "{nowhere}"
    );
    let crossed = refused("lower = 0.2\nupper = 0.1");
    assert!(crossed.contains("give lower < upper"), "{crossed}");
    let text = block_text(&stop("upper = 0.1", 1e4, 60.0)).replace(
        "coordinates = [\"x\"],",
        "coordinates = [\"x\"], angles = [\"x\"],",
    );
    let round = Model::parse(Path::new("block.toml"), text)
        .unwrap_err()
        .to_string();
    assert!(round.contains("has no ends"), "{round}");
}

/// More samples than there are used to end in a panic, or in the last state again and again.
#[test]
fn a_span_that_the_recording_does_not_have_is_refused() {
    let model = block("");
    let hybrid = Hybrid::of(&model);
    let t = times(0.2);
    let u = vec![vec![0.0; t.len()]];
    let run = FreeRun::new(&hybrid, &t, &u, 1e-3);
    let theta = hybrid.theta();
    let inputs = hybrid.drive(&t, &u, 2, &theta, &[]);
    let mut out = Trajectory::default();
    for (span, there) in [
        ((0, 11), true),
        ((10, 1), true),
        ((0, 12), false),
        ((11, 1), false),
        ((3, 0), false),
        ((usize::MAX, 2), false),
    ] {
        let (first, count) = span;
        let rolled = run.roll(&mut run.roller(), span, &[0.0, 0.1], &mut out);
        let stuck = roll_contacts(&hybrid, &theta, &inputs, span, &[0.0, 0.1]);
        if there {
            assert_eq!(rolled, Ok(()));
            assert_eq!(stuck.unwrap().states.len(), count);
            continue;
        }
        let none = NoSuchSpan {
            first,
            count,
            samples: 11,
        };
        assert_eq!(rolled, Err(FreeRunError::Span(none)));
        assert_eq!(stuck, Err(ContactRunError::Span(none)));
    }
}

#[test]
fn a_run_that_starts_behind_a_stop_names_it() {
    let model = block(&stop("upper = 0.1", 1e4, 60.0));
    let t = times(0.1);
    let u = vec![vec![0.0; t.len()]];
    let rolled = simulate_by(Scheme::Contacts, &model, "0", &t, &u, &[0.2, 0.0], 1e-3);
    let said = rolled.unwrap_err().to_string();
    assert!(
        said.contains("start in front of the stop") && said.contains("upper end stop of `x`"),
        "{said}"
    );
}

/// 80 s of the block with viscous friction b = 0.5 N·s/m under a force that is held between samples, with a hard stop of restitution e at 0.1 m:
/// x(t) = x + u/b t + (v − u/b) (1 − e^{−bt})/b between the blows, whose times are bisected. With the noise of the sensor, as a log; and the number of blows.
fn struck(e: f64, seed: u64) -> (String, usize) {
    const B: f64 = 0.5;
    const UPPER: f64 = 0.1;
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let after = |(x, v): (f64, f64), u: f64, t: f64| {
        let (last, kept) = (u / B, (-B * t).exp());
        (
            x + last * t + (v - last) * (1.0 - kept) / B,
            last + (v - last) * kept,
        )
    };
    let (mut state, mut push, mut blows) = ((0.0, 0.0), 0.0, 0);
    let mut text = "t,q.x,u.push\n".to_owned();
    for (k, t) in times(80.0).into_iter().enumerate() {
        if k % 15 == 0 {
            push = rng.random_range(-2.0..2.5);
        }
        // Held near the middle by the hand's spring, in the inputs only.
        let u = push - 4.0 * state.0;
        let noise: f64 = rng.sample(StandardNormal);
        text += &format!("{t},{},{u}\n", state.0 + NOISE * noise);
        let mut left = 0.02;
        loop {
            let is_behind = |t: f64| after(state, u, t).0 > UPPER;
            let reached = (1..=20)
                .map(|i| left * f64::from(i) / 20.0)
                .find(|t| is_behind(*t));
            let Some(mut late) = reached else {
                state = after(state, u, left);
                break;
            };
            let mut early = late - left / 20.0;
            for _ in 0..60 {
                let middle = 0.5 * (early + late);
                match is_behind(middle) {
                    true => late = middle,
                    false => early = middle,
                }
            }
            let speed = after(state, u, early).1;
            left -= early;
            // What is slower than that rests on it.
            if speed < 1e-3 && u > 0.0 {
                state = (UPPER, 0.0);
                break;
            }
            blows += usize::from(speed > 0.02);
            state = (UPPER, -e * speed);
        }
    }
    (text, blows)
}

/// The truth has a hard stop on one side of the table and the model none.
#[test]
fn a_stop_that_a_log_strikes_is_named_with_its_place_and_restitution() {
    const E: f64 = 0.65;
    let known =
        block("[[effect]]\nkind = \"viscous_friction\"\njoint = \"x\"\ncoefficient = 0.5\n");
    let (text, blows) = struck(E, 1);
    assert!(blows >= 30, "{blows}");
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("log.csv");
    std::fs::write(&path, text).unwrap();
    let log = || [Log::read(&path, &known).unwrap()];
    let outcome = diagnose(&known, &log(), &[], dir.path(), 0, &|_| ()).unwrap();
    let found = &outcome.diagnosis;
    let [stop] = &found.effects[..] else {
        panic!("{:?}, {:?}", found.verdict, found.effects)
    };
    assert_eq!(
        (stop.kind.as_str(), stop.target.as_str()),
        ("end_stop", "x")
    );
    assert_eq!(found.verdict, Verdict::EffectsFound);
    let value = |name: &str| stop.parameters[name].value;
    let [upper, k, c] = ["upper", "stiffness", "damping"].map(value);
    assert!((upper - 0.1).abs() < 0.001, "{upper}");
    let std = stop.parameters["upper"].std.unwrap();
    assert!(
        (upper - 0.1).abs() < 2.0 * std && std < 0.001,
        "{upper} ± {std}"
    );
    assert!((restitution(k, c) - E).abs() < 0.1, "{}", restitution(k, c));
    assert!(
        found.gap.after < 0.05 * found.gap.before,
        "{} of {}",
        found.gap.after,
        found.gap.before
    );

    // Most windows have no blow, and the residuals of most are noise: yet that is no model that explains the data.
    let stops = [registry::find("end_stop").unwrap()];
    let without = diagnose_without(&known, &log(), &[], dir.path(), 0, &stops, &|_| ()).unwrap();
    let found = &without.diagnosis;
    assert_eq!(found.verdict, Verdict::Unexplained, "{:?}", found.effects);
    assert!(found.residuals[0].strays[1] > 0.1, "{:?}", found.residuals);
}

#[cfg(feature = "cli")]
#[test]
fn simulate_by_contacts_ends_on_the_stop_where_runge_kutta_leans_into_it() {
    let dir = tempfile::tempdir().unwrap();
    let effects = stop("upper = 0.1", 1e3, 40.0)
        + "[[effect]]\nkind = \"constant_force\"\njoint = \"x\"\nforce = 2.0\n";
    std::fs::write(dir.path().join("block.toml"), block_text(&effects)).unwrap();
    let last = |method: &str| -> f64 {
        let output = std::process::Command::new(env!("CARGO_BIN_EXE_pinode"))
            .current_dir(dir.path())
            .args([
                "simulate",
                "block.toml",
                "--duration",
                "4",
                "--initial",
                "0,0",
            ])
            .args(["--method", method, "--out", "out.csv"])
            .output()
            .unwrap();
        assert!(output.status.success(), "{output:?}");
        let rows = std::fs::read_to_string(dir.path().join("out.csv")).unwrap();
        rows.lines()
            .last()
            .unwrap()
            .split(',')
            .nth(1)
            .unwrap()
            .parse()
            .unwrap()
    };
    assert_eq!(last("contacts"), 0.1);
    // 2 N on 1000 N/m
    assert!((last("rk4") - 0.102).abs() < 1e-6);
}
