//! How sharply friction changes its sign, and what steps follow it.

use lagrange::LANES;

use super::{Hybrid, Placed};
use crate::effect::{Room, default_smoothing};

/// Friction with a faster rate about rest than this, 1/s at the usual pace, is stepped implicitly: explicit steps would have to be shorter than a millisecond.
const STIFF: f64 = 2.5e3;
/// Fits sharpen friction up to this part of it, so that what they move does not take it beyond.
const CLOSE_TO_STIFF: f64 = 0.8;
/// The velocity over which friction changes its sign is no more than this part of the speed of what is slow, and no less than this part of the usual one: what is
/// nearly always at rest has no speed.
pub(super) const OF_SPEED: f64 = 0.1;
pub(super) const LEAST_SLOW: f64 = 1e-3;
/// Implicit steps follow friction whose change of sign is spread over so many times less: on what is light and is often held, creeping shows most.
pub(super) const SHARPER: f64 = 0.1;

impl Hybrid {
    /// The velocity over which a sign change of friction of a coordinate is spread unless a model says otherwise, m/s or, of an angle, rad/s; in a fitted model as
    /// much sharper as its own friction was made.
    pub fn default_smoothing(&self, coordinate: usize) -> f64 {
        let own = self.mechanics.coordinates().get(coordinate);
        let slow = self.slow.get(coordinate).copied().unwrap_or(1.0);
        self.unsaid_smoothing(own.is_some_and(|c| c.angular)) * slow * self.sharpness.1
    }

    /// The same as the model's file has it where it says nothing.
    pub(crate) fn unsaid_smoothing(&self, angular: bool) -> f64 {
        default_smoothing(angular) * self.sharpness.0
    }

    /// The fastest rate of dry friction at rest at the [typical](crate::typical) configuration, −(M⁻¹)_jj ∂Q_j/∂v_j, 1/s; 0 where M has no inverse there, where a body
    /// floats and under constraints.
    pub(crate) fn fastest_friction(&self, theta: &[f64]) -> f64 {
        let n = self.nv();
        if self.nq() != n || self.mechanics.constraints().is_some() {
            return 0.0;
        }
        let mut rest = vec![[0.0; LANES]; self.nx()];
        for (lanes, q) in rest.iter_mut().zip(&self.typical) {
            *lanes = [*q; LANES];
        }
        let mut mass = nalgebra::DMatrix::zeros(n, n);
        self.mass_matrix_into(&self.typical, theta, &mut self.memory(&[]), &mut mass);
        let Some(mass) = nalgebra::Cholesky::new(mass) else {
            return 0.0;
        };
        let response = mass.inverse().diagonal();
        let (mut slopes, mut room) = (vec![0.0; n], Room::default());
        for (index, effect) in self.effects.iter().enumerate() {
            if let Some(law) = self.laws[index]
                .as_ref()
                .filter(|_| effect.kind.dry().is_some())
            {
                let at = self.at_joint(index, &rest, theta);
                let [_, slope] = law.slopes_of_eight(&at, &mut room);
                slopes[self.starts[effect.target].v] += slope[0];
            }
        }
        let rates = response.iter().zip(&slopes).map(|(r, slope)| -r * slope);
        rates.fold(0.0, f64::max)
    }

    pub(super) fn stiff_rate(&self) -> f64 {
        STIFF / self.pace
    }

    /// The least factor on the smoothing of dry friction at θ that leaves it slow enough for explicit steps; 0 where the steps are implicit already.
    pub(crate) fn sharpest(&self, theta: &[f64]) -> f64 {
        match self.stiff {
            true => 0.0,
            false => self.fastest_friction(theta) / (CLOSE_TO_STIFF * self.stiff_rate()),
        }
    }

    /// The model with the smoothing of all friction that may stick times `factor`, with implicit steps if it is too fast for others at θ.
    pub(crate) fn sharpened(&self, factor: f64, theta: &[f64]) -> Self {
        let sharp = self.smoothed_by(factor, |placed| placed.kind.dry().is_some());
        let mut sharp = sharp.stepped_for(theta);
        sharp.sharpness.1 *= factor;
        sharp
    }

    /// The same with implicit steps if its dry friction is too fast for others at θ.
    pub(crate) fn stepped_for(mut self, theta: &[f64]) -> Self {
        self.stiff |= self.fastest_friction(theta) > self.stiff_rate();
        self
    }

    /// The same with implicit steps or without, whatever its friction.
    #[cfg(test)]
    pub(crate) fn stepped_implicitly(mut self, stiff: bool) -> Self {
        self.stiff = stiff;
        self
    }

    /// Whether roll-outs take steps that are implicit: dry friction brings a joint to rest at a rate of more than 2500 1/s.
    pub fn is_stiff(&self) -> bool {
        self.stiff
    }

    /// The model with all smoothing velocities times `factor`.
    pub fn with_smoothing_scale(&self, factor: f64) -> Self {
        self.smoothed_by(factor, |_| true)
    }

    /// Gives effects the smoothing velocities that they have in another model.
    pub(crate) fn smooth_as(&mut self, other: &Self) {
        for placed in &mut self.effects {
            if let Some(own) = other.effects.iter().find(|e| e.is_same(placed)) {
                placed.smoothing = own.smoothing;
            }
        }
        (self.sharpness, self.stiff) = (other.sharpness, other.stiff);
    }

    /// The model with the smoothing velocities of these effects times `factor`.
    pub(crate) fn smoothed_by(&self, factor: f64, counts: impl Fn(&Placed) -> bool) -> Self {
        let mut scaled = self.clone();
        for placed in scaled.effects.iter_mut().filter(|e| counts(e)) {
            placed.smoothing *= factor;
        }
        scaled
    }
}
