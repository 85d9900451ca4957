//! Whether a log counts as the model does. A coordinate that counts the other way round, begins elsewhere, is in degrees or millimetres or stands under
//! another's name is no missing effect, and none explains it.
//!
//! Some short windows of the log are read in every such way, and the model as given is fitted to them a little. What it leaves of each coordinate,
//!
//! share = √(⟨(q − q̂)²⟩ − noise²) / √⟨(q − line)²⟩,
//!
//! in the median of the windows, compares it with the straight line through each: it has no unit, and needs to know nothing of the sensor. A model that lacks an
//! effect leaves a few hundredths; one that is told the wrong sign a good part of the motion.

mod each;
mod late_rows;
mod meant;
mod needed;
mod reading;
mod signs;
#[cfg(test)]
mod tests;
mod told;
mod unmoved;
mod windows;
mod zeros;

use std::borrow::Cow;

use self::each::{Each, readings};
use self::reading::{changes, mappings};
use self::told::For;
pub use self::unmoved::refuse_unmoved;
use self::zeros::Zeros;
use super::verdict::DataFault;
use crate::Error;
use crate::log::Log;
use crate::model::Model;

/// Work that only warns of them tries no more than so many: two joints and a motor may have 40, seven of each have 140 or more.
const MOST_ASIDE: usize = 60;
/// The kind of these faults.
pub const CONVENTION: &str = "convention";
/// A model and its logs, read as they are meant.
pub struct AsMeant<'a> {
    /// The model, with `[log.columns]` that say so.
    pub model: Cow<'a, Model>,
    /// The logs.
    pub logs: Cow<'a, [Log]>,
    /// Those that no fit may see.
    pub held_out: Cow<'a, [Log]>,
    /// What they count otherwise, one a signal.
    pub faults: Vec<DataFault>,
    /// Whether rows were [left out](super::fresh_rows) of them: then what is some rows late is so by others.
    pub is_thinned: bool,
}

/// The logs as they are meant: as they are, unless the model explains them far better where they are read otherwise.
///
/// # Errors
/// Those of [`Model::with_columns`].
pub fn as_meant<'a>(
    model: &'a Model,
    logs: &'a [Log],
    held_out: &'a [Log],
    report: &dyn Fn(&str),
) -> Result<AsMeant<'a>, Error> {
    let seen = Each::of(model, logs, For::Fits, None, report);
    let usual = seen.usual.clone();
    let readings = readings(usual.as_ref());
    // What is held out may have been recorded by others; where it does not tell, it counts as what is seen.
    let unseen = Each::of(model, held_out, For::HeldOut, usual.clone(), report);
    let mut faults = seen.faults(usual.as_ref());
    faults.extend(unseen.faults(usual.as_ref()));
    let columns = logs.first().map_or(Vec::new(), |log| {
        let own = log.columns(model);
        let of_reading = |reading| mappings(reading, model, (log, &own));
        readings.iter().flat_map(of_reading).collect()
    });
    let mut logs = seen.read().map_or(Cow::Borrowed(logs), Cow::Owned);
    let mut held_out = unseen.read().map_or(Cow::Borrowed(held_out), Cow::Owned);
    let zeros = Zeros::of(model, &logs, &held_out, For::Fits);
    faults.extend(zeros.faults());
    if let Some(read) = zeros.read() {
        [logs, held_out] = read.map(Cow::Owned);
    }
    Ok(AsMeant {
        is_thinned: false,
        faults,
        logs,
        held_out,
        model: match columns.is_empty() {
            true => Cow::Borrowed(model),
            false => Cow::Owned(model.with_columns(&columns)?),
        },
    })
}

/// How logs count otherwise than the model, in words, for those who read them as they are. Of mechanisms with many signals, whose ways to count take minutes to
/// try, a diagnosis alone asks.
///
/// # Errors
/// [`Error::OtherModel`] when a log was read for another model.
pub fn counts_otherwise(model: &Model, logs: &[Log]) -> Result<Vec<String>, Error> {
    logs.iter().try_for_each(|log| log.check(model))?;
    if changes(model, logs).len() > MOST_ASIDE {
        return Ok(Vec::new());
    }
    let each = Each::of(model, logs, For::ReadAsTheyAre, None, &|_| ());
    let zeros = Zeros::of(model, logs, &[], For::ReadAsTheyAre);
    let faults = each.faults(None).into_iter().chain(zeros.faults());
    Ok(faults.map(|fault| fault.detail).collect())
}
