//! Ctrl-C during long work: what was finished stays, and the process ends with 130.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, Once, PoisonError};

use crate::diagnose::kept::Kept;

/// Exit code of an interrupted program: 128 and the number of SIGINT.
const INTERRUPTED: i32 = 130;

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
        checkpoint: PathBuf,
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

    /// A training, whose last checkpoint stays.
    pub fn training(checkpoint: PathBuf, quiet: bool) -> Self {
        Self::start(Work::Training { checkpoint }, quiet)
    }

    fn start(work: Work, quiet: bool) -> Self {
        *running() = Some(Running { work, quiet });
        // Where no handler can be set, Ctrl-C ends the process as it always does, and what is finished stays as well.
        HANDLER.call_once(|| drop(ctrlc::set_handler(interrupted)));
        Interruptible(())
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

/// Runs in a thread of its own.
fn interrupted() {
    // Held to the end: nothing is renamed or written from here on.
    let running = running();
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
            Work::Training { checkpoint } if checkpoint.exists() => format!(
                "interrupted; the last epoch is kept in {}: the same command with --resume goes on from there",
                checkpoint.display()
            ),
            Work::Training { .. } => "interrupted before the first epoch ended".to_owned(),
        };
        if !quiet {
            eprintln!("{message}");
        }
    }
    std::process::exit(INTERRUPTED);
}
