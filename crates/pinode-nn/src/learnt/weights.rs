//! The weights of a learnt force in a file: safetensors, with a card that says what the network sees, what it acts on and how it was trained.
//!
//! Tensors `layers.0.weight` (outputs × inputs), `layers.0.bias` and so on; the card is the JSON text under `pinode` in the file's metadata. Where the
//! card has a `reach`, the tensor `region` (points × inputs) has the states that cover the training data, as shares of the features' ranges:
//! see [`super::Region`]. Files without them have ranges alone.

use std::collections::HashMap;
use std::fs::File;
use std::io::Read;
use std::path::Path;

use lagrange::{Coordinate, Problem, Problems};
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use serde::{Deserialize, Serialize};

use super::{Feature, LearntForce, Output, Quantity, Region};
use crate::Error;
use crate::disk::write_atomically;
use crate::naming::{hint, quoted};
use crate::network::{Activation, Mlp, Shape};

/// A larger file of weights is refused.
const LARGEST: u64 = 256 << 20;
/// Where the card is in the metadata.
const KEY: &str = "pinode";
/// The tensor with the states that cover the training data.
const REGION: &str = "region";
/// The version of the card that this program writes, and reads.
const FORMAT: u32 = 1;

/// What a file of weights says of itself.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Card {
    /// Version of the card.
    pub format: u32,
    /// `relu`, `tanh` or `identity`, of the hidden layers.
    pub hidden: String,
    /// The same of the last layer.
    pub output: String,
    /// What the network sees, in the order of its inputs.
    pub features: Vec<FeatureCard>,
    /// What it acts on, in the order of its outputs.
    pub joints: Vec<JointCard>,
    /// Whether the inputs act on these joints through it alone; effects of the model come beside it.
    pub alone: bool,
    /// No state of the training data is farther than this from a point of the tensor `region`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reach: Option<f64>,
    /// The time between the samples of the logs that it was trained on, s: what some samples ago means.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub interval: Option<f64>,
    /// How it was trained; any text that programs need not understand.
    #[serde(default, skip_serializing_if = "serde_json::Map::is_empty")]
    pub training: serde_json::Map<String, serde_json::Value>,
}

/// One input of a network: z = (x − offset)/width.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FeatureCard {
    /// `q.<joint>`, `cos(q.<joint>)`, `sin(q.<joint>)`, `v.<joint>`, `u.<input>`, `u.<input>[-k]`: of k samples ago.
    pub name: String,
    /// In the unit of x.
    pub offset: f64,
    /// In the unit of x.
    pub width: f64,
    /// The least and the largest x in the training data.
    pub range: [f64; 2],
}

/// One output of a network: Q = scale · y.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointCard {
    /// The joint.
    pub name: String,
    /// N or N·m.
    pub scale: f64,
}

/// What names in a card are resolved among.
#[derive(Debug, Clone, Copy)]
pub struct Names<'a> {
    /// The model's coordinates.
    pub coordinates: &'a [Coordinate],
    /// The names of its inputs.
    pub inputs: &'a [&'a str],
}

impl Card {
    /// The card of a learnt force, without a word on its training.
    pub fn of(force: &LearntForce, names: Names<'_>) -> Self {
        let shape = force.network().shape();
        let features = force.features().iter().map(|feature| FeatureCard {
            name: feature.quantity.name(names.coordinates, names.inputs),
            offset: feature.offset,
            width: feature.width,
            range: feature.range,
        });
        let joints = force.outputs().iter().map(|output| JointCard {
            name: names
                .coordinates
                .get(output.coordinate)
                .map(|c| c.name.clone())
                .unwrap_or_default(),
            scale: output.scale,
        });
        Card {
            format: FORMAT,
            hidden: shape.hidden().name().to_owned(),
            output: shape.output().name().to_owned(),
            features: features.collect(),
            joints: joints.collect(),
            alone: force.is_alone(),
            reach: force.region().map(Region::reach),
            interval: None,
            training: serde_json::Map::new(),
        }
    }
}

