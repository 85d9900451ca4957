//! The energy of systems without loss over a million steps, for every method of fixed step: the figure in the crate's documentation.
//!
//! `cargo run --release -p integrators --example energy` writes `docs/energy.svg` in the crate's folder and prints the largest errors of
//! the first and of the last tenth of the steps.

mod figure;

use std::error::Error;
use std::path::Path;

use figure::{Curve, Panel};
use integrators::problems::{Conservative, DoublePendulum, Kepler, Pendulum};
use integrators::{Heun, Method, Order, Rk4, StormerVerlet, SymplecticEuler, Variational};

const STEPS: usize = 1_000_000;
/// Points of a curve in a decade of steps.
const POINTS: f64 = 10.0;

/// Largest |E − E₀| / |E₀| between one point and the next.
fn curve<P: Conservative>(problem: &P, name: &str, mut method: impl Method<P>, h: f64) -> Curve {
    let mut x = problem.initial();
    let start = problem.energy(&x);
    let (mut points, mut largest, mut tenths) = (Vec::new(), 0.0_f64, [0.0_f64; 10]);
    let mut next = 1.0_f64;
    for step in 1..=STEPS {
        if let Err(error) = method.step(problem, 0.0, h, &(), &mut (), &mut x) {
            println!("{name}, step {step}: {error}");
            break;
        }
        let off = ((problem.energy(&x) - start) / start).abs();
        if off.is_nan() || off >= 1.0 {
            println!("{name} has lost its energy after {step} steps");
            break;
        }
        largest = largest.max(off);
        let tenth = &mut tenths[(step - 1) * 10 / STEPS];
        *tenth = tenth.max(off);
        if step as f64 >= next {
            points.push((step as f64, largest));
            largest = 0.0;
            next = (next * 10_f64.powf(1.0 / POINTS)).max(step as f64 + 0.5);
        }
    }
    println!(
        "{:16} {name:18} h = {h}: {:.3e} in the first tenth, {:.3e} in the last",
        problem.name(),
        tenths[0],
        tenths[9]
    );
    Curve {
        name: name.into(),
        points,
    }
}

fn panel<P: Conservative>(problem: &P, title: &str, h: f64) -> Panel {
    let mut curves = vec![
        curve(problem, "Heun", Heun::default(), h),
        curve(problem, "RK4", Rk4::default(), h),
    ];
    if let Ok(method) = SymplecticEuler::new(problem) {
        curves.push(curve(problem, "symplectic Euler", method, h));
    }
    if let Ok(method) = StormerVerlet::new(problem) {
        curves.push(curve(problem, "Störmer-Verlet", method, h));
    }
    for (name, order) in [
        ("variational", Order::Two),
        ("variational, order 4", Order::Four),
    ] {
        curves.push(curve(problem, name, Variational::new(problem, order), h));
    }
    Panel {
        title: title.into(),
        x: "steps".into(),
        y: "|E − E₀| / |E₀|".into(),
        curves,
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let pendulum = Pendulum {
        frequency: 1.0,
        amplitude: std::f64::consts::FRAC_PI_2,
    };
    let panels = [
        panel(&pendulum, "Pendulum, 90°, h = 0.1 (period 7.4)", 0.1),
        panel(
            &Kepler { eccentricity: 0.3 },
            "Kepler, e = 0.3, h = 0.05 (period 6.3)",
            0.05,
        ),
        panel(
            &DoublePendulum::default(),
            "Double pendulum, chaotic, h = 0.01 s",
            0.01,
        ),
    ];
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/energy.svg");
    figure::write(&path, &panels, 3)?;
    println!("{}", path.display());
    Ok(())
}
