//! Parquet: a column for each signal, faults told by column and row.
//!
//! Times may be stamps of any unit; they become seconds since the first. Fields of structures have dotted names. Lists are not read.

mod column;
mod pages;

use std::path::Path;

use ::parquet::errors::{ParquetError, Result};
use ::parquet::file::reader::{FileReader, SerializedFileReader};
use ::parquet::schema::types::{ColumnDescPtr, SchemaDescriptor};
use bytes::Bytes;
use lagrange::Problem;

use super::columns::{self, Layout};
use super::rows::{Cell, Found, Row, Rows, refused};
use super::{Channels, Log};
use crate::Error;
use crate::naming::quoted;
use column::{Column, Kind, Value};

/// Cells of the columns that are read: as many as fill 1 GiB with numbers.
const MOST_CELLS: u64 = 1 << 27;
/// Rows that are unpacked at once.
const BATCH: usize = 4096;

/// The log in `bytes`.
pub(super) fn parse(path: &Path, bytes: &[u8], channels: &Channels) -> Result<Log, Error> {
    let damaged = |e| damaged(path, e);
    let file = open(path, bytes)?;
    let names = names(&file);
    let schema = file.metadata().file_metadata().schema_descr();
    let header: Vec<&str> = names.iter().map(String::as_str).collect();
    let mut warnings = Vec::new();
    let layout = columns::resolve(&header, None, channels, &mut warnings)
        .map_err(|list| Found::from(list).into_error(path))?;
    let mut used = Used::new(schema, &layout).map_err(|list| Found::from(list).into_error(path))?;
    let rows = used.rows(&file).map_err(&damaged)?;
    if rows.saturating_mul(used.columns.len() as u64) > MOST_CELLS {
        return Err(refused(
            path,
            Problem::general(format!(
                "{rows} rows of {} columns are more than {MOST_CELLS} numbers: split the log by runs",
                used.columns.len()
            )),
        ));
    }
    if let Some(Kind::Stamp { .. }) = used.kind(layout.t.index) {
        warnings.push(Problem::general(format!(
            "{} has time stamps: they are read as seconds since the first",
            quoted(&channels.columns.of("t").column)
        )));
    }

    let mut checked = Rows::new(&header, &layout);
    let mut read = 0;
    for group in 0..file.num_row_groups() {
        guarded(|| used.open(&file, group)).map_err(&damaged)?;
        while guarded(|| used.advance()).map_err(&damaged)? {
            for row in 0..used.batch() {
                read += 1;
                checked.add(&TableRow {
                    used: &used,
                    row,
                    number: read,
                });
            }
        }
    }
    checked.into_log(path, bytes, channels, warnings)
}

/// The names of the columns.
pub(super) fn header(path: &Path, bytes: &[u8]) -> Result<Vec<String>, Error> {
    Ok(names(&open(path, bytes)?))
}

type File = SerializedFileReader<Bytes>;

fn open(path: &Path, bytes: &[u8]) -> Result<File, Error> {
    let opened = guarded(|| SerializedFileReader::new(Bytes::copy_from_slice(bytes)));
    opened.map_err(|e| damaged(path, e))
}

fn names(file: &File) -> Vec<String> {
    let columns = file.metadata().file_metadata().schema_descr().columns();
    let name = |column: &ColumnDescPtr| column.path().string();
    columns.iter().map(name).collect()
}

fn damaged(path: &Path, e: ParquetError) -> Error {
    refused(
        path,
        Problem::general(format!(
            "the file begins as Parquet and cannot be read as such ({e}): where it is cut off or damaged write it anew, without \
             encryption and with one of the usual compressions (snappy, zstd, gzip, lz4); or write the log as CSV in UTF-8"
        )),
    )
}

/// What the library says of a damaged file, also where it panics: its decoders trust lengths and indices within pages.
fn guarded<T>(work: impl FnOnce() -> Result<T>) -> Result<T> {
    let panicked = || ParquetError::General("its pages contradict themselves".into());
    super::guarded::guarded(work).unwrap_or_else(|| Err(panicked()))
}

/// The columns that are read, a batch of rows of each.
struct Used {
    columns: Vec<Column>,
    /// For each column of the file, its place among those.
    slots: Vec<Option<usize>>,
    /// Rows of the open group that have not been read.
    left: usize,
}

impl Used {
    fn new(schema: &SchemaDescriptor, layout: &Layout) -> Result<Self, Vec<Problem>> {
        let mut problems = Vec::new();
        let mut columns = Vec::new();
        let mut slots = vec![None; schema.num_columns()];
        for index in layout.used() {
            let descriptor = schema.column(index);
            let (is_t, is_run) = (index == layout.t.index, Some(index) == layout.run);
            match Kind::of(&descriptor, is_t, is_run) {
                Ok(kind) => {
                    if let Some(slot @ None) = slots.get_mut(index) {
                        *slot = Some(columns.len());
                        columns.push(Column::new(index, kind));
                    }
                }
                Err(fault) => problems.push(Problem::general(format!(
                    "column {} {fault}",
                    quoted(&descriptor.path().string())
                ))),
            }
        }
        if problems.is_empty() {
            Ok(Used {
                columns,
                slots,
                left: 0,
            })
        } else {
            Err(problems)
        }
    }

    fn column(&self, index: usize) -> Option<&Column> {
        self.columns.get((*self.slots.get(index)?)?)
    }

    fn kind(&self, index: usize) -> Option<Kind> {
        self.column(index).map(|column| column.kind)
    }

    /// How many rows the file says that it has.
    fn rows(&self, file: &File) -> Result<u64> {
        let mut rows: u64 = 0;
        for group in file.metadata().row_groups() {
            rows = rows.saturating_add(rows_of(group.num_rows())?);
        }
        Ok(rows)
    }

    fn open(&mut self, file: &File, group: usize) -> Result<()> {
        let group = file.get_row_group(group)?;
        self.left = rows_of(group.metadata().num_rows())?
            .try_into()
            .unwrap_or(usize::MAX);
        for column in &mut self.columns {
            column.open(group.as_ref())?;
        }
        Ok(())
    }

    /// Reads the next batch; false at the end of the group.
    fn advance(&mut self) -> Result<bool> {
        let expected = self.left.min(BATCH);
        for column in &mut self.columns {
            let found = column.read(expected)?;
            if found != expected {
                return Err(ParquetError::General(format!(
                    "column {} ends {} rows too early",
                    column.index,
                    self.left - found
                )));
            }
        }
        self.left -= expected;
        Ok(expected > 0)
    }

    /// Rows in the batch.
    fn batch(&self) -> usize {
        self.columns.first().map_or(0, |column| column.batch.len())
    }
}

fn rows_of(rows: i64) -> Result<u64> {
    u64::try_from(rows).map_err(|_| ParquetError::General(format!("a group of {rows} rows")))
}

struct TableRow<'a> {
    used: &'a Used,
    /// In the batch.
    row: usize,
    /// From 1, in the file.
    number: u64,
}

impl Row for TableRow<'_> {
    fn cell(&self, index: usize) -> Cell<'_> {
        let column = self.used.column(index);
        match column.and_then(|column| column.batch.get(self.row)) {
            None | Some(Value::Missing) => Cell::Missing,
            Some(Value::Number(value)) => Cell::Number(*value),
            Some(Value::Integer(value)) => Cell::Integer(*value),
            Some(Value::Text(text)) => match text.trim() {
                "" => Cell::Missing,
                text => Cell::Text(text),
            },
        }
    }

    fn problem(&self, _: usize, message: String) -> Problem {
        Problem::general(format!("row {}: {message}", self.number))
    }
}
