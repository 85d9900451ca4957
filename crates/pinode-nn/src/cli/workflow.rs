//! A diagnosis with its files, as both programs make it.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use sha2::{Digest, Sha256};

use super::Output;
use super::folder::Folder;
use super::interrupt::Interruptible;
use super::progress::Progress;
use crate::Error;
use crate::diagnose::kept::{self, Before, Kept};
use crate::diagnose::verdict::Diagnosis;
use crate::diagnose::{Means, diagnose_into};
use crate::disk::{Staged, refuse_overwriting};
use crate::log::Log;
use crate::model::Model;
use crate::report;

/// What to diagnose, and where to write.
#[derive(Debug, Clone, Copy)]
pub struct Task<'a> {
    /// The model.
    pub model: &'a Model,
    /// The logs; without `held_out`, their last quarter is not fitted.
    pub logs: &'a [Log],
    /// Logs that no fit may see.
    pub held_out: &'a [Log],
    /// The folder of the results; made where it is missing.
    pub out: &'a Path,
    /// Seed of everything random.
    pub seed: u64,
    /// What was typed, for the report.
    pub command: &'a str,
}

/// A diagnosis that has been written.
#[derive(Debug, Clone)]
pub struct Finished {
    /// What it says.
    pub diagnosis: Diagnosis,
    /// `report.html`.
    pub report: PathBuf,
    /// `diagnosis.json`.
    pub json: PathBuf,
    /// `model.toml`.
    pub model: PathBuf,
}

/// Diagnoses and writes `model.toml` (with its URDF beside it), `report.html` and `diagnosis.json`. All three are written under other
/// names first and renamed together at the end, so that no old file stands beside a new one; when something fails, no new file and no
/// new folder is left. Finished fits are kept in the folder meanwhile: a diagnosis that is interrupted goes on from them when it is begun
/// again with the same inputs, to the same bits. Drafts of the model that a killed diagnosis left in the folder are removed.
///
/// # Errors
/// Those of [`diagnose`](crate::diagnose::diagnose); [`Error::OverwritesInput`], [`Error::Io`].
pub fn run(task: &Task, output: &Output) -> Result<Finished, Error> {
    // Said before the work, not after it.
    let outputs = OWN_FILES.map(|name| task.out.join(name));
    let logs = task.logs.iter().chain(task.held_out);
    let mut inputs = task.model.files();
    inputs.extend(logs.map(|log| log.path.as_path()));
    refuse_overwriting(&outputs, &inputs)?;
    let folder = Folder::make(task.out)?;
    let finished = work(task, &folder, output);
    // Finished or failed: there is nothing to go on with. Where it cannot be removed, the next diagnosis empties it.
    let _ = std::fs::remove_file(task.out.join(kept::FILE_NAME));
    if finished.is_err() {
        folder.leave_as_it_was();
    }
    finished
}

/// SHA-256 of all that a diagnosis is made of: the program, the model with its URDF, the logs, the seed.
fn fingerprint(task: &Task) -> [u8; 32] {
    let mut text = env!("CARGO_PKG_VERSION").to_owned();
    // A program that was built anew may fit otherwise.
    let built = std::env::current_exe().and_then(std::fs::metadata);
    if let Ok(built) = built {
        text += &format!("\n{} {:?}", built.len(), built.modified().ok());
    }
    text += &format!("\n{}", task.model.sha256());
    for (logs, side) in [(task.logs, "fit"), (task.held_out, "held out")] {
        for log in logs {
            text += &format!("\n{side} {}", log.sha256);
        }
    }
    text += &format!("\n{}", task.seed);
    Sha256::digest(text).into()
}

fn work(task: &Task, folder: &Folder, output: &Output) -> Result<Finished, Error> {
    let progress = Progress::new(output);
    let [model, json, report] = OWN_FILES.map(|name| task.out.join(name));
    let draft = folder.draft().map_err(|e| Error::io(&model, e))?;
    let draft_name = draft.file_name().unwrap_or_default().to_string_lossy();
    let (kept, before) = Kept::open(task.out, &fingerprint(task))?;
    match before {
        Before::Nothing => {}
        Before::Same(fits) => output.note(&format!(
            "going on with the unfinished diagnosis in {}: {fits} of its fits are there",
            task.out.display()
        )),
        Before::Other => output.note(&format!(
            "the unfinished diagnosis in {} was of other inputs: begun anew",
            task.out.display()
        )),
    }
    let kept = Arc::new(kept);
    let interruptible = Interruptible::new(&kept, draft.to_path_buf(), output.quiet);
    let means = Means {
        kept: Some(Arc::clone(&kept)),
        ..Means::default()
    };
    let outcome = diagnose_into(
        task.model,
        task.logs,
        task.held_out,
        (task.out, &draft_name),
        task.seed,
        &|stage| progress.stage(stage),
        &means,
    )?;
    progress.stage("writing the report");
    let text = std::fs::read_to_string(&draft).map_err(|e| Error::io(&draft, e))?;
    let page = report::render(&outcome.diagnosis, &outcome.curves, &text, task.command)?;
    let mut bytes =
        serde_json::to_vec_pretty(&outcome.diagnosis).map_err(|e| Error::io(&json, e.into()))?;
    bytes.push(b'\n');
    let staged = [
        Staged::write(&report, page.as_bytes())?,
        Staged::write(&model, text.as_bytes())?,
        Staged::write(&json, &bytes)?,
    ];
    let _uninterrupted = interruptible.wait();
    staged.into_iter().try_for_each(Staged::commit)?;
    Ok(Finished {
        diagnosis: outcome.diagnosis,
        report,
        json,
        model,
    })
}

/// What the workflow writes, beside copies of the URDF and of the weights of networks.
pub(super) const OWN_FILES: [&str; 3] = ["model.toml", "diagnosis.json", report::FILE_NAME];

/// The command line of this process as one could type it again.
pub fn command_line() -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./=,:@+%".contains(c);
    let quoted = |argument: String| match !argument.is_empty() && argument.chars().all(plain) {
        true => argument,
        false => format!("'{}'", argument.replace('\'', "'\\''")),
    };
    let mut arguments = std::env::args_os().map(|a| a.to_string_lossy().into_owned());
    let program = arguments.next().unwrap_or_default();
    let name = Path::new(&program).file_stem().unwrap_or_default();
    let mut words = vec![name.to_string_lossy().into_owned()];
    words.extend(arguments.map(quoted));
    words.join(" ")
}
