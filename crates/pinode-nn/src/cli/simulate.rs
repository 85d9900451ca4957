//! `pinode simulate`: rolls a model out and writes the trajectory as a log.
//!
//! The columns are t, `q.<coordinate>` and `v.<coordinate>` in the model's order, `u.<input>`, and `run` with a log. The pose of a
//! floating body has seven columns `q.<name>.x`, `.y`, `.z` (m), `.qw`, `.qx`, `.qy`, `.qz` (its unit quaternion), and six
//! `v.<name>.vx`, `.vy`, `.vz` (m/s), `.wx`, `.wy`, `.wz` (rad/s), both in the body's own axes. `--initial` takes the same numbers in
//! the same order; its quaternions are made of length 1.

use std::path::PathBuf;

use lagrange::state;
use serde_json::json;

use super::band::Band;
use super::csv_line::csv_line;
use super::output::Output;
use super::refused;
use super::stepping::{Effort, Stepping};
use crate::Error;
use crate::coarse::CoarseStep;
use crate::disk::{Staged, refuse_overwriting};
use crate::entries::{q_names, starts, v_names};
use crate::free_run::{
    FreeRun, Initial, LONGEST_STEP, initial_states, longest_step as longest_taken, step_warning,
};
use crate::hybrid::Hybrid;
use crate::learnt::{Guard, other_intervals};
use crate::limits;
use crate::log::{Log, Run};
use crate::model::Model;
use crate::poses::{Upright, measured_state};

/// A longer trajectory is refused.
const MOST_SAMPLES: f64 = 1e7;
/// So are more integration steps between two samples.
const MOST_STEPS: f64 = 1e6;
/// Relative tolerance unless another is asked for.
const TOLERANCE: f64 = 1e-6;

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// The model, a TOML file
    model: PathBuf,
    /// Take times, inputs and initial state of every run from this log; with --initial it needs no more than `t` and the inputs
    #[arg(long)]
    log: Option<PathBuf>,
    /// Length, s [default: the log's; 10 without a log]
    #[arg(long, value_name = "S", value_parser = positive, allow_negative_numbers = true)]
    duration: Option<f64>,
    /// Initial state: positions, then velocities; a floating body has seven positions (x y z and a quaternion w x y z) and six
    /// velocities (linear, angular, in its own axes) [default: the log's; 0 and no rotation without a log]
    #[arg(
        long,
        value_name = "Q1,Q2,…,V1,V2,…",
        value_delimiter = ',',
        allow_hyphen_values = true
    )]
    initial: Option<Vec<f64>>,
    /// Interval between samples without a log, s
    #[arg(long, value_name = "S", default_value_t = 0.01, value_parser = positive, allow_negative_numbers = true, conflicts_with = "log")]
    sample: f64,
    /// Longest step of methods with fixed steps, s [default: 0.001]
    #[arg(long, value_name = "S", value_parser = positive, allow_negative_numbers = true)]
    step: Option<f64>,
    /// Method of integration
    #[arg(long, value_enum, default_value_t)]
    method: Stepping,
    /// Relative tolerance of methods whose steps adapt, for the error of one step; positions below 1 mm or 1 mrad and velocities below
    /// 1 mm/s or 1 mrad/s count as these (velocities under dry friction as the one its sign change is spread over) [default: 1e-6]
    #[arg(long, value_name = "R", value_parser = positive, allow_negative_numbers = true)]
    tolerance: Option<f64>,
    /// The trajectory, in the format of a log: positions as the sensors would read them without noise, velocities of the model
    #[arg(long, value_name = "TRAJ.csv")]
    out: PathBuf,
    /// Write the standard deviations of q and v over the members of an ensemble, each rolled out from the same state, and the half-widths of the band that
    /// holds 95 % of what is measured, where the model has one
    #[arg(long, value_name = "BAND.csv")]
    band: Option<PathBuf>,
}

/// A positive, finite number.
pub(super) fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x.is_finite() && x > 0.0 => Ok(x),
        Ok(x) if x > 0.0 => Err(format!("{x} is not finite")),
        Ok(x) => Err(format!("{x} is not positive")),
        Err(e) => Err(e.to_string()),
    }
}

