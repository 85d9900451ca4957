//! What some samples ago means: another time in a log of another rate.

use super::Quantity;
use crate::log::{Run, same_rate, typical_interval};
use crate::model::{Model, NetworkEntry};

/// What should be known of networks that see what was some samples ago, where samples are apart otherwise than in their training.
pub(crate) fn other_intervals(model: &Model, runs: &[&Run]) -> Vec<String> {
    let tables = model.networks.chunk_by(|a, b| a.table == b.table);
    let networks = tables.filter_map(|table| table.first());
    networks
        .filter_map(|network| other_interval(model, network, runs))
        .collect()
}

fn other_interval(model: &Model, network: &NetworkEntry, runs: &[&Run]) -> Option<String> {
    let trained = network.card.interval?;
    let features = network.force.features().iter();
    let names = features.zip(network.sees(model)).filter_map(|(f, seen)| {
        let past = matches!(f.quantity, Quantity::Input { back: 1.., .. });
        past.then_some(seen.name)
    });
    let past: Vec<String> = names.collect();
    if past.is_empty() {
        return None;
    }
    let (run, interval) = runs.iter().find_map(|run| {
        let interval = typical_interval(&run.t)?;
        (!same_rate(interval, trained)).then_some((run, interval))
    })?;
    Some(format!(
        "the network of {} sees {}, and samples of {trained:.6} s are what it was trained on: those of run `{}` are {interval:.6} s apart, \
         so that it sees another time",
        network.weights,
        past.join(", "),
        run.id
    ))
}
