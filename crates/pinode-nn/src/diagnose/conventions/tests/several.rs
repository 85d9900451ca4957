//! Several recordings, each of which may count in its own way, and one whose model lacks a friction that is as large as anything else.

use super::*;

/// Of a pendulum of 0.5 kg at 0.4 m.
const INERTIA: f64 = 0.5 * 0.4 * 0.4;
const WEIGHT: f64 = 0.5 * 9.81 * 0.4;

/// 30 s of what one coordinate does under a force that is drawn anew every quarter of a second, `size` at most, every 10 ms; and of that force. `pull` is what acts beside
/// it, at (q, v), over an inertia.
fn driven(seed: u64, (inertia, size): (f64, f64), pull: impl Fn(f64, f64) -> f64) -> Vec<[f64; 2]> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let (mut q, mut v, mut force) = (0.3, 0.0, 0.0);
    let h = 5e-4;
    let mut rows = Vec::new();
    for k in 0..3000 {
        if k % 25 == 0 {
            force = rng.random_range(-size..size);
        }
        rows.push([q + 1e-3 * rng.random_range(-1.7..1.7), force]);
        for _ in 0..20 {
            // Semi-implicit Euler, in steps far below what the sensor tells.
            v += h * (force + pull(q, v)) / inertia;
            q += h * v;
        }
    }
    rows
}

/// The pendulum's, with a dry friction that its model lacks and a torque that nobody logged.
fn swinging(seed: u64, size: f64, torque: f64) -> Vec<[f64; 2]> {
    driven(seed, (INERTIA, size), |q, v| {
        torque - WEIGHT * q.sin() - 0.01 * v - 0.05 * (v / 1e-2).tanh()
    })
}

/// A model of one coordinate.
fn of_one(text: &str) -> Model {
    let input = "[[input]]\nname = \"motor\"\njoint = \"q\"\n";
    Model::parse(Path::new("one.toml"), format!("{text}\n{input}")).unwrap()
}

fn pendulum() -> Model {
    of_one(&format!(
        "lagrangian = {{ coordinates = [\"q\"], angles = [\"q\"], \
         kinetic = \"0.5*{INERTIA}*q_dot^2\", potential = \"-{WEIGHT}*cos(q)\" }}"
    ))
}

fn named(name: &str, model: &Model, rows: &[[f64; 2]], so: impl Fn([f64; 2]) -> [f64; 2]) -> Log {
    let mut text = "t,q.q,u.motor\n".to_owned();
    for (k, row) in rows.iter().enumerate() {
        let [q, u] = so(*row);
        text += &format!("{:.2},{q},{u}\n", k as f64 * 0.01);
    }
    let channels = Channels {
        coordinates: model.mechanics.coordinates(),
        velocities: &[false],
        inputs: &["motor"],
        columns: &model.columns,
    };
    Log::parse(Path::new(name), text.as_bytes(), &channels).unwrap()
}

/// What is said of some logs.
fn told(meant: &AsMeant) -> Vec<String> {
    meant.faults.iter().map(|f| f.detail.clone()).collect()
}

/// How far a log is from what was recorded, at most.
fn off(log: &Log, rows: &[[f64; 2]]) -> f64 {
    let each = log.runs[0].q[0].iter().zip(rows);
    each.map(|(q, row)| (q - row[0]).abs()).fold(0.0, f64::max)
}

#[test]
fn one_log_of_several_may_count_in_its_own_way() {
    let model = pendulum();
    let rows = [5, 6, 7].map(|seed| swinging(seed, 1.0, 0.0));
    let degrees = |[q, u]: [f64; 2]| [q.to_degrees(), u];
    let log = |k: usize, so: &dyn Fn([f64; 2]) -> [f64; 2]| {
        named(["a.csv", "b.csv", "c.csv"][k], &model, &rows[k], so)
    };
    let logs = [
        log(0, &|row| row),
        log(1, &|[q, u]| [q, -u]),
        log(2, &|row| row),
    ];
    let meant = as_meant(&model, &logs, &[], &|_| ()).unwrap();
    let [fault] = &told(&meant)[..] else {
        panic!("{:?}", meant.faults)
    };
    let said = "in `b.csv` `u.motor` counts the other way round";
    assert!(fault.starts_with(said), "{fault}");
    assert!(meant.model.columns.mappings.is_empty());
    assert_eq!(meant.logs[1].runs[0].u[0][40], rows[1][40][1]);
    assert_eq!(meant.logs[2].runs, logs[2].runs);
    // Most are in degrees: then the new model says so, and what is not stands out.
    let logs = [log(0, &degrees), log(1, &|row| row), log(2, &degrees)];
    let meant = as_meant(&model, &logs, &[], &|_| ()).unwrap();
    let said = told(&meant);
    assert_eq!(said.len(), 2, "{said:?}");
    assert!(said[0].starts_with("`q.q` is in degrees"), "{said:?}");
    let other = "in `b.csv` `q.q` counts as the model as given says";
    assert!(said[1].starts_with(other), "{said:?}");
    assert_eq!(meant.model.columns.mappings.len(), 1);
    for (log, rows) in meant.logs.iter().zip(&rows) {
        assert!(off(log, rows) < 1e-9);
    }
    let warned = counts_otherwise(&model, &logs).unwrap();
    assert!(warned.iter().any(|w| w.contains("`q.q` is in degrees")));
}

