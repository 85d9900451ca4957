//! What a network was trained on, so that a roll-out can be told when it leaves it.
//!
//! The range of each quantity says little of several together: most of a box in five dimensions is empty. So points are kept that cover the training
//! data, chosen one after the other where the data are farthest from those chosen before (Gonzalez 1985). Quantities count as shares of their ranges,
//! ξ = (x − low)/(high − low), and the distance of two states is the largest difference of a ξ. Every state of the training data is within the
//! reach of a point; a state that is well beyond the reach of all is unlike anything that was seen, though each of its quantities may be in its range.

use super::{Feature, LearntForce};

/// At most so many points cover the training data.
const MOST_POINTS: usize = 256;
/// Less than this share of a range is no difference: neither beyond an end of it, nor between states.
pub const MARGIN: f64 = 0.05;

/// A state is unlike the training where the nearest point is farther than the reach by this factor. A cart-pole's network that sees five quantities,
/// trained on 60 s, found 7 % of the samples of a fresh minute of the same kind outside by the reach itself, 0.4 % by this; of a minute under inputs
/// twice as large 43 %, 32 % by ranges alone.
const SLACK: f64 = 1.5;

/// Points that cover what a network was trained on.
#[derive(Debug, Clone, PartialEq)]
pub struct Region {
    /// ξ of all features, point after point.
    points: Vec<f32>,
    /// No state of the training data is farther from a point.
    reach: f64,
}

/// How a state is outside of what a network was trained on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Outside {
    /// Features are beyond the ends of their ranges, this one by the largest share of its range.
    Range(usize),
    /// Each is in its range, and no state like this was seen: the distance to the nearest point is this.
    Unlike(f64),
}

impl Region {
    /// Covers `states`, each as long as there are features; none without a state.
    fn cover(features: &[Feature], states: &[Vec<f64>]) -> Option<Self> {
        let shares = |x: &Vec<f64>| -> Vec<f32> {
            let each = features.iter().zip(x);
            each.map(|(feature, x)| share(feature, *x)).collect()
        };
        let states: Vec<Vec<f32>> = states.iter().map(shares).collect();
        let mut next = states.first()?;
        let mut nearest = vec![f32::INFINITY; states.len()];
        let mut region = Region {
            points: Vec::new(),
            reach: MARGIN,
        };
        for _ in 0..MOST_POINTS {
            let point = next;
            region.points.extend(point);
            let mut farthest = 0.0;
            for (distance, state) in nearest.iter_mut().zip(&states) {
                *distance = distance.min(apart(point, state));
                if *distance > farthest {
                    farthest = *distance;
                    next = state;
                }
            }
            region.reach = MARGIN.max(f64::from(farthest));
            if f64::from(farthest) <= MARGIN {
                break;
            }
        }
        Some(region)
    }

    /// From a file: points of `features` numbers each.
    pub(super) fn of(points: Vec<f32>, features: usize, reach: f64) -> Option<Self> {
        let whole = features > 0 && !points.is_empty() && points.len().is_multiple_of(features);
        let finite = points.iter().all(|x| x.is_finite()) && reach.is_finite() && reach > 0.0;
        (whole && finite).then_some(Region { points, reach })
    }

    /// ξ of all features, point after point.
    pub fn points(&self) -> &[f32] {
        &self.points
    }

    /// No state of the training data is farther than this from a point, as a share of the ranges.
    pub fn reach(&self) -> f64 {
        self.reach
    }

    /// The distance from a state to the nearest point.
    fn distance(&self, features: &[Feature], x: &[f64]) -> f64 {
        let state: Vec<f32> = features.iter().zip(x).map(|(f, x)| share(f, *x)).collect();
        let points = self.points.chunks_exact(state.len().max(1));
        f64::from(
            points
                .map(|point| apart(point, &state))
                .fold(f32::INFINITY, f32::min),
        )
    }
}

/// ξ; 0 of what never moved in training: its range alone counts.
fn share(feature: &Feature, x: f64) -> f32 {
    let [low, high] = feature.range;
    match high > low {
        true => ((x - low) / (high - low)) as f32,
        false => 0.0,
    }
}

/// The largest difference of a ξ.
fn apart(a: &[f32], b: &[f32]) -> f32 {
    let differences = a.iter().zip(b).map(|(a, b)| (a - b).abs());
    differences.fold(0.0, f32::max)
}

