//! Friction and stops of one mechanism.

use std::convert::Infallible;

use approx::assert_abs_diff_eq;
use integrators::event::{ContactError, ContactSystem, Coulomb, Law, Masses};
use integrators::{Ode, Rk4, Rotation, roll_out};
use nalgebra::DMatrix;
use proptest::prelude::*;

use super::*;

/// Two point masses of 1 kg on rods of 1 m; angles from hanging, the second one relative to the first.
fn double_pendulum(q: &[f64], v: &[f64]) -> (DMatrix<f64>, [f64; 2]) {
    let (g, cos, sin) = (9.81, q[1].cos(), q[1].sin());
    let mass = nalgebra::dmatrix![3.0 + 2.0 * cos, 1.0 + cos; 1.0 + cos, 1.0];
    let coriolis = [-sin * (2.0 * v[0] * v[1] + v[1] * v[1]), sin * v[0] * v[0]];
    let (s1, s12) = (q[0].sin(), (q[0] + q[1]).sin());
    let gravity = [g * (2.0 * s1 + s12), g * s12];
    (mass, [-coriolis[0] - gravity[0], -coriolis[1] - gravity[1]])
}

fn double_pendulum_energy(x: &[f64]) -> f64 {
    let (mass, _) = double_pendulum(&x[..2], &x[2..]);
    let v = nalgebra::dvector![x[2], x[3]];
    0.5 * v.dot(&(mass * &v)) - 9.81 * (2.0 * x[0].cos() + (x[0] + x[1]).cos())
}

fn double_pendulum_system() -> impl ContactSystem<Input = (), Error = Infallible, Memory = ()> {
    Masses::new(2, |_t, (q, v), _u: &(), mass, force| {
        let (m, f) = double_pendulum(q, v);
        mass.copy_from(&m);
        force.copy_from_slice(&f);
        Ok(())
    })
}

fn both_joints(force: f64) -> Vec<Law> {
    vec![
        Law::friction(&[1.0, 0.0], Coulomb::new(force)),
        Law::friction(&[0.0, 1.0], Coulomb::new(force)),
    ]
}

#[test]
fn energy_never_rises_under_friction_and_stops() {
    let start = [2.8, 0.5, 0.0, -1.0];
    let mut laws = both_joints(0.8);
    laws.push(Law::stop(&[0.0, 1.0], 0.6, 0.7));
    laws.push(Law::stop(&[0.0, -1.0], 0.6, 0.7));
    laws.push(Law::stop(&[1.0, 1.0], 2.0, 0.7));
    let rolled = motion(&double_pendulum_system(), laws, (60.0, 6000, 20), &start);
    assert!(impacts(&rolled.events).len() > 5);
    for pair in rolled.states.windows(2) {
        let (before, after) = (
            double_pendulum_energy(&pair[0]),
            double_pendulum_energy(&pair[1]),
        );
        assert!(after <= before + 1e-9, "{before} J then {after} J");
        assert!(pair[1][1].abs() <= 0.6 + 1e-12);
    }
    // It comes to rest, off the vertical as friction allows.
    assert_eq!(rolled.states.last().unwrap()[2..], [0.0, 0.0]);
}

#[test]
fn smoothed_friction_tends_to_the_set_as_its_width_goes_to_0() {
    // F tanh(v/ε) in both joints of the double pendulum, over slides, turns and moments of rest.
    let force = 1.0;
    let start = [1.2, -0.4, 0.0, 0.0];
    let set = motion(
        &double_pendulum_system(),
        both_joints(force),
        (3.0, 1, 3000),
        &start,
    );
    assert!(set.events.len() > 6, "{:?}", set.events);
    let errors = [1e-1, 1e-2, 1e-3].map(|width| {
        let smoothed = Ode::new(4, move |_t, x: &[f64], _u: &(), dx: &mut [f64]| {
            let (q, v) = x.split_at(2);
            let (m, f) = double_pendulum(q, v);
            let rhs = nalgebra::dvector![
                f[0] - force * (v[0] / width).tanh(),
                f[1] - force * (v[1] / width).tanh()
            ];
            let a = m.cholesky().unwrap().solve(&rhs);
            dx.copy_from_slice(&[v[0], v[1], a[0], a[1]]);
            Ok::<(), Infallible>(())
        });
        let end = roll_out(
            &smoothed,
            Rk4::default(),
            &[0.0, 3.0],
            &[()],
            30_000,
            &start,
        )
        .unwrap()
        .remove(1);
        (0..2)
            .map(|i| (end[i] - set.states[1][i]).abs())
            .fold(0.0, f64::max)
    });
    eprintln!("widths 0.1, 0.01, 0.001 rad/s: off by {errors:?} rad");
    assert!(errors[1] < 0.3 * errors[0], "{errors:?}");
    assert!(errors[2] < 0.3 * errors[1], "{errors:?}");
    assert!(errors[2] < 1e-3, "{errors:?}");
}

