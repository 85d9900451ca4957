//! Which of the refined candidates is accepted.

use super::candidate::Candidate;
use super::comparison::Comparison;
use super::numerics::sharp;
use super::refine::{Contender, Standing, is_sensible, rank};
use super::step::FAR;
use super::study::{Fitted, Study};
use super::width::{is_soft, respread};
use crate::smoothing::VISIBLE;

/// Who is behind by so many standard errors on the windows held out does not lead.
const BEHIND: f64 = -1.0;
/// What relieves tolerances is in doubt beside what gains in both parts by so many standard errors, relieves this share of it and has so many times the evidence.
const GAINS: (f64, f64) = (1.5, 1.0);
const PART_OF_RELIEF: f64 = 0.5;
const FAR_MORE: f64 = 3.0;
/// A law of dry friction that leads one that it contains by so many nats and does not earn its constants is asked again as sharp as the data see it.
const WORTH_SHARPENING: f64 = 20.0;
/// A gain that loses more than this share when the numerics are refined is numerical. One that grows was held back by them.
const NUMERICAL: f64 = 0.3;

/// The best contender that has a say, where the gain of one is significant on both sides and not numerical. Where none is, but something is left
/// beyond doubt, one with a smaller gain that leaves nothing: of the `first` name only, for beside one that stands in for what
/// is there others take what it leaves.
pub fn accept(
    study: &Study,
    current: &Fitted,
    contenders: &mut [Contender],
    (first, seed): (bool, u64),
) -> Option<usize> {
    let accepted = leading(study, current, contenders).or_else(|| {
        let follows = |fitted: &Fitted| fitted.left(study).is_some();
        if !(first && follows(current)) {
            return None;
        }
        for contender in contenders.iter_mut() {
            let (compared, fitted) = (&contender.comparison, &contender.fitted);
            if compared.explains_a_little() && !follows(fitted) {
                contender.standing = Standing::TakesAll;
            }
        }
        leading(study, current, contenders)
    });
    // Without those that were found to be numerical; the order stays.
    rank(contenders, seed);
    accepted
}

/// The best contender that has a say, where one is acceptable and not numerical; in place of it a simpler one that does as well.
pub fn leading(study: &Study, current: &Fitted, contenders: &mut [Contender]) -> Option<usize> {
    for k in 0..contenders.len() {
        let is_in_doubt = contenders
            .iter()
            .any(|c| contenders[k].is_in_doubt_beside(c));
        if contenders[k].is_acceptable() && !is_in_doubt && contenders[k].is_sound(study, current) {
            // One that is ahead of it on the seen windows and not behind on those held out.
            let leader = (0..k).find(|&j| {
                let (ahead, own) = (&contenders[j], &contenders[k].fitted);
                let held_out = Comparison::of(&ahead.fitted, own).outside.z;
                ahead.is_rival() && held_out > BEHIND && contenders[j].is_sound(study, current)
            });
            let k = leader.unwrap_or(k);
            // What is found to be numerical is no simpler name from then on.
            let mut best = k;
            while let Some(j) = simpler(study, contenders, k, best) {
                if contenders[j].is_sound(study, current) {
                    best = j;
                }
            }
            return Some(best);
        }
    }
    None
}

/// The best contender that has a say and fewer constants than the `best` so far, unless that or the `k`th, which leads, would be accepted beside it: a name
/// with more constants earns its place against one with fewer as it would against none. Of what has as few the best one is asked, and in place of a
/// simpler one than the `k`th only what that contains.
pub fn simpler(study: &Study, contenders: &[Contender], k: usize, best: usize) -> Option<usize> {
    let constants = |c: &Contender| c.fitted.inside.free.len();
    let earns = |c: usize, other: &Contender| {
        let lead = Comparison::of(&contenders[c].fitted, &other.fitted);
        // One that stretches what is known in place of a constant of its own is no simpler.
        lead.explains()
            || lead.relieves()
            || (contenders[c].standing == Standing::Slight && lead.leads_slightly())
            || (contenders[c].contains(other) && has_more(study, &contenders[c], other, lead))
    };
    let mut ahead = usize::MAX;
    contenders.iter().position(|other| {
        if !other.is_rival() {
            return false;
        }
        let leads = constants(other) < ahead;
        ahead = ahead.min(constants(other));
        leads
            && constants(other) < constants(&contenders[best])
            && (k == best || contenders[best].contains(other))
            && !earns(k, other)
            && (best == k || !earns(best, other))
    })
}

