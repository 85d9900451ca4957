//! What is late by the same time everywhere. A motion that all inputs reach T late and that is read at once,
//!
//! M v̇ + C v + G = Q(q, v, u(t − T)),  y(t) = q(t),
//!
//! is, on another clock, one that they reach at once and that is read T late: y(t) = q(t − T). No inputs and readings by one clock tell the two apart.

use super::candidate::Candidate;
use super::comparison::{Comparison, RELIEF, SURE};
use super::found::position;
use super::study::{Fitted, Study};
use crate::effect::{Kind, registry};

/// What is late: an input, or the reading of a coordinate.
pub const LATE: [&str; 2] = ["input_delay", "sensor_delay"];
/// Iterations of a fit with the inputs late in place of the readings, and how far it may fall behind, in standard errors: both are one equation, but that no
/// sample is lost to a late input.
const ITERATIONS: usize = 8;
const BEHIND: f64 = -2.0;

/// A kind on all that may be late.
fn everywhere(kind: &'static Kind, fitted: &Fitted) -> Vec<Candidate> {
    let targets = match kind.name == LATE[0] {
        true => fitted.hybrid.inputs(),
        false => fitted.hybrid.nv(),
    };
    let of = |target| Candidate { kind, target };
    (0..targets).map(of).collect()
}

/// By how much all is late that a kind may make so, s: within [`SURE`] standard errors by the same.
pub fn common_delay(kind: &'static Kind, fitted: &Fitted) -> Option<f64> {
    let fit = &fitted.inside;
    let errors = fit.standard_errors();
    let delay = |candidate: Candidate| {
        let at = fitted.hybrid.range(position(fitted, &candidate)?).start;
        let error = errors[fit.free.iter().position(|&free| free == at)?];
        // What the data do not determine agrees with nothing.
        (error > 0.0 && error.is_finite()).then_some((fit.theta[at], error))
    };
    let delays: Vec<(f64, f64)> = everywhere(kind, fitted)
        .into_iter()
        .map(delay)
        .collect::<Option<_>>()?;
    let weight = |error: f64| error.powi(2).recip();
    let weights: f64 = delays.iter().map(|(_, error)| weight(*error)).sum();
    let mean: f64 = delays
        .iter()
        .map(|(t, error)| t * weight(*error))
        .sum::<f64>()
        / weights;
    let agrees = |(t, error): &(f64, f64)| (t - mean).abs() <= SURE * error;
    (!delays.is_empty() && delays.iter().all(agrees)).then_some(mean)
}

/// Where the reading of every coordinate was found late by the same time, and there are no more inputs than coordinates: the model whose inputs are late
/// instead, and its names. They are what a controller can do something about, and of a single input one name for many.
pub fn of_the_inputs(
    study: &Study,
    current: &Fitted,
    added: &[Candidate],
) -> Option<(Fitted, Vec<Candidate>)> {
    let [pushed, read] = LATE.map(registry::find);
    let (pushed, read) = (pushed?, read?);
    let [inputs, readings] = [pushed, read].map(|kind| everywhere(kind, current));
    let is_found = |candidate: &Candidate| added.contains(candidate);
    let known = inputs.iter().any(|c| position(current, c).is_some());
    if inputs.is_empty()
        || inputs.len() > readings.len()
        || known
        || study.without.contains(&pushed)
        || !readings.iter().all(is_found)
    {
        return None;
    }
    let late = common_delay(read, current)?;
    let (mut hybrid, mut theta) = (current.hybrid.clone(), current.inside.theta.clone());
    for reading in &readings {
        let index = hybrid.effects().iter().position(|e| reading.is(e))?;
        theta.drain(hybrid.range(index));
        hybrid = hybrid.without(index);
    }
    for input in &inputs {
        (hybrid, theta) = input.place(&hybrid, &theta, &[late]);
    }
    let model = study.fit(hybrid, current.start(theta), 1, ITERATIONS);
    let as_well = Comparison::of(&model, current);
    let (z_in, z_out) = (as_well.inside.z, as_well.outside.z);
    let is_as_good = z_in > BEHIND && z_out > BEHIND && as_well.relief > -RELIEF;
    // An input that never moves is late by anything.
    let is_one = is_as_good && common_delay(pushed, &model).is_some();
    is_one.then(|| {
        let others = added.iter().filter(|c| !readings.contains(c)).copied();
        (model, inputs.into_iter().chain(others).collect())
    })
}

/// The other name of a candidate that is late as all others of its kind are, of which all were `added`, where every coordinate has one input. It goes with
/// the other names of the others, and alone is none.
pub fn on_another_clock(
    candidate: &Candidate,
    added: &[Candidate],
    model: &Fitted,
) -> Option<Candidate> {
    let hybrid = &model.hybrid;
    let [pushed, read] = LATE.map(registry::find);
    let (pushed, read) = (pushed?, read?);
    let on =
        |input: usize| (!hybrid.is_on_link(input)).then(|| hybrid.coordinate_of(pushed, input));
    let driven: Vec<Option<usize>> = (0..hybrid.inputs()).map(on).collect();
    let input_on = |c: usize| driven.iter().position(|on| *on == Some(c));
    let each_has_one =
        driven.len() == hybrid.nv() && (0..hybrid.nv()).all(|c| input_on(c).is_some());
    let (kind, target) = match candidate.kind == pushed {
        true => (read, driven.get(candidate.target).copied().flatten()?),
        false => (pushed, input_on(candidate.target)?),
    };
    // Beside some of both kinds, or some that are known, another clock leaves neither alone.
    let of_both = hybrid.effects().iter().any(|e| e.kind == kind && !e.fixed);
    let all = everywhere(candidate.kind, model);
    let are_found = all.iter().all(|c| added.contains(c));
    let late =
        each_has_one && !of_both && are_found && common_delay(candidate.kind, model).is_some();
    late.then_some(Candidate { kind, target })
}

#[cfg(test)]
mod tests {
    use super::super::pushes::tests::prepared;
    use super::super::setup::Prepared;
    use super::*;

    #[test]
    fn what_is_read_late_everywhere_is_told_of_the_inputs_beside_all_else_that_was_found() {
        let (_dir, Prepared { study, null, .. }) = prepared(0.0);
        let [pushed, read] = LATE.map(|name| Candidate::named(name, 0));
        let viscous = Candidate::named("viscous_friction", 0);
        let (hybrid, theta) = read.place(&null.hybrid, &null.inside.theta, &[0.01]);
        let (hybrid, theta) = viscous.place(&hybrid, &theta, &[0.0]);
        let late = study.fit(hybrid, null.start(theta), 1, 0);
        assert_eq!(common_delay(read.kind, &late), Some(0.01));
        assert_eq!(common_delay(pushed.kind, &late), None);
        assert!(of_the_inputs(&study, &late, &[viscous]).is_none());
        let Some((model, names)) = of_the_inputs(&study, &late, &[read, viscous]) else {
            unreachable!("one sledge that is read late is one that is pushed late")
        };
        assert_eq!(names, [pushed, viscous]);
        assert!(position(&model, &pushed).is_some() && position(&model, &read).is_none());
        assert_eq!(on_another_clock(&pushed, &names, &model), Some(read));
        assert_eq!(on_another_clock(&read, &[read], &late), Some(pushed));
        assert_eq!(on_another_clock(&read, &[], &late), None, "it was known");
    }
}
