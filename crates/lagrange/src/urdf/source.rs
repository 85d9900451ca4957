//! The text of a URDF: bounds that hold before any parser sees it, and what stands where in it.

use roxmltree::{Document, Node, ParsingOptions};

use super::schema::{Times, children, fault, fields};
use super::validate::nearest;
use crate::{Position, Problem};

/// Longest text that is read, bytes.
const MAX_BYTES: usize = 16 << 20;
/// Deepest nesting of elements. A URDF needs six; recursive parsers overflow the stack at some thousands.
const MAX_DEPTH: usize = 64;
/// Most attributes of one element; parsers compare each with each.
const MAX_ATTRIBUTES: usize = 200;
/// Most elements, comments and stretches of text.
const MAX_NODES: u32 = 400_000;
/// Most links, and most joints.
const MAX_LINKS: usize = 10_000;

/// A name or value with the byte at which it stands.
#[derive(Debug, Clone)]
pub struct At<T> {
    pub value: T,
    pub at: usize,
}

/// What the validation needs of a `<link>`.
pub struct LinkText {
    pub name: At<String>,
    pub inertial: Option<InertialText>,
}

/// What the validation needs of an `<inertial>`; nothing where it cannot be read.
pub struct InertialText {
    pub at: usize,
    pub mass: Option<At<f64>>,
    /// ixx, ixy, ixz, iyy, iyz, izz.
    pub inertia: Option<At<[f64; 6]>>,
}

/// What the validation needs of a `<joint>`; nothing where it cannot be read.
pub struct JointText {
    pub name: At<String>,
    pub kind: Option<At<String>>,
    pub parent: Option<At<String>>,
    pub child: Option<At<String>>,
    pub axis: Option<At<[f64; 3]>>,
    pub limit: Option<At<(Option<f64>, Option<f64>)>>,
    /// damping, friction.
    pub dynamics: Option<At<[f64; 2]>>,
    /// Leader and multiplier.
    pub mimic: Option<At<(String, f64)>>,
}

/// A URDF as it stands in the text.
#[derive(Default)]
pub struct Source {
    /// Whether the links and joints are worth no look: the root is no robot, or xacro is left in it.
    pub abandoned: bool,
    pub links: Vec<LinkText>,
    pub joints: Vec<JointText>,
}

/// Errors and warnings under way, by the byte that they are about.
pub struct Report<'t> {
    text: &'t str,
    errors: Vec<(usize, String)>,
    warnings: Vec<(usize, String)>,
}

impl<'t> Report<'t> {
    pub fn new(text: &'t str) -> Self {
        Report {
            text,
            errors: Vec::new(),
            warnings: Vec::new(),
        }
    }
    pub fn error(&mut self, at: usize, message: impl Into<String>) {
        self.errors.push((at, message.into()));
    }
    pub fn warning(&mut self, at: usize, message: impl Into<String>) {
        self.warnings.push((at, message.into()));
    }
    pub fn failed(&self) -> bool {
        !self.errors.is_empty()
    }
    /// Whether so much is wrong already that hints are not worth their time.
    pub fn is_long(&self) -> bool {
        self.errors.len() >= 20
    }
    /// ` in line …` for a byte; nothing where so much is wrong that it is not worth the time.
    pub fn line(&self, at: usize) -> String {
        if self.is_long() {
            return String::new();
        }
        format!(" in line {}", Position::of(self.text, at).line)
    }
    pub fn into_errors(self) -> Vec<Problem> {
        located(self.text, self.errors)
    }
    pub fn into_warnings(self) -> Vec<Problem> {
        located(self.text, self.warnings)
    }
}

/// Most problems that are listed one by one.
const MAX_LISTED: usize = 200;

/// The problems in the order of the text. The list is cut, so that a large broken file does not take long to report.
fn located(text: &str, mut list: Vec<(usize, String)>) -> Vec<Problem> {
    list.sort_by_key(|&(at, _)| at);
    let more = list.len().saturating_sub(MAX_LISTED);
    // Positions are counted on from one problem to the next, in one pass over the text.
    let (mut line, mut column, mut counted) = (1, 1, 0);
    let mut problems: Vec<Problem> = list
        .into_iter()
        .take(MAX_LISTED)
        .map(|(at, message)| {
            let between = text.get(counted..at).unwrap_or("");
            match between.rsplit_once('\n') {
                Some((before, last)) => {
                    line += before.matches('\n').count() + 1;
                    column = 1 + last.chars().count();
                }
                None => column += between.chars().count(),
            }
            counted = at;
            Problem::at(Position { line, column }, message)
        })
        .collect();
    if more > 0 {
        problems.push(Problem::general(format!("and {more} more of the kind")));
    }
    problems
}

/// A name in a message: cut where it is very long.
pub fn shown(name: &str) -> String {
    match name.char_indices().nth(60) {
        Some((end, _)) => format!("`{}…`", name.get(..end).unwrap_or("")),
        None => format!("`{name}`"),
    }
}

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

const EXPAND: &str =
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