/// What a file of weights holds.
#[derive(Debug, Clone, PartialEq)]
pub struct Stored {
    /// The force.
    pub force: LearntForce,
    /// What the file says of itself.
    pub card: Card,
    /// SHA-256 of the file, hexadecimal.
    pub sha256: String,
    /// Whether all its numbers have 32 bits.
    pub single: bool,
}

/// Writes the weights of `force` to `path`, whole or not at all, with `card`; as 32 bits a number with `single`.
///
/// # Errors
/// [`Error::Io`].
pub fn write(path: &Path, force: &LearntForce, card: &Card, single: bool) -> Result<(), Error> {
    write_atomically(path, &to_bytes(path, force, card, single)?)
}

/// The bytes of the file that [`write()`] writes.
///
/// # Errors
/// [`Error::Io`] when the card is no JSON: it holds a number that is not finite.
pub fn to_bytes(
    path: &Path,
    force: &LearntForce,
    card: &Card,
    single: bool,
) -> Result<Vec<u8>, Error> {
    let io =
        |e: Box<dyn std::error::Error + Send + Sync>| Error::io(path, std::io::Error::other(e));
    let network = force.network();
    let bytes_of = |numbers: &[f64]| -> Vec<u8> {
        match single {
            true => numbers
                .iter()
                .flat_map(|x| (*x as f32).to_le_bytes())
                .collect(),
            false => numbers.iter().flat_map(|x| x.to_le_bytes()).collect(),
        }
    };
    let kind = if single { Dtype::F32 } else { Dtype::F64 };
    let mut tensors = Vec::new();
    for (k, layer) in network.shape().layers().enumerate() {
        let weights = &network.parameters()[layer.weights..layer.biases];
        let biases = &network.parameters()[layer.biases..][..layer.outputs];
        tensors.push((
            format!("layers.{k}.weight"),
            vec![layer.outputs, layer.inputs],
            bytes_of(weights),
        ));
        tensors.push((
            format!("layers.{k}.bias"),
            vec![layer.outputs],
            bytes_of(biases),
        ));
    }
    let mut kinds = vec![kind; tensors.len()];
    if let Some(region) = force.region() {
        let inputs = force.features().len();
        let numbers = region.points().iter();
        tensors.push((
            REGION.to_owned(),
            vec![region.points().len() / inputs.max(1), inputs],
            numbers.flat_map(|x| x.to_le_bytes()).collect(),
        ));
        kinds.push(Dtype::F32);
    }
    let mut views = Vec::new();
    for ((name, shape, bytes), kind) in tensors.iter().zip(kinds) {
        let view = TensorView::new(kind, shape.clone(), bytes).map_err(|e| io(e.into()))?;
        views.push((name, view));
    }
    let text = serde_json::to_string(card).map_err(|e| io(e.into()))?;
    let metadata = HashMap::from([(KEY.to_owned(), text)]);
    safetensors::serialize(views, Some(metadata)).map_err(|e| io(e.into()))
}

/// Reads a learnt force and its card from `path`.
///
/// # Errors
/// [`Error::Io`], [`Error::Problems`] with every fault of the file.
pub fn read(path: &Path, names: Names<'_>) -> Result<Stored, Error> {
    let mut bytes = Vec::new();
    File::open(path)
        .and_then(|file| file.take(LARGEST + 1).read_to_end(&mut bytes))
        .map_err(|e| Error::io(path, e))?;
    let parsed = match bytes.len() as u64 > LARGEST {
        true => Err(vec![
            "the file is larger than 256 MiB: these are no weights of a force".to_owned(),
        ]),
        false => parse(&bytes, names),
    };
    parsed.map_err(|faults| {
        Error::Problems(Problems {
            source: path.display().to_string(),
            list: faults.into_iter().map(Problem::general).collect(),
        })
    })
}

