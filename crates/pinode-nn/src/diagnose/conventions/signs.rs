//! Signs of many signals at once, by the equations and without a fit. Where each wrong sign hides the others no single one helps, and of n coordinates and as
//! many inputs there are 4ⁿ ways to count.
//!
//! For each choice of the signs of the coordinates the forces τ that the inputs would have to make, [`Needed`], are those of the inputs on each coordinate, times what
//! makes them so, beside a friction:
//!
//! τᵢ ≈ Σⱼ βⱼ uⱼ + dᵢ q̇ᵢ + cᵢ sgn q̇ᵢ + oᵢ.
//!
//! The signs and units of the inputs are those of βⱼ over the gain. What is left over of τᵢ, over the size of M q̈ and of the rest together, ranks the choices.

use nalgebra::DMatrix;

use super::needed::Needed;
use super::reading::{Reading, Signal, unit_of_input};
use super::windows::{Sample, Windows};
use crate::model::Model;

/// So many coordinates have 1024 choices.
const MOST_COORDINATES: usize = 10;
/// So many of the choices are worth a fit.
const LIKELY: usize = 4;
/// What is left over is not told from less than this part.
const FLOOR: f64 = 0.02;
/// Singular values below this part of the largest one are none.
const ALIKE: f64 = 1e-9;

/// Less than this part of an input beside the other columns says nothing of its sign.
const SILENT: f64 = 1e-3;

/// The ways to count that the equations speak for, the likeliest first: choices of signs of what moves, with the signs and units that the inputs have beside them.
/// None where an input acts on a link, or loops are closed.
pub fn likely(windows: &Windows, model: &Model) -> Vec<Vec<Reading>> {
    let n = model.mechanics.coordinates().len();
    let moving: Vec<usize> = (0..n).filter(|c| windows.moves(*c)).collect();
    let Some(on) = driven(model).filter(|_| moving.len() <= MOST_COORDINATES) else {
        return Vec::new();
    };
    let samples = windows.smoothed(&[]);
    if samples.is_empty() {
        return Vec::new();
    }
    let makes: Vec<Makes> = (0..n).map(|c| Makes::on(c, &on, &samples)).collect();
    let choices = (0..1_usize << moving.len()).map(|choice| -> Vec<f64> {
        let mut signs = vec![1.0; n];
        for (k, &c) in moving.iter().enumerate() {
            if choice >> k & 1 == 1 {
                signs[c] = -1.0;
            }
        }
        signs
    });
    let mut ranked: Vec<(f64, Vec<Reading>)> = choices
        .filter_map(|signs| {
            let needed = Needed::of(windows.hybrid(), &samples, &signs)?;
            let (mut left, mut readings) = (0.0, Vec::new());
            for (c, sign) in signs.into_iter().enumerate() {
                readings.push(Reading::of(Signal::Coordinate(c), sign, 0.0));
                let (part, factors) = makes[c].explain(&needed, c);
                left += part;
                let inputs = makes[c].inputs.iter().zip(factors);
                let heard = inputs.filter_map(|(&input, factor)| Some((input, factor?)));
                readings.extend(heard.map(|(input, factor)| {
                    let scale = unit_of_input(factor / model.inputs[input].gain);
                    Reading::of(Signal::Input(input), scale, 0.0)
                }));
            }
            readings.retain(Reading::is_other);
            Some((left, readings))
        })
        .filter(|(left, readings)| left.is_finite() && !readings.is_empty())
        .collect();
    ranked.sort_by(|(a, _), (b, _)| a.total_cmp(b));
    let likely = ranked.into_iter().take(LIKELY);
    likely.map(|(_, readings)| readings).collect()
}

/// Σ of the logarithms of what the equations leave over of the forces, squared, with the log read so: however soon a model runs away from its log, and by
/// whatever friction it lacks. None where an input acts on a link, where loops are closed and where there is too little of the log.
pub fn left_over(windows: &Windows, model: &Model, readings: &[Reading]) -> Option<f64> {
    let on = driven(model)?;
    let samples = windows.smoothed(readings);
    if samples.is_empty() {
        return None;
    }
    let n = model.mechanics.coordinates().len();
    let needed = Needed::of(windows.hybrid(), &samples, &vec![1.0; n])?;
    let of_coordinate = |c: usize| Makes::on(c, &on, &samples).explain(&needed, c).0;
    Some((0..n).map(of_coordinate).sum()).filter(|left: &f64| left.is_finite())
}

/// The coordinates that the inputs act on; none where one acts on a link, or loops are closed: what acts then is not the inputs' alone.
fn driven(model: &Model) -> Option<Vec<usize>> {
    let is_open = model.mechanics.constraints().is_none();
    let on = model.inputs.iter().map(|i| i.coordinate());
    is_open.then(|| on.collect())?
}

/// What makes the force on a coordinate.
struct Makes {
    /// The inputs on it.
    inputs: Vec<usize>,
    /// A row a sample: these inputs, and a friction; each over its norm.
    columns: DMatrix<f64>,
    /// The norms.
    norms: Vec<f64>,
    /// Their pseudo-inverse.
    inverse: DMatrix<f64>,
    /// Whether an input is told from the other columns.
    heard: Vec<bool>,
}

impl Makes {
    fn on(coordinate: usize, on: &[usize], samples: &[Sample]) -> Self {
        let inputs: Vec<usize> = (0..on.len()).filter(|i| on[*i] == coordinate).collect();
        let row = |s: &Sample| {
            let driven = inputs.iter().map(|i| s.u[*i]);
            let v = s.v[coordinate];
            let rubs = [v, if v < 0.0 { -1.0 } else { 1.0 }, 1.0];
            driven.chain(rubs).collect::<Vec<f64>>()
        };
        let rows: Vec<f64> = samples.iter().flat_map(row).collect();
        let mut columns = DMatrix::from_row_slice(samples.len(), inputs.len() + 3, &rows);
        let mut norms = Vec::new();
        for mut column in columns.column_iter_mut() {
            norms.push(column.norm().max(f64::MIN_POSITIVE));
            column /= column.norm().max(f64::MIN_POSITIVE);
        }
        let none = DMatrix::zeros(columns.ncols(), columns.nrows());
        let inverted = |columns: &DMatrix<f64>| columns.clone().pseudo_inverse(ALIKE);
        let is_heard = |input: usize| {
            let others = columns.clone().remove_column(input);
            let own = columns.column(input);
            let along = inverted(&others).map(|inverse| &others * (inverse * own));
            along.is_ok_and(|along| (own - along).norm() > SILENT)
        };
        Makes {
            heard: (0..inputs.len()).map(is_heard).collect(),
            inverse: inverted(&columns).unwrap_or(none),
            inputs,
            norms,
            columns,
        }
    }

    /// The logarithm of what is left over of the force on the coordinate, squared, and the factors of the inputs, of those that are heard.
    fn explain(&self, needed: &Needed, coordinate: usize) -> (f64, Vec<Option<f64>>) {
        let force = &needed.forces[coordinate];
        let factors = &self.inverse * force;
        let left = force - &self.columns * &factors;
        let square = left.norm_squared() / force.len().max(1) as f64;
        let part = square / needed.squares[coordinate];
        let factor = |k: usize| self.heard[k].then(|| factors[k] / self.norms[k]);
        (
            (part + FLOOR * FLOOR).ln(),
            (0..self.inputs.len()).map(factor).collect(),
        )
    }
}
