#![allow(clippy::unwrap_used)]

mod several;

use std::path::Path;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::reading::{Reading, Signal};
use super::*;
use crate::bins::pseudo;
use crate::log::Channels;
use crate::model::log_columns::value;

const CART: f64 = 0.6;
const BOB: f64 = 0.15;
const LENGTH: f64 = 0.4;
const NOISE: (f64, f64) = (5e-4, 1e-3);
const RATE_NOISE: f64 = 1e-2;

/// (x, φ from hanging, ẋ, φ̇) after 20 ms under a force on the cart, which rubs.
fn after(state: [f64; 4], force: f64, rubbing: f64) -> [f64; 4] {
    let rates = |s: [f64; 4]| {
        let (sin, cos) = s[1].sin_cos();
        let pull = force - rubbing * s[2] + BOB * sin * (LENGTH * s[3] * s[3] + 9.81 * cos);
        let a = pull / (CART + BOB * sin * sin);
        [s[2], s[3], a, -(a * cos + 9.81 * sin) / LENGTH]
    };
    let h = 1e-3;
    let ahead = |s: [f64; 4], h: f64, k: [f64; 4]| std::array::from_fn(|i| s[i] + h * k[i]);
    (0..20).fold(state, |s, _| {
        let a = rates(s);
        let b = rates(ahead(s, h / 2.0, a));
        let c = rates(ahead(s, h / 2.0, b));
        let d = rates(ahead(s, h, c));
        std::array::from_fn(|i| s[i] + h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]))
    })
}

/// 20 s of x, φ and the force that a spring with a random will makes.
fn recording(rubbing: f64) -> Vec<[f64; 3]> {
    let with_rates = recording_with_rates(rubbing, |force| force);
    let without = with_rates.into_iter().map(|[x, phi, u, ..]| [x, phi, u]);
    without.collect()
}

/// With ẋ and φ̇ after them; the motor makes `made` of the force that it is told.
fn recording_with_rates(rubbing: f64, made: impl Fn(f64) -> f64) -> Vec<[f64; 5]> {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let (mut state, mut will) = ([0.0, 0.5, 0.0, 0.0], 0.0);
    let mut rows = Vec::new();
    for k in 0..1000 {
        if k % 12 == 0 {
            will = rng.random_range(-4.0..4.0);
        }
        let force = will - 8.0 * state[0] - 1.5 * state[2];
        let mut noise = |size: f64| size * rng.random_range(-1.7..1.7);
        let [x, phi] = [state[0] + noise(NOISE.0), state[1] + noise(NOISE.1)];
        rows.push([
            x,
            phi,
            force,
            state[2] + noise(RATE_NOISE),
            state[3] + noise(RATE_NOISE),
        ]);
        state = after(state, made(force), rubbing);
    }
    rows
}

/// A log of two coordinates, with their velocities or without.
fn parsed(model: &Model, text: &str, velocities: bool) -> Log {
    let inputs: Vec<&str> = model.inputs.iter().map(|i| i.name.as_str()).collect();
    let channels = Channels {
        coordinates: model.mechanics.coordinates(),
        velocities: &[velocities; 2],
        inputs: &inputs,
        columns: &model.columns,
    };
    Log::parse(Path::new("log.csv"), text.as_bytes(), &channels).unwrap()
}

/// The log of these columns for the model.
fn log(model: &Model, rows: &[[f64; 3]], as_logged: impl Fn([f64; 3]) -> [f64; 3]) -> Log {
    let mut text = "t,q.x,q.phi,u.motor\n".to_owned();
    for (k, row) in rows.iter().enumerate() {
        let [x, phi, u] = as_logged(*row);
        text += &format!("{:.2},{x},{phi},{u}\n", k as f64 * 0.02);
    }
    parsed(model, &text, false)
}

