//! Where the motor of a drive counts and where its joint is read: against models in which that is made by hand, and in model files.

use std::path::Path;

use pinode_nn::free_run::{FreeRun, Initial, LONGEST_STEP, initial_states};
use pinode_nn::hybrid::{Hybrid, State};
use pinode_nn::log::Log;
use pinode_nn::model::{Model, Revision};
use pinode_nn::shooting::Trajectory;

use super::program::{pinode, stderr};

const LOAD: f64 = 1.7;
const MOTOR: f64 = 0.8;

/// A slide of this mass with an elastic drive of which `more` is said.
fn text(mass: f64, more: &str) -> String {
    format!(
        "name = \"slide\"\n\
         lagrangian = {{ coordinates = [\"x\"], kinetic = \"0.5*{mass}*x_dot^2\", potential = \"0*x\" }}\n\
         [[input]]\nname = \"motor\"\njoint = \"x\"\n\
         [[effect]]\nkind = \"elastic_transmission\"\ninput = \"motor\"\n\
         stiffness = 2500.0\ndamping = 3.0\nmotor_inertia = {MOTOR}\n{more}\n"
    )
}

fn read(mass: f64, more: &str) -> Result<Model, pinode_nn::Error> {
    Model::parse(Path::new("slide.toml"), text(mass, more))
}

fn hybrid(mass: f64, more: &str) -> Hybrid {
    Hybrid::of(&read(mass, more).unwrap_or_else(|e| panic!("{e}")))
}

/// x = [q, v, e, v_m]
const STATE: [f64; 4] = [0.1, 0.3, 2e-3, 0.5];

#[test]
fn a_motor_within_the_mass_is_one_on_top_of_what_is_left_of_it() {
    let accelerations = [
        hybrid(LOAD, ""),
        hybrid(LOAD + MOTOR, "motor_in_mass = true"),
    ]
    .map(|hybrid| {
        let theta = hybrid.theta();
        let inputs = hybrid.drive(&[0.0, 1.0], &[vec![0.7; 2]], 1, &theta, &[]);
        let mut memory = hybrid.memory(&[]);
        let [q, v, h @ ..] = &STATE;
        let state = State {
            q: &[*q],
            v: &[*v],
            h,
        };
        hybrid
            .acceleration(state, &theta, &inputs, 0, &mut memory)
            .unwrap();
        memory.acceleration[0]
    });
    let pull = 2500.0 * STATE[2] + 3.0 * (STATE[3] - STATE[1]);
    for found in accelerations {
        assert!((found - pull / LOAD).abs() < 1e-12, "{accelerations:?}");
    }
}

#[test]
fn a_sensor_on_the_motor_reads_how_far_the_drive_stretches_as_well() {
    for (more, expected) in [
        ("", (STATE[0], STATE[1])),
        ("sensor_on_motor = true", (STATE[0] + STATE[2], STATE[3])),
    ] {
        let hybrid = hybrid(LOAD, more);
        let [reading] = &hybrid.readings(&hybrid.theta(), &[])[..] else {
            panic!("one coordinate")
        };
        let position = reading.position((0, 1), 4, &STATE, &[0.0], 0).value;
        let velocity = reading.velocity((0, 1), 4, &STATE, &[0.0], 0).value;
        assert!((position - expected.0).abs() < 1e-15, "{more}: {position}");
        assert!((velocity - expected.1).abs() < 1e-15, "{more}: {velocity}");
    }
}

#[test]
fn a_file_says_yes_or_nothing_and_is_written_so() {
    let dir = tempfile::tempdir().unwrap();
    for (more, flags) in [
        ("", [0.0, 0.0]),
        ("motor_in_mass = true\nsensor_on_motor = false", [1.0, 0.0]),
        ("sensor_on_motor = true", [0.0, 1.0]),
    ] {
        let model = read(LOAD + MOTOR, more).unwrap();
        assert_eq!(model.effects[0].values[4..], flags, "{more}");
        let path = model
            .write_revision(dir.path(), "again.toml", &Revision::of(&model))
            .unwrap();
        assert_eq!(
            Model::load(&path).unwrap().effects[0].values[4..],
            flags,
            "{more}"
        );
    }
    // What a diagnosis has found is new in the file.
    let model = read(LOAD + MOTOR, "").unwrap();
    let mut revision = Revision::of(&model);
    revision.effects[0].0.values[5] = 1.0;
    let path = model
        .write_revision(dir.path(), "new.toml", &revision)
        .unwrap();
    let written = std::fs::read_to_string(&path).unwrap();
    assert!(written.contains("sensor_on_motor = true"), "{written}");
    assert!(!written.contains("motor_in_mass"), "{written}");
    assert_eq!(
        Model::load(&path).unwrap().effects[0].values[4..],
        [0.0, 1.0]
    );
}

