//! Work against precision of the adaptive methods, on problems that are stiff and on problems that are not.
//!
//! `cargo bench -p integrators --features adaptive --bench adaptive_work_precision` prints tables; with `-- --json FILE` also one line of JSON
//! for each run; with `-- --only NAME` for problems whose name contains NAME.
//!
//! Work is given twice: as evaluations (a Jacobian of n directions counts 1 + n/2) and as processor time of the thread. The error is the
//! largest one of the state at the end, relative to |x| + s with the size s of the problem's coordinates; tolerances are rtol and
//! atol = rtol · s. The ratio of Automatic to the better of Tsit5 and BDF is at equal error, on the straight lines between runs in
//! logarithms.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::convert::Infallible;
use std::io::Write as _;

use integrators::adaptive::{Inputs, Method, Settings, roll_out};
use integrators::problems::{
    DoublePendulum, HeavyTop, Kepler, Pendulum, Problem, RigidBody, Robertson, VanDerPol,
};
use integrators::{Differentiable, Flat, Gradient, Jacobian, Space, System};

const METHODS: [Method; 5] = [
    Method::Tsit5,
    Method::TrBdf2,
    Method::Esdirk34,
    Method::Bdf,
    Method::Automatic,
];

/// Steps beyond which a method has lost.
const STEPS: usize = 60_000;

/// A run of a method.
#[derive(Clone, Copy)]
struct Run {
    error: f64,
    evaluations: f64,
    seconds: f64,
    steps: usize,
    switches: usize,
}

fn thread_seconds() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

/// Every method at every tolerance on one problem.
#[allow(clippy::too_many_arguments)]
fn measure<S>(
    name: &str,
    system: &S,
    initial: &[f64],
    end: f64,
    sizes: &[f64],
    reference: Option<Vec<f64>>,
    json: &mut Option<std::fs::File>,
    only: Option<&str>,
) -> Option<(String, [f64; 2], [f64; 2])>
where
    S: Differentiable<Input = ()>,
    S::Error: std::fmt::Debug,
{
    if only.is_some_and(|only| !name.contains(only)) {
        return None;
    }
    let times = [0.0, end];
    let absolute = |tolerance: f64| -> Vec<f64> { sizes.iter().map(|s| s * tolerance).collect() };
    let reference = reference.unwrap_or_else(|| {
        // Of another method and a hundred times finer than the finest run.
        let settings = Settings::new(Method::Esdirk34, 1e-12, 1e-12)
            .with_absolute(&absolute(1e-12))
            .with_max_steps(20_000_000);
        let rolled = roll_out(system, &settings, &times, Inputs::Constant(&()), initial);
        rolled.expect("reference").states.remove(1)
    });
    let space = system.space();
    let directions = space.tangent_dim();
    let jacobian = 1.0 + 0.5 * directions as f64;
    let mut curves = Vec::new();
    println!("\n{name}");
    for method in METHODS {
        let mut curve = Vec::new();
        for tenth in [6, 8, 10, 12, 14, 16, 18] {
            let tolerance = 10_f64.powf(-f64::from(tenth) / 2.0);
            let settings = Settings::new(method, tolerance, 1.0)
                .with_absolute(&absolute(tolerance))
                .with_max_steps(STEPS);
            let run = || roll_out(system, &settings, &times, Inputs::Constant(&()), initial);
            let Ok(rolled) = run() else { continue };
            let (mut off, mut scale) = (vec![0.0; directions], vec![0.0; directions]);
            space.difference_into(&reference, &rolled.states[1], &mut off);
            space.scale_into(&reference, &mut scale);
            let error = off
                .iter()
                .zip(&scale)
                .zip(sizes)
                .map(|((e, x), s)| e.abs() / (x.abs() + s))
                .fold(0.0, f64::max);
            let mut seconds = f64::INFINITY;
            let rounds = if cfg!(debug_assertions) { 1 } else { 7 };
            for _ in 0..rounds {
                // As many as take a few milliseconds.
                let (begin, mut count) = (thread_seconds(), 0);
                while thread_seconds() - begin < 4e-3 {
                    std::hint::black_box(run().ok());
                    count += 1;
                }
                seconds = seconds.min((thread_seconds() - begin) / f64::from(count));
            }
            let statistics = &rolled.statistics;
            let run = Run {
                error,
                evaluations: statistics.evaluations as f64 + jacobian * statistics.jacobians as f64,
                seconds,
                steps: statistics.steps,
                switches: statistics.switches.len() - 1,
            };
            if let Some(json) = json {
                let line = serde_json::json!({
                    "problem": name, "method": method.name(), "tolerance": tolerance, "error": error,
                    "weighted_evaluations": run.evaluations, "seconds": seconds,
                    "steps": run.steps, "explicit_steps": statistics.explicit_steps,
                    "evaluations": statistics.evaluations, "jacobians": statistics.jacobians,
                    "switches": run.switches,
                });
                writeln!(json, "{line}").unwrap();
            }
            println!(
                "  {:9} {:8.1e}: error {:8.1e}  work {:9.1}  {:9.1} µs  steps {:6}  switches {}",
                method.name(),
                tolerance,
                error,
                run.evaluations,
                1e6 * seconds,
                run.steps,
                run.switches
            );
            curve.push(run);
        }
        curves.push(curve);
    }
    let work = |run: &Run| run.evaluations;
    let time = |run: &Run| run.seconds;
    let (work, time) = (ratios(&curves, work), ratios(&curves, time));
    println!(
        "  Automatic / better of Tsit5 and BDF at equal error: work {:.2} (worst {:.2}), time {:.2} (worst {:.2})",
        work[0], work[1], time[0], time[1]
    );
    Some((name.to_string(), work, time))
}