/// Walks through the document: the links and joints in it, and every fault of elements, attributes and numbers.
pub fn collect(document: &Document, report: &mut Report) -> Source {
    let robot = document.root_element();
    let mut source = Source::default();
    if robot.tag_name().name() != "robot" {
        let found = shown(robot.tag_name().name());
        let hint = match robot.tag_name().name() {
            "sdf" => " (this is SDF: convert it to URDF)",
            "mujoco" => " (this is MJCF: convert it to URDF)",
            _ => "",
        };
        report.error(
            robot.range().start,
            format!("the root element is {found}, a URDF's is <robot>{hint}"),
        );
        source.abandoned = true;
        return source;
    }
    if xacro_leftovers(document, report) {
        source.abandoned = true;
        return source;
    }
    let newer = robot.attribute("version").is_some_and(is_version_1_2);
    let mut walk = Walk {
        report,
        newer,
        unread: Vec::new(),
    };
    if robot.attribute("name").is_none() {
        walk.report
            .warning(robot.range().start, "<robot> has no name: add name=\"…\"");
    }
    for node in robot.children().filter(Node::is_element) {
        match node.tag_name().name() {
            "link" => {
                let link = walk.link(&node);
                source.links.push(link);
            }
            "joint" => {
                let joint = walk.joint(&node);
                source.joints.push(joint);
            }
            "material" => {
                walk.required(&node, "name");
            }
            _ => walk.unread(&node),
        }
    }
    for Unread {
        what,
        hint,
        at,
        count,
    } in std::mem::take(&mut walk.unread)
    {
        let times = if count > 1 {
            format!(" ({count} times)")
        } else {
            String::new()
        };
        report.warning(at, format!("{what} is not read{times}{hint}"));
    }
    for (what, count) in [
        ("links", source.links.len()),
        ("joints", source.joints.len()),
    ] {
        if count > MAX_LINKS {
            report.error(
                robot.range().start,
                format!("there are {count} {what}, at most {MAX_LINKS} are read"),
            );
        }
    }
    source
}

fn is_version_1_2(version: &str) -> bool {
    let mut parts = version.trim().splitn(2, '.').map(str::parse::<u32>);
    match (parts.next(), parts.next()) {
        (Some(Ok(major)), Some(Ok(minor))) => (major, minor) >= (1, 2),
        _ => false,
    }
}

/// Reports elements of xacro and `${…}`, `$(…)` in links and joints.
fn xacro_leftovers(document: &Document, report: &mut Report) -> bool {
    for node in document.descendants().filter(Node::is_element) {
        if node
            .tag_name()
            .namespace()
            .is_some_and(|n| n.contains("xacro"))
        {
            let name = shown(node.tag_name().name());
            report.error(
                node.range().start,
                format!("unexpanded xacro element {name}: {EXPAND}"),
            );
        }
    }
    let robot = document.root_element();
    let parts = robot
        .children()
        .filter(|n| n.has_tag_name("link") || n.has_tag_name("joint"));
    for attribute in parts
        .flat_map(|n| n.descendants())
        .flat_map(|n| n.attributes())
    {
        let value = attribute.value();
        if value.contains("${") || value.contains("$(") {
            let (name, value) = (attribute.name(), shown(value));
            report.error(
                attribute.range().start,
                format!("unexpanded xacro in {name}={value}: {EXPAND}"),
            );
        }
    }
    report.failed()
}

struct Walk<'r, 't> {
    report: &'r mut Report<'t>,
    /// URDF 1.2 or later: limits may be left out.
    newer: bool,
    unread: Vec<Unread>,
}

/// A kind of element or attribute that is not read, its first place and how often it stands in the text.
struct Unread {
    what: String,
    hint: String,
    at: usize,
    count: usize,
}

impl Walk<'_, '_> {
    fn link(&mut self, node: &Node) -> LinkText {
        let name = self.required(node, "name");
        self.check(node, &format!("link {}", shown(&name.value)));
        let inertial = child(node, "inertial").map(|inertial| InertialText {
            at: inertial.range().start,
            mass: child(&inertial, "mass").and_then(|m| {
                numbers_of(&m, ["value"]).map(|v| At {
                    value: v.value[0],
                    at: v.at,
                })
            }),
            inertia: child(&inertial, "inertia")
                .and_then(|i| numbers_of(&i, ["ixx", "ixy", "ixz", "iyy", "iyz", "izz"])),
        });
        LinkText { name, inertial }
    }

    fn joint(&mut self, node: &Node) -> JointText {
        let name = self.required(node, "name");
        self.check(node, &format!("joint {}", shown(&name.value)));
        let link = |element| child(node, element).and_then(|n| text_of(&n, "link"));
        JointText {
            kind: text_of(node, "type"),
            parent: link("parent"),
            child: link("child"),
            axis: child(node, "axis").and_then(|n| {
                let values = parse_numbers(n.attribute("xyz")?)?;
                Some(At {
                    value: values.try_into().ok()?,
                    at: n.range().start,
                })
            }),
            limit: child(node, "limit").map(|n| At {
                value: (optional(&n, "lower"), optional(&n, "upper")),
                at: n.range().start,
            }),
            dynamics: child(node, "dynamics").map(|n| At {
                value: ["damping", "friction"].map(|a| optional(&n, a).unwrap_or(0.0)),
                at: n.range().start,
            }),
            mimic: child(node, "mimic").and_then(|n| {
                let leader = text_of(&n, "joint")?;
                Some(At {
                    value: (leader.value, optional(&n, "multiplier").unwrap_or(1.0)),
                    at: leader.at,
                })
            }),
            name,
        }
    }

