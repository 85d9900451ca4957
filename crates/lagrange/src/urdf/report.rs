//! Errors and warnings on their way to the reader, each with its place in the text.

use crate::{Position, Problem};

/// Errors and warnings under way, by the byte that they are about.
pub struct Report<'t> {
    text: &'t str,
    errors: Vec<(usize, String)>,
    warnings: Vec<(usize, String)>,
    /// Those of the warnings that may be the cause of errors: a name misspelt is not read, and what it says is missing.
    unread: Vec<(usize, String)>,
}

impl<'t> Report<'t> {
    pub fn new(text: &'t str) -> Self {
        Report {
            text,
            errors: Vec::new(),
            warnings: Vec::new(),
            unread: Vec::new(),
        }
    }
    pub fn error(&mut self, at: usize, message: impl Into<String>) {
        self.errors.push((at, message.into()));
    }
    pub fn warning(&mut self, at: usize, message: impl Into<String>) {
        self.warnings.push((at, message.into()));
    }
    /// A warning of what is not read, which comes with the errors too.
    pub fn unread(&mut self, at: usize, message: impl Into<String>) {
        self.unread.push((at, message.into()));
    }
    pub fn failed(&self) -> bool {
        !self.errors.is_empty()
    }
    /// Whether so much is wrong already that hints are not worth their time.
    pub fn is_long(&self) -> bool {
        self.errors.len() >= 20
    }
    /// ` in line …` for a byte; nothing where so much is wrong that it is not worth the time.
    pub fn line(&self, at: usize) -> String {
        if self.is_long() {
            return String::new();
        }
        format!(" in line {}", Position::of(self.text, at).line)
    }
    pub fn into_errors(self) -> Vec<Problem> {
        located(self.text, [self.errors, self.unread].concat())
    }
    pub fn into_warnings(self) -> Vec<Problem> {
        located(self.text, [self.warnings, self.unread].concat())
    }
}

/// Most problems that are listed one by one.
pub(super) const MAX_LISTED: usize = 200;

/// The problems in the order of the text. The list is cut, so that a large broken file does not take long to report.
fn located(text: &str, mut list: Vec<(usize, String)>) -> Vec<Problem> {
    list.sort_by_key(|&(at, _)| at);
    let more = list.len().saturating_sub(MAX_LISTED);
    // Positions are counted on from one problem to the next, in one pass over the text.
    let (mut line, mut column, mut counted) = (1, 1, 0);
    let mut problems: Vec<Problem> = list
        .into_iter()
        .take(MAX_LISTED)
        .map(|(at, message)| {
            let between = text.get(counted..at).unwrap_or("");
            match between.rsplit_once('\n') {
                Some((before, last)) => {
                    line += before.matches('\n').count() + 1;
                    column = 1 + last.chars().count();
                }
                None => column += between.chars().count(),
            }
            counted = at;
            Problem::at(Position { line, column }, message)
        })
        .collect();
    if more > 0 {
        problems.push(Problem::general(format!("and {more} more of the kind")));
    }
    problems
}

/// A name in a message: cut where it is very long.
pub fn shown(name: &str) -> String {
    match name.char_indices().nth(60) {
        Some((end, _)) => format!("`{}…`", name.get(..end).unwrap_or("")),
        None => format!("`{name}`"),
    }
}
