//! Gradients of roll-outs by six ways that must agree: backwards, forwards, complex step, dual numbers, finite differences, and
//! backwards again with less memory.

use std::convert::Infallible;
use std::sync::atomic::{AtomicUsize, Ordering};

use crate::systems::{DualKepler, DualPendulum, Kepler, Pendulum, Top};
use integrators::gradient::{
    Adjoint, Column, DualOde, DualRate, Explicit, GradientError, RollOutGradient, Schedule,
    Sensitivity,
};
use integrators::{
    Differentiable, Gradient, Heun, Jacobian, Rk4, RollOutError, Space, System, roll_out,
};
use nalgebra::DMatrix;
use num_complex::Complex64;
use num_dual::{Dual64, DualNum};
use proptest::prelude::*;

/// Times with intervals of different lengths.
fn times(samples: usize, mean: f64) -> Vec<f64> {
    (0..samples)
        .map(|k| mean * (k as f64 + 0.3 * (k as f64 * 1.7).sin()))
        .collect()
}

/// Inputs that differ in every interval.
fn inputs<const NU: usize>(samples: usize, size: f64) -> Vec<[f64; NU]> {
    (0..samples - 1)
        .map(|k| std::array::from_fn(|j| size * (0.9 * k as f64 + 2.0 * j as f64).cos()))
        .collect()
}

/// A covector for every sample, of no structure.
fn covector(sample: usize, nt: usize) -> Vec<f64> {
    (0..nt)
        .map(|i| (1.3 * sample as f64 + 0.7 * i as f64 + 0.2).sin())
        .collect()
}

fn all_columns<S: Differentiable>(system: &S, intervals: usize) -> Vec<Column> {
    let mut columns = Column::initial_and_parameters(system);
    columns.extend(Column::inputs(system, 0..intervals));
    columns
}

/// States and their derivatives in everything, at every sample.
fn forwards<S: Differentiable, M: Explicit>(
    system: &S,
    method: M,
    schedule: Schedule<'_, S::Input>,
    initial: &[f64],
) -> (Vec<Vec<f64>>, Vec<DMatrix<f64>>)
where
    S::Input: Sized,
    S::Error: std::fmt::Debug,
{
    let columns = all_columns(system, schedule.intervals());
    let (mut states, mut by) = (Vec::new(), Vec::new());
    Sensitivity::new(system, method)
        .roll_out(system, schedule, initial, &columns, |k, x, d| {
            assert_eq!(k, states.len());
            states.push(x.to_vec());
            by.push(d.clone());
        })
        .unwrap();
    (states, by)
}

/// Σ m_k · x_k with the covectors of `covector`, backwards; all entries in the order of `all_columns`.
fn backwards<S: Differentiable, M: Explicit>(
    system: &S,
    method: M,
    schedule: Schedule<'_, S::Input>,
    initial: &[f64],
    budget: usize,
) -> Vec<f64>
where
    S::Input: Sized,
    S::Error: std::fmt::Debug,
{
    let nt = system.space().tangent_dim();
    let mut gradient = RollOutGradient::default();
    Adjoint::new(system, method)
        .with_budget(budget)
        .gradient(
            system,
            schedule,
            initial,
            |k, _x, by| {
                by.copy_from_slice(&covector(k, nt));
                0.0
            },
            &mut gradient,
        )
        .unwrap();
    [
        gradient.initial,
        gradient.parameters,
        gradient.inputs.as_slice().to_vec(),
    ]
    .concat()
}

/// Σ m_kᵀ ∂x_k/∂c for every column c.
fn contracted(by: &[DMatrix<f64>]) -> Vec<f64> {
    (0..by[0].ncols())
        .map(|c| {
            by.iter()
                .enumerate()
                .map(|(k, by)| {
                    let m = covector(k, by.nrows());
                    by.column(c).iter().zip(&m).map(|(a, b)| a * b).sum::<f64>()
                })
                .sum()
        })
        .collect()
}

/// Largest difference beside the largest entry.
fn relative(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    let size = a.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
    let difference = a.iter().zip(b).map(|(a, b)| (a - b).abs());
    difference.fold(0.0, f64::max) / size
}

fn backwards_is_forwards<S: Differentiable, M: Explicit>(
    name: &str,
    system: &S,
    method: M,
    schedule: Schedule<'_, S::Input>,
    initial: &[f64],
) where
    S::Input: Sized,
    S::Error: std::fmt::Debug,
{
    let (_, by) = forwards(system, method.clone(), schedule, initial);
    let error = relative(
        &contracted(&by),
        &backwards(system, method, schedule, initial, 1 << 20),
    );
    eprintln!("{name}: backwards and forwards differ by {error:.1e}");
    assert!(error < 1e-12, "{name}: {error:e}");
}

