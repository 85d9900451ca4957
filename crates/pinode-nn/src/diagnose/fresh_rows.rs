//! Logs that are written more often than their sensors are read: rows in which every reading is that of the row before.
//!
//! A sensor that is read at 60 Hz and logged at 200 repeats each reading three or four times. Between its readings it says nothing, and taken for new ones the repetitions are late: by
//! up to the time between two of them, which a lag, a delay or an elastic drive explains. What is left here are the rows with a new reading, and between them inputs with the same
//! mean. A coarse encoder repeats as well where it moves slowly; but then one step is as large as another, and where it moves fast every row is new.

use std::borrow::Cow;

use super::verdict::DataFault;
use crate::effect::Between;
use crate::log::{Log, Run};
use crate::model::Model;

/// The kind of these faults.
const KIND: &str = "repeated_rows";
/// So many new readings tell.
const FEWEST: usize = 100;
/// Readings are this many rows apart at most.
const FARTHEST: usize = 100;
/// Of them so large a part is two rows apart or more …
const APART: f64 = 0.99;
/// … and so large a part as far as is usual, or one row more or less: at rest some are farther.
const REGULAR: f64 = 0.8;
/// Where so large a part of the steps are as small as the least, it is an encoder that moves slowly.
const SINGLE_STEPS: f64 = 0.5;

/// The logs without the rows in which nothing is new, and what was left out; that one sensor of several repeats is said.
pub fn fresh<'a>(model: &Model, logs: &'a [Log]) -> (Cow<'a, [Log]>, Vec<DataFault>) {
    let runs = logs.iter().flat_map(|log| &log.runs);
    let new: Vec<Option<Vec<usize>>> = runs.map(|run| new_rows(&columns(run))).collect();
    let faults = faults(model, logs, &new);
    if new.iter().all(Option::is_none) {
        return (Cow::Borrowed(logs), faults);
    }
    let mut thinned = logs.to_vec();
    let runs = thinned.iter_mut().flat_map(|log| &mut log.runs);
    for (run, rows) in runs.zip(new) {
        if let Some(rows) = rows {
            *run = at_rows(model, run, &rows);
        }
    }
    (Cow::Owned(thinned), faults)
}

/// What is measured in a recording.
fn columns(run: &Run) -> Vec<&Vec<f64>> {
    run.q.iter().chain(run.v.iter().flatten()).collect()
}

/// What is said of each position, by the first recording in which it repeats.
fn faults(model: &Model, logs: &[Log], new: &[Option<Vec<usize>>]) -> Vec<DataFault> {
    let coordinates = model.mechanics.coordinates().iter().enumerate();
    let of_coordinate = |(c, coordinate): (usize, &lagrange::Coordinate)| {
        let runs = logs.iter().flat_map(|log| &log.runs).zip(new);
        let mut repeating = runs.filter_map(|(run, all)| {
            let own = || new_rows(&[run.q.get(c)?]);
            let rows = all.clone().or_else(own)?;
            Some((run, rows, all.is_some()))
        });
        let (run, rows, is_left_out) = repeating.next()?;
        let so = match is_left_out {
            true => {
                "they are left out here, and between two readings inputs that are held count by their mean"
            }
            false => {
                "other columns do not, and all rows are taken as they stand: what looks like a delay of this sensor is half the time between two readings or so"
            }
        };
        let duration = run.t[run.len() - 1] - run.t[0];
        Some(DataFault {
            kind: KIND.into(),
            column: format!("q.{}", coordinate.name),
            when: Vec::new(),
            detail: format!(
                "a new reading comes every {:.1} rows, {:.0} times a second, and the rows between repeat it: {so}. Log a row when the sensor is read, or read it for every row",
                run.len() as f64 / rows.len() as f64,
                rows.len() as f64 / duration.max(f64::MIN_POSITIVE)
            ),
        })
    };
    coordinates.filter_map(of_coordinate).collect()
}

