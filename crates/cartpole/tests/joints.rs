//! The rigs of a Furuta pendulum and of an arm with seven joints, against physics and their own promises.

use std::path::{Path, PathBuf};

use approx::assert_abs_diff_eq;
use cartpole::config::NoiseLevel;
use cartpole::joints::{Bench, Fault, KINDS, Recording};
use pinode_nn::free_run::{Scheme, simulate_by};
use pinode_nn::log::Log;
use pinode_nn::model::Model;

fn models() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models")
}

fn furuta() -> Bench {
    Bench::furuta(&models()).unwrap()
}

fn arm() -> Bench {
    Bench::arm(&models()).unwrap()
}

fn fault(kind: &'static str, target: usize, parameters: &[(&'static str, f64)]) -> [Fault; 1] {
    [Fault {
        kind,
        target,
        parameters: parameters.to_vec(),
    }]
}

fn run(bench: &Bench, faults: &[Fault], duration: f64) -> Recording {
    bench.run(faults, NoiseLevel::Low, duration, 5).unwrap()
}

#[test]
fn without_a_fault_the_model_of_the_user_runs_as_the_rig_does() {
    // From rest, under the torques of the log, with friction that sticks: within the noise of the sensors, as long as their
    // rounding of the start has not grown. The arm with its upper arm up falls away by itself, e-fold in a quarter of a second.
    for (bench, duration, noise) in [(furuta(), 12.0, 1e-4), (arm(), 1.5, 2e-5)] {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("log.csv");
        let recorded = run(&bench, &[], duration);
        recorded.write_csv(&path).unwrap();
        let model = Model::load(&bench.known_model(&[], dir.path()).unwrap()).unwrap();
        let log = Log::read(&path, &model).unwrap();
        assert!(log.warnings.is_empty());
        let run = &log.runs[0];
        let n = recorded.q[0].len();
        let centres = bench.centres();
        let start = [centres, vec![0.0; n]].concat();
        let states = simulate_by(
            Scheme::Contacts,
            &model,
            "log",
            &run.t,
            &run.u,
            &start,
            1e-3,
        )
        .unwrap();
        let mut worst = 0.0_f64;
        for (row, state) in recorded.q.iter().zip(&states) {
            for (measured, q) in row.iter().zip(state) {
                worst = worst.max((measured - q).abs());
            }
        }
        // Of some thousand numbers none is five deviations off; half a count more for the rounding.
        assert!(worst < 5.0 * noise + 2e-4, "{worst} rad");
        assert!(worst > noise, "no noise: {worst}");
    }
}

#[test]
fn every_fault_changes_the_motion_or_the_torques_and_stays_in_bounds() {
    let bench = furuta();
    let clean = run(&bench, &[], 15.0);
    let apart = |a: &[Vec<f64>], b: &[Vec<f64>]| {
        let pairs = a.iter().flatten().zip(b.iter().flatten());
        pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    };
    for (index, kind) in KINDS.iter().enumerate() {
        let fault = bench.draw(index, 3).unwrap();
        assert_eq!(fault.kind, *kind);
        let log = run(&bench, std::slice::from_ref(&fault), 15.0);
        // Tens of counts of the encoders, or a share of the force that matters on the arm, which the controller gives back.
        let (moved, pushed) = (apart(&clean.q, &log.q), apart(&clean.u, &log.u));
        assert!(
            moved > 0.01 || pushed > 5e-4,
            "{fault:?} moves it by {moved} rad and takes {pushed} N·m only"
        );
        assert!(
            log.q.iter().flatten().all(|q| q.abs() < 3.1),
            "{fault:?} throws it about"
        );
    }
}

#[test]
fn the_arm_follows_its_sines_with_every_fault() {
    let bench = arm();
    for kind in 0..KINDS.len() {
        let fault = bench.draw(kind, 11).unwrap();
        let log = bench
            .run(std::slice::from_ref(&fault), NoiseLevel::Low, 4.0, 5)
            .unwrap_or_else(|error| panic!("{fault:?}: {error}"));
        let limits = [2.9, 2.0, 2.9, 2.7, 2.9, 1.8, 3.0];
        for row in &log.q {
            for (q, limit) in row.iter().zip(limits) {
                assert!(q.abs() < limit, "{fault:?}: {q} rad");
            }
        }
    }
}

#[test]
fn same_seed_same_bits_and_other_seed_another_motion() {
    let bench = furuta();
    let fault = [bench.draw(3, 8).unwrap()];
    let log = run(&bench, &fault, 5.0);
    assert_eq!(log, run(&bench, &fault, 5.0));
    let other = bench.run(&fault, NoiseLevel::Low, 5.0, 6).unwrap();
    assert_ne!(log.u, other.u);
}

#[test]
fn a_pendulum_with_dry_friction_comes_to_rest_off_the_vertical() {
    // The arm is held by friction that no torque overcomes; its pendulum hangs still and nothing moves.
    let held = fault("coulomb_friction", 0, &[("force", 10.0)]);
    let log = run(&furuta(), &held, 3.0);
    for row in &log.q {
        assert_abs_diff_eq!(row[0], 0.0, epsilon = 1e-3);
        assert_abs_diff_eq!(row[1], 0.0, epsilon = 1e-3);
    }
}

#[test]
fn the_model_of_the_user_lacks_the_hidden_friction_alone() {
    let bench = arm();
    let dir = tempfile::tempdir().unwrap();
    let effects = |hidden: &[Fault], name: &str| {
        let path = bench.known_model(hidden, &dir.path().join(name)).unwrap();
        let model = Model::load(&path).unwrap();
        let named = |e: &pinode_nn::model::EffectEntry| {
            (e.kind.name, model.target_name(e.target).to_owned())
        };
        model.effects.iter().map(named).collect::<Vec<_>>()
    };
    let all = effects(&[], "all");
    assert_eq!(all.len(), 14);
    for (kind, joint) in [("viscous_friction", 2), ("coulomb_friction", 4)] {
        let name = format!("j{}", joint + 1);
        let parameter = [("coefficient", 0.5), ("force", 0.5)];
        let left = effects(&fault(kind, joint, &parameter), kind);
        let expected: Vec<_> = all
            .iter()
            .filter(|(k, on)| !(*k == kind && *on == name))
            .cloned()
            .collect();
        assert_eq!(left, expected);
    }
    let stribeck = bench.draw(3, 1).unwrap();
    assert_eq!(effects(&[stribeck], "law"), all);
}

#[test]
fn what_delays_the_torques_leaves_the_controllers_stable() {
    let late = ["input_delay", "actuator_lag", "elastic_transmission"];
    for bench in [furuta(), arm()] {
        for (index, kind) in KINDS.iter().enumerate() {
            if !late.contains(kind) {
                continue;
            }
            for seed in 1..9 {
                let fault = bench.draw(index, seed).unwrap();
                let log = bench
                    .run(std::slice::from_ref(&fault), NoiseLevel::Low, 10.0, seed)
                    .unwrap_or_else(|error| panic!("{fault:?}: {error}"));
                // The driven joints stay about their middles: 0.64 or 1.28 rad are asked for at most.
                let driven = if bench.centres().len() == 2 { 1 } else { 7 };
                for row in &log.q {
                    for (q, centre) in row.iter().zip(bench.centres()).take(driven) {
                        assert!((q - centre).abs() < 1.6, "{fault:?}: {q} rad");
                    }
                }
            }
        }
    }
}
