//! Numbers and verdicts as people say them.

use crate::diagnose::audit::contradicts;
use crate::diagnose::conventions::CONVENTION;
use crate::diagnose::verdict::{
    CoordinateExcitation, Diagnosis, EVEN, Gap, NamedEffect, ParameterValue, Verdict,
};
use crate::digits::{exponent, fixed, is_plain};
pub use crate::digits::{number, short, uncertain};
use crate::effect::registry;

/// A name of the library without its underscores: `coulomb_friction` is "Coulomb friction".
pub fn plain(name: &str) -> String {
    let words: Vec<&str> = name
        .split('_')
        .map(|word| match word {
            "coulomb" => "Coulomb",
            "stribeck" => "Stribeck",
            "dahl" => "Dahl",
            "lugre" => "LuGre",
            other => other,
        })
        .collect();
    match words.join(" ").as_str() {
        "unknown" => "unknown effect".to_owned(),
        words => words.to_owned(),
    }
}

/// An interval to the second digit of half its width: `0.292 to 0.333`.
pub fn interval([from, to]: [f64; 2], half: f64) -> String {
    let size = exponent(from.abs().max(to.abs()), 2);
    if !(from.is_finite() && to.is_finite() && half > 0.0 && is_plain(size)) {
        return format!("{} to {}", number(from), number(to));
    }
    let last = (exponent(half, 1) - 1).max(size - 5);
    format!("{} to {}", fixed(from, -last), fixed(to, -last))
}

/// `0.31 ± 0.01 N`; ratios have no unit.
pub fn quantity(parameter: &ParameterValue) -> String {
    with_unit(uncertain(parameter.value, parameter.std), &parameter.unit)
}

/// A number and its unit; the unit of a ratio is left out.
pub fn with_unit(number: String, unit: &str) -> String {
    match unit {
        "" | "1" => number,
        unit => format!("{number} {unit}"),
    }
}

/// A probability or a share; never a false 0 or 100.
pub fn percent(share: f64) -> String {
    match 100.0 * share {
        p if p.is_nan() => "–".to_owned(),
        p if (99.5..100.0).contains(&p) => "> 99 %".to_owned(),
        p if p > 0.0 && p < 0.5 => "< 1 %".to_owned(),
        p => format!("{p:.0} %"),
    }
}

/// The verdict in plain sentences.
pub fn verdict(diagnosis: &Diagnosis) -> String {
    let said = match diagnosis.verdict {
        Verdict::EffectsFound => format!("{}.{}", missing(&diagnosis.effects), more(diagnosis)),
        Verdict::NothingMissing if hardly_moves(diagnosis) => {
            "The log hardly moves: the model explains it, as any other would.".to_owned()
        }
        Verdict::NothingMissing => format!(
            "Nothing is missing: the model explains the data{}.",
            adjusted(diagnosis)
        ),
        Verdict::Unexplained => unexplained(diagnosis),
        Verdict::DataFault => data_fault(diagnosis),
    };
    let said = match otherwise(diagnosis).as_slice() {
        [] => said,
        _ if diagnosis.verdict == Verdict::DataFault => said,
        columns => format!(
            "The log counts otherwise than the model in {}: it was read as it is meant. {said}",
            columns.join(", ")
        ),
    };
    match gap(&diagnosis.gap, may_stick(diagnosis)) {
        Some(gap) => format!("{said} {gap}"),
        None => said,
    }
}

/// Whether no reading leaves its sensor's noise.
fn hardly_moves(diagnosis: &Diagnosis) -> bool {
    let coordinates = &diagnosis.excitation.coordinates;
    let noises = diagnosis.gap.coordinates.iter().map(|c| c.noise);
    let still = |(c, noise): (&CoordinateExcitation, f64)| c.is_still(noise);
    !coordinates.is_empty() && coordinates.iter().zip(noises).all(still)
}

/// Which constants had to move for it to explain the data.
fn adjusted(diagnosis: &Diagnosis) -> String {
    let moved: Vec<String> = diagnosis
        .constants
        .iter()
        .filter(|c| c.moved().is_some())
        .map(|c| format!("{} is {}", c.spoken(), uncertain(c.fitted, c.std)))
        .collect();
    match moved.is_empty() {
        true => String::new(),
        false => format!(" when {}", moved.join(" and ")),
    }
}

/// What is left beside what was found, where it follows from something.
fn more(diagnosis: &Diagnosis) -> String {
    let left = diagnosis.unexplained.as_ref();
    if let Some(follows) = left.and_then(|left| left.follows.as_ref()) {
        return format!(" That is not all: what is left follows {follows}.");
    }
    let learnt = left.and_then(|left| left.learnt.as_ref()).map(|learnt| {
        format!(
            "a network has learnt something on {} that no effect in the library explains",
            learnt.places()
        )
    });
    let change = diagnosis.change.as_ref();
    let changes = change.map(|change| format!("the {} changes over the log", change.name));
    let more: Vec<String> = learnt.into_iter().chain(changes).collect();
    match more.is_empty() {
        true => String::new(),
        false => format!(" That is not all: {}.", more.join(", and ")),
    }
}

