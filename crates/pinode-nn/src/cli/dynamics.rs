//! `pinode dynamics`: the equations of motion at given states, JSON in and out.
//!
//! q has the entries of all coordinates one after the other, v and tau those of their velocities. A floating body has seven in q,
//! position and unit quaternion w x y z, and six in v and tau: linear, then angular, in the body's own axes. The rows and columns of
//! all matrices follow v. `coriolis_matrix` is Christoffel's where every coordinate is a single number; the velocities of a floating
//! body are no rates of coordinates, and there it is one of the C with C v + G = bias_force and Ṁ − 2C skew.
//!
//! Where T is not quadratic in v, `mass_matrix` is ∂²T/∂v∂v at the state, and M v̇ + bias_force = Q holds with it as always. The terms of T
//! without v or linear in it give forces that no C v can be; then `coriolis_matrix` is null, and `no_coriolis_matrix` says so.
//!
//! `--derivatives` adds `acceleration_by_q`, `acceleration_by_v` and `acceleration_by_tau`, nv × nv each, row i of the acceleration's
//! entry i. For a floating body the derivatives in q are along its velocities: column j is the rate of v̇ while q moves with v = e_j.

use std::path::{Path, PathBuf};

use lagrange::{Coordinate, ForwardDynamicsDerivatives, Mechanics, Workspace};
use lagrange::{Position, Problem, Problems, state};
use nalgebra::{DMatrix, DVector};
use serde_json::{Value, json};

use super::output::Output;
use crate::Error;
use crate::entries::starts;
use crate::model::Model;
use crate::naming::{hint, quoted};

/// What a state is made of.
const KEYS: [&str; 3] = ["q", "v", "tau"];
/// More problems than these are only counted.
const MOST_PROBLEMS: usize = 20;
/// A quaternion may be as much longer or shorter than 1, from rounding in a file; it is then made of length 1.
const QUATERNION_TOLERANCE: f64 = 1e-6;

/// Why `coriolis_matrix` is null.
const NO_CORIOLIS: &str = "T is not quadratic in v here, and no Christoffel matrix C gives C v + G = bias_force: the equations are \
     mass_matrix v̇ + bias_force = tau, with mass_matrix = ∂²T/∂v∂v at this state";

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// The model, a TOML file
    model: PathBuf,
    /// {"states": [{"q": […], "v": […], "tau": […]}, …]}; tau is the total generalized force Q
    states: PathBuf,
    /// Add the derivatives of the acceleration in q, v and tau
    #[arg(long)]
    derivatives: bool,
}

