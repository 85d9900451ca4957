//! How far residuals exceed the noise of the sensors.

use super::study::{Fitted, Study};

/// Residual over sensor noise beyond which a model does not explain the data: on a displacement, on an angle.
pub const UNEXPLAINED: (f64, f64) = (1.6, 5.0);

/// The largest residual of a channel over its limit, in units of the sensor's noise: on a displacement, on an angle.
fn misfit(study: &Study, fitted: &Fitted, (linear, angular): (f64, f64)) -> f64 {
    let coordinates = fitted.hybrid.mechanics().coordinates();
    let excess = fitted.excess(&study.observations);
    let channels = excess.into_iter().zip(&study.observations.channels);
    channels
        .map(
            |(excess, channel)| match coordinates[channel.coordinate].angular {
                true => excess / angular,
                false => excess / linear,
            },
        )
        .fold(0.0, f64::max)
}

/// Whether a residual is larger than its limit.
pub fn is_unexplained(study: &Study, fitted: &Fitted, limits: (f64, f64)) -> bool {
    misfit(study, fitted, limits) > 1.0
}

/// The share of the misfit of `null` that `model` explains, on a logarithmic scale: 1 where what is left does not exceed
/// [`UNEXPLAINED`], 0 where nothing is explained. A name for a small part of a large misfit may stand in for what is really missing.
pub fn explained(study: &Study, null: &Fitted, model: &Fitted) -> f64 {
    let of = |fitted| misfit(study, fitted, UNEXPLAINED);
    let (before, after) = (of(null), of(model));
    if after <= 1.0 {
        1.0
    } else if after < before {
        (before / after).ln() / before.ln()
    } else {
        0.0
    }
}