/// Effects with their places and confidences.
fn named(effects: &[NamedEffect]) -> String {
    let said: Vec<String> = effects
        .iter()
        .map(|e| format!("{}, {}", placed(e), percent(e.confidence)))
        .collect();
    said.join("; ")
}

/// An effect and where it is.
fn placed(effect: &NamedEffect) -> String {
    let more = match (effect.beside_fixed, takes_away(effect)) {
        (true, Some(_)) => " (less than is `fixed`)",
        (true, None) => " (beside what is `fixed`)",
        (false, Some(_)) => " (less than the model has)",
        (false, None) => "",
    };
    format!("{} on `{}`{more}", plain(&effect.kind), effect.target)
}

/// What it takes from what the model has, where its strength is negative: the name of that strength.
fn takes_away(effect: &NamedEffect) -> Option<&'static str> {
    let kind = registry::find(&effect.kind).filter(|kind| kind.adds_up())?;
    let name = kind.parameters.first()?.name;
    (effect.parameters.get(name)?.value < 0.0).then_some(name)
}

/// How probable an effect is: together with what the data do not tell from it.
fn sure(effect: &NamedEffect) -> String {
    const NAMED: usize = 2;
    let share = percent(effect.confidence);
    let others = effect.indistinguishable_from.iter();
    let named = others.map(|name| format!("{} on `{}`", plain(&name.kind), name.target));
    let mut names: Vec<String> = named.collect();
    let more = names.len().saturating_sub(NAMED);
    if more > 1 {
        names.truncate(NAMED);
        names.push(format!("one of {more} others"));
    }
    match names.split_last() {
        None => share,
        Some((last, [])) => format!("{share} for it or {last}"),
        Some((last, first)) => format!("{share} for it, {} or {last}", first.join(", ")),
    }
}

/// Where a centre of mass is that is not where the model has it.
fn elsewhere(effect: &NamedEffect) -> Option<String> {
    let place = effect.parameters.get("place")?;
    let is_centre = effect.kind == "centre_of_mass";
    is_centre.then(|| {
        format!(
            "the centre of mass of `{}` is {} times as far from its joint as the model has it",
            effect.target,
            quantity(place)
        )
    })
}

fn missing(effects: &[NamedEffect]) -> String {
    match effects {
        [] => "An effect is missing".to_owned(),
        [one] => {
            if let Some(said) = elsewhere(one) {
                return format!("{} ({})", capital(&said), sure(one));
            }
            let said = match takes_away(one) {
                Some(_) if one.beside_fixed => {
                    let kind = capital(&plain(&one.kind));
                    format!("{kind} on `{}` is less than is `fixed`", one.target)
                }
                Some(what) => format!("`{}` has less {what} than the model has", one.target),
                None => format!("{} is missing", capital(&placed(one))),
            };
            match quantities(one) {
                Some(quantities) => {
                    format!("{said}: {quantities} ({})", sure(one))
                }
                None => format!("{said} ({})", sure(one)),
            }
        }
        several => {
            let said: Vec<String> = several
                .iter()
                .map(|e| {
                    let said = elsewhere(e).unwrap_or_else(|| match quantities(e) {
                        Some(quantities) => format!("{}, {quantities}", placed(e)),
                        None => placed(e),
                    });
                    format!("{said} ({})", sure(e))
                })
                .collect();
            format!("{} effects are missing: {}", several.len(), said.join("; "))
        }
    }
}

/// Whether a parameter of an effect is a yes or a no.
pub fn is_flag(effect: &NamedEffect, name: &str) -> bool {
    let kind = registry::find(&effect.kind);
    kind.is_some_and(|kind| kind.parameters.iter().any(|p| p.name == name && p.is_flag))
}

/// The parameters of an effect; one needs no name.
fn quantities(effect: &NamedEffect) -> Option<String> {
    let single = effect.parameters.len() == 1;
    let all: Vec<String> = effect
        .parameters
        .iter()
        .map(|(name, p)| match single {
            _ if is_flag(effect, name) => plain(name),
            true => quantity(p),
            false => format!("{} {}", plain(name), quantity(p)),
        })
        .collect();
    (!all.is_empty()).then(|| all.join(", "))
}

fn unexplained(diagnosis: &Diagnosis) -> String {
    // Where the unexplained force is, else where the model as given is off most.
    let of_force = diagnosis.unexplained.as_ref().map(|u| &u.coordinate);
    let of_model = diagnosis.disagreement.first().map(|d| &d.coordinate);
    let place = of_force.or(of_model);
    let place = place.map_or(String::new(), |name| format!(" on `{name}`"));
    match diagnosis.effects.as_slice() {
        [] => format!("Something is missing{place} that no effect in the library explains."),
        doubtful if doubtful.iter().all(|e| e.confidence < EVEN) => format!(
            "Something is missing{place} that no effect in the library explains; what was added stands in for part of it at best ({}).",
            named(doubtful)
        ),
        some => format!(
            "{}. That is not all: something is left{place} that no effect in the library explains.",
            missing(some)
        ),
    }
}

