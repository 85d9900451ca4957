//! What is left that no effect explains: on which coordinates, and what it follows there.

use super::audit::Masked;
use super::curves::ResidualForce;
use super::last_resort::Sitting;
use super::locate::locate;
use super::search::Search;
use super::setup::Prepared;
use super::shapes::Follows;
use super::study::{Fitted, Study};
use super::unexplained::describe;
use super::verdict::{Gap, Unexplained};
use crate::learnt::Quantity;
use crate::model::Model;

/// It is off beside a network where free runs or windows leave so many times what they should.
const STILL_OFF: f64 = 4.0;

/// A coordinate of which the fits and the free runs leave less than this part of what they leave of the worst, in units of their noises, is not what is off.
const WITHIN: f64 = 0.25;

/// What is left, and what is known of it.
pub struct Leftover<'a> {
    /// The model as given.
    pub model: &'a Model,
    /// The data of the diagnosis.
    pub study: &'a Study,
    /// What a network of it needs to know of the logs.
    pub sitting: Sitting<'a>,
    /// The coordinate that is off.
    pub own: Off,
    /// The others that a force is left on.
    pub others: Vec<Off>,
}

/// A coordinate on which a force is left.
pub struct Off {
    /// The coordinate.
    pub coordinate: usize,
    /// Root mean square of the force, N or N·m.
    pub rms: f64,
    /// What it follows, where windows that were set aside hint at it.
    pub follows: Option<Follows>,
    /// The signals that it follows most.
    pub signals: Vec<Quantity>,
}

/// On which coordinates the model is off, by what is left of each: not on those that stay within their noise while another leaves it.
fn off(left: &[f64]) -> Vec<bool> {
    let most = left.iter().copied().fold(0.0, f64::max);
    left.iter().map(|&x| x >= WITHIN * most).collect()
}

/// What a fitted model leaves on each coordinate in its windows or in free runs, whichever is more, in units of the noise.
fn left(study: &Study, fitted: &Fitted, gap: &Gap) -> Vec<f64> {
    let excess = fitted.excess(&study.observations);
    let pairs = gap.coordinates.iter().zip(excess);
    pairs.map(|(free, excess)| free.after.max(excess)).collect()
}

/// Whether it leaves far more than it should on each.
fn is_far(study: &Study, fitted: &Fitted, gap: &Gap) -> Vec<bool> {
    let excess = fitted.excess(&study.observations);
    let pairs = gap.coordinates.iter().zip(excess);
    let far =
        pairs.map(|(free, excess)| free.after > STILL_OFF * free.expected || excess > STILL_OFF);
    far.collect()
}

impl<'a> Leftover<'a> {
    /// What is left, in words, and what a network would be taught of it. `None` where too little is.
    pub fn of(
        model: &'a Model,
        (study, search): (&'a Study, &Search),
        prepared: &Prepared,
        (masked, gap): (&Masked, &Gap),
        sitting: Sitting<'a>,
    ) -> Option<(Unexplained, Self)> {
        let inputs = sitting.inputs;
        let (smoothed, half_width) = (&prepared.smoothed, prepared.study.pace.half_width());
        let fitted = &search.model;
        let (_, all) = locate(study, fitted, smoothed, half_width, inputs, masked);
        let coordinates = model.mechanics.coordinates();
        let left = search.left.as_ref();
        let there = left.map(|left| coordinates[left.coordinate].name.as_str());
        let named = |force: &&ResidualForce| Some(force.coordinate.as_str()) == there;
        let off = off(&self::left(study, fitted, gap));
        let is_off = |force: &&ResidualForce| {
            let mut coordinates = coordinates.iter().zip(&off);
            coordinates.any(|(c, off)| *off && c.name == force.coordinate)
        };
        let worst = || all.iter().find(is_off).or(all.first());
        let force = all.iter().find(named).or_else(worst)?;
        let c = coordinates
            .iter()
            .position(|c| c.name == force.coordinate)?;
        let left = left.filter(|left| left.coordinate == c);
        let (words, signals) = describe(study, fitted, (force, c), left, inputs)?;
        let hint = fitted.hint(study, true);
        let own = Off {
            coordinate: c,
            rms: words.rms,
            follows: hint.filter(|h| h.coordinate == c).map(|h| h.follows),
            signals,
        };
        let others = all.iter().filter_map(|force| {
            let mut names = coordinates.iter();
            let other = names.position(|own| own.name == force.coordinate)?;
            if other == c {
                return None;
            }
            let (words, signals) = describe(study, fitted, (force, other), None, inputs)?;
            Some(Off {
                coordinate: other,
                rms: words.rms,
                follows: None,
                signals,
            })
        });
        let leftover = Leftover {
            model,
            study,
            sitting,
            own,
            others: others.collect(),
        };
        Some((words, leftover))
    }

    /// The coordinates that are off, the worst first, with the others that a fitted model leaves far more than it should on.
    pub fn all_off(&self, fitted: &Fitted, gap: &Gap) -> Vec<&Off> {
        let (far, off) = (
            is_far(self.study, fitted, gap),
            off(&left(self.study, fitted, gap)),
        );
        let outputs = |c: usize| {
            let networks = self.model.networks.iter();
            let mut outputs = networks.flat_map(|network| network.force.outputs());
            outputs.any(|output| output.coordinate == c)
        };
        let is_off = |other: &&Off| {
            let c = other.coordinate;
            far.get(c) == Some(&true) && off.get(c) == Some(&true) && !outputs(c)
        };
        [&self.own]
            .into_iter()
            .chain(self.others.iter().filter(is_off))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A satellite whose wheel is 30 noises off does not lack a force on its resting height.
    #[test]
    fn what_stays_within_its_noise_while_another_coordinate_leaves_it_is_not_off() {
        assert_eq!(off(&[1.1, 0.9, 30.0]), [false, false, true]);
        assert_eq!(off(&[12.0, 30.0]), [true, true]);
        assert_eq!(off(&[1.0, 0.9]), [true, true]);
    }
}
