//! Logs of bodies that float: poses, measured as position and quaternion, as six numbers each.
//!
//! What is fitted and compared with a sensor is one number, and so is its velocity. A model with a pose among its coordinates is therefore written by
//! [`Angles`] for everything that reads a log: `pose = "angles"` in its file, with coordinates from `base.x` to `base.roll`. Angles fail where the axis that
//! roll is about is vertical; it is chosen such that the motion in the logs stays away from there, and what does not is left out.

use std::path::Path;

use lagrange::mechanism::{Angles, Axis, PoseForm};
use lagrange::{Coordinate, Problem, Problems};

use crate::Error;
use crate::entries::{Start, q_names, starts};
#[cfg(feature = "cli")]
use crate::hybrid::Hybrid;
use crate::log::{FEWEST_SAMPLES, Log, Run};
use crate::model::Model;
use crate::naming::quoted;

/// Samples are left out where the [`steepness`](Angles::steepness) of the angles is below this: the roll axis is within 9° of the vertical.
const LEAST_STEEPNESS: f64 = 0.15;
/// A quaternion is of length 1 to this; what is measured is rounded.
const UNIT: f64 = 0.02;
/// More problems than these are only counted.
const MOST_PROBLEMS: usize = 20;

/// `model` and `logs` with every pose by angles. Unchanged where no coordinate is a pose.
///
/// The axis of the bodies that roll is about is the one that is near the vertical in the fewest samples. Those samples are left out, which cuts recordings;
/// the logs' warnings say so.
///
/// ```no_run
/// use pinode_nn::{log::Log, model::Model, poses};
///
/// let model = Model::load("satellite.toml".as_ref())?;
/// let log = Log::read("log.csv".as_ref(), &model)?;
/// let (model, logs) = poses::by_angles(&model, &[log])?;
/// assert_eq!(model.mechanics.coordinates()[3].name, "base.yaw");
/// # Ok::<(), pinode_nn::Error>(())
/// ```
///
/// # Errors
/// [`Error::OtherModel`] when a log was read for another model; [`Error::Problems`] where a quaternion in a log is none; what [`Model::by_angles`] returns.
pub fn by_angles(model: &Model, logs: &[Log]) -> Result<(Model, Vec<Log>), Error> {
    let coordinates = model.mechanics.coordinates();
    if !model.has_poses() {
        return Ok((model.clone(), logs.to_vec()));
    }
    logs.iter().try_for_each(|log| log.check(model))?;
    let choices = Axis::ALL.map(|roll_axis| Poses {
        angles: Angles { roll_axis },
        coordinates: coordinates.to_vec(),
    });
    let runs: Vec<&Run> = logs.iter().flat_map(|log| &log.runs).collect();
    let left_out = |poses: &Poses| {
        let steep = runs.iter().flat_map(|run| poses.are_steep(run));
        steep.filter(|steep| !steep).count()
    };
    let [first, others @ ..] = choices;
    let least = |best: (usize, Poses), next: Poses| match left_out(&next) {
        fewer if fewer < best.0 => (fewer, next),
        _ => best,
    };
    let (_, poses) = others.into_iter().fold((left_out(&first), first), least);
    let logs = logs.iter().cloned().map(|log| poses.by_angles(log));
    let logs = logs.collect::<Result<Vec<_>, _>>()?;
    Ok((model.by_angles(poses.angles.roll_axis)?, logs))
}

/// The state (q, v) of a model with poses at sample `k` of a recording: as measured, and where velocities are not, by the difference of the neighbours;
/// of coordinates of one number behind what their sensors read.
#[cfg(feature = "cli")]
pub(crate) fn measured_state(model: &Model, run: &Run, k: usize) -> Vec<f64> {
    let coordinates = model.mechanics.coordinates();
    let q = |k: usize| -> Vec<f64> {
        let mut q: Vec<f64> = run.q.iter().map(|column| column[k]).collect();
        lagrange::state::normalize(coordinates, &mut q);
        q
    };
    let (a, b) = (
        k.saturating_sub(1),
        (k + 1).min(run.len().saturating_sub(1)),
    );
    let mut v = vec![0.0; model.mechanics.nv()];
    if b > a {
        lagrange::state::difference_into(coordinates, &q(a), &q(b), &mut v);
        let time = run.t[b] - run.t[a];
        v.iter_mut().for_each(|v| *v /= time);
    }
    for (v, measured) in v.iter_mut().zip(&run.v) {
        if let Some(column) = measured {
            *v = column[k];
        }
    }
    let mut q = q(k);
    let hybrid = Hybrid::of(model);
    let readings = hybrid.readings(&hybrid.theta(), &[]);
    for ((coordinate, start), reading) in coordinates.iter().zip(starts(coordinates)).zip(readings)
    {
        if !coordinate.floating {
            q[start.q] = reading.position_of(q[start.q], v[start.v]);
            v[start.v] /= reading.factor;
        }
    }
    q.extend(v);
    q
}

