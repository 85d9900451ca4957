//! Energy over a million steps where nothing is lost; over fewer where steps cost more. Of these `examples/energy.rs` takes the two pendulums to
//! the million; the heavy top goes 100,000 steps here and nowhere further.

use integrators::problems::{Conservative, DoublePendulum, HeavyTop, Kepler, Pendulum};
use integrators::{
    Heun, Method, NotSeparable, Order, Rk4, StormerVerlet, SymplecticEuler, Variational,
};

/// 90°, with a period of 7.4 s.
const PENDULUM: Pendulum = Pendulum {
    frequency: 1.0,
    amplitude: std::f64::consts::FRAC_PI_2,
};
const KEPLER: Kepler = Kepler { eccentricity: 0.3 };

/// Largest |E − E₀| in each tenth of a run, relative to E₀.
fn tenths<P: Conservative>(
    problem: &P,
    mut method: impl Method<P>,
    h: f64,
    steps: usize,
) -> [f64; 10] {
    let mut x = problem.initial();
    let start = problem.energy(&x);
    [0; 10].map(|_| {
        let mut largest = 0.0_f64;
        for _ in 0..steps / 10 {
            if let Err(error) = method.step(problem, 0.0, h, &(), &mut (), &mut x) {
                panic!("{}: {error}", problem.name());
            }
            let change = (problem.energy(&x) - start).abs();
            assert!(change.is_finite(), "{} diverged", problem.name());
            largest = largest.max(change);
        }
        largest / start.abs()
    })
}

const MILLION: usize = 1_000_000;

/// The last tenth may exceed the first by a part in twenty, for the phases that it happens to see; in chaos, where the largest value is
/// one of rare states, the largest of those before it. Energy that is lost steadily makes the last tenth a ninth larger than that.
fn is_bounded<P: Conservative>(
    problem: &P,
    name: &str,
    method: impl Method<P>,
    h: f64,
    steps: usize,
) {
    let tenths = tenths(problem, method, h, steps);
    eprintln!(
        "{name:18} {:16} h = {h}: {:.3e} in the first tenth of {steps} steps, {:.3e} in the last",
        problem.name(),
        tenths[0],
        tenths[9]
    );
    let before = if problem.name() == "double pendulum" {
        tenths[..9].iter().copied().fold(0.0, f64::max)
    } else {
        tenths[0]
    };
    assert!(
        tenths[9] < 1.05 * before,
        "{name} on the {}: {tenths:?}",
        problem.name()
    );
}

#[test]
fn explicit_symplectic_methods_keep_the_energy_near_its_value_over_a_million_steps()
-> Result<(), NotSeparable> {
    let euler = SymplecticEuler::new(&PENDULUM)?;
    is_bounded(&PENDULUM, "symplectic Euler", euler, 0.1, MILLION);
    let verlet = StormerVerlet::new(&PENDULUM)?;
    is_bounded(&PENDULUM, "Störmer-Verlet", verlet, 0.1, MILLION);
    let euler = SymplecticEuler::new(&KEPLER)?;
    is_bounded(&KEPLER, "symplectic Euler", euler, 0.02, MILLION);
    let verlet = StormerVerlet::new(&KEPLER)?;
    is_bounded(&KEPLER, "Störmer-Verlet", verlet, 0.05, MILLION);
    Ok(())
}

#[test]
fn the_variational_integrator_keeps_the_energy_near_its_value_over_a_million_steps() {
    let method = Variational::new(&PENDULUM, Order::Two);
    is_bounded(&PENDULUM, "variational", method, 0.1, MILLION);
    let method = Variational::new(&KEPLER, Order::Two);
    is_bounded(&KEPLER, "variational", method, 0.05, MILLION);
}

#[test]
fn the_variational_integrator_of_order_4_keeps_the_energy_near_its_value() {
    let method = Variational::new(&PENDULUM, Order::Four);
    is_bounded(&PENDULUM, "variational, 4", method, 0.2, MILLION / 5);
}

#[test]
fn the_energy_of_a_chaotic_double_pendulum_stays_near_its_value() {
    let double = DoublePendulum::default();
    let method = Variational::new(&double, Order::Two);
    is_bounded(&double, "variational", method, 0.005, MILLION / 5);
}

#[test]
fn the_energy_of_a_spinning_top_stays_near_its_value() {
    let top = HeavyTop::default();
    let method = Variational::new(&top, Order::Two);
    is_bounded(&top, "variational", method, 0.02, MILLION / 10);
}

#[test]
fn runge_kutta_methods_lose_energy_step_by_step() {
    let rk4 = tenths(&PENDULUM, Rk4::default(), 0.1, MILLION);
    eprintln!("RK4 on the pendulum: {rk4:?}");
    assert!(rk4[9] > 8.0 * rk4[0], "{rk4:?}");
    let rk4 = tenths(&KEPLER, Rk4::default(), 0.05, MILLION);
    eprintln!("RK4 on Kepler: {rk4:?}");
    assert!(rk4[9] > 8.0 * rk4[0], "{rk4:?}");
    let heun = tenths(&PENDULUM, Heun::default(), 0.005, MILLION);
    eprintln!("Heun on the pendulum: {heun:?}");
    assert!(heun[9] > 8.0 * heun[0], "{heun:?}");
}

/// (E − E₀)/E₀ a second after 50 periods.
fn drift<P: Conservative>(problem: &P, mut method: impl Method<P>, period: f64, h: f64) -> f64 {
    let time = 50.0 * period;
    let steps = (time / h).round();
    let h = time / steps;
    let mut x = problem.initial();
    let start = problem.energy(&x);
    for _ in 0..steps as usize {
        if let Err(error) = method.step(problem, 0.0, h, &(), &mut (), &mut x) {
            panic!("{}: {error}", problem.name());
        }
    }
    (problem.energy(&x) - start) / start.abs() / time
}

#[test]
fn the_drift_of_rk4_in_a_given_time_falls_with_the_fifth_power_of_the_step() {
    let orders = [
        [0.1, 0.05, 0.025].map(|h| drift(&PENDULUM, Rk4::default(), PENDULUM.period(), h)),
        [0.04, 0.02, 0.01].map(|h| drift(&KEPLER, Rk4::default(), std::f64::consts::TAU, h)),
    ]
    .map(|drift| {
        eprintln!("RK4 loses {drift:?} of the energy a second");
        [drift[0] / drift[1], drift[1] / drift[2]].map(f64::log2)
    });
    eprintln!("orders {orders:.3?}");
    for order in orders {
        assert!((order[1] - 5.0).abs() < 0.15, "{orders:?}");
    }
    let heun = [0.02, 0.01, 0.005].map(|h| drift(&PENDULUM, Heun::default(), PENDULUM.period(), h));
    let order = (heun[1] / heun[2]).log2();
    eprintln!("Heun: {heun:?}, order {order:.3}");
    assert!((order - 3.0).abs() < 0.15, "{order}");
}
