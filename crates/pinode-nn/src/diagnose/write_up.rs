//! From a search to the documents: the new model and the entries of the diagnosis.

use std::collections::BTreeMap;

use super::candidate::Candidate;
use super::comparison::Comparison;
use super::experiment::{self, Split};
use super::misfit;
use super::refine::Contender;
use super::search::Search;
use super::study::{Fitted, Study};
use super::verdict::{
    Alternative, Evidence, FittedConstant, Name, NamedEffect, ParameterValue, Provenance,
    RefinedName, Residual, ScreenedName, SearchStep,
};
use crate::effect::ActsOn;
use crate::hybrid::{ConstantId, Hybrid, Placed};
use crate::model::{EffectEntry, Model, Revision, Target};

/// The input model with the found effects, and with all constants as fitted.
pub fn revision(
    model: &Model,
    (study, search): (&Study, &Search),
    provenance: &Provenance,
) -> Revision {
    let fitted = search.whole();
    let theta = &fitted.inside.theta;
    let hybrid = &fitted.hybrid;
    let errors = Errors::of(search, study);
    let mut revision = Revision::of(model);
    for (i, constant) in hybrid.constants().iter().enumerate() {
        match constant.id {
            ConstantId::Mechanics(k) => revision.parameter_values[k] = theta[i],
            ConstantId::Gain(k) => revision.gains[k] = theta[i],
            ConstantId::Zero(k) => revision.zeros[k] = theta[i],
            ConstantId::Effect(..) | ConstantId::Network(..) => {}
        }
    }
    revision.effects = hybrid
        .effects()
        .iter()
        .enumerate()
        .map(|(index, placed)| {
            let target = match placed.kind.acts_on() {
                ActsOn::Joint | ActsOn::Sensor => Target::Coordinate(placed.target),
                ActsOn::Input => Target::Input(placed.target),
                ActsOn::Link => Target::Link(placed.target),
            };
            let own = model
                .effects
                .iter()
                .find(|e| (e.kind, e.target, e.fixed) == (placed.kind, target, placed.fixed));
            let range = hybrid.range(index);
            let angular = hybrid.is_angular(placed.kind, placed.target);
            let entry = EffectEntry {
                kind: placed.kind,
                target,
                values: theta[range.clone()].to_vec(),
                smoothing: own.and_then(|own| own.smoothing).or_else(|| {
                    let default = hybrid.unsaid_smoothing(angular);
                    (placed.kind.is_smoothed() && placed.smoothing != default)
                        .then_some(placed.smoothing)
                }),
                fixed: placed.fixed,
            };
            let comment = search
                .found
                .iter()
                .find(|f| f.candidate.is(placed))
                .map(|found| {
                    // What explains no more than stretched tolerances do, and takes their place.
                    let relief = match found.comparison.relieves() {
                        true => format!(", {:.0} nats of tolerances relieved", found.comparison.relief),
                        false => String::new(),
                    };
                    let mut comment = format!(
                        "found by pinode {}: confidence {:.2}, z = {:.1} (held out {:.1}), {:.3} nats per sample{relief}; seed {}\n",
                        provenance.version,
                        found.confidence,
                        found.comparison.inside.z,
                        found.comparison.outside.z,
                        found.comparison.inside_gain,
                        provenance.seed
                    );
                    for log in &provenance.logs {
                        comment += &format!("log {} (sha256 {})\n", log.path, log.sha256);
                    }
                    for (k, i) in range.enumerate() {
                        if let Some(std) = errors.at(i) {
                            let spec = &placed.kind.parameters[k];
                            comment += &format!(
                                "{} = {:.4e} ± {std:.1e} {}\n",
                                spec.name,
                                theta[i],
                                spec.quantity.unit(angular)
                            );
                        }
                    }
                    comment.trim_end().to_owned()
                })
                .unwrap_or_default();
            (entry, comment)
        })
        .collect();
    revision
}

/// Gives every entry that may have one the smoothing velocity of the fitted model's effect.
pub fn say_smoothing(revision: &mut Revision, hybrid: &Hybrid) {
    for ((entry, _), placed) in revision.effects.iter_mut().zip(hybrid.effects()) {
        if entry.kind.is_smoothed() {
            entry.smoothing = Some(placed.smoothing);
        }
    }
}

/// Standard errors by index in θ: of the fit with a network, and where that held a constant, of the one without.
struct Errors<'a> {
    fits: [(&'a [usize], &'a [f64]); 2],
}

impl<'a> Errors<'a> {
    fn of(search: &'a Search, study: &Study) -> Self {
        let fits = [search.whole(), &search.model];
        Errors {
            fits: fits.map(|fit| (&fit.inside.free[..], fit.standard_errors(study))),
        }
    }

    fn at(&self, index: usize) -> Option<f64> {
        let of_fit = |(free, errors): &(&[usize], &[f64])| {
            let k = free.iter().position(|&i| i == index)?;
            errors.get(k).copied()
        };
        let error = self.fits.iter().find_map(of_fit)?;
        Some(error).filter(|e| e.is_finite())
    }
}

