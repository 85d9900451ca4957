//! Measured logs: tables with the columns `t`, `q.<joint>`, `v.<joint>`, `u.<input>`, `run`, in CSV, Parquet or MCAP.
//!
//! Row k is the state measured at t_k and the input held over [t_k, t_{k+1}). `v.*` and `run` are optional; `run` separates
//! recordings that do not continue one another. The rows of one run stand together: an id that returns after another run is an
//! error, since the rows could as well be a second recording under the same name.
//!
//! The first bytes of a file tell its format, not its name:
//!
//! | format | columns | times | a fault is told by |
//! |---|---|---|---|
//! | CSV in UTF-8 | those of the header | `t`, s; whole numbers that begin long ago, as those since 1970, become seconds since the first | line and column |
//! | Parquet (feature `parquet`) | numbers, decimals, switches, text; the fields of structures as `a.b`, but no lists | as in CSV, or stamps, which become seconds since the first | row, from 1 |
//! | MCAP (feature `mcap`) | the numbers in messages, `<topic>.<field>.<subfield>` | `header.stamp` of a message, else when it was logged; s since the first row | topic and time |
//!
//! Times that cannot be in seconds are refused with the unit that they seem to be in; `[log.columns]` says it, as the `scale` of `t`.
//!
//! Messages of an MCAP file are read in JSON, and in CDR with definitions of ROS 2 (`ros2msg`); other topics are left out with a
//! warning. The elements of an array are `[0]`, `[1]`, …, or have the names that stand beside it, as in
//! `/joint_states.position[slider]`. A field that is called as a signal (`q.slider`) is that signal, and where one topic has the type
//! `sensor_msgs/msg/JointState` its positions and velocities are those of the coordinates with these names; all else is mapped by
//! `[log.columns]`. The rows are at the messages that hold the position of the first coordinate: other positions and velocities are
//! interpolated between their messages (orientations on the shorter arc, whichever of q and −q was sent), with a warning, and an input is that of the last
//! message until then. Rows at which a signal
//! has no value yet, or no longer, are left out, with a warning.

mod columns;
mod csv;
#[cfg(any(feature = "mcap", feature = "parquet"))]
mod guarded;
mod interval;
#[cfg(feature = "mcap")]
mod mcap;
#[cfg(feature = "parquet")]
mod parquet;
mod read;
mod rows;
mod twice;
mod unit;

use std::path::{Path, PathBuf};

use lagrange::{Coordinate, Problem};

pub use columns::{ColumnMap, Mapping};
pub(crate) use interval::{same_rate, typical, typical_interval};
pub(crate) use twice::refuse_twice;
pub(crate) use unit::{MICROSECOND, MILLISECOND, sizes_of_a_count};

use crate::Error;
use crate::model::{Model, Velocity};
use crate::poses::Poses;

/// Runs shorter than this are left out, with a warning.
pub const FEWEST_SAMPLES: usize = 8;

/// A log in memory, in SI units and in the order of the model's coordinates and inputs.
#[derive(Debug, Clone, PartialEq)]
pub struct Log {
    /// The file it was read from.
    pub path: PathBuf,
    /// SHA-256 of the file, hexadecimal.
    pub sha256: String,
    /// The recordings, in the order of the file.
    pub runs: Vec<Run>,
    /// What was ignored or looks odd.
    pub warnings: Vec<Problem>,
}

/// One uninterrupted recording. All columns are as long as `t`.
#[derive(Debug, Clone, PartialEq)]
pub struct Run {
    /// What stands in the column `run`; `0` without that column.
    pub id: String,
    /// Times, s, increasing.
    pub t: Vec<f64>,
    /// Measured positions, one column per coordinate, m or rad; of a pose seven, position (m) and unit quaternion w x y z.
    pub q: Vec<Vec<f64>>,
    /// Measured velocities, one column per coordinate, m/s or rad/s; `None` where the log has none or the model says to use none. Of a pose six, in the
    /// body's axes.
    pub v: Vec<Option<Vec<f64>>>,
    /// Inputs, one column per input, in the input's own unit; entry k is held over [t_k, t_{k+1}), unless the model says otherwise:
    /// [`Between`](crate::effect::Between).
    pub u: Vec<Vec<f64>>,
}

impl Run {
    /// Number of samples.
    pub fn len(&self) -> usize {
        self.t.len()
    }
    /// Whether there is no sample.
    pub fn is_empty(&self) -> bool {
        self.t.is_empty()
    }

    /// Takes an input from so many rows further down; the last rows keep the last one.
    pub(crate) fn read_input_later(&mut self, input: usize, rows: usize) {
        if let Some(column) = self.u.get_mut(input)
            && let Some(&last) = column.last()
        {
            column.drain(..rows.min(column.len()));
            column.resize(self.t.len(), last);
        }
    }
}

