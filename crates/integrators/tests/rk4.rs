//! The classical Runge-Kutta method by itself: as a plain step, and on dual numbers.

use std::convert::Infallible;

use approx::assert_relative_eq;
use integrators::problems::{Pendulum, Problem};
use integrators::{Rk4, roll_out};
use num_dual::{Dual64, DualNum};

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
    for (degrees, half_steps) in [(5.0_f64, 1000), (90.0, 2000), (150.0, 4000)] {
        let problem = Pendulum {
            frequency: 3.0,
            amplitude: degrees.to_radians(),
        };
        let period = problem.period();
        let times = [0.0, 0.5 * period, period];
        let start = problem.initial();
        let states = roll_out(
            &problem,
            Rk4::default(),
            &times,
            &[(), ()],
            half_steps,
            &start,
        )
        .unwrap();
        assert_relative_eq!(states[1][0], -problem.amplitude, max_relative = 1e-11);
        assert_relative_eq!(states[2][0], problem.amplitude, max_relative = 1e-11);
        assert!(states[1][1].abs() < 1e-9 && states[2][1].abs() < 1e-9);
    }
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
