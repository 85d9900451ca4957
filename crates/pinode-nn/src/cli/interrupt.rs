//! Ctrl-C during a diagnosis: what was finished stays, and the process ends with 130.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, Once, PoisonError};

use crate::diagnose::kept::Kept;

/// Exit code of an interrupted program: 128 and the number of SIGINT.
const INTERRUPTED: i32 = 130;

/// The diagnosis under way.
struct Running {
    kept: Arc<Kept>,
    /// A file of its own that nobody needs when it is interrupted.
    draft: PathBuf,
    quiet: bool,
}

static RUNNING: Mutex<Option<Running>> = Mutex::new(None);
static HANDLER: Once = Once::new();

fn running() -> MutexGuard<'static, Option<Running>> {
    RUNNING.lock().unwrap_or_else(PoisonError::into_inner)
}

/// While it lives, Ctrl-C ends the process with 130 and leaves the finished fits of a diagnosis behind.
pub(super) struct Interruptible(());

impl Interruptible {
    pub fn new(kept: &Arc<Kept>, draft: PathBuf, quiet: bool) -> Self {
        *running() = Some(Running {
            kept: Arc::clone(kept),
            draft,
            quiet,
        });
        // Where no handler can be set, Ctrl-C ends the process as it always does, and the finished fits stay as well.
        HANDLER.call_once(|| drop(ctrlc::set_handler(interrupted)));
        Interruptible(())
    }

    /// While the guard lives, an interruption waits: files get their names together.
    pub fn wait(&self) -> impl Sized {
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
    if let Some(diagnosis) = running.as_ref() {
        let _whole = diagnosis.kept.hold();
        let _ = std::fs::remove_file(&diagnosis.draft); // gone already, or another program's to clear
        if !diagnosis.quiet {
            eprintln!(
                "interrupted; what was finished is kept in {}: the same command goes on from there",
                diagnosis.kept.path().display()
            );
        }
        // With the locks held.
        std::process::exit(INTERRUPTED);
    }
    std::process::exit(INTERRUPTED);
}