/// What a log is expected to hold.
#[derive(Debug, Clone, Copy)]
pub struct Channels<'a> {
    /// The coordinates: `q.<name>` and `v.<name>`; of a pose `q.<name>.x` to `.z` and `.qw` to `.qz`, `v.<name>.vx` to `.wz`.
    pub coordinates: &'a [Coordinate],
    /// For each coordinate, whether a `v.<name>` column is to be used.
    pub velocities: &'a [bool],
    /// The inputs: `u.<name>`.
    pub inputs: &'a [&'a str],
    /// Where the columns have other names.
    pub columns: &'a ColumnMap,
}

/// Whether the velocity of each coordinate of a model is to be used, and the names of its inputs.
fn read_for(model: &Model) -> (Vec<bool>, Vec<&str>) {
    let sensors = model.sensors.iter();
    let inputs = model.inputs.iter();
    (
        sensors.map(|s| s.velocity != Velocity::None).collect(),
        inputs.map(|input| input.name.as_str()).collect(),
    )
}

/// What a log of a model holds.
fn channels<'a>(model: &'a Model, velocities: &'a [bool], inputs: &'a [&'a str]) -> Channels<'a> {
    Channels {
        coordinates: model.mechanics.coordinates(),
        velocities,
        inputs,
        columns: &model.columns,
    }
}

impl Log {
    /// Reads the log at `path` for `model`. Where the model writes poses by angles, the log may still have positions and quaternions.
    ///
    /// # Errors
    /// [`Error::Io`], or [`Error::Problems`] with every fault, each with its place (the first twenty, and how many more).
    pub fn read(path: &Path, model: &Model) -> Result<Log, Error> {
        let (velocities, inputs) = read_for(model);
        let channels = channels(model, &velocities, &inputs);
        let bytes = read::bytes(path)?;
        let log = Log::parse(path, &bytes, &channels);
        let Some(poses) = Poses::of(model).filter(|_| log.is_err()) else {
            return log;
        };
        let velocities = poses.of_all(&velocities);
        let with_poses = Channels {
            coordinates: poses.coordinates(),
            velocities: &velocities,
            ..channels
        };
        // What is wrong with a log of poses is said of their columns, and with others of the angles'.
        match poses.are_among(&read::positions(path, &bytes, &with_poses)) {
            true => poses.by_angles(Log::parse(path, &bytes, &with_poses)?),
            false => log,
        }
    }

    /// Reads the times and the inputs of `model` at `path`, whatever else stands there: what a roll-out from a given state needs.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn read_inputs(path: &Path, model: &Model) -> Result<Log, Error> {
        let (_, inputs) = read_for(model);
        let channels = Channels {
            coordinates: &[],
            ..channels(model, &[], &inputs)
        };
        Log::read_channels(path, &channels)
    }

    /// Reads the log at `path` without a model.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn read_channels(path: &Path, channels: &Channels) -> Result<Log, Error> {
        let bytes = read::bytes(path)?;
        Log::parse(path, &bytes, channels)
    }

    /// Reads a log that is in memory; `path` is its name in messages.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn parse(path: &Path, bytes: &[u8], channels: &Channels) -> Result<Log, Error> {
        read::parse(path, bytes, channels)
    }

    /// Where the signals of a model without poses stand in the file; as the model says where that cannot be read any more.
    pub(crate) fn columns(&self, model: &Model) -> ColumnMap {
        let (velocities, inputs) = read_for(model);
        let channels = channels(model, &velocities, &inputs);
        let bytes = read::bytes(&self.path);
        let header = bytes.and_then(|bytes| read::header(&self.path, &bytes, &channels));
        header.map_or_else(|_| model.columns.clone(), |(_, columns)| columns)
    }

    /// Whether the recordings have the columns of `model`: whether they were read for it, or for one like it.
    ///
    /// # Errors
    /// [`Error::OtherModel`].
    pub fn check(&self, model: &Model) -> Result<(), Error> {
        let (nq, nv) = (model.mechanics.nq(), model.mechanics.nv());
        let inputs = model.inputs.len();
        for run in &self.runs {
            let columns = [
                ("positions", run.q.len(), nq),
                ("velocities", run.v.len(), nv),
                ("inputs", run.u.len(), inputs),
            ];
            for (what, found, expected) in columns {
                if found != expected {
                    return Err(Error::OtherModel {
                        log: self.path.clone(),
                        run: run.id.clone(),
                        what,
                        found,
                        expected,
                    });
                }
            }
        }
        Ok(())
    }

    /// Number of samples in all runs.
    pub fn samples(&self) -> usize {
        self.runs.iter().map(Run::len).sum()
    }
}
