//! A learnt force as an ONNX model, for programs that have a runtime of ONNX and no `pinode`.
//!
//! F = s ∘ φ_L(W_L … φ_1(W_1 (x − o)/w + b_1) … + b_L)
//!
//! One input `features`, \[batch, features\]: x as they are, SI units, in the order of the network's features; the scaling is in the file. One output
//! `forces`, \[batch, joints\], N or N·m: what the network adds to Q. Numbers have 32 or 64 bits throughout. Names, units and meanings stand in
//! the documentation of both, for people, and in the metadata, for programs:
//!
//! | key | value |
//! |---|---|
//! | `pinode.features` | JSON, one object a column of `features`: `name`, `unit`, `meaning`, and `range`: outside of it the force was never seen |
//! | `pinode.forces` | JSON, one object a column of `forces`: `name` of the joint, `unit`, `meaning` |
//! | `pinode.alone` | `true`: the inputs act on these joints through these forces alone; else they act beside them. Effects of the model come beside them in both |
//! | `pinode.share` | the part of the forces that counts: 1, or of a member of an ensemble, whose force is the mean, 1 over the number of members |
//! | `pinode.model`, `pinode.weights`, `pinode.weights_sha256` | what it was made from |
//!
//! Operators are Sub, Div, Gemm, Relu, Tanh and Mul of opset 13, in IR version 8. Checked by `onnx.checker` and against onnxruntime: see
//! `benches/peers/onnx_check.py`.

mod messages;
#[cfg(test)]
mod tests;

use prost::Message;
use serde::Serialize;

use super::{Described, LearntForce};
use crate::Error;
use crate::model::{Model, NetworkEntry};
use crate::network::Activation;
use messages::{
    AttributeProto, DOUBLE, Dimension, DimensionProto, FLOAT, GraphProto, INT, ModelProto,
    NodeProto, OperatorSetIdProto, StringStringEntryProto, TensorProto, TensorShapeProto,
    TensorTypeProto, TypeProto, ValueInfoProto,
};

/// Version of the format.
pub const IR_VERSION: i64 = 8;
/// Version of the operators.
pub const OPSET: i64 = 13;
/// The name of the input.
pub const INPUT: &str = "features";
/// The name of the output.
pub const OUTPUT: &str = "forces";

/// The network `entry` of `model` as the bytes of an ONNX file; of 32 bits a number with `single`.
///
/// # Errors
/// [`Error::NotSingle`] when a scale is beyond 32 bits.
pub fn to_bytes(model: &Model, entry: &NetworkEntry, single: bool) -> Result<Vec<u8>, Error> {
    Ok(message(model, entry, single)?.encode_to_vec())
}

/// The network `entry` of `model` as a message.
fn message(model: &Model, entry: &NetworkEntry, single: bool) -> Result<ModelProto, Error> {
    let force = &entry.force;
    let columns: Vec<Column> = entry
        .sees(model)
        .into_iter()
        .zip(force.features())
        .map(|(signal, feature)| Column {
            signal,
            range: Some(feature.range),
        })
        .collect();
    let forces: Vec<Column> = entry
        .gives(model)
        .into_iter()
        .map(|signal| Column {
            signal,
            range: None,
        })
        .collect();
    let kind = if single { FLOAT } else { DOUBLE };
    let graph = Graph::of(force, &columns, kind)?;
    let role = match force.is_alone() {
        true => {
            "The inputs act on these joints through them alone; effects of the model come beside them."
        }
        false => "They come to what inputs and effects give on their joints.",
    };
    let metadata = [
        ("pinode.features", json(&columns)),
        ("pinode.forces", json(&forces)),
        ("pinode.alone", force.is_alone().to_string()),
        ("pinode.share", entry.share.to_string()),
        ("pinode.model", model.name.clone()),
        ("pinode.weights", entry.weights.clone()),
        ("pinode.weights_sha256", entry.sha256.clone()),
    ];
    Ok(ModelProto {
        ir_version: IR_VERSION,
        producer_name: "pinode".to_owned(),
        producer_version: env!("CARGO_PKG_VERSION").to_owned(),
        doc_string: format!(
            "Learnt generalized forces of the model {}, from raw quantities in SI units. {role} Outside of the ranges in the metadata \
             they were never seen.",
            model.name
        ),
        graph: Some(GraphProto {
            node: graph.nodes,
            name: "learnt_force".to_owned(),
            initializer: graph.tensors,
            input: vec![value(INPUT, kind, &columns)],
            output: vec![value(OUTPUT, kind, &forces)],
        }),
        opset_import: vec![OperatorSetIdProto {
            domain: String::new(),
            version: OPSET,
        }],
        metadata_props: metadata
            .map(|(key, value)| StringStringEntryProto {
                key: key.to_owned(),
                value,
            })
            .to_vec(),
    })
}

/// A column of the input or of the output, as the metadata have it.
#[derive(Serialize)]
struct Column {
    #[serde(flatten)]
    signal: Described,
    #[serde(skip_serializing_if = "Option::is_none")]
    range: Option<[f64; 2]>,
}

fn json(columns: &[Column]) -> String {
    serde_json::to_string(columns).unwrap_or_default() // strings and numbers: it cannot fail
}

