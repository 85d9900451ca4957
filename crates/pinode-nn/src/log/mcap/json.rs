//! Messages in JSON.

use std::fmt;
use std::rc::Rc;

use serde::Deserialize;
use serde::de::{Deserializer, Error, IgnoredAny, MapAccess, SeqAccess, Visitor};

use super::value::{MOST_ELEMENTS, Value};

/// The message in `data`.
pub(super) fn decode(data: &[u8]) -> Result<Value, String> {
    serde_json::from_slice(data).map_err(|e| e.to_string())
}

impl<'de> Deserialize<'de> for Value {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(Tree)
    }
}

struct Tree;

impl<'de> Visitor<'de> for Tree {
    type Value = Value;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a JSON value")
    }

    fn visit_bool<E: Error>(self, value: bool) -> Result<Value, E> {
        Ok(Value::Number(value.into()))
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<Value, E> {
        Ok(Value::Number(value as f64))
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<Value, E> {
        Ok(Value::Number(value as f64))
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<Value, E> {
        Ok(Value::Number(value))
    }

    fn visit_str<E: Error>(self, value: &str) -> Result<Value, E> {
        Ok(Value::Text(value.into()))
    }

    fn visit_unit<E: Error>(self) -> Result<Value, E> {
        Ok(Value::Nothing)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut elements: A) -> Result<Value, A::Error> {
        let mut list = Vec::new();
        while list.len() < MOST_ELEMENTS {
            match elements.next_element()? {
                Some(element) => list.push(element),
                None => return Ok(Value::List(list)),
            }
        }
        let mut longer = false;
        while elements.next_element::<IgnoredAny>()?.is_some() {
            longer = true;
        }
        Ok(if longer {
            Value::Nothing
        } else {
            Value::List(list)
        })
    }

    fn visit_map<A: MapAccess<'de>>(self, mut entries: A) -> Result<Value, A::Error> {
        let mut fields: Vec<(Rc<str>, Value)> = Vec::new();
        while let Some((name, value)) = entries.next_entry::<String, Value>()? {
            fields.push((name.into(), value));
        }
        Ok(Value::Fields(fields))
    }
}