/// Whether one explains more than another that it contains, with this lead. Two laws of dry friction that are not as sharp as the data see it both lose, in other windows each,
/// and what one of them is ahead is lost in that: then it is asked of them as sharp as that. Where they are far from the log, for other things are missing, it is asked once these
/// are there.
fn has_more(study: &Study, rich: &Contender, simple: &Contender, lead: Comparison) -> bool {
    let are_dry = rich.added.iter().all(|c| c.kind.dry().is_some());
    let is_near = || rich.fitted.most_excess(study) < FAR;
    let leads = lead.inside.gain > WORTH_SHARPENING && lead.outside.gain > 0.0 && is_near();
    let as_sharp = || {
        let sharp = |c: &Contender| as_sharp_as_seen(study, &c.fitted, &c.added);
        let model = sharp(rich);
        let lead = Comparison::of(&model, &sharp(simple));
        let is_itself = |c: &Candidate| is_sensible(study, c, &model);
        (lead.explains() || lead.explains_more()) && rich.added.iter().all(is_itself)
    };
    lead.explains_more() || (are_dry && leads && study.may_sharpen && as_sharp())
}

/// A fitted model with the dry friction that was `added` spread over as few or as many speeds as explain the windows.
fn as_sharp_as_seen(study: &Study, fitted: &Fitted, added: &[Candidate]) -> Fitted {
    let better = |own: &Fitted| Comparison::of(own, fitted).total() > 0.0;
    let sharper = sharp(study, fitted, VISIBLE).filter(|(_, own)| better(own));
    let (study, fitted) = sharper.unwrap_or_else(|| (study.clone(), fitted.clone()));
    respread(&study, &fitted, added).unwrap_or(fitted)
}

impl Contender {
    /// Whether it only relieves tolerances, and another does so as well and gains far more, though in too few windows to be believed.
    fn is_in_doubt_beside(&self, other: &Contender) -> bool {
        let (own, others) = (&self.comparison, &other.comparison);
        let gains = others.inside.z > GAINS.0 && others.outside.z > GAINS.1;
        !own.explains()
            && self.standing == Standing::Usual
            && other.is_sensible
            && gains
            && others.relief > PART_OF_RELIEF * own.relief
            && others.total() > FAR_MORE * own.total()
    }

    /// Whether all that it adds contains what another does.
    fn contains(&self, other: &Contender) -> bool {
        let pairs = || self.added.iter().zip(&other.added);
        self.added.len() == other.added.len()
            && pairs().all(|(own, other)| own == other || own.contains(other))
    }

    /// Whether its gain is not numerical; asked once.
    fn is_sound(&mut self, study: &Study, current: &Fitted) -> bool {
        let known = self.numerically_sound;
        let sound = known.unwrap_or_else(|| is_numerically_sound(study, current, self));
        self.numerically_sound = Some(sound);
        sound
    }
}

/// Whether the gain stands when both models are fitted with half the step and half the smoothing.
fn is_numerically_sound(study: &Study, current: &Fitted, contender: &Contender) -> bool {
    // A gain as large as this is not made of integration errors below a third of the noise.
    if contender.comparison.inside_gain > 0.5 || contender.imitated {
        return true;
    }
    let fine = study.with_half_the_steps();
    let again = |fitted: &Fitted| {
        let from = &fitted.hybrid;
        let hybrid = from.smoothed_by(0.5, |placed| !is_soft(from, placed));
        let start = fitted.start(fitted.inside.theta.clone());
        fine.fit(hybrid, start, 1, 6)
    };
    let finer = Comparison::of(&again(&contender.fitted), &again(current));
    let nearly = match contender.standing {
        Standing::Usual => finer.nearly_explains(),
        Standing::TakesAll => finer.explains_a_little(),
        Standing::Slight | Standing::BesideSlight => finer.explains_slightly(),
    };
    (nearly || (contender.comparison.relieves() && finer.relieves()))
        && finer.total() > (1.0 - NUMERICAL) * contender.comparison.total()
}

