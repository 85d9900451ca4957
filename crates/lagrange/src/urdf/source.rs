//! What stands where in a URDF, and every fault of its elements, attributes and numbers.

use roxmltree::{Document, Node};

use super::names::nearest;
use super::report::{MAX_LISTED, Report, shown};
use super::schema::{Times, children, fault, fields};
use super::xml::EXPAND;

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

/// The elements that a motion depends on, as they are written.
const ELEMENTS: [&str; 12] = [
    "link", "joint", "inertial", "origin", "mass", "inertia", "parent", "child", "axis", "limit",
    "mimic", "dynamics",
];

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
        report.unread(at, format!("{what} is not read{times}{hint}"));
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
        let lower = what.to_lowercase();
        let meant = ELEMENTS
            .iter()
            .find(|element| strsim::osa_distance(&lower, element) <= 1);
        let hint = meant.map_or_else(String::new, |element| {
            format!("; did you mean <{element}>?")
        });
        self.count(format!("<{what}>"), hint, node.range().start);
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

    /// Checks the attributes and children of an element of `owner`, and those below. The nesting is bounded by [`MAX_DEPTH`](super::xml::MAX_DEPTH).
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
