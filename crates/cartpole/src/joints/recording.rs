//! The log of such a rig.

use std::fmt::Write;
use std::path::Path;

use crate::rig::{Error, write_whole};

/// Row k: what was measured at t_k, and the inputs held over [t_k, t_{k+1}). Velocities are not measured.
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
}

impl Recording {
    pub(super) fn new(joints: Vec<String>, inputs: Vec<String>) -> Self {
        Recording {
            joints,
            inputs,
            t: Vec::new(),
            q: Vec::new(),
            u: Vec::new(),
        }
    }

    pub(super) fn push(&mut self, t: f64, q: Vec<f64>, u: Vec<f64>) {
        self.t.push(t);
        self.q.push(q);
        self.u.push(u);
    }

    /// Writes the log as CSV; the file is there whole or not at all. Numbers round-trip exactly.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn write_csv(&self, path: &Path) -> Result<(), Error> {
        let mut text = String::from("t");
        for joint in &self.joints {
            let _ = write!(text, ",q.{joint}");
        }
        for input in &self.inputs {
            let _ = write!(text, ",u.{input}");
        }
        for ((t, q), u) in self.t.iter().zip(&self.q).zip(&self.u) {
            let _ = write!(text, "\n{t}");
            for x in q.iter().chain(u) {
                let _ = write!(text, ",{x}");
            }
        }
        text.push('\n');
        write_whole(path, text.as_bytes())
    }
}
