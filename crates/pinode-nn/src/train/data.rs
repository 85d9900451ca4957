//! Recordings, cut into the windows that a network is trained on.

use std::collections::BTreeSet;

use super::adjoint::Member;
use super::loss::{FAR, Loss, Target};
use super::windows::{RunName, border, one_interval, run_names};
use super::{Options, Start};
use crate::Error;
use crate::diagnose::audit::{Masked, audit};
use crate::diagnose::pace::Pace;
use crate::diagnose::scales::{MotionScales, scales};
use crate::diagnose::smooth::{Smoothed, smooth};
use crate::entries::{refuse_poses, starts};
use crate::hybrid::{DrivenInputs, HiddenPath, Hybrid, Reading};
use crate::learnt::{Feature, Output, Quantity};
use crate::log::{Log, typical_interval};
use crate::model::{EffectEntry, Model};
use crate::naming::quoted;
use crate::shooting::{Observations, ObservedRun, Window};

/// What this is called in errors.
const WORK: &str = "training";
/// Of the windows with the largest forces, so many do not set the scale of the outputs.
const LARGEST: f64 = 0.005;
/// Windows that are learnt from begin so many times a window.
pub(super) const OVERLAP: usize = 4;
/// More integration steps between two samples are refused.
pub(super) const MOST_SUBSTEPS: f64 = 1000.0;
/// The network can give so much more than the largest force that the data ask for.
const RESERVE: f64 = 1.5;

/// Recordings under one model, and their windows.
pub(crate) struct Recordings {
    pub hybrid: Hybrid,
    pub theta: Vec<f64>,
    /// θ as the model has it: what the tolerances are about.
    pub(super) given: Vec<f64>,
    /// Known constants that the last fit would have stretched beyond reason, and to what: they were held as they are given.
    pub(super) held_back: Vec<(usize, f64)>,
    pub observations: Observations,
    pub loss: Loss,
    /// Integration steps a sample interval, and sample intervals a window.
    pub substeps: usize,
    pub horizon: usize,
    /// One a recording.
    pub inputs: Vec<DrivenInputs>,
    /// Recordings from this one on are held out.
    pub(super) fit_runs: usize,
    /// The typical time between samples, s.
    pub interval: f64,
    /// That of each; no number where it has one sample.
    pub(super) intervals: Vec<f64>,
    /// The recordings that have no window, and why.
    pub left_out: Vec<String>,
    pub(super) masked: Masked,
    pub(super) targets: Vec<Target>,
    /// The readings, smoothed.
    pub(super) smoothed: Vec<Smoothed>,
    pub(super) scales: MotionScales,
    /// What the sensors do, one a coordinate.
    pub(super) readings: Vec<Reading>,
    /// Where the recordings take the effects with a memory.
    pub(super) paths: Vec<HiddenPath>,
    /// Those that are learnt from, and those that tell when to stop.
    pub seen: Side,
    pub held_out: Side,
}

/// Windows and the states that they start from.
#[derive(Clone)]
pub(crate) struct Side {
    pub windows: Vec<Window>,
    pub starts: Vec<Vec<f64>>,
    /// So many entries of a start are q and v, which are fitted; the others are h.
    pub visible: usize,
    /// Of each start: how far its window was from the measurements, the damping of its next step, and the start before.
    pub trust: Vec<Vec<f64>>,
}

/// Networks are fitted to where joints are, which a sensor on a motor does not say.
fn refuse_read_motors(model: &Model) -> Result<(), Error> {
    let is_read = |entry: &&EffectEntry| {
        let motor = entry.kind.motor();
        motor.is_some_and(|motor| motor.is_read(&entry.values))
    };
    match model.effects.iter().find(is_read) {
        None => Ok(()),
        Some(entry) => Err(Error::Training(format!(
            "the {} on {} has `sensor_on_motor = true`: networks are trained on where joints are, and its sensor reads its motor; leave it to \
             `pinode diagnose`, or log the joint itself",
            entry.kind.name,
            quoted(model.target_name(entry.target)),
        ))),
    }
}

