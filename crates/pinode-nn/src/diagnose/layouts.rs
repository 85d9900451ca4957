//! Where the motor of a drive counts, and where its joint is read.
//!
//! No log says whether the model's masses have the motor's inertia, nor whether the joint's sensor is on the load or on the motor. A screen sees drives as they are named: the sensor on
//! the load, an elastic drive's motor on top. The other layouts are the same law with a yes in place of a no ([`Motor`]); they are asked by fits, where a drive was accepted that leaves
//! something or strains what is known, and where what is left on a driven coordinate is beyond doubt.

use super::candidate::Candidate;
use super::comparison::{Comparison, RELIEF};
use super::found::{SAME, position, stripped};
use super::refine::{Contender, ITERATIONS, SHARE, best, best_of_starts, contender, is_sensible};
use super::step::Report;
use super::study::{Fitted, Study};
use super::unstretched::unstrained;
use super::valley::{along_the_valley, laid_out, swinging};
use crate::effect::{Inertial, LeftOut, Motor};
use crate::hybrid::Hybrid;

/// Fits start from motors of these shares of what their joint moves.
const MOTORS: [f64; 4] = [0.08, 0.2, 0.4, 0.65];
/// Another layout than the one that is named explains the seen windows, and those held out, by so many standard errors.
const SURE: (f64, f64) = (4.0, 2.0);
/// So many layouts that explain most of some windows are fitted to all.
const LAYOUTS: usize = 2;
/// Iterations of the initial states before those of all: what they were before belongs to another layout.
const STATES_ALONE: usize = 30;
/// At most so many inputs are asked, those of the loudest coordinates.
const INPUTS: usize = 2;
/// A coordinate is loud enough to be asked where its residuals are so many times the noise: where nothing was found, and beside what was.
const LOUD: (f64, f64) = (1.05, 2.5);
/// A motor of less than this share of what its joint moves is little beside what is known of masses.
const LITTLE: f64 = 0.1;
/// A motor on top of the mechanism that is so many times its standard error shows.
const SHOWN: f64 = 2.0;

/// Where the motor counts in a layout that is taken where another does as well; the joint's sensor is on the load.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Usual {
    OnTop,
    Within,
}

impl Usual {
    fn is(self, motor: Motor, p: &[f64]) -> bool {
        let within = motor.within.is_some_and(|flag| p[flag] != 0.0);
        within == (self == Usual::Within)
    }
}

/// The constants of a drive in a fitted model.
fn constants_of<'a>(fitted: &'a Fitted, drive: &Candidate) -> Option<&'a [f64]> {
    let index = position(fitted, drive)?;
    fitted.inside.theta.get(fitted.hybrid.range(index))
}

/// The values of the flags of a motor, one set a layout; the first is the one that is named.
fn layouts(motor: Motor) -> Vec<Vec<(usize, f64)>> {
    let withins = motor.within.map_or(&[0.0][..], |_| &[0.0, 1.0]);
    let all = [0.0, 1.0].into_iter().flat_map(|read| {
        withins.iter().map(move |&within| {
            let within = motor.within.map(|flag| (flag, within));
            [(motor.read, read)].into_iter().chain(within).collect()
        })
    });
    all.collect()
}

fn is_sure(lead: &Comparison) -> bool {
    lead.inside.z > SURE.0 && lead.outside.z > SURE.1
}

/// The best fit of `candidate` beside `current`, over its layouts, from where it swings as at each of `from` and nothing is strained. What the `usual` one does as well is laid out so.
fn best_layout(
    study: &Study,
    (current, hybrid, theta): (&Fitted, &Hybrid, &[f64]),
    candidate: Candidate,
    from: &[Vec<f64>],
    usual: Usual,
) -> Option<Fitted> {
    let (kind, motor) = (candidate.kind, candidate.kind.motor()?);
    let mass = candidate.scales(hybrid, &study.scales).free_mass;
    let theta: &[f64] = &unstrained(hybrid, theta);
    let (some, there) = study.some_windows(current, SHARE);
    let coordinate = hybrid.coordinate_of(kind, candidate.target);
    let may_be_read = !hybrid.is_read_on_motor(coordinate, theta);
    let may_be_within = hybrid.may_change(Inertial::Motor, coordinate);
    let is_possible = |layout: &Vec<(usize, f64)>| {
        layout.iter().all(|&(flag, yes)| match flag == motor.read {
            _ if yes == 0.0 => true,
            true => may_be_read,
            false => may_be_within,
        })
    };
    let tried = layouts(motor).into_iter().filter(is_possible);
    let tried = tried.filter_map(|layout| {
        let of_all_sizes = |p: &Vec<f64>| -> Vec<Vec<f64>> {
            let sized = MOTORS.iter();
            let sized =
                sized.filter_map(|share| swinging((kind, motor), (p, mass), share * mass, &layout));
            let sized: Vec<Vec<f64>> = sized.collect();
            match sized.is_empty() {
                true => vec![laid_out(p, &layout)],
                false => sized,
            }
        };
        let starts: Vec<Vec<f64>> = from.iter().flat_map(of_all_sizes).collect();
        best_of_starts(&some, (&there, hybrid, theta), candidate, &starts)
    });
    let mut tried: Vec<Fitted> = tried.collect();
    tried.sort_by(|a, b| b.score(0).total_cmp(&a.score(0)));
    let fits = tried.into_iter().take(LAYOUTS).map(|tried| {
        let start = current.start(tried.inside.theta);
        study.fit(tried.hybrid, start, STATES_ALONE, ITERATIONS)
    });
    let fits = fits.filter(|fit| is_sensible(study, &candidate, fit));
    let fits: Vec<Fitted> = fits.collect();
    let named = fits.iter().find(|fit| {
        let own = constants_of(fit, &candidate);
        own.is_some_and(|p| !motor.is_read(p) && usual.is(motor, p))
    });
    let named = named.cloned();
    let best = best(fits)?;
    let best = match named {
        Some(named) if !is_sure(&Comparison::of(&best, &named)) => named,
        _ => best,
    };
    match Comparison::of(&best, current).total() > SAME {
        true => Some(along_the_valley(study, best, &candidate)),
        false => Some(best),
    }
}