#[test]
fn backwards_and_forwards_agree() {
    let (t, u) = (times(9, 0.4), inputs::<1>(9, 2.0));
    let swing = Schedule {
        times: &t,
        inputs: &u,
        substeps: 13,
    };
    let start = [1.2, -0.4];
    backwards_is_forwards("pendulum", &Pendulum::new(), Rk4::default(), swing, &start);
    backwards_is_forwards("Heun's", &Pendulum::new(), Heun::default(), swing, &start);

    let (t, u) = (times(12, 0.6), inputs::<2>(12, 0.05));
    let orbit = Schedule {
        times: &t,
        inputs: &u,
        substeps: 20,
    };
    let start = [0.7, 0.0, 0.0, 1.36];
    backwards_is_forwards("Kepler", &Kepler::new(), Rk4::default(), orbit, &start);

    let (t, u) = (times(8, 0.3), inputs::<3>(8, 0.5));
    for substeps in [1, 2, 11] {
        let turning = Schedule {
            times: &t,
            inputs: &u,
            substeps,
        };
        for weight in [0.0, 3.0] {
            let (top, start) = (Top::new(weight), top_start());
            backwards_is_forwards("top", &top, Rk4::default(), turning, &start);
            backwards_is_forwards("top, Heun's", &top, Heun::default(), turning, &start);
        }
    }
}

fn top_start() -> Vec<f64> {
    let mut x = vec![0.8, -0.3, 0.4, 0.2];
    let size = x.iter().map(|x: &f64| x * x).sum::<f64>().sqrt();
    x.iter_mut().for_each(|x| *x /= size);
    x.extend([0.9, -1.4, 2.1]);
    x
}

#[test]
fn states_are_those_of_the_roll_out_to_the_bit() {
    let (t, u) = (times(8, 0.3), inputs::<3>(8, 0.5));
    let schedule = Schedule {
        times: &t,
        inputs: &u,
        substeps: 3,
    };
    let (top, start) = (Top::new(3.0), top_start());
    let rolled = roll_out(&top, Rk4::default(), &t, &u, 3, &start).unwrap();
    assert_eq!(forwards(&top, Rk4::default(), schedule, &start).0, rolled);
    for budget in [0, 2000, 1 << 20] {
        let mut seen = vec![Vec::new(); t.len()];
        Adjoint::new(&top, Rk4::default())
            .with_budget(budget)
            .gradient(
                &top,
                schedule,
                &start,
                |k, x, _by| {
                    seen[k] = x.to_vec();
                    0.0
                },
                &mut RollOutGradient::default(),
            )
            .unwrap();
        assert_eq!(seen, rolled, "budget {budget}");
    }
}

/// All states at the samples one after the other, by `Rk4<S>` over numbers of any kind: `rate(x, u, dx)`.
fn by_numbers<S: integrators::Real, const NU: usize>(
    (times, inputs, substeps): (&[f64], &[[S; NU]], usize),
    mut x: Vec<S>,
    rate: impl Fn(&[S], &[S], &mut [S]),
) -> Vec<S> {
    let mut rk4 = Rk4::new(x.len());
    let mut states = x.clone();
    for (k, u) in inputs.iter().enumerate() {
        let h = (times[k + 1] - times[k]) / substeps as f64;
        for i in 0..substeps {
            let Ok(()) = rk4.step(times[k] + i as f64 * h, h, &mut x, |_t, x, dx| {
                rate(x, u, dx);
                Ok::<(), Infallible>(())
            });
        }
        states.extend_from_slice(&x);
    }
    states
}

/// Which of the numbers in x, p and u column c of `all_columns` is, and the others plain.
fn seeded<T: From<f64>, const NU: usize>(
    c: usize,
    (x, p, u): (&[f64], &[f64], &[[f64; NU]]),
    seed: impl Fn(f64) -> T,
) -> (Vec<T>, Vec<T>, Vec<[T; NU]>) {
    let at = |i: usize, value: f64| if i == c { seed(value) } else { value.into() };
    let (nx, np) = (x.len(), p.len());
    (
        x.iter().enumerate().map(|(i, &x)| at(i, x)).collect(),
        p.iter().enumerate().map(|(i, &p)| at(nx + i, p)).collect(),
        u.iter()
            .enumerate()
            .map(|(k, u)| std::array::from_fn(|j| at(nx + np + k * NU + j, u[j])))
            .collect(),
    )
}

