//! How much better one fitted model explains the data than another, and how much better is enough.

use super::score::{Paired, paired, samples_per_window};
use super::study::Fitted;
use crate::shooting::Fit;

/// How much better one fitted model explains the windows than another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Comparison {
    /// Over the seen windows.
    pub inside: Paired,
    /// Over the windows held out.
    pub outside: Paired,
    /// Gain per sample over the seen windows, nats.
    pub inside_gain: f64,
    /// Gain per sample over the windows held out, nats.
    pub outside_gain: f64,
    /// By how much less the tolerances are stretched, nats.
    pub relief: f64,
}

/// So many standard deviations say that a constant is not what it is taken for: one in two thousand is as far off.
pub const SURE: f64 = 3.5;
/// A relief of the tolerances by so many nats, as of one of them that was stretched by [`SURE`], speaks for an effect by itself.
pub const RELIEF: f64 = 0.5 * SURE * SURE;

/// A loss of less than this, nats a sample, does not count against a relief: a tenth of the least gain held out that counts for an effect.
const HARMLESS: f64 = 2.5e-3;
/// Nor does this share of what it relieves: a fit that is freed of large tolerances gives up something for them.
const PART: f64 = 0.5;

/// What is accepted explains the seen windows by so many standard errors and those held out by so many, or both by as much as is the least of each.
const LEAST_Z: (f64, f64) = (4.0, 2.0);
const LEAST_Z_OF_BOTH: f64 = 3.0;
/// What is nearly as good explains those held out by so many.
const BORNE_OUT_Z: f64 = 1.0;
/// … and so many nats a sample of the one and of the other.
const LEAST_GAIN: (f64, f64) = (0.05, 0.025);
/// What takes away all that follows from anything may explain less by this factor.
const LITTLE: f64 = 0.6;

/// What is slight explains the seen windows by so many standard errors and so many nats a sample.
pub const SLIGHT: (f64, f64) = (1.5, 0.01);
/// … and those held out by this share of that at least.
const BORNE_OUT: f64 = 0.1;
/// Ahead by so many standard errors in the seen windows and in those held out it earns more constants.
const SLIGHT_LEAD: (f64, f64) = (2.0, 1.0);

/// What an effect lacks of an explanation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lack {
    /// A gain on the windows that the fit saw.
    Gain,
    /// A gain on the windows held out, though there is one on the others.
    GainHeldOut,
}

/// What an effect lacks that explains the seen windows, and those held out, by so many standard errors and so many nats a sample. Nothing where
/// both gains are large enough and significant: the seen windows chose the effect and its parameters, which those held out did not.
pub fn lacks(z: (f64, f64), gain: (f64, f64)) -> Option<Lack> {
    let on_both = z.0 > LEAST_Z_OF_BOTH && z.1 > LEAST_Z_OF_BOTH;
    if !(gain.0 > LEAST_GAIN.0 && (z.0 > LEAST_Z.0 || on_both)) {
        Some(Lack::Gain)
    } else if !(gain.1 > LEAST_GAIN.1 && z.1 > LEAST_Z.1) {
        Some(Lack::GainHeldOut)
    } else {
        None
    }
}

impl Comparison {
    /// Of `new` over `old`.
    pub fn of(new: &Fitted, old: &Fitted) -> Self {
        let inside = paired(&new.inside_scores, &old.inside_scores);
        let outside = paired(&new.outside_scores, &old.outside_scores);
        let per_sample =
            |p: Paired, fit: &Fit| p.gain / (p.windows.max(1) as f64 * samples_per_window(fit));
        Comparison {
            inside,
            outside,
            inside_gain: per_sample(inside, &new.inside),
            outside_gain: per_sample(outside, &new.outside),
            relief: old.inside.stretch - new.inside.stretch,
        }
    }

    /// What it lacks of a gain that is significant and large enough on both sides.
    pub fn lacks(&self) -> Option<Lack> {
        let z = (self.inside.z_in_reach(), self.outside.z);
        lacks(z, (self.inside_gain, self.outside_gain))
    }

    /// Whether the gain is significant on both sides, be it large enough or not.
    pub fn is_significant(&self) -> bool {
        lacks(
            (self.inside.z_in_reach(), self.outside.z),
            (f64::INFINITY, f64::INFINITY),
        )
        .is_none()
    }

    /// Whether the gain is significant and large enough on both sides.
    pub fn explains(&self) -> bool {
        self.lacks().is_none()
    }

    /// Whether the gain is significant on both sides, and large enough for what leaves nothing.
    pub fn explains_a_little(&self) -> bool {
        let z = (self.inside.z_in_reach(), self.outside.z);
        lacks(z, (self.inside_gain / LITTLE, self.outside_gain / LITTLE)).is_none()
    }

    /// Whether a law explains more than another that it contains, also where few windows make it: the gain is large enough on both sides, and as sure on both
    /// together as is the least of each. Those held out did not choose between the two, and are with the larger one.
    pub fn explains_more(&self) -> bool {
        let (inside, outside) = (self.inside.z_in_reach(), self.outside.z);
        let is_large = self.inside_gain > LEAST_GAIN.0 && self.outside_gain > LEAST_GAIN.1;
        let are_sure = inside.powi(2) + outside.powi(2) > LEAST_Z.0.powi(2) + LEAST_Z.1.powi(2);
        is_large && are_sure && inside > LEAST_Z_OF_BOTH && outside > BORNE_OUT_Z
    }

