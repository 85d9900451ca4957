//! The ranges that a URDF gives its joints. They are no forces: an `end_stop` is what stops a joint.

use lagrange::mechanism::{Joint, Limits};

use crate::entries::starts;
use crate::model::{EffectEntry, Model, Target};

/// By this part of its range a joint may leave it: what rounding does.
const GRACE: f64 = 1e-6;

/// A joint with a coordinate of its own, a range, and no effect that would stop it at its ends.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Unstopped<'a> {
    pub joint: &'a Joint,
    pub limits: Limits,
    /// Index of its coordinate.
    coordinate: usize,
}

/// Those of a model, in the order of its URDF. A range that is empty is none.
pub(crate) fn unstopped(model: &Model) -> Vec<Unstopped<'_>> {
    let joints = model.tree.iter().flat_map(|tree| tree.joints());
    let ranged = joints.filter(|joint| joint.is_independent() && joint.kind.is_single());
    let all = ranged.filter_map(|joint| {
        Some(Unstopped {
            joint,
            limits: joint.limits.filter(|l| l.lower < l.upper)?,
            coordinate: joint.coordinate?,
        })
    });
    all.filter(|unstopped| {
        let target = Target::Coordinate(unstopped.coordinate);
        let stops = |effect: &&EffectEntry| effect.kind.stop().is_some();
        let stops = model.effects.iter().filter(stops);
        !stops.map(|effect| effect.target).any(|of| of == target)
    })
    .collect()
}

/// What should be known of the motion `states`, one state (q, v, …) a sample, over the times `t` of `run`: that joints leave their ranges.
pub(crate) fn warning(model: &Model, run: &str, t: &[f64], states: &[Vec<f64>]) -> Option<String> {
    let coordinates = model.mechanics.coordinates();
    let starts: Vec<usize> = starts(coordinates).iter().map(|start| start.q).collect();
    let mut beyond = unstopped(model).into_iter().filter_map(|of| {
        let Limits { lower, upper, .. } = of.limits;
        let at = *starts.get(of.coordinate)?;
        let grace = match (upper - lower).is_finite() {
            true => GRACE * (upper - lower),
            false => GRACE,
        };
        let out = |q: f64| q < lower - grace || q > upper + grace;
        let samples = t.iter().zip(states);
        let mut positions = samples.filter_map(|(t, state)| Some((*t, *state.get(at)?)));
        let (time, q) = positions.find(|(_, q)| out(*q))?;
        Some((of, time, q))
    });
    let (of, time, q) = beyond.next()?;
    let unit = coordinates.get(of.coordinate).map_or("", |c| c.unit());
    let Limits { lower, upper, .. } = of.limits;
    let others = match beyond.count() {
        0 => String::new(),
        1 => ", and one more joint leaves its own".to_owned(),
        n => format!(", and {n} more joints leave theirs"),
    };
    Some(format!(
        "run `{run}`: joint `{}` is at {q:.4} {unit} at t = {time:.6} s, beyond its <limit> in the URDF, {lower} … {upper} {unit}{others}: limits do not stop \
         a motion; where they should, add an [[effect]] with kind = \"end_stop\", joint = \"{}\", lower, upper, stiffness and damping",
        of.joint.name, of.joint.name
    ))
}
