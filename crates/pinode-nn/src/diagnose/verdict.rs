//! The diagnosis as it is written down: `diagnosis.json`.

use std::collections::BTreeMap;

use serde::Serialize;

pub use super::comparison::Lack;
use super::comparison::lacks;
use crate::learnt::law::Law;
use crate::naming::with_article;
use crate::smoothing::SmoothingError;

/// What a diagnosis says; the JSON document of `pinode diagnose`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Diagnosis {
    /// In one word.
    pub verdict: Verdict,
    /// Where model and data disagree before anything is added, the worst coordinate first.
    pub disagreement: Vec<Disagreement>,
    /// What was found and added, in the order of its contribution.
    pub effects: Vec<NamedEffect>,
    /// Free-run errors on data that no fit has seen, before and after.
    pub gap: Gap,
    /// Spread of the residuals of the fits, within their windows: 1 where a model explains a channel down to its noise.
    pub residuals: Vec<Residual>,
    /// What is wrong with the data themselves.
    pub data_faults: Vec<DataFault>,
    /// What the data excite, and what they can show at best; known before anything is fitted.
    pub excitation: Excitation,
    /// What no effect explains, on the worst coordinate; `null` where nothing of the kind is left.
    pub unexplained: Option<Unexplained>,
    /// What to do or to record next.
    pub advice: Vec<String>,
    /// Everything else the fit moved within its tolerance: masses, gains, zeros, known effects.
    pub constants: Vec<FittedConstant>,
    /// The constant that changes most clearly over the log, if one does.
    pub change: Option<Change>,
    /// Every step of the search: what the screen promised and what refining it gave.
    pub search: Vec<SearchStep>,
    /// What the new model owes to its numerics.
    pub numerics: Numerics,
    /// How to do it again.
    pub provenance: Provenance,
}

/// A name with less confidence than this is no finding where something is left.
pub const DOUBTFUL: f64 = 0.05;

/// One with less than this is no likelier than not: it does not lead the verdict where something is left, and is not worth a recording.
pub const EVEN: f64 = 0.5;

/// The verdict.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// One or more effects were named, and explain more than follows from anything and is left.
    EffectsFound,
    /// The model explains the data.
    NothingMissing,
    /// Something is missing that no effect in the library explains; what is named beside it explains less.
    Unexplained,
    /// The data are at fault: without what is faulty the model explains them.
    DataFault,
}

/// Where one coordinate disagrees.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Disagreement {
    /// Its name.
    pub coordinate: String,
    /// Its share of the disagreement, each coordinate in units of what sensor noise alone would show.
    pub share: f64,
    /// Root mean square of the force that the model lacks.
    pub rms: f64,
    /// Unit of `rms`.
    pub unit: String,
    /// On what it depends most, in words.
    pub r#where: String,
    /// The times at which it is largest, s.
    pub when: Vec<[f64; 2]>,
}

/// A found effect.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct NamedEffect {
    /// Its kind.
    pub kind: String,
    /// The joint, input, link or sensor it sits on.
    pub target: String,
    /// Whether the model has one of its kind there that is `fixed`: then this is what there is more.
    pub beside_fixed: bool,
    /// Probability that it is this one, or one of those in `indistinguishable_from`.
    pub confidence: f64,
    /// Its parameters.
    pub parameters: BTreeMap<String, ParameterValue>,
    /// Other names, with their probabilities.
    pub alternatives: Vec<Alternative>,
    /// Names that these data cannot tell from it.
    pub indistinguishable_from: Vec<Name>,
    /// Experiments that tell it from a name that these data do not exclude, the best first; at most three.
    pub experiments: Vec<Experiment>,
    /// The evidence: paired windows with the effect against without.
    pub evidence: Evidence,
}

/// A value with its standard error.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ParameterValue {
    /// The value.
    pub value: f64,
    /// Its standard error, which has what scatters between windows, and beside effects with states what a fit to windows twice as long
    /// differs by; `null` when the data do not determine it.
    pub std: Option<f64>,
    /// The unit, `1` for a ratio.
    pub unit: String,
}

