//! Error against work: the figures in the crate's documentation.
//!
//! `cargo run --release -p integrators --example work_precision` steps problems with known solutions by every method of fixed step and
//! writes `docs/work_precision_fixed.svg` in the crate's folder. An evaluation is one of the rate, of the acceleration, or of an iteration
//! of the variational method (momentum, force and velocity). The error is the largest component of the motion from the exact state.
//!
//! With `-- FILE`, the lines that `cargo bench -p integrators --features adaptive --bench adaptive_work_precision -- --json FILE` writes
//! become `docs/work_precision_adaptive.svg` instead (six of its problems stand there now): the largest error at fifty times against evaluations, where a
//! Jacobian of n directions counts as 1 + n/2 of them and a factorisation as n/3.

mod figure;

#[path = "../tests/counted/mod.rs"]
mod counted;

use std::error::Error;
use std::path::Path;

use counted::Counted;
use figure::{Curve, Panel};
use integrators::problems::{DoublePendulum, Kepler, Pendulum, Problem};
use integrators::{
    Heun, Mechanical, Method, Order, Rk4, Space, StormerVerlet, SymplecticEuler, System,
    Variational,
};

/// Numbers of steps to the end, each twice the one before.
const FEWEST: usize = 16;
const DOUBLINGS: u32 = 13;
/// No curve goes on below this error, where rounding begins.
const LEAST: f64 = 1e-12;

/// Evaluations and error for one number of steps, if they can be made.
fn run<P: Problem + Mechanical + Copy, M: Method<Counted<P>>>(
    problem: P,
    method: &impl Fn(&Counted<P>) -> Option<M>,
    steps: usize,
) -> Option<(f64, f64)> {
    let counted = Counted::new(problem);
    let mut method = method(&counted)?;
    let end = problem.span();
    let h = end / steps as f64;
    let mut x = problem.initial();
    for step in 0..steps {
        let t = step as f64 * h;
        method.step(&counted, t, h, &(), &mut (), &mut x).ok()?;
    }
    let mut motion = vec![0.0; counted.space().tangent_dim()];
    counted
        .space()
        .difference_into(&problem.solution(end)?, &x, &mut motion);
    let error = motion
        .iter()
        .fold(0.0_f64, |largest, d| largest.max(d.abs()));
    error
        .is_finite()
        .then_some((counted.evaluations() as f64, error))
}

fn curve<P: Problem + Mechanical + Copy, M: Method<Counted<P>>>(
    problem: P,
    name: &str,
    method: impl Fn(&Counted<P>) -> Option<M>,
) -> Option<Curve> {
    let mut points = Vec::new();
    for doubling in 0..=DOUBLINGS {
        let Some(point) = run(problem, &method, FEWEST << doubling) else {
            continue;
        };
        // Far off is no point of a curve.
        if point.1 < 1.0 {
            points.push(point);
        }
        if point.1 < LEAST {
            break;
        }
    }
    for (work, error) in &points {
        println!(
            "{:16} {name:21} {work:9.0} evaluations, error {error:.2e}",
            problem.name()
        );
    }
    let name = name.into();
    (!points.is_empty()).then_some(Curve { name, points })
}

fn panel<P: Problem + Mechanical + Copy>(problem: P, title: &str) -> Panel {
    let curves = [
        curve(problem, "Heun", |_| Some(Heun::default())),
        curve(problem, "RK4", |_| Some(Rk4::default())),
        curve(problem, "symplectic Euler", |p| {
            SymplecticEuler::new(p).ok()
        }),
        curve(problem, "Störmer-Verlet", |p| StormerVerlet::new(p).ok()),
        curve(problem, "variational", |p| {
            Some(Variational::new(p, Order::Two))
        }),
        curve(problem, "variational, order 4", |p| {
            Some(Variational::new(p, Order::Four))
        }),
    ];
    Panel {
        title: title.into(),
        x: "evaluations".into(),
        y: "error".into(),
        curves: curves.into_iter().flatten().collect(),
    }
}

/// Panels of the lines of a file of runs, a problem each.
fn panels_of(lines: &str) -> Result<Vec<Panel>, Box<dyn Error>> {
    let mut panels: Vec<Panel> = Vec::new();
    for line in lines.lines() {
        let run: serde_json::Value = serde_json::from_str(line)?;
        let text = |key: &str| {
            let value = run.get(key).and_then(|value| value.as_str());
            value.ok_or_else(|| format!("no text {key:?} in {line}"))
        };
        let number = |key: &str| {
            let value = run.get(key).and_then(|value| value.as_f64());
            value.ok_or_else(|| format!("no number {key:?} in {line}"))
        };
        let (title, name) = (text("problem")?, text("method")?);
        let point = (number("weighted_evaluations")?, number("error")?);
        if panels.last().is_none_or(|panel| panel.title != title) {
            panels.push(Panel {
                title: title.into(),
                x: "evaluations".into(),
                y: "error".into(),
                curves: Vec::new(),
            });
        }
        if let Some(panel) = panels.last_mut() {
            match panel.curves.iter_mut().find(|curve| curve.name == name) {
                Some(curve) => curve.points.push(point),
                None => panel.curves.push(Curve {
                    name: name.into(),
                    points: vec![point],
                }),
            }
        }
    }
    Ok(panels)
}

fn main() -> Result<(), Box<dyn Error>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs");
    let path = if let Some(file) = std::env::args().nth(1) {
        let path = folder.join("work_precision_adaptive.svg");
        figure::write(&path, &panels_of(&std::fs::read_to_string(file)?)?, 3)?;
        path
    } else {
        let pendulum = Pendulum {
            frequency: 1.0,
            amplitude: std::f64::consts::FRAC_PI_2,
        };
        let panels = [
            panel(pendulum, "Pendulum, 90°, 0.77 periods"),
            panel(
                Kepler { eccentricity: 0.3 },
                "Kepler, e = 0.3, 0.77 periods",
            ),
            panel(DoublePendulum::default(), "Double pendulum, 3 s"),
        ];
        let path = folder.join("work_precision_fixed.svg");
        figure::write(&path, &panels, 3)?;
        path
    };
    println!("{}", path.display());
    Ok(())
}
