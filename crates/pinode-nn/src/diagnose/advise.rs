//! What to do or to record next.

use lagrange::{Parameter, Role};

use super::at_rest::Unborne;
use super::audit::median;
use super::candidate::Candidate;
use super::elsewhere::Elsewhere;
use super::experiment::{CLOSE, Outcome, Split, short};
use super::found::{Found, position};
use super::misfit::{is_unexplained, strays};
use super::released::Instead;
use super::search::Search;
use super::study::Study;
use super::unseen_spring::UnseenSpring;
use super::valley::Swing;
use super::verdict::{
    Change, EVEN, FittedConstant, Gap, InputExcitation, Moved, Name, NamedEffect, Numerics,
    ParameterValue, Unexplained, Verdict,
};
use super::width::soft;
use crate::digits::{number, uncertain};
use crate::effect::Between;
use crate::hybrid::{Hybrid, Placed};
use crate::model::{Input, Model};
use crate::naming::{quoted, with_article};

/// A name with less confidence is in doubt.
pub const IN_DOUBT: f64 = 0.9;
/// Changes of an input from sample to sample that differ by less than this part of themselves are those of a smooth one.
const SMOOTH: f64 = 0.3;
/// Delays below this are not told from a lag, s at the usual pace.
const SHORT_DELAY: f64 = 5e-3;

/// Advice on ties, weak findings, what is left unexplained, and friction that is smoothed too much.
pub fn advise(
    study: &Study,
    search: &Search,
    effects: &[NamedEffect],
    splits: &[Split],
    verdict: Verdict,
    unexplained: Option<&Unexplained>,
    numerics: &Numerics,
) -> Vec<String> {
    let mut advice = Vec::new();
    // What is told of is in the model.
    let stays = |found: &&Found| position(&search.model, &found.candidate).is_some();
    for (effect, found) in effects.iter().zip(search.found.iter().filter(stays)) {
        let own = format!("{} on `{}`", spoken(&effect.kind), effect.target);
        let rivals = || {
            let is_own = |s: &&Split| {
                let own = s.own.kind == effect.kind && s.own.target == effect.target;
                own && effect.confidence >= EVEN
            };
            splits.iter().filter(is_own)
        };
        advice.extend(rivals().map(|split| telling_apart(&own, split)));
        let other = found.instead.filter(|other| other.confidence > CLOSE);
        let told = effect.confidence + other.map_or(0.0, |other| other.confidence);
        advice.extend(other.map(|other| constant_instead(&own, &other, &search.model.hybrid)));
        if told < IN_DOUBT && rivals().next().is_none() && search.left.is_none() {
            advice.push(format!(
                "{own} is the best of several names (confidence {:.2}): record a longer log with a wider range of speeds and inputs.",
                effect.confidence
            ));
        }
        let gain = effect.parameters.get("gain").map(|g| g.value);
        if effect.kind == "input_gain_error" && gain.is_some_and(|g| g < -1.0) {
            advice.push(format!(
                "`{}` acts the other way round than the model has it: is its sign, or that of the coordinates it moves, reversed in the log?",
                effect.target
            ));
        }
        advice.extend(where_it_is(effect, &search.model.hybrid));
        advice.extend(ways(effect).map(|ways| one_sided(&own, ways)));
        let delay = effect.parameters.get("delay").map(|d| d.value);
        let is_lag_out = || effect.kind == "input_delay" && beats(search, found, "actuator_lag");
        if delay.is_some_and(|d| d < study.pace.long(SHORT_DELAY)) && !is_lag_out() {
            advice.push(format!(
                "a delay of {} ms is not told from a lag: record sharp steps of the input.",
                number(1e3 * delay.unwrap_or(0.0))
            ));
        }
    }
    if let Some(left) = &search.left {
        let coordinates = search.model.hybrid.mechanics().coordinates();
        let joint = &coordinates[left.coordinate].name;
        let learnt = unexplained.is_some_and(|u| u.learnt.is_some());
        let therefore = match (learnt, effects.is_empty()) {
            (true, true) => {
                "a law is missing that the library has not. The network in the model has learnt it: see what it is like"
            }
            (true, false) => {
                "a law is missing that the library has not, for part of which what was found may stand in. The network in the model has \
                 learnt the rest of it: see what it is like"
            }
            (false, true) => "something is missing that no effect explains",
            (false, false) => {
                "something is missing that no accepted effect explains, and what was found may stand in for it"
            }
        };
        advice.push(format!(
            "what is left on `{joint}` follows {}: {therefore}.",
            left.words(search.model.hybrid.mechanics().coordinates())
        ));
    } else if verdict != Verdict::NothingMissing && is_unexplained(study, search.whole()) {
        let coordinates = search.model.hybrid.mechanics().coordinates();
        let excess = search.whole().excess(&study.observations);
        let strays = strays(study, search.whole());
        let channels = study.observations.channels.iter().enumerate();
        let sizes = channels.filter(|(_, channel)| !channel.velocity);
        let sizes = sizes.map(|(c, channel)| {
            let name = &coordinates[channel.coordinate].name;
            let far = match strays[c] > 0.0 {
                true => format!(
                    ", far more in {:.0} % of the windows",
                    (100.0 * strays[c]).ceil()
                ),
                false => String::new(),
            };
            format!("{:.1} times on `{name}`{far}", excess[c])
        });
        let sizes: Vec<String> = sizes.collect();
        advice.push(format!(
            "what is left is larger than the sensor noise ({}), and {}.",
            sizes.join("; "),
            match unexplained.and_then(|u| u.learnt.as_ref()) {
                Some(_) => "a network that was taught it does better on unseen data: a law is missing that the library has not, see what it is like",
                None => "no law of one or two of the signals that were measured explains it: pushes from outside, something that was not measured, or a law of more of them, which `pinode train` may learn",
            }
        ));
    }
    let hybrid = &search.model.hybrid;
    // What a model file says of its smoothing is its author's.
    let soft: Vec<&Placed> = match study.may_sharpen {
        true => soft(hybrid).collect(),
        false => Vec::new(),
    };
    advice.extend(soft.iter().map(|placed| does_not_stick(placed, hybrid)));
    // Where some of it does not stick, what all of it would do if it did says nothing.
    let sticking = numerics.set_valued.iter().flat_map(|s| s.visible());
    for moved in sticking.filter(|_| soft.is_empty()) {
        let from = moved.starts.map_or(String::new(), |start| {
            format!(", first at t = {:.2} s", start.t)
        });
        advice.push(format!(
            "friction that sticks would move `{}` by {:.1} times the sensor noise (root mean square over windows of the log{from}) from \
             where the smoothed friction of the model has it: give its dry friction a lower `smoothing`, and compare with `pinode \
             simulate --method contacts`.",
            moved.name, moved.rms
        ));
    }
    advice
}

