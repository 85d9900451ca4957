//! What the log itself tells: noise and step of each sensor, outliers, held readings, the clock, starts without effect.

mod blind_band;
mod clock;
mod excitation;
mod held;
mod masked;
mod noise;
mod outliers;
mod overstated;
mod rates;
mod second_look;
mod slips;
mod stamps;
mod start;
mod unlogged_force;

use std::ops::Range;

use super::conventions::CONVENTION;
use super::pace::Pace;
use super::smooth::{outruns_folding, unwrapped};
use super::verdict::DataFault;
use crate::log::{Log, Run};
use crate::model::{Model, Velocity};
use crate::shooting::{Channel, Finer, Observations, ObservedRun};

pub use excitation::excitation;
pub use masked::Masked;
use noise::is_difference;
pub use noise::{Readings, median, noise};
use outliers::Read;
pub use overstated::overstated;
pub use rates::scale_of_time;
pub use second_look::second_look;
use slips::{Slip, Slipped};
pub use unlogged_force::{UNLOGGED_FORCE, is_explained};

/// So many intervals of a fault are listed.
const MOST_LISTED: usize = 100;
/// The kind of a fault of a sensor that is noisier than the model says.
const NOISE: &str = "noise";
/// Readings that scatter more than so many times the declared noise are believed, not the declaration.
const MORE_THAN_DECLARED: f64 = 1.5;
/// A step of the readings more than so many times the declared resolution is a fault.
const COARSER_THAN_DECLARED: f64 = 1.5;
/// A sensor whose range of readings has fewer steps than this is a coarse one.
const FEWEST_STEPS: f64 = 64.0;

/// A sensor without noise does not exist, and simulated logs may have none: its noise is no less than this part of the range of its readings, unless the model
/// declares it. Encoders read positions to seven digits, and integration steps follow them so far; …
const LEAST_OF_POSITIONS: f64 = 1e-7;
/// … nothing reads velocities to more than four. Exact ones beside positions of a usual sensor outweigh these by ten orders of magnitude, in which fits stall,
/// networks learn next to nothing, and steps are made finer than any sensor could tell.
const LEAST_OF_VELOCITIES: f64 = 1e-4;

/// Readings that are held in more than this share of the samples are a sensor's that is stuck, not a sample dropped now and then.
const OFTEN_HELD: f64 = 0.01;

/// What a log is seen to hold.
#[derive(Debug, Clone)]
pub struct Audited {
    /// What was measured. Samples that are faulty by themselves do not count; those outside the stretch of a recording that counts are not there.
    pub observations: Observations,
    /// The first sample of each recording that counts.
    pub firsts: Vec<usize>,
    /// The faults.
    pub faults: Vec<DataFault>,
    /// Stretches that no window may touch.
    pub masked: Masked,
}

