//! Planar and floating joints and floating bases: their coordinates, where they take their links, and what is said of them.

use std::f64::consts::FRAC_PI_2;

use approx::assert_relative_eq;
use lagrange::mechanism::{Angles, Axis, JointKind, PoseForm, Tree};
use lagrange::urdf::{self, Options, Urdf};
use lagrange::{Dynamics, Lagrangian, Mechanics};
use nalgebra::{Isometry3, Matrix3, Rotation3, Unit, Vector3};

const BRICK: &str = r#"<inertial><mass value="2"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.2" iyz="0" izz="0.25"/></inertial>"#;

/// base –j→ a –k→ b, with a brick in a and in b.
fn two_joints(j: &str, k: &str) -> String {
    format!(
        r#"<robot name="r"><link name="base"/><link name="a">{BRICK}</link><link name="b">{BRICK}</link>
{j}
{k}
</robot>"#
    )
}

fn joint(name: &str, kind: &str, parent: &str, child: &str, more: &str) -> String {
    format!(
        r#"<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{more}</joint>"#
    )
}

fn read(text: &str, options: &Options) -> Urdf {
    urdf::read(text, options).unwrap_or_else(|problems| panic!("{problems}\n{text}"))
}

fn refused(text: &str, options: &Options) -> String {
    match urdf::read(text, options) {
        Ok(_) => panic!("this URDF is broken\n{text}"),
        Err(problems) => problems.to_string(),
    }
}

fn floating() -> Options {
    Options {
        floating_base: true,
        ..Options::default()
    }
}

fn names(tree: &Tree) -> Vec<&str> {
    tree.coordinates().iter().map(|c| c.name.as_str()).collect()
}

fn is(pose: &Isometry3<f64>, position: Vector3<f64>, rotation: &Rotation3<f64>) {
    assert_relative_eq!(pose.translation.vector, position, epsilon = 1e-14);
    assert_relative_eq!(
        pose.rotation.to_rotation_matrix().into_inner(),
        *rotation.matrix(),
        epsilon = 1e-14
    );
}