impl ParameterValue {
    /// Half the width of its 95 % interval, 1.96 standard errors; `None` when the data do not determine it.
    pub fn half_interval(&self) -> Option<f64> {
        const NORMAL: f64 = 1.959_963_984_540_054;
        self.std.filter(|s| s.is_finite()).map(|s| NORMAL * s)
    }
}

/// Another name for a found effect.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Alternative {
    /// Kind.
    pub kind: String,
    /// Target.
    pub target: String,
    /// Probability.
    pub confidence: f64,
}

/// A kind on a target.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Name {
    /// Kind.
    pub kind: String,
    /// Target.
    pub target: String,
}

/// An experiment that tells a found effect from another name: simulated with both fitted models, from rest.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Experiment {
    /// The other name.
    pub against: Name,
    /// What is done: `slow_triangle`, `steps`, `square_wave`, `chirp`, `push_and_coast`, `constant_push` or `free_decay`.
    pub experiment: String,
    /// The input that moves, all others are zero; `null`: none.
    pub input: Option<String>,
    /// Its largest value as it is logged, negative for a push that way; `null` without an input.
    pub amplitude: Option<f64>,
    /// Whether the base is turned by 180° about the vertical.
    pub turned: bool,
    /// What is mounted in addition; `null`: nothing.
    pub payload: Option<Payload>,
    /// How long it takes within the logged reach, s.
    pub duration_s: f64,
    /// Root mean square difference of what the sensors read, over their noise, by coordinate: after the constants of both models have
    /// been moved within three standard errors to bring the two together.
    pub differences: BTreeMap<String, f64>,
    /// All this in words.
    pub sentence: String,
}

/// A mass in addition.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Payload {
    /// The link on whose body it is, at the centre of mass.
    pub link: String,
    /// kg.
    pub mass: f64,
}

/// Paired differences of the windows' log-likelihoods.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Evidence {
    /// How sure the sign of their sum is, in standard errors, in the windows that the fit saw; of fewer than 14 windows as a share of the most that these could be.
    pub z_fit: f64,
    /// The same on windows it did not see.
    pub z_held_out: f64,
    /// Gain per sample on the seen windows, nats.
    pub gain_fit: f64,
    /// Gain per sample on the windows held out, nats.
    pub gain_held_out: f64,
    /// By how much less the tolerances of masses and gains are stretched, nats; 8 are four standard deviations.
    pub relief: f64,
}

impl Evidence {
    /// What it lacks of a significant gain that is large enough, seen and held out; nothing when it lacks nothing.
    pub fn lacks(&self) -> Option<Lack> {
        let z = (self.z_fit, self.z_held_out);
        lacks(z, (self.gain_fit, self.gain_held_out))
    }
}

/// Free-run errors over held-out windows.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Gap {
    /// Length of the free runs, s.
    pub horizon_s: f64,
    /// Number of free runs.
    pub windows: usize,
    /// Each coordinate, in units of its measurement noise.
    pub coordinates: Vec<CoordinateGap>,
    /// Root mean square over the coordinates, before; NaN, `null` in JSON, without a free run.
    pub before: f64,
    /// The same, after.
    pub after: f64,
    /// The same, as the noise and the errors of the estimated starts make it of a right model, to first order: more where it sticks and slips.
    pub expected: f64,
    /// The sensor noise itself: 1.
    pub noise_floor: f64,
    /// The same for shorter and longer free runs, the shortest first.
    pub horizons: Vec<Horizon>,
    /// Errors inside and outside of where the missing force is large, for each coordinate where it follows a signal.
    pub regions: Vec<Region>,
}

/// Free-run errors over one horizon.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Horizon {
    /// Length of the free runs, s.
    pub horizon_s: f64,
    /// Number of free runs that count.
    pub windows: usize,
    /// Number of those left out because a model diverges.
    pub diverged: usize,
    /// Root mean square over the coordinates, each in units of its noise, before.
    pub before: f64,
    /// The same, after.
    pub after: f64,
    /// The same, as the noise and the errors of the starts make it.
    pub expected: f64,
}

