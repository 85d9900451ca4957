//! Writing files whole or not at all; fingerprints.

use std::ffi::OsStr;
use std::fs::OpenOptions;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use sha2::{Digest, Sha256};
use tempfile::NamedTempFile;

use crate::Error;

/// Writes `bytes` to a temporary file beside `path`, then renames it to `path`: nothing half-written ever has the name. The file that a link
/// leads to is replaced, not the link, and keeps its permissions; what is no file (a pipe, `/dev/stdout`) is written to.
///
/// # Errors
/// [`Error::Io`].
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<(), Error> {
    Staged::write(path, bytes)?.commit()
}

/// How many files are written beside their places at the moment.
static OPEN: Mutex<usize> = Mutex::new(0);

fn open_files() -> MutexGuard<'static, usize> {
    OPEN.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A guard under which no file is begun, where none is half written: a process that ends under it leaves none behind.
#[cfg(any(test, feature = "cli"))]
pub(crate) fn nothing_open() -> Option<impl Sized> {
    Some(open_files()).filter(|open| **open == 0)
}

/// Counts among [`OPEN`] while it lives.
struct Open(());

impl Open {
    fn new() -> Self {
        *open_files() += 1;
        Open(())
    }
}

impl Drop for Open {
    fn drop(&mut self) {
        *open_files() -= 1;
    }
}

/// A file that is written beside its place and not yet in it; gone when dropped.
pub(crate) struct Staged(Place);

enum Place {
    /// A file, to be renamed.
    File {
        path: PathBuf,
        file: NamedTempFile,
        /// Dropped after the file.
        open: Open,
    },
    /// What is no file takes its bytes as they come.
    Stream { path: PathBuf, bytes: Vec<u8> },
}

impl Staged {
    /// Writes `bytes` to a temporary file beside `path`.
    pub fn write(path: &Path, bytes: &[u8]) -> Result<Self, Error> {
        let io = |e| Error::io(path, e);
        // A rename onto a folder fails, and would after other files have got their names.
        if path.is_dir() {
            return Err(io(ErrorKind::IsADirectory.into()));
        }
        if is_stream(path) {
            let (path, bytes) = (path.to_owned(), bytes.to_vec());
            return Ok(Staged(Place::Stream { path, bytes }));
        }
        let path = path.canonicalize().unwrap_or_else(|_| path.to_owned());
        let open = Open::new();
        let mut file = beside(&path)?;
        file.write_all(bytes).map_err(io)?;
        if let Ok(there) = path.metadata() {
            file.as_file()
                .set_permissions(there.permissions())
                .map_err(io)?;
        }
        file.as_file().sync_all().map_err(io)?;
        Ok(Staged(Place::File { path, file, open }))
    }

    /// Renames it to its place.
    pub fn commit(self) -> Result<(), Error> {
        match self.0 {
            Place::File { path, file, open } => {
                let renamed = file.persist(&path).map(drop);
                let renamed = renamed.map_err(|e| Error::io(&path, e.error));
                drop(open);
                renamed
            }
            Place::Stream { path, bytes } => {
                let stream = OpenOptions::new().write(true).open(&path);
                let written = stream.and_then(|mut stream| stream.write_all(&bytes));
                written.map_err(|e| Error::io(&path, e))
            }
        }
    }
}

/// Whether there is something at `path` that bytes pass through: a device, a pipe, a stream of the process itself, be it led to a file.
fn is_stream(path: &Path) -> bool {
    let of_system = ["/dev", "/proc"].iter().any(|dir| path.starts_with(dir));
    path.metadata()
        .is_ok_and(|there| of_system || !there.is_file())
}

/// Files that come into a folder together, or not at all.
pub(crate) struct Together<'a> {
    dir: &'a Path,
    /// Names, the hashes of what they hold, and what is not there yet.
    files: Vec<(String, String, Option<Staged>)>,
}

impl<'a> Together<'a> {
    /// None yet.
    pub fn new(dir: &'a Path) -> Self {
        let files = Vec::new();
        Together { dir, files }
    }

