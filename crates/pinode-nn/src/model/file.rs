//! Reading a model file: all faults of it, and of the URDF it names, at once.

use std::ffi::OsStr;
use std::fs::File;
use std::io::Read;
use std::path::Path;

use lagrange::{Position, Problem, Problems};
use toml::de::DeTable;

use super::document::{Faults, Section};
use super::mechanism;
use super::networks::NetworkEntry;
use super::{
    Input, Model, band, effects, inputs, log_columns, massless, networks, sensor, tolerance,
};
use crate::Error;
use crate::naming::quoted;

/// A larger model file is refused.
const LARGEST: u64 = 16 << 20;

/// The text of the model file at `path`.
pub(super) fn text(path: &Path) -> Result<String, Error> {
    let problem = |problem: Problem| {
        Error::Problems(Problems {
            source: path.display().to_string(),
            list: vec![problem],
        })
    };
    let logs = ["csv", "parquet", "mcap"];
    let is_log = |name: &OsStr| logs.iter().any(|log| name.eq_ignore_ascii_case(log));
    if path.extension().is_some_and(is_log) && path.is_file() {
        return Err(problem(Problem::general(
            "this is a log by its name, and stands where the model is to be, a TOML file: the model comes first, then the logs",
        )));
    }
    let mut bytes = Vec::new();
    File::open(path)
        .and_then(|file| file.take(LARGEST + 1).read_to_end(&mut bytes))
        .map_err(|e| Error::io(path, e))?;
    if bytes.len() as u64 > LARGEST {
        return Err(problem(Problem::general(
            "the file is larger than 16 MiB: it is no model",
        )));
    }
    String::from_utf8(bytes).map_err(|e| {
        let valid = e.utf8_error().valid_up_to();
        let before = String::from_utf8_lossy(e.as_bytes().get(..valid).unwrap_or_default());
        problem(Problem::at(
            Position::of(&before, before.len()),
            "this byte is not UTF-8: a model is a TOML text in UTF-8",
        ))
    })
}

/// What to do with a robot's description that stands where the model is to be: no TOML begins with `<`.
fn robot_for_model(path: &Path, text: &str) -> Option<Problem> {
    if !text
        .trim_start_matches('\u{feff}')
        .trim_start()
        .starts_with('<')
    {
        return None;
    }
    let named = |path: &Path| path.file_name()?.to_str().map(quoted);
    let name = named(path).unwrap_or_default();
    let toml = named(&path.with_extension("toml")).unwrap_or_default();
    let urdf = named(&path.with_extension("urdf")).unwrap_or_default();
    let first = match path.extension().is_some_and(|e| e == "xacro") {
        true => format!("expand it by `xacro`, write the result to {urdf}, and beside it "),
        false => "beside it ".to_owned(),
    };
    Some(Problem::general(format!(
        "this is XML, a URDF it seems, and a model is a TOML file that names one: {first}write a file {toml} with this line, and give \
         that file instead\n\n    urdf = \"{}\"\n\nJoints, masses and <dynamics> come from {name}; inputs, effects and sensors stand in the TOML file",
        if first.starts_with("expand") {
            &urdf
        } else {
            &name
        }
        .trim_matches('`')
    )))
}

/// The model in `text`; `path` is its name in messages, and its folder is where its URDF is looked for.
pub(super) fn parse(path: &Path, text: String, strict: bool) -> Result<Model, Error> {
    let source = path.display().to_string();
    if let Some(problem) = robot_for_model(path, &text) {
        return Err(Error::Problems(Problems {
            source,
            list: vec![problem],
        }));
    }
    let mut faults = Faults::default();
    let (document, syntax) = DeTable::parse_recoverable(&text);
    for error in &syntax {
        faults.at(
            error.span().map_or(0, |span| span.start),
            error.message().trim().replace('\n', ", "),
        );
    }
    if !faults.is_empty() {
        return Err(Error::Problems(Problems {
            source,
            list: faults.into_problems(&text),
        }));
    }
    let root = Section {
        title: "the model".to_owned(),
        table: document.get_ref(),
        offset: 0,
    };
    root.check_keys(
        &[
            "name",
            "urdf",
            "gravity",
            "base",
            "pose",
            "roll_axis",
            "mimic",
            "urdf_dynamics",
            "lagrangian",
            "input",
            "effect",
            "sensor",
            "tolerance",
            "mass_scale",
            "log",
            "loop",
            "band",
        ],
        &mut faults,
    );
    let name = root.string("name", &mut faults);
    let (mut foreign, mut warnings) = (Vec::new(), Vec::new());
    let mechanism = mechanism::read(
        &root,
        path,
        &text,
        strict,
        &mut faults,
        &mut foreign,
        &mut warnings,
    );
    let mechanics = mechanism.as_ref().map(|m| m.mechanics.as_ref());
    let inputs = inputs::read(&root, mechanism.as_ref(), &mut faults);
    let named: Vec<Input> = inputs.iter().map(|(input, _)| input.clone()).collect();
    let mut entries = effects::read(&root, mechanism.as_ref(), &named, &mut faults);
    let networks = networks::read(&root, path, mechanism.as_ref(), &named, &mut faults);
    let has_ensemble = networks.iter().any(NetworkEntry::is_member);
    let band = band::read(&root, mechanism.as_ref(), has_ensemble, &mut faults);
    let sensors = sensor::read(&root, mechanism.as_ref(), &mut faults);
    let tolerance = tolerance::read(&root, mechanism.as_ref(), &mut faults);
    let parameter_values = tolerance::parameter_values(&root, mechanics, &mut faults);
    let columns = log_columns::read(&root, mechanics, &named, &mut faults);
    if let Some(mechanics) = mechanics {
        massless::check(&root, mechanics, &parameter_values, &mut faults);
    }

    let Some(mechanism) = mechanism.filter(|_| faults.is_empty()) else {
        return Err(Error::Problems(together(source, &text, faults, foreign)));
    };
    let mut own = Vec::new();
    effects::add_joint_friction(
        &mechanism.friction,
        mechanism.mechanics.as_ref(),
        &text,
        &mut entries,
        &mut own,
    );
    if !own.is_empty() {
        warnings.push(Problems { source, list: own });
    }
    let stem = path.file_stem().and_then(|stem| stem.to_str());
    Ok(Model {
        name: name
            .map(|name| name.value.to_owned())
            .or(mechanism.name)
            .or(stem.map(str::to_owned))
            .unwrap_or_default(),
        path: path.to_owned(),
        mechanics: mechanism.mechanics,
        constraints: mechanism.constraints,
        tree: mechanism.tree,
        pose: mechanism.pose,
        parameter_values,
        inputs: named,
        effects: entries.into_iter().map(|(_, entry)| entry).collect(),
        networks,
        band,
        sensors,
        tolerance,
        columns,
        warnings,
        urdf: mechanism.urdf,
        text,
    })
}

/// The faults of the model file and those of the URDF; the URDF's alone keep their own source.
fn together(source: String, text: &str, faults: Faults, foreign: Vec<Problems>) -> Problems {
    let mut list = faults.into_problems(text);
    let mut foreign = foreign.into_iter();
    if list.is_empty()
        && let Some(only) = foreign.next()
    {
        return only;
    }
    for other in foreign {
        for problem in other.list {
            let separator = if problem.position.is_some() {
                ":"
            } else {
                ": "
            };
            list.push(Problem::general(format!(
                "{}{separator}{problem}",
                other.source
            )));
        }
    }
    if list.is_empty() {
        list.push(Problem::general("the mechanism cannot be read"));
    }
    Problems { source, list }
}
