//! Parquet, written by pyarrow; and what damaged files say.

use pinode_nn::log::{ColumnMap, Mapping};

use super::{
    assert_same, data, mapped, parse, problems, read, read_mapped, refused_when_flipped, told,
};

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
    let parsed = |name: &str| read_mapped(name, &columns).unwrap();
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
        // The stamps are not what `t` is.
        let columns = mapped(&[(signal, column), ("t", "v.pole")]);
        let message = problems(read_mapped("types.parquet", &columns));
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

/// Decoders of damaged pages panic, or read what is there.
#[test]
fn flipped_bytes_never_panic() {
    let names = ["snappy", "zstd", "gzip", "lz4", "plain", "types", "nested"];
    let refused = names.map(|name| {
        let file = std::fs::read(data(&format!("{name}.parquet"))).unwrap();
        refused_when_flipped(&file, 11, &ColumnMap::default())
    });
    assert!(refused.iter().all(|refused| *refused > 20), "{refused:?}");
}
