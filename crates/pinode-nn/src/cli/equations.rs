//! `pinode equations`: the equations of motion as formulas, and as functions in Rust and C.

use std::path::{Path, PathBuf};

use clap::ValueEnum;
use lagrange::{Role, Style, Written};
use serde_json::{Value, json};

use super::output::Output;
use crate::Error;
use crate::disk::refuse_overwriting;
use crate::model::Model;

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// The model, a TOML file
    model: PathBuf,
    /// How formulas are written
    #[arg(long, value_enum, default_value_t = Format::Text, conflicts_with = "emit")]
    format: Format,
    /// Write a stand-alone function instead, which needs nothing but the standard library (of C: math.h)
    #[arg(long, value_enum, value_name = "LANGUAGE")]
    emit: Option<Language>,
    /// Write to this file [default: stdout]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Numbers in place of the constants that the model names
    #[arg(long, conflicts_with = "parameters")]
    numeric: bool,
    /// Names in place of all constants, also of the factors on the masses of a URDF
    #[arg(long)]
    parameters: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Format {
    /// As a model file has them
    Text,
    /// For a document with the package amsmath
    Latex,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Language {
    /// Rust, without crates
    Rust,
    /// C99
    C,
}

pub(super) fn run(arguments: &Arguments, output: &Output) -> Result<(), Error> {
    let model = output.load_model(&arguments.model)?;
    let bound = bound(arguments, &model);
    let formulas = model.mechanics.formulas(&bound)?;
    if model.mechanics.constraints().is_some() {
        output.note(
            "note: this mechanism is constrained, M v̇ + C v + G = Q + Jᵀλ; M, C and G are written, J is not",
        );
    }
    let text = match (arguments.emit, arguments.format) {
        (Some(Language::Rust), _) => formulas.emit_rust(&model.name),
        (Some(Language::C), _) => formulas.emit_c(&model.name),
        (None, Format::Text) => formulas.to_text(),
        (None, Format::Latex) => formulas.to_latex(),
    };
    if let Some(path) = &arguments.out {
        write(path, &model, &text)?;
    }
    if output.json {
        let style = match arguments.format {
            Format::Text => Style::Text,
            Format::Latex => Style::Latex,
        };
        let mut document = document(&model, &formulas.written(style), &bound);
        if let (Some(_), Some(fields)) = (arguments.emit, document.as_object_mut()) {
            fields.insert("code".into(), text.into());
        }
        return output.document(&document);
    }
    match &arguments.out {
        Some(path) => {
            output.note(&format!("written to {}", path.display()));
            Ok(())
        }
        None => output.result(&(), &text),
    }
}

/// The numbers that stand for constants: by default for the factors on masses alone.
fn bound(arguments: &Arguments, model: &Model) -> Vec<Option<f64>> {
    let parameters = model.mechanics.parameters().iter();
    parameters
        .zip(&model.parameter_values)
        .map(|(parameter, &value)| {
            let as_number = match parameter.role {
                Role::MassScale => !arguments.parameters,
                _ => arguments.numeric,
            };
            as_number.then_some(value)
        })
        .collect()
}

/// Writes the file, unless it is one of the model's.
fn write(path: &Path, model: &Model, text: &str) -> Result<(), Error> {
    refuse_overwriting(&[path.to_owned()], &model.files())?;
    std::fs::write(path, text).map_err(|e| Error::io(path, e))
}

fn document(model: &Model, written: &Written, bound: &[Option<f64>]) -> Value {
    let named = |names: &[String]| -> Vec<Value> { names.iter().map(|n| json!(n)).collect() };
    let parameters = written.parameters.iter().zip(&model.parameter_values);
    let parameters: Vec<Value> = parameters
        .zip(bound)
        .map(|((name, value), bound)| {
            json!({ "name": name, "value": value, "symbol": bound.is_none() })
        })
        .collect();
    let definitions: Vec<Value> = written
        .definitions
        .iter()
        .map(|(name, formula)| json!({ "name": name, "formula": formula }))
        .collect();
    json!({
        "model": model.name,
        "constrained": model.mechanics.constraints().is_some(),
        "coordinates": named(&written.coordinates),
        "velocities": named(&written.velocities),
        "parameters": parameters,
        "definitions": definitions,
        "mass_matrix": written.mass_matrix,
        "coriolis_matrix": written.coriolis_matrix,
        "gravity_force": written.gravity_force,
        "bias_force": written.bias_force,
        "kinetic_energy": written.kinetic_energy,
        "potential_energy": written.potential_energy,
    })
}
