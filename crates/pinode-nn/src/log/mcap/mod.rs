//! MCAP: messages of topics, in JSON or as ROS 2 sends them; faults are told by topic and time.
//!
//! Every number in a message is a column, `<topic>.<field>.<subfield>`, `[k]` for the elements of arrays and `[<name>]` where there is
//! an array of names beside: `/joint_states.position[slider]`. The rows of the log are at the messages with the position of the first
//! coordinate; other positions and velocities lie on lines between their neighbours (orientations on arcs), inputs are held.

mod catalogue;
mod cdr;
mod clock;
mod json;
mod messages;
mod readings;
mod ros2msg;
mod series;
mod table;
mod turn;
mod value;

use std::path::Path;

use lagrange::Problem;

use super::rows::{Found, Rows, refused};
use super::{Channels, ColumnMap, Log, columns};
use crate::Error;
use crate::naming::quoted;
use catalogue::Catalogue;
use table::Table;

/// The log in `bytes`.
pub(super) fn parse(path: &Path, bytes: &[u8], channels: &Channels) -> Result<Log, Error> {
    let damaged = |why| damaged(path, why);
    let refuse = |list: Vec<Problem>| Found::from(list).into_error(path);
    let catalogue = Catalogue::of(bytes, &channels.columns.of("run")).map_err(damaged)?;
    let map = catalogue.map(channels).map_err(refuse)?;
    let channels = &Channels {
        columns: &map,
        ..*channels
    };
    let header = names(&catalogue);
    let mut warnings = Vec::new();
    let layout = columns::resolve(&header, None, channels, &mut warnings).map_err(|mut list| {
        list.extend(catalogue.unread());
        refuse(list)
    })?;
    warnings.extend(catalogue.unread());
    if catalogue.overfull {
        warnings.push(Problem::general(
            "the messages have more than 20000 numbers: others cannot be used",
        ));
    }

    let mut used = vec![false; catalogue.columns.len()];
    for index in layout.used().filter_map(|index| index.checked_sub(1)) {
        if let Some(used) = used.get_mut(index) {
            *used = true;
        }
    }
    let run = layout.run.and_then(|index| index.checked_sub(1));
    let readings = readings::read(bytes, &catalogue, &used, run).map_err(damaged)?;
    let mut rows = Rows::new(&header, &layout);
    for fault in &readings.faults {
        rows.found.push(|| Problem::general(fault));
    }
    for _ in 0..readings.more_faults {
        rows.found
            .push(|| Problem::general("a message cannot be read"));
    }
    if readings.clocks_differ {
        warnings.push(Problem::general(
            "the stamps in the messages are not of the clock of the times at which they were logged, and not all topics have them: all \
             times are those of logging",
        ));
    }
    if !readings.unstamped.is_empty() {
        let names: Vec<String> = readings.unstamped.iter().map(|name| quoted(name)).collect();
        warnings.push(Problem::general(format!(
            "no stamps in the messages of {}: their times are those of logging, beside stamps of others",
            names.join(", ")
        )));
    }
    let mut table = Table::new(&catalogue, &readings, &layout, channels);
    table.fill(&mut rows);
    table.tell(&mut rows, &mut warnings);
    rows.into_log(path, bytes, channels, warnings)
}

/// The names of the columns, and where the signals of `channels` stand in them.
pub(super) fn header(
    path: &Path,
    bytes: &[u8],
    channels: &Channels,
) -> Result<(Vec<String>, ColumnMap), Error> {
    let catalogue =
        Catalogue::of(bytes, &channels.columns.of("run")).map_err(|why| damaged(path, why))?;
    let map = catalogue.map(channels);
    let map = map.map_err(|list| Found::from(list).into_error(path))?;
    let names = names(&catalogue).into_iter().map(str::to_owned);
    Ok((names.collect(), map))
}

/// Before the columns of the file there is the time of the row, which every log has.
fn names(catalogue: &Catalogue) -> Vec<&str> {
    let columns = catalogue.columns.iter();
    let names = columns.map(|column| column.name.as_str());
    std::iter::once("t").chain(names).collect()
}

fn damaged(path: &Path, why: String) -> Error {
    refused(
        path,
        Problem::general(format!(
            "the file begins as MCAP and cannot be read as such ({why}): where it is cut off, `mcap recover` saves what is there; \
             or write the log as CSV in UTF-8"
        )),
    )
}
