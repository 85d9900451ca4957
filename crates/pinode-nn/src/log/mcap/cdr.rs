//! Messages in CDR, as ROS 2 sends them: the fields of a definition one after another, each aligned to its own size.
//!
//! The first four bytes say which end of a number comes first; alignment counts from behind them. OMG, "DDS Interoperability Wire
//! Protocol", 10.5; "Common Object Request Broker Architecture", 9.3.

use super::ros2msg::{Array, Definitions, Element, Field};
use super::value::{MOST_ELEMENTS, Value};

/// Structures within structures.
const DEEPEST: usize = 64;
/// Parts of one message: definitions can promise more with a few bytes than there is memory for.
const MOST_PARTS: usize = 1 << 20;

/// The message in `data`, by its definition.
pub(super) fn decode(definitions: &Definitions, data: &[u8]) -> Result<Value, String> {
    let (header, body) = data
        .split_first_chunk::<4>()
        .ok_or("it has no header of four bytes")?;
    let little = match header {
        [0, 0, ..] => false,
        [0, 1, ..] => true,
        [a, b, ..] => {
            return Err(format!(
                "its representation is {a:#04x}{b:02x}, not plain CDR"
            ));
        }
    };
    let mut reader = Reader {
        definitions,
        body,
        at: 0,
        little,
        parts: MOST_PARTS,
    };
    reader.structure(0, 0)
}

struct Reader<'a> {
    definitions: &'a Definitions,
    body: &'a [u8],
    at: usize,
    little: bool,
    /// How many may still be read.
    parts: usize,
}

impl<'a> Reader<'a> {
    fn structure(&mut self, index: usize, depth: usize) -> Result<Value, String> {
        if depth > DEEPEST {
            return Err(format!("it is more than {DEEPEST} structures deep"));
        }
        let definitions = self.definitions;
        let fields = definitions.fields(index);
        if fields.is_empty() {
            // ROS gives a structure without fields a byte that nobody reads.
            self.take(1)?;
        }
        let mut values = Vec::with_capacity(fields.len());
        for field in fields {
            let value = self
                .field(field, depth)
                .map_err(|fault| format!("{fault}, in its field `{}`", field.name))?;
            values.push((field.name.clone(), value));
        }
        Ok(Value::Fields(values))
    }

    fn field(&mut self, field: &Field, depth: usize) -> Result<Value, String> {
        let count = match field.array {
            Array::None => return self.element(field.element, depth),
            Array::Fixed(count) => count,
            Array::Sequence => self.count()?,
        };
        if let Some(size) = size(field.element)
            && count > MOST_ELEMENTS
        {
            self.align(size);
            self.take(count.saturating_mul(size))?;
            return Ok(Value::Nothing);
        }
        let mut list = Vec::new();
        for _ in 0..count {
            let value = self.element(field.element, depth)?;
            if list.len() < MOST_ELEMENTS {
                list.push(value);
            }
        }
        Ok(if count > MOST_ELEMENTS {
            Value::Nothing
        } else {
            Value::List(list)
        })
    }

    fn element(&mut self, element: Element, depth: usize) -> Result<Value, String> {
        self.parts = self
            .parts
            .checked_sub(1)
            .ok_or_else(|| format!("it has more than {MOST_PARTS} parts"))?;
        Ok(match element {
            Element::Structure(index) => return self.structure(index, depth + 1),
            Element::Text => {
                // With a zero behind it.
                let length = self.count()?;
                let bytes = self.take(length)?;
                let bytes = bytes.strip_suffix(&[0]).unwrap_or(bytes);
                Value::Text(String::from_utf8_lossy(bytes).into())
            }
            Element::Bool => Value::Number(f64::from(u8::from(self.unsigned(1)? != 0))),
            Element::Unsigned(size) => Value::Number(self.unsigned(size)? as f64),
            Element::Signed(size) => {
                let unused = 64 - 8 * size;
                let raw = self.unsigned(size)? << unused;
                Value::Number((raw.cast_signed() >> unused) as f64)
            }
            Element::Float(4) => Value::Number(f32::from_bits(self.unsigned(4)? as u32).into()),
            Element::Float(_) => Value::Number(f64::from_bits(self.unsigned(8)?)),
        })
    }

    /// How many elements or bytes follow.
    fn count(&mut self) -> Result<usize, String> {
        Ok(self.unsigned(4)? as usize)
    }

