//! Writing files whole or not at all; fingerprints.

use std::ffi::OsStr;
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

/// Puts `bytes` into `dir` under the name that `path` has, and returns the name; where another file has it, part of the hash is added.
pub(crate) fn copy_beside(path: &Path, bytes: &[u8], dir: &Path) -> Result<String, Error> {
    let part =
        |part: Option<&OsStr>| part.map_or("robot".into(), |p| p.to_string_lossy().into_owned());
    let name = part(path.file_name());
    if holds(&dir.join(&name), bytes)? {
        return Ok(name);
    }
    if !dir.join(&name).exists() {
        write_atomically(&dir.join(&name), bytes)?;
        return Ok(name);
    }
    let hash = sha256(bytes);
    let short = hash.get(..12).unwrap_or(&hash);
    let (stem, ending) = (part(path.file_stem()), path.extension());
    let ending = ending.map_or("urdf".into(), |e| e.to_string_lossy().into_owned());
    let name = format!("{stem}-{short}.{ending}");
    if !holds(&dir.join(&name), bytes)? {
        write_atomically(&dir.join(&name), bytes)?;
    }
    Ok(name)
}

/// Whether the file at `path` is there and holds `bytes`.
fn holds(path: &Path, expected: &[u8]) -> Result<bool, Error> {
    match std::fs::read(path) {
        Ok(bytes) => Ok(bytes == expected),
        Err(e) if e.kind() == ErrorKind::NotFound => Ok(false),
        Err(e) => Err(Error::io(path, e)),
    }
}
