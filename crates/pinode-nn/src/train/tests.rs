//! The gradient through roll-outs, against differences of the loss and against sensitivities that run forward.
#![allow(clippy::unwrap_used)]

use std::path::Path;
use std::sync::Arc;

use nalgebra::{DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::adjoint::{CHUNK, Chunk, Learner, Member, Setting};
use super::loss::{FAR, Loss, Target};
use crate::hybrid::{DrivenInputs, Hybrid};
use crate::learnt::{Feature, LearntForce, Output, Quantity};
use crate::model::Model;
use crate::network::{Activation, Mlp, Shape};
use crate::shooting::{Roller, Trajectory};

/// A model with a smooth network, random data and windows of three samples of two steps.
struct Case {
    hybrid: Hybrid,
    theta: Vec<f64>,
    free: Vec<usize>,
    inputs: DrivenInputs,
    target: Target,
    loss: Loss,
    learner: Learner<f64>,
    starts: Vec<Vec<f64>>,
}

const SAMPLES: usize = 3;
const SUBSTEPS: usize = 2;

impl Case {
    fn new(folder: &str, effects: &str, joints: &[usize], interval: f64, seed: u64) -> Self {
        let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models");
        let path = models.join(folder);
        let text = std::fs::read_to_string(&path).unwrap() + effects;
        let model = Model::parse(&path, text).unwrap();
        let hybrid = Hybrid::explicit(&model);
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut number = |size: f64| size * (2.0 * rng.random::<f64>() - 1.0);
        let n = hybrid.nv();
        let rows = 2 * CHUNK;
        let t: Vec<f64> = (0..rows).map(|k| interval * k as f64).collect();
        let mut columns = |count: usize, size: f64| -> Vec<Vec<f64>> {
            (0..count)
                .map(|_| (0..rows).map(|_| number(size)).collect())
                .collect()
        };
        let u = columns(hybrid.inputs(), 2.0);
        let q = columns(n, 2.0);
        let target = Target {
            read: q.clone(),
            q,
            v: columns(n, 2.0),
            valid: [vec![vec![true; rows]; n], vec![vec![true; rows]; n]],
        };
        let starts: Vec<Vec<f64>> = (0..CHUNK - 5)
            .map(|_| (0..2 * n).map(|_| number(1.0)).collect())
            .collect();
        let theta = hybrid.theta();
        let free = hybrid.free();
        let inputs = hybrid.drive(&t, &u, SUBSTEPS, &theta, &free);
        let coordinates = hybrid.mechanics().coordinates();
        let places: Vec<_> = (0..n).map(|c| hybrid.start_of(c)).collect();
        let weights: Vec<[f64; 2]> = (0..n).map(|c| [1.0 + c as f64, 0.3]).collect();
        let loss = Loss::new(coordinates, &places, n, &weights, 1, None);
        let mut quantities: Vec<Quantity> = Vec::new();
        for c in 0..n {
            quantities.extend([
                Quantity::Position(c),
                Quantity::Sine(c),
                Quantity::Cosine(c),
                Quantity::Velocity(c),
            ]);
        }
        for input in 0..hybrid.inputs() {
            quantities.extend([0, 2].map(|back| Quantity::Input { input, back }));
        }
        let feature = |quantity| Feature {
            quantity,
            offset: 0.1,
            width: 1.5,
            range: [-1.0, 1.0],
        };
        let shape = Shape::new(
            &[quantities.len(), 9, 7, joints.len()],
            Activation::Tanh,
            Activation::Tanh,
        );
        let output = |&coordinate: &usize| Output {
            coordinate,
            scale: 1.7,
        };
        Case {
            learner: Learner {
                network: Mlp::xavier(shape.unwrap(), &mut ChaCha8Rng::seed_from_u64(seed)),
                features: quantities.into_iter().map(feature).collect(),
                outputs: joints.iter().map(output).collect(),
            },
            hybrid,
            theta,
            free,
            inputs,
            target,
            loss,
            starts,
        }
    }

    fn setting(&self) -> Setting<'_> {
        Setting {
            hybrid: &self.hybrid,
            theta: &self.theta,
            free: &self.free,
            loss: &self.loss,
            samples: SAMPLES,
        }
    }

    fn members(&self) -> Vec<Member<'_>> {
        self.starts
            .iter()
            .enumerate()
            .map(|(k, start)| Member {
                inputs: &self.inputs,
                target: &self.target,
                first: k,
                start,
            })
            .collect()
    }

    fn chunk(&self) -> Chunk<f64> {
        let mut chunk = Chunk::new(&self.setting(), &self.learner, CHUNK, SAMPLES * SUBSTEPS);
        chunk
            .forward(&self.setting(), &self.learner, &self.members())
            .unwrap();
        chunk.curve(&self.setting(), &self.learner, &self.members());
        chunk.backward(&self.setting(), &self.learner, &self.members());
        chunk
    }

    fn loss_with(&self, network: Mlp<f64>) -> f64 {
        let learner = Learner {
            network,
            ..self.learner.clone()
        };
        let mut chunk = Chunk::new(&self.setting(), &learner, CHUNK, SAMPLES * SUBSTEPS);
        chunk
            .forward(&self.setting(), &learner, &self.members())
            .unwrap();
        chunk.loss
    }
}

