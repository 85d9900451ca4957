//! What an environment takes and what it shows, number by number.

use super::EnvironmentError;

/// One number of an action or of an observation.
#[derive(Debug, Clone, PartialEq)]
pub struct Channel {
    /// As in logs: `u.motor`, `q.pole`, `v.pole`.
    pub name: String,
    /// Its least value; −∞ where there is none.
    pub lower: f64,
    /// Its largest value; ∞ where there is none.
    pub upper: f64,
}

impl Channel {
    /// A number between two bounds.
    pub fn new(name: impl Into<String>, lower: f64, upper: f64) -> Self {
        Channel {
            name: name.into(),
            lower,
            upper,
        }
    }

    /// A number without bounds.
    pub fn unbounded(name: impl Into<String>) -> Self {
        Channel::new(name, f64::NEG_INFINITY, f64::INFINITY)
    }

    /// Whether `value` is a number within the bounds.
    pub fn contains(&self, value: f64) -> bool {
        self.lower <= value && value <= self.upper && value.is_finite()
    }

    /// `value`, or the bound that it is beyond; NaN stays NaN.
    pub fn clip(&self, value: f64) -> f64 {
        if value < self.lower {
            self.lower
        } else if value > self.upper {
            self.upper
        } else {
            value
        }
    }

    /// Refuses bounds that hold no number.
    pub(super) fn check(&self) -> Result<(), EnvironmentError> {
        let finite_between = self.lower <= self.upper
            && self.lower < f64::INFINITY
            && self.upper > f64::NEG_INFINITY;
        match finite_between {
            true => Ok(()),
            false => Err(EnvironmentError::Bounds {
                channel: self.name.clone(),
                lower: self.lower,
                upper: self.upper,
            }),
        }
    }
}