    /// The folder.
    pub fn dir(&self) -> &'a Path {
        self.dir
    }

    /// A file under this name, in place of what is there; the folder is made where it is missing.
    pub fn put(&mut self, name: &str, bytes: &[u8]) -> Result<(), Error> {
        std::fs::create_dir_all(self.dir).map_err(|e| Error::io(self.dir, e))?;
        let staged = Staged::write(&self.dir.join(name), bytes)?;
        let hash = sha256(bytes);
        self.files.push((name.to_owned(), hash, Some(staged)));
        Ok(())
    }

    /// A file under the name that `path` has, which is returned; where another file has it, part of the hash is added.
    pub fn put_beside(&mut self, path: &Path, bytes: &[u8]) -> Result<String, Error> {
        let part = |part: Option<&OsStr>| {
            part.map_or("robot".into(), |p| p.to_string_lossy().into_owned())
        };
        let name = part(path.file_name());
        let hash = sha256(bytes);
        let there = self.dir.join(&name);
        let coming = self.files.iter().find(|(coming, ..)| *coming == name);
        let free = match coming {
            Some((_, held, _)) if *held == hash => return Ok(name),
            Some(_) => false,
            None if holds(&there, bytes)? => return Ok(name),
            None => !there.exists(),
        };
        if free {
            self.put(&name, bytes)?;
            return Ok(name);
        }
        let short = hash.get(..12).unwrap_or(&hash);
        let (stem, ending) = (part(path.file_stem()), path.extension());
        let ending = ending.map_or("urdf".into(), |e| e.to_string_lossy().into_owned());
        let name = format!("{stem}-{short}.{ending}");
        if !holds(&self.dir.join(&name), bytes)? {
            self.put(&name, bytes)?;
        }
        Ok(name)
    }

    /// Gives all their names, in the order in which they were put.
    pub fn commit(self) -> Result<(), Error> {
        let mut staged = self.files.into_iter().filter_map(|(.., staged)| staged);
        staged.try_for_each(Staged::commit)
    }
}

/// Whether the file at `path` is there and holds `bytes`.
fn holds(path: &Path, expected: &[u8]) -> Result<bool, Error> {
    match std::fs::read(path) {
        Ok(bytes) => Ok(bytes == expected),
        Err(e) if e.kind() == ErrorKind::NotFound => Ok(false),
        Err(e) => Err(Error::io(path, e)),
    }
}

/// The folder that a file is in.
fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

/// An empty temporary file in the folder of `path`.
fn beside(path: &Path) -> Result<NamedTempFile, Error> {
    let folder = folder_of(path);
    let mut builder = tempfile::Builder::new();
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666)); // less the umask
    }
    let made = builder.tempfile_in(folder);
    made.map_err(|e| Error::io(path, of_system(e)))
}

/// What the system said, without the name of the temporary file.
fn of_system(error: std::io::Error) -> std::io::Error {
    let inner = error.get_ref().and_then(|e| e.source());
    let inner = inner.and_then(|e| e.downcast_ref::<std::io::Error>());
    let code = inner.and_then(std::io::Error::raw_os_error);
    code.map_or(error, std::io::Error::from_raw_os_error)
}

/// Refuses `outputs` among which one is an input or another output, under whatever name: said before the work, not after it.
///
/// # Errors
/// [`Error::OverwritesInput`], [`Error::SameOutput`]; [`Error::Io`] where a folder has the name of an output.
pub(crate) fn refuse_overwriting(outputs: &[PathBuf], inputs: &[&Path]) -> Result<(), Error> {
    let inputs: Vec<PathBuf> = inputs.iter().map(|path| whole(path)).collect();
    for (k, path) in outputs.iter().enumerate() {
        if path.is_dir() {
            return Err(Error::io(path, ErrorKind::IsADirectory.into()));
        }
        let (found, path) = (whole(path), path.clone());
        if inputs.contains(&found) {
            return Err(Error::OverwritesInput { path });
        }
        if outputs.iter().take(k).any(|other| whole(other) == found) {
            return Err(Error::SameOutput { path });
        }
    }
    Ok(())
}