impl Feature {
    /// How far `x` is beyond the range, as a share of it; 0 inside.
    pub(super) fn beyond(&self, x: f64) -> f64 {
        let [low, high] = self.range;
        let excess = (low - x).max(x - high);
        match excess > 0.0 {
            // What never moved has no range to take a share of; rounding is no motion.
            true if high == low => match excess > 1e-9 * low.abs() {
                true => f64::INFINITY,
                false => 0.0,
            },
            true => excess / (high - low),
            false => 0.0,
        }
    }
}

impl LearntForce {
    /// The same force, with these states, rows of values of its [`features`](Self::features), as what it was trained on.
    #[must_use]
    pub fn trained_on(mut self, states: &[Vec<f64>]) -> Self {
        if states.is_empty() {
            return self;
        }
        for (k, feature) in self.features.iter_mut().enumerate() {
            let values = || states.iter().filter_map(|x| x.get(k).copied());
            feature.range = [
                values().fold(f64::INFINITY, f64::min),
                values().fold(f64::NEG_INFINITY, f64::max),
            ];
        }
        self.region = Region::cover(&self.features, states);
        self
    }

    /// Points that cover what it was trained on; none in files that have only ranges.
    pub fn region(&self) -> Option<&Region> {
        self.region.as_ref()
    }

    /// How the state `x`, values of its [`features`](Self::features), is outside of what it was trained on; none where it is not.
    ///
    /// A quantity is beyond its range by more than [`MARGIN`] of it, or no state like this one was seen: the nearest point is half as far again as its reach.
    pub fn outside(&self, x: &[f64]) -> Option<Outside> {
        let beyond = self.features.iter().zip(x).map(|(f, x)| f.beyond(*x));
        let farthest = beyond.enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
        if let Some((k, excess)) = farthest
            && excess > MARGIN
        {
            return Some(Outside::Range(k));
        }
        let region = self.region.as_ref()?;
        let distance = region.distance(&self.features, x);
        (distance > SLACK * region.reach).then_some(Outside::Unlike(distance))
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Output, Quantity};
    use super::*;
    use crate::network::{Activation, Mlp, Shape};

    /// A force that sees position and velocity of one joint, trained on an oscillation of 1 m and 2 m/s: an ellipse.
    fn of_an_oscillation() -> LearntForce {
        let shape = Shape::new(&[2, 1], Activation::Relu, Activation::Tanh).unwrap();
        let network = Mlp::from_parameters(shape, vec![0.0; 3]).unwrap();
        let feature = |quantity| Feature {
            quantity,
            offset: 0.0,
            width: 1.0,
            range: [0.0, 0.0],
        };
        let features = vec![
            feature(Quantity::Position(0)),
            feature(Quantity::Velocity(0)),
        ];
        let output = Output {
            coordinate: 0,
            scale: 1.0,
        };
        let states: Vec<Vec<f64>> = (0..1000)
            .map(|k| {
                let phase = 0.0063 * f64::from(k);
                vec![phase.cos(), -2.0 * phase.sin()]
            })
            .collect();
        let force = LearntForce::new(network, features, vec![output], false).unwrap();
        force.trained_on(&states)
    }

    #[test]
    fn the_oscillation_that_was_trained_on_is_inside() {
        let force = of_an_oscillation();
        for k in 0..777 {
            let phase = 0.0081 * f64::from(k);
            assert_eq!(force.outside(&[phase.cos(), -2.0 * phase.sin()]), None);
        }
        let region = force.region().unwrap();
        assert!(region.reach() <= MARGIN && region.points().len() < 2 * 60);
    }

    #[test]
    fn a_faster_motion_is_beyond_the_range_of_its_velocity() {
        let force = of_an_oscillation();
        assert_eq!(force.outside(&[0.0, 2.5]), Some(Outside::Range(1)));
        // A little beyond an end of the range is no news.
        assert_eq!(force.outside(&[0.0, 2.1]), None);
    }

    #[test]
    fn rest_in_the_middle_of_an_oscillation_is_in_both_ranges_and_was_never_seen() {
        let force = of_an_oscillation();
        let Some(Outside::Unlike(distance)) = force.outside(&[0.0, 0.0]) else {
            panic!("the middle of the ellipse was never seen")
        };
        // The nearest state is half a range away in one quantity; at (√½, √2) it is 0.35 of the range in both.
        assert!((distance - 0.35).abs() < 0.02, "{distance}");
    }

    #[test]
    fn what_never_moved_in_training_is_outside_as_soon_as_it_moves() {
        let force = of_an_oscillation().trained_on(&[vec![0.3, -1.0], vec![0.3, 1.0]]);
        assert_eq!(force.outside(&[0.3, 1.0]), None);
        assert_eq!(force.outside(&[0.31, 1.0]), Some(Outside::Range(0)));
    }
}
