//! Parquet, written by pyarrow; and what damaged files say.

use std::sync::Arc;

use parquet::column::writer::ColumnWriter;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::parser::parse_message_type;
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
        scale: 0.1,
        offset: 3.0,
        ..Mapping::new(signal, column)
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

/// Something that moves, at these times in whole numbers: in Parquet and in CSV.
fn counted(t: &[i64]) -> [Vec<u8>; 2] {
    let schema = "message log { required int64 t; required double q.slider; required double q.pole; required double u.motor; }";
    let schema = Arc::new(parse_message_type(schema).unwrap());
    let mut writer = SerializedFileWriter::new(Vec::new(), schema, Arc::default()).unwrap();
    let mut group = writer.next_row_group().unwrap();
    let swing: Vec<f64> = (0..t.len()).map(|k| (0.1 * k as f64).sin()).collect();
    while let Some(mut column) = group.next_column().unwrap() {
        match column.untyped() {
            ColumnWriter::Int64ColumnWriter(own) => own.write_batch(t, None, None).unwrap(),
            ColumnWriter::DoubleColumnWriter(own) => own.write_batch(&swing, None, None).unwrap(),
            _ => unreachable!(),
        };
        column.close().unwrap();
    }
    group.close().unwrap();
    let mut csv = "t,q.slider,q.pole,u.motor\n".to_owned();
    for (t, x) in t.iter().zip(&swing) {
        csv += &format!("{t},{x},{x},{x}\n");
    }
    [writer.into_inner().unwrap(), csv.into_bytes()]
}

/// They were read as seconds: a log in microseconds was a million times too slow.
#[test]
fn times_that_count_something_else_than_seconds_are_refused_and_their_scale_is_said() {
    for (first, step, words) in [
        (0, 20_000, ["seems to count µs: ", "scale = 1e-6"]),
        (0, 20_000_000, ["seems to count ns: ", "scale = 1e-9"]),
        (1_700_000_000_000, 20, ["ms since 1970", "scale = 1e-3"]),
        (
            1_700_000_000_000_000_000,
            20_000_000,
            ["ns since 1970", "scale = 1e-9"],
        ),
    ] {
        let t: Vec<i64> = (0..50).map(|k| first + step * k).collect();
        for file in counted(&t) {
            let message = problems(parse("counted", &file, &ColumnMap::default()));
            for words in words {
                assert!(message.contains(words), "{message}");
            }
        }
    }
    // Of a slow motion, or in ms.
    for file in counted(&(0..50).map(|k| 20 * k).collect::<Vec<i64>>()) {
        let log = parse("counted", &file, &ColumnMap::default()).unwrap();
        assert_eq!(log.runs[0].t[2], 40.0);
        let told = told(&log);
        assert!(
            told.contains("`t` is read as seconds: a sample every 20 s"),
            "{told}"
        );
        assert!(told.contains("scale = 1e-3"), "{told}");
    }
}

/// An `f64` holds nanoseconds since 1970 to a quarter of a microsecond.
#[test]
fn nothing_is_lost_of_nanoseconds_since_1970() {
    let columns = ColumnMap {
        mappings: vec![Mapping {
            scale: 1e-9,
            ..ColumnMap::default().of("t")
        }],
    };
    let t: Vec<i64> = (0..50)
        .map(|k| 1_700_000_000_000_000_001 + 1_003 * k)
        .collect();
    for file in counted(&t) {
        let log = parse("counted", &file, &columns).unwrap();
        for (k, t) in log.runs[0].t.iter().enumerate() {
            assert!((t - 1.003e-6 * k as f64).abs() < 1e-18, "{k}: {t:e}");
        }
        assert!(
            told(&log).contains("`t` counts from a day long ago"),
            "{}",
            told(&log)
        );
    }
}