#[test]
fn a_planar_joint_moves_in_the_plane_and_turns_about_its_normal() {
    let (x, y, z) = (Vector3::x(), Vector3::y(), Vector3::z());
    // Normal, and the directions of the two displacements in the joint's frame.
    for (axis, [along_x, along_y]) in [
        ("0 0 1", [x, y]),
        ("0 0 -3", [x, -y]),
        ("1 0 0", [-z, y]),
        ("-1 0 0", [z, y]),
        ("0 2 0", [x, -z]),
        ("0 -1 0", [x, z]),
    ] {
        let more = format!(r#"<origin xyz="0.1 0.2 0.3"/><axis xyz="{axis}"/>"#);
        let text = two_joints(
            &joint("p", "planar", "base", "a", &more),
            &joint("k", "fixed", "a", "b", ""),
        );
        let tree = read(&text, &Options::default()).tree;
        assert_eq!(names(&tree), ["p.x", "p.y", "p.theta"]);
        let unit: Vec<&str> = tree.coordinates().iter().map(|c| c.unit()).collect();
        assert_eq!(unit, ["m", "m", "rad"]);
        assert!(tree.coordinates()[2].wraps && tree.coordinates()[0].joint == "p");
        assert_eq!(tree.joints()[0].kind, JointKind::Planar);
        let normal = Unit::new_normalize(tree.joints()[0].axis);
        assert_relative_eq!(along_x.cross(&along_y), normal.into_inner());
        let pose = tree.link_poses(&[0.5, -0.7, 0.9]).unwrap()[1];
        let position = Vector3::new(0.1, 0.2, 0.3) + along_x * 0.5 - along_y * 0.7;
        is(&pose, position, &Rotation3::from_axis_angle(&normal, 0.9));
        // Velocities are the rates of the coordinates, wherever it has turned to.
        let kinetic = tree.kinetic(&[0.5, -0.7, 0.9], &[3.0, 4.0, 0.0]);
        assert_relative_eq!(kinetic, 0.5 * 4.0 * 25.0, max_relative = 1e-14);
    }
}

#[test]
fn the_plane_of_an_oblique_normal_is_turned_as_little_as_can_be() {
    let text = two_joints(
        &joint(
            "p",
            "planar",
            "base",
            "a",
            r#"<origin rpy="0.3 -0.2 0.5"/><axis xyz="0.6 0 0.8"/>"#,
        ),
        &joint("k", "fixed", "a", "b", ""),
    );
    let tree = read(&text, &Options::default()).tree;
    let pose = tree.link_poses(&[0.5, -0.7, 0.9]).unwrap()[1];
    let frame = Rotation3::from_euler_angles(0.3, -0.2, 0.5);
    let normal = Unit::new_normalize(Vector3::new(0.6, 0.0, 0.8));
    // z goes to the normal about y, which stays.
    let position = frame * (Vector3::new(0.8, 0.0, -0.6) * 0.5 - Vector3::y() * 0.7);
    is(
        &pose,
        position,
        &(frame * Rotation3::from_axis_angle(&normal, 0.9)),
    );
}

#[test]
fn a_floating_joint_takes_its_link_to_position_and_quaternion() {
    let text = two_joints(
        &joint("k", "continuous", "base", "a", r#"<axis xyz="0 0 1"/>"#),
        &joint(
            "free",
            "floating",
            "a",
            "b",
            r#"<origin xyz="1 0 0" rpy="0 0 1.5707963267948966"/>"#,
        ),
    );
    let urdf = read(&text, &Options::default());
    let tree = urdf.tree;
    assert_eq!((tree.nq(), tree.nv(), tree.dof()), (8, 7, 7));
    assert_eq!(names(&tree), ["k", "free"]);
    assert!(tree.is_floating() && tree.coordinates()[1].floating);
    let half = FRAC_PI_2 / 2.0;
    let q = [0.0, 0.5, 0.0, 0.2, half.cos(), half.sin(), 0.0, 0.0];
    let pose = tree.link_poses(&q).unwrap()[2];
    let rotation = Rotation3::from_matrix_unchecked(Matrix3::new(
        0.0, 0.0, 1.0, //
        1.0, 0.0, 0.0, //
        0.0, 1.0, 0.0,
    ));
    is(&pose, Vector3::new(1.0, 0.5, 0.2), &rotation);
    // Along its own z, which is x of the world, with 3 m/s, and about its own y with 2 rad/s.
    let kinetic = tree.kinetic(&q, &[0.0, 0.0, 0.0, 3.0, 0.0, 2.0, 0.0]);
    assert_relative_eq!(
        kinetic,
        0.5 * 2.0 * 9.0 + 0.5 * 0.2 * 4.0,
        max_relative = 1e-14
    );
}

#[test]
fn a_floating_base_falls_with_all_that_it_carries() {
    let text = two_joints(
        &joint("k", "continuous", "base", "a", r#"<axis xyz="0 1 0"/>"#),
        &joint("w", "fixed", "a", "b", ""),
    )
    .replace(
        r#"<link name="base"/>"#,
        &format!(r#"<link name="base">{BRICK}</link>"#),
    );
    let urdf = read(&text, &floating());
    assert_eq!(urdf.warnings, []);
    let tree = urdf.tree;
    assert_eq!(names(&tree), ["base", "k"]);
    assert_eq!(
        (tree.coordinates()[0].nq(), tree.coordinates()[0].nv()),
        (7, 6)
    );
    let root = &tree.bodies()[0];
    assert_eq!(
        (root.name.as_str(), root.joint, root.mass),
        ("base", None, 2.0)
    );
    assert_eq!(tree.bodies()[1].joint, Some(0));
    assert_eq!(tree.mass(), 6.0);
    assert_eq!(tree.joints()[0].coordinate, Some(1));
    let mechanics = Dynamics::of(tree);
    let q = [0.3, -0.4, 2.0, 0.5, 0.5, -0.5, 0.5, 0.7];
    // A third of a turn: the body's x stands up.
    let found = mechanics
        .forward_dynamics(&q, &[0.0; 7], &[0.0; 7])
        .unwrap();
    let expected = [-9.81, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let pose = mechanics.lagrangian().link_poses(&q).unwrap()[0];
    assert_relative_eq!(pose.rotation * Vector3::x(), Vector3::z(), epsilon = 1e-15);
    for (a, b) in found.iter().zip(expected) {
        assert_relative_eq!(*a, b, epsilon = 1e-13);
    }
}

#[test]
fn a_massless_root_that_floats_is_warned_of_and_a_name_that_clashes_refused() {
    let text = two_joints(
        &joint("k", "continuous", "base", "a", ""),
        &joint("w", "fixed", "a", "b", ""),
    );
    let warnings = read(&text, &floating()).warnings;
    assert!(
        warnings[0]
            .message
            .contains("the root link `base` floats but has no <inertial>: it counts as massless")
    );
    let carried = two_joints(
        &joint("k", "fixed", "base", "a", ""),
        &joint("w", "continuous", "a", "b", ""),
    );
    let warnings = read(&carried, &floating()).warnings;
    assert!(
        warnings[0]
            .message
            .ends_with("floats but has no <inertial>: only what is welded to it has mass"),
        "{warnings:?}"
    );

    let clash = text.replace(r#"name="k""#, r#"name="base""#);
    let message = refused(&clash, &floating());
    assert!(
        message.contains("joint `base` has the name of the floating base's coordinates"),
        "{message}"
    );
    assert_eq!(names(&read(&clash, &Options::default()).tree), ["base"]);

    let empty = text.replace(BRICK, "");
    let message = refused(&empty, &floating());
    assert!(
        message.contains("the root link `base` floats, but it has no mass"),
        "{message}"
    );
}

#[test]
fn what_has_no_meaning_for_several_coordinates_is_warned_of() {
    let text = two_joints(
        &joint("p", "planar", "base", "a", r#"<dynamics damping="0.5"/>"#),
        &joint(
            "f",
            "floating",
            "a",
            "b",
            r#"<axis xyz="0 0 0"/><dynamics friction="0.5"/>"#,
        ),
    );
    let urdf = read(&text, &Options::default());
    let all: Vec<String> = urdf.warnings.iter().map(|w| w.message.clone()).collect();
    for part in [
        "joint `p` is planar but has no <axis>: its plane is normal to x",
        "joint `p` is planar: its <dynamics> is not used",
        "joint `f` is floating: its <dynamics> is not used",
    ] {
        assert!(
            all.iter().any(|w| w.contains(part)),
            "{part} is not in {all:?}"
        );
    }
    assert_eq!(all.len(), 3, "{all:?}");
    assert_eq!(urdf.joint_dynamics, []);
}

#[test]
fn mimic_of_several_coordinates_is_read_where_mimics_are_ignored() {
    let text = two_joints(
        &joint("p", "planar", "base", "a", r#"<axis xyz="0 0 1"/>"#),
        &joint("k", "continuous", "a", "b", r#"<mimic joint="p"/>"#),
    );
    let message = refused(&text, &Options::default());
    assert!(
        message.contains("joint `k` mimics `p`, but `p` is planar"),
        "{message}"
    );
    let ignored = Options {
        ignore_mimic: true,
        ..Options::default()
    };
    assert_eq!(
        names(&read(&text, &ignored).tree),
        ["p.x", "p.y", "p.theta", "k"]
    );
}

/// The energies, from which all equations come, and the place of every link are those of the pose.
#[test]
fn a_pose_by_angles_is_the_same_mechanism() {
    let text = two_joints(
        &joint(
            "j",
            "floating",
            "base",
            "a",
            r#"<origin xyz="0.1 -0.2 0.3" rpy="0.4 0.5 -0.6"/>"#,
        ),
        &joint(
            "k",
            "continuous",
            "a",
            "b",
            r#"<origin xyz="0.5 0.1 0.2" rpy="0.2 0.3 0.1"/><axis xyz="1 2 3"/>"#,
        ),
    );
    for base in [false, true] {
        let options = Options {
            floating_base: base,
            ..Options::default()
        };
        let by_pose = read(&text, &options).tree;
        let poses = if base { 2 } else { 1 };
        let q: Vec<f64> = (0..by_pose.nq())
            .map(|i| (1.3 * i as f64 + 0.7).sin())
            .collect();
        let mut q = q;
        lagrange::state::normalize(by_pose.coordinates(), &mut q);
        let v: Vec<f64> = (0..by_pose.nv()).map(|i| (1.7 * i as f64).cos()).collect();
        for roll_axis in Axis::ALL {
            let angles = Angles { roll_axis };
            let tree = read(
                &text,
                &Options {
                    pose: PoseForm::Angles(angles),
                    ..options.clone()
                },
            )
            .tree;
            assert_eq!((tree.nq(), tree.nv()), (6 * poses + 1, 6 * poses + 1));
            assert!(!tree.is_floating());
            let (mut at, mut rates) = (Vec::new(), Vec::new());
            for k in 0..poses {
                let pose: [f64; 7] = q[7 * k..7 * k + 7].try_into().unwrap();
                let twist: [f64; 6] = v[6 * k..6 * k + 6].try_into().unwrap();
                at.extend(angles.of_pose(&pose));
                rates.extend(angles.rates(&pose, &twist));
            }
            at.push(q[7 * poses]);
            rates.push(v[6 * poses]);
            let close = |a: f64, b: f64| assert_relative_eq!(a, b, max_relative = 1e-12);
            close(tree.kinetic(&at, &rates), by_pose.kinetic(&q, &v));
            close(tree.potential(&at), by_pose.potential(&q));
            let places = tree.link_poses(&at).unwrap();
            for (found, expected) in places.iter().zip(by_pose.link_poses(&q).unwrap()) {
                is(
                    found,
                    expected.translation.vector,
                    &expected.rotation.to_rotation_matrix(),
                );
            }
            // What the trees of both forms are made of, body by body.
            for (found, expected) in tree.bodies().iter().zip(by_pose.bodies()) {
                assert_relative_eq!(found.centre, expected.centre, epsilon = 1e-14);
                assert_relative_eq!(found.inertia, expected.inertia, epsilon = 1e-14);
            }
        }
    }
}