/// The observations in a model's logs, and the faults of the data. The logs in `held_out` come last.
pub fn audit(model: &Model, logs: &[Log], held_out: &[Log]) -> Audited {
    let coordinates = model.mechanics.coordinates();
    let nv = coordinates.len();
    let all: Vec<&Run> = logs
        .iter()
        .chain(held_out)
        .flat_map(|log| &log.runs)
        .collect();
    let other_rates: Vec<Option<DataFault>> =
        (0..nv).map(|c| rates::fault(model, &all, c)).collect();
    // Velocities count only where they are measured everywhere, are those of the positions, and not differences of them after all.
    let measured_velocity: Vec<usize> = (0..nv)
        .filter(|&c| {
            model.sensors[c].velocity == Velocity::Measured
                && other_rates[c].is_none()
                && all.iter().all(|run| {
                    run.v[c]
                        .as_ref()
                        .is_some_and(|v| !is_difference(&run.t, &run.q[c], v))
                })
        })
        .collect();

    let mut channels = Vec::new();
    let mut columns: Vec<Vec<Vec<f64>>> = Vec::new();
    for (c, coordinate) in coordinates.iter().enumerate() {
        columns.push(all.iter().map(|run| run.q[c].clone()).collect());
        channels.push(Channel {
            coordinate: c,
            velocity: false,
            wraps: coordinate.wraps && !all.iter().any(|run| outruns_folding(&run.t, &run.q[c])),
            noise: 0.0,
        });
    }
    for &c in &measured_velocity {
        columns.push(
            all.iter()
                .map(|run| run.v[c].clone().unwrap_or_default())
                .collect(),
        );
        channels.push(Channel {
            coordinate: c,
            velocity: true,
            wraps: false,
            noise: 0.0,
        });
    }

    let (times, rounded) = stamps::times(&all);
    let mut faults: Vec<DataFault> = other_rates.into_iter().flatten().collect();
    let mut valid: Vec<Vec<Vec<bool>>> = Vec::new();
    let mut slipped: Vec<Slipped> = Vec::new();
    let mut masked = Masked::none(all.len());
    let mut held: Vec<(usize, [f64; 2])> = Vec::new();
    // The samples of each recording that count.
    let mut counting: Vec<Range<usize>> = all.iter().map(|run| 0..run.len()).collect();
    for (channel, column) in channels.iter_mut().zip(&columns) {
        let smooth: Vec<Vec<f64>> = column
            .iter()
            .map(|y| {
                if channel.wraps {
                    unwrapped(y)
                } else {
                    y.clone()
                }
            })
            .collect();
        let sensor = &model.sensors[channel.coordinate];
        let (column_name, unit) = column_name(model, channel);
        let seen_step = (!channel.velocity)
            .then(|| noise::quantum(&smooth))
            .flatten();
        faults.extend(step_fault(
            &smooth,
            sensor.resolution,
            seen_step,
            (&column_name, &unit),
        ));
        let declared_step = sensor.resolution.unwrap_or(0.0);
        let coarser = |&step: &f64| step > COARSER_THAN_DECLARED * declared_step;
        let step = seen_step.filter(coarser).unwrap_or(declared_step);
        let quantum = step / 12.0_f64.sqrt();
        let declared = sensor.position_noise.filter(|_| !channel.velocity);
        let least = match channel.velocity {
            false => LEAST_OF_POSITIONS,
            true => LEAST_OF_VELOCITIES,
        };
        let readings: Vec<Readings> = times
            .iter()
            .zip(&smooth)
            .map(|(t, y)| Readings { t, y })
            .collect();
        let moving: Vec<Readings> = readings.iter().flat_map(|r| held::moving(*r)).collect();
        let scatters = noise::scatters(&moving);
        let rough = match scatters {
            true => noise(&moving),
            false => noise(&readings),
        };
        let rough = of_sensor(rough, declared, quantum, (&smooth, least));
        let holds: Vec<Vec<[usize; 2]>> = smooth
            .iter()
            .map(|y| held::holds(y, rough, scatters))
            .collect();
        // What is held has no noise.
        let parts = readings.iter().zip(&holds);
        let parts: Vec<Readings> = parts
            .flat_map(|(readings, holds)| held::without(*readings, holds))
            .collect();
        let seen = noise(&parts);
        faults.extend(noise_fault(seen, declared, (&column_name, &unit)));
        channel.noise = of_sensor(seen, declared, quantum, (&smooth, least));
        // A blow changes velocities at once.
        let slips: Vec<Vec<Slip>> = match channel.velocity {
            true => vec![Vec::new(); all.len()],
            false => all
                .iter()
                .zip(&smooth)
                .zip(&holds)
                .map(|((run, y), holds)| slips::slips(&run.t, y, holds, channel.noise))
                .collect(),
        };
        let mut marked: Vec<Vec<bool>> = readings
            .iter()
            .zip(&holds)
            .zip(&slips)
            .map(|((readings, holds), slips)| {
                let what = match channel.velocity {
                    true => Read::Velocity,
                    false => Read::Position,
                };
                let mut valid = outliers::without_outliers(*readings, channel.noise, what);
                // A jump at the end of a hold, and one that stays, is no reading that stands alone.
                let slips = slips.iter().map(|slip| [slip.at, slip.at - 1]);
                for [first, last] in holds.iter().copied().chain(slips) {
                    let end = (last + 3).min(valid.len());
                    valid[first.saturating_sub(2)..end].fill(true);
                }
                valid
            })
            .collect();
        let when: Vec<[f64; 2]> = all
            .iter()
            .zip(&marked)
            .flat_map(|(run, marks)| {
                let times = marks.iter().enumerate().filter(|(_, valid)| !**valid);
                times.map(|(k, _)| [run.t[k], run.t[k]]).collect::<Vec<_>>()
            })
            .collect();
        if !when.is_empty() {
            faults.push(DataFault {
                kind: "outliers".into(),
                column: column_name.clone(),
                detail: format!(
                    "{} of {} samples stand alone, far from both neighbours; they are left out of all fits",
                    when.len(),
                    smooth.iter().map(Vec::len).sum::<usize>()
                ),
                when: when.into_iter().take(MOST_LISTED).collect(),
            });
        }
        faults.extend(hold_fault(&all, &holds, &mut marked, &column_name));
        for (r, holds) in holds.iter().enumerate() {
            for &[first, last] in holds {
                counting[r] = held::beside(counting[r].clone(), first..last + 1);
                held.push((r, [all[r].t[first], all[r].t[last]]));
            }
        }
        slipped.push(Slipped {
            slips,
            column: column_name,
            unit,
        });
        valid.push(marked);
    }
    faults.extend(clock::clock_faults(&all, &mut masked));
    faults.extend(rounded);
    for (counting, end) in
        counting
            .iter_mut()
            .zip(start::dead_starts(model, &all, &channels, &mut faults))
    {
        *counting = held::beside(counting.clone(), 0..end);
    }
    let kept = slips::kept(counting, &slipped);
    faults.extend(slips::faults(&all, &slipped, &kept));

    let runs = all
        .iter()
        .enumerate()
        .map(|(r, run)| {
            let kept = || kept[r].clone();
            ObservedRun {
                finer: Finer::default(),
                t: times[r][kept()].to_vec(),
                u: run.u.iter().map(|u| u[kept()].to_vec()).collect(),
                y: columns
                    .iter()
                    .map(|column| column[r][kept()].to_vec())
                    .collect(),
                valid: valid
                    .iter()
                    .map(|marks| marks[r][kept()].to_vec())
                    .collect(),
            }
        })
        .collect();
    let observations = Observations { channels, runs };
    // A window without a sensor says little of what is missing.
    let window = Pace::of(&observations).window();
    for (r, [from, to]) in held {
        if to - from > window {
            masked.add(r, [from, to]);
        }
    }
    Audited {
        observations,
        firsts: kept.iter().map(|kept| kept.start).collect(),
        faults,
        masked,
    }
}