fn text() -> String {
    format!(
        "lagrangian = {{ coordinates = [\"x\", \"phi\"], angles = [\"phi\"], \
         kinetic = \"0.5*{total}*x_dot^2 + {swing}*x_dot*phi_dot*cos(phi) + {turn}*phi_dot^2\", potential = \"-{weight}*cos(phi)\" }}\n\
         [[input]]\nname = \"motor\"\njoint = \"x\"\n",
        total = CART + BOB,
        swing = BOB * LENGTH,
        turn = 0.5 * BOB * LENGTH * LENGTH,
        weight = BOB * 9.81 * LENGTH,
    )
}

fn model() -> Model {
    Model::parse(Path::new("cart.toml"), text()).unwrap()
}

/// What is changed, as the model's file has it.
fn found(model: &Model, log: &Log) -> Vec<String> {
    let logs = [log.clone()];
    let meant = as_meant(model, &logs, &[], &|_| ()).unwrap();
    assert!(meant.faults.iter().all(|f| f.kind == CONVENTION));
    let mappings = meant.model.columns.mappings.iter();
    let written: Vec<String> = mappings
        .map(|m| format!("{} = {}", m.signal, value(m)))
        .collect();
    assert_eq!(written.len(), meant.faults.len());
    written
}

#[test]
fn signs_zeros_and_units_are_read_as_they_are_meant_beside_friction_that_is_missing_or_not() {
    let model = model();
    for rubbing in [0.0, 0.8] {
        let rows = recording(rubbing);
        let as_they_are = log(&model, &rows, |row| row);
        assert_eq!(found(&model, &as_they_are), [""; 0]);
        let degrees = 180.0 / std::f64::consts::PI;
        let check = |as_logged: &dyn Fn([f64; 3]) -> [f64; 3], expected: &str| {
            assert_eq!(found(&model, &log(&model, &rows, as_logged)), [expected]);
        };
        check(
            &|[x, phi, u]| [x, -phi, u],
            "q.phi = { column = \"q.phi\", scale = -1.0 }",
        );
        check(
            &|[x, phi, u]| [x, phi - std::f64::consts::PI, u],
            "q.phi = { column = \"q.phi\", scale = 1.0, offset = 3.141592653589793 }",
        );
        check(
            &|[x, phi, u]| [x, degrees * phi, u],
            "q.phi = { column = \"q.phi\", scale = 0.017453292519943295 }",
        );
        check(
            &|[x, phi, u]| [-1000.0 * x, phi, u],
            "q.x = { column = \"q.x\", scale = -0.001 }",
        );
        check(
            &|[x, phi, u]| [x, phi, 1000.0 * u],
            "u.motor = { column = \"u.motor\", scale = 0.001 }",
        );
        let exchanged = log(&model, &rows, |[x, phi, u]| [phi, x, u]);
        let columns = ["q.x = \"q.phi\"", "q.phi = \"q.x\""];
        assert_eq!(found(&model, &exchanged), columns);
    }
}

/// A recorder that takes 100 samples a second and says 50.
#[test]
fn a_clock_at_half_its_pace_is_told_where_the_velocities_say_so_too() {
    let model = model();
    let log = |pace: f64| {
        let mut text = "t,q.x,q.phi,u.motor,v.x,v.phi\n".to_owned();
        for (k, [x, phi, u, rate, turning]) in
            recording_with_rates(0.3, |force| force).iter().enumerate()
        {
            let t = pace * k as f64 * 0.02;
            text += &format!("{t:.3},{x},{phi},{u},{rate},{turning}\n");
        }
        parsed(&model, &text, true)
    };
    assert_eq!(found(&model, &log(1.0)), [""; 0]);
    for pace in [2.0, 0.5] {
        let scale = 1.0 / pace;
        let column = format!("t = {{ column = \"t\", scale = {scale:?} }}");
        assert_eq!(found(&model, &log(pace)), [column]);
    }
}