#[test]
fn forwards_is_the_complex_step() {
    const STEP: f64 = 1e-150;
    let seed = |value| Complex64::new(value, STEP);
    let check = |name: &str, c: usize, by: &[DMatrix<f64>], states: &[Complex64]| {
        let complex: Vec<f64> = states.iter().map(|z| z.im / STEP).collect();
        let column: Vec<f64> = by
            .iter()
            .flat_map(|by| by.column(c).clone_owned().data.as_vec().clone())
            .collect();
        let error = relative(&column, &complex);
        assert!(error < 1e-12, "{name}, column {c}: {error:e}");
    };

    let (t, u) = (times(9, 0.4), inputs::<1>(9, 2.0));
    let (start, system) = ([1.2, -0.4], Pendulum::new());
    let schedule = Schedule {
        times: &t,
        inputs: &u,
        substeps: 13,
    };
    let (_, by) = forwards(&system, Rk4::default(), schedule, &start);
    for c in 0..by[0].ncols() {
        let (x, p, u) = seeded(c, (&start, &system.p, &u), seed);
        let states = by_numbers((&t, &u, 13), x, |x, u, dx| {
            dx[0] = x[1];
            dx[1] = -(x[0].sin() * p[0]) - x[1] * p[1] + u[0];
        });
        check("pendulum", c, &by, &states);
    }

    let (t, u) = (times(12, 0.6), inputs::<2>(12, 0.05));
    let (start, system) = ([0.7, 0.0, 0.0, 1.36], Kepler::new());
    let schedule = Schedule {
        times: &t,
        inputs: &u,
        substeps: 20,
    };
    let (_, by) = forwards(&system, Rk4::default(), schedule, &start);
    for c in 0..by[0].ncols() {
        let (x, p, u) = seeded(c, (&start, &system.p, &u), seed);
        let states = by_numbers((&t, &u, 20), x, |x, u, dx| {
            let r2 = x[0] * x[0] + x[1] * x[1];
            let pull = p[0] / (r2 * r2.sqrt());
            dx.copy_from_slice(&[x[2], x[3], u[0] - pull * x[0], u[1] - pull * x[1]]);
        });
        check("Kepler", c, &by, &states);
    }
}

#[test]
fn forwards_is_the_derivative_of_dual_numbers() {
    fn check<R: DualRate, const NU: usize>(
        name: &str,
        by: &[DMatrix<f64>],
        rate: &R,
        (t, u, substeps): (&[f64], &[[f64; NU]], usize),
        (start, p): (&[f64], &[f64]),
    ) {
        for c in 0..by[0].ncols() {
            let (x, p, u) = seeded(c, (start, p, u), |value| Dual64::new(value, 1.0));
            let states = by_numbers((t, &u, substeps), x, |x, u, dx| {
                assert!(rate.rate(0.0, x, u, &p, dx).is_ok());
            });
            let dual: Vec<f64> = states.iter().map(|z| z.eps).collect();
            let column: Vec<f64> = by
                .iter()
                .flat_map(|by| by.column(c).iter().copied().collect::<Vec<_>>())
                .collect();
            let error = relative(&column, &dual);
            assert!(error < 1e-12, "{name}, column {c}: {error:e}");
        }
    }
    let (t, u) = (times(9, 0.4), inputs::<1>(9, 2.0));
    let schedule = Schedule {
        times: &t,
        inputs: &u,
        substeps: 13,
    };
    let (start, by_hand) = ([1.2, -0.4], Pendulum::new());
    let by_duals = DualOde::new(2, DualPendulum, by_hand.p.to_vec());
    for by in [
        forwards(&by_hand, Rk4::default(), schedule, &start).1,
        forwards(&by_duals, Rk4::default(), schedule, &start).1,
    ] {
        check(
            "pendulum",
            &by,
            &DualPendulum,
            (&t, &u, 13),
            (&start, &by_hand.p),
        );
    }

    let (t, u) = (times(12, 0.6), inputs::<2>(12, 0.05));
    let schedule = Schedule {
        times: &t,
        inputs: &u,
        substeps: 20,
    };
    let (start, by_hand) = ([0.7, 0.0, 0.0, 1.36], Kepler::new());
    let by_duals = DualOde::new(4, DualKepler, by_hand.p.to_vec());
    for by in [
        forwards(&by_hand, Rk4::default(), schedule, &start).1,
        forwards(&by_duals, Rk4::default(), schedule, &start).1,
    ] {
        check(
            "Kepler",
            &by,
            &DualKepler,
            (&t, &u, 20),
            (&start, &by_hand.p),
        );
    }
}

#[test]
fn backwards_by_duals_is_backwards_by_hand() {
    let (t, u) = (times(12, 0.6), inputs::<2>(12, 0.05));
    let schedule = Schedule {
        times: &t,
        inputs: &u,
        substeps: 20,
    };
    let start = [0.7, 0.0, 0.0, 1.36];
    let by_hand = backwards(&Kepler::new(), Rk4::default(), schedule, &start, 1 << 20);
    let kepler = DualOde::new(4, DualKepler, vec![1.0]);
    let by_duals = backwards(&kepler, Rk4::default(), schedule, &start, 1 << 20);
    let error = relative(&by_hand, &by_duals);
    assert!(error < 1e-12, "{error:e}");
}

/// The top in any numbers, with the same chart and the same cut series: an independent derivative by dual numbers.
mod top_in_numbers {
    use super::*;

