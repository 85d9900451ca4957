//! Readers that are not ours, on damaged files.

use std::panic::{AssertUnwindSafe, catch_unwind};

/// What `work` gives; none where it panics, as libraries do that trust what stands in a file. What they had in hand is not used again.
pub(super) fn guarded<T>(work: impl FnOnce() -> T) -> Option<T> {
    catch_unwind(AssertUnwindSafe(work)).ok()
}
