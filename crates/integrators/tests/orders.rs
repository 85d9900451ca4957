//! Order of convergence of every method of fixed step on every test problem that it is for.
//!
//! An order is the slope of log error against log step through five steps a factor √2 apart, in the range where the next terms of the
//! error and rounding are small. The error is the largest component of the motion from the exact state to the one reached, so that an
//! attitude counts by its angle. Robertson's and van der Pol's problems are stiff: no method here is for them.

use integrators::problems::{
    DoublePendulum, DrivenOscillator, HarmonicOscillator, HeavyTop, Kepler, LinearDecay, Pendulum,
    Problem, RigidBody,
};
use integrators::{
    Heun, Mechanical, Method, Order, Rk4, Space, StormerVerlet, SymplecticEuler, Variational,
};

/// How far a measured order may be from the nominal one.
const TOLERANCE: f64 = 0.15;

/// Error at the problem's span after so many steps.
fn error<P: Problem>(problem: &P, method: &mut impl Method<P>, steps: usize) -> f64 {
    let end = problem.span();
    let h = end / steps as f64;
    let mut x = problem.initial();
    for k in 0..steps {
        let t = k as f64 * h;
        if let Err(error) = method.step(problem, t, h, &(), &mut (), &mut x) {
            panic!("{}, step {k} of {steps}: {error}", problem.name());
        }
    }
    let Some(exact) = problem.solution(end) else {
        panic!("{} has no solution at its span", problem.name());
    };
    let mut motion = vec![0.0; problem.space().tangent_dim()];
    problem.space().difference_into(&exact, &x, &mut motion);
    motion.iter().fold(0.0, |largest, d| d.abs().max(largest))
}

/// Slope of the least-squares line through (a, b).
fn slope(points: &[(f64, f64)]) -> f64 {
    let n = points.len() as f64;
    let mean_a = points.iter().map(|p| p.0).sum::<f64>() / n;
    let mean_b = points.iter().map(|p| p.1).sum::<f64>() / n;
    let cov: f64 = points.iter().map(|p| (p.0 - mean_a) * (p.1 - mean_b)).sum();
    let var: f64 = points.iter().map(|p| (p.0 - mean_a).powi(2)).sum();
    cov / var
}

/// Wants the nominal order from `fewest` steps to four times as many.
fn has_order<P: Problem>(
    problem: &P,
    name: &str,
    mut method: impl Method<P>,
    nominal: i32,
    fewest: usize,
) {
    let points: Vec<(f64, f64)> = [0.0_f64, 0.5, 1.0, 1.5, 2.0]
        .map(|power| (fewest as f64 * power.exp2()) as usize)
        .map(|steps| {
            let h = 1.0 / steps as f64;
            (h.ln(), error(problem, &mut method, steps).ln())
        })
        .into();
    let order = slope(&points);
    eprintln!(
        "{name:18} {:20} order {order:.3}, errors {:.1e} to {:.1e}",
        problem.name(),
        points[0].1.exp(),
        points[4].1.exp()
    );
    assert!(
        (order - f64::from(nominal)).abs() < TOLERANCE,
        "{name} on the {}: order {order} instead of {nominal}, errors {:?}",
        problem.name(),
        points.iter().map(|p| p.1.exp()).collect::<Vec<_>>()
    );
}

fn explicit<P: Problem>(problem: &P) {
    has_order(problem, "Heun", Heun::default(), 2, 1000);
    // At 150° the next term of RK4's error is large: 200 steps are too few there.
    let fewest = if problem.name() == "pendulum" {
        800
    } else {
        200
    };
    has_order(problem, "RK4", Rk4::default(), 4, fewest);
}

fn separable<P: Problem + Mechanical>(problem: &P) {
    let euler = SymplecticEuler::new(problem).unwrap_or_else(|error| panic!("{error}"));
    has_order(problem, "symplectic Euler", euler, 1, 4000);
    let verlet = StormerVerlet::new(problem).unwrap_or_else(|error| panic!("{error}"));
    has_order(problem, "Störmer-Verlet", verlet, 2, 1000);
}

fn variational<P: Problem + Mechanical>(problem: &P) {
    let second = Variational::new(problem, Order::Two);
    has_order(problem, "variational", second, 2, 1000);
    let fourth = Variational::new(problem, Order::Four);
    has_order(problem, "variational, 4", fourth, 4, 100);
}

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

fn pendulums() -> [Pendulum; 3] {
    [5.0_f64, 90.0, 150.0].map(|degrees| Pendulum {
        frequency: 3.0,
        amplitude: degrees.to_radians(),
    })
}

#[test]
fn runge_kutta_methods_have_their_orders_in_flat_spaces() {
    explicit(&DECAY);
    explicit(&OSCILLATOR);
    explicit(&DRIVEN);
    for pendulum in pendulums() {
        explicit(&pendulum);
    }
    explicit(&KEPLER);
    explicit(&DoublePendulum::default());
}

#[test]
fn runge_kutta_methods_have_their_orders_on_quaternions() {
    explicit(&BODY);
    explicit(&SYMMETRIC);
    explicit(&HeavyTop::default());
}

#[test]
fn explicit_symplectic_methods_have_their_orders() {
    separable(&OSCILLATOR);
    separable(&DrivenOscillator {
        damping: 0.0,
        ..DRIVEN
    });
    for pendulum in pendulums() {
        separable(&pendulum);
    }
    separable(&KEPLER);
}

#[test]
fn the_variational_integrator_has_its_orders_in_flat_spaces() {
    variational(&OSCILLATOR);
    variational(&DRIVEN);
    for pendulum in pendulums() {
        variational(&pendulum);
    }
    variational(&KEPLER);
    variational(&DoublePendulum::default());
}

#[test]
fn the_variational_integrator_has_its_orders_on_quaternions() {
    variational(&BODY);
    variational(&SYMMETRIC);
    variational(&HeavyTop::default());
}
