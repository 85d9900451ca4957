//! How far apart two models are in an experiment.

use nalgebra::{Cholesky, DMatrix, DVector};
use rayon::prelude::*;

use super::super::study::{Fitted, Study};
use super::menu::Trial;
use super::simulate::{Simulated, Simulator};
use crate::shooting::Fit;

/// So many standard errors of the log the constants may move.
const OPEN: f64 = 3.0;

/// The readings of `a` less those of `b` over the sensor's noise, over the first `count` samples; one column a coordinate.
pub fn difference(study: &Study, a: &Simulated, b: &Simulated, count: usize) -> Vec<Vec<f64>> {
    let columns = a.readings.iter().zip(&b.readings);
    columns
        .zip(&study.observations.channels)
        .map(|((a, b), channel)| {
            let pairs = a.iter().zip(b).take(count);
            pairs
                .map(|(a, b)| channel.difference(*a, *b) / channel.noise)
                .collect()
        })
        .collect()
}

/// Root mean square of each column.
pub fn root_mean_squares(columns: &[Vec<f64>]) -> Vec<f64> {
    let of = |column: &Vec<f64>| {
        let squares: f64 = column.iter().map(|d| d * d).sum();
        (squares / column.len().max(1) as f64).sqrt()
    };
    columns.iter().map(of).collect()
}

/// The root mean square differences, one a coordinate, that remain when the constants of both models have been moved to bring the two
/// together, as far as the log allows.
///
/// With d the difference of the readings over the noise, X its change by one standard error of each constant, and P the information of
/// the log on them in this unit: d + X δ for the δ that has the least |d + X δ|² among those with δᵀ P δ ≤ 9. X is the secant of one
/// standard error, since friction that sticks has no derivative. Constants that the log leaves open altogether stay.
pub fn least(
    study: &Study,
    models: [&Fitted; 2],
    trial: &Trial,
    substeps: usize,
    simulated: &[Simulated; 2],
    count: usize,
) -> Vec<f64> {
    let apart = difference(study, &simulated[0], &simulated[1], count);
    let samples = apart.first().map_or(0, Vec::len);
    let d = DVector::from_vec(apart.concat());
    let mut columns: Vec<Vec<f64>> = Vec::new();
    let mut blocks: Vec<DMatrix<f64>> = Vec::new();
    for (which, (model, at)) in models.iter().zip(simulated).enumerate() {
        // The difference is that of the first model less the second.
        let side = if which == 0 { 1.0 } else { -1.0 };
        let simulator = Simulator::new(study, &model.hybrid, trial, substeps);
        let moved: Vec<Option<Vec<f64>>> = steps(model)
            .into_par_iter()
            .map(|(index, step)| {
                let mut theta = model.inside.theta.clone();
                *theta.get_mut(index)? += step?;
                let other = simulator.run(&theta)?;
                let column = difference(study, &other, at, count).concat();
                let finite = column.len() == d.len() && column.iter().all(|x| x.is_finite());
                finite.then(|| column.iter().map(|x| side * x).collect())
            })
            .collect();
        let kept: Vec<usize> = (0..moved.len()).filter(|&k| moved[k].is_some()).collect();
        blocks.push(information(&model.inside, &kept, model));
        columns.extend(moved.into_iter().flatten());
    }
    let n = columns.len();
    let x = DMatrix::from_fn(d.len(), n, |i, j| columns[j][i]);
    let mut p = DMatrix::zeros(n, n);
    let mut at = 0;
    for block in &blocks {
        let size = block.nrows();
        p.view_mut((at, at), (size, size)).copy_from(block);
        at += size;
    }
    let left = match within(&x, &p, &d) {
        Some(delta) => &d + &x * delta,
        None => d,
    };
    let left: Vec<Vec<f64>> = left
        .as_slice()
        .chunks(samples.max(1))
        .map(<[f64]>::to_vec)
        .collect();
    root_mean_squares(&left)
}

/// The free constants of a model, by their index in θ, with a step of one standard error within the bounds; `None` where the log says
/// nothing of one, or holds it between its bounds.
fn steps(model: &Fitted) -> Vec<(usize, Option<f64>)> {
    let errors = model.inside.standard_errors();
    let free = model.inside.free.iter().zip(errors);
    free.map(|(&index, error)| {
        let constant = &model.hybrid.constants()[index];
        let value = model.inside.theta[index];
        let fits = |step: &f64| (constant.lower..=constant.upper).contains(&(value + step));
        let sides = [error, -error];
        let step = sides
            .into_iter()
            .find(fits)
            .filter(|_| error.is_finite() && error > 0.0);
        (index, step)
    })
    .collect()
}

/// The information of the log on the `kept` ones of the free constants, each in units of its step: the nominal one, which says how they
/// depend on each other, with the standard errors of the sandwich.
fn information(fit: &Fit, kept: &[usize], model: &Fitted) -> DMatrix<f64> {
    let n = kept.len();
    let own = DMatrix::from_fn(n, n, |i, j| fit.information[(kept[i], kept[j])]);
    let Some(inverse) = Cholesky::new(own.clone()).map(|c| c.inverse()) else {
        return DMatrix::identity(n, n);
    };
    let steps = steps(model);
    let unit: Vec<f64> = (0..n)
        .map(|i| {
            let step = steps[kept[i]].1.unwrap_or(1.0);
            inverse[(i, i)].sqrt() * step.signum()
        })
        .collect();
    DMatrix::from_fn(n, n, |i, j| unit[i] * own[(i, j)] * unit[j])
}

/// The δ with the least |d + X δ|² among those with δᵀ P δ ≤ 9: (Xᵀ X + λ P) δ = −Xᵀ d, the least λ that keeps within.
fn within(x: &DMatrix<f64>, p: &DMatrix<f64>, d: &DVector<f64>) -> Option<DVector<f64>> {
    if x.ncols() == 0 {
        return None;
    }
    let square = x.transpose() * x;
    let gradient = x.transpose() * d;
    let at = |exponent: f64| -> Option<(DVector<f64>, f64)> {
        let matrix = &square + p * 10f64.powf(exponent);
        let delta = -Cholesky::new(matrix)?.solve(&gradient);
        let size = delta.dot(&(p * &delta)).sqrt();
        size.is_finite().then_some((delta, size))
    };
    let (mut low, mut high) = (-6.0, 15.0);
    if let Some((delta, size)) = at(low)
        && size <= OPEN
    {
        return Some(delta);
    }
    let mut best = None;
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        match at(middle) {
            Some((delta, size)) if size <= OPEN => {
                high = middle;
                best = Some(delta);
            }
            _ => low = middle,
        }
    }
    best
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[test]
    fn what_is_open_takes_away_no_more_than_three_standard_errors() {
        // One constant that moves all readings by 2: the difference of 10 noises shrinks by 3·2, one of 4 vanishes.
        let x = DMatrix::from_element(50, 1, 2.0);
        let p = DMatrix::identity(1, 1);
        for (apart, left) in [(10.0, 4.0), (4.0, 0.0)] {
            let d = DVector::from_element(50, apart);
            let delta = within(&x, &p, &d).unwrap();
            let rest = (&d + &x * &delta).amax();
            assert!((rest - left).abs() < 1e-3, "{apart}: {rest}");
        }
    }
}
