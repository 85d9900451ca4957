//! Logs that are Parquet files, written by pyarrow (`data/logs/make.py`): the same recording as in CSV, and what damaged files say.
#![allow(clippy::unwrap_used, clippy::panic)]
#![cfg(feature = "parquet")]

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

fn read(name: &str) -> Result<Log, Error> {
    parse(
        name,
        &std::fs::read(data(name)).unwrap(),
        &ColumnMap::default(),
    )
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

#[test]
fn the_same_recording_is_the_same_log_whatever_the_compression() {
    let csv = read("rig.csv").unwrap();
    assert_eq!(csv.samples(), 80);
    // Dictionaries and statistics; several groups of rows in pages of the second version; values split by bytes.
    for codec in ["snappy", "zstd", "gzip", "lz4", "plain"] {
        let log = read(&format!("{codec}.parquet")).unwrap();
        assert_same(&log, &csv);
        assert!(log.warnings.is_empty(), "{}", told(&log));
    }
}

#[test]
fn counts_decimals_switches_stamps_and_ids_are_the_numbers_that_csv_has() {
    let csv = read("types.csv").unwrap();
    let ids: Vec<&str> = csv.runs.iter().map(|run| run.id.as_str()).collect();
    assert_eq!(ids, ["7000000000000000001", "7000000000000000002"]);

    let log = read("types.parquet").unwrap();
    assert_same(&log, &csv);
    assert_eq!(log.runs[1].t[0], 0.8, "from the first stamp of the file");
    assert!(
        told(&log).contains("columns not used: `forces.list.element`"),
        "{}",
        told(&log)
    );
    assert!(
        told(&log).contains("`t` has time stamps: they are read as seconds since the first"),
        "{}",
        told(&log)
    );
}

#[test]
fn fields_of_structures_are_columns_and_numbers_in_words_are_numbers_as_in_csv() {
    assert_same(
        &read("nested.parquet").unwrap(),
        &read("types.csv").unwrap(),
    );
}

#[test]
fn columns_are_mapped_scaled_and_offset_as_in_csv() {
    let mapping = |signal: &str, column: &str| Mapping {
        signal: signal.into(),
        column: column.into(),
        scale: 0.1,
        offset: 3.0,
    };
    let columns = ColumnMap {
        mappings: vec![
            mapping("q.slider", "u.motor"),
            mapping("v.pole", "u.motor"),
            mapping("t", "t"),
        ],
    };
    let parsed = |name: &str| parse(name, &std::fs::read(data(name)).unwrap(), &columns).unwrap();
    assert_same(&parsed("zstd.parquet"), &parsed("rig.csv"));
    assert_same(&parsed("types.parquet"), &parsed("types.csv"));
}

#[test]
fn nulls_and_nan_are_told_by_column_and_row() {
    let message = problems(read("faulty.parquet"));
    assert!(
        message.contains("faulty.parquet: row 12: `q.slider` is empty"),
        "{message}"
    );
    assert!(
        message.contains("faulty.parquet: row 20: `q.pole` is NaN: every entry must be a finite"),
        "{message}"
    );
    assert_eq!(message.lines().count(), 2, "{message}");
}

#[test]
fn missing_columns_and_those_of_the_wrong_type_are_named() {
    let file = std::fs::read(data("types.parquet")).unwrap();
    for (signal, column, words) in [
        (
            "q.pole",
            "q.pol",
            "column `q.pol` (for q.pole, by [log.columns]) is missing; ",
        ),
        (
            "q.pole",
            "t",
            "column `t` holds time stamps: numbers are needed",
        ),
        ("run", "t", "column `t` holds time stamps: ids are"),
        (
            "v.pole",
            "forces.list.element",
            "column `forces.list.element` holds lists",
        ),
    ] {
        let columns = ColumnMap {
            mappings: [(signal, column), ("t", "v.pole")]
                .map(|(signal, column)| Mapping {
                    signal: signal.into(),
                    column: column.into(),
                    scale: 1.0,
                    offset: 0.0,
                })
                .into(),
        };
        let message = problems(parse("types.parquet", &file, &columns));
        assert!(message.contains(words), "{message}");
    }
}

#[test]
fn a_compression_that_is_not_built_in_is_named() {
    let message = problems(read("brotli.parquet"));
    assert!(message.contains("brotli"), "{message}");
    assert!(message.contains("snappy, zstd, gzip, lz4"), "{message}");
}

#[test]
fn truncated_files_are_refused_at_every_length() {
    for name in ["snappy.parquet", "types.parquet"] {
        let file = std::fs::read(data(name)).unwrap();
        for length in (4..file.len()).step_by(7).chain(file.len() - 9..file.len()) {
            let message = problems(parse(name, &file[..length], &ColumnMap::default()));
            assert!(message.contains("cut off or damaged"), "{message}");
            assert!(message.starts_with(name), "{message}");
        }
    }
}

/// Decoders of damaged pages panic or read what is there; none of it is a panic of ours.
#[test]
fn flipped_bytes_never_panic() {
    let mut refused = 0;
    for name in ["snappy", "zstd", "gzip", "lz4", "plain", "types", "nested"] {
        let name = format!("{name}.parquet");
        let file = std::fs::read(data(&name)).unwrap();
        for at in (4..file.len()).step_by(11) {
            let mut damaged = file.clone();
            damaged[at] ^= 1 << (at % 8);
            match parse(&name, &damaged, &ColumnMap::default()) {
                Ok(log) => assert!(log.samples() > 0),
                Err(Error::Problems(_)) => refused += 1,
                Err(other) => panic!("{other}"),
            }
        }
    }
    assert!(refused > 200, "{refused}");
}
