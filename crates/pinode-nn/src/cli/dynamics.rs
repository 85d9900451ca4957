//! `pinode dynamics`: the equations of motion at given states, JSON in and out.

use std::path::{Path, PathBuf};

use lagrange::{Mechanics, Position, Problem, Problems, Workspace};
use nalgebra::{DMatrix, DVector};
use serde_json::{Value, json};

use super::output::Output;
use crate::Error;
use crate::model::Model;

/// More problems than these are only counted.
const MOST_PROBLEMS: usize = 20;

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// The model, a TOML file
    model: PathBuf,
    /// {"states": [{"q": […], "v": […], "tau": […]}, …]}; tau is the total generalized force Q
    states: PathBuf,
}

pub(super) fn run(arguments: &Arguments, output: &Output) -> Result<(), Error> {
    let model = output.load_model(&arguments.model)?;
    let path = &arguments.states;
    let bytes = std::fs::read(path).map_err(|e| Error::io(path, e))?;
    let states = read(path, &bytes, &model)?;
    output.document(&evaluate(path, &model, &states)?)
}

struct State {
    q: Vec<f64>,
    v: Vec<f64>,
    tau: Vec<f64>,
}

/// The states in `bytes`, or everything that is wrong with them.
fn read(path: &Path, bytes: &[u8], model: &Model) -> Result<Vec<State>, Error> {
    let fail = |mut list: Vec<Problem>| {
        let more = list.len().saturating_sub(MOST_PROBLEMS);
        if more > 0 {
            list.truncate(MOST_PROBLEMS);
            list.push(Problem::general(format!("and {more} more")));
        }
        Error::Problems(Problems {
            source: path.display().to_string(),
            list,
        })
    };
    let document: Value = serde_json::from_slice(bytes).map_err(|e| {
        let position = Position {
            line: e.line().max(1),
            column: e.column().max(1),
        };
        let text = e.to_string();
        let message = text.split(" at line ").next().unwrap_or(&text).to_owned();
        fail(vec![Problem::at(position, message)])
    })?;
    let Some(list) = document.get("states").and_then(Value::as_array) else {
        return Err(fail(vec![Problem::general(
            "no array `states`: the document must be {\"states\": [{\"q\": […], \"v\": […], \"tau\": […]}, …]}",
        )]));
    };
    let mut problems = Vec::new();
    let mut states = Vec::with_capacity(list.len());
    for (i, state) in list.iter().enumerate() {
        let mut vector = |key: &str| vector(model, state, i, key, &mut problems);
        let (q, v, tau) = (vector("q"), vector("v"), vector("tau"));
        if let (Some(q), Some(v), Some(tau)) = (q, v, tau) {
            states.push(State { q, v, tau });
        }
    }
    if problems.is_empty() {
        Ok(states)
    } else {
        Err(fail(problems))
    }
}

fn vector(
    model: &Model,
    state: &Value,
    i: usize,
    key: &str,
    problems: &mut Vec<Problem>,
) -> Option<Vec<f64>> {
    let mut problem = |message: String| {
        problems.push(Problem::general(format!("states[{i}].{key}{message}")));
        None
    };
    let list = match state.get(key) {
        Some(Value::Array(list)) => list,
        Some(_) => return problem(" is not an array of numbers".into()),
        None => return problem(" is missing".into()),
    };
    let coordinates = model.mechanics.coordinates();
    if list.len() != coordinates.len() {
        let names: Vec<&str> = coordinates.iter().map(|c| c.name.as_str()).collect();
        return problem(format!(
            " has {} entries, the model has {} coordinates: {}",
            list.len(),
            names.len(),
            names.join(", ")
        ));
    }
    let mut numbers = Vec::with_capacity(list.len());
    for (k, value) in list.iter().enumerate() {
        match value.as_f64().filter(|x| x.is_finite()) {
            Some(x) => numbers.push(x),
            None => return problem(format!("[{k}] is {value}, not a finite number")),
        }
    }
    Some(numbers)
}

