//! A URDF that is written and read again is the same mechanism.

use std::path::{Path, PathBuf};

use lagrange::urdf::{self, Options, Urdf};
use lagrange::{Lagrangian, state};

fn read(text: &str, options: &Options) -> Urdf {
    urdf::read(text, options).unwrap_or_else(|problems| panic!("{problems}\n{text}"))
}

/// Equal, entry by entry.
fn same<T: PartialEq + std::fmt::Debug>(first: &[T], again: &[T]) {
    assert_eq!(first.len(), again.len());
    for (a, b) in first.iter().zip(again) {
        assert_eq!(a, b);
    }
}

/// Everything that the text says of the mechanism, and its energies, are the same to the last bit.
fn comes_back(text: &str, options: &Options) {
    let first = read(text, options);
    let written = urdf::write(&first);
    let again = read(&written, options);
    assert_eq!(first.name, again.name);
    assert_eq!(first.joint_dynamics, again.joint_dynamics);
    let (a, b) = (&first.tree, &again.tree);
    assert_eq!(a.coordinates(), b.coordinates());
    same(a.joints(), b.joints());
    same(a.links(), b.links());
    same(a.bodies(), b.bodies());
    assert_eq!(a.gravity(), b.gravity());
    let mut x = 0.1_f64;
    let mut draw = || {
        x = (x * 997.0 + 0.377).fract();
        x
    };
    for _ in 0..5 {
        let q = state::random(a.coordinates(), &mut draw);
        let v: Vec<f64> = (0..a.nv()).map(|_| draw() - 0.5).collect();
        assert_eq!(a.kinetic(&q, &v), b.kinetic(&q, &v));
        assert_eq!(a.potential(&q), b.potential(&q));
        assert_eq!(a.link_poses(&q).unwrap(), b.link_poses(&q).unwrap());
    }
    // Nothing of what is written is unread.
    assert_eq!(written, urdf::write(&again));
    let unread = |w: &&lagrange::Problem| w.message.contains("is not read");
    assert_eq!(again.warnings.iter().find(unread), None);
}

/// All URDFs below a folder.
fn urdfs(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            urdfs(&path, found);
        } else if path.extension().is_some_and(|e| e == "urdf") {
            found.push(path);
        }
    }
}

#[test]
fn models_and_reference_robots_come_back() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut files = Vec::new();
    urdfs(&root.join("../../models"), &mut files);
    assert!(!files.is_empty());
    let robots = root.join("../../../shared/oracles");
    if robots.is_dir() {
        urdfs(&robots, &mut files);
    } else {
        eprintln!(
            "SKIPPED: there are no reference robots at {}",
            robots.display()
        );
    }
    for file in files {
        eprintln!("{}", file.display());
        let text = std::fs::read_to_string(&file).unwrap();
        for (floating_base, ignore_mimic) in [(false, false), (false, true), (true, false)] {
            let options = Options {
                source: file.display().to_string(),
                floating_base,
                ignore_mimic,
                ..Options::default()
            };
            comes_back(&text, &options);
        }
    }
}

#[test]
fn extreme_numbers_and_names_come_back() {
    let text = r#"<robot name="a &amp; b &lt;&quot;c&quot;&gt; 'd'&#10;e">
  <link name="base"/>
  <link name="tab&#9;ü&amp;"><inertial><origin xyz="1e-300 -0.0 0.1" rpy="0.1 1.5707963267948966 -3.141592653589793"/>
    <mass value="0.30000000000000004"/><inertia ixx="1e-22" ixy="0" ixz="0" iyy="1e-22" iyz="0" izz="1e-22"/></inertial></link>
  <link name="point"><inertial><origin xyz="30 20 10"/><mass value="1"/><inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial></link>
  <joint name="j" type="revolute"><parent link="base"/><child link="tab&#9;ü&amp;"/><origin rpy="0 -1.5707963267948966 0.7"/>
    <axis xyz="3 -1 7"/><limit lower="-inf" upper="1e99" effort="12345678901234567890" velocity="5e-324"/>
    <dynamics damping="1e-7" friction="0.1"/></joint>
  <joint name="k" type="prismatic"><parent link="tab&#9;ü&amp;"/><child link="point"/><axis xyz="0 0 -2"/>
    <limit lower="0" upper="1" effort="1" velocity="1"/><mimic joint="j" multiplier="-0.3333333333333333" offset="1e-3"/></joint>
</robot>"#;
    comes_back(text, &Options::default());
    let read = read(text, &Options::default());
    assert_eq!(read.name, "a & b <\"c\"> 'd'\ne");
    let limits = read.tree.joints()[0].limits.unwrap();
    assert_eq!((limits.lower, limits.velocity), (f64::NEG_INFINITY, 5e-324));
}
