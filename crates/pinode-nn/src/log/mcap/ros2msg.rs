//! Definitions of ROS 2 messages, the text of `.msg` files: a type for each line of `type name`.
//!
//! The definitions of all types that a message needs stand one after another in a schema, parted by a line of `=` and one that names
//! the type. See <https://docs.ros.org/en/rolling/Concepts/Basic/About-Interfaces.html>.

use std::collections::HashMap;
use std::rc::Rc;

/// All structures of a message.
#[derive(Debug)]
pub(super) struct Definitions {
    structures: Vec<Vec<Field>>,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Field {
    pub name: Rc<str>,
    pub element: Element,
    pub array: Array,
}

/// What a field holds, or the array of a field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Element {
    Bool,
    Signed(usize),
    /// Of so many bytes, as the others.
    Unsigned(usize),
    Float(usize),
    Text,
    /// By its index.
    Structure(usize),
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Array {
    None,
    Fixed(usize),
    Sequence,
}

impl Definitions {
    /// The definitions in the schema `text` of the type `root`, `package/msg/Type`.
    pub(super) fn parse(root: &str, text: &str) -> Result<Self, String> {
        let mut sections = vec![(short(root), Vec::new())];
        let mut parted = false;
        for line in text.lines() {
            // No string before a comment matters: defaults and constants are not read.
            let line = line.split('#').next().unwrap_or("").trim();
            if line.len() >= 3 && line.bytes().all(|byte| byte == b'=') {
                parted = true;
            } else if let (true, Some(name)) = (parted, line.strip_prefix("MSG:")) {
                sections.push((short(name.trim()), Vec::new()));
                parted = false;
            } else if let (false, Some((_, lines))) = (line.is_empty(), sections.last_mut()) {
                lines.push(line);
            }
        }
        // Times need not be defined in every file.
        for name in ["Time", "Duration"] {
            sections.push((
                format!("builtin_interfaces/{name}"),
                vec!["int32 sec", "uint32 nanosec"],
            ));
        }
        let mut indices = HashMap::new();
        for (index, (name, _)) in sections.iter().enumerate() {
            indices.entry(name.as_str()).or_insert(index);
        }
        let structures = sections.iter().map(|(name, lines)| {
            let package = name.split('/').next().unwrap_or("");
            let fields = lines.iter().map(|line| field(line, package, &indices));
            fields.filter_map(Result::transpose).collect()
        });
        Ok(Definitions {
            structures: structures.collect::<Result<_, String>>()?,
        })
    }

    /// The fields of the structure with the index `index`; the message is the one with 0.
    pub(super) fn fields(&self, index: usize) -> &[Field] {
        self.structures.get(index).map_or(&[], Vec::as_slice)
    }
}

/// `package/Type` of `package/msg/Type`.
fn short(name: &str) -> String {
    name.replace("/msg/", "/")
}

/// The field in a line; none where it is a constant.
fn field(
    line: &str,
    package: &str,
    indices: &HashMap<&str, usize>,
) -> Result<Option<Field>, String> {
    let mut words = line.split_whitespace();
    let (Some(spelled), Some(name)) = (words.next(), words.next()) else {
        return Err(format!("`{line}` is no field"));
    };
    let constant = name.contains('=') || words.next().is_some_and(|word| word.starts_with('='));
    if constant {
        return Ok(None);
    }
    let (base, array) = match spelled.split_once('[') {
        None => (spelled, Array::None),
        Some((base, "]")) => (base, Array::Sequence),
        Some((base, length)) => {
            let length = length.strip_suffix(']').unwrap_or(length);
            let array = match (length.strip_prefix("<="), length.parse()) {
                (Some(_), _) => Array::Sequence,
                (None, Ok(length)) => Array::Fixed(length),
                (None, Err(_)) => return Err(format!("`{spelled}` is no array")),
            };
            (base, array)
        }
    };
    let base = base.split("<=").next().unwrap_or(base);
    let element = match base {
        "bool" => Element::Bool,
        "byte" | "char" | "uint8" => Element::Unsigned(1),
        "uint16" => Element::Unsigned(2),
        "uint32" => Element::Unsigned(4),
        "uint64" => Element::Unsigned(8),
        "int8" => Element::Signed(1),
        "int16" => Element::Signed(2),
        "int32" => Element::Signed(4),
        "int64" => Element::Signed(8),
        "float32" => Element::Float(4),
        "float64" => Element::Float(8),
        "string" => Element::Text,
        "wstring" => return Err("it has a `wstring`".into()),
        other => {
            let own = format!("{package}/{other}");
            // Before ROS 2 had packages everywhere, headers had none.
            let name = match other {
                _ if other.contains('/') => short(other),
                "Header" if !indices.contains_key(own.as_str()) => "std_msgs/Header".into(),
                _ => own,
            };
            let index = indices.get(name.as_str());
            Element::Structure(*index.ok_or_else(|| format!("its type `{name}` is not defined"))?)
        }
    };
    Ok(Some(Field {
        name: name.into(),
        element,
        array,
    }))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn fields(text: &str) -> Vec<Field> {
        let definitions = Definitions::parse("own/msg/Root", text).unwrap();
        definitions.fields(0).to_vec()
    }

    #[test]
    fn comments_constants_bounds_and_defaults_are_no_fields() {
        let fields = fields(
            "# a\nint8 A=1 # one\nint8 B = 2\nstring<=5 C=\"#\"\n\nstring<=5 s \"a b\" # c\nuint8[<=3] u\nfloat32[2] f [0, 1]",
        );
        let found: Vec<_> = fields
            .iter()
            .map(|f| (&*f.name, f.element, f.array))
            .collect();
        assert_eq!(
            found,
            [
                ("s", Element::Text, Array::None),
                ("u", Element::Unsigned(1), Array::Sequence),
                ("f", Element::Float(4), Array::Fixed(2)),
            ]
        );
    }

    #[test]
    fn types_are_found_in_their_package_and_in_others() {
        let sections = "Part a\nother/Part b\nother/msg/Part c\nbuiltin_interfaces/Time d\n===\nMSG: other/Part\nint8 x\n===\nMSG: own/Part\nint8 y";
        let indices: Vec<_> = fields(sections).iter().map(|f| f.element).collect();
        assert_eq!(
            indices,
            [2, 1, 1, 3].map(Element::Structure),
            "own, other, other, built in"
        );
    }

    #[test]
    fn what_cannot_be_read_is_named() {
        for (text, words) in [
            ("Prat a", "`own/Prat` is not defined"),
            ("wstring a", "wstring"),
            ("int8[x] a", "`int8[x]` is no array"),
            ("int8", "`int8` is no field"),
        ] {
            let fault = Definitions::parse("own/msg/Root", text).unwrap_err();
            assert!(fault.contains(words), "{fault}");
        }
    }
}