/// The columns that count otherwise than the model.
fn otherwise(diagnosis: &Diagnosis) -> Vec<String> {
    let faults = diagnosis.data_faults.iter();
    let own = faults.filter(|fault| fault.kind == CONVENTION);
    own.map(|fault| format!("`{}`", fault.column)).collect()
}

fn data_fault(diagnosis: &Diagnosis) -> String {
    let columns = otherwise(diagnosis);
    if !columns.is_empty() {
        return format!(
            "The log counts otherwise than the model in {}. Read as it is meant, the model explains it.",
            columns.join(", ")
        );
    }
    let all = &diagnosis.data_faults;
    let Some(first) = all.iter().find(|f| contradicts(f)).or(all.first()) else {
        return "The data are at fault, not the model.".to_owned();
    };
    let more = match all.len() - 1 {
        0 => String::new(),
        1 => ", and one more fault".to_owned(),
        n => format!(", and {n} more faults"),
    };
    format!(
        "The data are at fault, not the model: {} in `{}`{more}. Without what is faulty the model explains the data.",
        plain(&first.kind),
        first.column
    )
}

/// Whether what was found may hold a joint at rest, or let it go, by less than the data say.
fn may_stick(diagnosis: &Diagnosis) -> bool {
    let kinds = diagnosis.effects.iter();
    let mut kinds = kinds.filter_map(|effect| registry::find(&effect.kind));
    kinds.any(|kind| kind.dry().is_some())
}

/// How the free-run error changed; nothing where it was not measured.
fn gap(gap: &Gap, may_stick: bool) -> Option<String> {
    const UNIT: &str = "times the sensor noise";
    let (before, after) = (number(gap.before), number(gap.after));
    if gap.windows == 0 && gap.after.is_nan() {
        return Some(
            "What is held out is too short for a free run: no gap is measured.".to_owned(),
        );
    }
    if gap.after.is_nan() || gap.before.is_nan() {
        return None;
    }
    let what = "Free-run error on unseen data";
    let expected = match gap.expected.is_finite() {
        true => format!(
            "; the noise and the uncertain starts alone make {}{}",
            number(gap.expected),
            if may_stick {
                ", and more where friction sticks"
            } else {
                ""
            }
        ),
        false => String::new(),
    };
    Some(if gap.before.is_infinite() && gap.after.is_infinite() {
        "Free runs on unseen data diverge.".to_owned()
    } else if gap.before.is_infinite() {
        format!("Free runs on unseen data diverged; now their error is {after} {UNIT}{expected}.")
    } else if before == after {
        format!("{what} is {after} {UNIT}{expected}.")
    } else if gap.after < gap.before {
        format!("{what} falls from {before} to {after} {UNIT}{expected}.")
    } else {
        format!("{what} rises from {before} to {after} {UNIT}{expected}.")
    })
}

/// With a capital first letter.
pub fn capital(words: &str) -> String {
    let mut letters = words.chars();
    match letters.next() {
        Some(first) => first.to_uppercase().chain(letters).collect(),
        None => String::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_error_decides_the_last_digit_of_the_value() {
        assert_eq!(uncertain(0.3124, Some(0.0104)), "0.312 ± 0.010");
        assert_eq!(uncertain(0.3124, Some(0.00996)), "0.312 ± 0.010");
        assert_eq!(uncertain(1234.5, Some(56.0)), "1234 ± 56");
        assert_eq!(uncertain(2.51e-5, Some(3e-7)), "(2.510 ± 0.030)×10⁻⁵");
        assert_eq!(uncertain(1.0, Some(1e-12)), "1.00000 ± 0.00000");
        assert_eq!(uncertain(0.5, None), "0.500");
        assert_eq!(uncertain(0.5, Some(f64::NAN)), "0.500");
    }

    #[test]
    fn an_interval_has_as_many_digits_as_its_width_deserves() {
        assert_eq!(interval([0.2920, 0.3328], 0.0204), "0.292 to 0.333");
        assert_eq!(interval([-0.01, 0.03], 0.02), "-0.010 to 0.030");
        assert_eq!(interval([1e-7, 3e-7], 1e-7), "1.00×10⁻⁷ to 3.00×10⁻⁷");
        assert_eq!(interval([2.0, 2.0], 0.0), "2.00 to 2.00");
    }

    #[test]
    fn certainty_is_not_rounded_to_certain() {
        assert_eq!(percent(0.98), "98 %");
        assert_eq!(percent(0.999), "> 99 %");
        assert_eq!(percent(0.001), "< 1 %");
        assert_eq!(percent(0.0), "0 %");
    }

    #[test]
    fn names_lose_their_underscores_and_keep_their_capitals() {
        assert_eq!(
            plain("asymmetric_coulomb_friction"),
            "asymmetric Coulomb friction"
        );
        assert_eq!(plain("lugre_friction"), "LuGre friction");
    }
}
