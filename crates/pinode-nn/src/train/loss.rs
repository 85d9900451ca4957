//! How far a roll-out is from what was measured.

use lagrange::{Coordinate, LANES};

use crate::entries::Start;
use crate::hybrid::Lane;
use crate::learnt::SinCos;
use crate::processor::Processor;
use crate::shooting::wrap_angle;

/// What was measured in one recording.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Target {
    /// Positions as they were read, one column a coordinate, m or rad.
    pub read: Vec<Vec<f64>>,
    /// Velocities as they were read, one column a coordinate, m/s or rad/s; empty where there is none.
    pub read_v: Vec<Vec<f64>>,
    /// What is behind these readings.
    pub q: Vec<Vec<f64>>,
    /// The same of the velocities.
    pub v: Vec<Vec<f64>>,
    /// Which positions and which velocities count: the others are no readings of what they stand for.
    pub valid: [Vec<Vec<bool>>; 2],
}

/// κ of a [robust](Loss::far) loss is at least this, in squares of the sensors' noise: ten deviations. Less, and a network would give up what is rare.
pub(super) const FAR: f64 = 100.0;

/// Σ_c λ_c (q_c − q′_c)² + μ_c (v_c − v′_c)² over the samples of a window; of an angle that wraps, (cos q − cos q′)² + (sin q − sin q′)² takes the
/// place of the first square (Roehrl et al. 2020, eq. 11).
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Loss {
    channels: Vec<Channel>,
    /// The first sample that counts: 1 where windows start from what was measured, 0 where their start is free.
    pub first: usize,
    /// κ, where a window counts n κ ln(1 + S/(n κ)), S its sum over n samples, instead of S: farther from the measurements, as chaos takes it, it
    /// counts little more, and does not own the sum.
    pub far: Option<f64>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Channel {
    /// Where it is in a state.
    q: usize,
    v: usize,
    wraps: bool,
    /// λ and μ.
    position: f64,
    velocity: f64,
}

impl Loss {
    /// `weights` has λ and μ of every coordinate; `starts` their places, q before v.
    pub fn new(
        coordinates: &[Coordinate],
        starts: &[Start],
        nq: usize,
        weights: &[[f64; 2]],
        first: usize,
        far: Option<f64>,
    ) -> Self {
        let channel = |((coordinate, start), weight): ((&Coordinate, &Start), &[f64; 2])| Channel {
            q: start.q,
            v: nq + start.v,
            wraps: coordinate.wraps,
            position: weight[0],
            velocity: weight[1],
        };
        let channels = coordinates.iter().zip(starts).zip(weights);
        Loss {
            channels: channels.map(channel).collect(),
            first,
            far,
        }
    }

    /// What a window counts with the sum `s` over `n` samples, and the derivative of that in `s`.
    pub fn of_window(&self, s: f64, n: f64) -> (f64, f64) {
        match self.far {
            Some(kappa) => {
                let far = s / (n * kappa);
                (n * kappa * far.ln_1p(), 1.0 / (1.0 + far))
            }
            None => (s, 1.0),
        }
    }

    /// The sum at one sample of a window that has this derivative, see [`of_window`](Self::of_window).
    pub fn distance(&self, slope: f64) -> f64 {
        self.far
            .map_or(f64::NAN, |kappa| kappa * (1.0 / slope - 1.0))
    }

    /// The typical sum at one sample where windows count `mean` a sample.
    pub fn typical(&self, mean: f64) -> f64 {
        match self.far {
            Some(kappa) => kappa * (mean / kappa).exp_m1(),
            None => mean,
        }
    }

    /// Every part of the loss at one sample of a recording, of the state with these entries: to `each` the entry, the weight and the measured number
    /// less that of the state, on the circle for an angle that wraps.
    pub fn residuals(
        &self,
        target: &Target,
        sample: usize,
        state: impl Fn(usize) -> f64,
        mut each: impl FnMut(usize, f64, f64),
    ) {
        for (c, channel) in self.channels.iter().enumerate() {
            if channel.position > 0.0 && target.valid[0][c][sample] {
                let d = target.q[c][sample] - state(channel.q);
                let d = if channel.wraps { wrap_angle(d) } else { d };
                each(channel.q, channel.position, d);
            }
            if channel.velocity > 0.0 && target.valid[1][c][sample] {
                let d = target.v[c][sample] - state(channel.v);
                each(channel.v, channel.velocity, d);
            }
        }
    }

    /// Adds the loss of eight states with these entries to `sums`, each at its sample of a recording.
    #[inline(always)]
    pub fn add_eight(&self, processor: Processor, at: &Measured<'_>, x: &[Lane], sums: &mut Lane) {
        for (c, channel) in self.channels.iter().enumerate() {
            if channel.position > 0.0 {
                let mut d = at.residuals(0, c, &x[channel.q]);
                if channel.wraps {
                    d.iter_mut().for_each(|d| *d *= 0.5);
                    let [sin, _] = processor.run(SinCos(&d));
                    d = sin.map(|sin| 2.0 * sin);
                }
                add_squares(sums, channel.position, &d);
            }
            if channel.velocity > 0.0 {
                let d = at.residuals(1, c, &x[channel.v]);
                add_squares(sums, channel.velocity, &d);
            }
        }
    }

    /// Adds `factors` times its derivatives to `lambda`.
    #[inline(always)]
    pub fn add_gradient_of_eight(
        &self,
        processor: Processor,
        at: &Measured<'_>,
        x: &[Lane],
        factors: &Lane,
        lambda: &mut [Lane],
    ) {
        for (c, channel) in self.channels.iter().enumerate() {
            if channel.position > 0.0 {
                let mut d = at.residuals(0, c, &x[channel.q]);
                if channel.wraps {
                    [d, _] = processor.run(SinCos(&d));
                }
                add_slopes(&mut lambda[channel.q], channel.position, factors, &d);
            }
            if channel.velocity > 0.0 {
                let d = at.residuals(1, c, &x[channel.v]);
                add_slopes(&mut lambda[channel.v], channel.velocity, factors, &d);
            }
        }
    }

    /// The weight of every part of the loss in eight states, each at its sample: to `each` with the entry of the state; 0 where it does not count.
    #[inline(always)]
    pub fn weights_of_eight(&self, at: &Measured<'_>, mut each: impl FnMut(usize, &Lane)) {
        for (c, channel) in self.channels.iter().enumerate() {
            let parts = [(channel.q, channel.position), (channel.v, channel.velocity)];
            for (of, (entry, weight)) in parts.into_iter().enumerate() {
                if weight > 0.0 {
                    let counts = |lane: usize| at.targets[lane].valid[of][c][at.samples[lane]];
                    let of_lane = |lane| if counts(lane) { weight } else { 0.0 };
                    each(entry, &std::array::from_fn(of_lane));
                }
            }
        }
    }

    /// The loss at one sample of a recording, of the state with these entries.
    #[cfg(test)]
    pub fn at(&self, target: &Target, sample: usize, state: impl Fn(usize) -> f64) -> f64 {
        let mut sum = 0.0;
        self.residuals(target, sample, state, |i, weight, d| {
            sum += weight
                * match self.wraps(i) {
                    // (cos a − cos b)² + (sin a − sin b)² = 2 − 2 cos(a − b) = 4 sin²((a − b)/2).
                    true => 4.0 * (0.5 * d).sin().powi(2),
                    false => d * d,
                };
        });
        sum
    }

    /// Its derivatives, each to `add` with the entry of the state.
    #[cfg(test)]
    pub fn gradient(
        &self,
        target: &Target,
        sample: usize,
        state: impl Fn(usize) -> f64,
        mut add: impl FnMut(usize, f64),
    ) {
        self.residuals(target, sample, state, |i, weight, d| {
            let slope = if self.wraps(i) { d.sin() } else { d };
            add(i, -2.0 * weight * slope);
        });
    }

    /// Whether this entry of a state is an angle that wraps.
    #[cfg(test)]
    fn wraps(&self, i: usize) -> bool {
        self.channels.iter().any(|c| c.wraps && c.q == i)
    }
}

/// What was measured at eight samples.
pub(crate) struct Measured<'a> {
    /// One a state.
    pub targets: [&'a Target; LANES],
    /// One a state.
    pub samples: [usize; LANES],
}

impl Measured<'_> {
    /// The measured position (`of` 0) or velocity (1) of coordinate `c` less x; 0 where it does not count.
    #[inline(always)]
    fn residuals(&self, of: usize, c: usize, x: &Lane) -> Lane {
        std::array::from_fn(|lane| {
            let (target, sample) = (self.targets[lane], self.samples[lane]);
            let columns = if of == 0 { &target.q } else { &target.v };
            match target.valid[of][c][sample] {
                true => columns[c][sample] - x[lane],
                false => 0.0,
            }
        })
    }
}

/// sums += weight d².
#[inline(always)]
fn add_squares(sums: &mut Lane, weight: f64, d: &Lane) {
    for (sum, d) in sums.iter_mut().zip(d) {
        *sum += weight * d * d;
    }
}

/// to −= 2 weight factor slope.
#[inline(always)]
fn add_slopes(to: &mut Lane, weight: f64, factors: &Lane, slopes: &Lane) {
    for ((to, factor), slope) in to.iter_mut().zip(factors).zip(slopes) {
        *to -= 2.0 * weight * factor * slope;
    }
}
