//! `pinode export`: the learnt forces of a model as ONNX files, one a network.

use std::collections::BTreeSet;
use std::fmt::Write;
use std::path::{Path, PathBuf};

use clap::ValueEnum;
use serde::Serialize;

use super::Output;
use crate::Error;
use crate::disk::{Staged, refuse_overwriting};
use crate::learnt::{Described, onnx};
use crate::model::{Model, NetworkEntry};

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// The model, a TOML file with networks in it
    model: PathBuf,
    /// Folder for the ONNX files, one a network, with the names of the weights' files; made where it is missing
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Precision of all numbers, the scaling's too; f64 where positions are large beside their changes [default: that of the weights]
    #[arg(long, value_enum)]
    precision: Option<Precision>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Precision {
    /// 32 bits
    F32,
    /// 64 bits
    F64,
}

/// What `--json` prints.
#[derive(Serialize)]
struct Report {
    networks: Vec<Exported>,
}

/// One file.
#[derive(Serialize)]
struct Exported {
    file: String,
    weights: String,
    precision: &'static str,
    opset: i64,
    input: Tensor,
    output: Tensor,
    /// Whether the inputs act on their joints through them alone.
    alone: bool,
    /// The part of its forces that counts: 1 over the number of members of its ensemble.
    share: f64,
}

#[derive(Serialize)]
struct Tensor {
    name: &'static str,
    columns: Vec<Described>,
}

pub(super) fn run(arguments: &Arguments, output: &Output) -> Result<(), Error> {
    let model = output.load_model(&arguments.model)?;
    if model.networks.is_empty() {
        return Err(Error::NoNetwork {
            path: model.path.clone(),
            work: "export",
        });
    }
    let out = arguments.out.as_path();
    let mut taken = BTreeSet::new();
    let (mut networks, mut files) = (Vec::new(), Vec::new());
    for entry in &model.networks {
        let path = free_name(out, entry, &mut taken);
        refuse_overwriting(std::slice::from_ref(&path), &model.files())?;
        let single = match arguments.precision {
            Some(precision) => precision == Precision::F32,
            None => entry.single,
        };
        files.push((path.clone(), onnx::to_bytes(&model, entry, single)?));
        networks.push(exported(&model, entry, &path, single));
    }
    std::fs::create_dir_all(out).map_err(|e| Error::io(out, e))?;
    let staged = files.iter().map(|(path, bytes)| Staged::write(path, bytes));
    let staged = staged.collect::<Result<Vec<_>, _>>()?;
    staged.into_iter().try_for_each(Staged::commit)?;
    let report = Report { networks };
    output.result(&report, &text(&report))
}

/// The name of the weights' file with another ending; a number is added where another network of the model has it.
fn free_name(out: &Path, entry: &NetworkEntry, taken: &mut BTreeSet<PathBuf>) -> PathBuf {
    let stem = entry.path.file_stem().unwrap_or_default().to_string_lossy();
    let mut path = out.join(format!("{stem}.onnx"));
    let mut count = 1;
    while !taken.insert(path.clone()) {
        count += 1;
        path = out.join(format!("{stem}-{count}.onnx"));
    }
    path
}

fn exported(model: &Model, entry: &NetworkEntry, path: &Path, single: bool) -> Exported {
    Exported {
        file: path.display().to_string(),
        weights: entry.path.display().to_string(),
        precision: if single { "f32" } else { "f64" },
        opset: onnx::OPSET,
        input: Tensor {
            name: onnx::INPUT,
            columns: entry.sees(model),
        },
        output: Tensor {
            name: onnx::OUTPUT,
            columns: entry.gives(model),
        },
        alone: entry.force.is_alone(),
        share: entry.share,
    }
}

fn text(report: &Report) -> String {
    let mut out = String::new();
    // Writing to a String cannot fail.
    for network in &report.networks {
        let _ = writeln!(
            out,
            "{} ({}), from {}",
            network.file, network.precision, network.weights
        );
        for (way, tensor) in [("in", &network.input), ("out", &network.output)] {
            let _ = writeln!(
                out,
                "  {way} `{}` [batch, {}]:",
                tensor.name,
                tensor.columns.len()
            );
            for Described {
                name,
                unit,
                meaning,
            } in &tensor.columns
            {
                let _ = writeln!(out, "    {name} [{unit}], {meaning}");
            }
        }
        if network.share < 1.0 {
            let _ = writeln!(
                out,
                "  a member of an ensemble of {:.0}: the force is their mean",
                network.share.recip()
            );
        }
        if network.alone {
            let _ = writeln!(
                out,
                "  the inputs act on these joints through the network alone; effects of the model come beside it"
            );
        }
    }
    out
}
