//! The gradient through roll-outs, against differences of the loss and against sensitivities that run forward.
#![allow(clippy::unwrap_used, clippy::panic)]

#[path = "../../../../tests/common/random_tree.rs"]
mod random_tree;

use std::path::Path;
use std::sync::Arc;

use nalgebra::{DMatrix, DVector};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::adjoint::{CHUNK, Chunk, Learner, Member, Setting};
use super::loss::{FAR, Loss, Target};
use crate::hybrid::{DrivenInputs, Hybrid};
use crate::learnt::{Feature, LearntForce, Output, Quantity};
use crate::model::Model;
use crate::network::{Activation, Mlp, Shape};
use crate::shooting::{Roller, Trajectory};
use random_tree::{RandomBody, body, urdf};

/// A model with a smooth network, random data and windows of three samples of two steps.
struct Case {
    hybrid: Hybrid,
    theta: Vec<f64>,
    free: Vec<usize>,
    /// Times and readings of the inputs.
    read: (Vec<f64>, Vec<Vec<f64>>),
    inputs: DrivenInputs,
    target: Target,
    loss: Loss,
    learner: Learner<f64>,
    starts: Vec<Vec<f64>>,
}

const SAMPLES: usize = 3;
const SUBSTEPS: usize = 2;

impl Case {
    fn new(file: &str, effects: &str, joints: &[usize], interval: f64, seed: u64) -> Self {
        let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models");
        let path = models.join(file);
        let text = std::fs::read_to_string(&path).unwrap() + effects;
        let model = Model::parse(&path, text).unwrap();
        Self::of(&model, joints, interval, seed)
    }

    /// A random tree with a force on its first joint, laws on its last one, and a network on one of them or on two.
    fn random(bodies: &[RandomBody], seed: u64) -> Self {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("random.urdf"), urdf(bodies)).unwrap();
        let n = bodies.len();
        let mut text = "name = 'random'\nurdf = 'random.urdf'\n\
            [[input]]\nname = 'motor'\njoint = 'j1'\n"
            .to_owned();
        for law in [
            "kind = 'viscous_friction'\ncoefficient = 0.2",
            "kind = 'quadratic_drag'\ncoefficient = 0.1",
            "kind = 'cubic_spring'\nstiffness = 3.0",
        ] {
            text += &format!("[[effect]]\n{law}\njoint = 'j{n}'\n");
        }
        let path = folder.path().join("random.toml");
        let model = Model::parse(&path, text).unwrap();
        let mut joints = vec![seed as usize % n];
        if seed.is_multiple_of(3) && n > 1 {
            joints.push((joints[0] + 1) % n);
        }
        Self::of(&model, &joints, 2e-3, seed)
    }

    fn of(model: &Model, joints: &[usize], interval: f64, seed: u64) -> Self {
        let hybrid = Hybrid::explicit(model);
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
            read_v: Vec::new(),
            v: columns(n, 2.0),
            valid: [vec![vec![true; rows]; n], vec![vec![true; rows]; n]],
        };
        let starts: Vec<Vec<f64>> = (0..CHUNK - 5)
            .map(|_| {
                let visible = (0..2 * n).map(|_| 1.0);
                let sizes = visible.chain((0..hybrid.nh()).map(|_| 0.01));
                sizes.map(&mut number).collect()
            })
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
            read: (t, u),
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

/// An elastic string to the cart, and friction of the pole that winds up.
const MEMORIES: &str = "
[[effect]]
kind = 'elastic_transmission'
input = 'motor'
stiffness = 300.0
damping = 2.0
motor_inertia = 0.07
[[effect]]
kind = 'dahl_friction'
joint = 'pole'
stiffness = 0.4
coulomb_force = 0.02
";

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
        (
            "cart-pole with memories",
            Case::new("cartpole/cartpole.toml", MEMORIES, &[0, 1], 2e-3, 7),
        ),
        (
            "slider-crank, a closed loop",
            Case::new("slider_crank/slider_crank.toml", "", &[0], 5e-3, 5),
        ),
        // Its friction asks for short steps.
        ("arm", Case::new("arm7/arm7.toml", "", &[1, 4], 1e-4, 4)),
    ]
}

