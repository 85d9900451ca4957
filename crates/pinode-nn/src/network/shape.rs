//! How large a network is, and where its parameters are.

use std::ops::Range;

/// What a layer does to each of its sums.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Activation {
    /// φ(z) = z.
    Identity,
    /// φ(z) = max(z, 0); its derivative at 0 is taken as 0.
    Relu,
    /// φ(z) = tanh z.
    Tanh,
}

impl Activation {
    /// All of them.
    pub const ALL: [Activation; 3] = [Activation::Identity, Activation::Relu, Activation::Tanh];

    /// As it is written in files.
    pub fn name(self) -> &'static str {
        match self {
            Activation::Identity => "identity",
            Activation::Relu => "relu",
            Activation::Tanh => "tanh",
        }
    }

    /// The one of this [`name`](Self::name).
    pub fn from_name(name: &str) -> Option<Activation> {
        Self::ALL.into_iter().find(|a| a.name() == name)
    }

    /// φ(z), by the standard library.
    pub fn value(self, z: f64) -> f64 {
        match self {
            Activation::Identity => z,
            Activation::Relu if z < 0.0 => 0.0,
            Activation::Relu => z,
            Activation::Tanh => z.tanh(),
        }
    }

    /// φ′(z), from y = φ(z).
    pub fn slope(self, y: f64) -> f64 {
        match self {
            Activation::Identity => 1.0,
            Activation::Relu if y > 0.0 => 1.0,
            Activation::Relu => 0.0,
            Activation::Tanh => 1.0 - y * y,
        }
    }
}

/// Why sizes or parameters make no network.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ShapeError {
    /// Fewer than two sizes.
    #[error("a network needs the sizes of its input and its output, but {0} sizes are given")]
    TooFewSizes(usize),
    /// A layer without a unit.
    #[error("layer {0} of the network has no unit")]
    EmptyLayer(usize),
    /// More parameters than can be counted.
    #[error("the network has too many parameters")]
    TooLarge,
    /// Another number of parameters than the shape has.
    #[error("the network has {expected} parameters, but {found} are given")]
    Parameters {
        /// Of the shape.
        expected: usize,
        /// Given.
        found: usize,
    },
}

/// Sizes of the layers, and the activations.
///
/// The parameters lie layer after layer: W (outputs × inputs, row-major), then b.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct Shape {
    /// At least two, none 0.
    sizes: Vec<usize>,
    hidden: Activation,
    output: Activation,
    /// Of these sizes and activations; at least one.
    layers: Vec<Layer>,
}

/// One layer of a [`Shape`]: y = φ(W x + b).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Layer {
    /// Length of x.
    pub inputs: usize,
    /// Length of y and b.
    pub outputs: usize,
    /// φ.
    pub activation: Activation,
    /// Where W begins among the parameters.
    pub weights: usize,
    /// Where b begins among the parameters: behind W.
    pub biases: usize,
}

impl Layer {
    /// Where W is among the parameters, outputs × inputs, row-major.
    pub fn weight_range(&self) -> Range<usize> {
        self.weights..self.biases
    }

    /// Where b is among the parameters.
    pub fn bias_range(&self) -> Range<usize> {
        self.biases..self.biases + self.outputs
    }
}

impl Shape {
    /// Layers of `sizes` units, the first of them the input; `hidden` follows all of them but the last.
    ///
    /// # Errors
    ///
    /// Fewer than two sizes, a size 0, more parameters than a `usize` counts.
    pub fn new(
        sizes: &[usize],
        hidden: Activation,
        output: Activation,
    ) -> Result<Shape, ShapeError> {
        if sizes.len() < 2 {
            return Err(ShapeError::TooFewSizes(sizes.len()));
        }
        if let Some(empty) = sizes.iter().position(|&n| n == 0) {
            return Err(ShapeError::EmptyLayer(empty));
        }
        let last = sizes.len() - 2;
        let mut end = 0_usize;
        let mut layers = Vec::with_capacity(last + 1);
        for (index, (&inputs, &outputs)) in sizes.iter().zip(&sizes[1..]).enumerate() {
            let weights = end;
            let of_weights = inputs.checked_mul(outputs);
            let biases = of_weights.and_then(|n| weights.checked_add(n));
            let biases = biases.ok_or(ShapeError::TooLarge)?;
            end = biases.checked_add(outputs).ok_or(ShapeError::TooLarge)?;
            layers.push(Layer {
                inputs,
                outputs,
                activation: if index == last { output } else { hidden },
                weights,
                biases,
            });
        }
        Ok(Shape {
            sizes: sizes.to_vec(),
            hidden,
            output,
            layers,
        })
    }

    /// Units of every layer, the first of them the input.
    pub fn sizes(&self) -> &[usize] {
        &self.sizes
    }

    /// Length of an input.
    pub fn inputs(&self) -> usize {
        self.sizes[0]
    }

    /// Length of an output.
    pub fn outputs(&self) -> usize {
        self.sizes[self.sizes.len() - 1]
    }

    /// Activation of all layers but the last.
    pub fn hidden(&self) -> Activation {
        self.hidden
    }

    /// Activation of the last layer.
    pub fn output(&self) -> Activation {
        self.output
    }

    /// How many numbers W and b of all layers are: Σ (inputs + 1) · outputs.
    pub fn parameters(&self) -> usize {
        self.layers.last().map_or(0, |l| l.bias_range().end)
    }

    /// The layers, from the input on.
    pub fn layers(&self) -> impl DoubleEndedIterator<Item = Layer> + ExactSizeIterator + '_ {
        self.layers.iter().copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn five_fifty_fifty_fifty_one_has_5451_parameters() {
        let shape = Shape::new(&[5, 50, 50, 50, 1], Activation::Relu, Activation::Tanh).unwrap();
        assert_eq!(shape.parameters(), 5451);
        assert_eq!((shape.inputs(), shape.outputs()), (5, 1));
    }

    #[test]
    fn layers_follow_each_other_without_gaps() {
        let shape = Shape::new(&[3, 4, 2], Activation::Relu, Activation::Identity).unwrap();
        let layers: Vec<_> = shape.layers().collect();
        let layer = |inputs, outputs, activation, weights, biases| Layer {
            inputs,
            outputs,
            activation,
            weights,
            biases,
        };
        let expected = [
            layer(3, 4, Activation::Relu, 0, 12),
            layer(4, 2, Activation::Identity, 16, 24),
        ];
        assert_eq!(layers, expected);
        assert_eq!(shape.parameters(), 26);
    }

    #[test]
    fn impossible_sizes_are_named() {
        let new = |sizes: &[usize]| Shape::new(sizes, Activation::Tanh, Activation::Identity);
        assert_eq!(new(&[]), Err(ShapeError::TooFewSizes(0)));
        assert_eq!(new(&[4]), Err(ShapeError::TooFewSizes(1)));
        assert_eq!(new(&[4, 0, 1]), Err(ShapeError::EmptyLayer(1)));
        assert_eq!(new(&[usize::MAX, 2]), Err(ShapeError::TooLarge));
        assert_eq!(new(&[usize::MAX / 4, 5]), Err(ShapeError::TooLarge));
    }

    #[test]
    fn activations_are_found_by_their_names() {
        for a in Activation::ALL {
            assert_eq!(Activation::from_name(a.name()), Some(a));
        }
        assert_eq!(Activation::from_name("sigmoid"), None);
    }

    #[test]
    fn no_number_stays_none() {
        for a in Activation::ALL {
            assert!(a.value(f64::NAN).is_nan(), "{}", a.name());
        }
    }
}
