//! Writing files whole or not at all; fingerprints.

use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};
use tempfile::NamedTempFile;

use crate::Error;

/// Writes `bytes` to a temporary file beside `path`, then renames it to `path`.
pub(crate) fn write_atomically(path: &Path, bytes: &[u8]) -> Result<(), Error> {
    Staged::write(path, bytes)?.commit()
}

/// A file that is written beside its place and not yet in it; gone when dropped.
pub(crate) struct Staged {
    path: PathBuf,
    file: NamedTempFile,
}

impl Staged {
    /// Writes `bytes` to a temporary file beside `path`.
    pub fn write(path: &Path, bytes: &[u8]) -> Result<Self, Error> {
        let io = |e| Error::io(path, e);
        // A rename onto a folder fails, and would after other files have got their names.
        if path.is_dir() {
            return Err(io(ErrorKind::IsADirectory.into()));
        }
        let mut file = beside(path)?;
        file.write_all(bytes).map_err(io)?;
        file.as_file().sync_all().map_err(io)?;
        Ok(Staged {
            path: path.to_owned(),
            file,
        })
    }

    /// Renames it to its place.
    pub fn commit(self) -> Result<(), Error> {
        let Staged { path, file } = self;
        file.persist(&path)
            .map(drop)
            .map_err(|e| Error::io(&path, e.error))
    }
}

/// An empty temporary file in the folder of `path`.
fn beside(path: &Path) -> Result<NamedTempFile, Error> {
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let mut builder = tempfile::Builder::new();
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666)); // less the umask
    }
    builder.tempfile_in(folder).map_err(|e| Error::io(path, e))
}

/// SHA-256 of `bytes`, hexadecimal.
pub(crate) fn sha256(bytes: &[u8]) -> String {
    use std::fmt::Write;
    Sha256::digest(bytes)
        .iter()
        .fold(String::new(), |mut out, byte| {
            let _ = write!(out, "{byte:02x}"); // writing to a String cannot fail
            out
        })
}
