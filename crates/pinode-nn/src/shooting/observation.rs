//! What was measured, as the fit sees it.

use std::f64::consts::PI;

/// A measured quantity: a position, or a velocity measured on its own.
#[derive(Debug, Clone, PartialEq)]
pub struct Channel {
    /// The coordinate.
    pub coordinate: usize,
    /// Whether it is the coordinate's velocity rather than its position.
    pub velocity: bool,
    /// Whether differences are taken on the circle.
    pub wraps: bool,
    /// Standard deviation of the sensor's noise, from the log alone; m, rad, m/s or rad/s.
    pub noise: f64,
}

impl Channel {
    /// Index in the state (q, v) of a mechanism with `nv` coordinates.
    pub fn state(&self, nv: usize) -> usize {
        self.coordinate + if self.velocity { nv } else { 0 }
    }

    /// Measured less simulated, on the circle for an angle.
    pub fn difference(&self, measured: f64, simulated: f64) -> f64 {
        let d = measured - simulated;
        if self.wraps { wrap_angle(d) } else { d }
    }
}

/// The angle in [−π, π) that differs from `x` by whole turns.
pub fn wrap_angle(x: f64) -> f64 {
    (x + PI).rem_euclid(2.0 * PI) - PI
}

/// One recording.
#[derive(Debug, Clone, PartialEq)]
pub struct ObservedRun {
    /// Sample times, s.
    pub t: Vec<f64>,
    /// Inputs, one column each.
    pub u: Vec<Vec<f64>>,
    /// Measurements, one column a channel.
    pub y: Vec<Vec<f64>>,
    /// Whether each measurement counts; false: masked as an outlier or a fault.
    pub valid: Vec<Vec<bool>>,
}

/// All that was measured: the same channels in every recording. The first channels are the positions, in order.
#[derive(Debug, Clone, PartialEq)]
pub struct Observations {
    /// What was measured.
    pub channels: Vec<Channel>,
    /// The recordings.
    pub runs: Vec<ObservedRun>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_differ_on_the_circle() {
        assert!((wrap_angle(2.0 * PI + 0.1) - 0.1).abs() < 1e-12);
        assert!((wrap_angle(-2.0 * PI - 0.1) + 0.1).abs() < 1e-12);
        assert_eq!(wrap_angle(PI), -PI);
    }
}
