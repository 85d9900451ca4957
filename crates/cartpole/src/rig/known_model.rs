//! The model that the user of the rig has: complete but for the hidden effect.

use std::path::{Path, PathBuf};

use toml_edit::{DocumentMut, Item, Table};

use super::recording::write_whole;
use super::{Error, Hidden};

/// Writes the user's model for this draw to `out_dir/model.toml`, with its URDF beside it, and returns the model's path.
///
/// It is `models_dir/cartpole.toml` without the effect of the hidden kind on the hidden joint, when there is one. What is hidden behind
/// asymmetric, Stribeck, position-dependent, Dahl's or LuGre friction is the law, so the plain friction stays: it is then the wrong law.
pub fn known_model(hidden: &Hidden, models_dir: &Path, out_dir: &Path) -> Result<PathBuf, Error> {
    known_model_without(std::slice::from_ref(hidden), models_dir, out_dir)
}

/// [`known_model`] for several hidden effects.
pub fn known_model_without(
    hidden: &[Hidden],
    models_dir: &Path,
    out_dir: &Path,
) -> Result<PathBuf, Error> {
    let source = models_dir.join("cartpole.toml");
    let fault = |reason: String| Error::Model {
        path: source.clone(),
        reason,
    };
    let text = std::fs::read_to_string(&source).map_err(Error::io(&source))?;
    let mut model: DocumentMut = text
        .parse()
        .map_err(|e: toml_edit::TomlError| fault(e.to_string()))?;
    let urdf = model
        .get("urdf")
        .and_then(Item::as_str)
        .ok_or_else(|| fault("has no `urdf = \"…\"`: the rig's model is a URDF".into()))?
        .to_owned();
    if let Some(effects) = model
        .get_mut("effect")
        .and_then(Item::as_array_of_tables_mut)
    {
        effects.retain(|effect| {
            !hidden.iter().any(|hidden| {
                let target = hidden.target();
                target.is_some_and(|target| is(effect, hidden.kind(), target.name()))
            })
        });
        if effects.is_empty() {
            model.remove("effect");
        }
    }
    // The copy lies beside the model, whatever folder it came from.
    let name = Path::new(&urdf)
        .file_name()
        .ok_or_else(|| fault(format!("urdf = \"{urdf}\" names no file")))?;
    model["urdf"] = toml_edit::value(name.to_string_lossy().into_owned());
    let mechanism = models_dir.join(&urdf);
    let bytes = std::fs::read(&mechanism).map_err(Error::io(&mechanism))?;
    std::fs::create_dir_all(out_dir).map_err(Error::io(out_dir))?;
    write_whole(&out_dir.join(name), &bytes)?;
    let path = out_dir.join("model.toml");
    write_whole(&path, model.to_string().as_bytes())?;
    Ok(path)
}

/// Whether an effect of a model is of this kind on this joint or input.
fn is(effect: &Table, kind: &str, target: &str) -> bool {
    let text = |key: &str| effect.get(key).and_then(Item::as_str);
    text("kind") == Some(kind) && (text("joint") == Some(target) || text("input") == Some(target))
}