fn parse(bytes: &[u8], names: Names<'_>) -> Result<Stored, Vec<String>> {
    let only = |fault: String| vec![fault];
    let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(|e| {
        only(format!(
            "this is no file of weights in the safetensors format: {e}"
        ))
    })?;
    let tensors = SafeTensors::deserialize(bytes).map_err(|e| {
        only(format!(
            "this is no file of weights in the safetensors format: {e}"
        ))
    })?;
    let text = metadata.metadata().as_ref().and_then(|all| all.get(KEY));
    let Some(text) = text else {
        return Err(only(format!(
            "the metadata have no {} that says what the network sees and acts on: train it by `pinode train`",
            quoted(KEY)
        )));
    };
    let card: Card = serde_json::from_str(text)
        .map_err(|e| only(format!("the card under {} is faulty: {e}", quoted(KEY))))?;
    if card.format != FORMAT {
        return Err(only(format!(
            "the card has format {}, and this program reads format {FORMAT}",
            card.format
        )));
    }
    let mut faults = Vec::new();
    let features = read_features(&card, names, &mut faults);
    let outputs = read_joints(&card, names, &mut faults);
    let mut activation = |key: &str, name: &str| {
        let found = Activation::from_name(name);
        if found.is_none() {
            faults.push(format!(
                "`{key}` is {}: it must be relu, tanh or identity",
                quoted(name)
            ));
        }
        found
    };
    let (hidden, output) = (
        activation("hidden", &card.hidden),
        activation("output", &card.output),
    );
    let layers = read_layers(&tensors, &mut faults);
    let region = read_region(&tensors, card.reach, features.len(), &mut faults);
    let (Some(hidden), Some(output), true) = (hidden, output, faults.is_empty()) else {
        return Err(faults);
    };
    let (sizes, parameters) = layers;
    let shape = Shape::new(&sizes, hidden, output).map_err(|e| only(e.to_string()))?;
    let network = Mlp::from_parameters(shape, parameters).map_err(|e| only(e.to_string()))?;
    let mut force = LearntForce::new(network, features, outputs, card.alone)
        .map_err(|e| only(e.to_string()))?;
    force.region = region;
    Ok(Stored {
        force,
        card,
        sha256: crate::disk::sha256(bytes),
        single: tensors
            .tensors()
            .iter()
            .all(|(_, tensor)| tensor.dtype() == Dtype::F32),
    })
}

fn read_features(card: &Card, names: Names<'_>, faults: &mut Vec<String>) -> Vec<Feature> {
    let mut features = Vec::new();
    for FeatureCard {
        name,
        offset,
        width,
        range,
    } in &card.features
    {
        let numbers = [*offset, *width, range[0], range[1]];
        if numbers.iter().any(|x| !x.is_finite()) || *width <= 0.0 || range[0] > range[1] {
            faults.push(format!(
                "{} has offset {offset}, width {width} and range {range:?}: all must be finite, the width positive, the range in order",
                quoted(name)
            ));
        }
        match Quantity::from_name(name, names.coordinates, names.inputs) {
            Some(quantity) => features.push(Feature {
                quantity,
                offset: *offset,
                width: *width,
                range: *range,
            }),
            None => faults.push(format!(
                "the network sees {}, which this model does not have: the file is another model's, or a joint or input was renamed",
                quoted(name)
            )),
        }
    }
    features
}

fn read_joints(card: &Card, names: Names<'_>, faults: &mut Vec<String>) -> Vec<Output> {
    let known: Vec<&str> = names.coordinates.iter().map(|c| c.name.as_str()).collect();
    let mut outputs: Vec<Output> = Vec::new();
    for JointCard { name, scale } in &card.joints {
        if !scale.is_finite() || *scale == 0.0 {
            faults.push(format!(
                "the scale of {} is {scale}: it must be finite and not 0",
                quoted(name)
            ));
        }
        match known.iter().position(|known| known == name) {
            Some(c) if names.coordinates[c].floating => faults.push(format!(
                "{} is the pose of a body that floats: a network acts on joints of one coordinate",
                quoted(name)
            )),
            Some(c) if outputs.iter().any(|output| output.coordinate == c) => {
                faults.push(format!("{} is there twice among the joints", quoted(name)));
            }
            Some(coordinate) => outputs.push(Output {
                coordinate,
                scale: *scale,
            }),
            None => faults.push(format!(
                "the network acts on {}{}",
                quoted(name),
                hint(name, "joints", &known)
            )),
        }
    }
    outputs
}