    fn cross<D: DualNum<Primitive = f64> + Copy>(a: [D; 3], b: [D; 3]) -> [D; 3] {
        [
            a[1] * b[2] - a[2] * b[1],
            a[2] * b[0] - a[0] * b[2],
            a[0] * b[1] - a[1] * b[0],
        ]
    }

    pub fn product<D: DualNum<Primitive = f64> + Copy>(a: [D; 4], b: [D; 4]) -> [D; 4] {
        [
            a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
            a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
            a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
            a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
        ]
    }

    /// (cos θ/2, ξ/θ sin θ/2) by power series in θ², which have derivatives at 0.
    pub fn exp<D: DualNum<Primitive = f64> + Copy>(xi: [D; 3]) -> [D; 4] {
        let square = (xi[0] * xi[0] + xi[1] * xi[1] + xi[2] * xi[2]) * 0.25;
        let (mut cos, mut sinc) = (D::from(0.0), D::from(0.0));
        let (mut even, mut odd) = (D::from(1.0), D::from(1.0));
        for n in 1..16 {
            let m = 2.0 * f64::from(n);
            cos += even;
            sinc += odd;
            even = -even * square / (m * (m - 1.0));
            odd = -odd * square / (m * (m + 1.0));
        }
        let part = sinc * 0.5;
        [cos, xi[0] * part, xi[1] * part, xi[2] * part]
    }

    pub fn rate<D: DualNum<Primitive = f64> + Copy>(
        q: [D; 4],
        omega: [D; 3],
        u: &[D],
        p: &[D],
    ) -> [D; 3] {
        let [w, a, b, c] = q;
        let up = [(a * c - w * b) * 2.0, (b * c + w * a) * 2.0];
        let turning = cross([p[0] * omega[0], p[1] * omega[1], p[2] * omega[2]], omega);
        [
            (turning[0] - p[3] * up[1] + u[0]) / p[0],
            (turning[1] + p[3] * up[0] + u[1]) / p[1],
            (turning[2] + u[2]) / p[2],
        ]
    }

    /// One step of the classical method in the chart, on (q, ω).
    pub fn step<D: DualNum<Primitive = f64> + Copy + integrators::Real>(
        rk4: &mut Rk4<D>,
        h: f64,
        x: &mut [D; 7],
        u: &[D],
        p: &[D],
    ) {
        let q = [x[0], x[1], x[2], x[3]];
        let mut chart = [D::from(0.0); 6];
        chart[3..].copy_from_slice(&x[4..]);
        let Ok(()) = rk4.step(0.0, h, &mut chart, |_t, chart, slope| {
            let xi = [chart[0], chart[1], chart[2]];
            let omega = [chart[3], chart[4], chart[5]];
            let turn = rate(product(q, exp(xi)), omega, u, p);
            // z/(1 − e^{−z}) to the fourth power.
            let mut term = omega;
            slope[..3].copy_from_slice(&term);
            slope[3..].copy_from_slice(&turn);
            for coefficient in [0.5, 1.0 / 12.0, 0.0, -1.0 / 720.0] {
                term = cross(xi, term);
                for i in 0..3 {
                    slope[i] += term[i] * coefficient;
                }
            }
            Ok::<(), Infallible>(())
        });
        let turned = product(q, exp([chart[0], chart[1], chart[2]]));
        x[..4].copy_from_slice(&turned);
        x[4..].copy_from_slice(&chart[3..]);
    }
}

#[test]
fn forwards_on_quaternions_is_the_derivative_of_dual_numbers() {
    use top_in_numbers::{exp, product, step};
    // Up to 0.7 rad a step.
    for (mean, substeps) in [(0.3, 1), (0.3, 4), (0.05, 10)] {
        let (t, u) = (times(8, mean), inputs::<3>(8, 0.5));
        let schedule = Schedule {
            times: &t,
            inputs: &u,
            substeps,
        };
        let (top, start) = (Top::new(3.0), top_start());
        let (states, by) = forwards(&top, Rk4::default(), schedule, &start);
        let columns = by[0].ncols();
        let mut largest = 0.0_f64;
        for c in 0..columns {
            // Directions 0 to 2 of the initial state turn it; 3 to 5 change ω; then the constants, then the inputs.
            let seed =
                |number: usize, value: f64| Dual64::new(value, if number == c { 1.0 } else { 0.0 });
            let turn = exp(std::array::from_fn(|i| seed(i, 0.0)));
            let q = product([0, 1, 2, 3].map(|i| Dual64::from_re(start[i])), turn);
            let mut x = [Dual64::from_re(0.0); 7];
            x[..4].copy_from_slice(&q);
            for i in 0..3 {
                x[4 + i] = seed(3 + i, start[4 + i]);
            }
            let p: [Dual64; 4] = std::array::from_fn(|i| seed(6 + i, top.p[i]));
            let mut rk4 = Rk4::new(6);
            let (mut found, mut expected) = (Vec::new(), Vec::new());
            for k in 0..u.len() {
                let u: [Dual64; 3] = std::array::from_fn(|j| seed(10 + 3 * k + j, u[k][j]));
                for _ in 0..substeps {
                    step(
                        &mut rk4,
                        (t[k + 1] - t[k]) / substeps as f64,
                        &mut x,
                        &u,
                        &p,
                    );
                }
                // 2 q̄ δq is the turn, in the body's axes.
                let mut back = [x[0], -x[1], -x[2], -x[3]].map(|x| Dual64::from_re(x.re));
                back[0].eps = 0.0;
                let moved = product(back, [x[0], x[1], x[2], x[3]]);
                expected.extend((1..4).map(|i| 2.0 * moved[i].eps));
                expected.extend(x[4..].iter().map(|x| x.eps));
                found.extend(by[k + 1].column(c).iter());
                for i in 0..7 {
                    assert!((states[k + 1][i] - x[i].re).abs() < 1e-13);
                }
            }
            largest = largest.max(relative(&expected, &found));
        }
        eprintln!("{substeps} steps in {mean} s: {largest:.1e}");
        assert!(largest < 1e-12, "{largest:e}");
    }
}