/// Where a payload or a centre of mass is, m.
fn where_it_is(effect: &NamedEffect, hybrid: &Hybrid) -> Option<String> {
    let place = effect.parameters.get("place")?;
    let link = hybrid
        .links()
        .iter()
        .position(|link| link.name == effect.target)?;
    let way = hybrid.way_to_centre(link)?;
    let there = uncertain(way * place.value, place.std.map(|std| way * std));
    let (on, way) = (&effect.target, number(way));
    Some(match effect.kind.as_str() {
        "centre_of_mass" => format!(
            "the centre of mass of `{on}` is {there} m from the joint of that body, not {way} m as the model has it; beside that line it may be off as well."
        ),
        _ => format!(
            "the payload on `{on}` is {there} m from the joint of that body, on the line through the centre of mass, which is {way} m from there."
        ),
    })
}

/// That friction which was found holds no joint at rest.
fn does_not_stick(placed: &Placed, hybrid: &Hybrid) -> String {
    let coordinate = &hybrid.mechanics().coordinates()[placed.target];
    format!(
        "the {} on `{}` does not hold it at rest: its sign is spread over {} {}/s, as of friction that a fluid film carries at low speed, or of a \
         simulation that has tanh(v/v₀) for it; the `smoothing` in model.toml is no numerical one.",
        spoken(placed.kind.name),
        coordinate.name,
        number(placed.smoothing),
        coordinate.unit(),
    )
}

