//! CSV: text in UTF-8 with a header, faults told by line and column.

use std::path::Path;

use lagrange::{Position, Problem};

use super::rows::{Cell, Found, Row, Rows, refused};
use super::{Channels, Log, columns};
use crate::Error;
use crate::naming::quoted;

/// The log in the text `bytes`.
pub(super) fn parse(path: &Path, bytes: &[u8], channels: &Channels) -> Result<Log, Error> {
    let text = text_of(path, bytes)?;
    let mut reader = reader(text);
    let header = next_header(path, &mut reader)?;
    let header: Vec<&str> = header.iter().map(String::as_str).collect();
    let mut record = ::csv::StringRecord::new();
    let mut warnings = Vec::new();
    let csv_error = |e: ::csv::Error| refused(path, Problem::general(e.to_string()));
    let layout = columns::resolve(&header, Some(TOP), channels, &mut warnings)
        .map_err(|list| Found::from(list).into_error(path))?;

    let mut rows = Rows::new(&header, &layout);
    while reader.read_record(&mut record).map_err(csv_error)? {
        if record.len() == header.len() {
            rows.add(&Line {
                text,
                record: &record,
            });
        } else {
            rows.found.push(|| {
                Problem::at(
                    place(text, &record, 0),
                    format!("{} fields, the header has {}", record.len(), header.len()),
                )
            });
        }
    }
    rows.into_log(path, bytes, channels, warnings)
}

/// The names of the columns.
pub(super) fn header(path: &Path, bytes: &[u8]) -> Result<Vec<String>, Error> {
    next_header(path, &mut reader(text_of(path, bytes)?))
}

type Reader<'a> = ::csv::Reader<&'a [u8]>;

fn reader(text: &str) -> Reader<'_> {
    ::csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .from_reader(text.as_bytes())
}

/// Where the header stands.
const TOP: Position = Position { line: 1, column: 1 };

/// The header, of which nothing has been read.
fn next_header(path: &Path, reader: &mut Reader) -> Result<Vec<String>, Error> {
    let mut record = ::csv::StringRecord::new();
    let read = reader.read_record(&mut record);
    if !read.map_err(|e| refused(path, Problem::general(e.to_string())))? {
        return Err(refused(
            path,
            Problem::general(
                "the file is empty: a log starts with the header `t,q.<joint>,…,u.<input>,…`",
            ),
        ));
    }
    let header: Vec<String> = record.iter().map(|name| name.trim().to_owned()).collect();
    if let [only] = header.as_slice()
        && (only.contains(';') || only.contains('\t'))
    {
        return Err(refused(
            path,
            Problem::at(
                TOP,
                format!(
                    "the header is the single column {}: separate columns by commas, and write decimals with a point",
                    quoted(only)
                ),
            ),
        ));
    }
    Ok(header)
}

/// The text after the byte-order mark.
fn text_of<'a>(path: &Path, bytes: &'a [u8]) -> Result<&'a str, Error> {
    if bytes.starts_with(&[0xff, 0xfe]) || bytes.starts_with(&[0xfe, 0xff]) {
        return Err(refused(
            path,
            Problem::general("the file is UTF-16: save it as UTF-8"),
        ));
    }
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    std::str::from_utf8(bytes).map_err(|e| {
        let valid = bytes.get(..e.valid_up_to()).unwrap_or_default();
        let valid = std::str::from_utf8(valid).unwrap_or_default();
        refused(
            path,
            Problem::at(
                Position::of(valid, valid.len()),
                "this byte is not UTF-8: a log is a CSV text in UTF-8 (or a file in Parquet or MCAP, which are told by their first bytes)",
            ),
        )
    })
}

/// A record, and the text that it stands in.
struct Line<'a> {
    text: &'a str,
    record: &'a ::csv::StringRecord,
}

impl Row for Line<'_> {
    fn cell(&self, index: usize) -> Cell<'_> {
        match self.record.get(index).unwrap_or("").trim() {
            "" => Cell::Missing,
            field => Cell::Text(field),
        }
    }

    fn problem(&self, index: usize, message: String) -> Problem {
        Problem::at(place(self.text, self.record, index), message)
    }
}

/// Where field `index` of `record` stands in `text`.
fn place(text: &str, record: &::csv::StringRecord, index: usize) -> Position {
    let (mut offset, mut line) = match record.position() {
        Some(p) => (usize::try_from(p.byte()).unwrap_or(0), p.line() as usize),
        None => (0, 1),
    };
    let mut rest = text.get(offset..).unwrap_or("");
    // The reader counts blank lines to the record after them.
    while let Some(c @ ('\r' | '\n')) = rest.chars().next() {
        line += usize::from(c == '\n');
        offset += 1;
        rest = text.get(offset..).unwrap_or("");
    }
    let (mut field, mut column, mut within_quotes) = (0, 1, false);
    for c in rest.chars() {
        if field == index {
            break;
        }
        match c {
            '"' => within_quotes = !within_quotes,
            ',' if !within_quotes => field += 1,
            _ => {}
        }
        if c == '\n' {
            line += 1;
            column = 1;
        } else {
            column += 1;
        }
    }
    Position { line, column }
}
