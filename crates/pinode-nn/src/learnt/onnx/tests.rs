//! What is written is read again and evaluated by a small interpreter: it has to be the force.

use std::collections::HashMap;
use std::path::Path;

use prost::Message;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::messages::{Dimension, ModelProto, TensorProto};
use super::*;
use crate::learnt::{Card, Feature, Names, Output, Quantity, weights};
use crate::network::{Mlp, Shape};

const CART_POLE: &str = r#"
name = "cart-pole"

[lagrangian]
coordinates = ["slider", "pole"]
angles = ["pole"]
kinetic = "0.5*0.5*slider_dot^2 - 0.01*slider_dot*pole_dot*cos(pole) + 0.5*0.002*pole_dot^2"
potential = "0.1*cos(pole)"

[[input]]
name = "motor"
joint = "slider"
gain = 2.0

[[effect]]
kind = "neural_network"
weights = "learnt.safetensors"
joints = ["slider", "pole"]
"#;

fn features() -> Vec<Feature> {
    let of = |quantity, offset, width, range| Feature {
        quantity,
        offset,
        width,
        range,
    };
    vec![
        of(Quantity::Position(0), 0.1, 0.2, [-0.3, 0.5]),
        of(Quantity::Cosine(1), 0.0, 1.0, [-1.0, 1.0]),
        of(Quantity::Sine(1), 0.0, 1.0, [-1.0, 1.0]),
        of(Quantity::Velocity(1), -0.4, 3.0, [-9.0, 8.0]),
        of(Quantity::Input { input: 0, back: 0 }, 0.3, 2.5, [-4.0, 4.0]),
        of(Quantity::Input { input: 0, back: 2 }, 0.3, 2.5, [-4.0, 4.0]),
    ]
}

/// The cart-pole with a network in it, from files in `folder`.
fn model(folder: &Path, (hidden, output): (Activation, Activation), single: bool) -> Model {
    let shape = Shape::new(&[6, 20, 20, 2], hidden, output).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let mut network = match single {
        true => Mlp::<f32>::xavier(shape, &mut rng).convert(),
        false => Mlp::<f64>::xavier(shape, &mut rng),
    };
    for bias in network.parameters_mut().iter_mut().filter(|p| **p == 0.0) {
        *bias = f64::from(rng.random_range(-0.5_f32..0.5));
    }
    let output = |coordinate, scale| Output { coordinate, scale };
    let outputs = vec![output(0, 3.7), output(1, 0.21)];
    let force = LearntForce::new(network, features(), outputs, false).unwrap();
    let text = CART_POLE.split("[[effect]]").next().unwrap();
    let bare = Model::parse(&folder.join("bare.toml"), text).unwrap();
    let names = Names {
        coordinates: bare.mechanics.coordinates(),
        inputs: &["motor"],
    };
    let card = Card::of(&force, names);
    weights::write(&folder.join("learnt.safetensors"), &force, &card, single).unwrap();
    Model::parse(&folder.join("model.toml"), CART_POLE).unwrap()
}

fn numbers(tensor: &TensorProto) -> Vec<f64> {
    let bytes = &tensor.raw_data;
    let found: Vec<f64> = match tensor.data_type {
        FLOAT => {
            let (whole, _) = bytes.as_chunks::<4>();
            whole
                .iter()
                .map(|b| f64::from(f32::from_le_bytes(*b)))
                .collect()
        }
        DOUBLE => {
            let (whole, _) = bytes.as_chunks::<8>();
            whole.iter().map(|b| f64::from_le_bytes(*b)).collect()
        }
        other => panic!("numbers of kind {other}"),
    };
    assert_eq!(found.len() as i64, tensor.dims.iter().product::<i64>());
    found
}

/// The graph at one state, every result rounded to the kind of its numbers.
fn interpret(graph: &GraphProto, x: &[f64], single: bool) -> Vec<f64> {
    let rounded = |x: f64| if single { f64::from(x as f32) } else { x };
    let tensors = graph
        .initializer
        .iter()
        .map(|t| (t.name.as_str(), numbers(t)));
    let mut known: HashMap<&str, Vec<f64>> = tensors.collect();
    known.insert(
        &graph.input[0].name,
        x.iter().map(|x| rounded(*x)).collect(),
    );
    for node in &graph.node {
        let of = |k: usize| &known[node.input[k].as_str()];
        let both = |f: fn(f64, f64) -> f64| -> Vec<f64> {
            assert_eq!(of(0).len(), of(1).len());
            of(0).iter().zip(of(1)).map(|(a, b)| f(*a, *b)).collect()
        };
        let y: Vec<f64> = match node.op_type.as_str() {
            "Sub" => both(|a, b| a - b),
            "Div" => both(|a, b| a / b),
            "Mul" => both(|a, b| a * b),
            "Relu" => of(0).iter().map(|x| x.max(0.0)).collect(),
            "Tanh" => of(0).iter().map(|x| x.tanh()).collect(),
            "Gemm" => {
                let [transposed] = node.attribute.as_slice() else {
                    panic!("one attribute is expected")
                };
                assert_eq!((transposed.name.as_str(), transposed.i), ("transB", 1));
                let rows = of(1).chunks_exact(of(0).len()).zip(of(2));
                let dot = |w: &[f64]| w.iter().zip(of(0)).map(|(w, x)| w * x).sum::<f64>();
                rows.map(|(w, b)| dot(w) + b).collect()
            }
            other => panic!("operator {other}"),
        };
        known.insert(&node.output[0], y.into_iter().map(rounded).collect());
    }
    known.remove(graph.output[0].name.as_str()).unwrap()
}