/// What a motor makes of the force that it is told leaves 8.7 % of a coordinate or more where it is read as another unit, a unit less than one.
#[test]
fn an_input_in_other_units_is_told_and_a_limit_or_a_dead_zone_is_none() {
    let model = model();
    let found = |made: &dyn Fn(f64) -> f64| {
        let rows = recording_with_rates(0.3, made).into_iter();
        let rows: Vec<[f64; 3]> = rows.map(|[x, phi, u, ..]| [x, phi, u]).collect();
        found(&model, &log(&model, &rows, |row| row))
    };
    for unit in [0.1, 0.01, 10.0] {
        let told = format!("u.motor = {{ column = \"u.motor\", scale = {unit:?} }}");
        assert_eq!(found(&|force| unit * force), [told]);
    }
    for part in [0.25, 0.125, 0.03] {
        let most = 8.0 * part;
        assert_eq!(found(&|force| force.clamp(-most, most)), [""; 0], "{most}");
        let dead = 3.0 * (1.0 - part);
        let beyond = |force: f64| force - force.clamp(-dead, dead);
        assert_eq!(found(&beyond), [""; 0], "{dead}");
        assert_eq!(found(&|force| part * force), [""; 0], "{part}");
    }
}

/// What the motor is told acts 40 ms later. A reversed pole was not seen beside that.
#[test]
fn a_sign_is_told_beside_an_input_that_is_late() {
    let model = model();
    let mut rows = recording(0.3);
    for k in 2..rows.len() {
        rows[k - 2][2] = rows[k][2];
    }
    assert_eq!(found(&model, &log(&model, &rows, |row| row)), [""; 0]);
    let reversed = log(&model, &rows, |[x, phi, u]| [x, -phi, u]);
    let columns = ["q.phi = { column = \"q.phi\", scale = -1.0 }"];
    assert_eq!(found(&model, &reversed), columns);
}

/// The log that is held out is another's, in degrees: that is told of it, and neither the log nor the new model is read otherwise.
#[test]
fn what_is_held_out_may_count_in_its_own_way() {
    let model = model();
    let rows = recording(0.3);
    let logs = [log(&model, &rows, |row| row)];
    let held_out = [log(&model, &rows, |[x, phi, u]| [x, phi.to_degrees(), u])];
    let meant = as_meant(&model, &logs, &held_out, &|_| ()).unwrap();
    let [fault] = &meant.faults[..] else {
        panic!("{:?}", meant.faults)
    };
    let said = "in what is held out `q.phi` is in degrees";
    assert!(fault.detail.starts_with(said), "{}", fault.detail);
    assert!(meant.model.columns.mappings.is_empty());
    assert_eq!(meant.logs[0].runs, logs[0].runs);
    let (read, as_seen) = (&meant.held_out[0].runs[0].q[1], &logs[0].runs[0].q[1]);
    let off = read.iter().zip(as_seen).map(|(a, b)| (a - b).abs());
    assert!(off.fold(0.0, f64::max) < 1e-12);
    // Both in degrees: the new model says so of both.
    let meant = as_meant(&model, &held_out, &held_out, &|_| ()).unwrap();
    assert_eq!(
        (meant.faults.len(), meant.model.columns.mappings.len()),
        (1, 1)
    );
}

/// A mirror turns cart, pendulum and motor round: a log in which all three have another sign is right.
#[test]
fn two_signals_are_wrong_at_once_or_all_of_them() {
    let model = model();
    let rows = recording(0.3);
    let both = log(&model, &rows, |[x, phi, u]| {
        [1000.0 * x, phi.to_degrees(), u]
    });
    let columns = found(&model, &both);
    assert_eq!(columns.len(), 2, "{columns:?}");
    let logs = [log(&model, &rows, |[x, phi, u]| [-x, phi, u])];
    let meant = as_meant(&model, &logs, &[], &|_| ()).unwrap();
    let [fault] = &meant.faults[..] else {
        panic!("{:?}", meant.faults)
    };
    assert_eq!(fault.column, "q.x");
    let other = "as well: `q.phi` counts the other way round, `u.motor` counts the other way round";
    assert!(fault.detail.contains(other), "{}", fault.detail);
    // All signs at once are right again.
    let mirrored = log(&model, &rows, |row| row.map(|x| -x));
    assert_eq!(found(&model, &mirrored), [""; 0]);
}