    fn unsigned(&mut self, size: usize) -> Result<u64, String> {
        self.align(size);
        let bytes = self.take(size)?.iter();
        let sum = |sum: u64, byte: &u8| sum << 8 | u64::from(*byte);
        Ok(if self.little {
            bytes.rev().fold(0, sum)
        } else {
            bytes.fold(0, sum)
        })
    }

    fn align(&mut self, size: usize) {
        self.at = self.at.next_multiple_of(size);
    }

    fn take(&mut self, count: usize) -> Result<&'a [u8], String> {
        let end = self.at.saturating_add(count);
        let bytes = self
            .body
            .get(self.at..end)
            .ok_or_else(|| format!("it ends after {} bytes", self.body.len() + 4))?;
        self.at = end;
        Ok(bytes)
    }
}

/// Bytes of a number; none of what has no fixed size.
fn size(element: Element) -> Option<usize> {
    match element {
        Element::Bool => Some(1),
        Element::Signed(size) | Element::Unsigned(size) | Element::Float(size) => Some(size),
        Element::Text | Element::Structure(_) => None,
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn definitions(text: &str) -> Definitions {
        Definitions::parse("own/msg/Root", text).unwrap()
    }

    fn numbers(value: &Value) -> Vec<(String, f64)> {
        let mut found = Vec::new();
        value.leaves("", &mut |name, _, value| {
            found.extend(value.number().map(|number| (name.to_owned(), number)));
        });
        found
    }

    #[test]
    fn numbers_of_both_ends_are_aligned_behind_the_header() {
        let definitions = definitions("int8 a\nfloat64 b\nuint16[] c\nint32 d\nfloat32 e\nbool f");
        let mut little = vec![0, 1, 0, 0, 0xfe, 9, 9, 9, 9, 9, 9, 9];
        little.extend((-1.5_f64).to_le_bytes());
        little.extend(1_u32.to_le_bytes());
        little.extend(515_u16.to_le_bytes());
        little.extend([9, 9]);
        little.extend((-7_i32).to_le_bytes());
        little.extend(0.25_f32.to_le_bytes());
        little.push(1);
        let mut big = vec![0, 0, 0, 0, 0xfe, 9, 9, 9, 9, 9, 9, 9];
        big.extend((-1.5_f64).to_be_bytes());
        big.extend(1_u32.to_be_bytes());
        big.extend(515_u16.to_be_bytes());
        big.extend([9, 9]);
        big.extend((-7_i32).to_be_bytes());
        big.extend(0.25_f32.to_be_bytes());
        big.push(1);
        let expected = [
            (".a", -2.0),
            (".b", -1.5),
            (".c[0]", 515.0),
            (".d", -7.0),
            (".e", 0.25),
            (".f", 1.0),
        ]
        .map(|(name, number)| (name.to_owned(), number));
        for data in [&little, &big] {
            assert_eq!(numbers(&decode(&definitions, data).unwrap()), expected);
            for length in 0..data.len() {
                assert!(decode(&definitions, &data[..length]).is_err(), "{length}");
            }
        }
    }

    #[test]
    fn long_arrays_are_passed_over_and_what_follows_is_read() {
        let definitions = definitions("uint8[] image\nfloat64 b");
        let mut data = vec![0, 1, 0, 0];
        data.extend(2000_u32.to_le_bytes());
        data.extend([7; 2000]);
        data.extend([0; 4]);
        data.extend(2.5_f64.to_le_bytes());
        let value = decode(&definitions, &data).unwrap();
        assert_eq!(numbers(&value), [(".b".to_owned(), 2.5)]);
    }

    #[test]
    fn definitions_that_promise_too_much_end_in_words() {
        let endless = definitions("own/Root a");
        assert!(
            decode(&endless, &[0, 1, 0, 0])
                .unwrap_err()
                .contains("deep")
        );
        let bomb = definitions("A[4000000000] a\n===\nMSG: own/A\nint8[0] b");
        assert!(decode(&bomb, &[0, 1, 0, 0]).unwrap_err().contains("parts"));
        let long = definitions("float64[] a");
        let promised = [0, 1, 0, 0, 0xff, 0xff, 0xff, 0xff];
        let fault = decode(&long, &promised).unwrap_err();
        assert!(
            fault.contains("ends after 8 bytes, in its field `a`"),
            "{fault}"
        );
    }
}