/// The noise of a sensor whose readings scatter by `seen`: as declared with its steps, where what is seen does not contradict it; else no less than the `least`
/// part of its range.
fn of_sensor(
    seen: f64,
    declared: Option<f64>,
    quantum: f64,
    (smooth, least): (&[Vec<f64>], f64),
) -> f64 {
    let noise = match declared {
        Some(declared) if seen <= MORE_THAN_DECLARED * declared => declared.hypot(quantum),
        Some(_) => seen,
        None => seen.max(quantum),
    };
    if declared.is_some() && noise > 0.0 {
        return noise;
    }
    // The middle nine tenths tell the range.
    let mut sorted: Vec<f64> = smooth.iter().flatten().copied().collect();
    sorted.sort_by(f64::total_cmp);
    let at = |share: usize| {
        let place = sorted.len() * share / 20;
        sorted.get(place).copied().unwrap_or(0.0)
    };
    noise.max(least * (at(19) - at(1)).max(1e-9))
}

/// The column of a log in which a channel is, and its unit.
fn column_name(model: &Model, channel: &Channel) -> (String, String) {
    let coordinate = &model.mechanics.coordinates()[channel.coordinate];
    let (name, unit) = (&coordinate.name, coordinate.unit());
    match channel.velocity {
        false => (format!("q.{name}"), unit.to_owned()),
        true => (format!("v.{name}"), format!("{unit}/s")),
    }
}

/// Readings that scatter more than the model says.
fn noise_fault(
    seen: f64,
    declared: Option<f64>,
    (column, unit): (&str, &str),
) -> Option<DataFault> {
    let declared = declared.filter(|declared| seen > MORE_THAN_DECLARED * declared)?;
    Some(DataFault {
        kind: NOISE.into(),
        column: column.to_owned(),
        when: Vec::new(),
        detail: format!(
            "the readings scatter by {seen:.2e} {unit}, the model declares {declared:.2e}; the scatter is taken"
        ),
    })
}

