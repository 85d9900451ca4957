//! Which format a file has, told by its first bytes.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use lagrange::Problem;

use super::rows::refused;
use super::{Channels, ColumnMap, Log, csv};
use crate::Error;
use crate::entries::q_names;

/// A longer file is refused.
const LARGEST: u64 = 1 << 30;

/// The whole file.
pub(super) fn bytes(path: &Path) -> Result<Vec<u8>, Error> {
    let file = File::open(path).map_err(|e| Error::io(path, e))?;
    let mut bytes = Vec::new();
    file.take(LARGEST + 1)
        .read_to_end(&mut bytes)
        .map_err(|e| Error::io(path, e))?;
    Ok(bytes)
}

/// The log in `bytes`.
pub(super) fn parse(path: &Path, bytes: &[u8], channels: &Channels) -> Result<Log, Error> {
    if bytes.len() as u64 > LARGEST {
        return Err(refused(
            path,
            Problem::general("the file is larger than 1 GiB: split it by runs"),
        ));
    }
    match Format::of(bytes) {
        Format::Csv => csv::parse(path, bytes, channels),
        #[cfg(feature = "parquet")]
        Format::Parquet => super::parquet::parse(path, bytes, channels),
        #[cfg(feature = "mcap")]
        Format::Mcap => super::mcap::parse(path, bytes, channels),
        #[cfg(not(feature = "parquet"))]
        Format::Parquet => Err(not_built(path, "Parquet", "parquet")),
        #[cfg(not(feature = "mcap"))]
        Format::Mcap => Err(not_built(path, "MCAP", "mcap")),
    }
}

/// The names of the columns in `bytes`, and where the signals of `channels` stand in them.
pub(super) fn header(
    path: &Path,
    bytes: &[u8],
    channels: &Channels,
) -> Result<(Vec<String>, ColumnMap), Error> {
    let mapped = |header| (header, channels.columns.clone());
    match Format::of(bytes) {
        Format::Csv => csv::header(path, bytes).map(mapped),
        #[cfg(feature = "parquet")]
        Format::Parquet => super::parquet::header(path, bytes).map(mapped),
        #[cfg(feature = "mcap")]
        Format::Mcap => super::mcap::header(path, bytes, channels),
        #[cfg(not(feature = "parquet"))]
        Format::Parquet => Err(not_built(path, "Parquet", "parquet")),
        #[cfg(not(feature = "mcap"))]
        Format::Mcap => Err(not_built(path, "MCAP", "mcap")),
    }
}

/// The positions of `channels` that have a column in `bytes`, by the names of their signals; all in what cannot be read, which reading it tells.
pub(super) fn positions(path: &Path, bytes: &[u8], channels: &Channels) -> Vec<String> {
    let mut signals = q_names(channels.coordinates);
    if let Ok((header, map)) = header(path, bytes, channels) {
        signals.retain(|signal| header.contains(&map.of(signal).column));
    }
    signals
}

/// Of a file, by its first bytes.
enum Format {
    Csv,
    Parquet,
    Mcap,
}

impl Format {
    fn of(bytes: &[u8]) -> Self {
        match bytes {
            [b'P', b'A', b'R', b'1', ..] => Format::Parquet,
            [0x89, b'M', b'C', b'A', b'P', b'0', b'\r', b'\n', ..] => Format::Mcap,
            _ => Format::Csv,
        }
    }
}

#[cfg(not(all(feature = "parquet", feature = "mcap")))]
fn not_built(path: &Path, format: &str, feature: &str) -> Error {
    refused(
        path,
        Problem::general(format!(
            "the file is {format}, which this build does not read: build it with the cargo feature `{feature}`, or write the log as CSV \
             in UTF-8"
        )),
    )
}

#[cfg(all(test, not(any(feature = "parquet", feature = "mcap"))))]
mod tests {
    use super::*;
    use crate::log::ColumnMap;

    #[test]
    fn a_format_that_is_not_built_in_is_named_with_its_feature() {
        let channels = Channels {
            coordinates: &[],
            velocities: &[],
            inputs: &[],
            columns: &ColumnMap::default(),
        };
        for (bytes, feature) in [
            (&b"PAR1\x15"[..], "parquet"),
            (b"\x89MCAP0\r\n\x01", "mcap"),
        ] {
            let told = match parse(Path::new("log"), bytes, &channels) {
                Ok(_) => "accepted".into(),
                Err(e) => e.to_string(),
            };
            assert!(
                told.contains(&format!("the cargo feature `{feature}`")),
                "{told}"
            );
        }
    }
}
