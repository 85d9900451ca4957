//! When the rows of a log are taken, and what is lost of them on the way to the file.
//!
//! A busy computer that reads the sensors, sets the input and writes the log does not do so evenly: rows come early or late, some
//! are never written, and numbers are written with few decimals. Stamps are true. The input changes when a row is taken, written or not.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use super::scene::random;
use super::{Recording, Run, stream};
use crate::config::Range;

/// Instants in an interval at which a row may be taken.
const TICKS: u32 = 32;

/// A logger that is not even.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sampling {
    /// A row is early or late by this share of an interval at most; 0.45 and above are the same.
    pub jitter: f64,
    /// Share of the rows that are not written.
    pub lost: f64,
    /// Decimals of the stamps, s.
    pub time_decimals: i32,
    /// Decimals of positions and velocities.
    pub decimals: i32,
}

impl Sampling {
    /// What a log of 50 Hz may suffer.
    pub fn draw(seed: u64) -> Self {
        let mut rng = random(seed, 5);
        let mut size = |[from, to]: Range| rng.random_range(from..=to);
        let (jitter, lost) = (size([0.0, 0.3]), size([0.0, 0.02]));
        Sampling {
            jitter,
            lost,
            time_decimals: rng.random_range(3..=6),
            decimals: rng.random_range(4..=6),
        }
    }

    /// Rounds what is written.
    pub(super) fn round(&self, recording: &mut Recording) {
        let to = |decimals: i32| {
            let unit = 10f64.powi(decimals);
            move |value: &mut f64| *value = (*value * unit).round() / unit
        };
        recording.t.iter_mut().for_each(to(self.time_decimals));
        let [x, phi] = &mut recording.q;
        let [x_dot, phi_dot] = &mut recording.v;
        for column in [x, phi, x_dot, phi_dot] {
            column.iter_mut().for_each(to(self.decimals));
        }
    }

    /// The tick of the row, and whether it is written. The first row is on time and written.
    fn take(&self, row: usize, rng: &mut ChaCha8Rng) -> (u64, bool) {
        let late = rng.random_range(-1.0..=1.0) * self.jitter.clamp(0.0, 0.45);
        let lost = rng.random::<f64>() < self.lost;
        match row {
            0 => (0, true),
            _ => (
                ((row as f64 + late) * f64::from(TICKS)).round() as u64,
                !lost,
            ),
        }
    }
}

/// When a row is taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Row {
    /// s.
    pub time: f64,
    /// Ticks of the bench until the next row.
    pub ticks: u64,
    /// It is in the log.
    pub written: bool,
}

impl Run<'_> {
    /// Length of an interval of the bench, s.
    pub(super) fn tick(&self) -> f64 {
        let rows = 1.0 / self.rate;
        self.sampling.map_or(rows, |_| rows / f64::from(TICKS))
    }

    /// The rows of the recording.
    pub(super) fn clock(&self) -> Vec<Row> {
        let Some(sampling) = self.sampling else {
            let even = |k: usize| Row {
                time: k as f64 / self.rate,
                ticks: 1,
                written: true,
            };
            return (0..self.rows).map(even).collect();
        };
        let mut rng = self.random(stream::CLOCK);
        let taken: Vec<(u64, bool)> = (0..=self.rows)
            .map(|row| sampling.take(row, &mut rng))
            .collect();
        let between = taken.iter().zip(taken.iter().skip(1));
        between
            .map(|(&(tick, written), &(next, _))| Row {
                time: tick as f64 * self.tick(),
                ticks: next.saturating_sub(tick),
                written,
            })
            .collect()
    }
}