/// Whether a fault is one that no model of the mechanism could explain, and not the odd bad reading that every log has.
pub fn contradicts(fault: &DataFault) -> bool {
    [
        CONVENTION,
        "dead_start",
        "blind_zone",
        UNLOGGED_FORCE,
        "stuck",
        "slip",
    ]
    .contains(&fault.kind.as_str())
}

/// A sensor that reads in coarser steps than declared, or in so coarse ones that little of the motion is left.
fn step_fault(
    smooth: &[Vec<f64>],
    declared: Option<f64>,
    seen: Option<f64>,
    (column, unit): (&str, &str),
) -> Option<DataFault> {
    let seen = seen?;
    let all = || smooth.iter().flatten().copied();
    let range = all().fold(f64::NEG_INFINITY, f64::max) - all().fold(f64::INFINITY, f64::min);
    let detail = match declared {
        Some(declared) if seen > COARSER_THAN_DECLARED * declared => format!(
            "the readings come in steps of {seen:.3e} {unit}, the model declares {declared:.3e}; the steps are taken"
        ),
        None if range < FEWEST_STEPS * seen => format!(
            "the readings come in steps of {seen:.3e} {unit}, {:.0} over their whole range; what moves less cannot be seen",
            range / seen
        ),
        _ => return None,
    };
    Some(DataFault {
        kind: "quantum".into(),
        column: column.to_owned(),
        when: Vec::new(),
        detail,
    })
}

/// Readings that are held: `dropped_samples`, or `stuck` where they are many. They are marked as not valid.
fn hold_fault(
    runs: &[&Run],
    holds: &[Vec<[usize; 2]>],
    marked: &mut [Vec<bool>],
    column: &str,
) -> Option<DataFault> {
    let mut when = Vec::new();
    let mut samples = 0;
    for ((run, holds), marks) in runs.iter().zip(holds).zip(marked) {
        for &[first, last] in holds {
            when.push([run.t[first], run.t[last]]);
            samples += last + 1 - first;
            marks[first..=last].fill(false);
        }
    }
    let all = runs.iter().map(|run| run.len()).sum::<usize>();
    let often = samples as f64 > OFTEN_HELD * all as f64;
    (!when.is_empty()).then(|| DataFault {
        kind: if often { "stuck" } else { "dropped_samples" }.into(),
        column: column.to_owned(),
        detail: format!(
            "{samples} of {all} samples repeat the one before, in {} {}, and jump afterwards, or are many of a sensor whose readings scatter; \
             they are left out of all fits",
            when.len(),
            if when.len() == 1 { "stretch" } else { "stretches" }
        ),
        when: when.into_iter().take(MOST_LISTED).collect(),
    })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use std::path::Path;

    use super::*;

    /// The faults of a published recording; `None`, loudly, where it is not.
    fn faults(name: &str) -> Option<Vec<DataFault>> {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let beside = root.join("../shared/data").display().to_string();
        let folder = std::env::var("PINODE_DATA").unwrap_or(beside);
        let path = Path::new(&folder).join(name).join("data.csv");
        if !path.exists() {
            eprintln!("SKIPPED: no recording at {}", path.display());
            return None;
        }
        let model = root.join(format!("models/{name}/{name}.toml"));
        let model = Model::load(&model).unwrap();
        let log = Log::read(&path, &model).unwrap();
        Some(audit(&model, &[log], &[]).faults)
    }

    #[test]
    fn healthy_recordings_have_readings_that_stand_alone_at_most() {
        for name in ["emps", "silverbox", "map_single_pendulum"] {
            for fault in faults(name).unwrap_or_default() {
                let healthy = ["outliers", "rounded_stamps"];
                assert!(healthy.contains(&fault.kind.as_str()), "{name}: {fault:?}");
            }
        }
    }

    /// Its voltage has no effect until t = 0.55 s or so, in every one of ten recordings.
    #[test]
    fn the_dead_start_of_a_real_cart_is_found_with_its_times() {
        let Some(faults) = faults("quanser_cartpole") else {
            return;
        };
        let dead = faults.iter().find(|f| f.kind == "dead_start").unwrap();
        assert_eq!((dead.column.as_str(), dead.when.len()), ("u.motor", 10));
        for &[from, to] in &dead.when {
            assert!(from == 0.0 && (0.4..0.7).contains(&to), "{dead:?}");
        }
    }
}