#[cfg(test)]
mod tests {
    use std::sync::OnceLock;

    use super::super::candidate::Candidate;
    use super::super::pushes::tests::prepared_with;
    use super::super::refine::contender;
    use super::super::remainder::Remainder;
    use super::super::setup::Prepared;
    use super::super::shapes::Follows;
    use super::*;

    #[test]
    fn a_near_miss_is_taken_as_the_first_name_where_it_leaves_nothing_of_what_is_there() {
        let (_dir, Prepared { study, null, .. }) = prepared_with(0.0, 0.8);
        let leaves = |left: Option<Remainder>| {
            let mut fitted = null.clone();
            fitted.left = OnceLock::from(left);
            fitted
        };
        let something = Remainder {
            coordinate: 0,
            follows: Follows::Velocity,
            gain: 200.0,
            gain_per_sample: 0.06,
            z: 6.0,
            by_motion: 200.0,
        };
        assert!(something.is_significant());
        let miss = |gain: f64, left: Option<Remainder>| {
            let viscous = Candidate::named("viscous_friction", 0);
            let mut own = contender(&study, vec![viscous], leaves(left), &null);
            own.is_sensible = true;
            own.numerically_sound = Some(true);
            (own.comparison.inside.z, own.comparison.outside.z) = (7.0, 3.0);
            (own.comparison.inside_gain, own.comparison.outside_gain) = (gain, gain);
            own
        };
        let accepts = |current: &Fitted, own: Contender, first: bool| {
            accept(&study, current, &mut [own], (first, 0)).is_some()
        };
        let (there, nothing) = (leaves(Some(something.clone())), leaves(None));
        assert!(accepts(&there, miss(0.045, None), true));
        assert!(!accepts(&there, miss(0.029, None), true), "too little");
        assert!(
            !accepts(&there, miss(0.045, Some(something)), true),
            "it leaves as much"
        );
        assert!(
            !accepts(&nothing, miss(0.045, None), true),
            "nothing was there"
        );
        assert!(!accepts(&there, miss(0.045, None), false), "beside another");
        assert!(
            accepts(&nothing, miss(0.051, None), false),
            "enough by itself"
        );
    }

    #[test]
    fn what_relieves_tolerances_is_in_doubt_beside_what_relieves_as_much_and_gains_far_more() {
        let (_dir, Prepared { study, null, .. }) = prepared_with(0.0, 0.8);
        // Standard errors in both parts, nats in the seen one and of tolerances.
        let one = |z: (f64, f64), gain: f64, relief: f64| {
            let viscous = Candidate::named("viscous_friction", 0);
            let mut own = contender(&study, vec![viscous], null.clone(), &null);
            (own.is_sensible, own.is_sure, own.imitated) = (true, true, true);
            own.numerically_sound = Some(true);
            let compared = &mut own.comparison;
            (compared.inside.z, compared.outside.z) = z;
            (compared.inside.gain, compared.relief) = (gain, relief);
            (compared.inside_gain, compared.outside_gain) = (0.01 * gain, 0.01 * gain);
            own
        };
        let relieving = || one((0.3, -0.4), 0.1, 18.0);
        let accepted = |other: Contender| leading(&study, &null, &mut [other, relieving()]);
        // Friction in a few pushes: 2.3 and 2.1 standard errors.
        let friction = |relief: f64| Contender {
            imitated: false,
            ..one((2.3, 2.1), 900.0, relief)
        };
        assert!(!friction(18.0).is_rival());
        assert_eq!(accepted(friction(18.0)), None);
        assert_eq!(accepted(friction(1.0)), Some(1), "it relieves nothing");
        let little = Contender {
            imitated: false,
            ..one((2.3, 2.1), 20.0, 18.0)
        };
        assert_eq!(accepted(little), Some(1), "it gains as much");
        let contradicted = Contender {
            imitated: false,
            ..one((2.3, -2.1), 900.0, 18.0)
        };
        assert_eq!(
            accepted(contradicted),
            Some(1),
            "not where it was not fitted"
        );
    }
}