#[test]
fn forwards_is_the_finite_difference_along_the_directions_of_motion() {
    let (t, u) = (times(8, 0.3), inputs::<3>(8, 0.5));
    let (start, schedule) = (
        top_start(),
        Schedule {
            times: &t,
            inputs: &u,
            substeps: 5,
        },
    );
    for weight in [0.0, 3.0] {
        let top = Top::new(weight);
        let (states, by) = forwards(&top, Rk4::default(), schedule, &start);
        for (c, column) in all_columns(&top, 7).into_iter().enumerate() {
            let moved = |step: f64| {
                let (mut x, mut u, mut top) = (start.clone(), u.clone(), Top::new(weight));
                match column {
                    Column::Initial(direction) => {
                        let mut motion = [0.0; 6];
                        motion[direction] = step;
                        top.space.move_into(&start, &motion, &mut x);
                    }
                    Column::Parameter(i) => top.p[i] += step,
                    Column::Input { interval, entry } => u[interval][entry] += step,
                }
                roll_out(&top, Rk4::default(), &t, &u, 5, &x).unwrap()
            };
            let apart = |step: f64| -> Vec<f64> {
                let (mut out, mut all) = ([0.0; 6], Vec::new());
                let (plus, minus) = (moved(step), moved(-step));
                for (k, state) in states.iter().enumerate() {
                    // Both from the middle, for the difference of two ends is not seen from there.
                    top.space.difference_into(state, &plus[k], &mut out);
                    let mut sum = out;
                    top.space.difference_into(state, &minus[k], &mut out);
                    for i in 0..6 {
                        sum[i] = (sum[i] - out[i]) / (2.0 * step);
                    }
                    all.extend(sum);
                }
                all
            };
            // Error of the difference of order 4: rounding 1e-16/1e-3 and h⁴ = 1e-12 times fifth derivatives.
            let (near, far) = (apart(1e-3), apart(2e-3));
            let difference: Vec<f64> = near
                .iter()
                .zip(&far)
                .map(|(near, far)| (4.0 * near - far) / 3.0)
                .collect();
            let found: Vec<f64> = by
                .iter()
                .flat_map(|by| by.column(c).iter().copied().collect::<Vec<_>>())
                .collect();
            let error = relative(&difference, &found);
            assert!(error < 1e-9, "weight {weight}, {column:?}: {error:e}");
        }
    }
}

#[test]
fn a_loss_of_the_states_is_derived_backwards() {
    // ½ Σ |x_k − x*|² of the driven pendulum against central differences of order 4.
    let (t, mut u) = (times(9, 0.4), inputs::<1>(9, 2.0));
    let mut pendulum = Pendulum::new();
    let mut start = [1.2, -0.4];
    let loss = |_k: usize, x: &[f64], by: &mut [f64]| {
        by[0] = x[0] - 0.3;
        by[1] = x[1];
        0.5 * (by[0] * by[0] + by[1] * by[1])
    };
    let of = |pendulum: &Pendulum, u: &[[f64; 1]], start: &[f64; 2]| {
        let schedule = Schedule {
            times: &t,
            inputs: u,
            substeps: 7,
        };
        let mut gradient = RollOutGradient::default();
        let value = Adjoint::new(pendulum, Rk4::default())
            .gradient(pendulum, schedule, start, loss, &mut gradient)
            .unwrap();
        (value, gradient)
    };
    let (_, gradient) = of(&pendulum, &u, &start);
    let check = |name: &str, slope: f64, at: &mut dyn FnMut(f64) -> f64| {
        let d = 1e-3;
        let difference = (8.0 * (at(d) - at(-d)) - (at(2.0 * d) - at(-2.0 * d))) / (12.0 * d);
        assert!(
            (difference - slope).abs() < 1e-8 * (1.0 + slope.abs()),
            "{name}: {difference} and {slope}"
        );
    };
    for i in 0..2 {
        let nominal = start;
        check("initial", gradient.initial[i], &mut |d| {
            start[i] = nominal[i] + d;
            let (value, _) = of(&pendulum, &u, &start);
            start = nominal;
            value
        });
        let nominal = pendulum.p;
        check("constant", gradient.parameters[i], &mut |d| {
            pendulum.p[i] = nominal[i] + d;
            let (value, _) = of(&pendulum, &u, &start);
            pendulum.p = nominal;
            value
        });
    }
    for k in 0..u.len() {
        let nominal = u[k][0];
        check("input", gradient.inputs[k], &mut |d| {
            u[k][0] = nominal + d;
            let (value, _) = of(&pendulum, &u, &start);
            u[k][0] = nominal;
            value
        });
    }
}

