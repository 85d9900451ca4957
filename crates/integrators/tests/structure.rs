//! What methods keep: the symplectic form, the direction of time, momenta, the length of quaternions; and what they refuse.

use crate::counted::Counted;
use integrators::problems::{
    DoublePendulum, HarmonicOscillator, HeavyTop, Kepler, Pendulum, Problem, RigidBody,
};
use integrators::{
    Heun, Mechanical, Method, Order, Rk4, RollOutError, Space, StepError, StormerVerlet,
    SymplecticEuler, Variational, roll_out,
};

const PENDULUM: Pendulum = Pendulum {
    frequency: 3.0,
    amplitude: 2.0,
};
const KEPLER: Kepler = Kepler { eccentricity: 0.3 };
const DOUBLE: DoublePendulum = DoublePendulum { gravity: 9.81 };
const BODY: RigidBody = RigidBody {
    moments: [1.0, 2.0, 3.0],
    across: 1.0,
    along: 1.2,
};

fn stepped<P: Problem>(problem: &P, method: &mut impl Method<P>, h: f64, x: &[f64]) -> Vec<f64> {
    let mut x = x.to_vec();
    if let Err(error) = method.step(problem, 0.0, h, &(), &mut (), &mut x) {
        panic!("{}: {error}", problem.name());
    }
    x
}

/// (q, v) to (q, p).
fn to_momenta<P: Problem + Mechanical>(problem: &P, x: &[f64]) -> Vec<f64> {
    let (q, v) = x.split_at(problem.positions().dim());
    let mut p = vec![0.0; v.len()];
    let Ok(()) = problem.momentum((q, v), &mut (), &mut p);
    [q, &p].concat()
}

/// (q, p) to (q, v).
fn to_velocities<P: Problem + Mechanical>(problem: &P, z: &[f64]) -> Vec<f64> {
    let (q, p) = z.split_at(problem.positions().dim());
    let mut v = p.to_vec();
    let Ok(()) = problem.velocity(q, &mut (), &mut v);
    [q, &v].concat()
}

/// The symplectic form at (q, p) between tangents (ξ, δp): δp_a · ξ_b − δp_b · ξ_a − p · [ξ_a, ξ_b], which is −dq ∧ dp where
/// positions do not turn.
fn form<P: Problem + Mechanical>(problem: &P, z: &[f64], a: &[f64], b: &[f64]) -> f64 {
    let nv = problem.positions().tangent_dim();
    let p = &z[problem.positions().dim()..];
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let mut bracket = vec![0.0; nv];
    problem
        .positions()
        .bracket_into(&a[..nv], &b[..nv], &mut bracket);
    dot(&a[nv..], &b[..nv]) - dot(&b[nv..], &a[..nv]) - dot(p, &bracket)
}

/// How much one step changes the symplectic form, relative to the form: its derivatives by central differences of order 6.
fn change_of_the_form<P: Problem + Mechanical>(
    problem: &P,
    mut method: impl Method<P>,
    h: f64,
    x: &[f64],
) -> f64 {
    let space = problem.space();
    let nt = space.tangent_dim();
    let z = to_momenta(problem, x);
    let mut map = |z: &[f64]| {
        let x = stepped(problem, &mut method, h, &to_velocities(problem, z));
        to_momenta(problem, &x)
    };
    let image = map(&z);
    let step = 3e-3;
    let columns: Vec<Vec<f64>> = (0..nt)
        .map(|j| {
            let mut seen = |by: f64| {
                let mut motion = vec![0.0; nt];
                motion[j] = by;
                let mut near = vec![0.0; z.len()];
                space.move_into(&z, &motion, &mut near);
                let mut difference = vec![0.0; nt];
                space.difference_into(&image, &map(&near), &mut difference);
                difference
            };
            let [p1, m1, p2, m2, p3, m3] =
                [1.0, -1.0, 2.0, -2.0, 3.0, -3.0].map(|k: f64| seen(k * step));
            (0..nt)
                .map(|i| {
                    (45.0 * (p1[i] - m1[i]) - 9.0 * (p2[i] - m2[i]) + (p3[i] - m3[i]))
                        / (60.0 * step)
                })
                .collect()
        })
        .collect();
    let mut worst = 0.0_f64;
    for a in 0..nt {
        for b in 0..nt {
            let unit = |j: usize| {
                let mut e = vec![0.0; nt];
                e[j] = 1.0;
                e
            };
            let before = form(problem, &z, &unit(a), &unit(b));
            let after = form(problem, &image, &columns[a], &columns[b]);
            worst = worst.max((after - before).abs());
        }
    }
    worst
}