/// The output document.
fn evaluate(path: &Path, model: &Model, states: &[State]) -> Result<Value, Error> {
    let mechanics = &*model.mechanics;
    let p = &model.parameter_values;
    let n = mechanics.nv();
    let mut work = mechanics.workspace();
    let mut problems = Vec::new();
    let mut results = Vec::with_capacity(states.len());
    for (i, State { q, v, tau }) in states.iter().enumerate() {
        let mut mass = DMatrix::zeros(n, n);
        let mut coriolis = DMatrix::zeros(n, n);
        let mut gravity = DVector::zeros(n);
        let mut bias = DVector::zeros(n);
        let mut acceleration = DVector::from_column_slice(tau);
        mechanics.mass_matrix_into(q, p, &mut work, &mut mass);
        mechanics.coriolis_matrix_into(q, v, p, &mut work, &mut coriolis);
        mechanics.gravity_force_into(q, p, &mut work, &mut gravity);
        mechanics.bias_force_into(q, v, p, &mut work, &mut bias);
        let kinetic = mechanics.kinetic_energy_with(q, v, p);
        let potential = mechanics.potential_energy_with(q, p);
        let named: [(&str, &[f64]); 6] = [
            ("mass_matrix", mass.as_slice()),
            ("coriolis_matrix", coriolis.as_slice()),
            ("gravity_force", gravity.as_slice()),
            ("bias_force", bias.as_slice()),
            ("kinetic_energy", &[kinetic]),
            ("potential_energy", &[potential]),
        ];
        let infinite = named
            .iter()
            .find(|(_, numbers)| numbers.iter().any(|x| !x.is_finite()));
        if let Some((name, _)) = infinite {
            problems.push(Problem::general(format!(
                "states[{i}]: {name} is not finite there: the energies have a singular point at or near this state"
            )));
            continue;
        }
        let multipliers = match accelerate(mechanics, (q, v), p, &mut work, &mut acceleration) {
            Ok(multipliers) => multipliers,
            Err(e) => {
                problems.push(Problem::general(format!("states[{i}]: {e}")));
                continue;
            }
        };
        // C is defined for T quadratic in v; where C v + G is not the bias force there is no such C.
        let error = (&coriolis * DVector::from_column_slice(v) + &gravity - &bias).amax();
        let has_coriolis = error <= 1e-9 * (1.0 + bias.amax());
        let mut result = json!({
            "mass_matrix": rows(&mass),
            "coriolis_matrix": has_coriolis.then(|| rows(&coriolis)),
            "gravity_force": gravity.as_slice(),
            "bias_force": bias.as_slice(),
            "acceleration": acceleration.as_slice(),
            "kinetic_energy": kinetic,
            "potential_energy": potential,
        });
        if let Some(multipliers) = multipliers {
            result["multipliers"] = multipliers;
        }
        results.push(result);
    }
    if !problems.is_empty() {
        return Err(Error::Problems(Problems {
            source: path.display().to_string(),
            list: problems,
        }));
    }
    let coordinates: Vec<Value> = mechanics
        .coordinates()
        .iter()
        .map(|c| json!({ "name": c.name, "joint": c.joint, "nq": 1, "nv": 1, "unit": c.unit() }))
        .collect();
    Ok(json!({ "coordinates": coordinates, "states": results }))
}

/// `acceleration` holds Q and becomes v̇. Under constraints, M v̇ + C v + G = Q + Jᵀ λ and J v̇ + J̇ v = 0 at the state as it is
/// given: λ by name, with the residual φ and its rate J v, which are 0 where the state obeys the constraints.
fn accelerate(
    mechanics: &dyn Mechanics,
    (q, v): (&[f64], &[f64]),
    p: &[f64],
    work: &mut Workspace,
    acceleration: &mut DVector<f64>,
) -> Result<Option<Value>, lagrange::Error> {
    let Some(constraints) = mechanics.constraints() else {
        mechanics.forward_dynamics_into(q, v, p, work, acceleration)?;
        return Ok(None);
    };
    let names = constraints.names();
    let mut multipliers = DVector::zeros(names.len());
    constraints.multipliers_into(q, v, p, work, acceleration, &mut multipliers)?;
    let mut residual = DVector::zeros(names.len());
    constraints.residual_into(q, p, work, &mut residual);
    let mut jacobian = DMatrix::zeros(names.len(), v.len());
    constraints.jacobian_into(q, p, work, &mut jacobian);
    let rate = jacobian * DVector::from_column_slice(v);
    let list: Vec<Value> = names
        .iter()
        .zip(multipliers.iter().zip(residual.iter().zip(rate.iter())))
        .map(|(name, (value, (residual, rate)))| {
            json!({ "name": name, "value": value, "residual": residual, "rate": rate })
        })
        .collect();
    Ok(Some(list.into()))
}

fn rows(matrix: &DMatrix<f64>) -> Vec<Vec<f64>> {
    matrix
        .row_iter()
        .map(|row| row.iter().copied().collect())
        .collect()
}