#[test]
fn a_derivative_in_an_input_does_not_act_backwards_in_time() {
    let (t, u) = (times(6, 0.4), inputs::<1>(6, 2.0));
    let schedule = Schedule {
        times: &t,
        inputs: &u,
        substeps: 4,
    };
    let (_, by) = forwards(&Pendulum::new(), Rk4::default(), schedule, &[1.2, -0.4]);
    for (k, by) in by.iter().enumerate() {
        for interval in 0..5 {
            let column = by.column(4 + interval);
            assert_eq!(column.iter().all(|&x| x == 0.0), interval >= k);
        }
    }
}

/// A pendulum that refuses to go beyond θ = 2, and has no derivative there.
struct Stops(Pendulum);

impl System for Stops {
    type Space = integrators::Flat;
    type Input = [f64; 1];
    type Memory = ();
    type Error = &'static str;
    fn space(&self) -> &integrators::Flat {
        &self.0.space
    }
    fn memory(&self) {}
    fn rate(
        &self,
        t: f64,
        x: &[f64],
        u: &[f64; 1],
        memory: &mut (),
        dx: &mut [f64],
    ) -> Result<(), &'static str> {
        let Ok(()) = self.0.rate(t, x, u, memory, dx);
        if x[0] > 2.0 { Err("stop") } else { Ok(()) }
    }
}

impl Differentiable for Stops {
    fn input_count(&self) -> usize {
        1
    }
    fn parameter_count(&self) -> usize {
        2
    }
    fn linearize(
        &self,
        at: (f64, &[f64], &[f64; 1]),
        memory: &mut (),
        dx: &mut [f64],
        by: &mut Jacobian,
    ) -> Result<(), &'static str> {
        self.rate(at.0, at.1, at.2, memory, dx)?;
        let Ok(()) = self.0.linearize(at, memory, dx, by);
        Ok(())
    }
    fn pull_back(
        &self,
        at: (f64, &[f64], &[f64; 1]),
        memory: &mut (),
        weight: &[f64],
        dx: &mut [f64],
        by: &mut Gradient,
    ) -> Result<(), &'static str> {
        let Ok(()) = self.0.pull_back(at, memory, weight, dx, by);
        Ok(())
    }
}

#[test]
fn what_cannot_be_derived_is_refused() {
    let stops = Stops(Pendulum::new());
    let pushed = [[30.0]; 4];
    let times = [0.0, 0.1, 0.2, 0.3, 0.4];
    let mut adjoint = Adjoint::new(&stops, Rk4::default());
    let mut out = RollOutGradient::default();
    let mut schedule = Schedule {
        times: &times,
        inputs: &pushed[..],
        substeps: 2,
    };
    let quiet = |_k: usize, _x: &[f64], _by: &mut [f64]| 0.0;
    let refused = adjoint.gradient(&stops, schedule, &[1.9, 0.0], quiet, &mut out);
    let error = refused.unwrap_err();
    assert!(
        matches!(error, GradientError::RollOut(RollOutError::Step { time, .. }) if time < 0.2),
        "{error}"
    );
    let refused = Sensitivity::new(&stops, Rk4::default()).roll_out(
        &stops,
        schedule,
        &[1.9, 0.0],
        &[Column::Initial(0)],
        |_, _, _| {},
    );
    assert_eq!(refused.unwrap_err(), error);

    // The same adjoint still works.
    schedule.inputs = &[[0.0]; 4];
    let nan = |k: usize, _x: &[f64], by: &mut [f64]| {
        if k == 2 {
            by[1] = f64::NAN;
        }
        0.0
    };
    let refused = adjoint.gradient(&stops, schedule, &[0.3, 0.0], nan, &mut out);
    assert!(matches!(
        refused.unwrap_err(),
        GradientError::NotFinite {
            part: "the initial state",
            entry: 0,
            ..
        }
    ));
    let value = adjoint.gradient(&stops, schedule, &[0.3, 0.0], quiet, &mut out);
    assert_eq!(value, Ok(0.0));
    assert_eq!(out.initial, [0.0, 0.0]);

    schedule.substeps = 0;
    let refused = adjoint.gradient(&stops, schedule, &[0.3, 0.0], quiet, &mut out);
    assert_eq!(refused, Err(RollOutError::Substeps.into()));
    schedule.substeps = 1;
    let refused = adjoint.gradient(&stops, schedule, &[0.3], quiet, &mut out);
    assert_eq!(
        refused,
        Err(RollOutError::Initial {
            found: 1,
            expected: 2
        }
        .into())
    );
    let refused = Sensitivity::new(&stops, Rk4::default()).roll_out(
        &stops,
        schedule,
        &[0.3, 0.0],
        &[
            Column::Initial(0),
            Column::Input {
                interval: 4,
                entry: 0,
            },
        ],
        |_, _, _| {},
    );
    assert_eq!(
        refused,
        Err(GradientError::Column {
            column: 1,
            what: "interval",
            found: 4,
            count: 4
        })
    );
}

