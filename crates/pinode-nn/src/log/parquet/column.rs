//! One column of a Parquet file: what its values are, and batches of them.

use ::parquet::basic::{ConvertedType, LogicalType, TimeUnit, Type};
use ::parquet::column::reader::{ColumnReader, ColumnReaderImpl, get_column_reader};
use ::parquet::data_type::{AsBytes, DataType, Int96};
use ::parquet::errors::Result;
use ::parquet::file::reader::RowGroupReader;
use ::parquet::schema::types::ColumnDescriptor;

use super::pages::Checked;

/// What the values of a column mean.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Kind {
    Number,
    /// Integers without a sign, which the file keeps as if they had one.
    Unsigned,
    /// Integers to be divided by ten to this power.
    Decimal {
        scale: i32,
    },
    /// Instants, in so many parts of a second.
    Stamp {
        per_second: f64,
    },
    Text,
}

impl Kind {
    /// What the column's values are; else why they are not read.
    pub(super) fn of(column: &ColumnDescriptor, is_t: bool, is_run: bool) -> Result<Kind, String> {
        if column.max_rep_level() > 0 {
            return Err("holds lists: one value a row is needed, write its elements to columns of their own".into());
        }
        let kind = match (
            column.logical_type_ref(),
            column.converted_type(),
            column.physical_type(),
        ) {
            (Some(LogicalType::Timestamp(stamp) | LogicalType::Time(stamp)), ..) => Kind::Stamp {
                per_second: match stamp.unit {
                    TimeUnit::MILLIS => 1e3,
                    TimeUnit::MICROS => 1e6,
                    TimeUnit::NANOS => 1e9,
                },
            },
            (_, ConvertedType::TIMESTAMP_MILLIS | ConvertedType::TIME_MILLIS, _) => {
                Kind::Stamp { per_second: 1e3 }
            }
            (_, ConvertedType::TIMESTAMP_MICROS | ConvertedType::TIME_MICROS, _) => {
                Kind::Stamp { per_second: 1e6 }
            }
            (_, _, Type::INT96) => Kind::Stamp { per_second: 1e9 },
            (Some(LogicalType::Decimal(_)), ..) | (_, ConvertedType::DECIMAL, _) => Kind::Decimal {
                scale: column.type_scale(),
            },
            (Some(LogicalType::Integer(integer)), ..) if !integer.is_signed => Kind::Unsigned,
            (_, ConvertedType::UINT_32 | ConvertedType::UINT_64, _) => Kind::Unsigned,
            (Some(LogicalType::Date), ..) | (_, ConvertedType::DATE, _) => {
                return Err("holds dates: numbers are needed".into());
            }
            (Some(LogicalType::String | LogicalType::Enum), ..) | (None, _, Type::BYTE_ARRAY) => {
                Kind::Text
            }
            (
                None | Some(LogicalType::Integer(_)),
                _,
                Type::BOOLEAN | Type::INT32 | Type::INT64 | Type::FLOAT | Type::DOUBLE,
            ) => Kind::Number,
            (logical, _, physical) => {
                let named = logical.map_or_else(|| physical.to_string(), |l| format!("{l:?}"));
                return Err(format!("is of the type {named}: numbers are needed"));
            }
        };
        match kind {
            Kind::Stamp { .. } if is_run => {
                Err("holds time stamps: ids are integers or text".into())
            }
            Kind::Stamp { .. } if !is_t => Err("holds time stamps: numbers are needed".into()),
            kind => Ok(kind),
        }
    }
}

/// One value, with its meaning applied.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Value {
    Number(f64),
    Integer(i128),
    Text(String),
    Missing,
}

/// A column that is read.
pub(super) struct Column {
    /// In the file.
    pub index: usize,
    pub kind: Kind,
    /// The values that were read last.
    pub batch: Vec<Value>,
    reader: Option<ColumnReader>,
    /// Definition levels: the highest says that there is a value.
    levels: Vec<i16>,
    full: i16,
    /// The first stamp of the file.
    first: Option<i128>,
}

impl Column {
    pub(super) fn new(index: usize, kind: Kind) -> Self {
        Column {
            index,
            kind,
            batch: Vec::new(),
            reader: None,
            levels: Vec::new(),
            full: 0,
            first: None,
        }
    }

