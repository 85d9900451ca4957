//! Fixed steps that are too long for a stiff force are told; motions that they resolve, chaotic and rough ones too, are not.

use std::path::Path;

use pinode_nn::coarse::CoarseStep;
use pinode_nn::free_run::{Scheme, simulate_by};
use pinode_nn::model::Model;

const STEP: f64 = 1e-3;

/// The first step of the motion from `initial` over `seconds` that is too long.
fn coarse(scheme: Scheme, text: &str, initial: &[f64], seconds: f64) -> Option<CoarseStep> {
    let model = Model::parse(Path::new("m.toml"), text).unwrap_or_else(|e| panic!("{e}"));
    let t: Vec<f64> = (0..=(seconds / 0.01) as usize)
        .map(|k| 0.01 * k as f64)
        .collect();
    let states = simulate_by(scheme, &model, "0", &t, &[], initial, STEP);
    let states = states.unwrap_or_else(|e| panic!("{e}"));
    CoarseStep::of(scheme, &model, (&t, &[]), &states, STEP)
}

/// A ball of 1 kg above a floor.
fn ball(stiffness: f64) -> String {
    format!(
        "lagrangian = {{ coordinates = ['z'], kinetic = '0.5*z_dot^2', potential = '9.81*z' }}\n\
         [[effect]]\nkind = 'end_stop'\njoint = 'z'\nlower = 0.0\nstiffness = {stiffness:e}\ndamping = 100.0\n"
    )
}

/// Dropped from 1 m: the floor is touched after 0.4515 s at 4.43 m/s, and √(k/m) h is 30 at 1e9 N/m, 0.3 at 1e5 N/m.
#[test]
fn a_floor_too_stiff_for_the_steps_is_told_where_it_is_struck() {
    for scheme in [Scheme::Rk4, Scheme::Heun] {
        let found = coarse(scheme, &ball(1e9), &[1.0, 0.0], 3.0).unwrap();
        assert!((found.time - 0.4515).abs() < 1e-3, "{found:?}");
        assert_eq!(found.velocity, "v.z");
        assert!(
            (found.before + 4.43).abs() < 0.01 && found.after > 100.0,
            "{found:?}"
        );
        assert_eq!(coarse(scheme, &ball(1e5), &[1.0, 0.0], 3.0), None);
    }
    // By Heun's method, which bounces higher than it fell from, 1e6 N/m are too stiff as well.
    assert_eq!(coarse(Scheme::Rk4, &ball(1e6), &[1.0, 0.0], 3.0), None);
    assert!(coarse(Scheme::Heun, &ball(1e6), &[1.0, 0.0], 3.0).is_some());
}

#[test]
fn a_fall_through_the_centre_of_attraction_is_told() {
    let text = "lagrangian = { coordinates = ['x', 'y'], kinetic = '0.5*(x_dot^2 + y_dot^2)', potential = '-1/sqrt(x^2 + y^2)' }";
    // From rest at 1 m it takes π/(2√2) s to the centre.
    let found = coarse(Scheme::Rk4, text, &[1.0, 0.0, 0.0, 0.0], 3.0).unwrap();
    assert!((found.time - 1.11).abs() < 0.01, "{found:?}");
    assert_eq!(coarse(Scheme::Rk4, text, &[1.0, 0.0, 0.0, 0.7], 3.0), None);
}

/// Whole runs with steps of 1 ms and of 0.5 ms part.
#[test]
fn chaos_is_no_alarm() {
    let text = "lagrangian = { coordinates = ['a', 'b'], angles = ['a', 'b'], \
                kinetic = 'a_dot^2 + 0.5*b_dot^2 + a_dot*b_dot*cos(a - b)', potential = '-9.81*(2*cos(a) + cos(b))' }";
    for (scheme, seconds) in [
        (Scheme::Rk4, 40.0),
        (Scheme::Heun, 40.0),
        (Scheme::Variational, 2.0),
    ] {
        assert_eq!(coarse(scheme, text, &[2.0, 2.5, 0.0, 1.0], seconds), None);
    }
}

/// A block of 1 kg that a spring drags over a moving belt, from rest and from a slide.
#[test]
fn stick_and_slip_is_no_alarm() {
    let text = "lagrangian = { coordinates = ['x'], kinetic = '0.5*x_dot^2', potential = '50*x^2 - 4*x' }\n\
                [[effect]]\nkind = 'stribeck_friction'\njoint = 'x'\ncoulomb_force = 4.0\nstatic_force = 7.0\nstribeck_velocity = 0.05\n";
    for initial in [[0.0, 0.0], [0.2, 0.0], [0.3, -1.0]] {
        assert_eq!(coarse(Scheme::Rk4, text, &initial, 10.0), None);
    }
}

#[cfg(feature = "cli")]
#[test]
fn simulate_writes_the_trajectory_and_warns_of_its_steps() {
    use crate::program::{pinode, stderr};

    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("ball.toml"), ball(1e9)).unwrap();
    let simulate = [
        "simulate",
        "ball.toml",
        "--initial=1,0",
        "--duration",
        "1",
        "--out",
        "out.csv",
    ];
    let coarse = pinode(&simulate, dir.path());
    let told = stderr(&coarse);
    assert!(coarse.status.success(), "{told}");
    for part in [
        "too long from t = 0.450909 s",
        "`v.z` from -4.4234",
        "--method adaptive",
        "--step such as",
    ] {
        assert!(told.contains(part), "{part}: {told}");
    }
    assert!(dir.path().join("out.csv").exists());
    let contacts = pinode(
        &[&simulate[..], &["--method", "contacts"]].concat(),
        dir.path(),
    );
    assert_eq!(stderr(&contacts), "");
}