/// Mathieu's equation ẍ = −(p₀ + p₁ cos 2t) x + u, which depends on time.
struct Mathieu;

impl DualRate for Mathieu {
    type Error = Infallible;
    fn rate<D: DualNum<Primitive = f64> + Copy>(
        &self,
        t: f64,
        x: &[D],
        u: &[D],
        p: &[D],
        dx: &mut [D],
    ) -> Result<(), Infallible> {
        dx[0] = x[1];
        dx[1] = -((p[0] + p[1] * (2.0 * t).cos()) * x[0]) + u[0];
        Ok(())
    }
}

#[test]
fn stages_are_derived_at_their_times() {
    let (t, u) = (times(9, 0.4), inputs::<1>(9, 2.0));
    let (p, start) = ([1.3, 0.8], [0.5, -0.2]);
    let mathieu = DualOde::new(2, Mathieu, p.to_vec());
    let schedule = Schedule {
        times: &t,
        inputs: &u,
        substeps: 7,
    };
    let (states, by) = forwards(&mathieu, Rk4::default(), schedule, &start);
    assert_eq!(
        states,
        roll_out(&mathieu, Rk4::default(), &t, &u, 7, &start).unwrap()
    );
    backwards_is_forwards("Mathieu", &mathieu, Rk4::default(), schedule, &start);
    backwards_is_forwards(
        "Mathieu, Heun's",
        &mathieu,
        Heun::default(),
        schedule,
        &start,
    );
    for c in 0..by[0].ncols() {
        let (mut x, p, u) = seeded(c, (&start, &p, &u), |value| Dual64::new(value, 1.0));
        let mut rk4 = Rk4::new(2);
        for (k, u) in u.iter().enumerate() {
            let h = (t[k + 1] - t[k]) / 7.0;
            for i in 0..7 {
                let from = t[k] + f64::from(i) * h;
                let Ok(()) = rk4.step(from, h, &mut x, |t, x, dx| Mathieu.rate(t, x, u, &p, dx));
            }
            let dual: Vec<f64> = x.iter().map(|x| x.eps).collect();
            let found: Vec<f64> = by[k + 1].column(c).iter().copied().collect();
            if dual.iter().any(|&x| x != 0.0) {
                assert!(relative(&dual, &found) < 1e-12, "column {c}, sample {k}");
            }
        }
    }
}

/// A pendulum that counts the calls of its rate and of its derivative backwards.
struct Counted {
    pendulum: Pendulum,
    rates: AtomicUsize,
    backwards: AtomicUsize,
}

impl System for Counted {
    type Space = integrators::Flat;
    type Input = [f64; 1];
    type Memory = ();
    type Error = Infallible;
    fn space(&self) -> &integrators::Flat {
        &self.pendulum.space
    }
    fn memory(&self) {}
    fn rate(
        &self,
        t: f64,
        x: &[f64],
        u: &[f64; 1],
        memory: &mut (),
        dx: &mut [f64],
    ) -> Result<(), Infallible> {
        self.rates.fetch_add(1, Ordering::Relaxed);
        self.pendulum.rate(t, x, u, memory, dx)
    }
}

impl Differentiable for Counted {
    fn input_count(&self) -> usize {
        1
    }
    fn parameter_count(&self) -> usize {
        2
    }
    fn linearize(
        &self,
        at: (f64, &[f64], &[f64; 1]),
        memory: &mut (),
        dx: &mut [f64],
        by: &mut Jacobian,
    ) -> Result<(), Infallible> {
        self.pendulum.linearize(at, memory, dx, by)
    }
    fn pull_back(
        &self,
        at: (f64, &[f64], &[f64; 1]),
        memory: &mut (),
        weight: &[f64],
        dx: &mut [f64],
        by: &mut Gradient,
    ) -> Result<(), Infallible> {
        self.backwards.fetch_add(1, Ordering::Relaxed);
        self.pendulum.pull_back(at, memory, weight, dx, by)
    }
}

