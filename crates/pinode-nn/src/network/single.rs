//! A network at one point: its value, and the gradient of one of its outputs.

use super::{Activation, Mlp};

/// Memory for evaluations at one point.
#[derive(Debug, Clone, Default)]
pub struct Single {
    /// The inputs, then what each layer puts out, one after another.
    values: Vec<f64>,
    /// Where in `values` each of them starts, and one past the end.
    starts: Vec<usize>,
    /// The adjoints of one layer's values, and of those before it.
    adjoint: Vec<f64>,
    before: Vec<f64>,
}

impl Single {
    /// y(z), one number an output.
    ///
    /// `z` is as long as the network has inputs.
    pub fn evaluate(&mut self, network: &Mlp<f64>, z: &[f64]) -> &[f64] {
        let parameters = network.parameters();
        self.values.clear();
        self.values.extend_from_slice(z);
        self.starts.clear();
        self.starts.push(0);
        for layer in network.shape().layers() {
            let first = self.starts[self.starts.len() - 1];
            let count = self.values.len();
            self.starts.push(count);
            let weights = &parameters[layer.weights..layer.biases];
            let biases = &parameters[layer.biases..][..layer.outputs];
            for (row, bias) in weights.chunks_exact(layer.inputs).zip(biases) {
                let sum = bias + dot(row, &self.values[first..count]);
                self.values.push(match layer.activation {
                    Activation::Identity => sum,
                    Activation::Relu => sum.max(0.0),
                    Activation::Tanh => sum.tanh(),
                });
            }
        }
        &self.values[self.starts[self.starts.len() - 1]..]
    }

    /// ∂y_o/∂z of output `o` where the network was evaluated last, one number an input.
    pub fn gradient(&mut self, network: &Mlp<f64>, o: usize) -> &[f64] {
        self.gradients(network, o, |_, _| {})
    }

    /// The same, with ∂y_o/∂ of every parameter to `each`, by its index.
    pub fn gradients(
        &mut self,
        network: &Mlp<f64>,
        o: usize,
        mut each: impl FnMut(usize, f64),
    ) -> &[f64] {
        let parameters = network.parameters();
        let last = self.starts[self.starts.len() - 1];
        self.adjoint.clear();
        self.adjoint.resize(self.values.len() - last, 0.0);
        self.adjoint[o] = 1.0;
        let mut end = self.values.len();
        for k in (1..self.starts.len()).rev() {
            let Some(layer) = network.shape().layers().nth(k - 1) else {
                continue;
            };
            let start = self.starts[k];
            let values = &self.values[start..end];
            self.before.clear();
            self.before.resize(layer.inputs, 0.0);
            let weights = &parameters[layer.weights..layer.biases];
            let rows = weights.chunks_exact(layer.inputs).enumerate();
            let inputs = &self.values[self.starts[k - 1]..start];
            for (((index, row), &y), adjoint) in rows.zip(values).zip(&self.adjoint) {
                let slope = match layer.activation {
                    Activation::Identity => 1.0,
                    Activation::Relu => f64::from(u8::from(y > 0.0)),
                    Activation::Tanh => 1.0 - y * y,
                };
                let part = adjoint * slope;
                for (to, weight) in self.before.iter_mut().zip(row) {
                    *to += part * weight;
                }
                for (input, x) in inputs.iter().enumerate() {
                    each(layer.weights + index * layer.inputs + input, part * x);
                }
                each(layer.biases + index, part);
            }
            std::mem::swap(&mut self.adjoint, &mut self.before);
            end = start;
        }
        &self.adjoint
    }
}

/// Σ a_i b_i in eight partial sums, which are added up in a fixed order.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let (whole_a, rest_a) = a.as_chunks::<8>();
    let (whole_b, rest_b) = b.as_chunks::<8>();
    let mut sums = [0.0; 8];
    for (a, b) in whole_a.iter().zip(whole_b) {
        for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
            *sum += a * b;
        }
    }
    let rest: f64 = rest_a.iter().zip(rest_b).map(|(a, b)| a * b).sum();
    sums.iter().sum::<f64>() + rest
}