/// Geometric mean and largest of the ratio of Automatic to the better pure method, over the errors of the runs of Automatic.
fn ratios(curves: &[Vec<Run>], cost: impl Fn(&Run) -> f64) -> [f64; 2] {
    let (mut sum, mut count, mut worst) = (0.0, 0.0, 0.0_f64);
    for run in &curves[4] {
        let better = [&curves[0], &curves[3]]
            .into_iter()
            .map(|curve| at_error(curve, run.error, &cost))
            .fold(f64::INFINITY, f64::min);
        if better.is_finite() {
            let ratio = cost(run) / better;
            sum += ratio.ln();
            count += 1.0;
            worst = worst.max(ratio);
        }
    }
    [f64::exp(sum / count), worst]
}

/// What a method takes for an error, from the lines between its runs; infinite below its smallest error.
fn at_error(curve: &[Run], error: f64, cost: &impl Fn(&Run) -> f64) -> f64 {
    let mut best = f64::INFINITY;
    for run in curve.iter().filter(|run| run.error <= error) {
        best = best.min(cost(run));
    }
    for pair in curve.windows(2) {
        let (a, b) = (pair[0].error.ln(), pair[1].error.ln());
        let part = (error.ln() - a) / (b - a);
        if (0.0..=1.0).contains(&part) {
            let line = (1.0 - part) * cost(&pair[0]).ln() + part * cost(&pair[1]).ln();
            best = best.min(line.exp());
        }
    }
    best
}

/// ẋ = f(x) with its Jacobian, as closures.
struct Plain<F, J> {
    space: Flat,
    rate: F,
    jacobian: J,
}

fn plain<F, J>(dim: usize, rate: F, jacobian: J) -> Plain<F, J>
where
    F: Fn(f64, &[f64], &mut [f64]) + Sync,
    J: Fn(f64, &[f64], &mut dyn FnMut(usize, usize, f64)) + Sync,
{
    Plain {
        space: Flat::new(dim),
        rate,
        jacobian,
    }
}

impl<F, J> System for Plain<F, J>
where
    F: Fn(f64, &[f64], &mut [f64]) + Sync,
    J: Fn(f64, &[f64], &mut dyn FnMut(usize, usize, f64)) + Sync,
{
    type Space = Flat;
    type Input = ();
    type Memory = ();
    type Error = Infallible;
    fn space(&self) -> &Flat {
        &self.space
    }
    fn memory(&self) {}
    fn rate(
        &self,
        t: f64,
        x: &[f64],
        _u: &(),
        _m: &mut (),
        dx: &mut [f64],
    ) -> Result<(), Infallible> {
        (self.rate)(t, x, dx);
        Ok(())
    }
}