/// The two ways of friction that differs by them, F₊ and F₋, where it has no constant force as another name because the model has friction of its own.
fn ways(effect: &NamedEffect) -> Option<[&ParameterValue; 2]> {
    let said = |twin: &Name| twin.kind == "constant_force";
    let is_asked = effect.kind == "asymmetric_coulomb_friction"
        && !effect.indistinguishable_from.iter().any(said);
    let way = |name| effect.parameters.get(name).filter(|_| is_asked);
    Some([way("force_positive")?, way("force_negative")?])
}

/// What such friction is as well: F₊ for v > 0 and F₋ for v < 0 are ½(F₊ + F₋) both ways beside a constant force of ½(F₋ − F₊).
fn one_sided(own: &str, [forth, back]: [&ParameterValue; 2]) -> String {
    format!(
        "{own} is the same as Coulomb friction of {} {unit} both ways beside a constant force of {} {unit}, moving or at rest: look for an offset of the input or \
         a base that is not level before you look for friction.",
        number(0.5 * (forth.value + back.value)),
        number(0.5 * (back.value - forth.value)),
        unit = forth.unit
    )
}

/// Whether what was found was refined beside another kind on its target, which never did better.
fn beats(search: &Search, found: &Found, kind: &str) -> bool {
    let is_other = |c: &Candidate| c.kind.name == kind && c.target == found.candidate.target;
    let open = found.alternatives.iter().map(|(c, _)| c);
    if open.chain(&found.indistinguishable).any(is_other) {
        return false;
    }
    let refined = search.steps.iter().filter_map(|step| {
        let of = |is: &dyn Fn(&Candidate) -> bool| {
            step.contenders.iter().find(|c| match c.added[..] {
                [only] => is(&only),
                _ => false,
            })
        };
        Some((of(&|c| *c == found.candidate)?, of(&is_other)?))
    });
    let mut refined = refined.peekable();
    refined.peek().is_some() && refined.all(|(own, other)| own.wins > 0.0 && other.wins == 0.0)
}

/// What else a name may be: a constant of the mechanism.
fn constant_instead(own: &str, other: &Instead, hybrid: &Hybrid) -> String {
    let [given, instead] = other.values;
    format!(
        "{own} may be {} instead, {} in place of {} (confidence {:.2}): the motion hardly tells them apart. Measure one of the two by itself.",
        with_article(&hybrid.describe(other.index, &[])),
        number(instead),
        number(given),
        other.confidence
    )
}

/// What to do about a constant that was not found missing and yet has left what the model gives.
pub fn moved(constant: &FittedConstant) -> Option<String> {
    let moved = constant.moved()?;
    let went = format!(
        "{} went from {} to {}",
        constant.spoken(),
        number(constant.given),
        uncertain(constant.fitted, constant.std)
    );
    Some(match moved {
        Moved::Stretched => format!(
            "{went}, {} times its tolerance of {}: measure it, or say in `[tolerance]` what is possible.",
            short(constant.tolerances().abs()),
            short(constant.tolerance),
        ),
        Moved::Unsaid => format!(
            "{went}, of which the model does not say how well it is known: measure it, or say so under `[tolerance]`, in `parameters`; 0 is exact."
        ),
        Moved::Within => format!(
            "{went}, {} times its tolerance of {}: the data know it better than the model does.",
            short(constant.tolerances().abs()),
            short(constant.tolerance),
        ),
        Moved::Free => format!(
            "{went}: the model gives it without `fixed = true`, so that it was free to move. Where it is known, fix it: what it then no \
             longer stands in for may be something else that is missing."
        ),
        Moved::Undetermined => {
            format!("{went}, and these data do not determine it: keep the value that was given.")
        }
    })
}

/// What to ask about inputs that are taken to stay as they are between samples and look as if they did not, where something is left.
pub fn smooth_inputs(study: &Study, inputs: &[Input]) -> Vec<String> {
    let looks_smooth = |(i, input): &(usize, &Input)| {
        let mut runs = study.observations.runs.iter();
        input.between == Between::Held && runs.all(|run| is_smooth(&run.u[*i]))
    };
    let smooth = inputs.iter().enumerate().filter(looks_smooth);
    let advice = smooth.map(|(_, input)| {
        format!(
            "input `{0}` is taken to stay as it is between two samples, and its samples look like those of something smooth: if it was measured, and not set \
             anew at each of them, write `between_samples = \"smooth\"` under `[[input]]` of `{0}` and diagnose again.",
            input.name
        )
    });
    advice.collect()
}

