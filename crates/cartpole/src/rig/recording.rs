//! What a run leaves: the log that the user sees.

use std::path::Path;

use super::Error;

/// A log: row k is what was measured at t_k and the input held over [t_k, t_{k+1}).
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Recording {
    /// Times, s.
    pub t: Vec<f64>,
    /// Measured positions of `slider`, m, and `pole`, rad in [0, 2π).
    pub q: [Vec<f64>; 2],
    /// Backward differences of the measured positions, m/s and rad/s.
    pub v: [Vec<f64>; 2],
    /// Commanded force, N.
    pub u: Vec<f64>,
    /// When the cart struck an end of its rail, s. Whoever stands beside the rig hears it; it is not in the log. None
    /// of blows on hidden stops.
    pub blows: Vec<f64>,
}

impl Recording {
    /// Number of rows.
    pub fn len(&self) -> usize {
        self.t.len()
    }

    /// Whether there is no row.
    pub fn is_empty(&self) -> bool {
        self.t.is_empty()
    }

    /// Writes the log as CSV; the file is there whole or not at all. Numbers round-trip exactly.
    pub fn write_csv(&self, path: &Path) -> Result<(), Error> {
        let mut text = String::from("t,q.slider,q.pole,v.slider,v.pole,u.motor\n");
        let [x, phi] = &self.q;
        let [x_dot, phi_dot] = &self.v;
        let rows = self.t.iter().zip(x).zip(phi).zip(x_dot).zip(phi_dot);
        for (((((t, x), phi), x_dot), phi_dot), u) in rows.zip(&self.u) {
            text.push_str(&format!("{t},{x},{phi},{x_dot},{phi_dot},{u}\n"));
        }
        write_whole(path, text.as_bytes())
    }
}

/// [`pinode_nn::write_atomically`], with errors of the rig.
pub(crate) fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), Error> {
    pinode_nn::write_atomically(path, bytes).map_err(|error| match error {
        pinode_nn::Error::Io { path, source } => Error::Io { path, source },
        error => Error::Io {
            path: path.to_owned(),
            source: std::io::Error::other(error),
        },
    })
}