/// The one path of a file, also of one that is not there yet.
fn whole(path: &Path) -> PathBuf {
    let in_folder = || Some(folder_of(path).canonicalize().ok()?.join(path.file_name()?));
    let found = path.canonicalize().ok().or_else(in_folder);
    found.unwrap_or_else(|| path.to_owned())
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

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[test]
    fn files_come_together_or_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        let dir = folder.path().join("out");
        std::fs::create_dir_all(dir.join("model.toml")).unwrap();
        let mut files = Together::new(&dir);
        files.put("weights", b"new").unwrap();
        assert!(files.put("model.toml", b"m").is_err());
        drop(files);
        assert_eq!(std::fs::read_dir(&dir).unwrap().count(), 1);

        let mut files = Together::new(&dir);
        files.put("weights", b"new").unwrap();
        // What comes is in the way as much as what is there.
        let kept = files.put_beside("elsewhere/weights".as_ref(), b"old");
        let kept = kept.unwrap();
        assert!(kept.starts_with("weights-"), "{kept}");
        let same = files.put_beside("other/weights".as_ref(), b"new").unwrap();
        assert_eq!(same, "weights");
        files.commit().unwrap();
        assert_eq!(std::fs::read(dir.join("weights")).unwrap(), b"new");
        assert_eq!(std::fs::read(dir.join(kept)).unwrap(), b"old");
    }

    /// Links and permissions were lost, and as root `/dev/null` became a file.
    #[cfg(unix)]
    #[test]
    fn what_a_link_leads_to_is_replaced_and_what_is_no_file_is_written_to() {
        use std::os::unix::fs::{PermissionsExt, symlink};
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::write(at("file"), "old").unwrap();
        let private = std::fs::Permissions::from_mode(0o600);
        std::fs::set_permissions(at("file"), private).unwrap();
        symlink(at("file"), at("link")).unwrap();
        write_atomically(&at("link"), b"new").unwrap();
        assert_eq!(std::fs::read(at("file")).unwrap(), b"new");
        assert!(at("link").is_symlink());
        let mode = at("file").metadata().unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o600);

        let (reader, writer) = std::io::pipe().unwrap();
        let pipe = format!("/proc/self/fd/{}", std::os::fd::AsRawFd::as_raw_fd(&writer));
        if Path::new(&pipe).exists() {
            write_atomically(Path::new(&pipe), b"through").unwrap();
            drop(writer);
            assert_eq!(std::io::read_to_string(reader).unwrap(), "through");
        }
    }

    /// Ctrl-C during a write left a temporary file behind.
    #[test]
    fn while_a_file_is_half_written_the_process_does_not_end() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csv");
        let staged = Staged::write(&path, b"1").unwrap();
        assert!(nothing_open().is_none());
        staged.commit().unwrap();
        // Other tests write as well, each for a moment.
        while nothing_open().is_none() {
            std::thread::yield_now();
        }
    }

    #[test]
    fn an_output_is_neither_an_input_nor_another_output_under_another_name() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir(at("sub")).unwrap();
        std::fs::write(at("input.csv"), "").unwrap();
        let input = at("input.csv");
        let check = |names: &[&str]| {
            let outputs: Vec<PathBuf> = names.iter().map(|name| at(name)).collect();
            refuse_overwriting(&outputs, &[&input])
        };
        assert!(check(&["a.csv", "b.csv", "nowhere/a.csv"]).is_ok());
        let refused = check(&["a.csv", "sub/../input.csv"]);
        assert!(matches!(refused, Err(Error::OverwritesInput { .. })));
        let refused = check(&["a.csv", "sub/../a.csv"]);
        assert!(matches!(refused, Err(Error::SameOutput { .. })));
        assert!(matches!(check(&["sub"]), Err(Error::Io { .. })));
    }
}