/// A sample of a motion at which the angles of a pose are near where they fail.
#[cfg(feature = "cli")]
pub(crate) struct Upright {
    /// The angle, and its value, rad.
    coordinate: String,
    pitch: f64,
    /// s
    time: f64,
    roll_axis: Axis,
}

#[cfg(feature = "cli")]
impl Upright {
    /// The nearest of these states at the times `t`; `None` where none is near, and of a model without angles.
    pub fn of(model: &Model, t: &[f64], states: &[Vec<f64>]) -> Option<Self> {
        let poses = Poses::of(model)?;
        let roll_axis = poses.angles.roll_axis;
        let pitches = poses.poses().filter_map(|(_, start)| {
            // By angles there are as many entries in q as in v.
            let index = start.v + 4;
            Some((index, model.mechanics.coordinates().get(index)?))
        });
        let all = pitches.flat_map(|(index, coordinate)| {
            let samples = t.iter().zip(states);
            samples.filter_map(move |(&time, state)| {
                Some(Upright {
                    coordinate: coordinate.name.clone(),
                    pitch: *state.get(index)?,
                    time,
                    roll_axis,
                })
            })
        });
        let nearest = all.min_by(|a, b| a.steepness().total_cmp(&b.steepness()));
        nearest.filter(|nearest| nearest.steepness() < LEAST_STEEPNESS)
    }

    fn steepness(&self) -> f64 {
        self.pitch.cos().abs()
    }

    /// What a simulation of `run` that is stopped there has come to.
    pub fn stops(self, run: &str, cause: Error) -> Error {
        Error::Upright {
            run: run.to_owned(),
            coordinate: self.coordinate,
            pitch: self.pitch,
            time: self.time,
            roll_axis: self.roll_axis.name(),
            cause: Box::new(cause),
        }
    }

    /// What should be known of a simulation of `run` that passes there.
    pub fn warning(&self, run: &str) -> String {
        format!(
            "run `{run}`: `{}` is {:.3} rad at t = {} s: the {} axis of the body, which roll is about, is within 9° of the vertical, where the angles of \
             `pose = \"angles\"` fail and steps lose their accuracy; take a `roll_axis` that stays away from there, or `pose = \"quaternion\"`",
            self.coordinate,
            self.pitch,
            self.time,
            self.roll_axis.name()
        )
    }
}

/// How the poses of a model are measured, and how they are written.
pub(crate) struct Poses {
    angles: Angles,
    /// With each pose as one coordinate.
    coordinates: Vec<Coordinate>,
}

impl Poses {
    /// Of a model that writes them by angles; `None` of others.
    pub fn of(model: &Model) -> Option<Self> {
        let PoseForm::Angles(angles) = model.pose else {
            return None;
        };
        let coordinates = with_poses(model.mechanics.coordinates());
        let floats = coordinates.iter().any(|c| c.floating);
        floats.then_some(Poses {
            angles,
            coordinates,
        })
    }

    /// The coordinates with each pose as one.
    pub fn coordinates(&self) -> &[Coordinate] {
        &self.coordinates
    }

    /// Whether a quaternion, or a part of one, is among these signals.
    pub fn are_among(&self, signals: &[String]) -> bool {
        let names = q_names(&self.coordinates);
        let mut parts = self
            .poses()
            .flat_map(|(_, start)| &names[start.q + 3..start.q + 7]);
        parts.any(|part| signals.contains(part))
    }