impl Recordings {
    /// Those of `logs`; what is held out is `held_out`, or the last eighth of each recording where that is empty. Where constants are fitted, `within` reason or however far.
    pub fn new(
        model: &Model,
        [logs, held_out]: [&[Log]; 2],
        options: &Options,
        within: bool,
    ) -> Result<Self, Error> {
        let coordinates = model.mechanics.coordinates();
        refuse_poses(coordinates, WORK)?;
        refuse_read_motors(model)?;
        let mut all = logs.iter().chain(held_out);
        all.try_for_each(|log| log.check(model))?;
        let hybrid = Hybrid::explicit(model);
        let theta = hybrid.theta();
        let audited = audit(model, logs, held_out);
        let fit_runs = logs.iter().map(|log| log.runs.len()).sum();
        let observations = audited.observations;
        let wraps: Vec<bool> = coordinates.iter().map(|c| c.wraps).collect();
        let pace = Pace::of(&observations);
        let smoothed: Vec<Smoothed> = observations
            .runs
            .iter()
            .map(|run| smooth(run, &wraps, pace.half_width()))
            .collect();
        let names: Vec<RunName> = run_names(logs, held_out).collect();
        let intervals: Vec<f64> = (observations.runs.iter())
            .map(|run| typical_interval(&run.t).unwrap_or(f64::NAN))
            .collect();
        let interval = one_interval(&names, &intervals)?;
        let substeps = (interval / options.longest_step * (1.0 - 1e-9))
            .ceil()
            .max(1.0);
        if substeps > MOST_SUBSTEPS {
            return Err(Error::Training(format!(
                "a longest step of {:e} s takes {substeps:e} steps in a sample interval of {interval:.6} s: {MOST_SUBSTEPS} are taken at \
                 most; give a longer --step, {:.3e} s at least",
                options.longest_step,
                1.001 * interval / MOST_SUBSTEPS
            )));
        }
        let substeps = substeps as usize;
        let mut recordings = Recordings {
            loss: loss(&hybrid, &observations, options),
            targets: targets(logs, held_out, (&observations, &audited.firsts), options),
            scales: scales(&hybrid, (&smoothed, &pace), &observations),
            inputs: Vec::new(),
            readings: Vec::new(),
            paths: Vec::new(),
            hybrid,
            given: theta.clone(),
            held_back: Vec::new(),
            theta,
            smoothed,
            fit_runs,
            interval,
            intervals,
            left_out: Vec::new(),
            masked: audited.masked,
            substeps,
            horizon: (options.horizon / interval).round().max(1.0) as usize,
            seen: Side::empty(),
            held_out: Side::empty(),
            observations,
        };
        recordings.refine_for_memory()?;
        recordings.drive_with(&recordings.theta.clone(), &recordings.hybrid.free());
        recordings.look_behind_sensors();
        let horizon = recordings.horizon;
        [recordings.seen.windows, _] = recordings.cut(horizon, horizon.div_ceil(OVERLAP));
        [_, recordings.held_out.windows] = recordings.cut(horizon, horizon);
        if recordings.held_out.windows.is_empty() && held_out.is_empty() {
            // One may fit that does not begin on the grid of those that are learnt from.
            [_, recordings.held_out.windows] = recordings.cut_from(horizon, horizon, border);
        }
        let horizon = interval * recordings.horizon as f64;
        if recordings.seen.windows.is_empty() {
            return Err(Error::NoWindow { horizon });
        }
        if recordings.held_out.windows.is_empty() {
            let part = match held_out.is_empty() {
                true => "the last eighth of each recording, which is held out",
                false => "the logs that are held out",
            };
            return Err(Error::NoWindowHeldOut { horizon, part });
        }
        recordings.left_out = recordings.without_window(&names);
        recordings.check_room(options)?;
        let first = |side: &Side| recordings.first_states(&side.windows, &options.start);
        let (seen, held_out) = (first(&recordings.seen), first(&recordings.held_out));
        (recordings.seen.starts, recordings.held_out.starts) = (seen, held_out);
        let visible = recordings.hybrid.nx() - recordings.hybrid.nh();
        (recordings.seen.visible, recordings.held_out.visible) = (visible, visible);
        if options.physics {
            match options.start {
                Start::Measured { .. } => recordings.fit_from_starts()?,
                Start::Fitted => recordings.fit_from_free_states(within),
            }
        }
        recordings.set_theta(recordings.theta.clone());
        if options.start == Start::Fitted {
            recordings.fit_starts(&recordings.hybrid.clone());
        }
        if options.alone {
            recordings.hybrid.leave_to_network(&options.joints);
        }
        Ok(recordings)
    }