pub(super) fn run(arguments: &Arguments, output: &Output) -> Result<(), Error> {
    let model = output.load_model(&arguments.model)?;
    let path = &arguments.states;
    let bytes = std::fs::read(path).map_err(|e| Error::io(path, e))?;
    let states = read(path, &bytes, &model)?;
    output.document(&evaluate(path, &model, &states, arguments.derivatives)?)
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
        // Beside `states` the document may hold what it likes; within a state a key that nobody reads is a slip.
        let keys = state.as_object().into_iter().flat_map(|o| o.keys());
        for key in keys.filter(|key| !KEYS.contains(&key.as_str())) {
            problems.push(Problem::general(format!(
                "states[{i}]: unknown key {}{}",
                quoted(key),
                hint(key, "keys", &KEYS)
            )));
        }
        let mut vector = |key: &str| vector(model, state, i, key, &mut problems);
        let (q, v, tau) = (vector("q"), vector("v"), vector("tau"));
        let coordinates = model.mechanics.coordinates();
        let q = q.and_then(|q| on_the_manifold(coordinates, q, i, &mut problems));
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
    let length = |c: &Coordinate| if key == "q" { c.nq() } else { c.nv() };
    let expected: usize = coordinates.iter().map(length).sum();
    if list.len() != expected {
        let names: Vec<String> = coordinates
            .iter()
            .map(|c| match length(c) {
                1 => c.name.clone(),
                entries => format!("{} ({entries} entries)", c.name),
            })
            .collect();
        let takes = match expected == names.len() {
            true => format!("the model has {expected} coordinates"),
            false => format!("the model takes {expected}"),
        };
        return problem(format!(
            " has {} entries, {takes}: {}",
            list.len(),
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

/// q with its quaternions of length 1, unless one is far from that.
fn on_the_manifold(
    coordinates: &[Coordinate],
    mut q: Vec<f64>,
    i: usize,
    problems: &mut Vec<Problem>,
) -> Option<Vec<f64>> {
    let before = problems.len();
    for (coordinate, start) in coordinates.iter().zip(starts(coordinates)) {
        if !coordinate.floating {
            continue;
        }
        let quaternion = q.get(start.q + 3..start.q + 7).unwrap_or_default();
        let length = quaternion.iter().fold(0.0_f64, |l, x| l.hypot(*x));
        if (length - 1.0).abs() > QUATERNION_TOLERANCE {
            problems.push(Problem::general(format!(
                "states[{i}].q[{}..={}], the quaternion w x y z of `{}`, has length {length}: it must be 1 to within \
                 {QUATERNION_TOLERANCE:e}; divide it by its length",
                start.q + 3,
                start.q + 6,
                coordinate.name
            )));
        }
    }
    if problems.len() > before {
        return None;
    }
    state::normalize(coordinates, &mut q);
    Some(q)
}

/// The output document.
fn evaluate(
    path: &Path,
    model: &Model,
    states: &[State],
    derivatives: bool,
) -> Result<Value, Error> {
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
        mechanics.mass_matrix_at_into(q, v, p, &mut work, &mut mass);
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
            let depends_on_v = !matches!(*name, "gravity_force" | "potential_energy");
            let by_v = match depends_on_v {
                true => too_large(mechanics, (q, v), p, &mut work),
                false => None,
            };
            let why = by_v.unwrap_or_else(|| {
                "the energies have a singular point at or near this state, or are not defined there (the logarithm or the root of a negative number)".into()
            });
            problems.push(Problem::general(format!(
                "states[{i}]: {name} is not finite there: {why}"
            )));
            continue;
        }
        let moved = accelerate(mechanics, (q, v), p, &mut work, &mut acceleration);
        let finite = acceleration.iter().all(|x| x.is_finite());
        let (multipliers, failure) = match moved {
            Ok(multipliers) if finite => (multipliers, None),
            Ok(_) => (None, Some("the acceleration is not finite there: the mass matrix is nearly singular at this state".to_owned())),
            Err(e) => (None, Some(e.to_string())),
        };
        if let Some(failure) = failure {
            // Where the same state has an acceleration without tau, it is tau that takes it away.
            acceleration.fill(0.0);
            let idle = mechanics.forward_dynamics_into(q, v, p, &mut work, &mut acceleration);
            let good = idle.is_ok() && acceleration.iter().all(|x| x.is_finite());
            problems.push(Problem::general(match largest(tau) {
                Some((k, x)) if good => format!(
                    "states[{i}].tau[{k}] is {x:e}: the acceleration under it is beyond the range of numbers; check its unit and exponent"
                ),
                _ => format!("states[{i}]: {failure}"),
            }));
            continue;
        }
        // Christoffel's C is that of the part of T that is quadratic in v; where C v + G is not the bias force there is no such C.
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
        if !has_coriolis {
            result["no_coriolis_matrix"] = json!(NO_CORIOLIS);
        }
        if let Some(multipliers) = multipliers {
            result["multipliers"] = multipliers;
        }
        if derivatives {
            let mut by = ForwardDynamicsDerivatives::zeros(n, 0);
            let found =
                mechanics.forward_dynamics_derivatives_into(q, v, tau, p, &[], &mut work, &mut by);
            if let Err(e) = found {
                problems.push(Problem::general(format!("states[{i}]: {e}")));
                continue;
            }
            for (key, matrix) in [
                ("acceleration_by_q", &by.by_q),
                ("acceleration_by_v", &by.by_v),
                ("acceleration_by_tau", &by.by_force),
            ] {
                if matrix.iter().any(|x| !x.is_finite()) {
                    problems.push(Problem::general(format!(
                        "states[{i}]: {key} is not finite there, while the acceleration is: the energies have no second or third derivative at this state"
                    )));
                }
                result[key] = json!(rows(matrix));
            }
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
        .map(|c| json!({ "name": c.name, "joint": c.joint, "nq": c.nq(), "nv": c.nv(), "unit": c.unit() }))
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

/// The entry of `v` that makes the bias force or the kinetic energy overflow, where it is finite at rest.
fn too_large(
    mechanics: &dyn Mechanics,
    (q, v): (&[f64], &[f64]),
    p: &[f64],
    work: &mut Workspace,
) -> Option<String> {
    let rest = vec![0.0; v.len()];
    let mut bias = DVector::zeros(v.len());
    mechanics.bias_force_into(q, &rest, p, work, &mut bias);
    if bias.iter().any(|x| !x.is_finite()) {
        return None;
    }
    // At rest M is all that T has, so it is looked at as well.
    let mut mass = DMatrix::zeros(v.len(), v.len());
    mechanics.mass_matrix_into(q, p, work, &mut mass);
    if mass.iter().any(|x| !x.is_finite()) {
        return None;
    }
    let (k, x) = largest(v)?;
    Some(format!(
        "v[{k}] is {x:e}, and what is made of it is beyond the range of numbers; check its unit and exponent"
    ))
}

/// Index and value of the entry of largest magnitude, unless all are 0.
fn largest(list: &[f64]) -> Option<(usize, f64)> {
    let all = list.iter().copied().enumerate();
    all.max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))
        .filter(|(_, x)| *x != 0.0)
}

fn rows(matrix: &DMatrix<f64>) -> Vec<Vec<f64>> {
    matrix
        .row_iter()
        .map(|row| row.iter().copied().collect())
        .collect()
}