#[test]
fn steps_are_run_again_as_seldom_as_the_memory_allows() {
    const STEPS: usize = 8_000;
    let times = [0.0, 8.0];
    let schedule = Schedule {
        times: &times,
        inputs: &[[0.1]],
        substeps: STEPS,
    };
    // The stages of a step are 8 numbers, a kept state 3. 80 000 numbers hold all stages; 4000 those of 400 steps and 20 states; 200
    // those of a dozen steps and 33 states: 667 segments are more than β(34, 1) = 35 and more than β(34, 2) = 630.
    for (numbers, most) in [(80_000, 1.0), (4_000, 2.0), (200, 4.0)] {
        let counted = Counted {
            pendulum: Pendulum::new(),
            rates: AtomicUsize::new(0),
            backwards: AtomicUsize::new(0),
        };
        backwards(&counted, Rk4::default(), schedule, &[1.2, 0.0], 8 * numbers);
        let runs = counted.rates.into_inner() as f64 / (4 * STEPS) as f64;
        eprintln!("{numbers} numbers: every step is run {runs:.2} times");
        assert!((1.0..=most).contains(&runs), "{numbers}: {runs}");
        assert_eq!(counted.backwards.into_inner(), 4 * STEPS);
    }
}

#[test]
fn one_workspace_serves_systems_of_several_sizes() {
    let (small, large) = (
        DualOde::<_, 1>::new(2, DualPendulum, vec![9.0, 0.3]),
        DualOde::<_, 1>::new(2, DualPendulum, vec![9.0, 0.3, 7.0]),
    );
    let (t, u) = (times(4, 0.4), inputs::<1>(4, 2.0));
    let swing = Schedule {
        times: &t,
        inputs: &u,
        substeps: 5,
    };
    let loss = |_k: usize, x: &[f64], by: &mut [f64]| {
        by[0] = 1.0;
        x[0]
    };
    let mut adjoint = Adjoint::new(&small, Rk4::default());
    let mut sensitivity = Sensitivity::new(&small, Rk4::default());
    let (mut of_small, mut of_large) = (RollOutGradient::default(), RollOutGradient::default());
    let start = [1.2, -0.4];
    adjoint
        .gradient(&small, swing, &start, loss, &mut of_small)
        .unwrap();
    adjoint
        .gradient(&large, swing, &start, loss, &mut of_large)
        .unwrap();
    assert_eq!(of_small.initial, of_large.initial);
    assert_eq!(of_small.parameters, of_large.parameters[..2]);
    // A constant that does nothing.
    assert_eq!(of_large.parameters[2], 0.0);
    let mut widths = Vec::new();
    for system in [&small, &large] {
        let columns = Column::initial_and_parameters(system);
        sensitivity
            .roll_out(system, swing, &start, &columns, |k, _x, by| {
                if k == 3 {
                    widths.push(by.ncols());
                }
            })
            .unwrap();
    }
    assert_eq!(widths, [4, 5]);
}

#[test]
fn one_sample_has_its_loss_alone() {
    let pendulum = Pendulum::new();
    let mut out = RollOutGradient::default();
    let one = Schedule {
        times: &[3.0],
        inputs: &[],
        substeps: 2,
    };
    let mut adjoint = Adjoint::new(&pendulum, Rk4::default());
    let loss = |_k: usize, x: &[f64], by: &mut [f64]| {
        by[1] = 2.0;
        2.0 * x[1]
    };
    let value = adjoint.gradient(&pendulum, one, &[0.5, 4.0], loss, &mut out);
    assert_eq!(value, Ok(8.0));
    assert_eq!(out.initial, [0.0, 2.0]);
    assert_eq!(out.parameters, [0.0, 0.0]);
    assert_eq!(out.inputs.shape(), (1, 0));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn the_budget_does_not_change_a_bit(
        samples in 1_usize..12,
        substeps in 1_usize..40,
        budget in 0_usize..6000,
        weight in 0.0..3.0,
    ) {
        let (t, u) = (times(samples, 0.2), inputs::<3>(samples, 0.5));
        let turning = Schedule { times: &t, inputs: &u, substeps };
        let top = Top::new(weight);
        let all = backwards(&top, Rk4::default(), turning, &top_start(), 1 << 24);
        let few = backwards(&top, Rk4::default(), turning, &top_start(), budget);
        prop_assert_eq!(all, few);

        let u = inputs::<1>(samples, 2.0);
        let swing = Schedule { times: &t, inputs: &u, substeps };
        let all = backwards(&Pendulum::new(), Heun::default(), swing, &[1.2, -0.4], 1 << 24);
        let few = backwards(&Pendulum::new(), Heun::default(), swing, &[1.2, -0.4], budget / 10);
        prop_assert_eq!(all, few);
    }
}
