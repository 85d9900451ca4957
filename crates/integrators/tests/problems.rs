//! The test problems against themselves: solutions obey their equations, derivatives are those of the rates, and the parts of a
//! mechanical problem belong to one Lagrangian.

use approx::assert_abs_diff_eq;
use integrators::problems::{
    Conservative, DoublePendulum, DrivenOscillator, HarmonicOscillator, HeavyTop, Kepler,
    LinearDecay, Pendulum, Problem, RigidBody, Robertson, VanDerPol,
};
use integrators::{Gradient, Jacobian, Rk4, Space, roll_out};

const DECAY: LinearDecay = LinearDecay {
    rate: 1.5,
    start: 2.0,
};
const OSCILLATOR: HarmonicOscillator = HarmonicOscillator {
    frequency: 2.0,
    amplitude: 0.7,
};
const DRIVEN: DrivenOscillator = DrivenOscillator {
    frequency: 2.0,
    damping: 0.3,
    drive: 1.4,
    drive_frequency: 2.9,
};
const PENDULUM: Pendulum = Pendulum {
    frequency: 3.0,
    amplitude: 2.0,
};
const KEPLER: Kepler = Kepler { eccentricity: 0.3 };
const BODY: RigidBody = RigidBody {
    moments: [1.0, 2.0, 3.0],
    across: 1.0,
    along: 1.2,
};
const SYMMETRIC: RigidBody = RigidBody {
    moments: [1.0, 1.0, 1.7],
    across: 0.8,
    along: 2.0,
};

/// The rate at `TIME`, which matters to the driven oscillator.
fn rate<P: Problem>(problem: &P, x: &[f64]) -> Vec<f64> {
    rate_at(problem, TIME, x)
}

const TIME: f64 = 0.3;

fn rate_at<P: Problem>(problem: &P, t: f64, x: &[f64]) -> Vec<f64> {
    let mut dx = vec![f64::NAN; problem.space().tangent_dim()];
    let Ok(()) = problem.rate(t, x, &(), &mut (), &mut dx);
    dx
}

/// x ⊕ size · e_j.
fn moved<S: Space>(space: &S, x: &[f64], j: usize, size: f64) -> Vec<f64> {
    let mut motion = vec![0.0; space.tangent_dim()];
    motion[j] = size;
    let mut out = vec![0.0; space.dim()];
    space.move_into(x, &motion, &mut out);
    out
}

/// A state somewhere on the way of the problem.
fn on_the_way<P: Problem>(problem: &P, part: f64, steps: usize) -> Vec<f64> {
    let times = [0.0, part * problem.span()];
    let start = problem.initial();
    roll_out(problem, Rk4::default(), &times, &[()], steps, &start)
        .unwrap()
        .remove(1)
}

fn solution_obeys_its_equation<P: Problem>(problem: &P) {
    let space = problem.space();
    for (a, b) in problem.solution(0.0).unwrap().iter().zip(problem.initial()) {
        assert_abs_diff_eq!(*a, b, epsilon = 1e-15);
    }
    for i in 1..12 {
        let t = 0.1 * f64::from(i) * problem.span();
        let d = 1e-4 * problem.span();
        let at = |t| problem.solution(t).unwrap();
        let mut difference = vec![0.0; space.tangent_dim()];
        space.difference_into(&at(t - d), &at(t + d), &mut difference);
        let rate = rate_at(problem, t, &at(t));
        let scale = rate.iter().fold(1e-3, |m: f64, r| m.max(r.abs()));
        for (j, (difference, rate)) in difference.iter().zip(&rate).enumerate() {
            let found = difference / (2.0 * d);
            assert!(
                (found - rate).abs() < 1e-5 * scale,
                "{} component {j} at {t}: {found} and {rate}",
                problem.name()
            );
        }
    }
}

#[test]
fn solutions_obey_their_equations() {
    solution_obeys_its_equation(&DECAY);
    solution_obeys_its_equation(&OSCILLATOR);
    solution_obeys_its_equation(&DRIVEN);
    solution_obeys_its_equation(&PENDULUM);
    solution_obeys_its_equation(&KEPLER);
    solution_obeys_its_equation(&BODY);
    solution_obeys_its_equation(&SYMMETRIC);
}