/// The states that cover the training data, where the file has them.
fn read_region(
    tensors: &SafeTensors<'_>,
    reach: Option<f64>,
    features: usize,
    faults: &mut Vec<String>,
) -> Option<Region> {
    let tensor = tensors.tensor(REGION).ok();
    let (tensor, reach) = match (tensor, reach) {
        (None, None) => return None,
        (Some(tensor), Some(reach)) => (tensor, reach),
        (found, _) => {
            let (has, lacks) = match found {
                Some(_) => ("the tensor `region`", "`reach` in its card"),
                None => ("`reach` in its card", "the tensor `region`"),
            };
            faults.push(format!(
                "the file has {has} and lacks {lacks}: both or neither are needed"
            ));
            return None;
        }
    };
    let fits = matches!(tensor.shape(), [points, inputs] if *points > 0 && *inputs == features);
    if !fits || tensor.dtype() != Dtype::F32 {
        faults.push(format!(
            "the tensor `region` holds {:?} of the shape {:?}: F32 of points × {features} features are needed",
            tensor.dtype(),
            tensor.shape()
        ));
        return None;
    }
    let (whole, _) = tensor.data().as_chunks::<4>();
    let points = whole.iter().map(|b| f32::from_le_bytes(*b)).collect();
    let region = Region::of(points, features, reach);
    if region.is_none() {
        faults.push(format!(
            "`reach` is {reach}, with the points of the tensor `region`: all must be finite, and it positive"
        ));
    }
    region
}

/// The sizes of the layers and their parameters, in the order of [`Mlp::parameters`].
fn read_layers(tensors: &SafeTensors<'_>, faults: &mut Vec<String>) -> (Vec<usize>, Vec<f64>) {
    let (mut sizes, mut parameters) = (Vec::new(), Vec::new());
    let names = tensors.names();
    let of_layers = names.iter().filter(|name| **name != REGION).count();
    let count = of_layers / 2;
    if of_layers == 0 || !of_layers.is_multiple_of(2) {
        faults.push(format!(
            "there are {of_layers} tensors of layers: a weight and a bias a layer are needed"
        ));
        return (sizes, parameters);
    }
    for k in 0..count {
        for (name, rank) in [
            (format!("layers.{k}.weight"), 2),
            (format!("layers.{k}.bias"), 1),
        ] {
            let Ok(tensor) = tensors.tensor(&name) else {
                faults.push(format!("the tensor {} is missing", quoted(&name)));
                continue;
            };
            let shape = tensor.shape();
            let fits = match (shape, sizes.last()) {
                ([outputs, inputs], None) => {
                    sizes.extend([*inputs, *outputs]);
                    true
                }
                ([outputs, inputs], Some(last)) if inputs == last => {
                    sizes.push(*outputs);
                    true
                }
                ([outputs], Some(last)) => outputs == last,
                _ => false,
            };
            if !fits || shape.len() != rank {
                faults.push(format!(
                    "the tensor {} has the shape {shape:?}, which does not follow on {sizes:?}",
                    quoted(&name)
                ));
            }
            match tensor.dtype() {
                Dtype::F64 => {
                    let (whole, _) = tensor.data().as_chunks::<8>();
                    parameters.extend(whole.iter().map(|b| f64::from_le_bytes(*b)));
                }
                Dtype::F32 => {
                    let (whole, _) = tensor.data().as_chunks::<4>();
                    parameters.extend(whole.iter().map(|b| f64::from(f32::from_le_bytes(*b))));
                }
                other => faults.push(format!(
                    "the tensor {} holds {other:?}: F32 or F64 is needed",
                    quoted(&name)
                )),
            }
        }
    }
    if parameters.iter().any(|x| !x.is_finite()) {
        faults.push("a weight is not finite".to_owned());
    }
    (sizes, parameters)
}