#[test]
fn a_body_that_spins_on_the_sphere_of_its_poses_stops_when_coulomb_says() {
    struct Spinning {
        space: Rotation,
    }
    impl ContactSystem for Spinning {
        type Positions = Rotation;
        type Input = ();
        type Memory = ();
        type Error = Infallible;
        fn positions(&self) -> &Rotation {
            &self.space
        }
        fn memory(&self) {}
        fn mass_and_force(
            &self,
            _: f64,
            _: (&[f64], &[f64]),
            (): &(),
            (): &mut (),
            mass: &mut DMatrix<f64>,
            force: &mut [f64],
        ) -> Result<(), Infallible> {
            mass.fill_with_identity();
            mass[(2, 2)] = 0.5;
            force.fill(0.0);
            Ok(())
        }
    }
    let spinning = Spinning { space: Rotation };
    let law = Law::friction(&[0.0, 0.0, 1.0], Coulomb::new(0.2));
    let start = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 3.0];
    let long = [2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 3.0];
    let refused = refusal(&spinning, vec![], &long);
    assert!(
        matches!(refused, ContactError::OffSpace { distance: 1.0, .. }),
        "{refused}"
    );
    let rolled = motion(&spinning, vec![law], (10.0, 1, 100), &start);
    assert_abs_diff_eq!(rolled.events[0].time, 0.5 * 3.0 / 0.2, epsilon = 1e-12);
    let end = &rolled.states[1];
    assert_eq!(end[6], 0.0);
    // The angle is I ω²/(2 F), half of it in the quaternion.
    let half: f64 = 0.5 * 0.5 * 9.0 / (2.0 * 0.2);
    assert_abs_diff_eq!(end[0].abs(), half.cos().abs(), epsilon = 1e-9);
}

/// Wagons between two walls, friction under each and between neighbours that are also buffers and coupled by springs: they keep their places and
/// never gain energy.
fn wagons(
    e: f64,
    m: [f64; 4],
    level: [f64; 4],
    between: [f64; 3],
    v: [f64; 4],
    stiffness: f64,
) -> Result<(), TestCaseError> {
    let spring = move |q: &[f64]| stiffness * (q[3] - q[0] - 1.2);
    let wagons = masses(m, move |_, q, _| [spring(q), 0.0, 0.0, -spring(q)]);
    let mut laws = Vec::new();
    for i in 0..4 {
        let mut w = [0.0; 4];
        w[i] = 1.0;
        laws.push(Law::friction(
            &w,
            Coulomb {
                sliding: 0.7 * level[i],
                breakaway: level[i],
            },
        ));
    }
    for i in 0..3 {
        let mut w = [0.0; 4];
        (w[i], w[i + 1]) = (-1.0, 1.0);
        laws.push(Law::friction(&w, Coulomb::new(between[i])));
        laws.push(Law::stop(&w, -0.25, e));
    }
    laws.push(Law::stop(&[1.0, 0.0, 0.0, 0.0], 0.3, e));
    laws.push(Law::stop(&[0.0, 0.0, 0.0, -1.0], 1.5, e));
    let start = [0.0, 0.4, 0.8, 1.2, v[0], v[1], v[2], v[3]];
    let rolled = motion(&wagons, laws, (5.0, 500, 4), &start);
    let energy = |x: &[f64]| {
        let kinetic: f64 = (0..4).map(|i| 0.5 * m[i] * x[4 + i] * x[4 + i]).sum();
        kinetic + 0.5 * stiffness * (x[3] - x[0] - 1.2).powi(2)
    };
    for pair in rolled.states.windows(2) {
        let x = &pair[1];
        prop_assert!(
            energy(x) <= energy(&pair[0]) + 1e-8,
            "{} J then {} J",
            energy(&pair[0]),
            energy(x)
        );
        prop_assert!(x[0] >= -0.3 - 1e-12 && x[3] <= 1.5 + 1e-12);
        for i in 0..3 {
            prop_assert!(x[i + 1] - x[i] >= 0.25 - 1e-12);
        }
    }
    Ok(())
}

