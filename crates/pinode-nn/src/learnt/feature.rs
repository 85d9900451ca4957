//! What a network sees of a state: positions, their cosines and sines, velocities, and the inputs' forces, also those of some samples ago.
//!
//! z_k = (x_k − o_k)/w_k.

use lagrange::{Coordinate, LANES, Lanes, Scalar};
use pulp::{Simd, WithSimd};

use crate::entries::Start;
use crate::hybrid::{DrivenInputs, Eight, Lane};
use crate::processor::Processor;

/// A quantity that a network may see.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Quantity {
    /// The position of this coordinate, m or rad.
    Position(usize),
    /// The cosine of this coordinate, an angle.
    Cosine(usize),
    /// The sine of this coordinate, an angle.
    Sine(usize),
    /// The velocity of this coordinate, m/s or rad/s.
    Velocity(usize),
    /// The generalized force gain · ū of this input, N or N·m, after the effects of its drive.
    Input {
        /// Which input.
        input: usize,
        /// As it was so many samples of the log ago.
        back: usize,
    },
}

impl Quantity {
    /// Its name in weights' files: `q.pole`, `cos(q.pole)`, `sin(q.pole)`, `v.pole`, `u.motor`, `u.motor[-2]`.
    pub fn name(self, coordinates: &[Coordinate], inputs: &[&str]) -> String {
        let joint = |c: usize| coordinates.get(c).map_or("", |c| c.name.as_str());
        match self {
            Quantity::Position(c) => format!("q.{}", joint(c)),
            Quantity::Cosine(c) => format!("cos(q.{})", joint(c)),
            Quantity::Sine(c) => format!("sin(q.{})", joint(c)),
            Quantity::Velocity(c) => format!("v.{}", joint(c)),
            Quantity::Input { input, back } => {
                let name = inputs.get(input).copied().unwrap_or_default();
                match back {
                    0 => format!("u.{name}"),
                    back => format!("u.{name}[-{back}]"),
                }
            }
        }
    }

    /// The quantity that a name stands for among these coordinates and inputs.
    pub fn from_name(name: &str, coordinates: &[Coordinate], inputs: &[&str]) -> Option<Self> {
        let joint = |name: &str| {
            let found = coordinates.iter().position(|c| c.name == name)?;
            (!coordinates[found].floating).then_some(found)
        };
        let within = |name: &'_ str, function: &str| -> Option<usize> {
            let inner = name.strip_prefix(function)?.strip_suffix(')')?;
            let c = joint(inner.strip_prefix("q.")?)?;
            coordinates[c].angular.then_some(c)
        };
        if let Some(c) = within(name, "cos(") {
            return Some(Quantity::Cosine(c));
        }
        if let Some(c) = within(name, "sin(") {
            return Some(Quantity::Sine(c));
        }
        if let Some(rest) = name.strip_prefix("u.") {
            let input = |name: &str| inputs.iter().position(|i| *i == name);
            if let Some(input) = input(rest) {
                return Some(Quantity::Input { input, back: 0 });
            }
            let (rest, back) = rest.strip_suffix(']')?.rsplit_once("[-")?;
            return Some(Quantity::Input {
                input: input(rest)?,
                back: back.parse().ok().filter(|back| *back <= MOST_BACK)?,
            });
        }
        match name.split_once('.')? {
            ("q", name) => joint(name).map(Quantity::Position),
            ("v", name) => joint(name).map(Quantity::Velocity),
            _ => None,
        }
    }
}

impl Quantity {
    /// Its value in the state x = (q, v) at a sample of a recording.
    pub(crate) fn value(
        self,
        x: &[f64],
        sample: usize,
        starts: &[Start],
        nq: usize,
        inputs: &DrivenInputs,
    ) -> f64 {
        let entry =
            |index: Option<usize>| index.and_then(|i| x.get(i)).copied().unwrap_or(f64::NAN);
        let position = |c: usize| entry(starts.get(c).map(|start| start.q));
        match self {
            Quantity::Position(c) => position(c),
            Quantity::Cosine(c) => position(c).cos(),
            Quantity::Sine(c) => position(c).sin(),
            Quantity::Velocity(c) => entry(starts.get(c).map(|start| nq + start.v)),
            Quantity::Input { input, back } => {
                // The last sample has no step of its own: what acted before it counts.
                let values = inputs
                    .forces
                    .get(input)
                    .map_or(&[][..], |force| &force.value);
                let step = inputs.grid.steps_from(sample.saturating_sub(back)).start;
                values
                    .get(step)
                    .or(values.last())
                    .copied()
                    .unwrap_or(f64::NAN)
            }
        }
    }
}

/// A network sees inputs of at most so many samples ago.
pub const MOST_BACK: usize = 1000;

/// One input of a network.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Feature {
    /// What is seen.
    pub quantity: Quantity,
    /// o in z = (x − o)/w.
    pub offset: f64,
    /// w in z = (x − o)/w, positive.
    pub width: f64,
    /// The least and the largest value in the data that the network was trained on.
    pub range: [f64; 2],
}

