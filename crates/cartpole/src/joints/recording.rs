//! The log of such a rig.

use std::fmt::Write;
use std::path::Path;

use crate::rig::{Error, write_whole};

/// Row k: what was measured at t_k, and the inputs held over [t_k, t_{k+1}). Velocities are not measured, but may be written as differences.
#[derive(Debug, Clone, PartialEq)]
pub struct Recording {
    joints: Vec<String>,
    inputs: Vec<String>,
    /// Times, s.
    pub t: Vec<f64>,
    /// Measured positions, rad, by row.
    pub q: Vec<Vec<f64>>,
    /// Inputs, N·m, by row.
    pub u: Vec<Vec<f64>>,
    /// The true (q, v) by row, rad and rad/s. Nobody at the rig knows them.
    pub truth: Vec<(Vec<f64>, Vec<f64>)>,
}

impl Recording {
    pub(super) fn new(joints: Vec<String>, inputs: Vec<String>) -> Self {
        Recording {
            joints,
            inputs,
            t: Vec::new(),
            q: Vec::new(),
            u: Vec::new(),
            truth: Vec::new(),
        }
    }

    pub(super) fn push(
        &mut self,
        t: f64,
        q: Vec<f64>,
        (place, rate): (&[f64], &[f64]),
        u: Vec<f64>,
    ) {
        self.t.push(t);
        self.q.push(q);
        self.u.push(u);
        self.truth.push((place.to_vec(), rate.to_vec()));
    }

    /// Backward differences of the measured positions, rad/s, by row; 0 in the first.
    pub fn differences(&self) -> Vec<Vec<f64>> {
        let first = self.q.iter().take(1).map(|q| vec![0.0; q.len()]);
        let rows = self.q.windows(2).zip(self.t.windows(2));
        let others = rows.map(|(q, t)| {
            let pairs = q[0].iter().zip(&q[1]);
            pairs.map(|(a, b)| (b - a) / (t[1] - t[0])).collect()
        });
        first.chain(others).collect()
    }

    /// Writes the log as CSV; the file is there whole or not at all. Numbers round-trip exactly.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn write_csv(&self, path: &Path) -> Result<(), Error> {
        self.write(path, &vec![Vec::new(); self.q.len()], &[])
    }

    /// [`write_csv`](Self::write_csv) with [`differences`](Self::differences) as velocities.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn write_csv_with_differences(&self, path: &Path) -> Result<(), Error> {
        self.write(path, &self.differences(), &self.joints)
    }

    fn write(&self, path: &Path, v: &[Vec<f64>], names_of_v: &[String]) -> Result<(), Error> {
        let mut text = String::from("t");
        for (letter, names) in [
            ("q", self.joints.as_slice()),
            ("v", names_of_v),
            ("u", &self.inputs),
        ] {
            for name in names {
                let _ = write!(text, ",{letter}.{name}");
            }
        }
        for (((t, q), v), u) in self.t.iter().zip(&self.q).zip(v).zip(&self.u) {
            let _ = write!(text, "\n{t}");
            for x in q.iter().chain(v).chain(u) {
                let _ = write!(text, ",{x}");
            }
        }
        text.push('\n');
        write_whole(path, text.as_bytes())
    }
}
