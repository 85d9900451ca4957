//! The limits of a URDF's joints, which stop nothing: where that is told.
#![cfg(feature = "cli")]

use std::path::Path;

use serde_json::Value;

use crate::program::{pinode, stderr};

const QUILL: &str = r#"<robot name="quill"><link name="base"/>
<link name="spindle"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<joint name="slide" type="prismatic"><parent link="base"/><child link="spindle"/><axis xyz="0 0 1"/>
<limit lower="-0.2" upper="0" effort="1" velocity="1"/></joint></robot>"#;

fn files(folder: &Path, effects: &str) {
    std::fs::write(folder.join("quill.urdf"), QUILL).unwrap();
    std::fs::write(
        folder.join("m.toml"),
        format!("urdf = 'quill.urdf'\n{effects}"),
    )
    .unwrap();
}

fn simulated(folder: &Path, duration: &str) -> String {
    let arguments = [
        "simulate",
        "m.toml",
        "--duration",
        duration,
        "--out",
        "o.csv",
    ];
    let output = pinode(&arguments, folder);
    assert!(output.status.success(), "{output:?}");
    stderr(&output)
}

/// A spindle that falls: 0.2 m after 0.2019 s.
#[test]
fn a_joint_that_falls_through_its_limit_is_told_once_with_the_stop_that_it_lacks() {
    let dir = tempfile::tempdir().unwrap();
    files(dir.path(), "");
    let told = simulated(dir.path(), "1");
    assert_eq!(told.matches("warning").count(), 1, "{told}");
    for part in [
        "`slide` is at -0.2163 m at t = 0.210000 s",
        "-0.2 … 0 m",
        "kind = \"end_stop\", joint = \"slide\"",
    ] {
        assert!(told.contains(part), "{part}: {told}");
    }
    assert_eq!(simulated(dir.path(), "0.2"), "");
}

#[test]
fn a_stop_that_gives_a_little_is_no_limit_that_is_passed() {
    let dir = tempfile::tempdir().unwrap();
    files(
        dir.path(),
        "[[effect]]\nkind = 'end_stop'\njoint = 'slide'\nlower = -0.2\nstiffness = 1e4\ndamping = 50.0\n",
    );
    assert_eq!(simulated(dir.path(), "1"), "");
}

#[test]
fn check_says_that_limits_do_not_stop_a_motion() {
    let dir = tempfile::tempdir().unwrap();
    files(dir.path(), "");
    let output = pinode(&["check", "m.toml"], dir.path());
    let told = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(told.contains("slide has the limits -0.2 … 0 m"), "{told}");
    assert!(
        told.contains("do not stop a motion") && told.contains("end_stop"),
        "{told}"
    );
    let output = pinode(&["check", "m.toml", "--json"], dir.path());
    let document: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(document["joints"][0]["limits"]["lower"], -0.2);
}
