//! The passes against plain loops.

use pulp::{Scalar, Simd};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use super::adjoint::Backward;
use super::gradient::AddGradient;
use super::kernel::Forward;
use super::*;

/// A network, a tape filled with random inputs and seeds, and these.
struct Case<T> {
    mlp: Mlp<T>,
    tape: Tape<T>,
    /// `[slot][column][row]`.
    inputs: Vec<Vec<Vec<f64>>>,
    seeds: Vec<Vec<Vec<f64>>>,
}

impl<T: Real> Case<T> {
    fn new(shape: &Shape, columns: usize, slots: usize, rng: &mut ChaCha8Rng) -> Case<T> {
        let mut mlp = Mlp::<T>::xavier(shape.clone(), rng);
        for p in mlp.parameters_mut() {
            *p = T::from_f64(p.to_f64() + 0.2 * (rng.random::<f64>() - 0.5));
        }
        let mut tape = Tape::new(shape, columns, slots);
        let mut draw = |rows: usize| -> Vec<Vec<Vec<f64>>> {
            let mut number = || T::from_f64(2.0 * rng.random::<f64>() - 1.0).to_f64();
            let mut column = || (0..rows).map(|_| number()).collect();
            let mut slot = || (0..columns).map(|_| column()).collect();
            (0..slots).map(|_| slot()).collect()
        };
        let (inputs, seeds) = (draw(shape.inputs()), draw(shape.outputs()));
        for slot in 0..slots {
            for column in 0..columns {
                let (group, lane) = (column / GROUP, column % GROUP);
                for (row, x) in inputs[slot][column].iter().enumerate() {
                    tape.input_mut(slot, row, group)[lane] = T::from_f64(*x);
                }
                for (row, x) in seeds[slot][column].iter().enumerate() {
                    tape.seed_mut(slot, row, group)[lane] = T::from_f64(*x);
                }
            }
        }
        Case {
            mlp,
            tape,
            inputs,
            seeds,
        }
    }

    /// Outputs, adjoints of the inputs and the gradient, by the kernels.
    fn run(&mut self) -> Results {
        for slot in 0..self.tape.slots() {
            self.mlp.forward(&mut self.tape, slot);
            self.mlp.backward(&mut self.tape, slot);
        }
        let mut gradient = vec![T::default(); self.mlp.parameters().len()];
        self.mlp
            .add_gradient(&self.tape, 0..self.tape.slots(), &mut gradient);
        self.results(&gradient)
    }

    /// As [`run`](Self::run), on another processor.
    fn run_on(&mut self, s: impl Simd) -> Results {
        let (mlp, tape) = (&self.mlp, &mut self.tape);
        for slot in 0..tape.slots() {
            s.vectorize(Forward { mlp, tape, slot });
            s.vectorize(Backward { mlp, tape, slot });
        }
        let mut gradient = vec![T::default(); mlp.parameters().len()];
        s.vectorize(AddGradient {
            mlp,
            tape,
            slots: 0..tape.slots(),
            gradient: &mut gradient,
        });
        self.results(&gradient)
    }

    fn results(&self, gradient: &[T]) -> Results {
        let (tape, shape) = (&self.tape, self.mlp.shape());
        let mut results = Results {
            outputs: Vec::new(),
            by_input: Vec::new(),
            gradient: gradient.iter().map(|x| x.to_f64()).collect(),
        };
        for slot in 0..tape.slots() {
            for column in 0..tape.columns() {
                let (group, lane) = (column / GROUP, column % GROUP);
                let output = |row| tape.output(slot, row, group)[lane].to_f64();
                results.outputs.extend((0..shape.outputs()).map(output));
                let adjoint = |row| tape.input_gradient(slot, row, group)[lane].to_f64();
                results.by_input.extend((0..shape.inputs()).map(adjoint));
            }
        }
        results
    }