pub(super) fn run(arguments: &Arguments, output: &Output) -> Result<(), Error> {
    let model = output.load_model(&arguments.model)?;
    let outputs: Vec<PathBuf> = std::iter::once(&arguments.out)
        .chain(&arguments.band)
        .cloned()
        .collect();
    let mut inputs = model.files();
    inputs.extend(arguments.log.as_deref());
    refuse_overwriting(&outputs, &inputs)?;
    let with_run = arguments.log.is_some();
    let mut band = Band::of(&model, arguments.band.as_ref(), with_run)?;
    let step = longest_step(arguments)?;
    let tolerance = arguments.tolerance.unwrap_or(TOLERANCE);
    let given = match &arguments.initial {
        Some(initial) => Some(given_initial(&model, initial)?),
        None => None,
    };
    let runs = match &arguments.log {
        // From a given state, the inputs are all that it takes of a log.
        Some(path) if given.is_some() => output.told(Log::read_inputs(path, &model)?).runs,
        Some(path) => output.read_log(path, &model)?.runs,
        None => vec![still_run(&model, arguments)?],
    };
    let mut text = header(&model, arguments.log.is_some());
    let (mut samples, mut effort) = (0, Effort::default());
    let all: Vec<&Run> = runs.iter().collect();
    let (mut taken, mut warnings) = (step, other_intervals(&model, &all));
    let mut guard = Guard::new(&model);
    let mut told_limits = false;
    let visible = model.mechanics.nq() + model.mechanics.nv();
    for mut run in runs {
        if let Some(duration) = arguments.duration {
            shorten(&mut run, duration);
            warnings.extend(ends_early(&run, duration));
        }
        let initial = match (&given, &arguments.log) {
            (Some(given), _) => given.clone(),
            (None, Some(_)) if model.has_poses() => measured_state(&model, &run, 0),
            (None, Some(_)) => {
                let measured = initial_states(&model, &run, Initial::Measured);
                let hybrid = Hybrid::of(&model);
                let over = FreeRun::new(&hybrid, &run.t, &run.u, step);
                let behind = over.with_hidden(measured).into_iter().next();
                behind.map_or_else(|| at_rest(&model), |state| state[..visible].to_vec())
            }
            (None, None) => at_rest(&model),
        };
        let initial = consistent(&model, &run.id, initial, output)?;
        let fineness = (step, tolerance);
        let states = arguments
            .method
            .simulate(&model, &run, &initial, fineness, &mut effort)?;
        samples += states.len();
        if let Stepping::Fixed(scheme) = arguments.method {
            let coarse = CoarseStep::of(scheme, &model, (&run.t, &run.u), &states, step);
            warnings.extend(coarse.map(|coarse| coarse.warning(&run.id)));
            let longest = longest_taken(&run.t, f64::INFINITY, step);
            warnings.extend(step_warning(&run.id, longest, step));
            taken = taken.max(longest);
        }
        let moved = states.iter().map(|state| state[..visible].to_vec());
        let moved: Vec<Vec<f64>> = moved.collect();
        warnings.extend(Upright::of(&model, &run.t, &moved).map(|near| near.warning(&run.id)));
        if !told_limits {
            let beyond = limits::warning(&model, &run.id, &run.t, &moved);
            told_limits = beyond.is_some();
            warnings.extend(beyond);
        }
        guard.watch(&run.id, &run.t, &run.u, &moved);
        if let Some(band) = &mut band {
            let run = (&run, with_run);
            band.roll(arguments.method, run, &initial, fineness, output);
        }
        let id = arguments.log.is_some().then_some(run.id.as_str());
        write_rows(&mut text, &model, &run, id, &states)?;
    }
    let mut staged = vec![Staged::write(&arguments.out, &text)?];
    if let Some(band) = &band {
        staged.extend(band.stage()?);
    }
    staged.into_iter().try_for_each(Staged::commit)?;
    let path = arguments.out.display().to_string();
    warnings.extend(band.as_ref().and_then(Band::warning));
    let left_training = guard.departures();
    output.departures(&left_training);
    output.warnings(&warnings);
    let mut document = json!({
        "out": path, "samples": samples, "left_training": left_training, "warnings": warnings,
    });
    let mut text = format!("{samples} samples written to {path}\n");
    match arguments.method {
        Stepping::Fixed(_) => document["longest_step_s"] = json!(taken),
        Stepping::Adapting(_) => {
            document["relative_tolerance"] = json!(tolerance);
            document["effort"] = effort.document();
            text += &effort.words();
        }
    }
    if let Some(band) = &band {
        document["band"] = band.document();
        text += &band.words();
    }
    output.result(&document, &text)
}