fn derivatives_are_those_of_the_rate<P: Problem>(problem: &P, x: &[f64]) {
    let space = problem.space();
    let nt = space.tangent_dim();
    let mut by = Jacobian::zeros(problem);
    let mut dx = vec![f64::NAN; nt];
    let Ok(()) = problem.linearize((TIME, x, &()), &mut (), &mut dx, &mut by);
    assert_eq!(dx, rate(problem, x));
    for j in 0..nt {
        // The states of stiff problems have sizes of their own.
        let size = if nt == space.dim() {
            x[j].abs().max(1e-6)
        } else {
            1.0
        };
        let step = 1e-5 * size;
        let plus = rate(problem, &moved(space, x, j, step));
        let minus = rate(problem, &moved(space, x, j, -step));
        for i in 0..nt {
            let difference = (plus[i] - minus[i]) / (2.0 * step);
            let rounding = f64::EPSILON * rate_scale(problem) / step;
            assert!(
                (difference - by.state[(i, j)]).abs()
                    < 1e-8 * (1.0 + difference.abs()) + 10.0 * rounding,
                "{}: ({i}, {j}) {difference} and {}",
                problem.name(),
                by.state[(i, j)]
            );
        }
    }
    // wᵀ J by the other entry point, on top of what is there.
    let weight: Vec<f64> = (0..nt).map(|i| 0.3 + 0.2 * i as f64).collect();
    let mut sum = Gradient::zeros(problem);
    sum.state.fill(1.0);
    sum.parameters.fill(2.0);
    let Ok(()) = problem.pull_back((TIME, x, &()), &mut (), &weight, &mut dx, &mut sum);
    let scale = 1.0
        + by.state.amax()
        + if by.parameters.is_empty() {
            0.0
        } else {
            by.parameters.amax()
        };
    for j in 0..nt {
        let expected: f64 = 1.0 + (0..nt).map(|i| weight[i] * by.state[(i, j)]).sum::<f64>();
        assert_abs_diff_eq!(sum.state[j], expected, epsilon = 1e-13 * scale);
    }
    for j in 0..by.parameters.ncols() {
        let expected: f64 = 2.0
            + (0..nt)
                .map(|i| weight[i] * by.parameters[(i, j)])
                .sum::<f64>();
        assert_abs_diff_eq!(sum.parameters[j], expected, epsilon = 1e-13 * scale);
    }
}

/// The largest term in the rate's sums, whose rounding a difference feels.
fn rate_scale<P: Problem>(problem: &P) -> f64 {
    match problem.name() {
        "van der Pol" => 1e6,
        _ => 10.0,
    }
}

#[test]
fn derivatives_are_those_of_the_rates() {
    derivatives_are_those_of_the_rate(&DECAY, &[1.3]);
    derivatives_are_those_of_the_rate(&OSCILLATOR, &[0.4, -0.6]);
    derivatives_are_those_of_the_rate(&DRIVEN, &[0.4, -0.6]);
    derivatives_are_those_of_the_rate(&PENDULUM, &[1.1, -2.0]);
    derivatives_are_those_of_the_rate(&KEPLER, &[0.5, 0.6, -0.7, 0.4]);
    derivatives_are_those_of_the_rate(&DoublePendulum::default(), &[1.0, -0.4, 2.0, -3.0]);
    derivatives_are_those_of_the_rate(&BODY, &on_the_way(&BODY, 0.4, 100));
    let top = HeavyTop::default();
    derivatives_are_those_of_the_rate(&top, &on_the_way(&top, 0.4, 100));
    derivatives_are_those_of_the_rate(&Robertson::default(), &[0.7, 9e-6, 0.3]);
    derivatives_are_those_of_the_rate(&VanDerPol::default(), &[1.7, -0.9]);
}

/// Derivatives in a constant that `with` sets.
fn constant_is_differentiated<P: Problem>(
    with: impl Fn(f64) -> P,
    value: f64,
    column: usize,
    x: &[f64],
) {
    let problem = with(value);
    let mut by = Jacobian::zeros(&problem);
    let mut dx = vec![f64::NAN; problem.space().tangent_dim()];
    let Ok(()) = problem.linearize((TIME, x, &()), &mut (), &mut dx, &mut by);
    let step = 1e-5 * value;
    let (plus, minus) = (rate(&with(value + step), x), rate(&with(value - step), x));
    for i in 0..dx.len() {
        let difference = (plus[i] - minus[i]) / (2.0 * step);
        let found = by.parameters[(i, column)];
        assert!(
            (difference - found).abs() < 1e-8 * (1.0 + difference.abs()),
            "{} row {i}: {difference} and {found}",
            problem.name()
        );
    }
}