    /// The same by plain loops, the gradient by [`reverse`].
    fn reference(&self) -> Results {
        let mut results = Results {
            outputs: Vec::new(),
            by_input: Vec::new(),
            gradient: vec![0.0; self.mlp.parameters().len()],
        };
        let pairs = self
            .inputs
            .iter()
            .flatten()
            .zip(self.seeds.iter().flatten());
        for (input, seed) in pairs {
            results.outputs.extend(self.mlp.evaluate(input));
            let jacobian = self.mlp.jacobian(input);
            let n = input.len();
            let adjoint = |j| {
                (0..seed.len())
                    .map(|i| seed[i] * jacobian[i * n + j])
                    .sum::<f64>()
            };
            results.by_input.extend((0..n).map(adjoint));
            reverse(&self.mlp, input, seed, &mut results.gradient);
        }
        results
    }
}

/// gradient += ∂(seed · y)/∂parameters of one input.
fn reverse<T: Real>(mlp: &Mlp<T>, input: &[f64], seed: &[f64], gradient: &mut [f64]) {
    let p: Vec<f64> = mlp.parameters().iter().map(|p| p.to_f64()).collect();
    let layers: Vec<_> = mlp.shape().layers().collect();
    let mut values = vec![input.to_vec()];
    for l in &layers {
        let x = &values[values.len() - 1];
        let sum = |o: usize| -> f64 {
            let w = &p[l.weights + o * l.inputs..][..l.inputs];
            p[l.biases + o] + w.iter().zip(x).map(|(w, x)| w * x).sum::<f64>()
        };
        values.push((0..l.outputs).map(|o| l.activation.value(sum(o))).collect());
    }
    let mut by = seed.to_vec();
    for (l, pair) in layers.iter().zip(values.windows(2)).rev() {
        let mut below = vec![0.0; l.inputs];
        for o in 0..l.outputs {
            let delta = by[o] * l.activation.slope(pair[1][o]);
            gradient[l.biases + o] += delta;
            for i in 0..l.inputs {
                gradient[l.weights + o * l.inputs + i] += delta * pair[0][i];
                below[i] += delta * p[l.weights + o * l.inputs + i];
            }
        }
        by = below;
    }
}

#[derive(Debug, Clone, PartialEq)]
struct Results {
    outputs: Vec<f64>,
    by_input: Vec<f64>,
    gradient: Vec<f64>,
}

impl Results {
    /// The worst differences of outputs, adjoints and gradient, relative to the largest of their kind or 1.
    fn differences(&self, other: &Results) -> [f64; 3] {
        let of = |a: &[f64], b: &[f64]| {
            assert_eq!(a.len(), b.len());
            let scale = b.iter().fold(1.0_f64, |m, b| m.max(b.abs()));
            let differences = a.iter().zip(b).map(|(a, b)| (a - b).abs() / scale);
            // NaN must not pass.
            differences.fold(0.0, |m: f64, d| if d <= m { m } else { d })
        };
        [
            of(&self.outputs, &other.outputs),
            of(&self.by_input, &other.by_input),
            of(&self.gradient, &other.gradient),
        ]
    }
}

/// Shapes of 1 to 4 layers of 1 to 70 units, with every pair of activations, and numbers of columns and slots.
fn shapes(count: usize, rng: &mut ChaCha8Rng) -> Vec<(Shape, usize, usize)> {
    let mut shapes = Vec::new();
    for k in 0..count {
        let layers = rng.random_range(1..=4);
        let sizes: Vec<usize> = (0..=layers).map(|_| rng.random_range(1..=70)).collect();
        let (hidden, output) = (Activation::ALL[k % 3], Activation::ALL[k / 3 % 3]);
        let shape = Shape::new(&sizes, hidden, output).unwrap();
        shapes.push((shape, rng.random_range(1..=75), rng.random_range(1..=3)));
    }
    shapes
}

