//! What is kept of a log and its diagnosis.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::{Rig, Set};
use crate::config::NoiseLevel;

/// One log: what was hidden and what was said. One line of a JSON-lines file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Line {
    /// Rig, set, noise and seed; see [`super::Case::id`].
    pub id: String,
    /// The mechanism.
    pub rig: Rig,
    /// What was hidden in it, and how.
    pub set: Set,
    /// The noise level.
    pub noise: NoiseLevel,
    /// Seed of everything random on the rig.
    pub seed: u64,
    /// Length of the log, s.
    pub duration: f64,
    /// Rows a second, Hz, where they are not the rig's usual number.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rate: Option<u32>,
    /// What was hidden, the main effect first.
    pub hidden: Vec<Truth>,
    /// Factor on the sizes of what was drawn.
    pub size: f64,
    /// `effects_found`, `nothing_missing`, `unexplained`, `data_fault`; `error` when the diagnosis failed.
    pub verdict: String,
    /// Whether something is said to be left that no effect of the library explains.
    #[serde(default)]
    pub unexplained: bool,
    /// What was named, in its order.
    pub named: Vec<Named>,
    /// Kinds of the faults that were found in the data.
    pub data_faults: Vec<String>,
    /// Free-run error on the held-out data, in units of the sensors' noise, before and after.
    pub gap: Option<[f64; 2]>,
    /// The largest spread of residuals of the fits over a channel's noise, before and after.
    pub residual: Option<[f64; 2]>,
    /// Free-run errors on a recording of the same rig that the diagnosis has not had.
    pub free_run: Option<FreeRun>,
    /// Time of the diagnosis by the clock, s.
    pub seconds: f64,
    /// Number of threads of the diagnosis.
    pub threads: usize,
    /// Most memory of the process while it ran, MB; null where several logs ran at once.
    pub peak_mb: Option<f64>,
    /// Why there is no diagnosis.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
}

/// A hidden effect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Truth {
    /// Its kind, as in a model file.
    pub kind: String,
    /// What it sits on.
    pub target: String,
    /// Its parameters, SI units.
    pub parameters: BTreeMap<String, f64>,
}

/// A kind on a target.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Name {
    /// Kind.
    pub kind: String,
    /// What it sits on.
    pub target: String,
}

/// A named effect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Named {
    /// Kind.
    pub kind: String,
    /// What it sits on.
    pub target: String,
    /// Probability that the name is right.
    pub confidence: f64,
    /// Value and standard error of each parameter.
    pub parameters: BTreeMap<String, (f64, Option<f64>)>,
    /// Other names, with their probabilities.
    pub alternatives: Vec<(Name, f64)>,
    /// Names that the data cannot tell from it.
    pub indistinguishable_from: Vec<Name>,
}

/// Errors of free runs of 0.6 s: root mean square over the coordinates, each in units of its sensor's noise.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FreeRun {
    /// Of the model that lacks the effect.
    pub before: f64,
    /// Of the model that the diagnosis wrote.
    pub after: f64,
    /// Of the model with the hidden effects at their true values; null where the library has no such effect.
    pub truth: Option<f64>,
}