/// The rows in which there is something new in some columns of a recording, where these are fewer than all and regular.
fn new_rows(columns: &[&Vec<f64>]) -> Option<Vec<usize>> {
    let is_new = |k: usize| columns.iter().any(|y| y[k] != y[k - 1]);
    let count = columns.first().map_or(0, |y| y.len());
    let changes: Vec<usize> = (1..count).filter(|&k| is_new(k)).collect();
    let gaps: Vec<usize> = changes.windows(2).map(|p| p[1] - p[0]).collect();
    if gaps.len() < FEWEST {
        return None;
    }
    let mut sorted = gaps.clone();
    sorted.sort_unstable();
    let usual = sorted[sorted.len() / 2];
    let share = |of: &dyn Fn(usize) -> bool| {
        let such = gaps.iter().filter(|gap| of(**gap));
        such.count() as f64 / gaps.len() as f64
    };
    let is_regular = (2..=FARTHEST).contains(&usual)
        && share(&|gap| gap >= 2) >= APART
        && share(&|gap| gap.abs_diff(usual) <= 1) >= REGULAR;
    let is_slow = columns.iter().all(|y| goes_by_single_steps(y, &changes));
    if !is_regular || is_slow {
        return None;
    }
    // A reading that is as the one before was read all the same, and so were those before the first and behind the last.
    let first = changes.first().map_or(0, |first| first % usual);
    let mut rows = vec![first];
    for &k in changes.iter().chain([&count]) {
        while let Some(&last) = rows.last()
            && k > last + usual + usize::from(k < count)
        {
            rows.push(last + usual);
        }
        if k < count && rows.last() != Some(&k) {
            rows.push(k);
        }
    }
    Some(rows)
}

/// Whether most changes of a column are of its least size, or it has none.
fn goes_by_single_steps(y: &[f64], changes: &[usize]) -> bool {
    let steps = changes.iter().map(|&k| (y[k] - y[k - 1]).abs());
    let steps: Vec<f64> = steps.filter(|step| *step > 0.0).collect();
    let least = steps.iter().copied().fold(f64::INFINITY, f64::min);
    let single = steps.iter().filter(|step| **step < 1.5 * least).count();
    single as f64 >= SINGLE_STEPS * steps.len() as f64
}