fn cases() -> Vec<(&'static str, Case)> {
    let friction = |joint: &str| {
        format!(
            "\n[[effect]]\nkind = 'viscous_friction'\njoint = '{joint}'\ncoefficient = 0.01\n\
             [[effect]]\nkind = 'cubic_spring'\njoint = '{joint}'\nstiffness = 0.3\n"
        )
    };
    let delay = "\n[[effect]]\nkind = 'input_delay'\ninput = 'motor'\ndelay = 0.023\n";
    vec![
        (
            "cart-pole",
            Case::new(
                "cartpole/cartpole.toml",
                &(friction("slider") + delay),
                &[0],
                0.02,
                1,
            ),
        ),
        (
            "double pendulum, network on both joints",
            Case::new("double_pendulum/double_pendulum.toml", "", &[1, 0], 0.02, 2),
        ),
        (
            "Furuta's pendulum",
            Case::new("furuta_pendulum/furuta_pendulum.toml", "", &[0], 0.02, 3),
        ),
        // Its friction asks for short steps.
        ("arm", Case::new("arm7/arm7.toml", "", &[1, 4], 1e-4, 4)),
    ]
}

#[test]
fn the_gradient_in_the_weights_is_the_slope_of_the_loss() {
    for (k, (name, mut case)) in cases().into_iter().enumerate() {
        case.loss.far = (k % 2 == 0).then_some(FAR);
        let chunk = case.chunk();
        assert_eq!(chunk.diverged, 0, "{name}");
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        for _ in 0..4 {
            let p = case.learner.network.parameters();
            let direction: Vec<f64> = p.iter().map(|_| rng.random::<f64>() - 0.5).collect();
            let along = |h: f64| {
                let mut network = case.learner.network.clone();
                for (x, d) in network.parameters_mut().iter_mut().zip(&direction) {
                    *x += h * d;
                }
                case.loss_with(network)
            };
            // Central differences of the sixth order.
            let h = 2e-4;
            let pair = |k: f64| along(k * h) - along(-k * h);
            let expected = (45.0 * pair(1.0) - 9.0 * pair(2.0) + pair(3.0)) / (60.0 * h);
            let found: f64 = chunk
                .gradient
                .iter()
                .zip(&direction)
                .map(|(g, d)| g * d)
                .sum();
            let size: f64 = chunk.gradient.iter().map(|g| g.abs()).sum();
            assert!(
                (found - expected).abs() < 1e-8 * size,
                "{name}: {found} for {expected}, of {size}"
            );
        }
    }
}

