//! Coordinates that never move in a log though the equations ask them to: a sensor that is dead, or a joint that something holds.

use integrators::event::Direction;
use nalgebra::DVector;

use super::needed::Needed;
use super::windows::{Sample, Windows};
use crate::Error;
use crate::entries::q_names;
use crate::error::Unmoved;
use crate::log::Log;
use crate::model::{EffectEntry, Model, Target};

/// What holds a coordinate varies by this part of what acts on it, or more: what is constant may be a model that is a little off, or a load that it does not know.
const HELD: f64 = 0.3;
/// What it varies by is beyond so many times the friction that the model knows there.
const STRONGER: f64 = 2.0;
/// Inputs that follow what is needed to hold it so closely, by whatever factor, do hold it: a servo that is logged in other units.
const FOLLOWS: f64 = 0.5;

/// Refuses logs in which a coordinate is read as the same number throughout while the force
///
/// r = M q̈ + C q̇ + G − Q
///
/// that would hold it there, with the others moving as they do, varies by a good part of those on the right, and the inputs on it do not follow that. Nothing can be
/// said of what the model lacks where its state is not known, and the search for it takes minutes. What the model knows to remember, to stop or to change an input is
/// not asked, nor where loops are closed or inputs act on links.
///
/// # Errors
/// [`Error::Unmoved`], with all such coordinates.
pub fn refuse_unmoved(model: &Model, logs: &[Log]) -> Result<(), Error> {
    let coordinates = model.mechanics.coordinates();
    let names = q_names(coordinates);
    let constant = |c: usize| {
        let runs = logs.iter().flat_map(|log| &log.runs);
        let mut readings = runs.flat_map(|run| &run.q[c]);
        let first = *readings.next()?;
        let samples = 1 + readings.clone().count();
        readings.all(|x| *x == first).then_some((first, samples))
    };
    let still = (0..names.len()).filter_map(|c| Some((c, constant(c)?)));
    let still: Vec<(usize, (f64, usize))> = still.collect();
    let on: Option<Vec<usize>> = model.inputs.iter().map(|i| i.coordinate()).collect();
    let (Some(on), false, None) = (on, still.is_empty(), model.mechanics.constraints()) else {
        return Ok(());
    };
    let Some(windows) = Windows::of(model, logs) else {
        return Ok(());
    };
    // The accelerations of what hardly moves are noise, and so are the forces that these take.
    let mut samples = windows.smoothed(&[]);
    for sample in &mut samples {
        let own = sample.a.iter_mut().enumerate();
        own.for_each(|(c, a)| *a *= f64::from(windows.moves(c)));
    }
    let ones = vec![1.0; names.len()];
    let Some(needed) = Needed::of(windows.hybrid(), &samples, &ones) else {
        return Ok(());
    };
    let knows_what_holds = |c: usize| {
        model.effects.iter().any(|effect| match effect.target {
            Target::Input(input) => on[input] == c,
            Target::Coordinate(own) => {
                own == c && (effect.kind.stop().is_some() || effect.kind.states() > 0)
            }
            Target::Link(_) => false,
        })
    };
    let friction = |c: usize, q: f64| -> f64 {
        let on_it = model
            .effects
            .iter()
            .filter(|e| e.target == Target::Coordinate(c));
        let size = |e: &EffectEntry| {
            let dry = e.kind.dry()?;
            let sizes = [Direction::Positive, Direction::Negative];
            let sizes = sizes.map(|way| dry.size(way, q, 0.0, &e.values));
            Some(sizes[0].max(sizes[1]))
        };
        on_it.filter_map(size).sum()
    };
    let held = |(c, (value, readings)): (usize, (f64, usize))| {
        let on_it = |s: &Sample| -> f64 {
            let inputs = model.inputs.iter().zip(&s.u).zip(&on);
            let on_it = inputs.filter(|(_, on)| **on == c);
            on_it.map(|((input, u), _)| input.gain * u).sum()
        };
        let pushed = DVector::from_iterator(samples.len(), samples.iter().map(on_it));
        let asked = &needed.forces[c];
        let varying = |x: &DVector<f64>| x.add_scalar(-x.mean());
        let (push, ask) = (varying(&pushed), varying(asked));
        let follows = push.dot(&ask).powi(2) > FOLLOWS * push.norm_squared() * ask.norm_squared();
        let all = pushed.norm_squared() / samples.len().max(1) as f64 + needed.squares[c];
        let holding = (push - ask).norm_squared() / samples.len().max(1) as f64;
        let follows = follows && pushed.norm_squared() > 0.0;
        let is_beyond = holding.sqrt() > HELD * all.sqrt() + STRONGER * friction(c, value);
        let is_held = is_beyond && !follows && !knows_what_holds(c);
        is_held.then(|| Unmoved {
            column: names[c].clone(),
            value,
            unit: coordinates[c].unit(),
            samples: readings,
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
