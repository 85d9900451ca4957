//! Logs that are given twice.

use super::Log;
use crate::Error;

/// A log that is given twice would be seen and unseen. Of one that was made in memory nobody knows.
pub fn refuse_twice(logs: &[Log], held_out: &[Log]) -> Result<(), Error> {
    let all: Vec<&Log> = logs.iter().chain(held_out).collect();
    let is_same = |a: &Log, b: &Log| !a.sha256.is_empty() && a.sha256 == b.sha256;
    for (k, second) in all.iter().enumerate() {
        if let Some(first) = all[..k].iter().find(|first| is_same(first, second)) {
            return Err(Error::SameLog {
                first: first.path.clone(),
                second: second.path.clone(),
            });
        }
    }
    Ok(())
}
