//! A message as a tree, whatever its encoding, and the numbers in it by their names.

use std::rc::Rc;

/// Longer arrays, such as images, hold no signals.
pub(super) const MOST_ELEMENTS: usize = 1024;
/// Arrays of strings that name the elements of the arrays beside them.
const NAMES: [&str; 2] = ["name", "joint_names"];

/// A message or a part of one.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Value {
    Number(f64),
    Text(Rc<str>),
    List(Vec<Value>),
    Fields(Vec<(Rc<str>, Value)>),
    /// A null, or an array that is too long.
    Nothing,
}

/// One step down the tree.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Step {
    Field(Rc<str>),
    Index(usize),
    /// The element of the array `field` that stands where `name` does in the array of names beside it.
    Named {
        field: Rc<str>,
        name: Rc<str>,
    },
}

impl Value {
    pub(super) fn field(&self, name: &str) -> Option<&Value> {
        let Value::Fields(fields) = self else {
            return None;
        };
        let found = fields.iter().find(|(field, _)| &**field == name);
        found.map(|(_, value)| value)
    }

    pub(super) fn number(&self) -> Option<f64> {
        match self {
            Value::Number(number) => Some(*number),
            _ => None,
        }
    }

    /// What stands at the end of `path`.
    pub(super) fn at(&self, path: &[Step]) -> Option<&Value> {
        let Some((step, rest)) = path.split_first() else {
            return Some(self);
        };
        let next = match step {
            Step::Field(name) => self.field(name)?,
            Step::Index(index) => self.element(*index)?,
            Step::Named { field, name } => {
                let list = self.field(field)?;
                let index = self.names(list)?.position(|other| other == name)?;
                list.element(index)?
            }
        };
        next.at(rest)
    }

    fn element(&self, index: usize) -> Option<&Value> {
        match self {
            Value::List(elements) => elements.get(index),
            _ => None,
        }
    }

    /// The names beside `list`, one of these fields: of an array of strings of the same length.
    fn names(&self, list: &Value) -> Option<impl Iterator<Item = &Rc<str>>> {
        let Value::List(elements) = list else {
            return None;
        };
        let names = NAMES.iter().find_map(|name| match self.field(name)? {
            Value::List(names) if names.len() == elements.len() => Some(names),
            _ => None,
        })?;
        let texts = names.iter().map_while(|name| match name {
            Value::Text(text) => Some(text),
            _ => None,
        });
        (texts.clone().count() == elements.len()).then_some(texts)
    }

    /// Tells `found` the name, the way and the value of every number and text.
    pub(super) fn leaves(&self, topic: &str, found: &mut impl FnMut(&str, &[Step], &Value)) {
        self.descend(&mut topic.to_owned(), &mut Vec::new(), found);
    }

    fn descend(
        &self,
        name: &mut String,
        path: &mut Vec<Step>,
        found: &mut impl FnMut(&str, &[Step], &Value),
    ) {
        let length = name.len();
        match self {
            Value::Number(_) | Value::Text(_) => found(name, path, self),
            Value::Nothing => {}
            Value::List(elements) => {
                for (index, element) in elements.iter().enumerate() {
                    name.push_str(&format!("[{index}]"));
                    path.push(Step::Index(index));
                    element.descend(name, path, found);
                    path.pop();
                    name.truncate(length);
                }
            }
            Value::Fields(fields) => {
                for (field, value) in fields {
                    name.push('.');
                    name.push_str(field);
                    let named = match self.names(value) {
                        Some(names) if !NAMES.contains(&&**field) => names.collect(),
                        _ => Vec::new(),
                    };
                    if let (Value::List(elements), false) = (value, named.is_empty()) {
                        let length = name.len();
                        for (element, own) in elements.iter().zip(named) {
                            name.push_str(&format!("[{own}]"));
                            path.push(Step::Named {
                                field: field.clone(),
                                name: own.clone(),
                            });
                            element.descend(name, path, found);
                            path.pop();
                            name.truncate(length);
                        }
                    } else {
                        path.push(Step::Field(field.clone()));
                        value.descend(name, path, found);
                        path.pop();
                    }
                    name.truncate(length);
                }
            }
        }
    }
}