    /// What holds of the coordinates, where six are a pose: of all of these.
    pub fn of_all(&self, of_single: &[bool]) -> Vec<bool> {
        let mut rest = of_single;
        let mut of = |count: usize| {
            let (own, others) = rest.split_at(count.min(rest.len()));
            rest = others;
            own.iter().all(|x| *x)
        };
        let coordinates = self.coordinates.iter();
        coordinates.map(|c| of(c.nv())).collect()
    }

    fn poses(&self) -> impl Iterator<Item = (&Coordinate, Start)> {
        let all = self.coordinates.iter().zip(starts(&self.coordinates));
        all.filter(|(c, _)| c.floating)
    }

    /// Of every sample, whether the angles are good there.
    fn are_steep(&self, run: &Run) -> Vec<bool> {
        let steep = |k: usize, start: Start| {
            self.angles.steepness(&sample(&run.q, start.q, k)) >= LEAST_STEEPNESS
        };
        let samples = 0..run.len();
        samples
            .map(|k| self.poses().all(|(_, start)| steep(k, start)))
            .collect()
    }

    /// A log that was read with poses, by angles; without the samples where these fail.
    ///
    /// # Errors
    /// [`Error::Problems`] where a quaternion is none.
    pub fn by_angles(&self, mut log: Log) -> Result<Log, Error> {
        self.check(&log.path, &log.runs)?;
        let (mut pieces, mut left_out) = (Vec::new(), 0);
        for run in &log.runs {
            let good = self.are_steep(run);
            left_out += good.iter().filter(|good| !**good).count();
            pieces.extend(cut(self.run_by_angles(run), &good));
        }
        for (coordinate, start) in self.poses() {
            let measured = |run: &Run| run.v[start.v..start.v + 6].iter().flatten().count();
            if log.runs.iter().any(|run| (1..6).contains(&measured(run))) {
                log.warnings.push(Problem::general(format!(
                    "velocities of {} are not used: all six are needed, `v.{}.vx` to `.wz`, and some are missing",
                    quoted(&coordinate.name),
                    coordinate.name
                )));
            }
        }
        let samples: usize = log.runs.iter().map(Run::len).sum();
        if left_out > 0 {
            let names: Vec<String> = self.poses().map(|(c, _)| quoted(&c.name)).collect();
            log.warnings.push(Problem::general(format!(
                "{left_out} of {samples} samples are left out, and recordings cut there: the {} axis of {} is within 9° of the vertical, where the angles of \
                 `pose = \"angles\"` fail",
                self.angles.roll_axis.name(),
                names.join(", ")
            )));
        }
        log.runs = pieces;
        match log.runs.is_empty() {
            false => Ok(log),
            true => Err(Error::Problems(Problems {
                source: log.path.display().to_string(),
                list: vec![Problem::general(format!(
                    "no {FEWEST_SAMPLES} samples in a row in which the {} axis of the floating body is away from the vertical: say another `roll_axis`",
                    self.angles.roll_axis.name()
                ))],
            })),
        }
    }

    /// That quaternions are of length 1.
    fn check(&self, path: &Path, runs: &[Run]) -> Result<(), Error> {
        let mut list = Vec::new();
        let mut more = 0;
        for run in runs {
            for (coordinate, start) in self.poses() {
                for k in 0..run.len() {
                    let quaternion = &sample::<7>(&run.q, start.q, k)[3..];
                    let length = quaternion.iter().map(|x| x * x).sum::<f64>().sqrt();
                    if (length - 1.0).abs() <= UNIT {
                        continue;
                    }
                    if list.len() == MOST_PROBLEMS {
                        more += 1;
                        continue;
                    }
                    list.push(Problem::general(format!(
                        "run {} at t = {} s: the quaternion of {} has the length {length:.4}, and an orientation has 1: q.{}.qw is its real part, .qx to .qz \
                         its imaginary ones",
                        quoted(&run.id),
                        run.t[k],
                        quoted(&coordinate.name),
                        coordinate.name,
                    )));
                }
            }
        }
        if more > 0 {
            list.push(Problem::general(format!("and {more} more")));
        }
        match list.is_empty() {
            true => Ok(()),
            false => Err(Error::Problems(Problems {
                source: path.display().to_string(),
                list,
            })),
        }
    }