/// Whether a drive of this model has a motor on top of the mechanism that is no larger than what is not known of its mass: then it may as well be within.
fn may_be_within(study: &Study, model: &Fitted, drive: &Candidate) -> bool {
    let placed = drive.kind.motor().zip(constants_of(model, drive));
    placed.is_some_and(|(motor, p)| {
        let mass = drive.scales(&model.hybrid, &study.scales).free_mass;
        motor.inertia_within(p).is_none() && p[motor.inertia] < LITTLE * mass
    })
}

/// Whether the data show that the mechanism has the inertia of this drive's motor on top of its own.
fn shows_on_top(study: &Study, model: &Fitted, drive: &Candidate) -> bool {
    let placed = drive.kind.motor().zip(position(model, drive));
    placed.is_none_or(|(motor, index)| {
        let i = model.hybrid.range(index).start + motor.inertia;
        let error = model.standard_error(study, i);
        error.is_none_or(|error| model.inside.theta[i] > SHOWN * error)
    })
}

/// The model with the drive that was `accepted` laid out in another way, where that explains more; or as much, of a motor on top that does not show. `base` is the model that the
/// search began with.
pub fn laid_out_otherwise(
    study: &Study,
    base: &Fitted,
    model: &Fitted,
    accepted: &Candidate,
) -> Option<Fitted> {
    let motor = accepted.kind.motor()?;
    let index = position(model, accepted)?;
    let is_wanting = model.most_excess(study) > LOUD.1 || model.inside.stretch > RELIEF;
    let may_be_within = may_be_within(study, model, accepted);
    if !is_wanting && !may_be_within {
        return None;
    }
    let mut own = model.inside.theta[model.hybrid.range(index)].to_vec();
    // What fits leave alone is for another layout to ask again.
    for (p, spec) in own.iter_mut().zip(accepted.kind.parameters) {
        if let Some(LeftOut::Value(usual)) = spec.default.filter(|_| spec.held) {
            *p = usual;
        }
    }
    let usual = match may_be_within && !shows_on_top(study, model, accepted) {
        true => Usual::Within,
        false => Usual::OnTop,
    };
    let (hybrid, theta) = stripped(base, model, index);
    let other = best_layout(study, (model, &hybrid, &theta), *accepted, &[own], usual)?;
    let lead = Comparison::of(&other, model);
    let are_read_alike = |p: &[f64], own: &[f64]| motor.is_read(p) == motor.is_read(own);
    let is_usual = usual == Usual::Within
        && constants_of(&other, accepted)
            .zip(constants_of(model, accepted))
            .is_some_and(|(p, own)| usual.is(motor, p) && are_read_alike(p, own));
    let leads = is_sure(&lead) && lead.total() > SAME;
    (leads || is_usual && lead.total() > -SAME).then_some(other)
}

/// Drives beside `current` on the inputs of coordinates on which `left`, the model with what was found, leaves something beyond doubt; in layouts that no screen has seen.
pub fn drives(
    study: &Study,
    current: &Fitted,
    left: Option<&Fitted>,
    report: Report,
) -> Vec<Contender> {
    let hybrid = &current.hybrid;
    let leaving = left.unwrap_or(current);
    // What is loud alone may be the noise.
    if leaving.left(study).is_none() && leaving.most_excess(study) < LOUD.1 {
        return Vec::new();
    }
    let least = left.map_or(LOUD.0, |_| LOUD.1);
    let excess = leaving.excess(&study.observations);
    let channels = study.observations.channels.iter().zip(&excess);
    let loudness = |c: usize| {
        let own = channels
            .clone()
            .filter(|(channel, _)| channel.coordinate == c);
        own.map(|(_, excess)| *excess).fold(0.0, f64::max)
    };
    let mut asked: Vec<(f64, Candidate)> = Candidate::all(hybrid)
        .into_iter()
        .filter(|c| c.kind.motor().is_some() && !study.without.contains(&c.kind))
        .map(|c| (loudness(hybrid.coordinate_of(c.kind, c.target)), c))
        .filter(|(loud, _)| *loud > least)
        .collect();
    asked.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.target.cmp(&b.1.target)));
    let mut inputs: Vec<usize> = asked.iter().map(|(_, c)| c.target).collect();
    inputs.dedup();
    inputs.truncate(INPUTS);
    let asked = asked.into_iter().map(|(_, c)| c);
    let fitted = asked
        .filter(|c| inputs.contains(&c.target))
        .filter_map(|c| {
            report(&format!("refining {} read on the motor", c.kind.name));
            let theta = &current.inside.theta;
            let probes = (c.kind.probes)(&c.scales(hybrid, &study.scales), &[]).into_iter();
            let probes: Vec<Vec<f64>> = probes.map(|probe| probe.perturbed).collect();
            let fitted = best_layout(study, (current, hybrid, theta), c, &probes, Usual::OnTop)?;
            Some(contender(study, vec![c], fitted, current))
        });
    fitted.collect()
}