/// The found effects, with the best of the experiments that split them from their rivals.
pub fn effects(
    (study, search): (&Study, &Search),
    splits: &[Split],
    inputs: &[String],
) -> Vec<NamedEffect> {
    let Fitted { hybrid, inside, .. } = search.whole();
    let theta = &inside.theta;
    let errors = Errors::of(search, study);
    let name = |c: &Candidate| name(c, hybrid, inputs);
    search
        .found
        .iter()
        .filter_map(|found| {
            let candidate = &found.candidate;
            let index = hybrid.effects().iter().position(|e| candidate.is(e))?;
            let placed = hybrid.effects()[index];
            let angular = hybrid.is_angular(candidate.kind, candidate.target);
            let parameters: BTreeMap<String, ParameterValue> = hybrid
                .range(index)
                .zip(candidate.kind.parameters)
                .filter(|(i, spec)| spec.is_told(theta[*i]))
                .map(|(i, spec)| {
                    let value = ParameterValue {
                        value: theta[i],
                        std: errors.at(i),
                        unit: spec.quantity.unit(angular).into(),
                    };
                    (spec.name.to_owned(), value)
                })
                .collect();
            let own = name(candidate);
            let experiments = experiment::listed(splits.iter().filter(|s| s.own == own));
            let Name { kind, target } = own;
            let is_known = |e: &Placed| {
                e.is_same(&Placed {
                    fixed: true,
                    ..placed
                })
            };
            Some(NamedEffect {
                kind,
                target,
                beside_fixed: hybrid.effects().iter().any(is_known),
                confidence: found.confidence,
                parameters,
                alternatives: found
                    .alternatives
                    .iter()
                    .map(|(other, confidence)| {
                        let Name { kind, target } = name(other);
                        Alternative {
                            kind,
                            target,
                            confidence: *confidence,
                        }
                    })
                    .collect(),
                indistinguishable_from: found.indistinguishable.iter().map(name).collect(),
                experiments,
                evidence: evidence(&found.comparison),
            })
        })
        .collect()
}

pub fn name(candidate: &Candidate, hybrid: &Hybrid, inputs: &[String]) -> Name {
    Name {
        kind: candidate.kind.name.into(),
        target: candidate.target_name(hybrid, inputs).into(),
    }
}

/// The effects with any of these entries of θ.
pub fn with_entries(hybrid: &Hybrid, entries: &[usize], inputs: &[String]) -> Vec<Name> {
    let effects = hybrid.effects().iter().enumerate();
    let having = effects.filter(|(index, _)| {
        let range = hybrid.range(*index);
        entries.iter().any(|i| range.contains(i))
    });
    let name = |(_, placed): (usize, &Placed)| Name {
        kind: placed.kind.name.into(),
        target: hybrid
            .target_name(placed.kind, placed.target, inputs)
            .into(),
    };
    having.map(name).collect()
}

fn evidence(comparison: &Comparison) -> Evidence {
    Evidence {
        z_fit: comparison.inside.z_in_reach(),
        z_held_out: comparison.outside.z,
        gain_fit: comparison.inside_gain,
        gain_held_out: comparison.outside_gain,
        relief: comparison.relief,
    }
}

/// The constants that were not found but moved: masses, gains, zeros, known effects.
pub fn constants((study, search): (&Study, &Search), inputs: &[String]) -> Vec<FittedConstant> {
    let fitted = &search.model;
    let theta = &search.whole().inside.theta;
    let errors = Errors::of(search, study);
    let is_found = |effect: usize| {
        let placed = fitted.hybrid.effects()[effect];
        search.found.iter().any(|f| f.candidate.is(&placed))
    };
    let null = &search.null.hybrid;
    let moved = fitted.inside.free.iter().filter_map(|&i| {
        let constant = &fitted.hybrid.constants()[i];
        match constant.id {
            ConstantId::Effect(e, _) if is_found(e) => return None,
            ConstantId::Network(..) => return None,
            _ => {}
        }
        let name = fitted.hybrid.describe(i, inputs);
        // Known effects carry the value they were last placed with, and a constant that was released has no tolerance; the null model has both.
        let of_null = |k: &usize| null.describe(*k, inputs) == name;
        let given = (0..null.constants().len()).find(of_null);
        let given = given.map_or(constant, |k| &null.constants()[k]);
        Some(FittedConstant {
            name,
            given: given.value,
            fitted: theta[i],
            std: errors.at(i),
            tolerance: given.tolerance,
        })
    });
    moved.collect()
}

/// The steps of the search.
pub fn steps(search: &Search, inputs: &[String]) -> Vec<SearchStep> {
    let hybrid = &search.null.hybrid;
    let samples = super::score::samples_per_window(&search.null.inside)
        * search.null.inside_scores.len().max(1) as f64;
    search
        .steps
        .iter()
        .map(|step| SearchStep {
            screened: step
                .screened
                .iter()
                .map(|s| {
                    let Name { kind, target } = name(&s.candidate, hybrid, inputs);
                    ScreenedName {
                        kind,
                        target,
                        gain: s.gain / samples,
                        t2: s.t2,
                    }
                })
                .collect(),
            refined: step
                .contenders
                .iter()
                .enumerate()
                .map(|(k, c)| refined(c, step.accepted == Some(k), hybrid, inputs))
                .collect(),
        })
        .collect()
}

fn refined(c: &Contender, accepted: bool, hybrid: &Hybrid, inputs: &[String]) -> RefinedName {
    RefinedName {
        names: c.added.iter().map(|a| name(a, hybrid, inputs)).collect(),
        evidence: evidence(&c.comparison),
        wins: c.wins,
        accepted,
        numerical: c.numerically_sound == Some(false),
    }
}

/// What the fits before and after leave of every channel.
pub fn residuals(study: &Study, search: &Search) -> Vec<Residual> {
    let coordinates = search.null.hybrid.mechanics().coordinates();
    let before = search.null.excess(&study.observations);
    let after = search.whole().excess(&study.observations);
    let strays = [&search.null, search.whole()].map(|fitted| misfit::strays(study, fitted));
    let channels = study.observations.channels.iter().enumerate();
    channels
        .map(|(c, channel)| {
            let of = if channel.velocity { "v" } else { "q" };
            Residual {
                name: format!("{of}.{}", coordinates[channel.coordinate].name),
                before: before[c],
                after: after[c],
                strays: [strays[0][c], strays[1][c]],
            }
        })
        .collect()
}
