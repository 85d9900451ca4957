//! `report.html`: a diagnosis for people, in one file that needs no network.

mod figures;
mod gaps;
mod page;
mod profiles;
mod ruled_out;
pub mod sheet;
mod sketch;
pub(crate) mod words;

use std::path::{Path, PathBuf};

use askama::Template;

use crate::Error;
use crate::diagnose::curves::Curves;
use crate::diagnose::verdict::Diagnosis;

pub use words::verdict as verdict_in_words;

/// Name of the report in its folder.
pub const FILE_NAME: &str = "report.html";

/// Writes `dir/report.html` whole or not at all, and returns its path. `model_toml` is the text of the new model, `command` what was
/// typed; both are shown.
///
/// # Errors
/// [`Error::Io`] when the folder cannot be written to.
pub fn write(
    dir: &Path,
    diagnosis: &Diagnosis,
    curves: &Curves,
    model_toml: &str,
    command: &str,
) -> Result<PathBuf, Error> {
    let path = dir.join(FILE_NAME);
    let page = render(diagnosis, curves, model_toml, command)?;
    crate::disk::write_atomically(&path, page.as_bytes())?;
    Ok(path)
}

/// The text of the report.
///
/// # Errors
/// [`Error::Io`] when the template fails.
pub(crate) fn render(
    diagnosis: &Diagnosis,
    curves: &Curves,
    model_toml: &str,
    command: &str,
) -> Result<String, Error> {
    page::Page::new(diagnosis, curves, model_toml, command)
        .render()
        .map_err(|e| Error::io(Path::new(FILE_NAME), std::io::Error::other(e)))
}

#[cfg(test)]
mod browser_tests;
#[cfg(test)]
mod tests;