/// What to ask about the constants of energies that are written down, where none of them has a tolerance and something is left or in doubt.
pub fn exact_constants(model: &Model) -> Option<String> {
    const LISTED: usize = 4;
    let named = |p: &&Parameter| p.role == Role::Constant;
    let parameters = model.mechanics.parameters();
    let names: Vec<&str> = parameters
        .iter()
        .filter(named)
        .map(|p| p.name.as_str())
        .collect();
    let has_tolerance = model.tolerance.parameters.iter().any(|(_, t)| *t > 0.0);
    let first = names.first().filter(|_| !has_tolerance)?;
    let more = match names.len() > LISTED {
        true => ", …",
        false => "",
    };
    Some(format!(
        "the constants {}{more} of `[lagrangian.parameters]` are taken to be exact, and what one of them is off by is named as something else: where one is known to \
         two percent, write `parameters = {{ {} = 0.02 }}` under `[tolerance]` and diagnose again.",
        names
            .iter()
            .take(LISTED)
            .map(|n| quoted(n))
            .collect::<Vec<_>>()
            .join(", "),
        first
    ))
}

/// What to ask about inputs that have one value in all samples, where something is left.
pub fn silent_inputs(inputs: &[InputExcitation]) -> Vec<String> {
    let silent = inputs
        .iter()
        .filter(|input| input.range[0] == input.range[1]);
    let advice = silent.map(|input| {
        format!(
            "input `{}` is {} in every sample: if it was driven, its column is another one, and what is named or left here stands in for that.",
            input.name, input.range[0]
        )
    });
    advice.collect()
}

/// Whether samples of an input lie on a smooth curve: they change all the time, and the next change is nearly the last one.
fn is_smooth(u: &[f64]) -> bool {
    let changes: Vec<f64> = u.windows(2).map(|p| p[1] - p[0]).collect();
    let mut turns: Vec<f64> = changes.windows(2).map(|p| (p[1] - p[0]).abs()).collect();
    let mut sizes: Vec<f64> = changes.iter().map(|d| d.abs()).collect();
    let moving = sizes.iter().filter(|d| **d > 0.0).count();
    10 * moving > 9 * sizes.len() && median(&mut turns) < SMOOTH * median(&mut sizes)
}

/// What to ask where free runs over the unseen part contradict what the seen one bears out.
pub fn contradicted(gap: &Gap) -> String {
    format!(
        "free runs over data that no fit has seen err by {} times the sensor noise, by {} with the constants as given: what is missing \
         shows there or builds up over a run. Ask what differs between the parts of the log (a slipped encoder, another load, something \
         that warmed up), and compare logs of different days with `--holdout`.",
        short(gap.after),
        short(gap.before)
    )
}

/// What to do about a constant that is none.
pub fn changing(change: &Change, runs: &[String]) -> String {
    let of_run = match runs {
        [_] | [] => String::new(),
        _ => runs
            .get(change.run)
            .map_or(String::new(), |run| format!(" of {run}")),
    };
    format!(
        "the {} is not one number over the log: about {} until t = {:.1} s{of_run} and {} after it. What changes with time is no constant: fit \
         the parts by themselves, or log what it depends on (temperature, load, voltage).",
        change.name,
        number(change.before),
        change.t,
        number(change.after),
    )
}

/// A spring by which the motor whose inertia was found may drive its joint and not show; what would show it.
pub fn unseen_spring(spring: &UnseenSpring, hybrid: &Hybrid, inputs: &[Input]) -> Option<String> {
    let Candidate { kind, target } = spring.candidate;
    let input = &inputs.get(target)?.name;
    let coordinates = hybrid.mechanics().coordinates();
    let joint = coordinates.get(hybrid.coordinate_of(kind, target))?;
    let unit = match joint.angular {
        true => "N·m/rad",
        false => "N/m",
    };
    Some(format!(
        "the inertia found on `{}` may be that of the motor of `{input}` behind an elastic transmission: a spring of {} {unit} does as well in these \
         data; sharp steps of the input, sampled faster than the motor swings on its spring, would show it.",
        joint.name,
        number(spring.stiffness)
    ))
}