    fn run_by_angles(&self, run: &Run) -> Run {
        let (mut q, mut v) = (Vec::new(), Vec::new());
        for (coordinate, start) in self.coordinates.iter().zip(starts(&self.coordinates)) {
            if !coordinate.floating {
                q.push(run.q[start.q].clone());
                v.push(run.v[start.v].clone());
                continue;
            }
            let mut of_q: [Vec<f64>; 6] = Default::default();
            let mut of_v: [Vec<f64>; 6] = Default::default();
            let twists: Option<Vec<&Vec<f64>>> =
                (run.v[start.v..start.v + 6].iter().map(Option::as_ref)).collect();
            for k in 0..run.len() {
                let pose = sample(&run.q, start.q, k);
                let at = self.angles.of_pose(&pose);
                of_q.iter_mut()
                    .zip(at)
                    .for_each(|(column, x)| column.push(x));
                if let Some(twists) = &twists {
                    let twist: [f64; 6] = std::array::from_fn(|i| twists[i][k]);
                    let rates = self.angles.rates(&pose, &twist);
                    let pairs = of_v.iter_mut().zip(rates);
                    pairs.for_each(|(column, x)| column.push(x));
                }
            }
            q.extend(of_q);
            v.extend(of_v.map(|column| twists.as_ref().map(|_| column)));
        }
        Run {
            id: run.id.clone(),
            t: run.t.clone(),
            u: run.u.clone(),
            q,
            v,
        }
    }
}

/// Entries `first`, … of the columns at sample `k`.
fn sample<const N: usize>(columns: &[Vec<f64>], first: usize, k: usize) -> [f64; N] {
    std::array::from_fn(|i| columns[first + i][k])
}

/// The six coordinates of a pose that is written by angles, if `coordinates` begin with them.
fn pose_at_the_front(coordinates: &[Coordinate]) -> Option<&[Coordinate]> {
    let six = coordinates.get(..Angles::NAMES.len())?;
    let joint = &six[0].joint;
    let is_named =
        |(c, name): (&Coordinate, &str)| c.joint == *joint && c.name == format!("{joint}.{name}");
    six.iter().zip(Angles::NAMES).all(is_named).then_some(six)
}

/// The coordinates with each pose that is written by angles as one.
pub(crate) fn with_poses(coordinates: &[Coordinate]) -> Vec<Coordinate> {
    let mut list = Vec::new();
    let mut rest = coordinates;
    while let Some(first) = rest.first() {
        let six = pose_at_the_front(rest);
        list.push(match six {
            Some(_) => Coordinate {
                name: first.joint.clone(),
                joint: first.joint.clone(),
                angular: false,
                wraps: false,
                floating: true,
            },
            None => first.clone(),
        });
        rest = &rest[six.map_or(1, <[_]>::len)..];
    }
    list
}

/// Whether a coordinate is one of the six of a pose.
pub(crate) fn is_of_pose(coordinates: &[Coordinate], index: usize) -> bool {
    let joint = coordinates.get(index).map(|c| &c.joint);
    let first = coordinates.iter().position(|c| Some(&c.joint) == joint);
    first.is_some_and(|first| pose_at_the_front(&coordinates[first..]).is_some())
}

/// The stretches of a recording that are `good`, if they are not too short; of several each has a number of its own.
fn cut(run: Run, good: &[bool]) -> Vec<Run> {
    if good.iter().all(|good| *good) {
        return vec![run];
    }
    let mut pieces = Vec::new();
    let mut first = 0;
    for stretch in good.chunk_by(|a, b| a == b) {
        let of = first..first + stretch.len();
        first = of.end;
        if stretch[0] && stretch.len() >= FEWEST_SAMPLES {
            let part = |column: &Vec<f64>| column[of.clone()].to_vec();
            pieces.push(Run {
                id: format!("{}.{}", run.id, pieces.len() + 1),
                t: part(&run.t),
                q: run.q.iter().map(part).collect(),
                v: run.v.iter().map(|v| v.as_ref().map(part)).collect(),
                u: run.u.iter().map(part).collect(),
            });
        }
    }
    pieces
}