/// Two blocks of 1 and 0.4 kg on a rail with a spring of 30 N/m between them, each pushed by a motor of its own.
#[test]
fn exchanged_coordinates_and_exchanged_inputs_are_read_as_they_are_meant() {
    let text = "lagrangian = { coordinates = [\"a\", \"b\"], kinetic = \"0.5*a_dot^2 + 0.2*b_dot^2\", potential = \"15*(a - b)^2\" }\n\
                [[input]]\nname = \"left\"\njoint = \"a\"\n[[input]]\nname = \"right\"\njoint = \"b\"\n";
    let model = Model::parse(Path::new("blocks.toml"), text.to_owned()).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(8);
    let (mut x, mut v, mut will) = ([0.0; 2], [0.0; 2], [0.0; 2]);
    let mut rows = Vec::new();
    for k in 0..1000 {
        if k % 10 == 0 {
            will = std::array::from_fn(|_| rng.random_range(-3.0..3.0));
        }
        // A weak hold keeps them on the table.
        let force: [f64; 2] = std::array::from_fn(|i| will[i] - 4.0 * x[i] - v[i]);
        let read = x.map(|x| x + rng.random_range(-1e-3..1e-3));
        let noise = 1e-3 * pseudo(k, 0.2);
        rows.push([read[0], read[1], force[0], force[1], noise]);
        for _ in 0..200 {
            let h = 1e-4;
            let pull = 30.0 * (x[0] - x[1]);
            v[0] += h * (force[0] - pull);
            v[1] += h * (force[1] + pull) / 0.4;
            x = std::array::from_fn(|i| x[i] + h * v[i]);
        }
    }
    let logged = |order: [usize; 4], signs: [f64; 4]| {
        let mut text = "t,q.a,q.b,u.left,u.right\n".to_owned();
        for (k, row) in rows.iter().enumerate() {
            let [a, b, left, right] = std::array::from_fn(|i| signs[i] * row[order[i]]);
            text += &format!("{:.2},{a},{b},{left},{right}\n", k as f64 * 0.02);
        }
        parsed(&model, &text, false)
    };
    let log = |order: [usize; 4]| logged(order, [1.0; 4]);
    assert_eq!(found(&model, &log([0, 1, 2, 3])), [""; 0]);
    let blocks = ["q.a = \"q.b\"", "q.b = \"q.a\""];
    assert_eq!(found(&model, &log([1, 0, 2, 3])), blocks);
    let scale = |q: &str| format!("q.{q} = {{ column = \"q.{q}\", scale = 0.001 }}");
    let in_millimetres = logged([0, 1, 2, 3], [1e3, 1e3, 1.0, 1.0]);
    assert_eq!(found(&model, &in_millimetres), [scale("a"), scale("b")]);
    // A sensor that is dead reads nothing of the other block.
    assert_eq!(found(&model, &log([0, 4, 2, 3])), [""; 0]);
    let motors = ["u.left = \"u.right\"", "u.right = \"u.left\""];
    assert_eq!(found(&model, &log([0, 1, 3, 2])), motors);
    // One block with its motor the other way round is, in a mirror, the other one.
    let logs = [logged([0, 1, 2, 3], [1.0, -1.0, 1.0, -1.0])];
    let faults = as_meant(&model, &logs, &[], &|_| ()).unwrap().faults;
    let columns: Vec<&str> = faults.iter().map(|f| f.column.as_str()).collect();
    assert_eq!(columns, ["q.a", "u.left"]);
    let other =
        "or else, as well: `q.b` counts the other way round, `u.right` counts the other way round;";
    assert!(faults[0].detail.contains(other), "{}", faults[0].detail);
}

/// What is no sign alone is an effect, which the search finds.
#[test]
fn a_motor_that_acts_the_other_way_round_is_told_unless_it_is_weaker_too() {
    let model = model();
    let rows = recording(0.3);
    let found = |factor: f64| {
        found(
            &model,
            &log(&model, &rows, |[x, phi, u]| [x, phi, factor * u]),
        )
    };
    assert_eq!(
        found(-1.0),
        ["u.motor = { column = \"u.motor\", scale = -1.0 }"]
    );
    assert_eq!(found(-2.5), [""; 0]);
}