/// What a drive shows whose motor does not.
pub fn swings(swing: &Swing, drive: &Candidate, inputs: &[Input]) -> Option<String> {
    let input = &inputs.get(drive.target)?.name;
    let (frequency, error) = swing.frequency;
    Some(format!(
        "these data show what the drive of `{input}` swings like, {} Hz with {} % of the critical damping, and little of its motor: another one with another \
         spring, and with the same frequency, does nearly the same. A sensor on the motor tells them apart.",
        uncertain(frequency, Some(error)),
        number(100.0 * swing.damping)
    ))
}

/// What to ask where the unseen part contradicts a name.
pub fn elsewhere(elsewhere: &Elsewhere, name: &Name, hybrid: &Hybrid) -> String {
    let Elsewhere {
        candidate,
        parameter,
        seen,
        held_out,
    } = elsewhere;
    let angular = hybrid.is_angular(candidate.kind, candidate.target);
    let unit = match parameter.quantity.unit(angular) {
        "1" => String::new(),
        unit => format!(" {unit}"),
    };
    let value = |(value, error): (f64, f64)| format!("{}{unit}", uncertain(value, Some(error)));
    format!(
        "{} on `{}` explains what the seen windows lack, with `{}` = {}, and the part held out contradicts it: there it is {}. Ask what was \
         changed between them, and diagnose each by itself.",
        spoken(&name.kind),
        name.target,
        parameter.name,
        value(*seen),
        value(*held_out)
    )
}

/// What to record where the unseen part does not move what a name is about.
pub fn at_rest(unborne: &Unborne, name: &Name, hybrid: &Hybrid) -> String {
    let Unborne {
        candidate,
        of_input,
        z,
        moves: [seen, held_out],
    } = unborne;
    let c = hybrid.coordinate_of(candidate.kind, candidate.target);
    let coordinate = &hybrid.mechanics().coordinates()[c];
    let signal = match of_input {
        true => format!(
            "`{}` has {} of its {}",
            name.target,
            number(*held_out),
            number(*seen)
        ),
        false => format!(
            "`{}` moves at {} of its {} {}/s",
            coordinate.name,
            number(*held_out),
            number(*seen),
            coordinate.unit()
        ),
    };
    format!(
        "{} on `{}` explains what the seen windows lack ({z:.1} standard errors), and the part held out, in which {signal} (root mean square), neither bears it \
         out nor contradicts it: hold out another log with `--holdout`, or record one that moves to its end.",
        spoken(&name.kind),
        name.target,
    )
}

/// What tells a found effect from a rival.
fn telling_apart(own: &str, split: &Split) -> String {
    let rival = format!(
        "{} on `{}`",
        spoken(&split.against.kind),
        split.against.target
    );
    let tie = match split.confidence {
        None => format!("{own} and {rival} cannot be told apart here"),
        Some(confidence) => format!("{own} could still be {rival} (confidence {confidence:.2})"),
    };
    match &split.outcome {
        Outcome::Splits(experiments) => match experiments.first() {
            Some(best) => {
                let (coordinate, times) = best.largest();
                format!(
                    "{tie}: record {}. From rest, the two would differ by {} times the noise on `{coordinate}` (root mean square; no \
                     values of their constants within three standard errors of this log bring them closer).",
                    best.sentence,
                    short(times)
                )
            }
            None => format!("{tie}."),
        },
        Outcome::OneEffect => format!(
            "{tie}: no experiment of the menu splits them within the logged inputs and reach; there they are one effect for this mechanism."
        ),
        Outcome::NotSimulated => {
            format!(
                "{tie}: {}.",
                experiment(&split.own.kind, &split.against.kind)
            )
        }
    }
}