#[test]
fn the_gradient_in_the_weights_is_the_slope_of_the_loss() {
    for (k, (name, mut case)) in cases().into_iter().enumerate() {
        case.loss.far = (k % 2 == 0).then_some(FAR);
        case.weights_against_differences(name);
    }
}

#[test]
fn the_gradients_are_those_of_forward_sensitivities() {
    for (name, case) in cases() {
        case.against_forward_sensitivities(name);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]

    /// Of any mechanism.
    #[test]
    fn the_gradients_of_random_mechanisms_are_right_by_both_routes(
        bodies in proptest::collection::vec(body(&["revolute", "continuous", "prismatic"]), 1..=5),
        seed in 0..1000_u64,
    ) {
        let mut case = Case::random(&bodies, seed);
        case.against_forward_sensitivities("random tree");
        case.loss.far = Some(FAR);
        case.weights_against_differences("random tree");
    }
}

impl Case {
    fn weights_against_differences(&self, name: &str) {
        let chunk = self.chunk();
        assert_eq!(chunk.diverged, 0, "{name}");
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        for _ in 0..4 {
            let p = self.learner.network.parameters();
            let direction: Vec<f64> = p.iter().map(|_| rng.random::<f64>() - 0.5).collect();
            let along = |h: f64| {
                let mut network = self.learner.network.clone();
                for (x, d) in network.parameters_mut().iter_mut().zip(&direction) {
                    *x += h * d;
                }
                self.loss_with(network)
            };
            // Central differences of the sixth order, where those of the fourth are closest to them: farther apart they bend, closer they round.
            let differences = [2e-4, 1e-3, 5e-3, 2e-2].map(|h| {
                let [a, b, c] = [1.0, 2.0, 3.0].map(|k| along(k * h) - along(-k * h));
                let sixth = (45.0 * a - 9.0 * b + c) / (60.0 * h);
                (sixth, (sixth - (8.0 * a - b) / (12.0 * h)).abs())
            });
            let best = differences.iter().min_by(|a, b| a.1.total_cmp(&b.1));
            let expected = best.unwrap().0;
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

    /// The second route: the network as a part of the model whose parameters are entries of θ, and roll-outs that carry ∂x/∂(x₀, θ) forward.
    fn against_forward_sensitivities(&self, name: &str) {
        let mut chunk = self.chunk();
        let mut hybrid = self.hybrid.clone();
        let Learner {
            network,
            features,
            outputs,
        } = self.learner.clone();
        let force = LearntForce::new(network, features, outputs, false).unwrap();
        hybrid.add_open_network(Arc::new(force), f64::INFINITY);
        let (theta, free) = (hybrid.theta(), hybrid.free());
        let inputs = hybrid.drive(&self.read.0, &self.read.1, SUBSTEPS, &theta, &free);
        let mut roller = Roller::new(&hybrid, &free);
        let (nx, columns) = (hybrid.nx(), roller.columns());
        let mut by_theta = vec![0.0; free.len()];
        let mut loss = 0.0;
        let mut trajectory = Trajectory::default();
        for (k, start) in self.starts.iter().enumerate() {
            roller
                .roll_with_sensitivities(&theta, &inputs, (k, SAMPLES + 1), start, &mut trajectory)
                .unwrap();
            let mut by_start = vec![0.0; nx];
            let mut curvature = DMatrix::<f64>::zeros(nx, nx);
            for sample in 1..=SAMPLES {
                let x = &trajectory.states[sample * nx..][..nx];
                let s = &trajectory.sensitivities[sample * nx * columns..][..nx * columns];
                loss += self.loss.at(&self.target, k + sample, |i| x[i]);
                self.loss.gradient(
                    &self.target,
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
                self.loss.residuals(&self.target, k + sample, |i| x[i], add);
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
        let found: Vec<f64> = chunk
            .by_theta
            .iter()
            .chain(&chunk.gradient)
            .copied()
            .collect();
        assert_eq!(found.len(), by_theta.len(), "{name}");
        assert!(!self.free.is_empty(), "{name}");
        let largest = by_theta.iter().fold(0.0, |most, x| f64::max(most, x.abs()));
        for (k, (found, expected)) in found.iter().zip(&by_theta).enumerate() {
            assert!(
                (found - expected).abs() < 1e-8 * expected.abs() + 1e-13 * largest,
                "{name}, entry {k} of θ: {found} for {expected}"
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
