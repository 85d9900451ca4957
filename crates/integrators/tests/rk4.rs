//! The classical Runge-Kutta method against problems with known solutions.

use std::convert::Infallible;

use approx::assert_relative_eq;
use integrators::problems::{HarmonicOscillator, Kepler, LinearDecay, Pendulum, Problem};
use integrators::{Ode, Rk4, roll_out};
use num_dual::{Dual64, DualNum};

fn problems() -> Vec<Box<dyn Problem>> {
    vec![
        Box::new(LinearDecay {
            rate: 1.5,
            start: 2.0,
        }),
        Box::new(HarmonicOscillator {
            frequency: 2.0,
            amplitude: 0.7,
        }),
        Box::new(Pendulum {
            frequency: 3.0,
            amplitude: 2.0,
        }),
        Box::new(Kepler { eccentricity: 0.3 }),
    ]
}

/// Largest error at the end of 0.77 spans, an end where nothing is special.
fn final_error(problem: &dyn Problem, steps: usize) -> f64 {
    let end = 0.77 * problem.span();
    let mut x = problem.initial();
    let mut rk4 = Rk4::new(x.len());
    let h = end / steps as f64;
    for k in 0..steps {
        let Ok(()) = rk4.step(k as f64 * h, h, &mut x, |t, x, dx| {
            problem.rate(t, x, dx);
            Ok::<(), Infallible>(())
        });
    }
    let exact = problem.solution(end);
    x.iter()
        .zip(&exact)
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, f64::max)
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

#[test]
fn error_falls_with_the_fourth_power_of_the_step() {
    for problem in problems() {
        let points: Vec<(f64, f64)> = [400, 566, 800, 1131, 1600]
            .into_iter()
            .map(|steps| {
                (
                    -(steps as f64).ln(),
                    final_error(problem.as_ref(), steps).ln(),
                )
            })
            .collect();
        let order = slope(&points);
        eprintln!("{}: order {order:.3}", problem.name());
        assert!(
            (3.9..4.1).contains(&order),
            "{}: order {order}",
            problem.name()
        );
    }
}

#[test]
fn solutions_obey_their_equations() {
    for problem in problems() {
        for i in 1..10 {
            let t = 0.1 * f64::from(i) * problem.span();
            let d = 1e-4 * problem.span();
            let (before, after, x) = (
                problem.solution(t - d),
                problem.solution(t + d),
                problem.solution(t),
            );
            let mut rate = vec![0.0; x.len()];
            problem.rate(t, &x, &mut rate);
            for j in 0..x.len() {
                let difference = (after[j] - before[j]) / (2.0 * d);
                let scale = rate.iter().fold(1e-3, |m: f64, r| m.max(r.abs()));
                assert!(
                    (difference - rate[j]).abs() < 1e-5 * scale,
                    "{} component {j} at {t}: {difference} and {}",
                    problem.name(),
                    rate[j]
                );
            }
        }
    }
}

#[test]
fn jacobians_are_the_derivatives_of_the_rates() {
    for problem in problems() {
        let x = problem.solution(0.3 * problem.span());
        let n = x.len();
        let mut jacobian = vec![0.0; n * n];
        problem.jacobian(0.0, &x, &mut jacobian);
        for j in 0..n {
            let shifted = |by: f64| {
                let mut y = x.clone();
                y[j] += by;
                let mut rate = vec![0.0; n];
                problem.rate(0.0, &y, &mut rate);
                rate
            };
            let (plus, minus) = (shifted(1e-6), shifted(-1e-6));
            for i in 0..n {
                let difference = (plus[i] - minus[i]) / 2e-6;
                assert!(
                    (difference - jacobian[i * n + j]).abs() < 1e-7 * (1.0 + difference.abs()),
                    "{}: ({i}, {j})",
                    problem.name()
                );
            }
        }
    }
}

/// A damped pendulum, x = [θ, θ̇].
fn pendulum<S: DualNum<Primitive = f64> + Copy>(x: &[S], dx: &mut [S]) {
    dx[0] = x[1];
    dx[1] = -(x[0].sin() * 9.0) - x[1] * 0.3;
}