/// A recording at some of its rows, in rising order; between two of them inputs that are held have the same mean.
fn at_rows(model: &Model, run: &Run, rows: &[usize]) -> Run {
    let pick = |y: &Vec<f64>| -> Vec<f64> { rows.iter().map(|&k| y[k]).collect() };
    let mean = |u: &[f64], from: usize, to: usize| {
        let held = (from..to).map(|k| u[k] * (run.t[k + 1] - run.t[k]));
        held.sum::<f64>() / (run.t[to] - run.t[from])
    };
    let inputs = run.u.iter().zip(&model.inputs);
    let inputs = inputs.map(|(u, input)| match input.between {
        Between::Smooth => pick(u),
        Between::Held => {
            let means = rows.windows(2).map(|pair| mean(u, pair[0], pair[1]));
            means.chain(rows.last().map(|&k| u[k])).collect()
        }
    });
    Run {
        id: run.id.clone(),
        t: pick(&run.t),
        q: run.q.iter().map(pick).collect(),
        v: run.v.iter().map(|v| v.as_ref().map(pick)).collect(),
        u: inputs.collect(),
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::panic, clippy::unwrap_used)]

    use super::*;

    /// A swing that comes to rest, of a sensor with noise and of one with steps, read at some rows.
    fn swing(step: f64, read_at: impl Fn(usize) -> usize) -> Vec<f64> {
        let noise = |k: usize| 1e-4 * (12.9898 * k as f64).sin();
        let at = |k: usize| {
            let t = 0.005 * k as f64;
            let q = (-0.2 * t).exp() * (4.0 * t).sin();
            match step > 0.0 {
                true => (q / step).round() * step,
                false => q + noise(k),
            }
        };
        (0..3000).map(|k| at(read_at(k))).collect()
    }

    #[test]
    fn rows_between_two_readings_are_found_whether_these_are_every_third_or_come_as_they_come() {
        let third = new_rows(&[&swing(0.0, |k| k / 3 * 3)]);
        assert_eq!(
            third.as_deref().map(|rows| &rows[..3]),
            Some(&[0, 3, 6][..])
        );
        let encoder = new_rows(&[&swing(1e-3, |k| k / 3 * 3)]);
        assert!(encoder.is_some_and(|rows| rows.iter().all(|k| k % 3 == 0)));
        // 60 Hz in a log at 200: three rows or four.
        let sixty = |k: usize| ((k as f64 * 0.3).floor() / 0.3).ceil() as usize;
        let rows = new_rows(&[&swing(0.0, sixty)]).unwrap_or_default();
        assert!((895..=901).contains(&rows.len()), "{}", rows.len());
    }

    #[test]
    fn between_two_readings_held_inputs_have_the_same_mean_and_it_is_said() {
        let text = "name = \"swing\"\nlagrangian = { coordinates = [\"x\"], kinetic = \"x_dot^2\", potential = \"0\" }\n\
             [[input]]\nname = \"held\"\njoint = \"x\"\n\
             [[input]]\nname = \"smooth\"\njoint = \"x\"\nbetween_samples = \"smooth\"\n";
        let model = Model::parse("swing.toml".as_ref(), text.to_owned()).unwrap();
        let u: Vec<f64> = (0..3000).map(f64::from).collect();
        let log = |q: Vec<f64>| Log {
            path: "log.csv".into(),
            sha256: String::new(),
            warnings: Vec::new(),
            runs: vec![Run {
                id: "0".into(),
                t: u.iter().map(|k| 0.005 * k).collect(),
                v: vec![None],
                u: vec![u.clone(); 2],
                q: vec![q],
            }],
        };
        let logs = [log(swing(0.0, |k| k / 3 * 3))];
        let (thinned, faults) = fresh(&model, &logs);
        let run = &thinned[0].runs[0];
        assert_eq!(run.q[0][..3], [0, 3, 6].map(|k| logs[0].runs[0].q[0][k]));
        assert!((run.t[2] - 0.03).abs() < 1e-12, "{:?}", run.t);
        // 3, 4 and 5 from the second reading to the third.
        assert!((run.u[0][1] - 4.0).abs() < 1e-9 && run.u[1][1] == 3.0);
        let [fault] = &faults[..] else {
            panic!("{faults:?}")
        };
        assert_eq!((&*fault.kind, &*fault.column), (KIND, "q.x"));
        assert!(
            fault.detail.contains("every 3.0 rows, 67 times a second"),
            "{}",
            fault.detail
        );
        let logs = [log(swing(0.0, |k| k))];
        let (same, faults) = fresh(&model, &logs);
        assert!(matches!(same, Cow::Borrowed(_)) && faults.is_empty());
    }

    /// At rest before and behind, which is where friction holds.
    #[test]
    fn rests_at_both_ends_stay() {
        let moves = swing(1e-3, |k| k / 3 * 3);
        let resting: Vec<f64> = [
            vec![0.0; 300],
            moves[..1500].to_vec(),
            vec![moves[1499]; 301],
        ]
        .concat();
        let rows = new_rows(&[&resting]).unwrap_or_default();
        assert_eq!((rows.first(), rows.last()), (Some(&0), Some(&2100)));
        assert_eq!(rows.len(), 701);
    }

    #[test]
    fn what_is_read_in_every_row_is_left_as_it_is() {
        assert_eq!(new_rows(&[&swing(0.0, |k| k)]), None);
        assert_eq!(new_rows(&[&swing(1e-2, |k| k)]), None, "a coarse encoder");
        let slow: Vec<f64> = (0..3000).map(|k| 1e-3 * (k / 3) as f64).collect();
        assert_eq!(
            new_rows(&[&slow]),
            None,
            "one that goes slowly, at one speed"
        );
    }
}
