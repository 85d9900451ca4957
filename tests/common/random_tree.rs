//! Random kinematic trees as URDF text.

use std::fmt::Write;

use proptest::prelude::*;
use proptest::sample::Index;

/// A link and the joint that moves it.
#[derive(Debug, Clone)]
pub struct RandomBody {
    kind: &'static str,
    /// Which of the links before this one carries it.
    parent: Index,
    axis: [f64; 3],
    xyz: [f64; 3],
    rpy: [f64; 3],
    mass: f64,
    /// Centre of mass and axes of the inertia in the link's frame.
    centre: [f64; 3],
    turn: [f64; 3],
    /// ∫x², ∫y², ∫z² over the mass, per kg, m².
    spread: [f64; 3],
}

/// A body on a joint of one of `kinds`, with a rotated inertia. Axes are oblique or along x, y, z, and half of the frames are not
/// turned, so that axes are often parallel or vertical.
pub fn body(kinds: &'static [&'static str]) -> impl Strategy<Value = RandomBody> {
    let oblique = [-1.0..1.0, -1.0..1.0, -1.0..1.0];
    let axis = prop_oneof![
        oblique.prop_filter("too short to have a direction", |a| {
            a.iter().map(|x| x * x).sum::<f64>() > 0.05
        }),
        prop::sample::select(vec![
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, -1.0, 0.0],
            [0.0, 0.0, 1.0],
        ]),
    ];
    let rpy = prop_oneof![Just([0.0; 3]), triple(3.0)];
    let joint = (
        prop::sample::select(kinds),
        any::<Index>(),
        axis,
        triple(0.4),
        rpy,
    );
    let inertia = (
        0.2..3.0,
        triple(0.3),
        triple(3.0),
        [0.002..0.05, 0.002..0.05, 0.002..0.05],
    );
    (joint, inertia).prop_map(
        |((kind, parent, axis, xyz, rpy), (mass, centre, turn, spread))| RandomBody {
            kind,
            parent,
            axis,
            xyz,
            rpy,
            mass,
            centre,
            turn,
            spread,
        },
    )
}

fn triple(range: f64) -> impl Strategy<Value = [f64; 3]> {
    [-range..range, -range..range, -range..range]
}

/// The tree of `bodies`: link and joint k+1 hang on one of the links 0 … k, of which 0 is the root; its mass counts where it floats.
pub fn urdf(bodies: &[RandomBody]) -> String {
    let mut text = String::from(
        r#"<robot name="random">
<link name="l0"><inertial><origin xyz="0.1 -0.2 0.05" rpy="0.3 0.2 0.1"/><mass value="1.3"/>
  <inertia ixx="0.04" ixy="0.003" ixz="0" iyy="0.05" iyz="-0.002" izz="0.03"/></inertial></link>
"#,
    );
    for (k, body) in bodies.iter().enumerate() {
        let [x, y, z] = body.spread.map(|s| s * body.mass);
        // Half of the bodies hang on the one before, so that the trees are deep as well as wide.
        let parent = if k % 2 == 1 {
            k
        } else {
            body.parent.index(k + 1)
        };
        let child = k + 1;
        let _ = writeln!(
            text,
            r#"<link name="l{child}"><inertial><origin xyz="{}" rpy="{}"/><mass value="{}"/>
  <inertia ixx="{}" ixy="0" ixz="0" iyy="{}" iyz="0" izz="{}"/></inertial></link>
<joint name="j{child}" type="{}"><parent link="l{parent}"/><child link="l{child}"/>
  <origin xyz="{}" rpy="{}"/><axis xyz="{}"/><limit lower="-9" upper="9" effort="9" velocity="9"/></joint>"#,
            numbers(body.centre),
            numbers(body.turn),
            body.mass,
            y + z,
            x + z,
            x + y,
            body.kind,
            numbers(body.xyz),
            numbers(body.rpy),
            numbers(body.axis),
        );
    }
    text + "</robot>"
}

fn numbers([x, y, z]: [f64; 3]) -> String {
    format!("{x} {y} {z}")
}
