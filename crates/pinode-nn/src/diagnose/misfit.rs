//! How far residuals exceed the noise of the sensors.

use super::study::{Fitted, Study};

/// Residual over sensor noise beyond which a model does not explain the data: on a displacement, on an angle.
const UNEXPLAINED: (f64, f64) = (1.6, 5.0);

/// The largest residual of a channel over its limit.
fn misfit(study: &Study, fitted: &Fitted) -> f64 {
    let (linear, angular) = UNEXPLAINED;
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

/// Whether a residual is larger than its limit, so many times the noise of its sensor.
pub fn is_unexplained(study: &Study, fitted: &Fitted) -> bool {
    misfit(study, fitted) > 1.0
}

/// The share of the misfit of `null` that `model` explains, on a logarithmic scale: 1 where what is left does not exceed
/// its limits, 0 where nothing is explained. A name for a small part of a large misfit may stand in for what is really missing.
pub fn explained(study: &Study, null: &Fitted, model: &Fitted) -> f64 {
    let (before, after) = (misfit(study, null), misfit(study, model));
    if after <= 1.0 {
        1.0
    } else if after < before {
        (before / after).ln() / before.ln()
    } else {
        0.0
    }
}