fn five_fifty() -> Shape {
    Shape::new(&[5, 50, 50, 50, 1], Activation::Relu, Activation::Tanh).unwrap()
}

#[test]
fn f64_is_that_of_plain_loops() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut all = shapes(45, &mut rng);
    all.push((five_fifty(), 128, 4));
    for (shape, columns, slots) in all {
        let mut case = Case::<f64>::new(&shape, columns, slots, &mut rng);
        let differences = case.run().differences(&case.reference());
        let bounds = [1e-13, 1e-12, 1e-12];
        let fine = differences.iter().zip(bounds).all(|(d, b)| *d < b);
        assert!(fine, "{shape:?} {columns} {slots}: {differences:?}");
    }
}

#[test]
fn f32_is_near() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let mut all = shapes(27, &mut rng);
    all.push((five_fifty(), 128, 4));
    for (shape, columns, slots) in all {
        // The slope of a rectifier jumps: a sum that is nearly 0 may fall on either side.
        let smooth = Shape::new(shape.sizes(), Activation::Tanh, shape.output()).unwrap();
        let smooth = match shape.output() {
            Activation::Relu => {
                Shape::new(shape.sizes(), Activation::Tanh, Activation::Identity).unwrap()
            }
            _ => smooth,
        };
        for shape in [shape, smooth.clone()] {
            let mut case = Case::<f32>::new(&shape, columns, slots, &mut rng);
            let [outputs, by_input, gradient] = case.run().differences(&case.reference());
            assert!(outputs < 3e-6, "{shape:?}: {outputs:e}");
            if shape == smooth {
                assert!(
                    by_input < 3e-5 && gradient < 3e-5,
                    "{shape:?}: {by_input:e} {gradient:e}"
                );
            }
        }
    }
}

#[test]
fn every_instruction_set_gives_the_same_to_rounding() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    for (shape, columns, slots) in shapes(12, &mut rng) {
        let mut case = Case::<f64>::new(&shape, columns, slots, &mut rng);
        let here = case.run();
        let mut others = vec![case.run_on(Scalar)];
        #[cfg(target_arch = "x86_64")]
        {
            others.extend(pulp::x86::V3::try_new().map(|s| case.run_on(s)));
            // Which builds with debug assertions do not use.
            others.extend(pulp::x86::V4::try_new().map(|s| case.run_on(s)));
        }
        for other in others {
            let differences = other.differences(&here);
            assert!(
                differences.iter().all(|d| *d < 1e-12),
                "{shape:?}: {differences:?}"
            );
        }
    }
}

#[test]
fn the_gradient_is_that_of_central_differences() {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let shape = Shape::new(&[3, 11, 6, 2], Activation::Tanh, Activation::Tanh).unwrap();
    let mut case = Case::<f64>::new(&shape, 19, 2, &mut rng);
    let gradient = case.run().gradient;
    let seeds: Vec<f64> = case.seeds.iter().flatten().flatten().copied().collect();
    for (index, found) in gradient.iter().enumerate() {
        let mut at = |h: f64| -> f64 {
            case.mlp.parameters_mut()[index] += h;
            let outputs = case.run().outputs;
            case.mlp.parameters_mut()[index] -= h;
            outputs.iter().zip(&seeds).map(|(y, s)| y * s).sum()
        };
        let slope = (at(1e-5) - at(-1e-5)) / 2e-5;
        assert!((found - slope).abs() < 1e-8, "{index}: {found} {slope}");
    }
}

#[test]
fn adjoints_of_inputs_are_those_of_central_differences() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let shape = Shape::new(&[4, 13, 3], Activation::Relu, Activation::Tanh).unwrap();
    let mut case = Case::<f64>::new(&shape, 9, 1, &mut rng);
    let by_input = case.run().by_input;
    for (column, (x, seed)) in case.inputs[0].iter().zip(&case.seeds[0]).enumerate() {
        for row in 0..4 {
            let at = |h: f64| -> f64 {
                let mut x = x.clone();
                x[row] += h;
                let y = case.mlp.evaluate(&x);
                y.iter().zip(seed).map(|(y, s)| y * s).sum()
            };
            let slope = (at(1e-6) - at(-1e-6)) / 2e-6;
            assert!((by_input[column * 4 + row] - slope).abs() < 1e-8);
        }
    }
}