/// An incremental encoder is at 0 wherever it was switched on.
#[test]
fn an_encoder_that_starts_anew_in_each_recording_is_read_from_one_zero() {
    let model = pendulum();
    let rows = [5, 6, 7].map(|seed| swinging(seed, 1.0, 0.0));
    let log = |name, k: usize, by: f64| named(name, &model, &rows[k], |[q, u]| [q + by, u]);
    let logs = [log("a.csv", 0, 0.05), log("b.csv", 1, 0.0)];
    let held_out = [log("c.csv", 2, -0.03)];
    let meant = as_meant(&model, &logs, &held_out, &|_| ()).unwrap();
    let [fault] = &told(&meant)[..] else {
        panic!("{:?}", meant.faults)
    };
    for said in [
        "than in `b.csv`, by 0.0",
        "`a.csv`, by -0.0",
        "`c.csv` (held out)",
    ] {
        assert!(fault.contains(said), "{said}: {fault}");
    }
    let read = meant.logs.iter().chain(&*meant.held_out).zip(&rows);
    for (log, rows) in read {
        assert!(
            off(log, rows) < 1e-3,
            "{}: {}",
            log.path.display(),
            off(log, rows)
        );
    }
    let warned = counts_otherwise(&model, &logs).unwrap();
    assert!(warned[0].contains("its own `offset`"), "{warned:?}");
    // A zero that all have is a matter of the model's: the search finds it.
    let logs = [log("a.csv", 0, 0.05), log("b.csv", 1, 0.05)];
    let meant = as_meant(&model, &logs, &[], &|_| ()).unwrap();
    assert_eq!((told(&meant).len(), &*meant.logs), (0, &logs[..]));
}

/// A torque that differs moves where the pendulum comes to rest, and is no zero.
#[test]
fn a_torque_that_differs_between_recordings_is_no_zero() {
    let model = pendulum();
    let log = |name, seed, torque| named(name, &model, &swinging(seed, 0.5, torque), |row| row);
    let logs = [log("a.csv", 5, 0.0), log("b.csv", 6, 0.15)];
    let meant = as_meant(&model, &logs, &[], &|_| ()).unwrap();
    assert_eq!(told(&meant), [""; 0]);
}

/// A friction that leaves a quarter of the largest force, and of which the model knows nothing.
#[test]
fn units_are_told_beside_a_friction_that_is_as_large_as_anything_else() {
    let model = of_one(
        "lagrangian = { coordinates = [\"q\"], kinetic = \"2.5*q_dot^2\", potential = \"0\" }",
    );
    let rows = driven(5, (5.0, 24.0), |q, v| -20.0 * q - 6.0 * (v / 1e-3).tanh());
    // What holds the axis in its place is the motor's too.
    let with_spring = |[q, u]: [f64; 2]| [q, u - 20.0 * q];
    let logged = |so: &dyn Fn([f64; 2]) -> [f64; 2]| {
        let logs = [named("axis.csv", &model, &rows, |row| so(with_spring(row)))];
        let meant = as_meant(&model, &logs, &[], &|_| ()).unwrap();
        let mappings = meant.model.columns.mappings.iter();
        let written = mappings.map(|m| format!("{} = {}", m.signal, value(m)));
        written.collect::<Vec<_>>()
    };
    assert_eq!(logged(&|row| row), [""; 0]);
    let millimetres = "q.q = { column = \"q.q\", scale = 0.001 }";
    assert_eq!(logged(&|[q, u]| [1000.0 * q, u]), [millimetres]);
    let kilonewtons = "u.motor = { column = \"u.motor\", scale = 1000.0 }";
    assert_eq!(logged(&|[q, u]| [q, u / 1000.0]), [kilonewtons]);
}

/// Of an angle that turns over no error is more than half a turn: what is in degrees goes so far in each window that this is little of it.
#[test]
fn degrees_of_what_turns_over_are_told() {
    let model = pendulum();
    let rows = driven(5, (INERTIA, 1.0), |q, v| {
        -WEIGHT * q.sin() - 0.01 * v - 0.05 * (v / 1e-2).tanh()
    });
    let turns = rows.iter().map(|row| row[0].abs()).fold(0.0, f64::max);
    assert!(turns > 10.0, "{turns}");
    let logs = [named("a.csv", &model, &rows, |[q, u]| [q.to_degrees(), u])];
    let meant = as_meant(&model, &logs, &[], &|_| ()).unwrap();
    let [fault] = &told(&meant)[..] else {
        panic!("{:?}", meant.faults)
    };
    assert!(fault.starts_with("`q.q` is in degrees"), "{fault}");
}