/// A tensor \[batch, columns\], with what each column is.
fn value(name: &str, kind: i32, columns: &[Column]) -> ValueInfoProto {
    let words = columns
        .iter()
        .enumerate()
        .map(|(k, Column { signal, .. })| {
            format!("{k}: {} [{}], {}", signal.name, signal.unit, signal.meaning)
        });
    let dim = [
        Dimension::Parameter("batch".to_owned()),
        Dimension::Value(columns.len() as i64),
    ];
    ValueInfoProto {
        name: name.to_owned(),
        r#type: Some(TypeProto {
            tensor_type: Some(TensorTypeProto {
                elem_type: kind,
                shape: Some(TensorShapeProto {
                    dim: dim
                        .map(|value| DimensionProto { value: Some(value) })
                        .to_vec(),
                }),
            }),
        }),
        doc_string: words.collect::<Vec<_>>().join("; "),
    }
}

/// Operators in a row, each on what the one before gives.
struct Graph {
    nodes: Vec<NodeProto>,
    tensors: Vec<TensorProto>,
    /// Of all numbers.
    kind: i32,
}

impl Graph {
    /// s ∘ network ∘ (x − o)/w.
    fn of(force: &LearntForce, columns: &[Column], kind: i32) -> Result<Self, Error> {
        let mut graph = Graph {
            nodes: Vec::new(),
            tensors: Vec::new(),
            kind,
        };
        let features = || force.features().iter().zip(columns);
        let row = [1, columns.len()];
        let offsets: Vec<f64> = features().map(|(f, _)| f.offset).collect();
        let widths: Vec<f64> = features().map(|(f, _)| f.width).collect();
        let scales: Vec<f64> = force.outputs().iter().map(|o| o.scale).collect();
        if kind == FLOAT {
            for (feature, Column { signal, .. }) in features() {
                fits("offset", &signal.name, feature.offset, f64::INFINITY)?;
                fits("width", &signal.name, feature.width, feature.width)?;
            }
            for (k, &scale) in scales.iter().enumerate() {
                fits("scale", &format!("output {k}"), scale, scale)?;
            }
        }
        graph.add("Sub", "centred", &[("offset", &row, &offsets)]);
        graph.add("Div", "scaled", &[("width", &row, &widths)]);
        let network = force.network();
        for (k, layer) in network.shape().layers().enumerate() {
            let weights = network.parameters().get(layer.weight_range());
            let biases = network.parameters().get(layer.bias_range());
            let (weight, bias) = (format!("layers.{k}.weight"), format!("layers.{k}.bias"));
            let tensors: [(&str, &[usize], &[f64]); 2] = [
                (
                    &weight,
                    &[layer.outputs, layer.inputs],
                    weights.unwrap_or_default(),
                ),
                (&bias, &[layer.outputs], biases.unwrap_or_default()),
            ];
            graph.add("Gemm", &format!("layers.{k}.sum"), &tensors);
            let operator = match layer.activation {
                Activation::Identity => continue,
                Activation::Relu => "Relu",
                Activation::Tanh => "Tanh",
            };
            graph.add(operator, &format!("layers.{k}.value"), &[]);
        }
        graph.add("Mul", OUTPUT, &[("scale", &[1, scales.len()], &scales)]);
        Ok(graph)
    }

    /// `operator` on the last result and these tensors; its result is called `result`.
    fn add(&mut self, operator: &str, result: &str, tensors: &[(&str, &[usize], &[f64])]) {
        let last = self.nodes.last().and_then(|node| node.output.last());
        let mut input = vec![last.map_or(INPUT, String::as_str).to_owned()];
        for (name, shape, numbers) in tensors {
            input.push((*name).to_owned());
            let raw_data = match self.kind {
                FLOAT => numbers
                    .iter()
                    .flat_map(|x| (*x as f32).to_le_bytes())
                    .collect(),
                _ => numbers.iter().flat_map(|x| x.to_le_bytes()).collect(),
            };
            self.tensors.push(TensorProto {
                dims: shape.iter().map(|&n| n as i64).collect(),
                data_type: self.kind,
                name: (*name).to_owned(),
                raw_data,
            });
        }
        // W is stored as outputs × inputs, and states are rows: y = x Wᵀ + b.
        let transposed = AttributeProto {
            name: "transB".to_owned(),
            i: 1,
            r#type: INT,
        };
        self.nodes.push(NodeProto {
            input,
            output: vec![result.to_owned()],
            name: format!("{result}.{}", operator.to_lowercase()),
            op_type: operator.to_owned(),
            attribute: match operator {
                "Gemm" => vec![transposed],
                _ => Vec::new(),
            },
        });
    }
}

/// Whether 32 bits hold a number, and one that must not vanish.
fn fits(what: &'static str, name: &str, value: f64, not_zero: f64) -> Result<(), Error> {
    match (value as f32).is_finite() && not_zero.abs() >= f64::from(f32::MIN_POSITIVE) {
        true => Ok(()),
        false => Err(Error::NotSingle {
            what,
            name: name.to_owned(),
            value,
        }),
    }
}