    /// A name that must be there; reported by [`check`](Self::check) when it is not, by this when it is empty.
    fn required(&mut self, node: &Node, attribute: &str) -> At<String> {
        let found = text_of(node, attribute);
        if found
            .as_ref()
            .is_some_and(|name| name.value.trim().is_empty())
        {
            let element = node.tag_name().name();
            self.report.error(
                node.range().start,
                format!("<{element}> has an empty {attribute}: give it one of its own"),
            );
        }
        found.unwrap_or(At {
            value: String::new(),
            at: node.range().start,
        })
    }

    fn unread(&mut self, node: &Node) {
        let what = shown(node.tag_name().name()).replace('`', "");
        self.count(format!("<{what}>"), String::new(), node.range().start);
    }

    fn count(&mut self, what: String, hint: String, at: usize) {
        if let Some(known) = self.unread.iter_mut().find(|u| u.what == what) {
            known.count += 1;
        } else if self.unread.len() < MAX_LISTED {
            self.unread.push(Unread {
                what,
                hint,
                at,
                count: 1,
            });
        }
    }

    /// Checks the attributes and children of an element of `owner`, and those below. The nesting is bounded by [`MAX_DEPTH`].
    fn check(&mut self, node: &Node, owner: &str) {
        let element = node.tag_name().name();
        let Some(fields) = fields(element, self.newer) else {
            return;
        };
        let at = node.range().start;
        for field in fields {
            match node.attribute_node(field.name) {
                Some(attribute) => {
                    if let Some(fault) = fault(attribute.value(), field) {
                        let (name, value) = (field.name, shown(attribute.value()));
                        self.report.error(
                            attribute.range().start,
                            format!("{owner}: <{element}> has {name}={value}: {fault}"),
                        );
                    }
                }
                None if field.required => {
                    self.report.error(
                        at,
                        format!("{owner}: <{element}> lacks the attribute `{}`", field.name),
                    );
                }
                None => {}
            }
        }
        for attribute in node.attributes().filter(|a| a.namespace().is_none()) {
            if fields.iter().all(|f| f.name != attribute.name()) {
                let hint = nearest(attribute.name(), fields.iter().map(|f| f.name));
                let what = format!("the attribute {} of <{element}>", shown(attribute.name()));
                self.count(what, hint, attribute.range().start);
            }
        }
        let expected = children(element);
        for (name, times) in expected {
            let mut found = node.children().filter(|n| n.has_tag_name(*name));
            match (times, found.next(), found.next()) {
                (Times::Once, None, _) => {
                    self.report
                        .error(at, format!("{owner}: <{element}> lacks <{name}>"));
                }
                (Times::Once | Times::AtMostOnce, _, Some(second)) => {
                    self.report.error(
                        second.range().start,
                        format!("{owner}: <{element}> has a second <{name}>: keep one of them"),
                    );
                }
                _ => {}
            }
        }
        if element == "geometry"
            && !node
                .children()
                .any(|n| expected.iter().any(|(e, _)| n.has_tag_name(*e)))
        {
            self.report.error(
                at,
                format!("{owner}: <geometry> has no box, cylinder, capsule, sphere or mesh"),
            );
        }
        for inner in node.children().filter(Node::is_element) {
            if expected.iter().any(|(name, _)| inner.has_tag_name(*name)) {
                self.check(&inner, owner);
            } else {
                self.unread(&inner);
            }
        }
    }
}

fn child<'a, 'i>(node: &Node<'a, 'i>, name: &'static str) -> Option<Node<'a, 'i>> {
    node.children().find(|n| n.has_tag_name(name))
}

fn text_of(node: &Node, attribute: &str) -> Option<At<String>> {
    node.attribute_node(attribute).map(|a| At {
        value: a.value().to_owned(),
        at: a.range().start,
    })
}

fn optional(node: &Node, attribute: &str) -> Option<f64> {
    node.attribute(attribute)?
        .trim()
        .parse()
        .ok()
        .filter(|x: &f64| !x.is_nan())
}

/// Finite numbers, all of them or nothing.
fn parse_numbers(value: &str) -> Option<Vec<f64>> {
    value
        .split_whitespace()
        .map(|word| word.parse().ok().filter(|x: &f64| x.is_finite()))
        .collect()
}

fn numbers_of<const N: usize>(node: &Node, attributes: [&str; N]) -> Option<At<[f64; N]>> {
    let mut value = [0.0; N];
    for (slot, attribute) in value.iter_mut().zip(attributes) {
        *slot = optional(node, attribute).filter(|x| x.is_finite())?;
    }
    Some(At {
        value,
        at: node.range().start,
    })
}
