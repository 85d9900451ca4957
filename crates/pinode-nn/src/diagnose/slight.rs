//! Names that explain little, and are sure all the same.
//!
//! With the information I_w on an effect of size δ, a window gains ½ I_w δ² by it, give or take √I_w δ: a comparison of windows sees it with
//! z = ½ δ √(Σ I_w), half as clearly as its size is determined, and less where a few windows know most of it. So where nothing explains enough by itself,
//! the scores e_w of the model without it are asked, along the whole of the fitted effect: t = Σ e_w / √(Σ e_w²), in the seen windows, which it was
//! fitted to, and in those held out, unless the windows see it beyond doubt: where few of them have large scores, these are the less sure. Without an effect both are normal, and t_in² + max(t_out, 0)² is beyond T² with a probability below exp(−T²/2).

use super::accept::leading;
use super::comparison::{Comparison, SLIGHT};
use super::found::position;
use super::numerics::sharp;
use super::refine::{Contender, Standing, rank};
use super::screen::asked;
use super::step::Step;
use super::study::{Fitted, Study};

/// One name in so many is sure by chance, of those with one probe; of those with several, one of whose probes the fit began with, as many fewer.
const BY_CHANCE: f64 = 3e-4;
/// The windows held out ask for it by so many standard errors at least.
const ASKED: f64 = 1.0;

impl Step {
    /// Accepts the best of what explains little and is sure, where the step, made from `current`, has accepted nothing.
    pub fn or_slight(mut self, study: &Study, current: &Fitted, seed: u64) -> Self {
        if self.accepted.is_some() {
            return self;
        }
        let held_out = study.of_held_out(current);
        for contender in &mut self.contenders {
            if contender.is_sensible && contender.comparison.explains_slightly() {
                let is_sure = contender.comparison.is_significant()
                    || is_sure(study, current, &held_out, contender);
                contender.standing = match is_sure {
                    true => Standing::Slight,
                    false => Standing::BesideSlight,
                };
            }
        }
        self.ask_sharper_friction(study, current);
        self.accepted = leading(study, current, &mut self.contenders);
        if self.accepted.is_none() {
            // Nobody has a say where nobody is sure.
            for contender in &mut self.contenders {
                contender.standing = Standing::Usual;
            }
        }
        rank(&mut self.contenders, seed);
        self
    }

    /// A law of dry friction that does no more than sharper friction of `current` has no say.
    fn ask_sharper_friction(&mut self, study: &Study, current: &Fitted) {
        let rubs = |c: &Contender| c.added.iter().any(|c| c.kind.dry().is_some());
        let is_slight = |c: &Contender| c.standing == Standing::Slight && rubs(c);
        if !(study.may_sharpen && self.contenders.iter().any(is_slight)) {
            return;
        }
        // Roll-outs that differ by so many times the noise differ by the least gain that counts, half the square of that.
        let seen = (2.0 * SLIGHT.1).sqrt();
        let Some((_, sharper)) = sharp(study, current, seen) else {
            return;
        };
        for contender in self.contenders.iter_mut().filter(|c| rubs(c)) {
            if !Comparison::of(&contender.fitted, &sharper).explains_slightly() {
                contender.standing = Standing::Usual;
            }
        }
    }
}

/// Whether the scores of the model without it, `current` in the seen windows and the other in those held out, ask for a contender.
fn is_sure(
    study: &Study,
    current: &Fitted,
    (held_out, there): &(Study, Fitted),
    contender: &Contender,
) -> bool {
    let ([candidate], fitted) = (&contender.added[..], &contender.fitted) else {
        return false;
    };
    let Some(index) = position(fitted, candidate) else {
        return false;
    };
    let parameters = &fitted.inside.theta[fitted.hybrid.range(index)];
    let score = |study, model| asked(study, model, *candidate, parameters);
    let Some(out) = score(held_out, there).filter(|t| *t > ASKED) else {
        return false;
    };
    let contained = candidate.contained(&current.hybrid, &current.inside.theta);
    let scales = candidate.scales(&current.hybrid, &study.scales);
    let probes = (candidate.kind.probes)(&scales, &contained).len().max(1) as f64;
    score(study, current).is_some_and(|inside| exceeds(inside, out, probes))
}

/// Whether two scores are beyond what is one in `1/BY_CHANCE` names with so many probes.
fn exceeds(inside: f64, out: f64, probes: f64) -> bool {
    let out = out.max(0.0);
    inside > 0.0 && inside * inside + out * out > -2.0 * (BY_CHANCE / probes).ln()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::super::candidate::Candidate;
    use super::super::pushes::tests::prepared_with;
    use super::super::setup::Prepared;
    use super::super::step::{Turn, step_from};
    use super::*;

    /// Determined to a tenth of itself, and worth a third of what explains enough: 0.017 nats a sample.
    #[test]
    fn a_brake_too_weak_for_a_comparison_of_windows_is_found_by_their_scores() {
        let accepted = |damping: f64| {
            let (_dir, Prepared { study, null, .. }) = prepared_with(0.0, damping);
            let (base, first) = step_from(&study, null, &[], Turn::First, 1, &|_| ());
            assert!(first.accepted.is_none(), "{damping}");
            let step = first.or_slight(&study, &base, 1);
            step.accepted.map(|k| step.contenders[k].clone())
        };
        let found = accepted(0.014).unwrap();
        assert_eq!(found.added, [Candidate::named("viscous_friction", 0)]);
        assert_eq!(found.standing, Standing::Slight);
        let index = position(&found.fitted, &found.added[0]).unwrap();
        let place = found.fitted.hybrid.range(index).start;
        let (value, fit) = (found.fitted.inside.theta[place], &found.fitted.inside);
        let k = fit.free.iter().position(|&i| i == place).unwrap();
        let error = fit.standard_errors()[k];
        assert!((value - 0.014).abs() < 3.0 * error, "{value} ± {error}");
        assert!(error < 0.002, "{error}");
        assert!(accepted(0.0).is_none());
    }

    #[test]
    fn what_the_windows_held_out_ask_for_needs_less_of_the_others_and_more_where_many_probes_were_tried()
     {
        // √(−2 ln 3·10⁻⁴) = 4.03.
        assert!(exceeds(4.1, 0.0, 1.0) && !exceeds(3.9, 0.0, 1.0));
        assert!(exceeds(3.5, 2.1, 1.0) && !exceeds(3.5, -2.1, 1.0));
        assert!(exceeds(4.1, 2.9, 80.0) && !exceeds(4.1, 2.1, 80.0));
        assert!(
            !exceeds(-9.0, 3.0, 1.0),
            "the seen windows ask for its opposite"
        );
        assert!(!exceeds(f64::NAN, 3.0, 1.0) && !exceeds(9.0, f64::NAN, f64::NAN));
    }
}