    /// Whether it may explain more than that: then the data do not tell the two apart.
    pub fn may_explain_more(&self) -> bool {
        self.inside.z > LEAST_Z_OF_BOTH && self.has_nearly_the_gain()
    }

    /// Whether both sides gain, the seen windows by enough for what is [`slight`](super::slight), and those held out by more than next to
    /// nothing of that, which would not bear it out.
    pub fn explains_slightly(&self) -> bool {
        self.inside.z > SLIGHT.0
            && self.inside_gain > SLIGHT.1
            && self.outside_gain > BORNE_OUT * self.inside_gain
    }

    /// Whether one that is slight is ahead of another by enough for its additional constants.
    pub fn leads_slightly(&self) -> bool {
        let (z_in, z_out) = SLIGHT_LEAD;
        self.explains_slightly() && self.inside.z > z_in && self.outside.z > z_out
    }

    /// Whether it is as good on the seen windows, or nearly, and half as good on those held out, of which there are fewer.
    pub fn nearly_explains(&self) -> bool {
        let is_sure = self.inside.z > LEAST_Z_OF_BOTH && self.outside.z > BORNE_OUT_Z;
        is_sure && self.has_nearly_the_gain()
    }

    /// Whether the gain is large enough on the seen windows, and half of that on those held out.
    fn has_nearly_the_gain(&self) -> bool {
        self.inside_gain > LEAST_GAIN.0 && self.outside_gain > 0.5 * LEAST_GAIN.1
    }

    /// All that speaks for it on the seen windows, nats: what it explains better, and the tolerances that it stretches less.
    pub fn total(&self) -> f64 {
        self.inside.gain + self.relief
    }

    /// Whether the windows held out do not speak against the new model, or by next to nothing.
    pub fn is_borne_out(&self) -> bool {
        self.outside.z > 0.0 || self.outside_gain > -HARMLESS
    }

    /// Whether the old model explains the windows as well only by stretching what is known of masses and gains beyond belief.
    pub fn relieves(&self) -> bool {
        let relief_of = |of: Paired| {
            let share = of.windows as f64 / self.inside.windows.max(1) as f64;
            self.relief * share
        };
        // Where both models do the same, a loss of next to nothing may be a steady one.
        let harmless = |of: Paired, per_sample: f64| {
            of.z > -2.0 || per_sample > -HARMLESS || of.gain > -PART * relief_of(of)
        };
        self.relief > RELIEF
            && harmless(self.inside, self.inside_gain)
            && harmless(self.outside, self.outside_gain)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_slight_is_borne_out_by_the_windows_held_out() {
        let paired = |z: f64, gain: f64| Paired {
            z,
            gain,
            windows: 25,
        };
        let slight = |gain: f64, held_out: f64| Comparison {
            inside: paired(2.1, 40.0),
            outside: paired(1.1, 5.0),
            inside_gain: gain,
            outside_gain: held_out,
            relief: 0.0,
        };
        assert!(slight(0.02, 0.003).explains_slightly());
        assert!(!slight(0.009, 0.02).explains_slightly(), "too little");
        assert!(!slight(1.43, 0.001).explains_slightly(), "they hardly move");
        assert!(!slight(0.02, f64::NAN).explains_slightly());
        assert!(slight(0.02, 0.003).leads_slightly());
    }

    #[test]
    fn eight_windows_and_four_explain_where_all_of_them_do() {
        let compared = |inside: Paired, outside: Paired| Comparison {
            inside,
            outside,
            inside_gain: 1.0,
            outside_gain: 1.0,
            relief: 0.0,
        };
        let gains = |n: usize, lost: f64| {
            let mut new = vec![5.0; n];
            new[0] = lost;
            super::paired(&new, &vec![0.0; n])
        };
        assert!(compared(gains(8, 4.0), gains(4, 4.0)).explains());
        assert!(!compared(gains(8, -4.0), gains(4, 4.0)).explains());
        assert!(!compared(gains(8, 4.0), gains(4, -4.0)).explains());
    }

    #[test]
    fn a_gain_may_be_beyond_doubt_and_small() {
        let compared = |z: f64, outside: f64| Comparison {
            inside: Paired {
                z,
                gain: 140.0,
                windows: 66,
            },
            outside: Paired {
                z: outside,
                gain: 30.0,
                windows: 20,
            },
            inside_gain: 0.02,
            outside_gain: 0.02,
            relief: 0.0,
        };
        assert!(compared(6.8, 3.3).is_significant() && !compared(6.8, 3.3).explains());
        assert!(!compared(3.5, 2.5).is_significant());
        assert!(!compared(6.8, 1.5).is_significant());
    }

    #[test]
    fn an_explanation_is_large_enough_and_sure_on_the_windows_that_the_fit_saw_and_on_those_held_out()
     {
        let large = (0.051, 0.026);
        assert_eq!(lacks((4.1, 2.1), large), None);
        assert_eq!(lacks((3.9, 2.1), large), Some(Lack::Gain));
        assert_eq!(lacks((3.1, 3.1), large), None, "as sure on both");
        assert_eq!(lacks((2.9, 9.0), large), Some(Lack::Gain));
        assert_eq!(lacks((4.1, 1.9), large), Some(Lack::GainHeldOut));
        assert_eq!(lacks((9.0, 9.0), (0.049, 0.026)), Some(Lack::Gain));
        assert_eq!(lacks((9.0, 9.0), (0.051, 0.024)), Some(Lack::GainHeldOut));
        let nan = f64::NAN;
        assert_eq!(lacks((nan, 9.0), large), Some(Lack::Gain));
    }
}
