//! Dry friction, stops and impacts against motions that are known.

mod arguments;
mod both;
mod dry_friction;
mod laws;
mod stops;

use std::convert::Infallible;

use integrators::event::{
    ContactError, ContactSystem, Event, EventKind, EventRollOut, EventRollOutError, Law, Masses,
    roll_out_events,
};

/// States at `samples` + 1 equal times from 0 to `end`.
pub fn motion<S: ContactSystem<Input = ()>>(
    system: &S,
    laws: Vec<Law>,
    (end, samples, substeps): (f64, usize, usize),
    initial: &[f64],
) -> EventRollOut
where
    S::Error: std::fmt::Debug,
{
    let times: Vec<f64> = (0..=samples)
        .map(|k| end * k as f64 / samples as f64)
        .collect();
    roll_out_events(system, laws, &times, &vec![(); samples], substeps, initial).unwrap()
}

/// Masses m with the force f(t, q, v).
pub fn masses<const N: usize>(
    m: [f64; N],
    f: impl Fn(f64, &[f64], &[f64]) -> [f64; N] + Sync,
) -> impl ContactSystem<Input = (), Error = Infallible, Memory = ()> {
    Masses::new(N, move |t, (q, v), _u: &(), mass, force| {
        for i in 0..N {
            mass[(i, i)] = m[i];
        }
        force.copy_from_slice(&f(t, q, v));
        Ok(())
    })
}

pub fn kinds(events: &[Event], of: impl Fn(EventKind) -> bool) -> Vec<Event> {
    events.iter().copied().filter(|e| of(e.kind)).collect()
}

pub fn impacts(events: &[Event]) -> Vec<(f64, f64, f64)> {
    events
        .iter()
        .filter_map(|event| match event.kind {
            EventKind::Impact { before, after } => Some((event.time, before, after)),
            _ => None,
        })
        .collect()
}

/// Slope of the least-squares line through (a, b).
pub fn slope(points: &[(f64, f64)]) -> f64 {
    let n = points.len() as f64;
    let mean_a = points.iter().map(|p| p.0).sum::<f64>() / n;
    let mean_b = points.iter().map(|p| p.1).sum::<f64>() / n;
    let cov: f64 = points.iter().map(|p| (p.0 - mean_a) * (p.1 - mean_b)).sum();
    let var: f64 = points.iter().map(|p| (p.0 - mean_a).powi(2)).sum();
    cov / var
}

pub fn refusal<S: ContactSystem<Input = ()>>(
    system: &S,
    laws: Vec<Law>,
    initial: &[f64],
) -> ContactError<S::Error>
where
    S::Error: std::fmt::Debug,
{
    match roll_out_events(system, laws, &[0.0, 1.0], &[()], 10, initial).unwrap_err() {
        EventRollOutError::Contacts { source, .. } => source,
        other => panic!("{other:?}"),
    }
}
