//! Progress on stderr.

use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};

use super::Output;

/// What is being done: on a terminal a spinner with the elapsed time, elsewhere one plain line a stage, nothing when quiet. Gone
/// from the terminal when dropped.
pub(super) struct Progress {
    output: Output,
    bar: ProgressBar,
}

impl Progress {
    pub fn new(output: &Output) -> Self {
        // Draws on stderr, and is hidden where that is no terminal.
        let bar = match output.quiet {
            true => ProgressBar::hidden(),
            false => ProgressBar::new_spinner(),
        };
        if let Ok(style) = ProgressStyle::with_template("{spinner} {elapsed:>4} {wide_msg}") {
            bar.set_style(style);
        }
        if !bar.is_hidden() {
            bar.enable_steady_tick(Duration::from_millis(100));
        }
        Progress {
            output: *output,
            bar,
        }
    }

    /// A new stage has begun.
    pub fn stage(&self, text: &str) {
        match self.bar.is_hidden() {
            true => self.output.note(text),
            false => self.bar.set_message(text.to_owned()),
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
