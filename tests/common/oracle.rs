//! Reference data of other engines: where it lies, how it is read, and how numbers are compared with it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde_json::Value;

/// The folder of reference data, where there is one beside the checkout.
pub fn folder() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/oracles");
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!(
        "SKIPPED: there is no reference data at {}",
        folder.display()
    );
    None
}

pub fn json(path: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

pub fn numbers(value: &Value) -> Vec<f64> {
    let list = value.as_array().unwrap();
    list.iter().map(|x| x.as_f64().unwrap()).collect()
}

pub fn texts(value: &Value) -> Vec<&str> {
    let list = value.as_array().unwrap();
    list.iter().map(|x| x.as_str().unwrap()).collect()
}

/// What this project calls a coordinate that the reference calls `name`: `base_planar_x` is `base_planar.x` of a planar joint, and
/// `base_vx` … `base_wz` are the six velocities of `base`.
pub fn own_name(name: &str, coordinates: &[String]) -> (String, usize) {
    if coordinates.iter().any(|c| c == name) {
        return (name.to_owned(), 0);
    }
    let twist = ["vx", "vy", "vz", "wx", "wy", "wz"];
    match name.rsplit_once('_') {
        Some((joint, entry)) if twist.contains(&entry) => (
            joint.to_owned(),
            twist.iter().position(|t| *t == entry).unwrap(),
        ),
        Some((joint, entry)) => (format!("{joint}.{entry}"), 0),
        None => panic!("no coordinate `{name}` among {coordinates:?}"),
    }
}

/// The root link of a URDF on a chain of six massless joints: displacements along x, y, z of the world, then yaw, pitch and roll. Their
/// values are what the reference calls `base_x` … `base_roll`, true coordinates of a free body.
pub fn on_a_chain_of_angles(urdf: &str, root: &str) -> String {
    let mut joints = String::from("<link name=\"chain_world\"/>\n");
    let mut parent = String::from("chain_world");
    for (name, kind, axis) in [
        ("base_x", "prismatic", "1 0 0"),
        ("base_y", "prismatic", "0 1 0"),
        ("base_z", "prismatic", "0 0 1"),
        ("base_yaw", "continuous", "0 0 1"),
        ("base_pitch", "continuous", "0 1 0"),
        ("base_roll", "continuous", "1 0 0"),
    ] {
        let child = if name == "base_roll" {
            root.to_owned()
        } else {
            format!("chain_{name}")
        };
        if child != root {
            joints += &format!("<link name=\"{child}\"/>\n");
        }
        joints += &format!(
            "<joint name=\"{name}\" type=\"{kind}\"><parent link=\"{parent}\"/><child link=\"{child}\"/><axis xyz=\"{axis}\"/>\
             <limit lower=\"-100\" upper=\"100\" effort=\"1000\" velocity=\"100\"/></joint>\n"
        );
        parent = child;
    }
    let end = urdf.rfind("</robot>").unwrap();
    format!("{}{joints}{}", &urdf[..end], &urdf[end..])
}

/// `Derivative(x, t)` and `**`, as sympy writes them, in the language of text energies.
pub fn from_sympy(formula: &Value) -> String {
    let mut text = formula.as_str().unwrap().replace("**", "^");
    while let Some(start) = text.find("Derivative(") {
        let end = start + text[start..].find(')').unwrap();
        let inside = &text[start + "Derivative(".len()..end];
        let velocity = format!("{}_dot", inside.trim_end_matches(", t"));
        text.replace_range(start..=end, &velocity);
    }
    text
}

/// max |found − expected| / max |expected|; infinite where that is undefined and the two differ, or anything is NaN.
pub fn relative_error(found: &[f64], expected: &[f64]) -> f64 {
    assert_eq!(found.len(), expected.len());
    let size = expected.iter().fold(0.0, |s: f64, x| s.max(x.abs()));
    let mut worst = 0.0_f64;
    for (f, e) in found.iter().zip(expected) {
        let difference = (f - e).abs();
        if difference.is_nan() || (size == 0.0 && difference > 0.0) {
            return f64::INFINITY;
        }
        if difference > 0.0 {
            worst = worst.max(difference / size);
        }
    }
    worst
}

/// The largest relative errors found so far, by quantity.
pub struct Agreement {
    name: String,
    worst: BTreeMap<&'static str, f64>,
}

impl Agreement {
    pub fn of(name: impl Into<String>) -> Self {
        Agreement {
            name: name.into(),
            worst: BTreeMap::new(),
        }
    }

    /// Holds `found` against `expected`: the largest difference in units of the largest entry expected is at most `tolerance`.
    pub fn close(
        &mut self,
        what: &'static str,
        place: &str,
        found: &[f64],
        expected: &[f64],
        tolerance: f64,
    ) {
        let error = relative_error(found, expected);
        let worst = self.worst.entry(what).or_insert(0.0);
        *worst = worst.max(error);
        assert!(
            error <= tolerance,
            "{} {place}: {what} is off by {error:e}, tolerance {tolerance:e}:\n{found:?} against\n{expected:?}",
            self.name
        );
    }
}

impl Drop for Agreement {
    /// Says how well it agreed, failed or not.
    fn drop(&mut self) {
        if self.worst.is_empty() {
            return;
        }
        let list: Vec<String> = self
            .worst
            .iter()
            .map(|(what, error)| format!("{what} {error:.1e}"))
            .collect();
        eprintln!(
            "{}: largest relative errors: {}",
            self.name,
            list.join(", ")
        );
    }
}