#[test]
fn derivatives_in_the_constants_are_those_of_the_rates() {
    constant_is_differentiated(|rate| LinearDecay { rate, ..DECAY }, 1.5, 0, &[1.3]);
    let oscillator = |frequency| HarmonicOscillator {
        frequency,
        ..OSCILLATOR
    };
    constant_is_differentiated(oscillator, 2.0, 0, &[0.4, -0.6]);
    let pendulum = |frequency| Pendulum {
        frequency,
        ..PENDULUM
    };
    constant_is_differentiated(pendulum, 3.0, 0, &[1.1, -2.0]);
    let driven = |frequency| DrivenOscillator {
        frequency,
        ..DRIVEN
    };
    constant_is_differentiated(driven, 2.0, 0, &[0.4, -0.6]);
    let driven = |damping| DrivenOscillator { damping, ..DRIVEN };
    constant_is_differentiated(driven, 0.3, 1, &[0.4, -0.6]);
    let driven = |drive| DrivenOscillator { drive, ..DRIVEN };
    constant_is_differentiated(driven, 1.4, 2, &[0.4, -0.6]);
    let double = |gravity| DoublePendulum { gravity };
    constant_is_differentiated(double, 9.81, 0, &[1.0, -0.4, 2.0, -3.0]);
    let x = on_the_way(&BODY, 0.4, 100);
    for i in 0..3 {
        let body = |moment| {
            let mut body = BODY;
            body.moments[i] = moment;
            body
        };
        constant_is_differentiated(body, BODY.moments[i], i, &x);
        let reaction = |k| {
            let mut reaction = Robertson::default();
            reaction.rates[i] = k;
            reaction
        };
        constant_is_differentiated(
            reaction,
            Robertson::default().rates[i],
            i,
            &[0.7, 9e-6, 0.3],
        );
    }
    let top = |weight| HeavyTop {
        weight,
        ..HeavyTop::default()
    };
    constant_is_differentiated(top, 5.0, 0, &on_the_way(&top(5.0), 0.4, 100));
    let van_der_pol = |epsilon| VanDerPol { epsilon };
    constant_is_differentiated(van_der_pol, 0.1, 0, &[1.7, -0.9]);
}

/// d/dt p = ad_vᵀ p + ∂L/∂q along the motion, v = M⁻¹ p, and v̇ is the second half of the rate.
fn parts_belong_to_one_lagrangian<P: Conservative>(problem: &P) {
    let (nq, nv) = (problem.positions().dim(), problem.positions().tangent_dim());
    let x = on_the_way(problem, 0.4, 400);
    let dx = rate(problem, &x);
    let (q, v) = x.split_at(nq);
    let mut acceleration = vec![0.0; nv];
    let Ok(()) = problem.acceleration(0.0, (q, v), &(), &mut (), &mut acceleration);
    assert_eq!(acceleration, dx[nv..]);
    assert_eq!(v, &dx[..nv]);
    let momentum = |x: &[f64]| {
        let mut p = vec![0.0; nv];
        let Ok(()) = problem.momentum(x.split_at(nq), &mut (), &mut p);
        p
    };
    let mut back = momentum(&x);
    let Ok(()) = problem.velocity(q, &mut (), &mut back);
    let after = |by: f64| {
        let motion: Vec<f64> = dx.iter().map(|d| by * d).collect();
        let mut out = vec![0.0; x.len()];
        problem.space().move_into(&x, &motion, &mut out);
        out
    };
    let d = 1e-5;
    let (plus, minus) = (momentum(&after(d)), momentum(&after(-d)));
    let (mut turning, mut force) = (vec![0.0; nv], vec![0.0; nv]);
    problem
        .positions()
        .cobracket_into(v, &momentum(&x), &mut turning);
    let Ok(()) = problem.position_force(0.0, (q, v), &(), &mut (), &mut force);
    for i in 0..nv {
        assert_abs_diff_eq!(back[i], v[i], epsilon = 1e-14);
        let found = (plus[i] - minus[i]) / (2.0 * d);
        assert_abs_diff_eq!(found, turning[i] + force[i], epsilon = 1e-8);
        // ∂E/∂q = −∂L/∂q + 2 ∂T/∂q, where T does not depend on q: −∂L/∂q.
        if problem.name() != "double pendulum" {
            let energy = |by: f64| problem.energy(&moved(problem.space(), &x, i, by));
            let slope = (energy(d) - energy(-d)) / (2.0 * d);
            assert_abs_diff_eq!(slope, -force[i], epsilon = 1e-8);
        }
    }
    // The energy does not change to first order.
    let power = (problem.energy(&after(d)) - problem.energy(&after(-d))) / (2.0 * d);
    assert_abs_diff_eq!(power, 0.0, epsilon = 1e-8);
}

#[test]
fn momenta_forces_and_accelerations_belong_to_one_lagrangian() {
    parts_belong_to_one_lagrangian(&OSCILLATOR);
    parts_belong_to_one_lagrangian(&PENDULUM);
    parts_belong_to_one_lagrangian(&KEPLER);
    parts_belong_to_one_lagrangian(&DoublePendulum::default());
    parts_belong_to_one_lagrangian(&BODY);
    parts_belong_to_one_lagrangian(&HeavyTop::default());
}

#[test]
fn known_states_of_robertson_keep_the_mass() {
    for t in Robertson::known_times() {
        let x = Robertson::default().solution(t).unwrap();
        // The published state at 10¹¹ s has fewer digits than the others.
        let epsilon = if t < 1e5 { 2e-16 } else { 2e-14 };
        assert_abs_diff_eq!(x.iter().sum::<f64>(), 1.0, epsilon = epsilon);
    }
}
