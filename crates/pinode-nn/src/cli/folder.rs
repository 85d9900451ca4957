//! The folder that a command writes into: as it was, where the command fails.

use std::collections::BTreeSet;
use std::ffi::OsString;
use std::fs::File;
use std::path::{Path, PathBuf};

use tempfile::TempPath;

use super::workflow::OWN_FILES;
use crate::Error;

/// Between these six letters and digits stand in the name of a draft.
const DRAFT: [&str; 2] = [".model-", ".toml"];

/// Folders that were made. Those that are empty in the end are removed again.
pub(super) struct Made {
    /// The deepest first.
    folders: Vec<PathBuf>,
}

impl Made {
    /// Makes the folder with those above it.
    pub fn folder(path: &Path) -> Result<Self, Error> {
        let missing = path
            .ancestors()
            .take_while(|folder| !folder.as_os_str().is_empty() && !folder.exists());
        // From here on: what was made before the disk refuses goes again.
        let made = Made {
            folders: missing.map(Path::to_owned).collect(),
        };
        std::fs::create_dir_all(path).map_err(|e| Error::io(path, e))?;
        Ok(made)
    }

    /// The folders, the deepest first.
    pub fn folders(&self) -> &[PathBuf] {
        &self.folders
    }
}

impl Drop for Made {
    fn drop(&mut self) {
        remove_empty(&self.folders);
    }
}

/// Removes folders, the deepest first, that hold nothing else.
pub(super) fn remove_empty(folders: &[PathBuf]) {
    for folder in folders {
        let _ = std::fs::remove_dir(folder); // refuses a folder with something in it
    }
}

/// The folder of a diagnosis, and what was there before.
pub(super) struct Folder {
    path: PathBuf,
    /// Names in it.
    before: BTreeSet<OsString>,
    _made: Made,
    /// Held by every diagnosis that works in the folder; none where the system locks no folders.
    _in_use: Option<File>,
}

impl Folder {
    /// Makes the folder with those above it, and removes the drafts that killed processes left there.
    pub fn make(path: &Path) -> Result<Self, Error> {
        let made = Made::folder(path)?;
        Ok(Folder {
            _in_use: in_use(path),
            path: path.to_owned(),
            before: names(path).map_err(|e| Error::io(path, e))?,
            _made: made,
        })
    }

    /// A file for the model until the work is done.
    pub fn draft(&self) -> std::io::Result<TempPath> {
        let mut builder = tempfile::Builder::new();
        builder.prefix(DRAFT[0]).suffix(DRAFT[1]).rand_bytes(6);
        Ok(builder.tempfile_in(&self.path)?.into_temp_path())
    }

    /// Removes the files of the workflow that were not there before; what others wrote stays. What cannot be removed stays as well: the error that led here
    /// is the one to tell.
    pub fn leave_as_it_was(&self) {
        let now = names(&self.path).unwrap_or_default();
        for name in now.difference(&self.before) {
            let path = Path::new(name);
            let beside = |ending| {
                path.extension()
                    .is_some_and(|e| e.eq_ignore_ascii_case(ending))
            };
            if beside("urdf") || beside("safetensors") || OWN_FILES.iter().any(|own| name == own) {
                let _ = std::fs::remove_file(self.path.join(name));
            }
        }
    }
}

/// A lock on the folder that all diagnoses in it share. Whoever has it alone for a moment knows that the processes which left drafts there are dead, and
/// removes these.
fn in_use(folder: &Path) -> Option<File> {
    let lock = File::open(folder).ok()?;
    if lock.try_lock().is_ok() {
        for name in names(folder).unwrap_or_default() {
            if is_draft(&name) {
                let _ = std::fs::remove_file(folder.join(name)); // in nobody's way
            }
        }
        lock.unlock().ok()?;
    }
    lock.lock_shared().ok()?;
    Some(lock)
}

fn is_draft(name: &OsString) -> bool {
    let name = name.to_str().and_then(|name| name.strip_prefix(DRAFT[0]));
    let drawn = name.and_then(|name| name.strip_suffix(DRAFT[1]));
    drawn.is_some_and(|drawn| drawn.len() == 6 && drawn.chars().all(|c| c.is_ascii_alphanumeric()))
}

fn names(folder: &Path) -> std::io::Result<BTreeSet<OsString>> {
    std::fs::read_dir(folder)?
        .map(|entry| entry.map(|entry| entry.file_name()))
        .collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    /// What a killed diagnosis had begun to write stayed for ever.
    #[cfg(unix)]
    #[test]
    fn drafts_of_dead_processes_are_removed_and_those_of_live_ones_and_of_users_are_not() {
        let dir = tempfile::tempdir().unwrap();
        let there = || -> Vec<String> {
            let names = names(dir.path()).unwrap().into_iter();
            names.map(|name| name.into_string().unwrap()).collect()
        };
        let of_users = [
            ".model-Ab12Cd.toml.bak",
            ".model-arm.toml",
            "model-Ab12Cd.toml",
        ];
        for name in of_users.iter().chain(&[".model-Ab12Cd.toml"]) {
            std::fs::write(dir.path().join(name), "").unwrap();
        }
        let first = Folder::make(dir.path()).unwrap();
        assert_eq!(there(), of_users);
        let draft = first.draft().unwrap();
        let second = Folder::make(dir.path()).unwrap();
        assert!(draft.exists());
        // Killed: nothing of its own is removed, and its lock is gone.
        draft.keep().unwrap();
        drop((first, second));
        assert_eq!(there().len(), 4);
        drop(Folder::make(dir.path()).unwrap());
        assert_eq!(there(), of_users);
    }

    #[test]
    fn folders_that_were_made_go_again_where_they_stay_empty() {
        let dir = tempfile::tempdir().unwrap();
        let deep = dir.path().join("a/b");
        drop(Made::folder(&deep).unwrap());
        assert!(!dir.path().join("a").exists());
        let made = Made::folder(&deep).unwrap();
        std::fs::write(dir.path().join("a/mine"), "").unwrap();
        drop(made);
        assert!(!deep.exists() && dir.path().join("a/mine").exists());
        // What was there stays, empty or not.
        std::fs::create_dir(&deep).unwrap();
        drop(Made::folder(&deep).unwrap());
        assert!(deep.exists());
    }
}
