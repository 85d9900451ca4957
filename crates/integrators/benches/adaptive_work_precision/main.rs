//! Work against precision of the adaptive methods, on problems that are stiff and on problems that are not.
//!
//! `cargo bench -p integrators --features adaptive --bench adaptive_work_precision` prints tables; with `-- --json FILE` also one line of JSON
//! for each run; with `-- --only NAME` for problems whose name contains NAME.
//!
//! Work is given twice: in evaluations of the rate (a Jacobian of n directions counts 1 + n/2 of them, an LU factorisation n/3, as
//! where a rate takes n² operations), and as processor time of the thread, the least of [`ROUNDS`]. The error is the largest one of the
//! states at [`SAMPLES`] times, relative to |x| + s with the size s of the problem's coordinates; tolerances are rtol and
//! atol = rtol · s. The ratio of Automatic to the better of Tsit5 and BDF is at equal error, on the straight lines between runs in
//! logarithms; for it, the error of a run is the geometric mean over the tolerances up to ten times larger and smaller, as that of one run
//! may be small by chance (that of Tsit5 on the pendulum is smaller at 10⁻⁵ than at 10⁻⁶), and runs with errors above [`LARGEST`] do not count.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod plain;
mod problems;

use std::io::Write as _;

use integrators::adaptive::{Inputs, Method, Settings, roll_out};
use integrators::problems::Problem;
use integrators::{Differentiable, Rk4, Space};

const METHODS: [Method; 5] = [
    Method::Tsit5,
    Method::TrBdf2,
    Method::Esdirk34,
    Method::Bdf,
    Method::Automatic,
];

/// Steps beyond which a method has lost.
const STEPS: usize = 60_000;

/// Times at which errors are taken.
const SAMPLES: usize = 50;

/// Tolerances are 10^(−k/2) from this k on.
const COARSEST: usize = 6;

/// To this one.
const FINEST: usize = 18;

/// Half powers over which errors are averaged, to either side.
const NEIGHBOURS: usize = 2;

/// Errors beyond which there is no solution.
const LARGEST: f64 = 0.1;

/// Rounds of which the fastest counts.
const ROUNDS: usize = 7;

/// A run of a method.
#[derive(Clone, Copy)]
struct Run {
    error: f64,
    work: f64,
    seconds: f64,
}

/// Where the states come from that errors are measured against.
#[derive(Clone, Copy)]
pub(crate) enum Reference {
    /// The fixed-step classical method of order 4, so many steps between two samples.
    Fixed(usize),
    /// ESDIRK34 at 10⁻¹².
    Implicit,
}

/// A problem with its scales.
pub(crate) struct Case<'a, S> {
    pub(crate) name: &'a str,
    pub(crate) system: &'a S,
    pub(crate) initial: &'a [f64],
    /// Samples, 0 first.
    pub(crate) times: Vec<f64>,
    /// One for each direction of motion.
    pub(crate) sizes: &'a [f64],
    pub(crate) reference: Vec<Vec<f64>>,
}

/// [`SAMPLES`] equal intervals to `end`.
pub(crate) fn evenly(end: f64) -> Vec<f64> {
    (0..=SAMPLES)
        .map(|k| end * k as f64 / SAMPLES as f64)
        .collect()
}

/// 0 and [`SAMPLES`] times up to `end`, each the same multiple of the one before it.
pub(crate) fn in_decades(start: f64, end: f64) -> Vec<f64> {
    let ratio = (end / start).powf(1.0 / (SAMPLES - 1) as f64);
    std::iter::once(0.0)
        .chain((1..SAMPLES).map(|k| start * ratio.powi(k as i32 - 1)))
        .chain([end])
        .collect()
}

fn thread_seconds() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

/// The largest part of a size by which two trajectories differ.
fn error<S: Differentiable>(case: &Case<'_, S>, states: &[Vec<f64>]) -> f64 {
    let space = case.system.space();
    let directions = space.tangent_dim();
    let (mut off, mut scale) = (vec![0.0; directions], vec![0.0; directions]);
    let mut largest = 0.0_f64;
    for (exact, found) in case.reference.iter().zip(states) {
        space.difference_into(exact, found, &mut off);
        space.scale_into(exact, &mut scale);
        for ((e, x), s) in off.iter().zip(&scale).zip(case.sizes) {
            largest = largest.max(e.abs() / (x.abs() + s));
        }
    }
    largest
}

