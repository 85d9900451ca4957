//! Logs in other formats than CSV: the same recording, written by other programs (`data/logs/make.py`), is the same log.
#![cfg(any(feature = "mcap", feature = "parquet"))]

#[cfg(feature = "mcap")]
mod mcap_logs;
#[cfg(feature = "parquet")]
mod parquet_logs;

use std::path::{Path, PathBuf};

use lagrange::Coordinate;
use pinode_nn::Error;
use pinode_nn::log::{Channels, ColumnMap, Log, Mapping, Run};

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/data/logs")
        .join(name)
}

fn coordinate(name: &str) -> Coordinate {
    Coordinate {
        name: name.into(),
        joint: name.into(),
        angular: name == "pole",
        wraps: name == "pole",
        floating: false,
    }
}

/// The log in `bytes` of a cart-pole.
fn parse(name: &str, bytes: &[u8], columns: &ColumnMap) -> Result<Log, Error> {
    Log::parse(
        Path::new(name),
        bytes,
        &Channels {
            coordinates: &[coordinate("slider"), coordinate("pole")],
            velocities: &[true, true],
            inputs: &["motor"],
            columns,
        },
    )
}

fn read_mapped(name: &str, columns: &ColumnMap) -> Result<Log, Error> {
    parse(name, &std::fs::read(data(name)).unwrap(), columns)
}

fn read(name: &str) -> Result<Log, Error> {
    read_mapped(name, &ColumnMap::default())
}

/// Pairs of a signal and its column.
fn mapped(pairs: &[(&str, &str)]) -> ColumnMap {
    let mapping = |(signal, column): &(&str, &str)| Mapping::new(*signal, *column);
    ColumnMap {
        mappings: pairs.iter().map(mapping).collect(),
    }
}

fn problems(result: Result<Log, Error>) -> String {
    match result {
        Err(Error::Problems(problems)) => problems.to_string(),
        Err(other) => panic!("{other}"),
        Ok(_) => panic!("accepted"),
    }
}

fn told(log: &Log) -> String {
    let warnings: Vec<String> = log.warnings.iter().map(ToString::to_string).collect();
    warnings.join("\n")
}

/// All numbers of a run, by their bits: −0 is another number than 0.
fn bits(run: &Run) -> Vec<Vec<u64>> {
    let columns = std::iter::once(&run.t)
        .chain(&run.q)
        .chain(run.v.iter().flatten())
        .chain(&run.u);
    columns
        .map(|column| column.iter().map(|x| x.to_bits()).collect())
        .collect()
}

fn assert_same(log: &Log, expected: &Log) {
    assert_eq!(log.runs.len(), expected.runs.len());
    for (run, expected) in log.runs.iter().zip(&expected.runs) {
        assert_eq!(run.id, expected.id);
        assert_eq!(bits(run), bits(expected), "{}", log.path.display());
    }
}

/// How many of `file` with one byte changed, every `step` bytes, are refused; a panic is not.
fn refused_when_flipped(file: &[u8], step: usize, columns: &ColumnMap) -> usize {
    let mut refused = 0;
    for at in (8..file.len()).step_by(step) {
        let mut damaged = file.to_vec();
        damaged[at] ^= 1 << (at % 8);
        match parse("damaged", &damaged, columns) {
            Ok(log) => assert!(log.samples() > 0),
            Err(Error::Problems(_)) => refused += 1,
            Err(other) => panic!("{other}"),
        }
    }
    refused
}
