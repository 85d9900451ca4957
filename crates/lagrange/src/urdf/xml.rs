//! From the text to XML, within bounds that hold before any parser sees it.

use roxmltree::{Document, ParsingOptions};

use super::report::{Report, shown};

/// Longest text that is read, bytes.
const MAX_BYTES: usize = 16 << 20;

/// Deepest nesting of elements. A URDF needs six; recursive parsers overflow the stack at some thousands.
pub(super) const MAX_DEPTH: usize = 64;

/// Most attributes of one element; parsers compare each with each.
const MAX_ATTRIBUTES: usize = 200;

/// Most elements, comments and stretches of text.
const MAX_NODES: u32 = 400_000;

/// Parses the text within the bounds; nothing when there is no XML tree to look at.
pub fn parse<'t>(text: &'t str, report: &mut Report) -> Option<Document<'t>> {
    if text.len() > MAX_BYTES {
        report.error(0, format!("the text has {} bytes, at most {MAX_BYTES} (16 MiB) are read: leave meshes and plugins out of the URDF", text.len()));
        return None;
    }
    if text.trim().is_empty() {
        report.error(
            0,
            "the text is empty: a URDF starts with <robot name=\"…\">",
        );
        return None;
    }
    if let Some((at, message)) = scan(text) {
        report.error(at, message);
        return None;
    }
    let options = ParsingOptions {
        nodes_limit: MAX_NODES,
        ..ParsingOptions::default()
    };
    match Document::parse_with_options(text, options) {
        Ok(document) => Some(document),
        Err(error) => {
            let message = match &error {
                roxmltree::Error::UnknownNamespace(prefix, _) if prefix == "xacro" => {
                    format!("unexpanded xacro (prefix `xacro`): {EXPAND}")
                }
                roxmltree::Error::UnknownNamespace(prefix, _) => format!(
                    "the prefix {} is used but not declared: declare it by xmlns:… in <robot>, or remove the element",
                    shown(prefix)
                ),
                roxmltree::Error::NodesLimitReached => {
                    format!("the text has more than {MAX_NODES} elements")
                }
                other => format!("not well-formed XML: {}", cut(&other.to_string())),
            };
            report.error(offset_of(text, error.pos()), message);
            None
        }
    }
}

/// A message of the XML parser without its position, which ours carries, and of bounded length.
fn cut(message: &str) -> String {
    let message = message.split(" at ").next().unwrap_or(message);
    match message.char_indices().nth(200) {
        Some((end, _)) => message.get(..end).unwrap_or("").to_owned(),
        None => message.to_owned(),
    }
}

pub(super) const EXPAND: &str =
    "expand the file first (`xacro robot.urdf.xacro > robot.urdf`) and read the result";

fn offset_of(text: &str, position: roxmltree::TextPos) -> usize {
    let line: usize = text
        .split_inclusive('\n')
        .take((position.row as usize).saturating_sub(1))
        .map(str::len)
        .sum();
    let column = (position.col as usize).saturating_sub(1);
    let rest = text.get(line..).unwrap_or("");
    line + rest
        .char_indices()
        .nth(column)
        .map_or(rest.len(), |(i, _)| i)
}

/// One pass over the bytes, without recursion: no document type declaration (and so no entities), no deep nesting.
fn scan(text: &str) -> Option<(usize, String)> {
    let bytes = text.as_bytes();
    let (mut at, mut depth) = (0, 0_usize);
    while let Some(found) = find(bytes, at, b"<") {
        let rest = bytes.get(found..).unwrap_or_default();
        let skip = |end: &[u8]| find(bytes, found, end).map(|i| i + end.len());
        at = if rest.starts_with(b"<!--") {
            find(bytes, found + 4, b"-->")? + 3
        } else if rest.starts_with(b"<![CDATA[") {
            skip(b"]]>")?
        } else if rest.starts_with(b"<?") {
            skip(b"?>")?
        } else if rest.starts_with(b"<!") {
            return Some((
                found,
                "document type declarations and entities (<!DOCTYPE, <!ENTITY) are not read: remove the declaration".to_owned(),
            ));
        } else if rest.starts_with(b"</") {
            depth = depth.saturating_sub(1);
            skip(b">")?
        } else {
            let (end, attributes) = end_of_tag(bytes, found);
            if attributes > MAX_ATTRIBUTES {
                return Some((
                    found,
                    format!("the element has more than {MAX_ATTRIBUTES} attributes"),
                ));
            }
            let end = end?;
            let closed = end.checked_sub(1).and_then(|i| bytes.get(i)) == Some(&b'/');
            depth += usize::from(!closed);
            if depth > MAX_DEPTH {
                return Some((
                    found,
                    format!(
                        "elements are nested deeper than {MAX_DEPTH} levels; links and joints of a URDF stand side by side in <robot>"
                    ),
                ));
            }
            end + 1
        };
    }
    None
}

/// The `>` that ends the tag at `start`, not one within a quoted value; and the number of quoted values.
fn end_of_tag(bytes: &[u8], start: usize) -> (Option<usize>, usize) {
    let (mut quote, mut values) = (None, 0);
    for (i, &b) in bytes.iter().enumerate().skip(start) {
        match (quote, b) {
            (None, b'"' | b'\'') => {
                quote = Some(b);
                values += 1;
            }
            (None, b'>') => return (Some(i), values),
            (Some(q), _) if q == b => quote = None,
            _ => {}
        }
    }
    (None, values)
}

fn find(bytes: &[u8], from: usize, what: &[u8]) -> Option<usize> {
    let rest = bytes.get(from..)?;
    rest.windows(what.len())
        .position(|w| w == what)
        .map(|i| from + i)
}