impl Feature {
    /// Scaled to mean 0 and deviation 1 over these values; what never moves says nothing, and cosines and sines have their scale.
    pub(crate) fn scaled(quantity: Quantity, values: impl Iterator<Item = f64>) -> Self {
        let (mut n, mut sum, mut squares) = (0.0, 0.0, 0.0);
        let mut range = [f64::INFINITY, f64::NEG_INFINITY];
        for x in values {
            n += 1.0;
            sum += x;
            squares += x * x;
            range = [range[0].min(x), range[1].max(x)];
        }
        let mean = sum / n;
        let width = (squares / n - mean * mean).max(0.0).sqrt();
        let (offset, width) = match quantity {
            Quantity::Cosine(_) | Quantity::Sine(_) => (0.0, 1.0),
            _ if width <= 1e-9 * mean.abs() || width == 0.0 => (mean, 1.0),
            _ => (mean, width),
        };
        Feature {
            quantity,
            offset,
            width,
            range,
        }
    }
}

/// Sines and cosines of eight angles, to 1.5 units in the last place.
pub(crate) struct SinCos<'a>(pub &'a Lane);

impl WithSimd for SinCos<'_> {
    type Output = [Lane; 2];

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> [Lane; 2] {
        match S::IS_SCALAR {
            true => [self.0.map(f64::sin), self.0.map(f64::cos)],
            // All instruction sets with vectors that are asked for have fused products.
            false => {
                let (sin, cos) = Lanes::<true>(*self.0).sin_cos();
                [sin.0, cos.0]
            }
        }
    }
}

/// z in eight states, one an input.
#[inline(always)]
pub(crate) fn see(features: &[Feature], x: &[Lane], at: &Seen<'_>, z: &mut [Lane]) {
    // Sine and cosine of an angle mostly stand together.
    let mut last: Option<(usize, [Lane; 2])> = None;
    for (z, feature) in z.iter_mut().zip(features) {
        let values = match feature.quantity {
            Quantity::Position(c) => x[at.starts[c].q],
            Quantity::Velocity(c) => x[at.nq + at.starts[c].v],
            Quantity::Cosine(c) | Quantity::Sine(c) => {
                let both = at.sin_cos(x, c, &mut last);
                both[usize::from(feature.quantity == Quantity::Cosine(c))]
            }
            Quantity::Input { input, back } => std::array::from_fn(|lane| {
                at.eight.inputs[lane].forces[input].value[at.step(lane, back)]
            }),
        };
        let mut out = [0.0; LANES];
        for (out, x) in out.iter_mut().zip(values) {
            *out = (x - feature.offset) / feature.width;
        }
        *z = out;
    }
}

/// Chain rule: from ∂J/∂z to ∂J/∂x of positions, velocities and the inputs' forces, each given to `add`.
#[inline(always)]
pub(crate) fn chain(
    features: &[Feature],
    x: &[Lane],
    at: &Seen<'_>,
    by_z: &[Lane],
    mut add: impl FnMut(Sight, Lane),
) {
    let mut last = None;
    for (feature, by_z) in features.iter().zip(by_z) {
        let mut by = *by_z;
        for by in &mut by {
            *by /= feature.width;
        }
        match feature.quantity {
            Quantity::Position(c) => add(Sight::Position(at.starts[c].v), by),
            Quantity::Velocity(c) => add(Sight::Velocity(at.starts[c].v), by),
            Quantity::Cosine(c) => {
                let [sin, _] = at.sin_cos(x, c, &mut last);
                for (by, sin) in by.iter_mut().zip(sin) {
                    *by *= -sin;
                }
                add(Sight::Position(at.starts[c].v), by);
            }
            Quantity::Sine(c) => {
                let [_, cos] = at.sin_cos(x, c, &mut last);
                for (by, cos) in by.iter_mut().zip(cos) {
                    *by *= cos;
                }
                add(Sight::Position(at.starts[c].v), by);
            }
            Quantity::Input { input, back } => {
                for (lane, &by) in by.iter().enumerate() {
                    let inputs = at.eight.inputs[lane];
                    let step = at.step(lane, back);
                    for (index, derivative) in &inputs.forces[input].by_parameter {
                        let mut only = [0.0; LANES];
                        only[lane] = by * derivative[step];
                        add(Sight::Constant(*index), only);
                    }
                }
            }
        }
    }
}

/// In what a learnt force is derived.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Sight {
    /// A displacement along this entry of v.
    Position(usize),
    /// The entry of v.
    Velocity(usize),
    /// The entry of θ, through the inputs.
    Constant(usize),
}

/// Where eight states stand, for what a network sees of them.
#[derive(Clone, Copy)]
pub(crate) struct Seen<'a> {
    /// The inputs of the recordings.
    pub eight: Eight<'a>,
    /// Where each coordinate starts in q and in v.
    pub starts: &'a [Start],
    /// Length of q.
    pub nq: usize,
    /// Whose instructions sines are computed with.
    pub processor: Processor,
}

impl Seen<'_> {
    /// The integration step of a lane `back` samples ago; the first of its recording where that was before it.
    #[inline(always)]
    fn step(&self, lane: usize, back: usize) -> usize {
        let (step, grid) = (self.eight.steps[lane], &self.eight.inputs[lane].grid);
        grid.step_back(step, back)
    }

    /// Sine and cosine of coordinate `c`, those in `last` where they are its.
    #[inline(always)]
    fn sin_cos(&self, x: &[Lane], c: usize, last: &mut Option<(usize, [Lane; 2])>) -> [Lane; 2] {
        match *last {
            Some((of, both)) if of == c => both,
            _ => {
                let both = self.processor.run(SinCos(&x[self.starts[c].q]));
                *last = Some((c, both));
                both
            }
        }
    }
}