    pub(super) fn open(&mut self, group: &dyn RowGroupReader) -> Result<()> {
        let descriptor = group.metadata().column(self.index).column_descr_ptr();
        self.full = descriptor.max_def_level();
        let pages = Checked(group.get_column_page_reader(self.index)?);
        self.reader = Some(get_column_reader(descriptor, Box::new(pages)));
        Ok(())
    }

    /// Reads up to `rows` rows; how many there were.
    pub(super) fn read(&mut self, rows: usize) -> Result<usize> {
        self.batch.clear();
        let Some(mut reader) = self.reader.take() else {
            return Ok(0);
        };
        let found = match &mut reader {
            ColumnReader::BoolColumnReader(r) => {
                self.fill(r, rows, |_, v| Value::Integer((*v).into()))
            }
            ColumnReader::Int32ColumnReader(r) => self.fill(r, rows, |column, v| {
                column.integer((*v).into(), v.cast_unsigned().into())
            }),
            ColumnReader::Int64ColumnReader(r) => self.fill(r, rows, |column, v| {
                column.integer((*v).into(), v.cast_unsigned().into())
            }),
            ColumnReader::Int96ColumnReader(r) => self.fill(r, rows, |column, v: &Int96| {
                let ns = v.to_nanos().into();
                column.integer(ns, ns)
            }),
            ColumnReader::FloatColumnReader(r) => {
                self.fill(r, rows, |_, v| Value::Number((*v).into()))
            }
            ColumnReader::DoubleColumnReader(r) => self.fill(r, rows, |_, v| Value::Number(*v)),
            ColumnReader::ByteArrayColumnReader(r) => {
                self.fill(r, rows, |column, v| column.bytes(v))
            }
            ColumnReader::FixedLenByteArrayColumnReader(r) => {
                self.fill(r, rows, |column, v| column.bytes(v))
            }
        };
        self.reader = Some(reader);
        found
    }

    fn fill<T: DataType>(
        &mut self,
        reader: &mut ColumnReaderImpl<T>,
        rows: usize,
        mut value: impl FnMut(&mut Self, &T::T) -> Value,
    ) -> Result<usize> {
        let mut values = Vec::with_capacity(rows);
        let mut levels = std::mem::take(&mut self.levels);
        levels.clear();
        let (found, ..) = reader.read_records(rows, Some(&mut levels), None, &mut values)?;
        self.batch.reserve(found);
        let mut values = values.iter();
        for row in 0..found {
            // Without levels every row has a value.
            let there = levels.get(row).is_none_or(|level| *level == self.full);
            let read = if there { values.next() } else { None };
            let read = read.map_or(Value::Missing, |v| value(self, v));
            self.batch.push(read);
        }
        self.levels = levels;
        Ok(found)
    }

    /// An integer, with its sign and without.
    fn integer(&mut self, raw: i128, unsigned: i128) -> Value {
        match self.kind {
            Kind::Unsigned => Value::Integer(unsigned),
            Kind::Stamp { per_second } => {
                let first = *self.first.get_or_insert(raw);
                Value::Number((raw - first) as f64 / per_second)
            }
            Kind::Decimal { scale } => decimal(raw, scale),
            _ => Value::Integer(raw),
        }
    }

    fn bytes(&mut self, raw: &impl AsBytes) -> Value {
        let raw = raw.as_bytes();
        match self.kind {
            // Of two's complement, the most significant byte first.
            Kind::Decimal { scale } if (1..=16).contains(&raw.len()) => {
                let negative = raw.first().is_some_and(|byte| *byte >= 0x80);
                let integer = raw
                    .iter()
                    .fold(if negative { -1 } else { 0 }, |sum: i128, byte| {
                        sum << 8 | i128::from(*byte)
                    });
                decimal(integer, scale)
            }
            _ => Value::Text(String::from_utf8_lossy(raw).into_owned()),
        }
    }
}

/// The number nearest to the decimal, as if it had been read from text.
fn decimal(integer: i128, scale: i32) -> Value {
    match format!("{integer}e{}", -i64::from(scale)).parse() {
        Ok(number) => Value::Number(number),
        Err(_) => Value::Missing,
    }
}
