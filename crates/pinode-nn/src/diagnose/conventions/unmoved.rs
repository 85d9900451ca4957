//! Coordinates that never move in a log though the equations ask them to: a sensor that is dead, or a joint that something holds.

use super::signs::{Needed, Sample};
use super::windows::Windows;
use crate::Error;
use crate::entries::q_names;
use crate::error::Unmoved;
use crate::log::Log;
use crate::model::Model;

/// What holds a coordinate, over the inputs on it and the forces of the model together, is no error of the model above this part.
const HELD: f64 = 0.3;
/// Nor is any force below this part of the largest on a coordinate.
const NOTHING: f64 = 1e-4;

/// Refuses logs in which a coordinate is read as the same number throughout while the force
///
/// r = M q̈ + C q̇ + G − Q
///
/// that would hold it there, with the others moving as they do, is a good part of those on the right. Nothing can be said of what the model lacks where its
/// state is not known, and the search for it takes minutes.
///
/// # Errors
/// [`Error::Unmoved`], with all such coordinates.
pub fn refuse_unmoved(model: &Model, logs: &[Log]) -> Result<(), Error> {
    let coordinates = model.mechanics.coordinates();
    let names = q_names(coordinates);
    let runs = || logs.iter().flat_map(|log| &log.runs);
    let constant = |c: usize| {
        let mut readings = runs().flat_map(|run| &run.q[c]);
        let first = *readings.next()?;
        let samples = 1 + readings.clone().count();
        readings.all(|x| *x == first).then_some((first, samples))
    };
    let still = (0..names.len()).filter_map(|c| Some((c, constant(c)?)));
    let still: Vec<(usize, (f64, usize))> = still.collect();
    if still.is_empty() || still.len() == names.len() {
        return Ok(());
    }
    let Some(windows) = Windows::of(model, logs) else {
        return Ok(());
    };
    // The accelerations of what hardly moves are noise, and so are the forces that these take.
    let is_still = |c: usize| still.iter().any(|(other, _)| *other == c);
    if !(0..names.len()).any(|c| !is_still(c) && windows.moves(c)) {
        return Ok(());
    }
    let samples = windows.smoothed();
    let ones = vec![1.0; names.len()];
    let Some(needed) = Needed::of(windows.hybrid(), &samples, &ones) else {
        return Ok(());
    };
    let largest = needed.squares.iter().copied().fold(0.0, f64::max);
    let held = |(c, (value, samples_read)): (usize, (f64, usize))| {
        let inputs = || model.inputs.iter().enumerate();
        let on_it = |s: &Sample| -> f64 {
            let on_it = inputs().filter(|(_, input)| input.coordinate() == Some(c));
            on_it.map(|(i, input)| input.gain * s.u[i]).sum()
        };
        let pushed: Vec<f64> = samples.iter().map(on_it).collect();
        let mean_square = |x: &mut dyn Iterator<Item = f64>| {
            x.map(|x| x * x).sum::<f64>() / samples.len().max(1) as f64
        };
        let holding = mean_square(&mut pushed.iter().zip(&needed.forces[c]).map(|(u, f)| f - u));
        let all = mean_square(&mut pushed.iter().copied()) + needed.squares[c];
        let least = (HELD * HELD * all).max(NOTHING * NOTHING * largest);
        (holding > least).then(|| Unmoved {
            column: names[c].clone(),
            value,
            unit: coordinates[c].unit(),
            samples: samples_read,
            force: holding.sqrt(),
            force_unit: coordinates[c].force_unit(),
        })
    };
    let held: Vec<Unmoved> = still.into_iter().filter_map(held).collect();
    match held.is_empty() {
        true => Ok(()),
        false => Err(Error::Unmoved { columns: held }),
    }
}
