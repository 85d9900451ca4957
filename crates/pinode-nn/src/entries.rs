//! Which entries of q and of v belong to which coordinate, and what they are called.

use lagrange::Coordinate;

use crate::Error;

/// Entries of a pose in q: position, then the unit quaternion.
const POSE: [&str; 7] = ["x", "y", "z", "qw", "qx", "qy", "qz"];
/// Entries of its velocity in v, in the axes of the moved body: linear, then angular.
const TWIST: [&str; 6] = ["vx", "vy", "vz", "wx", "wy", "wz"];

/// Where a coordinate's entries start.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Start {
    /// Its first entry in q.
    pub q: usize,
    /// Its first entry in v, in accelerations and in forces.
    pub v: usize,
}

/// One start a coordinate.
pub(crate) fn starts(coordinates: &[Coordinate]) -> Vec<Start> {
    let mut next = Start { q: 0, v: 0 };
    coordinates
        .iter()
        .map(|coordinate| {
            let start = next;
            next.q += coordinate.nq();
            next.v += coordinate.nv();
            start
        })
        .collect()
}

/// The names of q's entries: `q.<coordinate>`; for a pose `q.<coordinate>.x`, `.y`, `.z`, `.qw`, `.qx`, `.qy`, `.qz`.
pub(crate) fn q_names(coordinates: &[Coordinate]) -> Vec<String> {
    names("q", coordinates, &POSE)
}

/// The names of v's entries: `v.<coordinate>`; for a pose `v.<coordinate>.vx`, `.vy`, `.vz`, `.wx`, `.wy`, `.wz`.
pub(crate) fn v_names(coordinates: &[Coordinate]) -> Vec<String> {
    names("v", coordinates, &TWIST)
}

fn names(signal: &str, coordinates: &[Coordinate], of_pose: &[&str]) -> Vec<String> {
    let mut names = Vec::new();
    for Coordinate { name, floating, .. } in coordinates {
        if *floating {
            names.extend(of_pose.iter().map(|part| format!("{signal}.{name}.{part}")));
        } else {
            names.push(format!("{signal}.{name}"));
        }
    }
    names
}

/// Refuses models with a pose among their coordinates, for work that takes one measured number a coordinate.
pub(crate) fn refuse_poses(coordinates: &[Coordinate], work: &'static str) -> Result<(), Error> {
    match coordinates.iter().find(|c| c.floating) {
        None => Ok(()),
        Some(pose) => Err(Error::Floating {
            coordinate: pose.name.clone(),
            work,
        }),
    }
}
