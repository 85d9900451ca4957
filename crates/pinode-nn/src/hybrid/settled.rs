//! Constants that do what an effect does too: what is known of one of them says what is left for the effect.

use std::ops::Range;

use super::{Hybrid, Placed};
use crate::effect::Action;

/// Drives through which a gain passes as it is.
const LINEAR: [&str; 3] = ["input_gain_error", "input_delay", "actuator_lag"];

impl Hybrid {
    /// The same motion with each gain as the model gives it, where an error of it is free to take over what it has from there: along their product a fit creeps, and
    /// ends where neither is.
    pub(crate) fn settled(&self, mut theta: Vec<f64>) -> Vec<f64> {
        let effects: Vec<(&Placed, Range<usize>)> = self
            .effects
            .iter()
            .zip(self.ranges.iter().cloned())
            .filter(|(effect, _)| matches!(effect.kind.action, Action::Drive(_)))
            .collect();
        for (effect, range) in &effects {
            // What is exact takes nothing over.
            let is_free = self.constants[range.start].tolerance > 0.0;
            if !is_free || effect.kind.name != "input_gain_error" {
                continue;
            }
            let mut beside = effects.iter().filter(|(e, _)| e.target == effect.target);
            let index = self.gain_index(effect.target);
            let (known, gain) = (self.constants[index].value, theta[index]);
            let error = (1.0 + theta[range.start]) * gain / known - 1.0;
            let spec = &effect.kind.parameters[0];
            let is_possible = error > spec.lower && error < spec.upper;
            if is_possible && beside.all(|(e, _)| LINEAR.contains(&e.kind.name)) {
                (theta[index], theta[range.start]) = (known, error);
            }
        }
        theta
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::effect::registry;
    use crate::model::Model;

    #[test]
    fn an_error_of_a_gain_takes_over_what_the_gain_has_where_they_multiply_the_same() {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models");
        let model = Model::load(&path.join("cartpole/cartpole.toml")).unwrap();
        let with = |kinds: &[(&str, f64)]| {
            let mut hybrid = Hybrid::of(&model);
            for (kind, value) in kinds {
                let placed = Placed {
                    kind: registry::find(kind).unwrap(),
                    target: 0,
                    smoothing: 0.0,
                    fixed: false,
                };
                hybrid.add(placed, &[*value]);
            }
            let mut theta = hybrid.theta();
            theta[hybrid.gain_index(0)] *= 0.6;
            (hybrid, theta)
        };
        let force = |hybrid: &Hybrid, theta: &[f64]| -> Vec<f64> {
            let t: Vec<f64> = (0..20).map(|k| 0.02 * f64::from(k)).collect();
            let u = vec![t.iter().map(|t| (9.0 * t).sin()).collect()];
            hybrid.drive(&t, &u, 2, theta, &[]).forces[0].value.clone()
        };
        let late = [("input_delay", 0.03), ("input_gain_error", -2.5)];
        let (hybrid, theta) = with(&late);
        let settled = hybrid.settled(theta.clone());
        assert_ne!(settled, theta);
        assert_eq!(
            settled[hybrid.gain_index(0)],
            hybrid.theta()[hybrid.gain_index(0)]
        );
        for (a, b) in force(&hybrid, &settled).iter().zip(force(&hybrid, &theta)) {
            assert!((a - b).abs() < 1e-12, "{a} {b}");
        }
        // An error that is exact takes nothing over.
        let (mut hybrid, theta) = with(&late);
        let error = hybrid.constants_mut().last_mut();
        error.unwrap().tolerance = 0.0;
        assert_eq!(hybrid.settled(theta.clone()), theta);
        // Behind a dead zone a gain is no gain of what comes before it; without an error there is nothing to take over.
        for other in [
            &[("input_dead_zone", 0.2), ("input_gain_error", 0.1)][..],
            &[],
        ] {
            let (hybrid, theta) = with(other);
            assert_eq!(hybrid.settled(theta.clone()), theta);
        }
    }
}