/// The rates of an arm of two rods without mass that hang, with a bob at each end, under torques at both joints: angle and rate of the first, angle to it and
/// rate of the second. From the sums of the torques about both joints, in the plane.
fn of_arm([q1, q2, v1, v2]: [f64; 4], [torque1, torque2]: [f64; 2]) -> [f64; 4] {
    let ([m1, m2], [l1, l2]) = ([1.0, 0.8], [0.5, 0.4]);
    let (sin, cos) = q2.sin_cos();
    let outer = m2 * 9.81 * l2 * (q1 + q2).sin();
    let inner = (m1 + m2) * 9.81 * l1 * q1.sin();
    let c = m2 * l2 * l2;
    let b = c + m2 * l1 * l2 * cos;
    let a = b + m2 * l1 * l2 * cos + (m1 + m2) * l1 * l1;
    let whirl = m2 * l1 * l2 * sin;
    let f1 = torque1 - outer - inner + whirl * v2 * (2.0 * v1 + v2);
    let f2 = torque2 - outer - whirl * v1 * v1;
    let det = a * c - b * b;
    [v1, v2, (c * f1 - b * f2) / det, (a * f2 - b * f1) / det]
}

/// Ways to count two joints and two motors; the other eight are those in a mirror. Where a joint and a motor count otherwise, no single change helps.
#[test]
fn any_signs_of_an_arm_are_told_up_to_its_mirror() {
    let text = "lagrangian = { coordinates = [\"a\", \"b\"], angles = [\"a\", \"b\"], \
         kinetic = \"0.5*0.25*a_dot^2 + 0.4*(0.25*a_dot^2 + 0.16*(a_dot + b_dot)^2 + 0.4*a_dot*(a_dot + b_dot)*cos(b))\", \
         potential = \"-9.81*(0.5*1.8*cos(a) + 0.8*0.4*cos(a + b))\" }\n\
         [[input]]\nname = \"one\"\njoint = \"a\"\n[[input]]\nname = \"two\"\njoint = \"b\"\n";
    let model = Model::parse(Path::new("arm.toml"), text.to_owned()).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(6);
    let (mut state, mut aim) = ([0.2, -0.3, 0.0, 0.0], [0.0; 2]);
    let mut rows = Vec::new();
    for k in 0..2000 {
        if k % 30 == 0 {
            aim = std::array::from_fn(|_| rng.random_range(-1.2..1.2));
        }
        let torque = |i: usize| [25.0, 8.0][i] * (aim[i] - state[i]) - [3.0, 0.8][i] * state[i + 2];
        let torques = [torque(0), torque(1)];
        let mut read = |x: f64| x + rng.random_range(-5e-4..5e-4);
        rows.push([read(state[0]), read(state[1]), torques[0], torques[1]]);
        for _ in 0..50 {
            let h = 2e-4;
            let half = of_arm(state, torques);
            let half: [f64; 4] = std::array::from_fn(|i| state[i] + 0.5 * h * half[i]);
            let rate = of_arm(half, torques);
            state = std::array::from_fn(|i| state[i] + h * rate[i]);
        }
    }
    let signals = ["q.a", "q.b", "u.one", "u.two"];
    for choice in 0..8_usize {
        let turned = |i: usize| choice >> i & 1 == 1;
        let mut text = "t,q.a,q.b,u.one,u.two\n".to_owned();
        for (k, row) in rows.iter().enumerate() {
            let x: [f64; 4] = std::array::from_fn(|i| if turned(i) { -row[i] } else { row[i] });
            text += &format!(
                "{:.2},{},{},{},{}\n",
                k as f64 * 0.01,
                x[0],
                x[1],
                x[2],
                x[3]
            );
        }
        let named = |turned: &dyn Fn(usize) -> bool| -> Vec<String> {
            let turned = (0..4).filter(|i| turned(*i)).map(|i| signals[i]);
            let column = |s: &str| format!("{s} = {{ column = \"{s}\", scale = -1.0 }}");
            turned.map(column).collect()
        };
        let (own, mirrored) = (named(&turned), named(&|i| !turned(i)));
        let found = found(&model, &parsed(&model, &text, false));
        let expected = match own.len().cmp(&2) {
            std::cmp::Ordering::Less => own,
            std::cmp::Ordering::Greater => mirrored,
            std::cmp::Ordering::Equal => match found.first() == own.first() {
                true => own,
                false => mirrored,
            },
        };
        assert_eq!(found, expected, "{choice:04b}");
    }
}