/// What central differences of order 6 leave.
const DIFFERENCES: f64 = 1e-10;

#[test]
fn symplectic_methods_keep_the_symplectic_form() {
    let pendulum = [1.2, -0.7];
    let euler = SymplecticEuler::new(&PENDULUM).unwrap();
    let verlet = StormerVerlet::new(&PENDULUM).unwrap();
    let kept = [
        change_of_the_form(&PENDULUM, euler, 0.1, &pendulum),
        change_of_the_form(&PENDULUM, verlet, 0.1, &pendulum),
        change_of_the_form(
            &KEPLER,
            StormerVerlet::new(&KEPLER).unwrap(),
            0.1,
            &[0.6, 0.4, -0.5, 1.1],
        ),
    ];
    eprintln!("separable: {kept:?}");
    assert!(kept.iter().all(|change| *change < DIFFERENCES), "{kept:?}");
    for order in [Order::Two, Order::Four] {
        let double = [0.8, -0.3, 1.0, -2.0];
        let top = HeavyTop::default();
        let top_state = stepped(&top, &mut Rk4::default(), 0.1, &top.initial());
        let kept = [
            change_of_the_form(
                &PENDULUM,
                Variational::new(&PENDULUM, order),
                0.1,
                &pendulum,
            ),
            change_of_the_form(&DOUBLE, Variational::new(&DOUBLE, order), 0.05, &double),
            change_of_the_form(&BODY, Variational::new(&BODY, order), 0.1, &BODY.initial()),
            change_of_the_form(&top, Variational::new(&top, order), 0.1, &top_state),
        ];
        eprintln!("variational, {order:?}: {kept:?}");
        assert!(kept.iter().all(|change| *change < DIFFERENCES), "{kept:?}");
    }
}

#[test]
fn runge_kutta_methods_do_not_keep_the_symplectic_form() {
    let double = [0.8, -0.3, 1.0, -2.0];
    let body = BODY.initial();
    let changed = [
        change_of_the_form(&PENDULUM, Rk4::default(), 0.1, &[1.2, -0.7]),
        change_of_the_form(&DOUBLE, Rk4::default(), 0.05, &double),
        change_of_the_form(&BODY, Rk4::default(), 0.1, &body),
        change_of_the_form(&PENDULUM, Heun::default(), 0.1, &[1.2, -0.7]),
        change_of_the_form(&DOUBLE, Heun::default(), 0.05, &double),
        change_of_the_form(&BODY, Heun::default(), 0.1, &body),
    ];
    eprintln!("RK4, then Heun: {changed:?}");
    assert!(
        changed.iter().all(|change| *change > 100.0 * DIFFERENCES),
        "{changed:?}"
    );
}

/// How far a step forward and one back end from where they began.
fn asymmetry<P: Problem>(problem: &P, mut method: impl Method<P>, h: f64, x: &[f64]) -> f64 {
    let there = stepped(problem, &mut method, h, x);
    let back = stepped(problem, &mut method, -h, &there);
    let mut motion = vec![0.0; problem.space().tangent_dim()];
    problem.space().difference_into(x, &back, &mut motion);
    motion.iter().fold(0.0, |largest, d| d.abs().max(largest))
}

#[test]
fn symmetric_methods_return_when_time_is_turned_back() {
    let double = [0.8, -0.3, 1.0, -2.0];
    let top = HeavyTop::default();
    let kepler = [0.6, 0.4, -0.5, 1.1];
    let verlet = StormerVerlet::new(&KEPLER).unwrap();
    let mut returns = vec![asymmetry(&KEPLER, verlet, 0.1, &kepler)];
    for order in [Order::Two, Order::Four] {
        returns.push(asymmetry(
            &KEPLER,
            Variational::new(&KEPLER, order),
            0.1,
            &kepler,
        ));
        returns.push(asymmetry(
            &DOUBLE,
            Variational::new(&DOUBLE, order),
            0.05,
            &double,
        ));
        returns.push(asymmetry(
            &BODY,
            Variational::new(&BODY, order),
            0.1,
            &BODY.initial(),
        ));
        returns.push(asymmetry(
            &top,
            Variational::new(&top, order),
            0.1,
            &top.initial(),
        ));
    }
    eprintln!("{returns:?}");
    assert!(returns.iter().all(|d| *d < 2e-14), "{returns:?}");
    // The others do not.
    assert!(asymmetry(&KEPLER, Rk4::default(), 0.1, &kepler) > 1e-9);
    let euler = SymplecticEuler::new(&KEPLER).unwrap();
    assert!(asymmetry(&KEPLER, euler, 0.1, &kepler) > 1e-4);
}