#[test]
fn what_is_neither_yes_nor_no_and_a_motor_heavier_than_all_are_refused() {
    for (mass, more, parts) in [
        (
            2.5,
            "motor_in_mass = 1.0",
            ["`motor_in_mass`", "true or false"],
        ),
        (
            2.5,
            "sensor_on_motor = \"yes\"",
            ["`sensor_on_motor`", "true or false"],
        ),
        (
            0.5,
            "motor_in_mass = true",
            ["motor_inertia = 0.8", "give less"],
        ),
    ] {
        let said = read(mass, more).unwrap_err().to_string();
        for part in parts {
            assert!(said.contains(part), "{said}");
        }
    }
    // On top of the mechanism it may be.
    assert!(read(0.5, "").is_ok());
}

#[test]
fn a_joint_has_one_sensor_and_it_is_on_one_motor() {
    let another = "sensor_on_motor = true\n\
        [[input]]\nname = \"brake\"\njoint = \"x\"\n\
        [[effect]]\nkind = \"backlash\"\ninput = \"brake\"\ngap = 1e-3\nmotor_inertia = 0.1\nsensor_on_motor = ";
    assert!(read(LOAD, &format!("{another}false")).is_ok());
    let said = read(LOAD, &format!("{another}true"))
        .unwrap_err()
        .to_string();
    assert!(said.contains("on another motor already"), "{said}");
}

/// What is written is what the sensor reads, by steps that are fixed and that adapt; a free run from a log of it starts behind the stretch.
#[test]
fn what_is_simulated_is_read_on_the_motor_and_runs_start_behind_it() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name).display().to_string();
    std::fs::write(path("m.toml"), text(LOAD, "sensor_on_motor = true")).unwrap();
    let rows: String = (0..100)
        .map(|k| {
            format!(
                "{},{},{}\n",
                0.01 * f64::from(k),
                1e-3 * f64::from(k),
                20.0 * (0.2 * f64::from(k)).sin()
            )
        })
        .collect();
    std::fs::write(path("in.csv"), format!("t,q.x,u.motor\n{rows}")).unwrap();
    let model = Model::load(dir.path().join("m.toml").as_path()).unwrap();
    let hybrid = Hybrid::of(&model);
    let log = Log::read(dir.path().join("in.csv").as_path(), &model).unwrap();
    let run = &log.runs[0];
    let over = FreeRun::new(&hybrid, &run.t, &run.u, 1e-4);
    // At rest, and nothing pushes yet.
    let mut rolled = Trajectory::default();
    over.roll(&mut over.roller(), (0, 100), &[0.0; 4], &mut rolled)
        .unwrap();
    let reads: Vec<f64> = rolled.states.chunks(4).map(|x| x[0] + x[2]).collect();
    let most = rolled
        .states
        .chunks(4)
        .map(|x| x[2].abs())
        .fold(0.0, f64::max);
    assert!(most > 1e-3, "{most}");
    for method in ["rk4", "adaptive"] {
        let arguments = [
            "simulate",
            "m.toml",
            "--log",
            "in.csv",
            "--initial",
            "0,0",
            "--method",
            method,
            "--out",
            "out.csv",
        ];
        let done = pinode(&arguments, dir.path());
        assert!(done.status.success(), "{}", stderr(&done));
        let written = Log::read(Path::new(&path("out.csv")), &model).unwrap();
        for (found, expected) in written.runs[0].q[0].iter().zip(&reads) {
            assert!(
                (found - expected).abs() < 1e-6,
                "{method}: {found} {expected}"
            );
        }
    }
    // Behind the readings of that log is the joint.
    let written = Log::read(Path::new(&path("out.csv")), &model).unwrap();
    let run = &written.runs[0];
    let over = FreeRun::new(&hybrid, &run.t, &run.u, LONGEST_STEP);
    let behind = over.with_hidden(initial_states(&model, run, Initial::Estimated));
    let both = behind.iter().zip(rolled.states.chunks(4)).enumerate();
    for (k, (found, exact)) in both.take(90).skip(10) {
        assert!(
            (found[0] - exact[0]).abs() < 0.3 * most,
            "{k}: {found:?} {exact:?}"
        );
    }
}

#[test]
fn networks_are_not_trained_on_what_a_motor_reads() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name).display().to_string();
    std::fs::write(path("m.toml"), text(LOAD, "sensor_on_motor = true")).unwrap();
    let rows: String = (0..500)
        .map(|k| format!("{},{},0\n", 0.01 * f64::from(k), (0.1 * f64::from(k)).sin()))
        .collect();
    std::fs::write(path("in.csv"), format!("t,q.x,u.motor\n{rows}")).unwrap();
    let arguments = ["train", "m.toml", "in.csv", "--joint", "x", "--out", "out"];
    let done = pinode(&arguments, dir.path());
    let said = stderr(&done);
    assert_eq!(done.status.code(), Some(1), "{said}");
    assert!(said.contains("`sensor_on_motor = true`"), "{said}");
}
