//! The program `pinode`, as a user runs it in a folder.

use std::path::Path;
use std::process::{Command, Output};

/// What the program does with these arguments.
pub fn pinode(arguments: &[&str], folder: &Path) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_pinode"));
    let command = command.args(arguments).current_dir(folder);
    command.output().unwrap()
}

/// What it tells people beside its result.
pub fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}