/// Where the missing force of a coordinate is large, and the free-run errors of that coordinate there and elsewhere.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Region {
    /// The coordinate.
    pub coordinate: String,
    /// The signal that the force follows.
    pub signal: String,
    /// Its unit.
    pub unit: String,
    /// The ranges of the signal in which the mean square force is more than half of its largest.
    pub ranges: Vec<[f64; 2]>,
    /// Share of the squared force that lies in them.
    pub force_share: f64,
    /// Share of the time that lies in them.
    pub time_share: f64,
    /// Errors at the samples in them.
    pub inside: RegionErrors,
    /// Errors at the others.
    pub outside: RegionErrors,
}

/// Free-run errors of a coordinate over some samples, in units of its measurement noise.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RegionErrors {
    /// Before.
    pub before: f64,
    /// After.
    pub after: f64,
    /// Number of samples.
    pub samples: usize,
}

/// One coordinate's free-run error, in units of its measurement noise.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CoordinateGap {
    /// `q.<coordinate>`.
    pub name: String,
    /// Unit of `noise`.
    pub unit: String,
    /// Before.
    pub before: f64,
    /// After.
    pub after: f64,
    /// As the noise and the errors of the estimated starts make it of a right model, to first order: more where it sticks and slips.
    pub expected: f64,
    /// The sensor noise itself: 1.
    pub noise_floor: f64,
    /// The measurement noise, in `unit`.
    pub noise: f64,
}

/// What the fits leave of one measured channel, in units of its noise.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Residual {
    /// `q.<coordinate>` or `v.<coordinate>`.
    pub name: String,
    /// By the model as given.
    pub before: f64,
    /// By the new model.
    pub after: f64,
    /// In what part of the windows it is many times what a model leaves that explains the data: 8 times the noise on a displacement, 25 times on an angle;
    /// before and after.
    pub strays: [f64; 2],
}

/// A fault of the data.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DataFault {
    /// What kind of fault.
    pub kind: String,
    /// In which column.
    pub column: String,
    /// When, s.
    pub when: Vec<[f64; 2]>,
    /// What was seen, and what was done about it.
    pub detail: String,
}

/// The force that is left on a coordinate, as a function of what it depends on.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Unexplained {
    /// The coordinate.
    pub coordinate: String,
    /// What a law that is missing there follows, in words, where windows it was not fitted to show it; `null`: no law is seen, it may be
    /// pushes from outside.
    pub follows: Option<String>,
    /// Root mean square of the force, its noise included.
    pub rms: f64,
    /// Its unit.
    pub unit: String,
    /// The signals that explain most of its variance, each by itself, the best first.
    pub depends_on: Vec<SharedSignal>,
    /// A second signal that explains much more together with the best one, with their common share.
    pub together_with: Option<SharedSignal>,
    /// Share of the odd part about 0 in the best signal; `null` where the signal has one sign.
    pub odd_share: Option<f64>,
    /// Whether the past matters.
    pub memory: Memory,
    /// The force over the best signal; valid between its first and its last point.
    pub curve: ForceCurve,
    /// The laws of the library that look most like it.
    pub nearest: Vec<NearShape>,
    /// The network that has learnt it and is a part of the new model; `null` where none was taught, or it did not shrink the gap.
    pub learnt: Option<Learnt>,
    /// All this in words.
    pub sentences: Vec<String>,
}

/// A network for what no effect explains.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Learnt {
    /// The file of its weights, beside the new model.
    pub weights: String,
    /// The coordinates that it acts on, the one that is worst off first.
    pub coordinates: Vec<String>,
    /// The effects whose work it could do: they have all of the force that their laws could explain.
    pub shares_with: Vec<Name>,
    /// What of the free-run errors on unseen data is left without it, in units of the sensors' noise, over all coordinates.
    pub without: f64,
    /// The same with it.
    pub with: f64,
    /// What it is like there.
    pub law: Option<Law>,
    /// The same on the others.
    pub more_laws: Vec<Law>,
}