#[test]
fn padding_adds_nothing_whatever_is_written_there() {
    let mut rng = ChaCha8Rng::seed_from_u64(6);
    for columns in [1, 11, 37, 61] {
        let mut case = Case::<f64>::new(&five_fifty(), columns, 2, &mut rng);
        let clean = case.run();
        let last = case.tape.groups() - 1;
        for slot in 0..2 {
            for row in 0..5 {
                case.tape.input_mut(slot, row, last)[columns % GROUP..].fill(f64::NAN);
            }
            case.tape.seed_mut(slot, 0, last)[columns % GROUP..].fill(f64::INFINITY);
        }
        assert_eq!(case.run(), clean);
    }
}

#[test]
fn slots_are_kept_apart_and_added_together() {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let mut case = Case::<f64>::new(&five_fifty(), 40, 4, &mut rng);
    let all = case.run().gradient;
    let mut parts = vec![0.0; all.len()];
    for range in [0..1, 1..1, 1..3, 3..4] {
        case.mlp.add_gradient(&case.tape, range, &mut parts);
    }
    for (part, all) in parts.iter().zip(&all) {
        assert!((part - all).abs() < 1e-12 * all.abs().max(1.0));
    }
}

#[test]
fn the_same_numbers_give_the_same_bits() {
    let run = || {
        let mut rng = ChaCha8Rng::seed_from_u64(8);
        let first = Case::<f32>::new(&five_fifty(), 77, 3, &mut rng).run();
        (
            first,
            Case::<f64>::new(&five_fifty(), 77, 3, &mut rng).run(),
        )
    };
    assert_eq!(run(), run());
}

#[test]
fn a_state_does_not_depend_on_where_it_stands() {
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    let mut case = Case::<f64>::new(&five_fifty(), 70, 1, &mut rng);
    let inputs: Vec<f64> = (0..5).map(|_| rng.random()).collect();
    for group in 0..case.tape.groups() {
        for (row, x) in inputs.iter().enumerate() {
            case.tape.input_mut(0, row, group).fill(*x);
        }
    }
    let outputs = case.run().outputs;
    assert!(outputs.iter().all(|y| y.to_bits() == outputs[0].to_bits()));
}

#[test]
fn no_states_and_no_slots_are_no_work() {
    let mut rng = ChaCha8Rng::seed_from_u64(10);
    let mut case = Case::<f32>::new(&five_fifty(), 0, 2, &mut rng);
    assert!(case.run().gradient.iter().all(|&g| g == 0.0));
    let mut case = Case::<f32>::new(&five_fifty(), 9, 0, &mut rng);
    assert!(case.run().gradient.iter().all(|&g| g == 0.0));
}

#[test]
#[should_panic(expected = "another shape")]
fn a_tape_of_another_shape_is_refused() {
    let shape = Shape::new(&[5, 50, 1], Activation::Relu, Activation::Tanh).unwrap();
    let mlp = Mlp::<f64>::xavier(five_fifty(), &mut ChaCha8Rng::seed_from_u64(11));
    mlp.forward(&mut Tape::new(&shape, 8, 1), 0);
}

#[test]
fn more_states_than_are_gone_through_together_are_all_counted() {
    let mut rng = ChaCha8Rng::seed_from_u64(12);
    let mut case = Case::<f64>::new(&five_fifty(), 70, 30, &mut rng);
    let differences = case.run().differences(&case.reference());
    assert!(differences.iter().all(|d| *d < 1e-12), "{differences:?}");
}
