//! Actuator lag: τ ẏ = u − y, and y arrives instead of u.
//!
//! τ in s. Over each integration step of length h, where u is constant, y goes from y₀ to u + (y₀ − u) e^(−h/τ); the step gets the mean,
//!
//! ȳ = u + (y₀ − u) τ/h (1 − e^(−h/τ)),
//!
//! which is exact for the impulse. The recording starts with y at the first u. A delay of τ looks much the same where the input is slow.

use super::{Action, DriveLaw, Family, Grid, Kind, ParameterSpec, Probe, Quantity, Signal};

struct Lag;

/// e^(−x) and (1 − e^(−x))/x, and their derivatives, for x > 0.
fn decay(x: f64) -> (f64, f64, f64, f64) {
    let e = (-x).exp();
    let mean = -(-x).exp_m1() / x;
    (e, mean, -e, (e - mean) / x)
}

/// The mean over each step of the lagged signal; with `slope`, their derivatives in τ as well.
fn lagged(grid: &Grid, value: &[f64], tau: f64, mut slope: Option<&mut Vec<f64>>) -> Vec<f64> {
    let Some(&start) = value.first() else {
        return Vec::new();
    };
    let (mut y, mut dy) = (start, 0.0);
    let steps = grid.bounds.windows(2).zip(value);
    steps
        .map(|(pair, &u)| {
            let h = pair[1] - pair[0];
            let x = h / tau;
            let (e, mean, by_e, by_mean) = decay(x);
            let by_tau = -x / tau;
            let out = u + (y - u) * mean;
            if let Some(slope) = slope.as_deref_mut() {
                slope.push(dy * mean + (y - u) * by_mean * by_tau);
            }
            dy = dy * e + (y - u) * by_e * by_tau;
            y = u + (y - u) * e;
            out
        })
        .collect()
}

impl DriveLaw for Lag {
    fn remembers(&self) -> bool {
        true
    }

    /// e^(−37) < 10⁻¹⁶.
    fn past(&self, p: &[f64]) -> Option<f64> {
        p.first().map(|tau| 37.0 * tau)
    }

    fn pass(&self, grid: &Grid, p: &[f64], first: Option<usize>, signal: &mut Signal) {
        // Below this the lag is over within a rounding error of any step.
        let tau = p[0].max(1e-9);
        for (_, derivative) in &mut signal.by_parameter {
            *derivative = lagged(grid, derivative, tau, None);
        }
        match first {
            Some(index) => {
                let mut slope = Vec::with_capacity(signal.value.len());
                signal.value = lagged(grid, &signal.value, tau, Some(&mut slope));
                signal.by_parameter.push((index, slope));
            }
            None => signal.value = lagged(grid, &signal.value, tau, None),
        }
    }
}

/// The kind `actuator_lag`.
pub static KIND: Kind = Kind {
    name: "actuator_lag",
    family: Family::Drive,
    summary: "the input acts with a lag of first order",
    parameters: &[ParameterSpec::new(
        "time_constant",
        Quantity::Time,
        (0.0, 2.0),
        0.0,
    )],
    action: Action::Drive(&Lag),
    contains: &[],
    probes: |scales, _| {
        [0.005, 0.025, 0.06]
            .map(|tau| Probe {
                neutral: vec![0.0],
                perturbed: vec![tau * scales.pace],
            })
            .to_vec()
    },
};