/// A signal and the adjusted share of the variance that it explains.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SharedSignal {
    /// What it is.
    pub signal: String,
    /// Its unit.
    pub unit: String,
    /// Adjusted correlation ratio.
    pub share: f64,
}

/// Whether a force depends on the past where the present is the same.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Memory {
    /// Whether it does.
    pub present: bool,
    /// Adjusted share of what the present leaves that the past explains.
    pub share: f64,
    /// What of the past.
    pub by: String,
}

/// A force over a signal: means of samples with neighbouring values.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ForceCurve {
    /// The signal.
    pub signal: String,
    /// Its unit.
    pub unit: String,
    /// Its values.
    pub at: Vec<f64>,
    /// The mean force there.
    pub force: Vec<f64>,
    /// Standard error of each mean.
    pub std: Vec<f64>,
}

/// A law of the library beside a force.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct NearShape {
    /// Kind.
    pub kind: String,
    /// Target.
    pub target: String,
    /// Correlation; negative where the law has the opposite sign.
    pub correlation: f64,
}

/// What the data excite, and what they can show at best.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Excitation {
    /// How the coordinates move.
    pub coordinates: Vec<CoordinateExcitation>,
    /// What the inputs do.
    pub inputs: Vec<InputExcitation>,
    /// The sizes from which effects can be seen.
    pub limits: Vec<Limit>,
    /// Pairs of effects that move a coordinate nearly alike.
    pub alike: Vec<Alike>,
    /// All this in words.
    pub sentences: Vec<String>,
}

/// How a coordinate moves.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CoordinateExcitation {
    /// Its name.
    pub name: String,
    /// `m` or `rad`.
    pub unit: String,
    /// Least and largest position; angles unwrapped.
    pub range: [f64; 2],
    /// Speed exceeded in one sample of twenty, unit/s.
    pub speed: f64,
    /// How often it turns round.
    pub reversals: usize,
    /// Root mean square of the acceleration over that of the velocity, over 2π, Hz.
    pub mean_frequency: f64,
}

/// Readings that span less than so many times the noise are those of what does not move: noise alone spans seven or eight.
const STILL: f64 = 10.0;

impl CoordinateExcitation {
    /// Whether its readings do not leave the `noise` of its sensor.
    pub fn is_still(&self, noise: f64) -> bool {
        self.range[1] - self.range[0] < STILL * noise
    }
}

/// What an input does, in its own unit.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct InputExcitation {
    /// Its name.
    pub name: String,
    /// Least and largest value.
    pub range: [f64; 2],
    /// Share of the samples in which it is zero.
    pub zero_share: f64,
}

/// The least size of an effect that the sensor's noise lets through.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Limit {
    /// Kind.
    pub kind: String,
    /// Target.
    pub target: String,
    /// The parameter that is its size.
    pub parameter: String,
    /// Below this it is not seen; `null` when no size moves the coordinate.
    pub least: Option<f64>,
    /// Unit of `least`.
    pub unit: String,
}

/// Two effects that move a coordinate nearly alike.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Alike {
    /// The coordinate.
    pub target: String,
    /// Their kinds.
    pub kinds: [String; 2],
    /// Correlation of what they move.
    pub correlation: f64,
}

/// A constant that the fit moved.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FittedConstant {
    /// What it is.
    pub name: String,
    /// Its value in the model as given.
    pub given: f64,
    /// Its value now.
    pub fitted: f64,
    /// Standard error; `null` when neither data nor tolerance determine it.
    pub std: Option<f64>,
    /// What the model takes for possible, as a standard deviation about the given value, in the constant's unit; infinite, `null` in JSON,
    /// where it gives none, and 0 of a constant in energies that has none.
    pub tolerance: f64,
}

impl FittedConstant {
    /// What it is, in a sentence.
    pub fn spoken(&self) -> String {
        with_article(&self.name)
    }

    /// (fitted − given)/tolerance.
    pub fn tolerances(&self) -> f64 {
        (self.fitted - self.given) / self.tolerance
    }

