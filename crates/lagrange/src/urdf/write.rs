//! From the tree back to the text.

use std::fmt::{Result, Write};

use nalgebra::Vector3;

use super::Urdf;
use crate::mechanism::{Inertial, Joint, JointKind, Placement};

pub fn write(urdf: &Urdf) -> String {
    let mut text = String::new();
    // Writing to a String cannot fail.
    let _ = robot(urdf, &mut text);
    text
}

fn robot(urdf: &Urdf, out: &mut String) -> Result {
    writeln!(out, "<?xml version=\"1.0\"?>")?;
    writeln!(out, "<robot name=\"{}\">", quoted(&urdf.name))?;
    for link in urdf.tree.links() {
        let name = quoted(&link.name);
        match &link.inertial {
            None => writeln!(out, "  <link name=\"{name}\"/>")?,
            Some(inertial) => {
                writeln!(out, "  <link name=\"{name}\">")?;
                self::inertial(inertial, out)?;
                writeln!(out, "  </link>")?;
            }
        }
    }
    for joint in urdf.tree.joints() {
        self::joint(joint, out)?;
    }
    writeln!(out, "</robot>")
}

fn inertial(inertial: &Inertial, out: &mut String) -> Result {
    writeln!(out, "    <inertial>")?;
    origin("      ", &inertial.origin, out)?;
    writeln!(out, "      <mass value=\"{}\"/>", number(inertial.mass))?;
    write!(out, "      <inertia")?;
    let names = ["ixx", "ixy", "ixz", "iyy", "iyz", "izz"];
    for (name, &entry) in names.iter().zip(&inertial.inertia) {
        write!(out, " {name}=\"{}\"", number(entry))?;
    }
    writeln!(out, "/>\n    </inertial>")
}

fn joint(joint: &Joint, out: &mut String) -> Result {
    let (name, kind) = (quoted(&joint.name), joint.kind.name());
    writeln!(out, "  <joint name=\"{name}\" type=\"{kind}\">")?;
    writeln!(out, "    <parent link=\"{}\"/>", quoted(&joint.parent))?;
    writeln!(out, "    <child link=\"{}\"/>", quoted(&joint.child))?;
    origin("    ", &joint.origin, out)?;
    let used = !matches!(joint.kind, JointKind::Fixed | JointKind::Floating);
    if used || joint.axis != Vector3::x() {
        writeln!(out, "    <axis xyz=\"{}\"/>", numbers(joint.axis.into()))?;
    }
    if let Some(limits) = &joint.limits {
        writeln!(
            out,
            "    <limit lower=\"{}\" upper=\"{}\" effort=\"{}\" velocity=\"{}\"/>",
            number(limits.lower),
            number(limits.upper),
            number(limits.effort),
            number(limits.velocity)
        )?;
    }
    if joint.damping != 0.0 || joint.friction != 0.0 {
        let (damping, friction) = (number(joint.damping), number(joint.friction));
        writeln!(
            out,
            "    <dynamics damping=\"{damping}\" friction=\"{friction}\"/>"
        )?;
    }
    if let Some(mimic) = &joint.mimic {
        writeln!(
            out,
            "    <mimic joint=\"{}\" multiplier=\"{}\" offset=\"{}\"/>",
            quoted(&mimic.leader),
            number(mimic.multiplier),
            number(mimic.offset)
        )?;
    }
    writeln!(out, "  </joint>")
}

fn origin(indent: &str, placement: &Placement, out: &mut String) -> Result {
    let (xyz, rpy) = (numbers(placement.xyz), numbers(placement.rpy));
    writeln!(out, "{indent}<origin xyz=\"{xyz}\" rpy=\"{rpy}\"/>")
}

fn numbers([x, y, z]: [f64; 3]) -> String {
    format!("{} {} {}", number(x), number(y), number(z))
}

/// The shortest decimal that is read as the same number; whole numbers without a point.
fn number(x: f64) -> String {
    let text = format!("{x:?}");
    match text.strip_suffix(".0") {
        Some(whole) => whole.to_owned(),
        None => text,
    }
}

/// A name as the value of an attribute. Line ends and tabs would be read as blanks, unless they are written by number.
fn quoted(name: &str) -> String {
    let mut out = String::with_capacity(name.len());
    for c in name.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\n' => out.push_str("&#10;"),
            '\r' => out.push_str("&#13;"),
            '\t' => out.push_str("&#9;"),
            c => out.push(c),
        }
    }
    out
}
