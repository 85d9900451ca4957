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

/// Where the reference's coordinates stand among one's own, by their names.
pub struct Order {
    /// Place in q and in v of each of the reference's velocities.
    places: Vec<(usize, usize)>,
    nq: usize,
}

impl Order {
    /// `own` are name, nq and nv of one's own coordinates; `reference` are the names of the reference's velocities.
    pub fn new(own: &[(String, usize, usize)], reference: &[&str]) -> Self {
        let (mut nq, mut nv) = (0, 0);
        let mut starts = Vec::new();
        for (name, own_nq, own_nv) in own {
            starts.push((name.as_str(), nq, nv));
            (nq, nv) = (nq + own_nq, nv + own_nv);
        }
        let place = |name: &&str| {
            let start = |own: &str| starts.iter().find(|(n, ..)| *n == own);
            if let Some((_, q, v)) = start(name) {
                return (*q, *v);
            }
            // `base_planar_x` is our `base_planar.x`, and `base_vx` … `base_wz` are the six velocities of our `base`.
            let (joint, entry) = name.rsplit_once('_').unwrap();
            if let Some((_, q, v)) = start(&format!("{joint}.{entry}")) {
                return (*q, *v);
            }
            let twist = ["vx", "vy", "vz", "wx", "wy", "wz"];
            let k = twist.iter().position(|t| *t == entry);
            match (start(joint), k) {
                (Some((_, q, v)), Some(k)) => (q + k, v + k),
                _ => panic!("there is no `{name}` among {own:?}"),
            }
        };
        let places: Vec<(usize, usize)> = reference.iter().map(place).collect();
        assert_eq!(places.len(), nv, "{own:?} against {reference:?}");
        Order { places, nq }
    }

    pub fn nv(&self) -> usize {
        self.places.len()
    }

    /// q of a state of the reference.
    pub fn position(&self, state: &Value) -> Vec<f64> {
        let mut q = vec![0.0; self.nq];
        let given = numbers(&state["q"]);
        // Where the base floats, its pose is given beside q, the scalar of its quaternion last.
        let skip = self.nv() - given.len();
        for ((i, _), x) in self.places.iter().skip(skip).zip(given) {
            q[*i] = x;
        }
        if skip > 0 {
            let start = self.places[0].0;
            q[start..start + 3].copy_from_slice(&numbers(&state["base_position"]));
            let xyzw = numbers(&state["base_quaternion_xyzw"]);
            q[start + 3] = xyzw[3];
            q[start + 4..start + 7].copy_from_slice(&xyzw[..3]);
        }
        q
    }

    /// Velocities, accelerations or forces of the reference.
    pub fn vector(&self, value: &Value) -> Vec<f64> {
        let mut out = vec![0.0; self.nv()];
        let pairs = self.places.iter().zip(numbers(value));
        pairs.for_each(|((_, i), x)| out[*i] = x);
        out
    }

    /// A matrix of the reference, row by row.
    pub fn matrix(&self, value: &Value) -> Vec<f64> {
        let n = self.nv();
        let mut out = vec![0.0; n * n];
        for ((_, i), row) in self.places.iter().zip(value.as_array().unwrap()) {
            out[i * n..(i + 1) * n].copy_from_slice(&self.vector(row));
        }
        out
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