impl<F, J> Differentiable for Plain<F, J>
where
    F: Fn(f64, &[f64], &mut [f64]) + Sync,
    J: Fn(f64, &[f64], &mut dyn FnMut(usize, usize, f64)) + Sync,
{
    fn input_count(&self) -> usize {
        0
    }
    fn parameter_count(&self) -> usize {
        0
    }
    fn linearize(
        &self,
        (t, x, _u): (f64, &[f64], &()),
        _m: &mut (),
        dx: &mut [f64],
        by: &mut Jacobian,
    ) -> Result<(), Infallible> {
        (self.rate)(t, x, dx);
        by.state.fill(0.0);
        (self.jacobian)(t, x, &mut |i, j, value| by.state[(i, j)] = value);
        Ok(())
    }
    fn pull_back(
        &self,
        (t, x, _u): (f64, &[f64], &()),
        _m: &mut (),
        weight: &[f64],
        dx: &mut [f64],
        by: &mut Gradient,
    ) -> Result<(), Infallible> {
        (self.rate)(t, x, dx);
        (self.jacobian)(t, x, &mut |i, j, value| by.state[j] += weight[i] * value);
        Ok(())
    }
}

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let after = |flag: &str| {
        let place = arguments.iter().position(|a| a == flag)?;
        arguments.get(place + 1).cloned()
    };
    let mut json = after("--json").map(|path| std::fs::File::create(path).unwrap());
    let only = after("--only");
    let only = only.as_deref();
    let mut table = Vec::new();
    macro_rules! problem {
        ($name:expr, $problem:expr, $end:expr, $sizes:expr) => {{
            let problem = $problem;
            table.extend(measure(
                $name,
                &problem,
                &problem.initial(),
                $end,
                &$sizes,
                problem.solution($end),
                &mut json,
                only,
            ));
        }};
    }
    let pendulum = Pendulum {
        frequency: 3.0,
        amplitude: 2.6,
    };
    problem!("pendulum, 149°", pendulum, 20.0, [1.0; 2]);
    problem!(
        "Kepler, e = 0.6",
        Kepler { eccentricity: 0.6 },
        20.0,
        [1.0; 4]
    );
    let double = DoublePendulum::default();
    let span = double.span();
    problem!("double pendulum", double, span, [1.0; 4]);
    let body = RigidBody {
        moments: [1.0, 2.0, 3.0],
        across: 1.0,
        along: 1.2,
    };
    problem!("free rigid body", body, 10.0, [1.0; 6]);
    let top = HeavyTop::default();
    let span = top.span();
    problem!("heavy top", top, span, [1.0; 6]);
    problem!(
        "Robertson, 40 s",
        Robertson::default(),
        40.0,
        [1.0, 1e-4, 1.0]
    );
    problem!(
        "Robertson, 1e11 s",
        Robertson::default(),
        1e11,
        [1e-6, 1e-10, 1.0]
    );
    problem!("van der Pol, ε = 1e-6", VanDerPol::default(), 2.0, [1.0; 2]);
    problem!(
        "van der Pol, ε = 1e-3",
        VanDerPol { epsilon: 1e-3 },
        2.0,
        [1.0; 2]
    );
    problem!(
        "van der Pol, ε = 0.1",
        VanDerPol { epsilon: 0.1 },
        4.0,
        [1.0; 2]
    );

    // Hairer and Wanner II, IV.10: the chemical reaction of eight species of Schäfer (1975).
    let hires = plain(
        8,
        |_t, y: &[f64], dy: &mut [f64]| {
            let r = 280.0 * y[5] * y[7];
            dy[0] = -1.71 * y[0] + 0.43 * y[1] + 8.32 * y[2] + 0.0007;
            dy[1] = 1.71 * y[0] - 8.75 * y[1];
            dy[2] = -10.03 * y[2] + 0.43 * y[3] + 0.035 * y[4];
            dy[3] = 8.32 * y[1] + 1.71 * y[2] - 1.12 * y[3];
            dy[4] = -1.745 * y[4] + 0.43 * y[5] + 0.43 * y[6];
            dy[5] = -r + 0.69 * y[3] + 1.71 * y[4] - 0.43 * y[5] + 0.69 * y[6];
            dy[6] = r - 1.81 * y[6];
            dy[7] = -r + 1.81 * y[6];
        },
        |_t, y: &[f64], set: &mut dyn FnMut(usize, usize, f64)| {
            for (i, j, value) in [
                (0, 0, -1.71),
                (0, 1, 0.43),
                (0, 2, 8.32),
                (1, 0, 1.71),
                (1, 1, -8.75),
                (2, 2, -10.03),
                (2, 3, 0.43),
                (2, 4, 0.035),
                (3, 1, 8.32),
                (3, 2, 1.71),
                (3, 3, -1.12),
                (4, 4, -1.745),
                (4, 5, 0.43),
                (4, 6, 0.43),
                (5, 3, 0.69),
                (5, 4, 1.71),
                (5, 5, -0.43 - 280.0 * y[7]),
                (5, 6, 0.69),
                (5, 7, -280.0 * y[5]),
                (6, 5, 280.0 * y[7]),
                (6, 6, -1.81),
                (6, 7, 280.0 * y[5]),
                (7, 5, -280.0 * y[7]),
                (7, 6, 1.81),
                (7, 7, -280.0 * y[5]),
            ] {
                set(i, j, value);
            }
        },
    );
    table.extend(measure(
        "HIRES",
        &hires,
        &[1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0057],
        321.8122,
        &[1e-3; 8],
        None,
        &mut json,
        only,
    ));
    // Hairer and Wanner II, IV.10: Field and Noyes.
    let oregonator = plain(
        3,
        |_t, y: &[f64], dy: &mut [f64]| {
            dy[0] = 77.27 * (y[1] + y[0] * (1.0 - 8.375e-6 * y[0] - y[1]));
            dy[1] = (y[2] - (1.0 + y[0]) * y[1]) / 77.27;
            dy[2] = 0.161 * (y[0] - y[2]);
        },
        |_t, y: &[f64], set: &mut dyn FnMut(usize, usize, f64)| {
            set(0, 0, 77.27 * (1.0 - 2.0 * 8.375e-6 * y[0] - y[1]));
            set(0, 1, 77.27 * (1.0 - y[0]));
            set(1, 0, -y[1] / 77.27);
            set(1, 1, -(1.0 + y[0]) / 77.27);
            set(1, 2, 1.0 / 77.27);
            set(2, 0, 0.161);
            set(2, 2, -0.161);
        },
    );
    table.extend(measure(
        "Oregonator",
        &oregonator,
        &[1.0, 2.0, 3.0],
        100.0,
        &[1.0; 3],
        None,
        &mut json,
        only,
    ));
    // A stiff spring in a swinging one: r̈ = r θ̇² + g cos θ − k (r − 1) − d ṙ, r θ̈ = −g sin θ − 2 ṙ θ̇.
    let spring = plain(
        4,
        |_t, y: &[f64], dy: &mut [f64]| {
            let (r, theta, v, w) = (y[0], y[1], y[2], y[3]);
            dy[0] = v;
            dy[1] = w;
            dy[2] = r * w * w + 9.81 * theta.cos() - 1e5 * (r - 1.0) - 600.0 * v;
            dy[3] = (-9.81 * theta.sin() - 2.0 * v * w) / r;
        },
        |_t, y: &[f64], set: &mut dyn FnMut(usize, usize, f64)| {
            let (r, theta, v, w) = (y[0], y[1], y[2], y[3]);
            set(0, 2, 1.0);
            set(1, 3, 1.0);
            set(2, 0, w * w - 1e5);
            set(2, 1, -9.81 * theta.sin());
            set(2, 2, -600.0);
            set(2, 3, 2.0 * r * w);
            set(3, 0, (9.81 * theta.sin() + 2.0 * v * w) / (r * r));
            set(3, 1, -9.81 * theta.cos() / r);
            set(3, 2, -2.0 * w / r);
            set(3, 3, -2.0 * v / r);
        },
    );
    table.extend(measure(
        "pendulum on a stiff damped spring",
        &spring,
        &[1.0, 1.5, 0.0, 0.0],
        5.0,
        &[1.0; 4],
        None,
        &mut json,
        only,
    ));

    // What follows was not looked at while the constants of the changes were chosen.
    for epsilon in [1e-4, 1e-5] {
        let name = format!("van der Pol, ε = {epsilon:e}");
        problem!(&name, VanDerPol { epsilon }, 2.0, [1.0; 2]);
    }
    // Prothero and Robinson: ẏ = −λ (y − cos t) − sin t with y = cos t; time is the second coordinate.
    let prothero = plain(
        2,
        |_t, y: &[f64], dy: &mut [f64]| {
            dy[0] = -1e4 * (y[0] - y[1].cos()) - y[1].sin();
            dy[1] = 1.0;
        },
        |_t, y: &[f64], set: &mut dyn FnMut(usize, usize, f64)| {
            set(0, 0, -1e4);
            set(0, 1, -1e4 * y[1].sin() - y[1].cos());
        },
    );
    table.extend(measure(
        "Prothero and Robinson",
        &prothero,
        &[1.0, 0.0],
        10.0,
        &[1.0; 2],
        Some(vec![10.0_f64.cos(), 10.0]),
        &mut json,
        only,
    ));
    // Hairer and Wanner II, IV.10, on a coarser grid: the Brusselator with diffusion on 16 points, α (N + 1)² = 5.78.
    const POINTS: usize = 16;
    let diffusion = 0.02 * ((POINTS + 1) * (POINTS + 1)) as f64;
    let brusselator = plain(
        2 * POINTS,
        move |_t, y: &[f64], dy: &mut [f64]| {
            for i in 0..POINTS {
                let (u, v) = (y[i], y[POINTS + i]);
                let side = |at: usize, edge: f64| -> f64 {
                    let left = if i == 0 { edge } else { y[at - 1] };
                    let right = if i + 1 == POINTS { edge } else { y[at + 1] };
                    diffusion * (left - 2.0 * y[at] + right)
                };
                dy[i] = 1.0 + u * u * v - 4.0 * u + side(i, 1.0);
                dy[POINTS + i] = 3.0 * u - u * u * v + side(POINTS + i, 3.0);
            }
        },
        move |_t, y: &[f64], set: &mut dyn FnMut(usize, usize, f64)| {
            for i in 0..POINTS {
                let (u, v) = (y[i], y[POINTS + i]);
                set(i, i, 2.0 * u * v - 4.0 - 2.0 * diffusion);
                set(i, POINTS + i, u * u);
                set(POINTS + i, i, 3.0 - 2.0 * u * v);
                set(POINTS + i, POINTS + i, -u * u - 2.0 * diffusion);
                for base in [0, POINTS] {
                    if i > 0 {
                        set(base + i, base + i - 1, diffusion);
                    }
                    if i + 1 < POINTS {
                        set(base + i, base + i + 1, diffusion);
                    }
                }
            }
        },
    );
    let start: Vec<f64> = (0..2 * POINTS)
        .map(|i| {
            let place = (i + 1) as f64 / (POINTS + 1) as f64;
            if i < POINTS {
                1.0 + (std::f64::consts::TAU * place).sin()
            } else {
                3.0
            }
        })
        .collect();
    table.extend(measure(
        "Brusselator, 16 points",
        &brusselator,
        &start,
        10.0,
        &[1.0; 2 * POINTS],
        None,
        &mut json,
        only,
    ));

    println!("\n| problem | work, mean | work, worst | time, mean | time, worst |");
    println!("|---|---|---|---|---|");
    for (name, work, time) in table {
        println!(
            "| {name} | {:.2} | {:.2} | {:.2} | {:.2} |",
            work[0], work[1], time[0], time[1]
        );
    }
}