/// Largest change of a number over many steps, relative to its first value.
fn change<P: Problem>(
    problem: &P,
    method: &mut impl Method<P>,
    (h, steps): (f64, usize),
    number: impl Fn(&[f64]) -> f64,
) -> f64 {
    let mut x = problem.initial();
    let first = number(&x);
    let mut worst = 0.0_f64;
    for _ in 0..steps {
        x = stepped(problem, method, h, &x);
        worst = worst.max((number(&x) - first).abs());
    }
    worst / first.abs()
}

#[test]
fn kepler_keeps_its_angular_momentum() {
    let momentum = |x: &[f64]| KEPLER.angular_momentum(x);
    let run = (0.05, 10_000);
    let mut verlet = StormerVerlet::new(&KEPLER).unwrap();
    let mut euler = SymplecticEuler::new(&KEPLER).unwrap();
    let kept = [
        change(&KEPLER, &mut verlet, run, momentum),
        change(&KEPLER, &mut euler, run, momentum),
        change(
            &KEPLER,
            &mut Variational::new(&KEPLER, Order::Two),
            run,
            momentum,
        ),
        change(
            &KEPLER,
            &mut Variational::new(&KEPLER, Order::Four),
            run,
            momentum,
        ),
    ];
    eprintln!("{kept:?}");
    assert!(kept.iter().all(|change| *change < 1e-12), "{kept:?}");
    assert!(change(&KEPLER, &mut Rk4::default(), run, momentum) > 1e-7);
}

#[test]
fn turning_bodies_keep_the_momenta_of_their_symmetries() {
    let top = HeavyTop::default();
    for order in [Order::Two, Order::Four] {
        let mut method = Variational::new(&BODY, order);
        for axis in 0..3 {
            // The momentum stands on z: x and y of it are measured against z.
            let number = |x: &[f64]| 10.0 + BODY.angular_momentum(x)[axis];
            let kept = change(&BODY, &mut method, (0.1, 10_000), number);
            eprintln!("free body, {order:?}, axis {axis}: {kept:e}");
            assert!(kept < 1e-12, "axis {axis}: {kept}");
        }
        // Steps of nearly a radian.
        let kept = change(&BODY, &mut method, (0.6, 1000), |x| {
            BODY.angular_momentum(x)[2]
        });
        eprintln!("free body, {order:?}, long steps: {kept:e}");
        assert!(kept < 1e-12, "{kept}");
        let mut method = Variational::new(&top, order);
        let kept = change(&top, &mut method, (0.02, 10_000), |x| {
            top.vertical_momentum(x)
        });
        eprintln!("heavy top, {order:?}: {kept:e}");
        assert!(kept < 1e-12, "{kept}");
    }
    let lost = change(&top, &mut Rk4::default(), (0.02, 10_000), |x| {
        top.vertical_momentum(x)
    });
    eprintln!("heavy top, RK4: {lost:e}");
    assert!(lost > 1e-10, "{lost}");
}

/// Six digits make a quaternion; one of another length is no orientation, and its motion would be none.
#[test]
fn a_quaternion_of_another_length_is_no_start() {
    let top = HeavyTop::default();
    let rolled = |factor: f64| {
        let mut x = top.initial();
        x.iter_mut().take(4).for_each(|x| *x *= factor);
        roll_out(&top, Rk4::default(), &[0.0, 0.01], &[()], 1, &x)
    };
    assert!(rolled(1.0).is_ok() && rolled(-1.0).is_ok() && rolled(1.0 + 5e-7).is_ok());
    for factor in [0.0, 0.5, 1.01] {
        let Err(RollOutError::OffSpace { distance }) = rolled(factor) else {
            panic!("{factor}")
        };
        assert!((distance - (factor - 1.0).abs()).abs() < 1e-12);
    }
    assert!(matches!(
        rolled(f64::NAN),
        Err(RollOutError::NotFinite { component: 0, .. })
    ));
}