/// Friction without a force, between two that a stop keeps together: their slip is a rounding, whose sign is no event.
#[test]
fn friction_without_a_force_between_what_a_stop_holds_has_no_events() {
    let m = [0.2, 0.2, 0.2904845399219593, 0.3216065888635652];
    let v = [0.0, 0.0, -3.0347354458073705, 0.0];
    wagons(0.0, m, [0.0; 4], [0.0; 3], v, 7.48145089272021).unwrap();
}

/// A row that comes to rest against a wall, dragged by its first wagon: what is left of the velocities when it does is no velocity.
#[test]
fn a_row_that_comes_to_rest_against_a_wall_is_at_rest() {
    let m = [
        2.3831899929624973,
        2.074047200794718,
        0.5689060208100719,
        0.2,
    ];
    let level = [
        1.1494165212867062,
        0.0,
        0.4928319787005553,
        0.9323171406671442,
    ];
    let between = [0.38512347232063127, 0.0, 0.35751104074406737];
    let v = [
        2.532963930748376,
        -0.5557187586571366,
        -1.8819602578726857,
        3.301897637017479,
    ];
    wagons(0.0, m, level, between, v, 4.604608731310259).unwrap();

    let m = [
        0.7055958277186799,
        2.947023473143335,
        2.415836135602838,
        2.453125012847393,
    ];
    let level = [
        0.9744566589442778,
        0.028708335066838703,
        0.1659695440801729,
        1.759823289634186,
    ];
    let between = [0.54686425761563, 0.2625085740224998, 0.6738450130632159];
    let v = [
        0.8685452048676139,
        1.1744109503870641,
        0.5620440510516641,
        0.3027314102817185,
    ];
    wagons(0.0, m, level, between, v, 1.4726693447843286).unwrap();
}

/// A row held by its wall and two frictions, whose last wagon goes on: the wall and the frictions are asked for one force of three.
#[test]
fn a_row_that_several_laws_hold_at_once_has_no_events_without_end() {
    let m = [
        2.331157453582583,
        2.1675211502149603,
        0.2,
        2.8932572195525594,
    ];
    let level = [
        0.0,
        0.9645845556467639,
        0.3323437121243217,
        0.7525598136353453,
    ];
    let between = [0.5661613817789697, 0.6708377183853138, 0.9068988017780928];
    let v = [
        -0.7716001583172356,
        -0.6756810676763598,
        -3.4624812978355552,
        2.2200699480710315,
    ];
    wagons(0.0, m, level, between, v, 15.675735763343253).unwrap();
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, cases: 64, ..ProptestConfig::default() })]

    /// Wagons between two walls, friction under each and between neighbours that are also buffers and coupled by springs.
    #[test]
    fn wagons_keep_their_places_and_never_gain_energy(
        e in prop_oneof![Just(0.0), Just(1.0), 0.0..1.0_f64],
        m in proptest::array::uniform4(0.2..3.0_f64),
        level in proptest::array::uniform4(0.0..2.0_f64),
        between in proptest::array::uniform3(0.0..1.0_f64),
        v in proptest::array::uniform4(-4.0..4.0_f64),
        stiffness in 0.0..20.0_f64,
    ) {
        wagons(e, m, level, between, v, stiffness)?;
    }
}
