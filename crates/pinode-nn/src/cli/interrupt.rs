//! Ctrl-C during long work: what was finished stays, and the process ends with 130.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, Once, PoisonError};
use std::time::Duration;

use super::folder::{Made, remove_empty};
use crate::diagnose::kept::Kept;
use crate::disk::nothing_open;

/// Exit code of an interrupted program: 128 and the number of SIGINT.
const INTERRUPTED: i32 = 130;

/// So long is waited between two looks at files that are being written.
const SHORT: Duration = Duration::from_millis(1);

/// The work under way.
struct Running {
    work: Work,
    quiet: bool,
}

enum Work {
    Diagnosis {
        kept: Arc<Kept>,
        /// A file of its own that nobody needs when it is interrupted.
        draft: PathBuf,
    },
    Training {
        /// Of all members so far, the one under way last.
        checkpoints: Vec<PathBuf>,
        /// Folders that were made for it, the deepest first.
        made: Vec<PathBuf>,
    },
}

static RUNNING: Mutex<Option<Running>> = Mutex::new(None);
static HANDLER: Once = Once::new();

fn running() -> MutexGuard<'static, Option<Running>> {
    RUNNING.lock().unwrap_or_else(PoisonError::into_inner)
}

/// While it lives, Ctrl-C ends the process with 130 and leaves behind what is finished of the work.
pub(super) struct Interruptible(());

impl Interruptible {
    /// A diagnosis, whose finished fits stay.
    pub fn new(kept: &Arc<Kept>, draft: PathBuf, quiet: bool) -> Self {
        let kept = Arc::clone(kept);
        Self::start(Work::Diagnosis { kept, draft }, quiet)
    }

    /// A training, whose last checkpoint among these stays, and those before it; without any, folders that were made for it go.
    pub fn training(checkpoints: Vec<PathBuf>, made: &Made, quiet: bool) -> Self {
        let made = made.folders().to_vec();
        Self::start(Work::Training { checkpoints, made }, quiet)
    }

    fn start(work: Work, quiet: bool) -> Self {
        *running() = Some(Running { work, quiet });
        // Where no handler can be set, Ctrl-C ends the process as it always does, and what is finished stays as well.
        HANDLER.call_once(|| drop(ctrlc::set_handler(interrupted)));
        Interruptible(())
    }

    /// From now on it is from the last of these that there is that the training goes on.
    pub fn goes_on_from(&self, so_far: &[PathBuf]) {
        if let Some(Running {
            work: Work::Training { checkpoints, .. },
            ..
        }) = running().as_mut()
        {
            *checkpoints = so_far.to_vec();
        }
    }

    /// While the guard lives, an interruption waits: files get their names together.
    pub fn wait(&self) -> impl Sized + use<> {
        running()
    }
}

impl Drop for Interruptible {
    fn drop(&mut self) {
        *running() = None;
    }
}

/// What is running, when no file is half written. Whoever is to write waits for what is running, and the other way round: neither is held
/// while the other is waited for.
fn between_files() -> (MutexGuard<'static, Option<Running>>, impl Sized) {
    loop {
        let running = running();
        if let Some(nothing_open) = nothing_open() {
            return (running, nothing_open);
        }
        drop(running);
        std::thread::sleep(SHORT);
    }
}

/// Runs in a thread of its own.
fn interrupted() {
    // Held to the end: nothing is renamed or written from here on.
    let (running, _nothing_open) = between_files();
    if let Some(Running { work, quiet }) = running.as_ref() {
        let message = match work {
            Work::Diagnosis { kept, draft } => {
                // Never given back: no fit is half written when the process ends.
                std::mem::forget(kept.hold());
                let _ = std::fs::remove_file(draft); // gone already, or another program's to clear
                format!(
                    "interrupted; what was finished is kept in {}: the same command goes on from there",
                    kept.path().display()
                )
            }
            Work::Training { checkpoints, made } => {
                remove_empty(made);
                match checkpoints.iter().rev().find(|path| path.exists()) {
                    Some(checkpoint) => format!(
                        "interrupted; the last epoch is kept in {}: the same command with --resume goes on from there",
                        checkpoint.display()
                    ),
                    None => "interrupted before the first epoch ended".to_owned(),
                }
            }
        };
        if !quiet {
            eprintln!("{message}");
        }
    }
    std::process::exit(INTERRUPTED);
}