    /// How it left what the model gives, if it did.
    pub fn moved(&self) -> Option<Moved> {
        let known = self.tolerance.is_finite();
        if self.tolerance == 0.0 {
            return (self.fitted != self.given).then_some(Moved::Unsaid);
        }
        if known && self.tolerances().abs() > STRETCHED {
            return Some(Moved::Stretched);
        }
        let by = (self.fitted - self.given).abs();
        let far = by > FAR * self.given.abs() || (known && self.tolerances().abs() > POSSIBLE);
        let surely = |std: f64| by > SURELY * std;
        match (self.std, known) {
            _ if !far => None,
            // A part of nothing, as of a sensor's zero, is no measure.
            (Some(std), true) => (self.given != 0.0 && surely(std)).then_some(Moved::Within),
            (Some(std), false) => surely(std).then_some(Moved::Free),
            (None, true) => None,
            (None, false) => Some(Moved::Undetermined),
        }
    }
}

/// A constant that a fit has stretched by more tolerances than this has left them: one in four hundred is as far off.
const STRETCHED: f64 = 3.0;
/// One with a tolerance, or without one, has left its value when it is off by so many tolerances or by this part of it, and by so many standard errors.
const POSSIBLE: f64 = 1.0;
const FAR: f64 = 0.1;
const SURELY: f64 = 4.0;

/// How a constant left what the model gives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Moved {
    /// Beyond its tolerance.
    Stretched,
    /// The model does not say how well it is known, and the data want another value.
    Unsaid,
    /// Far, by no more tolerances than may be.
    Within,
    /// It has no tolerance, and the data want another value.
    Free,
    /// It has no tolerance, and the data do not determine it.
    Undetermined,
}

/// A constant, found or known, that is another before some time of the log than after it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Change {
    /// What it is.
    pub name: String,
    /// The largest sum of the signs of the windows' pulls on it, about their mean and over the root of the sum of their squares; beyond x with the
    /// probability 2 exp(−2 x²) where nothing changes.
    pub statistic: f64,
    /// The recording in which the sum is the largest, from 0 on.
    pub run: usize,
    /// When in it, s.
    pub t: f64,
    /// Its value over the windows until then, to first order.
    pub before: f64,
    /// Its value over those after it.
    pub after: f64,
}

/// One step of the search.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SearchStep {
    /// The screen's best, with the gain it promised.
    pub screened: Vec<ScreenedName>,
    /// What was refined, best first.
    pub refined: Vec<RefinedName>,
}

/// A line of the screen.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ScreenedName {
    /// Kind.
    pub kind: String,
    /// Target.
    pub target: String,
    /// Promised gain per sample, nats.
    pub gain: f64,
    /// Cluster-robust t².
    pub t2: f64,
}

/// A refined candidate.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RefinedName {
    /// What was added; two names for a pair.
    pub names: Vec<Name>,
    /// Against the model before this step.
    pub evidence: Evidence,
    /// Share of bootstraps over windows in which it was best.
    pub wins: f64,
    /// Whether it was added.
    pub accepted: bool,
    /// Whether its gain was numerical.
    pub numerical: bool,
}

/// What the new model owes to its numerics.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Numerics {
    /// What smoothing its dry friction changes, over a few windows of the log; `null` when it has none, and under constraints.
    pub set_valued: Option<SmoothingError>,
}

/// What the diagnosis was made of.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Provenance {
    /// Version of the program.
    pub version: String,
    /// The model file.
    pub model: String,
    /// The logs, with their SHA-256.
    pub logs: Vec<LogProvenance>,
    /// The seed.
    pub seed: u64,
    /// Windows that the fits saw, and windows held out.
    pub windows: [usize; 2],
    /// Length of a window, s.
    pub window_s: f64,
    /// Integration steps per log sample; about rests there may be more.
    pub substeps: usize,
}

/// A log.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LogProvenance {
    /// The file.
    pub path: String,
    /// SHA-256, hexadecimal.
    pub sha256: String,
    /// Whether it was given to be held out.
    pub held_out: bool,
}