/// The second route: the network as a part of the model, whose roll-outs carry ∂x/∂(x₀, θ) forward.
#[test]
fn the_gradients_in_starts_and_constants_are_those_of_forward_sensitivities() {
    for (name, case) in cases() {
        let mut chunk = case.chunk();
        let mut hybrid = case.hybrid.clone();
        let Learner {
            network,
            features,
            outputs,
        } = case.learner.clone();
        let force = LearntForce::new(network, features, outputs, false).unwrap();
        hybrid.add_network(Arc::new(force));
        let mut roller = Roller::new(&hybrid, &case.free);
        let (nx, columns) = (hybrid.nx(), roller.columns());
        let mut by_theta = vec![0.0; case.free.len()];
        let mut loss = 0.0;
        let mut trajectory = Trajectory::default();
        for (k, start) in case.starts.iter().enumerate() {
            roller
                .roll_with_sensitivities(
                    &case.theta,
                    &case.inputs,
                    (k, SAMPLES + 1),
                    start,
                    &mut trajectory,
                )
                .unwrap();
            let mut by_start = vec![0.0; nx];
            let mut curvature = DMatrix::<f64>::zeros(nx, nx);
            for sample in 1..=SAMPLES {
                let x = &trajectory.states[sample * nx..][..nx];
                let s = &trajectory.sensitivities[sample * nx * columns..][..nx * columns];
                loss += case.loss.at(&case.target, k + sample, |i| x[i]);
                case.loss.gradient(
                    &case.target,
                    k + sample,
                    |i| x[i],
                    |i, part| {
                        for (column, by) in by_start.iter_mut().enumerate() {
                            *by += part * s[column * nx + i];
                        }
                        for (column, by) in by_theta.iter_mut().enumerate() {
                            *by += part * s[(nx + column) * nx + i];
                        }
                    },
                );
                let add = |i: usize, weight: f64, _| {
                    let row = DVector::from_fn(nx, |column, _| s[column * nx + i]);
                    curvature.ger(2.0 * weight, &row, &row, 1.0);
                };
                case.loss.residuals(&case.target, k + sample, |i| x[i], add);
            }
            let size: f64 = by_start.iter().map(|x| x.abs()).sum();
            for (i, expected) in by_start.iter().enumerate() {
                let found = chunk.by_start_of(k)[i];
                assert!(
                    (found - expected).abs() < 1e-10 * size,
                    "{name}, window {k}, entry {i}: {found} for {expected}"
                );
            }
            // (H + μ diag H) d = −∂S/∂x₀.
            let mut step = DVector::zeros(nx);
            chunk.move_start(k, 0.1, step.as_mut_slice());
            for i in 0..nx {
                curvature[(i, i)] *= 1.1;
            }
            let residual = &curvature * &step + DVector::from_vec(by_start);
            assert!(
                residual.amax() < 1e-9 * size,
                "{name}, window {k}: a step {step} that leaves {residual}"
            );
        }
        assert!((chunk.loss / loss - 1.0).abs() < 1e-12, "{name}");
        assert!(!by_theta.is_empty());
        for (k, (found, expected)) in chunk.by_theta.iter().zip(&by_theta).enumerate() {
            assert!(
                (found - expected).abs() < 1e-9 * expected.abs().max(1.0),
                "{name}, constant {k}: {found} for {expected}"
            );
        }
    }
}

#[test]
fn a_window_that_leaves_the_range_of_mechanisms_counts_nothing() {
    let mut case = Case::new("cartpole/cartpole.toml", "", &[0], 0.02, 6);
    let usual = case.chunk();
    let nx = case.hybrid.nx();
    case.starts[7] = vec![0.0, 0.3, 1e200, 1e180];
    let lost = case.chunk();
    assert_eq!(lost.diverged, 1);
    assert!(lost.loss.is_finite() && lost.loss < usual.loss);
    assert!(lost.gradient.iter().all(|g| g.is_finite()));
    assert!(lost.by_theta.iter().all(|g| g.is_finite()));
    assert_eq!(lost.by_start_of(7), vec![0.0; nx]);
    assert_eq!(lost.by_start_of(6), usual.by_start_of(6));
}