    /// The inputs of the recordings at θ, with derivatives in these entries of it.
    pub(super) fn drive_with(&mut self, theta: &[f64], free: &[usize]) {
        let runs = &self.observations.runs;
        let drive = |run: &ObservedRun| {
            self.hybrid
                .drive(&run.t, &run.u, self.substeps, theta, free)
        };
        self.inputs = runs.iter().map(drive).collect();
    }

    /// The constants as they were fitted, and what follows from them.
    pub(super) fn set_theta(&mut self, theta: Vec<f64>) {
        self.theta = theta;
        self.hybrid.set_theta(&self.theta);
        self.drive_with(&self.theta.clone(), &[]);
        self.look_behind_sensors();
        self.remember();
    }

    /// The standard deviations that fits begin with, one a channel.
    pub(super) fn noise(&self) -> Vec<f64> {
        let channels = &self.observations.channels;
        channels.iter().map(|c| 3.0 * c.noise).collect()
    }

    /// A window as it is rolled out.
    pub fn member<'a>(&'a self, side: &'a Side, index: usize) -> Member<'a> {
        let window = &side.windows[index];
        Member {
            inputs: &self.inputs[window.run],
            target: &self.targets[window.run],
            first: window.first,
            start: &side.starts[index],
        }
    }

    /// What a network saw of the samples in the windows that it learnt from, one row a sample.
    pub fn seen_states(&self, features: &[Feature]) -> Vec<Vec<f64>> {
        self.values_at(&self.seen_samples(), features)
    }

    /// The samples in the windows that are learnt from, by recording and place.
    pub(super) fn seen_samples(&self) -> Vec<(usize, usize)> {
        let windows = self.seen.windows.iter();
        let samples = windows.flat_map(|w| (w.first..w.first + w.count).map(|k| (w.run, k)));
        let samples: BTreeSet<(usize, usize)> = samples.collect(); // windows overlap
        samples.into_iter().collect()
    }

    /// What a network sees of these samples, one row a sample.
    pub(super) fn values_at(
        &self,
        samples: &[(usize, usize)],
        features: &[Feature],
    ) -> Vec<Vec<f64>> {
        let starts = starts(self.hybrid.mechanics().coordinates());
        let of = |&(run, k): &(usize, usize)| -> Vec<f64> {
            let (state, inputs) = (self.state(run, k), &self.inputs[run]);
            let value = |f: &Feature| {
                f.quantity
                    .value(&state, k, &starts, self.hybrid.nq(), inputs)
            };
            features.iter().map(value).collect()
        };
        samples.iter().map(of).collect()
    }

    /// What the network sees, scaled to mean 0 and deviation 1 over the recordings.
    pub fn features(&self, quantities: &[Quantity]) -> Vec<Feature> {
        let starts = starts(self.hybrid.mechanics().coordinates());
        let nq = self.hybrid.nq();
        // The last sample has no step of its own.
        let samples = |smoothed: &Smoothed| 0..smoothed.q.first().map_or(0, Vec::len).max(1) - 1;
        let runs = self.smoothed.iter().zip(&self.inputs).enumerate();
        let states: Vec<(Vec<f64>, usize, &DrivenInputs)> = runs
            .flat_map(|(run, (smoothed, inputs))| {
                samples(smoothed).map(move |k| (self.state(run, k), k, inputs))
            })
            .collect();
        let of = |&quantity: &Quantity| {
            let value = |(state, k, inputs): &(Vec<f64>, usize, &DrivenInputs)| {
                quantity.value(state, *k, &starts, nq, inputs)
            };
            Feature::scaled(quantity, states.iter().map(value))
        };
        quantities.iter().map(of).collect()
    }