#[test]
fn the_file_gives_the_forces_of_the_network_in_both_precisions() {
    let folder = tempfile::tempdir().unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(12);
    for activations in [
        (Activation::Relu, Activation::Tanh),
        (Activation::Tanh, Activation::Identity),
    ] {
        for single in [false, true] {
            let model = model(folder.path(), activations, single);
            let entry = &model.networks[0];
            assert_eq!(entry.single, single);
            let bytes = to_bytes(&model, entry, single).unwrap();
            let graph = ModelProto::decode(bytes.as_slice()).unwrap().graph.unwrap();
            let tolerance = if single { 1e-6 } else { 1e-12 };
            for _ in 0..500 {
                let draw = |[low, high]: [f64; 2], rng: &mut ChaCha8Rng| {
                    let x = rng.random_range(low..high);
                    if single { f64::from(x as f32) } else { x }
                };
                let x: Vec<f64> = entry
                    .force
                    .features()
                    .iter()
                    .map(|f| draw(f.range, &mut rng))
                    .collect();
                let found = interpret(&graph, &x, single);
                let expected = entry.force.at(&x);
                let outputs = entry.force.outputs();
                for ((found, expected), output) in found.iter().zip(&expected).zip(outputs) {
                    let error = (found - expected).abs() / output.scale;
                    assert!(error < tolerance, "{found} for {expected}: {error:e}");
                }
            }
        }
    }
}

#[test]
fn names_units_and_ranges_of_all_columns_stand_in_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let model = model(folder.path(), (Activation::Relu, Activation::Tanh), true);
    let bytes = to_bytes(&model, &model.networks[0], true).unwrap();
    let file = ModelProto::decode(bytes.as_slice()).unwrap();
    assert_eq!((file.ir_version, file.opset_import[0].version), (8, 13));
    let graph = file.graph.unwrap();
    let words = &graph.input[0].doc_string;
    for expected in [
        "0: q.slider [m], position of slider",
        "1: cos(q.pole) [1], cosine of the angle of pole",
        "3: v.pole [rad/s], velocity of pole",
        "5: u.motor[-2] [N], force of the input motor on slider: its gain of 2 N per unit times what its drive lets through, 2 samples",
    ] {
        assert!(words.contains(expected), "{words}");
    }
    let shape = |value: &ValueInfoProto| -> Vec<Dimension> {
        let tensor = value.r#type.clone().and_then(|t| t.tensor_type).unwrap();
        let dims = tensor.shape.unwrap().dim;
        dims.into_iter().filter_map(|d| d.value).collect()
    };
    let batch = Dimension::Parameter("batch".to_owned());
    assert_eq!(shape(&graph.input[0]), [batch.clone(), Dimension::Value(6)]);
    assert_eq!(shape(&graph.output[0]), [batch, Dimension::Value(2)]);
    let metadata: HashMap<String, String> = file
        .metadata_props
        .into_iter()
        .map(|entry| (entry.key, entry.value))
        .collect();
    let json = |key: &str| serde_json::from_str::<serde_json::Value>(&metadata[key]).unwrap();
    let (features, forces) = (json("pinode.features"), json("pinode.forces"));
    assert_eq!(features[3]["name"], "v.pole");
    assert_eq!(features[3]["range"], serde_json::json!([-9.0, 8.0]));
    assert_eq!(forces[1]["name"], "pole");
    assert_eq!(forces[1]["unit"], "N·m");
    assert_eq!(metadata["pinode.alone"], "false");
}

#[test]
fn a_width_that_vanishes_in_32_bits_is_refused_with_its_name() {
    let folder = tempfile::tempdir().unwrap();
    let model = model(folder.path(), (Activation::Relu, Activation::Tanh), true);
    let entry = &model.networks[0];
    let mut features = features();
    features[0].width = 1e-60;
    let force = &entry.force;
    let narrow = LearntForce::new(
        force.network().clone(),
        features,
        force.outputs().to_vec(),
        false,
    );
    let entry = NetworkEntry {
        force: narrow.unwrap().into(),
        ..entry.clone()
    };
    let words = to_bytes(&model, &entry, true).unwrap_err().to_string();
    assert!(words.contains("width of q.slider is 1e-60"), "{words}");
    assert!(to_bytes(&model, &entry, false).is_ok());
}