/// The longest step of methods with fixed steps.
///
/// # Errors
/// What contradicts the method among `--step` and `--tolerance`, and steps that would never end.
fn longest_step(arguments: &Arguments) -> Result<f64, Error> {
    let step = arguments.step.unwrap_or(LONGEST_STEP);
    let wrong = match arguments.method {
        Stepping::Adapting(_) => arguments.step.map(|step| {
            (
                "--step",
                format!(
                    "a longest step of {step} s is for methods with fixed steps: leave it out, or take --method rk4; how fine steps that \
                     adapt are is said by --tolerance"
                ),
            )
        }),
        Stepping::Fixed(_) => match arguments.tolerance {
            Some(tolerance) => Some((
                "--tolerance",
                format!(
                    "a tolerance of {tolerance} is for methods whose steps adapt: take --method adaptive, or leave it out and give --step"
                ),
            )),
            None if arguments.log.is_none() && arguments.sample / step > MOST_STEPS => Some((
                "--step",
                format!(
                    "{step:e} s is more than {MOST_STEPS:e} times shorter than the interval between samples: take a longer step"
                ),
            )),
            None => None,
        },
    };
    match wrong {
        Some((option, wrong)) => refused(option, vec![wrong]).map(|()| step),
        None => Ok(step),
    }
}

/// Under constraints, the state on φ = 0, J v = 0 that belongs to `initial`; where it is another one, that is said.
fn consistent(
    model: &Model,
    run: &str,
    initial: Vec<f64>,
    output: &Output,
) -> Result<Vec<f64>, Error> {
    let Some(constraints) = model.mechanics.constraints() else {
        return Ok(initial);
    };
    let (q, v) = initial.split_at(model.mechanics.nq());
    let (q, v) = constraints.project_with(q, v, &[], &model.parameter_values)?;
    let consistent: Vec<f64> = q.into_iter().chain(v).collect();
    let moved = consistent.iter().zip(&initial).map(|(a, b)| (a - b).abs());
    let most = moved.fold(0.0, f64::max);
    if most > 1e-9 {
        output.note(&format!(
            "run `{run}`: the initial state does not obey the constraints; it starts at the nearest one that does (in the metric \
             of the mass matrix): {}",
            consistent
                .iter()
                .map(|x| format!("{x:.6}"))
                .collect::<Vec<_>>()
                .join(", ")
        ));
    }
    Ok(consistent)
}

/// The state of all zeros, floating bodies not rotated.
fn at_rest(model: &Model) -> Vec<f64> {
    let mut state = state::neutral(model.mechanics.coordinates());
    state.resize(state.len() + model.mechanics.nv(), 0.0);
    state
}

/// What `--initial` says, with quaternions of length 1.
fn given_initial(model: &Model, initial: &[f64]) -> Result<Vec<f64>, Error> {
    let coordinates = model.mechanics.coordinates();
    let mut wrong = Vec::new();
    let names = [q_names(coordinates), v_names(coordinates)].concat();
    if initial.len() != names.len() {
        wrong.push(format!(
            "{} numbers are given, the state has {}: {}",
            initial.len(),
            names.len(),
            names.join(",")
        ));
    }
    if let Some(x) = initial.iter().find(|x| !x.is_finite()) {
        wrong.push(format!("{x} is not finite"));
    }
    let mut initial = initial.to_vec();
    for (coordinate, start) in coordinates.iter().zip(starts(coordinates)) {
        let quaternion = initial.get(start.q + 3..start.q + 7).unwrap_or_default();
        if coordinate.floating && wrong.is_empty() && quaternion.iter().all(|x| *x == 0.0) {
            wrong.push(format!(
                "the quaternion of `{}` is 0 and gives no orientation: give 1,0,0,0 for none",
                coordinate.name
            ));
        }
    }
    refused("--initial", wrong)?;
    if let Some(q) = initial.get_mut(..model.mechanics.nq()) {
        state::normalize(coordinates, q);
    }
    Ok(initial)
}

/// The times of a recording in which nothing is measured and all inputs are 0.
fn still_run(model: &Model, arguments: &Arguments) -> Result<Run, Error> {
    let duration = arguments.duration.unwrap_or(10.0);
    if arguments.sample > duration {
        let long = format!(
            "{} s from sample to sample is longer than the {duration} s of the run: take a shorter interval, or a longer --duration",
            arguments.sample
        );
        refused("--sample", vec![long])?;
    }
    let steps = (duration / arguments.sample).round();
    if steps > MOST_SAMPLES {
        let many =
            format!("{steps:e} samples are too many: take a shorter duration or a longer --sample");
        refused("--duration", vec![many])?;
    }
    let t: Vec<f64> = (0..=steps as usize)
        .map(|k| k as f64 * arguments.sample)
        .collect();
    let zeros = vec![0.0; t.len()];
    Ok(Run {
        id: "0".into(),
        q: Vec::new(),
        v: Vec::new(),
        u: vec![zeros; model.inputs.len()],
        t,
    })
}

