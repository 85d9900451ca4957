//! All readings of the columns that are used, and when they were.

use std::collections::HashMap;

use super::catalogue::{Catalogue, Column};
use super::clock::{self, Times};
use super::messages::for_each;
use super::series::Series;
use super::value::Value;
use crate::naming::quoted;

/// As many readings as fill 1 GiB with numbers.
const MOST_READINGS: usize = 1 << 27;

/// The readings of the used columns.
pub(super) struct Readings<'a> {
    /// For each column of the catalogue; empty for those that are not used.
    pub series: Vec<Series>,
    /// Whether the stamps were passed over, since not all clocks agree.
    pub clocks_differ: bool,
    /// Topics without stamps, where others have some.
    pub unstamped: Vec<&'a str>,
    /// The first messages that are not like their definition.
    pub faults: Vec<String>,
    pub more_faults: usize,
}

/// What is read of the messages of one topic: columns, with their indices.
struct Wanted<'a> {
    topic: usize,
    columns: Vec<(usize, &'a Column)>,
}

/// Reads the columns for which `used` says so; the ids of runs stand in the column `run`.
pub(super) fn read<'a>(
    bytes: &[u8],
    catalogue: &'a Catalogue,
    used: &[bool],
    run: Option<usize>,
) -> Result<Readings<'a>, String> {
    let mut topics: HashMap<&str, Wanted> = HashMap::new();
    for (index, column) in catalogue.columns.iter().enumerate() {
        if used.get(index) == Some(&true)
            && let Some(topic) = catalogue.topics.get(column.topic)
        {
            let wanted = topics.entry(&topic.name).or_insert_with(|| Wanted {
                topic: column.topic,
                columns: Vec::new(),
            });
            wanted.columns.push((index, column));
        }
    }
    let mut series: Vec<Series> = catalogue
        .columns
        .iter()
        .map(|_| Series::default())
        .collect();
    let mut times: Vec<Times> = catalogue.topics.iter().map(|_| Times::default()).collect();
    let (mut faults, mut more_faults, mut readings) = (Vec::new(), 0, 0);
    for_each(bytes, |channel, logged, data| {
        let Some(wanted) = topics.get(channel.topic.as_str()) else {
            return;
        };
        if channel.unread().is_some() || readings > MOST_READINGS {
            return;
        }
        let message = match channel.decode(data) {
            Ok(message) => message,
            Err(why) if faults.len() < 20 => {
                return faults.push(format!(
                    "a message of {} at {} s cannot be read: {why}",
                    quoted(&channel.topic),
                    seconds(logged)
                ));
            }
            Err(_) => {
                more_faults += 1;
                return;
            }
        };
        let Some(times) = times.get_mut(wanted.topic) else {
            return;
        };
        let index = u32::try_from(times.logged.len()).unwrap_or(u32::MAX);
        times.push(logged, &message);
        for (column, Column { path, .. }) in &wanted.columns {
            if let (Some(value), Some(series)) = (message.at(path), series.get_mut(*column)) {
                readings += 1;
                series.messages.push(index);
                // What is no number here and was one elsewhere is a null or a word: found where it is used.
                series.numbers.push(value.number().unwrap_or(f64::NAN));
                if Some(*column) == run {
                    series.texts.push(match value {
                        Value::Text(text) => text.clone(),
                        value => value.number().map_or("".into(), |id| id.to_string().into()),
                    });
                }
            }
        }
    })?;
    if readings > MOST_READINGS {
        return Err(format!(
            "it has more than {MOST_READINGS} numbers of the signals that are read"
        ));
    }
    let chosen = clock::choose(times);
    let name = |topic: usize| catalogue.topics.get(topic).map_or("", |topic| &topic.name);
    for (topic, logged) in chosen.begun_anew {
        faults.push(format!(
            "the stamps of {} begin anew in what was logged at {} s: cut the file there, recordings that do not continue one another are \
             logs of their own",
            quoted(name(topic)),
            seconds(logged)
        ));
    }
    for (series, column) in series.iter_mut().zip(&catalogue.columns) {
        series.place(chosen.times.get(column.topic).map_or(&[], Vec::as_slice));
    }
    Ok(Readings {
        series,
        clocks_differ: !chosen.agree,
        unstamped: chosen.unstamped.into_iter().map(name).collect(),
        faults,
        more_faults,
    })
}

/// Nanoseconds as seconds, to the last digit.
pub(super) fn seconds(ns: i64) -> String {
    let (whole, part) = (ns / 1_000_000_000, (ns % 1_000_000_000).abs());
    format!("{whole}.{part:09}")
}
