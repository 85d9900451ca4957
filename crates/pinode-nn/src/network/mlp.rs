//! The parameters of a network, and what it is, by plain loops.

use rand::{Rng, RngExt};

use super::real::Real;
use super::shape::{Layer, Shape, ShapeError};

/// A network: y_l = φ_l(W_l y_{l−1} + b_l), its parameters in the order of [`Shape`].
#[derive(Debug, Clone, PartialEq)]
pub struct Mlp<T> {
    shape: Shape,
    /// As many as the shape has.
    parameters: Vec<T>,
}

impl<T: Real> Mlp<T> {
    /// Weights drawn uniformly from ±√(6/(inputs + outputs)) of their layer, no biases (Glorot and Bengio, 2010). The draws are of f64,
    /// so that networks of f32 and f64 start alike.
    pub fn xavier(shape: Shape, rng: &mut impl Rng) -> Mlp<T> {
        let mut parameters = vec![T::default(); shape.parameters()];
        for layer in shape.layers() {
            let bound = (6.0 / (layer.inputs + layer.outputs) as f64).sqrt();
            for w in &mut parameters[layer.weight_range()] {
                *w = T::from_f64(bound * (2.0 * rng.random::<f64>() - 1.0));
            }
        }
        Mlp { shape, parameters }
    }

    /// A network of given numbers.
    ///
    /// # Errors
    ///
    /// If there are not [`Shape::parameters`] of them.
    pub fn from_parameters(shape: Shape, parameters: Vec<T>) -> Result<Mlp<T>, ShapeError> {
        match (shape.parameters(), parameters.len()) {
            (expected, found) if expected == found => Ok(Mlp { shape, parameters }),
            (expected, found) => Err(ShapeError::Parameters { expected, found }),
        }
    }

    /// Sizes and activations.
    pub fn shape(&self) -> &Shape {
        &self.shape
    }

    /// W and b, layer after layer.
    pub fn parameters(&self) -> &[T] {
        &self.parameters
    }

    /// W and b, layer after layer.
    pub fn parameters_mut(&mut self) -> &mut [T] {
        &mut self.parameters
    }

    /// The same network in numbers of another kind, rounded.
    pub fn convert<U: Real>(&self) -> Mlp<U> {
        let parameters = self.parameters.iter().map(|p| U::from_f64(p.to_f64()));
        Mlp {
            shape: self.shape.clone(),
            parameters: parameters.collect(),
        }
    }

    /// The output for one input, in f64 by plain loops: for tests and single questions. A missing entry of `input` counts as 0.
    pub fn evaluate(&self, input: &[f64]) -> Vec<f64> {
        let layers = self.shape.layers();
        layers.fold(input.to_vec(), |x, layer| self.layer(&layer, &x))
    }

    /// ∂y/∂x for one input, outputs × inputs, row-major, in f64 by plain loops.
    pub fn jacobian(&self, input: &[f64]) -> Vec<f64> {
        let inputs = self.shape.inputs();
        let mut x = input.to_vec();
        let mut by: Vec<f64> = (0..inputs * inputs)
            .map(|k| f64::from(u8::from(k / inputs == k % inputs)))
            .collect();
        for layer in self.shape.layers() {
            let y = self.layer(&layer, &x);
            let mut next = vec![0.0; layer.outputs * inputs];
            let weights = self.parameters[layer.weight_range()].chunks_exact(layer.inputs);
            for ((to, weights), &y) in next.chunks_exact_mut(inputs).zip(weights).zip(&y) {
                for (from, w) in by.chunks_exact(inputs).zip(weights) {
                    for (to, from) in to.iter_mut().zip(from) {
                        *to += layer.activation.slope(y) * w.to_f64() * from;
                    }
                }
            }
            (x, by) = (y, next);
        }
        by
    }

    /// y of one layer from its x.
    fn layer(&self, layer: &Layer, x: &[f64]) -> Vec<f64> {
        let weights = self.parameters[layer.weight_range()].chunks_exact(layer.inputs);
        let rows = weights.zip(&self.parameters[layer.bias_range()]);
        let sum = |(w, b): (&[T], &T)| {
            let products = w.iter().zip(x).map(|(w, x)| w.to_f64() * x);
            layer.activation.value(b.to_f64() + products.sum::<f64>())
        };
        rows.map(sum).collect()
    }
}

#[cfg(test)]
mod tests {
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;

    use super::super::shape::Activation;
    use super::*;

    fn shape() -> Shape {
        Shape::new(&[3, 7, 4, 2], Activation::Tanh, Activation::Identity).unwrap()
    }

    #[test]
    fn networks_of_both_precisions_start_alike() {
        let of_f64 = Mlp::<f64>::xavier(shape(), &mut ChaCha8Rng::seed_from_u64(3));
        let of_f32 = Mlp::<f32>::xavier(shape(), &mut ChaCha8Rng::seed_from_u64(3));
        assert_eq!(of_f64.convert::<f32>(), of_f32);
    }

    #[test]
    fn weights_fill_their_range_and_biases_are_zero() {
        let net = Mlp::<f64>::xavier(shape(), &mut ChaCha8Rng::seed_from_u64(4));
        for layer in net.shape().layers() {
            let bound = (6.0 / (layer.inputs + layer.outputs) as f64).sqrt();
            let weights = &net.parameters()[layer.weight_range()];
            let largest = weights.iter().fold(0.0_f64, |m, w| m.max(w.abs()));
            assert!(largest <= bound && largest > 0.5 * bound);
            assert!(
                net.parameters()[layer.bias_range()]
                    .iter()
                    .all(|&b| b == 0.0)
            );
        }
    }

    #[test]
    fn another_number_of_parameters_is_refused() {
        let expected = shape().parameters();
        let found = Mlp::from_parameters(shape(), vec![0.0_f64; expected - 1]);
        let found_less = ShapeError::Parameters {
            expected,
            found: expected - 1,
        };
        assert_eq!(found, Err(found_less));
    }

    #[test]
    fn the_jacobian_is_that_of_central_differences() {
        let net = Mlp::<f64>::xavier(shape(), &mut ChaCha8Rng::seed_from_u64(5));
        let x = [0.3, -0.8, 1.1];
        let jacobian = net.jacobian(&x);
        for j in 0..3 {
            let at = |h: f64| {
                let mut x = x;
                x[j] += h;
                net.evaluate(&x)
            };
            let (above, below) = (at(1e-5), at(-1e-5));
            for i in 0..2 {
                let slope = (above[i] - below[i]) / 2e-5;
                assert!((jacobian[i * 3 + j] - slope).abs() < 1e-9);
            }
        }
    }
}