/// A cart whose encoder is dead, a pendulum whose is, and a pendulum that hangs still because nothing moves it.
#[test]
fn a_coordinate_that_never_moves_is_refused_where_something_would_have_to_hold_it() {
    let model = model();
    let rows = recording(0.3);
    let refused = |as_logged: &dyn Fn([f64; 3]) -> [f64; 3]| {
        let logs = [log(&model, &rows, as_logged)];
        match refuse_unmoved(&model, &logs) {
            Ok(()) => Vec::new(),
            Err(Error::Unmoved { columns }) => {
                columns.into_iter().map(|unmoved| unmoved.column).collect()
            }
            Err(other) => panic!("{other}"),
        }
    };
    assert_eq!(refused(&|row| row), [""; 0]);
    assert_eq!(refused(&|[_, phi, u]| [0.01, phi, u]), ["q.x"]);
    assert_eq!(refused(&|[x, _, u]| [x, 3.0, u]), ["q.phi"]);
    // Beside friction that is known, which may or may not hold it.
    for (force, is_refused) in [(0.2, true), (50.0, false)] {
        let rubs = format!(
            "{}\n[[effect]]\nkind = \"coulomb_friction\"\njoint = \"x\"\nforce = {force:?}\n",
            text()
        );
        let model = Model::parse(Path::new("cart.toml"), rubs).unwrap();
        let logs = [log(&model, &rows, |[_, phi, u]| [0.01, phi, u])];
        let refused = refuse_unmoved(&model, &logs);
        assert_eq!(refused.is_err(), is_refused, "{force}");
    }
    let coasts: Vec<[f64; 3]> = (0..1000)
        .map(|k| [0.01 * k as f64 + NOISE.0 * pseudo(k, 0.2), 0.0, 0.0])
        .collect();
    let logs = [log(&model, &coasts, |row| row)];
    assert!(refuse_unmoved(&model, &logs).is_ok());

    // One that hangs by itself, a step of its encoder off the lowest point or where a stop that nobody knows has it, while its neighbour is swung.
    let text = "lagrangian = { coordinates = [\"a\", \"b\"], kinetic = \"0.5*a_dot^2 + 0.5*b_dot^2\", potential = \"-9.81*(cos(a) + cos(b))\" }\n\
                [[input]]\nname = \"motor\"\njoint = \"a\"\n";
    let two = Model::parse(Path::new("two.toml"), text.to_owned()).unwrap();
    for resting in [0.0015, 0.4] {
        let mut text = "t,q.a,q.b,u.motor\n".to_owned();
        for (k, row) in rows.iter().enumerate() {
            text += &format!("{:.2},{},{resting},{}\n", k as f64 * 0.02, row[1], row[2]);
        }
        assert!(refuse_unmoved(&two, &[parsed(&two, &text, false)]).is_ok());
    }
}

#[test]
fn a_reading_comes_after_what_the_model_says_of_the_columns() {
    let model = model();
    let given = crate::log::Mapping {
        scale: 2.0,
        offset: 0.5,
        ..crate::log::Mapping::new("q.phi", "angle")
    };
    let known = model.with_columns(&[given]).unwrap();
    let log = log(&model, &recording(0.0), |row| row);
    let turned = Reading::of(Signal::Coordinate(1), -1.0, 1.0);
    let mappings = mappings(&turned, &known, (&log, &known.columns));
    assert_eq!(mappings.len(), 1);
    assert_eq!((mappings[0].scale, mappings[0].offset), (-2.0, 0.5));
    let again = known.with_columns(&mappings).unwrap();
    assert_eq!(again.columns.mappings, mappings);
}