/// What is wanted, and what was found.
pub(crate) struct Bench {
    json: Option<std::fs::File>,
    only: Option<String>,
    table: Vec<(String, [f64; 2], [f64; 2])>,
}

impl Bench {
    pub(crate) fn wants(&self, name: &str) -> bool {
        self.only.as_ref().is_none_or(|only| name.contains(only))
    }

    /// A problem of the library: against its solution where that is known at all times.
    pub(crate) fn problem<P: Problem>(
        &mut self,
        name: &str,
        problem: &P,
        times: Vec<f64>,
        sizes: &[f64],
        reference: Reference,
    ) {
        if !self.wants(name) {
            return;
        }
        let initial = problem.initial();
        let known: Option<Vec<_>> = times.iter().map(|&t| problem.solution(t)).collect();
        let of_library = known.is_some();
        let case = Case {
            name,
            system: problem,
            initial: &initial,
            reference: known
                .unwrap_or_else(|| references(problem, &initial, &times, sizes, reference)),
            times,
            sizes,
        };
        self.measure(&case);
        let end = case.times[case.times.len() - 1];
        if let Some(known) = problem.solution(end).filter(|_| !of_library) {
            let found = case.reference[SAMPLES..].to_vec();
            let alone = Case {
                reference: vec![known],
                times: vec![end],
                ..case
            };
            println!(
                "  the reference is off by {:.1e} at the end",
                error(&alone, &found)
            );
        }
    }

    /// A problem of this bench.
    pub(crate) fn plain<S>(
        &mut self,
        name: &str,
        system: &S,
        initial: &[f64],
        times: Vec<f64>,
        sizes: &[f64],
        reference: Reference,
    ) where
        S: Differentiable<Input = ()>,
        S::Error: std::fmt::Debug,
    {
        if self.wants(name) {
            let reference = references(system, initial, &times, sizes, reference);
            self.measure(&Case {
                name,
                system,
                initial,
                times,
                sizes,
                reference,
            });
        }
    }