/// The experiment that splits two names, where none can be simulated.
fn experiment(a: &str, b: &str) -> &'static str {
    let is = |x: &str| a == x || b == x;
    if is("constant_force") && is("asymmetric_coulomb_friction") {
        "turn the rig or its rail by 180° (a constant force changes sign, friction does not)"
    } else if is("input_offset") {
        "switch the input off, or take its plug out: what pushes from elsewhere stays, an offset of the input does not"
    } else if is("input_gain_error") {
        "let it move without input: the gain then has no part in it"
    } else if is("quadratic_drag")
        || is("viscous_friction")
        || is("stribeck_friction")
        || is("coulomb_friction")
    {
        "drive it slowly and fast, each both ways, so that the speeds span a range of at least 1 : 10"
    } else if is("linear_spring") || is("cubic_spring") || is("constant_force") {
        "move slowly through the whole range of positions, both ways"
    } else if is("input_delay") && is("sensor_delay") {
        "let it go by hand at a time that its clock knows: what no input makes is late only where it is read"
    } else if is("input_delay") {
        "record sharp steps of the input"
    } else {
        "record a longer log with a wider range of speeds, positions and inputs"
    }
}

/// A kind's name as people say it.
pub fn spoken(kind: &str) -> String {
    kind.replace('_', " ")
        .replace("coulomb", "Coulomb")
        .replace("stribeck", "Stribeck")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_constant_that_changes_between_two_recordings_names_the_one_in_which_it_does() {
        let change = Change {
            name: "force of coulomb_friction on `x`".into(),
            statistic: 2.0,
            run: 1,
            t: 30.0,
            before: 0.2,
            after: 0.4,
        };
        let logs = ["`a.csv`", "`b.csv`"].map(str::to_owned);
        assert!(changing(&change, &logs).contains("until t = 30.0 s of `b.csv`"));
        assert!(changing(&change, &logs[..1]).contains("until t = 30.0 s and"));
    }

    /// Q = −3 N forth and 1 N back is ∓2 N and −1 N both ways.
    #[test]
    fn friction_that_differs_each_way_is_friction_beside_a_constant_force() {
        let [forth, back] = [3.0, 1.0].map(|value| ParameterValue {
            value,
            std: None,
            unit: "N".into(),
        });
        let said = one_sided("friction", [&forth, &back]);
        assert!(said.contains("Coulomb friction of 2.00 N"), "{said}");
        assert!(said.contains("constant force of -1.00 N"), "{said}");
    }

    #[test]
    fn constants_of_energies_are_exact_until_one_has_a_tolerance() {
        let asked = |more: &str| {
            let text = format!(
                "lagrangian = {{ coordinates = [\"x\"], kinetic = \"0.5*m*x_dot^2\", potential = \"0.5*k*x^2\", parameters = {{ m = 2.0, k = 5.0 }} }}\n{more}"
            );
            let model = Model::parse("m.toml".as_ref(), text);
            model.ok().and_then(|model| exact_constants(&model))
        };
        let said = asked("").unwrap_or_default();
        assert!(said.starts_with("the constants `m`, `k` of"), "{said}");
        assert!(said.contains("`parameters = { m = 0.02 }`"), "{said}");
        assert_eq!(asked("[tolerance]\nparameters = { k = 0.1 }\n"), None);
    }

    #[test]
    fn an_input_that_never_changes_is_asked_about() {
        let input = |low: f64, high: f64| InputExcitation {
            name: "motor".into(),
            range: [low, high],
            zero_share: 0.0,
        };
        let [told] = &silent_inputs(&[input(-1.0, 2.0), input(0.0, 0.0)])[..] else {
            unreachable!("one of them is silent")
        };
        assert!(
            told.starts_with("input `motor` is 0 in every sample"),
            "{told}"
        );
    }

    #[test]
    fn a_sine_is_smooth_and_steps_noise_and_a_coarse_staircase_are_not() {
        let samples = |u: &dyn Fn(usize) -> f64| (0..2000).map(u).collect::<Vec<_>>();
        let sine = |k: usize| (0.1 * k as f64).sin() + 0.5 * (0.03 * k as f64).sin();
        assert!(is_smooth(&samples(&sine)));
        assert!(!is_smooth(&samples(&|k| sine(k / 10 * 10))));
        assert!(!is_smooth(&samples(&|k| crate::bins::pseudo(k, 0.2))));
        assert!(!is_smooth(&samples(
            &|k| sine(k) + 0.2 * crate::bins::pseudo(k, 0.2)
        )));
        assert!(!is_smooth(&samples(&|k| (2.0 * sine(k)).round())));
    }
}
