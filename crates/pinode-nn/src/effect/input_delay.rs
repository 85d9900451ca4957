//! Input delay: u(t) → u(t − T).
//!
//! T in s, not a whole number of samples in general. Every integration step gets the mean of the delayed input over the step,
//!
//! ū = [U(b − T) − U(a − T)] / (b − a),  U(t) = ∫ u dt,
//!
//! which is exact for the impulse over the step and has the derivative ∂ū/∂T = [u(a − T) − u(b − T)] / (b − a). Steps that adapt end
//! where u(t − T) jumps instead. Before the recording starts the input is taken as its first value.

use super::{Action, DriveLaw, Family, Grid, Kind, ParameterSpec, Probe, Quantity, Signal};

struct Delay;

/// U and u of a signal that is constant over the steps of a grid.
struct Integral<'a> {
    bounds: &'a [f64],
    value: &'a [f64],
    cumulated: Vec<f64>,
}

impl<'a> Integral<'a> {
    fn new(grid: &'a Grid, value: &'a [f64]) -> Self {
        let mut cumulated = Vec::with_capacity(grid.bounds.len());
        let mut sum = 0.0;
        cumulated.push(sum);
        for (pair, u) in grid.bounds.windows(2).zip(value) {
            sum += (pair[1] - pair[0]) * u;
            cumulated.push(sum);
        }
        Integral {
            bounds: &grid.bounds,
            value,
            cumulated,
        }
    }

    /// (U(t), u(t)); `cursor` is the step of the last call, from which the search goes on.
    fn at(&self, t: f64, cursor: &mut usize) -> (f64, f64) {
        let start = self.bounds[0];
        if t < start {
            let first = self.value[0];
            return (first * (t - start), first);
        }
        while *cursor + 1 < self.value.len() && self.bounds[*cursor + 1] <= t {
            *cursor += 1;
        }
        let u = self.value[*cursor];
        (self.cumulated[*cursor] + u * (t - self.bounds[*cursor]), u)
    }
}

/// Means of the delayed signal over the steps; with `slope`, their derivative in the delay as well.
fn delayed(grid: &Grid, value: &[f64], delay: f64, mut slope: Option<&mut Vec<f64>>) -> Vec<f64> {
    let integral = Integral::new(grid, value);
    let mut cursor = 0;
    let mut out = Vec::with_capacity(value.len());
    let mut from = integral.at(grid.bounds[0] - delay, &mut cursor);
    for pair in grid.bounds.windows(2) {
        let to = integral.at(pair[1] - delay, &mut cursor);
        let width = pair[1] - pair[0];
        out.push((to.0 - from.0) / width);
        if let Some(slope) = slope.as_deref_mut() {
            slope.push((from.1 - to.1) / width);
        }
        from = to;
    }
    out
}

impl DriveLaw for Delay {
    fn pass(&self, grid: &Grid, p: &[f64], first: Option<usize>, signal: &mut Signal) {
        if signal.value.is_empty() {
            return;
        }
        for (_, derivative) in &mut signal.by_parameter {
            *derivative = delayed(grid, derivative, p[0], None);
        }
        match first {
            Some(index) => {
                let mut slope = Vec::with_capacity(signal.value.len());
                signal.value = delayed(grid, &signal.value, p[0], Some(&mut slope));
                signal.by_parameter.push((index, slope));
            }
            None => signal.value = delayed(grid, &signal.value, p[0], None),
        }
    }

    fn delay(&self, p: &[f64]) -> Option<f64> {
        p.first().copied()
    }
}

/// The kind `input_delay`.
pub static KIND: Kind = Kind {
    name: "input_delay",
    family: Family::Drive,
    summary: "the input acts later than it is logged",
    parameters: &[ParameterSpec::new("delay", Quantity::Time, (0.0, 0.3), 0.0)],
    action: Action::Drive(&Delay),
    contains: &[],
    probes: |scales, _| {
        [0.005, 0.02, 0.045]
            .map(|delay| Probe {
                neutral: vec![0.0],
                perturbed: vec![delay * scales.pace],
            })
            .to_vec()
    },
};