/// Where a run does not last as long as was asked for.
fn ends_early(run: &Run, duration: f64) -> Option<String> {
    let (first, last) = (run.t.first()?, run.t.last()?);
    let lasts = last - first;
    (lasts < (1.0 - 1e-6) * duration).then(|| {
        format!(
            "run `{}`: the trajectory lasts {lasts:.6} s, not {duration} s: there are no samples after that, and no inputs",
            run.id
        )
    })
}

/// Leaves the first `duration` s.
pub(super) fn shorten(run: &mut Run, duration: f64) {
    let Some(&start) = run.t.first() else {
        return;
    };
    // Half a microsecond of grace: a sample at the very end stays in spite of rounding.
    let count = run.t.partition_point(|t| t - start <= duration + 5e-7);
    run.t.truncate(count);
    for column in run.q.iter_mut().chain(&mut run.u) {
        column.truncate(count);
    }
    for column in run.v.iter_mut().flatten() {
        column.truncate(count);
    }
}

/// The line of the columns, in which names stand in quotation marks where they need to.
fn header(model: &Model, with_run: bool) -> Vec<u8> {
    let coordinates = model.mechanics.coordinates();
    let mut names = vec!["t".to_owned()];
    names.extend(q_names(coordinates));
    names.extend(v_names(coordinates));
    names.extend(model.inputs.iter().map(|input| format!("u.{}", input.name)));
    if with_run {
        names.push("run".into());
    }
    csv_line(&names)
}

/// All digits that tell a number from its neighbours; without a row of zeros before them.
fn digits(x: f64) -> String {
    match x != 0.0 && x.abs() < 1e-5 {
        true => format!("{x:e}"),
        false => x.to_string(),
    }
}

fn write_rows(
    text: &mut Vec<u8>,
    model: &Model,
    run: &Run,
    id: Option<&str>,
    states: &[Vec<f64>],
) -> Result<(), Error> {
    let mut writer = csv::Writer::from_writer(text);
    let mut record = csv::StringRecord::new();
    let coordinates = model.mechanics.coordinates();
    let hybrid = Hybrid::of(model);
    let readings = hybrid.readings(&hybrid.theta(), &[]);
    let (nq, nx) = (model.mechanics.nq(), states.first().map_or(0, Vec::len));
    let flat = states.concat();
    let times = run.t.get(..states.len()).unwrap_or(&run.t);
    for (k, (state, t)) in states.iter().zip(&run.t).enumerate() {
        record.clear();
        record.push_field(&digits(*t));
        // What the sensors read; the pose of a floating body has none.
        let mut velocities = Vec::with_capacity(nx);
        for ((coordinate, start), reading) in
            coordinates.iter().zip(starts(coordinates)).zip(&readings)
        {
            let at = (start.q, nq + start.v);
            if coordinate.floating {
                let pose = state.get(start.q..start.q + coordinate.nq());
                pose.unwrap_or_default()
                    .iter()
                    .for_each(|q| record.push_field(&digits(*q)));
                let twist = state.get(at.1..at.1 + coordinate.nv());
                velocities.extend_from_slice(twist.unwrap_or_default());
            } else {
                let q = reading.position(at, nx, &flat, times, k).value;
                record.push_field(&digits(q));
                velocities.push(reading.velocity(at, nx, &flat, times, k).value);
            }
        }
        for v in velocities {
            record.push_field(&digits(v));
        }
        for u in run.u.iter().filter_map(|column| column.get(k)) {
            record.push_field(&digits(*u));
        }
        if let Some(id) = id {
            record.push_field(id);
        }
        writer
            .write_record(&record)
            .map_err(|e| Error::io(std::path::Path::new("memory"), e.into()))?;
    }
    writer
        .flush()
        .map_err(|e| Error::io(std::path::Path::new("memory"), e))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What dies away had three hundred zeros in a row: a log of 10⁷ samples had 3.9 GB.
    #[test]
    fn small_numbers_are_written_with_an_exponent_and_read_back_as_they_were() {
        for x in [0.0, -0.25, 1e-5, 3.25e-6, -6.868e-310, 1.0 / 3.0, 1e15] {
            let written = digits(x);
            assert_eq!(written.parse(), Ok(x), "{written}");
            assert!(written.len() < 25, "{written}");
        }
    }
}
