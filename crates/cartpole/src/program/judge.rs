//! The diagnosis against the truth.

use pinode_nn::diagnose::verdict::{NamedEffect, Verdict};
use serde::Serialize;

use crate::rig::Hidden;

/// How well the hidden effect was named.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Judgement {
    /// The hidden effect was named and nothing else; or nothing was hidden and nothing is said to be missing.
    Right,
    /// The hidden effect was named, and others that the rig does not have.
    RightAndMore,
    /// The hidden effect is among the names that the diagnosis says it cannot tell from the one it gives.
    Undecided,
    /// Another effect was named, or one where nothing was hidden.
    Wrong,
    /// Nothing was named.
    Missed,
}

impl Judgement {
    /// Judges what was said about `hidden`.
    pub fn of(hidden: &Hidden, verdict: Verdict, effects: &[NamedEffect]) -> Self {
        let Some(target) = hidden.target() else {
            return match (verdict, effects) {
                (Verdict::NothingMissing, []) => Judgement::Right,
                _ => Judgement::Wrong,
            };
        };
        let is_hidden = |kind: &str, on: &str| kind == hidden.kind() && on == target.name();
        if effects.iter().any(|e| is_hidden(&e.kind, &e.target)) {
            return match effects.len() {
                1 => Judgement::Right,
                _ => Judgement::RightAndMore,
            };
        }
        let mut ties = effects.iter().flat_map(|e| &e.indistinguishable_from);
        if ties.any(|n| is_hidden(&n.kind, &n.target)) {
            Judgement::Undecided
        } else if effects.is_empty() {
            Judgement::Missed
        } else {
            Judgement::Wrong
        }
    }

    /// In a sentence.
    pub fn in_words(self) -> &'static str {
        match self {
            Judgement::Right => "The diagnosis is right.",
            Judgement::RightAndMore => {
                "The hidden effect was named, but so was something that the rig does not have."
            }
            Judgement::Undecided => {
                "The name is not the right one; the right one is among those that the data cannot tell from it, as the diagnosis says."
            }
            Judgement::Wrong => "The diagnosis is wrong.",
            Judgement::Missed => "The diagnosis missed the effect: it names nothing.",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::Target;
    use pinode_nn::diagnose::verdict::{Evidence, Name};

    const HIDDEN: Hidden = Hidden::QuadraticDrag {
        target: Target::Slider,
        coefficient: 0.5,
    };

    fn found(kind: &str, target: &str, tie: Option<&str>) -> NamedEffect {
        NamedEffect {
            beside_fixed: false,
            kind: kind.into(),
            target: target.into(),
            confidence: 0.9,
            parameters: Default::default(),
            alternatives: vec![],
            indistinguishable_from: tie
                .map(|kind| Name {
                    kind: kind.into(),
                    target: target.into(),
                })
                .into_iter()
                .collect(),
            experiments: vec![],
            evidence: Evidence {
                z_fit: 9.0,
                z_held_out: 9.0,
                gain_fit: 1.0,
                gain_held_out: 1.0,
                relief: 0.0,
            },
        }
    }

    #[test]
    fn kind_and_target_both_count() {
        let judge =
            |effects: &[NamedEffect]| Judgement::of(&HIDDEN, Verdict::EffectsFound, effects);
        let right = found("quadratic_drag", "slider", None);
        let elsewhere = found("quadratic_drag", "pole", None);
        assert_eq!(judge(std::slice::from_ref(&right)), Judgement::Right);
        assert_eq!(judge(std::slice::from_ref(&elsewhere)), Judgement::Wrong);
        assert_eq!(judge(&[elsewhere, right]), Judgement::RightAndMore);
        let tied = found("viscous_friction", "slider", Some("quadratic_drag"));
        assert_eq!(judge(&[tied]), Judgement::Undecided);
        assert_eq!(judge(&[]), Judgement::Missed);
    }

    #[test]
    fn where_nothing_is_hidden_silence_is_right() {
        let judge =
            |verdict, effects: &[NamedEffect]| Judgement::of(&Hidden::Nothing, verdict, effects);
        assert_eq!(judge(Verdict::NothingMissing, &[]), Judgement::Right);
        assert_eq!(judge(Verdict::Unexplained, &[]), Judgement::Wrong);
        let invented = found("viscous_friction", "pole", None);
        assert_eq!(judge(Verdict::EffectsFound, &[invented]), Judgement::Wrong);
    }
}