    /// Every method at every tolerance on one problem.
    fn measure<S>(&mut self, case: &Case<'_, S>)
    where
        S: Differentiable<Input = ()>,
        S::Error: std::fmt::Debug,
    {
        let name = case.name;
        let directions = case.sizes.len() as f64;
        let mut curves = Vec::new();
        println!("\n{name}");
        for method in METHODS {
            let mut curve = Vec::new();
            // The others go on to where their errors are as small as those of Automatic, whose implicit steps are at a tenth.
            let finest = if method == Method::Automatic {
                FINEST + NEIGHBOURS
            } else {
                FINEST + 2 * NEIGHBOURS
            };
            for half in COARSEST..=finest {
                let tolerance = 10_f64.powf(-0.5 * half as f64);
                let settings = Settings::new(method, tolerance, 1.0)
                    .with_absolute(&scaled(case.sizes, tolerance))
                    .with_max_steps(STEPS);
                let inputs = Inputs::Constant(&());
                let run = || roll_out(case.system, &settings, &case.times, inputs, case.initial);
                let Ok(rolled) = run() else { continue };
                let error = error(case, &rolled.states);
                let mut seconds = f64::INFINITY;
                for _ in 0..ROUNDS {
                    // As many as take a few milliseconds.
                    let (begin, mut count) = (thread_seconds(), 0);
                    while thread_seconds() - begin < 2e-3 {
                        std::hint::black_box(run().ok());
                        count += 1;
                    }
                    seconds = seconds.min((thread_seconds() - begin) / f64::from(count));
                }
                let statistics = &rolled.statistics;
                let (evaluations, jacobians, factorizations) = (
                    statistics.evaluations as f64,
                    statistics.jacobians as f64,
                    statistics.factorizations as f64,
                );
                let run = Run {
                    error,
                    work: evaluations
                        + (1.0 + directions / 2.0) * jacobians
                        + directions / 3.0 * factorizations,
                    seconds,
                };
                let switches = statistics.switches.len() - 1;
                if let Some(json) = &mut self.json {
                    let line = serde_json::json!({
                        "problem": name, "method": method.name(), "tolerance": tolerance, "error": error,
                        "weighted_evaluations": run.work, "seconds": seconds,
                        "steps": statistics.steps, "explicit_steps": statistics.explicit_steps,
                        "evaluations": statistics.evaluations, "jacobians": statistics.jacobians,
                        "factorizations": statistics.factorizations, "switches": switches,
                    });
                    writeln!(json, "{line}").unwrap();
                }
                println!(
                    "  {:9} {tolerance:7.0e}: error {error:7.1e}  work {:8.0}  {:8.1} µs  evaluations {evaluations:6}  Jacobians {jacobians:4}  LU {factorizations:4}  steps {:5} ({} explicit, {} tried again)  changes {switches}",
                    method.name(),
                    run.work,
                    1e6 * seconds,
                    statistics.steps,
                    statistics.explicit_steps,
                    statistics.rejected,
                );
                curve.push(run);
            }
            curves.push(curve);
        }
        let (work, time) = (
            ratios(&curves, |run| run.work),
            ratios(&curves, |run| run.seconds),
        );
        println!("  Automatic / better of Tsit5 and BDF at equal error:");
        for (what, ratios) in [("work", &work), ("time", &time)] {
            let list: Vec<String> = ratios.iter().map(|r| format!("{r:.2}")).collect();
            println!("    {what} {}", list.join(" "));
        }
        self.table
            .push((name.to_string(), summary(&work), summary(&time)));
    }
}

fn scaled(sizes: &[f64], tolerance: f64) -> Vec<f64> {
    sizes.iter().map(|s| s * tolerance).collect()
}

/// States of another method, much finer than the finest run.
fn references<S>(
    system: &S,
    initial: &[f64],
    times: &[f64],
    sizes: &[f64],
    reference: Reference,
) -> Vec<Vec<f64>>
where
    S: Differentiable<Input = ()>,
    S::Error: std::fmt::Debug,
{
    match reference {
        Reference::Fixed(substeps) => {
            let inputs = vec![(); times.len()];
            integrators::roll_out(system, Rk4::default(), times, &inputs, substeps, initial)
                .expect("reference")
        }
        Reference::Implicit => {
            let settings = Settings::new(Method::Esdirk34, 1e-12, 1.0)
                .with_absolute(&scaled(sizes, 1e-12))
                .with_max_steps(20_000_000);
            let rolled = roll_out(system, &settings, times, Inputs::Constant(&()), initial);
            rolled.expect("reference").states
        }
    }
}

/// Geometric mean and largest.
fn summary(ratios: &[f64]) -> [f64; 2] {
    let sum: f64 = ratios.iter().map(|ratio| ratio.ln()).sum();
    let worst = ratios.iter().copied().fold(0.0, f64::max);
    [f64::exp(sum / ratios.len() as f64), worst]
}

/// The runs with their errors averaged over neighbours on either side.
fn typical(curve: &[Run]) -> Vec<Run> {
    let mut typical = curve.to_vec();
    for (k, run) in typical.iter_mut().enumerate() {
        let near = &curve[k.saturating_sub(NEIGHBOURS)..(k + NEIGHBOURS + 1).min(curve.len())];
        let sum: f64 = near.iter().map(|run| run.error.ln()).sum();
        run.error = (sum / near.len() as f64).exp();
    }
    typical
}

/// Automatic against the better pure method, for each run of Automatic whose error is in the reach of one of them.
fn ratios(curves: &[Vec<Run>], cost: impl Fn(&Run) -> f64) -> Vec<f64> {
    let mut ratios = Vec::new();
    let curves: Vec<Vec<Run>> = curves.iter().map(|curve| typical(curve)).collect();
    let counted = curves[4].iter().take(1 + FINEST - COARSEST);
    for run in counted.filter(|run| run.error < LARGEST) {
        let better = [&curves[0], &curves[3]]
            .into_iter()
            .map(|curve| at_error(curve, run.error, &cost))
            .fold(f64::INFINITY, f64::min);
        if better.is_finite() {
            ratios.push(cost(run) / better);
        }
    }
    ratios
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

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let after = |flag: &str| {
        let place = arguments.iter().position(|a| a == flag)?;
        arguments.get(place + 1).cloned()
    };
    let mut bench = Bench {
        json: after("--json").map(|path| std::fs::File::create(path).unwrap()),
        only: after("--only"),
        table: Vec::new(),
    };
    problems::all(&mut bench);

    println!("\n| problem | work, mean | work, worst | time, mean | time, worst |");
    println!("|---|---|---|---|---|");
    for (name, work, time) in bench.table {
        println!(
            "| {name} | {:.2} | {:.2} | {:.2} | {:.2} |",
            work[0], work[1], time[0], time[1]
        );
    }
}