    /// What the network acts on, each with the scale of the force that the model lacks: M v̇ + C v + G − Q, smoothed.
    pub fn outputs(&self, joints: &[usize]) -> Vec<Output> {
        let hybrid = &self.hybrid;
        let n = hybrid.nv();
        let mut memory = hybrid.memory(&[]);
        let mut mass = nalgebra::DMatrix::zeros(n, n);
        let mut missing: Vec<Vec<f64>> = vec![Vec::new(); n];
        for (run, (smoothed, inputs)) in self.smoothed.iter().zip(&self.inputs).enumerate() {
            let samples = smoothed.q.first().map_or(0, Vec::len);
            for k in 0..samples.saturating_sub(1) {
                let x = self.state(run, k);
                let state = hybrid.parts(&x);
                let step = self.substeps * k;
                if hybrid
                    .acceleration(state, &self.theta, inputs, step, &mut memory)
                    .is_err()
                {
                    continue;
                }
                hybrid.mass_matrix_into(state.q, &self.theta, &mut memory, &mut mass);
                let lacking =
                    nalgebra::DVector::from_fn(n, |c, _| smoothed.a[c][k] - memory.acceleration[c]);
                let force = &mass * lacking;
                for (c, missing) in missing.iter_mut().enumerate() {
                    missing.push(force[c].abs());
                }
            }
        }
        let output = |&coordinate: &usize| {
            let forces = &mut missing[hybrid.start_of(coordinate).v];
            forces.sort_by(f64::total_cmp);
            let index = ((1.0 - LARGEST) * forces.len() as f64) as usize;
            let largest = forces.get(index).copied().unwrap_or(0.0);
            let scale = RESERVE * largest;
            Output {
                coordinate,
                scale: if scale > 0.0 && scale.is_finite() {
                    scale
                } else {
                    1.0
                },
            }
        };
        joints.iter().map(output).collect()
    }
}

impl Side {
    fn empty() -> Self {
        Side {
            windows: Vec::new(),
            starts: Vec::new(),
            visible: 0,
            trust: Vec::new(),
        }
    }
}

fn loss(hybrid: &Hybrid, observations: &Observations, options: &Options) -> Loss {
    let coordinates = hybrid.mechanics().coordinates();
    let mut weights = vec![[0.0; 2]; coordinates.len()];
    match options.start {
        Start::Measured { weights: own } => weights.fill(own),
        Start::Fitted => {
            let channels = &observations.channels;
            for channel in channels {
                weights[channel.coordinate][usize::from(channel.velocity)] =
                    1.0 / (channel.noise.powi(2) * channels.len() as f64);
            }
        }
    }
    let first = usize::from(options.start != Start::Fitted);
    let starts: Vec<_> = (0..coordinates.len()).map(|c| hybrid.start_of(c)).collect();
    let far = (options.start == Start::Fitted).then_some(FAR);
    Loss::new(coordinates, &starts, hybrid.nq(), &weights, first, far)
}

/// The measurements. The paper's loss takes velocities as the log has them, differences among them.
fn targets(
    logs: &[Log],
    held_out: &[Log],
    (observations, firsts): (&Observations, &[usize]),
    options: &Options,
) -> Vec<Target> {
    let runs = logs.iter().chain(held_out).flat_map(|log| &log.runs);
    runs.zip(&observations.runs)
        .zip(firsts)
        .map(|((run, observed), &first)| {
            let rows = observed.t.len();
            let taken = |all: &[f64]| all[first..first + rows].to_vec();
            let read: Vec<Vec<f64>> = run.q.iter().map(|q| taken(q)).collect();
            let column = |v: &Option<Vec<f64>>| v.as_ref().map_or(Vec::new(), |v| taken(v));
            let v: Vec<Vec<f64>> = run.v.iter().map(column).collect();
            let all = |column: &Vec<f64>| vec![!column.is_empty(); rows];
            let paper = options.start != Start::Fitted;
            let mut valid = [
                vec![vec![true; rows]; read.len()],
                v.iter().map(all).collect(),
            ];
            if !paper {
                for (channel, own) in observations.channels.iter().zip(&observed.valid) {
                    valid[usize::from(channel.velocity)][channel.coordinate].clone_from(own);
                }
            }
            Target {
                q: read.clone(),
                read,
                read_v: v.clone(),
                v,
                valid,
            }
        })
        .collect()
}