fn swing<S>(x: &mut [S], steps: usize)
where
    S: DualNum<Primitive = f64> + integrators::Real,
{
    let mut rk4 = Rk4::new(2);
    for k in 0..steps {
        let Ok(()) = rk4.step(0.05 * k as f64, 0.05, x, |_t, x, dx| {
            pendulum(x, dx);
            Ok::<(), Infallible>(())
        });
    }
}

#[test]
fn dual_numbers_give_the_derivative_of_the_discrete_map() {
    let start = [1.2, -0.4];
    for j in 0..2 {
        let mut x = start.map(Dual64::from_re);
        x[j].eps = 1.0;
        swing(&mut x, 40);
        // Fourth-order central difference of the same map.
        let at = |by: f64| {
            let mut y = start;
            y[j] += by;
            swing(&mut y, 40);
            y
        };
        let d = 1e-3;
        let (p1, m1, p2, m2) = (at(d), at(-d), at(2.0 * d), at(-2.0 * d));
        for i in 0..2 {
            let difference = (8.0 * (p1[i] - m1[i]) - (p2[i] - m2[i])) / (12.0 * d);
            assert_relative_eq!(x[i].eps, difference, max_relative = 1e-9, epsilon = 1e-9);
        }
        // The real part is the plain map, bit for bit.
        let mut plain = start;
        swing(&mut plain, 40);
        assert_eq!(
            plain.map(f64::to_bits),
            [x[0].re.to_bits(), x[1].re.to_bits()]
        );
    }
}

#[test]
fn variational_equations_stepped_alike_equal_the_dual_derivative() {
    // Ẋ = A(x(t)) X beside ẋ = f(x), in one state of 2 + 4 numbers.
    let mut y = [1.2, -0.4, 1.0, 0.0, 0.0, 1.0];
    let mut rk4 = Rk4::new(6);
    for k in 0..60 {
        let Ok(()) = rk4.step(0.05 * f64::from(k), 0.05, &mut y, |_t, y, dy| {
            pendulum(&y[..2], &mut dy[..2]);
            let a = [[0.0, 1.0], [-9.0 * y[0].cos(), -0.3]];
            for i in 0..2 {
                for j in 0..2 {
                    dy[2 + 2 * i + j] = a[i][0] * y[2 + j] + a[i][1] * y[4 + j];
                }
            }
            Ok::<(), Infallible>(())
        });
    }
    for j in 0..2 {
        let mut x = [1.2, -0.4].map(Dual64::from_re);
        x[j].eps = 1.0;
        swing(&mut x, 60);
        for i in 0..2 {
            assert_relative_eq!(
                x[i].eps,
                y[2 + 2 * i + j],
                max_relative = 1e-12,
                epsilon = 1e-12
            );
        }
    }
}

#[test]
fn a_pendulum_returns_after_its_elliptic_period() {
    let problem = Pendulum {
        frequency: 3.0,
        amplitude: 2.8,
    };
    let swing = Ode::new(2, move |t, x: &[f64], (): &(), dx: &mut [f64]| {
        problem.rate(t, x, dx);
        Ok::<(), Infallible>(())
    });
    let times = [0.0, problem.period()];
    let states = roll_out(
        &swing,
        Rk4::default(),
        &times,
        &[()],
        20_000,
        &problem.initial(),
    )
    .unwrap();
    assert_relative_eq!(states[1][0], 2.8, max_relative = 1e-11);
    assert!(states[1][1].abs() < 1e-9);
}

#[test]
fn a_failing_right_hand_side_leaves_the_state_as_it_was() {
    let mut calls = 0;
    let mut x = [1.0, 2.0];
    let result = Rk4::new(2).step(0.0, 0.1, &mut x, |_t, x, dx| {
        calls += 1;
        dx.copy_from_slice(x);
        if calls == 4 { Err("singular") } else { Ok(()) }
    });
    assert_eq!(result, Err("singular"));
    assert_eq!(x, [1.0, 2.0]);
}