#[test]
fn quaternions_keep_their_length() {
    let top = HeavyTop::default();
    fn worst(method: &mut impl Method<HeavyTop>, top: &HeavyTop) -> f64 {
        let mut x = top.initial();
        let mut worst = 0.0_f64;
        for _ in 0..10_000 {
            x = stepped(top, method, 0.02, &x);
            let size = x[..4].iter().map(|x| x * x).sum::<f64>().sqrt();
            worst = worst.max((size - 1.0).abs());
        }
        worst
    }
    assert!(worst(&mut Heun::default(), &top) < 1e-15);
    assert!(worst(&mut Rk4::default(), &top) < 1e-15);
    assert!(worst(&mut Variational::new(&top, Order::Two), &top) < 1e-15);
    assert!(worst(&mut Variational::new(&top, Order::Four), &top) < 1e-15);
}

#[test]
fn explicit_symplectic_methods_refuse_what_is_not_separable() {
    let error = StormerVerlet::new(&DOUBLE).unwrap_err();
    assert_eq!(error.reason, "the mass matrix depends on θ₁ − θ₂");
    assert!(error.to_string().contains("Variational"), "{error}");
    assert_eq!(SymplecticEuler::new(&DOUBLE).unwrap_err(), error);
    let error = SymplecticEuler::new(&BODY).unwrap_err();
    assert!(error.reason.contains("turn"), "{error}");
    let oscillator = HarmonicOscillator {
        frequency: 1.0,
        amplitude: 1.0,
    };
    assert!(StormerVerlet::new(&oscillator).is_ok());
}

/// Forces a step of order 2 asks for, on average over a while.
fn forces_a_step<P: Problem + Mechanical>(problem: P, h: f64) -> f64 {
    let steps = 200;
    let mut x = problem.initial();
    let counted = Counted::new(problem);
    let mut method = Variational::new(&counted, Order::Two);
    for k in 0..steps {
        let t = f64::from(k) * h;
        if let Err(error) = method.step(&counted, t, h, &(), &mut (), &mut x) {
            panic!("step {k}: {error}");
        }
    }
    counted.evaluations() as f64 / f64::from(steps)
}

#[test]
fn the_variational_step_takes_fewer_iterations_the_shorter_it_is() {
    let steps = [0.1, 0.03, 0.01, 0.003, 0.001];
    let double = steps.map(|h| forces_a_step(DOUBLE, h));
    let pendulum = steps.map(|h| forces_a_step(PENDULUM, h));
    let body = steps.map(|h| forces_a_step(BODY, h));
    eprintln!("steps {steps:?}\ndouble pendulum {double:?}\npendulum {pendulum:?}\nbody {body:?}");
    for counts in [double, pendulum, body] {
        // Where rounding decides on the last iteration, the mean flutters by a part of one.
        assert!(counts.is_sorted_by(|a, b| *a >= b - 0.1), "{counts:?}");
    }
    assert!(pendulum[4] <= 6.0, "{pendulum:?}");
}

#[test]
fn a_step_too_long_to_be_solved_is_refused_and_leaves_the_state() {
    for order in [Order::Two, Order::Four] {
        for h in [3.0, 5.0, 20.0, 1e3, 1e150, f64::NAN] {
            let start = [2.0, 0.4, 3.0, -5.0];
            let mut x = start;
            let mut method = Variational::new(&DOUBLE, order);
            let error = method
                .step(&DOUBLE, 0.0, h, &(), &mut (), &mut x)
                .unwrap_err();
            assert!(
                matches!(error, StepError::NoConvergence { .. }),
                "step {h}: {error}"
            );
            assert_eq!(x, start);
            // The method is as good as new afterwards.
            let after = stepped(&DOUBLE, &mut method, 0.01, &start);
            let fresh = stepped(&DOUBLE, &mut Variational::new(&DOUBLE, order), 0.01, &start);
            assert_eq!(after, fresh);
        }
    }
}

#[test]
fn turning_points_are_passed_without_losing_the_solution() {
    // From v to −v in one step: the velocity of the step is the rounding of terms much larger than it.
    let (h, q) = (0.01, 2.0_f64);
    let speed = 0.5 * h * 9.0 * q.sin();
    for order in [Order::Two, Order::Four] {
        let mut method = Variational::new(&PENDULUM, order);
        for ulps in -2000..2000 {
            let x = [q, speed * (1.0 + f64::from(ulps) * f64::EPSILON)];
            let end = stepped(&PENDULUM, &mut method, h, &x);
            assert!((end[1] + speed).abs() < 1e-5, "{end:?}");
        }
    }
}
