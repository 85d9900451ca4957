//! URDFs good and bad: energies against independent engines, and every fault reported with its culprit, quickly, without a panic.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use approx::assert_relative_eq;
use lagrange::mechanism::{JointKind, Tree};
use lagrange::urdf::{self, Options, Urdf};
use lagrange::{Lagrangian, Role};
use nalgebra::{DMatrix, Matrix3, Point3, Vector3};
use num_dual::{Dual64, HyperDual64};
use proptest::prelude::*;
use serde_json::Value;

fn model(path: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../models")
        .join(path);
    std::fs::read_to_string(path).unwrap()
}

fn good(text: &str) -> Urdf {
    urdf::read(text, &Options::default()).unwrap_or_else(|problems| panic!("{problems}"))
}

/// All messages of a URDF that must be refused within two seconds.
fn refused(text: &str) -> String {
    refused_with(text, &Options::default())
}

fn refused_with(text: &str, options: &Options) -> String {
    let start = Instant::now();
    let problems = urdf::read(text, options)
        .map(|_| ())
        .expect_err("this URDF is broken")
        .to_string();
    assert!(
        start.elapsed() < Duration::from_secs(2),
        "took {:?}: {problems}",
        start.elapsed()
    );
    problems
}

/// The mass matrix by polarisation of T.
fn mass_matrix(tree: &Tree, q: &[f64]) -> DMatrix<f64> {
    let n = tree.dof();
    let along = |indices: &[usize]| {
        let mut v = vec![0.0; n];
        indices.iter().for_each(|&i| v[i] += 1.0);
        tree.kinetic(q, &v)
    };
    let single: Vec<f64> = (0..n).map(|i| along(&[i])).collect();
    DMatrix::from_fn(n, n, |i, j| along(&[i, j]) - single[i] - single[j])
}

fn numbers(value: &Value) -> Vec<f64> {
    value
        .as_array()
        .unwrap()
        .iter()
        .map(|x| x.as_f64().unwrap())
        .collect()
}

/// The folder of reference robots, where there is one beside the checkout.
fn reference_robots() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/oracles");
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!("SKIPPED: no reference robots at {}", folder.display());
    None
}

/// T, V and M of a robot's variant agree with the reference at all its states.
fn agrees(folder: &Path, robot: &str, variant: &str, tolerance: f64) {
    let text = std::fs::read_to_string(folder.join(format!("{robot}.urdf"))).unwrap();
    let json: Value = serde_json::from_str(
        &std::fs::read_to_string(folder.join(format!("{robot}.json"))).unwrap(),
    )
    .unwrap();
    let options = Options {
        source: format!("{robot}.urdf"),
        ignore_mimic: ["fixed", "planar_coords"].contains(&variant),
        floating_base: variant == "floating_quat",
        ..Options::default()
    };
    let start = Instant::now();
    let urdf = urdf::read(&text, &options).unwrap_or_else(|p| panic!("{p}"));
    eprintln!(
        "{robot}/{variant}: read in {:?}, {} warnings",
        start.elapsed(),
        urdf.warnings.len()
    );
    for warning in &urdf.warnings {
        eprintln!("    {warning}");
    }
    let tree = urdf.tree;
    let variant = &json["variants"][variant];
    let names: Vec<&str> = variant["dof_order"]
        .as_array()
        .unwrap()
        .iter()
        .map(|name| name.as_str().unwrap())
        .collect();
    // Indices in q and v of a reference's coordinate; the base of six degrees of freedom comes first.
    let at = |name: &str| {
        let base = ["vx", "vy", "vz", "wx", "wy", "wz"]
            .iter()
            .position(|k| name == format!("base_{k}"));
        let (mut q, mut v) = (0, 0);
        for c in tree.coordinates() {
            match base {
                Some(k) if c.name == "base" => return (None, v + k),
                None if c.name == name || c.name == name.replace("planar_", "planar.") => {
                    return (Some(q), v);
                }
                _ => (q, v) = (q + c.nq(), v + c.nv()),
            }
        }
        panic!("there is no coordinate {name}")
    };
    let order: Vec<usize> = names.iter().map(|name| at(name).1).collect();
    let positions: Vec<usize> = names.iter().filter_map(|name| at(name).0).collect();
    assert_eq!(order.len(), tree.dof());
    let arranged = |order: &[usize], length: usize, values: Vec<f64>| {
        let mut out = vec![0.0; length];
        assert_eq!(order.len(), values.len());
        order.iter().zip(values).for_each(|(&i, x)| out[i] = x);
        out
    };
    let mass: f64 = tree.bodies().iter().map(|b| b.mass).sum();
    assert_relative_eq!(
        mass,
        variant["total_mass_moving"].as_f64().unwrap(),
        max_relative = 1e-12
    );
    let mut frames = 0;
    for state in variant["states"].as_array().unwrap() {
        let mut q = arranged(&positions, tree.nq(), numbers(&state["q"]));
        let v = arranged(&order, tree.nv(), numbers(&state["v"]));
        if tree.is_floating() {
            q[..3].copy_from_slice(&numbers(&state["base_position"]));
            let xyzw = numbers(&state["base_quaternion_xyzw"]);
            q[3..7].copy_from_slice(&[xyzw[3], xyzw[0], xyzw[1], xyzw[2]]);
        }
        assert_relative_eq!(
            tree.kinetic(&q, &v),
            state["KE"].as_f64().unwrap(),
            max_relative = tolerance
        );
        assert_relative_eq!(
            tree.potential(&q),
            state["PE"].as_f64().unwrap(),
            max_relative = tolerance,
            epsilon = tolerance
        );
        let reference: Vec<Vec<f64>> = state["M"].as_array().unwrap().iter().map(numbers).collect();
        let found = mass_matrix(&tree, &q);
        let size = found.amax();
        for (a, row) in order.iter().zip(&reference) {
            for (b, x) in order.iter().zip(row) {
                assert!(
                    (found[(*a, *b)] - x).abs() <= tolerance * size,
                    "{robot}: M[{a}, {b}] = {} against {x}",
                    found[(*a, *b)]
                );
            }
        }
        for (name, frame) in state["frames"].as_object().into_iter().flatten() {
            let Some(index) = tree.links().iter().position(|l| l.name == *name) else {
                continue;
            };
            let pose = tree.link_poses(&q).unwrap()[index];
            let p = numbers(&frame["position"]);
            assert_relative_eq!(
                pose.translation.vector,
                Vector3::new(p[0], p[1], p[2]),
                epsilon = 1e-12
            );
            let rows: Vec<Vec<f64>> = frame["rotation"]
                .as_array()
                .unwrap()
                .iter()
                .map(numbers)
                .collect();
            assert_relative_eq!(
                pose.rotation.to_rotation_matrix().into_inner(),
                Matrix3::from_fn(|i, j| rows[i][j]),
                epsilon = 1e-12
            );
            // A point of the link, on a scalar.
            let point = [0.3, -0.2, 0.1];
            assert_relative_eq!(
                Vector3::from(tree.point_position(&q, index, point)),
                (pose * Point3::from(point)).coords,
                epsilon = 1e-12
            );
            frames += 1;
        }
    }
    assert!(frames > 0);
}

#[test]
fn energies_and_mass_matrix_agree_with_other_engines() {
    let Some(folder) = reference_robots() else {
        return;
    };
    for (robot, variant) in [
        ("cartpole_roehrl2020", "fixed"),
        ("cartpole_pybullet", "fixed"),
        ("double_pendulum_continuous", "fixed"),
        ("kuka_iiwa", "fixed"),
        ("panda", "fixed"),
        ("panda", "mimic"),
        ("kinova_j2s6s200", "fixed"),
        ("solo12", "fixed"),
        ("talos_reduced", "fixed"),
        ("pr2", "fixed"),
        ("pr2", "mimic"),
        ("stress_tree", "planar_coords"),
        ("stress_tree", "planar_coords_mimic"),
        ("solo12", "floating_quat"),
        ("talos_reduced", "floating_quat"),
    ] {
        agrees(&folder, robot, variant, 1e-10);
    }
}

#[test]
fn the_cart_pole_has_the_mass_matrix_of_the_paper() {
    let tree = good(&model("cartpole/cartpole.urdf")).tree;
    let names: Vec<&str> = tree.coordinates().iter().map(|c| c.name.as_str()).collect();
    assert_eq!(names, ["slider", "pole"]);
    assert!(!tree.coordinates()[0].angular && tree.coordinates()[1].wraps);
    let (mc, mp, ms, l, g) = (0.466, 0.06, 0.012, 0.201, 9.81);
    for phi in [0.0, 0.4, 2.0, -3.0_f64] {
        let m = mass_matrix(&tree, &[0.1, phi]);
        let coupling = (0.5 * mp + ms) * l * phi.cos();
        assert_relative_eq!(m[(0, 0)], mc + mp + ms, max_relative = 1e-12);
        assert_relative_eq!(m[(0, 1)], coupling, max_relative = 1e-12);
        assert_relative_eq!(m[(1, 1)], (mp / 3.0 + ms) * l * l, max_relative = 1e-12);
        let v = tree.potential(&[0.1, phi]);
        assert_relative_eq!(v, (0.5 * mp + ms) * l * g * phi.cos(), max_relative = 1e-12);
    }
}

#[test]
fn the_double_pendulum_hangs_in_its_lowest_position() {
    let urdf = good(&model("double_pendulum/double_pendulum.urdf"));
    assert!(urdf.warnings.is_empty(), "{:?}", urdf.warnings);
    let tree = urdf.tree;
    let lowest = tree.potential(&[0.0, 0.0]);
    for q in [[0.1, 0.0], [-0.1, 0.0], [0.0, 0.1], [0.0, -0.1], [3.0, 1.0]] {
        assert!(tree.potential(&q) > lowest);
    }
    let slope = [0, 1].map(|i| {
        tree.potential(&[0, 1].map(|j| Dual64::new(0.0, f64::from(u8::from(i == j)))))
            .eps
    });
    assert_relative_eq!(slope[0].abs() + slope[1].abs(), 0.0, epsilon = 1e-12);
    assert_eq!(urdf.joint_dynamics.len(), 2);
    assert_eq!(
        (
            urdf.joint_dynamics[1].coordinate,
            urdf.joint_dynamics[1].damping
        ),
        (1, 0.0005)
    );
}

#[test]
fn second_derivatives_of_the_kinetic_energy_are_its_polarisation() {
    let tree = good(&model("double_pendulum/double_pendulum.urdf")).tree;
    let q = [0.7, -1.3];
    let m = mass_matrix(&tree, &q);
    for (i, j) in [(0, 0), (0, 1), (1, 1)] {
        let unit = |k: usize, l: usize| f64::from(u8::from(k == l));
        let v = [0, 1].map(|k| HyperDual64::new(0.2, unit(k, i), unit(k, j), 0.0));
        let second = tree.kinetic(&q.map(HyperDual64::from), &v).eps1eps2;
        assert_relative_eq!(second, m[(i, j)], max_relative = 1e-12);
    }
}

#[test]
fn mass_scales_act_on_one_body_each_and_leave_its_centre() {
    let tree = good(&model("cartpole/cartpole.urdf")).tree;
    let parameters = tree.parameters();
    assert_eq!(
        parameters
            .iter()
            .map(|p| p.name.as_str())
            .collect::<Vec<_>>(),
        ["cart", "pole"]
    );
    assert!(
        parameters
            .iter()
            .all(|p| p.role == Role::MassScale && p.nominal == 1.0)
    );
    let (q, v) = ([0.2, 0.9], [0.5, -2.0]);
    assert_eq!(tree.kinetic_with(&q, &v, &[1.0, 1.0]), tree.kinetic(&q, &v));
    let cart = tree.kinetic_with(&q, &v, &[1.0, 0.0]);
    let pole = tree.kinetic_with(&q, &v, &[0.0, 1.0]);
    assert_relative_eq!(cart, 0.5 * 0.466 * 0.25, max_relative = 1e-14);
    assert_relative_eq!(
        tree.kinetic_with(&q, &v, &[2.0, 3.0]),
        2.0 * cart + 3.0 * pole,
        max_relative = 1e-14
    );
    assert_relative_eq!(
        tree.potential_with(&q, &[5.0, 2.0]),
        2.0 * tree.potential(&q),
        max_relative = 1e-14
    );
}

#[test]
fn the_rod_and_the_sphere_are_one_body() {
    let tree = good(&model("cartpole/cartpole.urdf")).tree;
    let pole = &tree.bodies()[1];
    assert_eq!(pole.links, ["pole", "sphere"]);
    assert_eq!(pole.parent, Some(0));
    assert_relative_eq!(pole.mass, 0.072);
    let centre = (0.06 * 0.1005 + 0.012 * 0.201) / 0.072;
    assert_relative_eq!(pole.centre, Vector3::new(0.0, 0.0, centre), epsilon = 1e-15);
    let about_pivot = pole.inertia[(1, 1)] + 0.072 * centre * centre;
    assert_relative_eq!(
        about_pivot,
        0.06 * 0.201 * 0.201 / 3.0 + 0.012 * 0.201 * 0.201,
        max_relative = 1e-12
    );
}

const BODY: &str = r#"<inertial><origin xyz="0.1 0 0"/><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>"#;

fn link(name: &str) -> String {
    format!(r#"<link name="{name}">{BODY}</link>"#)
}
fn joint(name: &str, kind: &str, parent: &str, child: &str, more: &str) -> String {
    format!(
        r#"<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{more}</joint>"#
    )
}
fn robot(parts: &[String]) -> String {
    format!("<robot name=\"r\">\n{}\n</robot>", parts.join("\n"))
}
/// base –j→ a, with something more in the joint.
fn one_joint(kind: &str, more: &str) -> String {
    robot(&[link("base"), link("a"), joint("j", kind, "base", "a", more)])
}
/// base –j→ a, with another <inertial> in a.
fn one_body(inertial: &str) -> String {
    robot(&[
        link("base"),
        format!(r#"<link name="a">{inertial}</link>"#),
        joint("j", "continuous", "base", "a", ""),
    ])
}
fn inertial(mass: &str, ixx: &str, iyy: &str, izz: &str) -> String {
    format!(
        r#"<inertial><mass value="{mass}"/><inertia ixx="{ixx}" ixy="0" ixz="0" iyy="{iyy}" iyz="0" izz="{izz}"/></inertial>"#
    )
}
const LIMIT: &str = r#"<limit lower="-1" upper="1" effort="1" velocity="1"/>"#;

#[test]
fn coordinates_stand_in_the_order_of_the_joints_whatever_the_topology() {
    let text = robot(&[
        joint("tip", "continuous", "b", "c", ""),
        joint("weld", "fixed", "base", "a", ""),
        joint("root", "prismatic", "a", "b", LIMIT),
        link("c"),
        link("b"),
        link("a"),
        link("base"),
    ]);
    let tree = good(&text).tree;
    let names: Vec<&str> = tree.coordinates().iter().map(|c| c.name.as_str()).collect();
    assert_eq!(names, ["tip", "root"]);
    // The bodies go outward; what is welded to the world is none.
    assert_eq!(
        tree.bodies()
            .iter()
            .map(|b| b.name.as_str())
            .collect::<Vec<_>>(),
        ["b", "c"]
    );
}

#[test]
fn chains_of_mimics_are_composed() {
    let tree = || {
        robot(&[
            link("base"),
            link("a"),
            link("b"),
            link("c"),
            joint(
                "third",
                "continuous",
                "b",
                "c",
                r#"<mimic joint="second" multiplier="3" offset="0.2"/><dynamics damping="0.1"/>"#,
            ),
            joint("first", "continuous", "base", "a", ""),
            joint(
                "second",
                "continuous",
                "a",
                "b",
                r#"<mimic joint="first" multiplier="-2" offset="0.5"/>"#,
            ),
        ])
    };
    let followed = good(&tree());
    assert_eq!(followed.tree.dof(), 1);
    let third = &followed.tree.joints()[0];
    assert_eq!(
        (third.coordinate, third.ratio, third.follows),
        (Some(0), -6.0, true)
    );
    assert_relative_eq!(third.offset, 1.7);
    assert_eq!(followed.joint_dynamics[0].ratio, -6.0);
    let free = urdf::read(
        &tree(),
        &Options {
            ignore_mimic: true,
            ..Options::default()
        },
    )
    .unwrap()
    .tree;
    assert_eq!(free.dof(), 3);
    let (q, v) = (0.3, 1.1);
    let full_q = [3.0 * (-2.0 * q + 0.5) + 0.2, q, -2.0 * q + 0.5];
    assert_relative_eq!(
        followed.tree.kinetic(&[q], &[v]),
        free.kinetic(&full_q, &[-6.0 * v, v, -2.0 * v]),
        max_relative = 1e-13
    );
    assert_relative_eq!(
        followed.tree.potential(&[q]),
        free.potential(&full_q),
        max_relative = 1e-13
    );
}

#[test]
fn an_oblique_axis_is_normalised_and_its_length_does_not_matter() {
    let energy = |axis: &str| {
        good(&one_joint(
            "prismatic",
            &format!(r#"<axis xyz="{axis}"/>{LIMIT}"#),
        ))
        .tree
        .kinetic(&[0.2], &[2.0])
    };
    assert_relative_eq!(energy("3 -4 12"), 2.0, max_relative = 1e-14);
    assert_relative_eq!(energy("1e-200 1e-200 0"), 2.0, max_relative = 1e-14);
    assert_relative_eq!(energy("1e200 1e308 0"), 2.0, max_relative = 1e-14);
}

#[test]
fn the_seven_axis_directions_move_links_as_rodrigues_says() {
    for axis in [
        "1 0 0", "-1 0 0", "0 1 0", "0 -1 0", "0 0 1", "0 0 -1", "1 2 -3",
    ] {
        let numbers: Vec<f64> = axis.split(' ').map(|x| x.parse().unwrap()).collect();
        let unit = nalgebra::Unit::new_normalize(Vector3::new(numbers[0], numbers[1], numbers[2]));
        let tree = good(&one_joint(
            "continuous",
            &format!(r#"<origin xyz="1 2 3" rpy="0.3 0.2 0.1"/><axis xyz="{axis}"/>"#),
        ))
        .tree;
        let poses = tree.link_poses(&[0.8]).unwrap();
        let expected = nalgebra::UnitQuaternion::from_euler_angles(0.3, 0.2, 0.1)
            * nalgebra::UnitQuaternion::from_axis_angle(&unit, 0.8);
        assert!(poses[1].rotation.angle_to(&expected) < 1e-7);
        assert_relative_eq!(
            poses[1].rotation.to_rotation_matrix(),
            expected.to_rotation_matrix(),
            epsilon = 1e-14
        );
        assert_relative_eq!(
            poses[1].translation.vector,
            Vector3::new(1.0, 2.0, 3.0),
            epsilon = 1e-14
        );
    }
}

#[test]
fn a_long_chain_and_a_wide_tree_need_no_stack() {
    for wide in [false, true] {
        let mut parts = vec![link("l0")];
        for i in 1..=2000 {
            parts.push(link(&format!("l{i}")));
            let parent = if wide { (i - 1) / 2 } else { i - 1 };
            parts.push(joint(
                &format!("j{i}"),
                "continuous",
                &format!("l{parent}"),
                &format!("l{i}"),
                "",
            ));
        }
        let text = robot(&parts);
        let energy = std::thread::Builder::new()
            .stack_size(512 * 1024)
            .spawn(move || {
                let tree = good(&text).tree;
                tree.kinetic(&vec![0.01_f64; 2000], &vec![0.1_f64; 2000])
            })
            .unwrap()
            .join()
            .unwrap();
        assert!(energy.is_finite() && energy > 0.0);
    }
}

#[test]
fn wrong_and_infinite_configurations_are_typed_errors() {
    let tree = good(&model("cartpole/cartpole.urdf")).tree;
    assert!(
        tree.link_poses(&[0.0])
            .unwrap_err()
            .to_string()
            .contains("takes 2")
    );
    assert!(
        tree.link_poses(&[0.0, f64::NAN])
            .unwrap_err()
            .to_string()
            .contains("q[1]")
    );
}

#[test]
fn massless_links_inside_a_chain_are_legal_and_warned_of() {
    let text = robot(&[
        link("base"),
        r#"<link name="cross"/>"#.into(),
        link("bob"),
        joint("u", "continuous", "base", "cross", r#"<axis xyz="1 0 0"/>"#),
        joint("v", "continuous", "cross", "bob", r#"<axis xyz="0 1 0"/>"#),
    ]);
    let urdf = good(&text);
    assert_eq!(
        (
            urdf.tree.dof(),
            urdf.tree.bodies().len(),
            urdf.tree.parameters().len()
        ),
        (2, 2, 1)
    );
    assert_eq!(urdf.warnings.len(), 1);
    assert!(
        urdf.warnings[0].message.contains("`cross`")
            && urdf.warnings[0].message.contains("<inertial>")
    );
}

#[test]
fn what_is_lost_or_looks_wrong_is_warned_of_once_a_kind() {
    let text = robot(&[
        link("base"),
        format!(r#"<link name="a">{}</link>"#, inertial("1", "1", "1", "3")),
        joint("j", "revolute", "base", "a", r#"<origin xzy="1 2 3"/>"#),
        "<transmission name=\"t\"/><gazebo/><gazebo/><ros2_control name=\"c\"/>".into(),
    ]);
    let urdf = good(&text);
    let all = urdf
        .warnings
        .iter()
        .map(ToString::to_string)
        .collect::<Vec<_>>()
        .join("\n");
    for part in [
        "link `a`: no real body",
        "A + B < C",
        "C = 3.0000e0",
        "the attribute `xzy` of <origin> is not read; did you mean `xyz`?",
        "no <limit>",
        "<transmission>",
        "<gazebo> is not read (2 times)",
        "<ros2_control>",
    ] {
        assert!(all.contains(part), "{part} is not in\n{all}");
    }
    assert_eq!(all.matches("<gazebo>").count(), 1);
    let strict = refused_with(
        &text,
        &Options {
            strict: true,
            ..Options::default()
        },
    );
    assert!(strict.contains("A + B < C"), "{strict}");
    assert_eq!(urdf.tree.joints()[0].kind, JointKind::Revolute);
}

/// What is missing stands there under a name that nobody reads.
#[test]
fn what_is_not_read_is_told_with_the_errors_that_it_causes() {
    let arm = |link: &str, inertial: &str| {
        format!(
            "<robot name='r'>\n<{link} name='b'/>\n<link name='a'><{inertial}><mass value='1'/></{inertial}></link>\n\
             <joint name='j' type='continuous'><parent link='b'/><child link='a'/></joint>\n</robot>"
        )
    };
    let told = refused(&arm("link", "inertia_"));
    assert!(
        told.contains("3:16: <inertia_> is not read; did you mean <inertial>?"),
        "{told}"
    );
    assert!(
        told.contains("link `a`, which joint `j` moves, has no mass"),
        "{told}"
    );
    let told = refused(&arm("Link", "inertial"));
    assert!(
        told.contains("2:1: <Link> is not read; did you mean <link>?"),
        "{told}"
    );
    assert!(told.contains("there is no link `b`"), "{told}");
}

#[test]
fn limits_in_degrees_are_warned_of_and_six_turns_are_not() {
    let joint = |kind: &str, upper: f64| {
        let more = format!(r#"<limit lower="-3" upper="{upper}" effort="1" velocity="1"/>"#);
        let warnings = good(&one_joint(kind, &more)).warnings;
        warnings.iter().map(ToString::to_string).collect::<Vec<_>>()
    };
    let told = joint("revolute", 180.0);
    assert!(
        told.iter().any(|w| w
            .contains("a limit of 180 rad is 29 turns: if these are degrees, write 3.1416 rad")),
        "{told:?}"
    );
    assert_eq!(joint("revolute", 37.7), joint("prismatic", 180.0));
}

#[test]
fn all_problems_come_at_once_with_file_line_and_column() {
    let text = robot(&[
        link("base"),
        format!(r#"<link name="a">{}</link>"#, inertial("-1", "1", "1", "1")),
        joint("j", "continous", "base", "a", r#"<axis xyz="0 foo 0 1"/>"#),
        joint("k", "continuous", "base", "a", r#"<mimic joint="jj"/>"#),
    ]);
    let message = refused_with(
        &text,
        &Options {
            source: "r.urdf".into(),
            ..Options::default()
        },
    );
    for part in [
        "r.urdf:3:26: link `a`: the mass is -1 kg",
        "r.urdf:4:17: joint `j`: there is no joint type `continous`; did you mean `continuous`?",
        "`foo` is not a number",
        "several parents",
        "joint `k` mimics `jj`, but there is no such joint; did you mean `j`?",
    ] {
        assert!(message.contains(part), "{part} is not in\n{message}");
    }
    assert_eq!(message.lines().count(), 5, "{message}");
}

#[test]
fn options_that_cannot_be_met_are_problems() {
    let text = one_joint("continuous", "");
    let gravity = refused_with(
        &text,
        &Options {
            gravity: [0.0, f64::NAN, 0.0],
            ..Options::default()
        },
    );
    assert!(gravity.contains("gravity"), "{gravity}");
}

/// Broken URDFs and a part of the message that each must give.
fn corpus() -> Vec<(&'static str, String, &'static str)> {
    let three = |joints: [String; 3]| {
        let mut parts: Vec<String> = ["base", "a", "b", "c"].map(link).into();
        parts.extend(joints);
        robot(&parts)
    };
    let mimic = |leader: &str| format!(r#"<mimic joint="{leader}"/>"#);
    let entity_bomb = "<!DOCTYPE r [<!ENTITY a \"aaaaaaaaaa\"><!ENTITY b \"&a;&a;&a;&a;&a;&a;&a;&a;\">]><robot name=\"&b;\"/>";
    vec![
        ("empty", String::new(), "the text is empty"),
        ("blank", " \n\t\n".into(), "the text is empty"),
        ("not XML", "hello, robot".into(), "not well-formed XML"),
        ("truncated", one_joint("continuous", "").replace("</robot>", ""), "not well-formed XML"),
        ("cut in a tag", r#"<robot name="r"><link name="#.into(), "not well-formed XML"),
        ("crossed tags", r#"<robot name="r"><link name="a"></robot></link>"#.into(), "not well-formed XML"),
        ("duplicate attribute", r#"<robot name="r" name="s"/>"#.into(), "not well-formed XML"),
        ("two documents", r#"<robot name="r"/><robot name="s"/>"#.into(), "not well-formed XML"),
        ("unclosed comment", "<robot name=\"r\"><!-- <link".into(), "not well-formed XML"),
        ("undeclared prefix", r#"<robot name="r"><ctl:plugin/></robot>"#.into(), "prefix `ctl`"),
        ("binary", "\u{0}\u{1}\u{7f}ELF\u{2}".into(), "not well-formed XML"),
        ("JSON", r#"{"robot": []}"#.into(), "not well-formed XML"),
        ("SDF", r#"<sdf version="1.9"><model name="m"/></sdf>"#.into(), "this is SDF"),
        ("MJCF", "<mujoco/>".into(), "this is MJCF"),
        ("other root", "<html/>".into(), "the root element is `html`"),
        ("no links", r#"<robot name="r"/>"#.into(), "has no <link>"),
        ("entity bomb", entity_bomb.into(), "entities"),
        ("external entity", "<!DOCTYPE r [<!ENTITY x SYSTEM \"file:///etc/passwd\">]><robot name=\"r\">&x;</robot>".into(), "entities"),
        ("undefined entity", r#"<robot name="r">&nope;</robot>"#.into(), "not well-formed XML"),
        ("100,000 nested elements", "<a>".repeat(100_000), "nested deeper than 64"),
        ("100,000 nested links", format!("<robot name=\"r\">{}{}</robot>", "<link name='x'>".repeat(100_000), "</link>".repeat(100_000)), "nested deeper than 64"),
        ("100,000 unclosed tags", "<a ".repeat(100_000), "not well-formed XML"),
        ("17 MiB", format!("<robot name=\"{}\"/>", "x".repeat(17 << 20)), "16 MiB"),
        ("many links", format!("<robot name=\"r\">{}</robot>", (0..11_000).map(|i| format!("<link name=\"l{i}\"/>")).collect::<String>()), "at most 10000 are read"),
        ("xacro expression", one_body(&inertial("${m}", "1", "1", "1")), "xacro"),
        ("xacro element", r#"<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arm/></robot>"#.into(), "expand the file first"),
        ("xacro undeclared", r#"<robot name="r"><xacro:arm/></robot>"#.into(), "expand the file first"),
        ("xacro find", robot(&[r#"<link name="a"><visual><geometry><mesh filename="$(find pkg)/a.stl"/></geometry></visual></link>"#.into()]), "expand the file first"),
        ("link without name", robot(&["<link/>".into()]), "lacks the attribute `name`"),
        ("empty name", robot(&[r#"<link name=""/>"#.into()]), "empty name"),
        ("joint without name", r#"<robot name="r"><link name="a"/><joint type="fixed"><parent link="a"/><child link="a"/></joint></robot>"#.into(), "lacks the attribute `name`"),
        ("joint without type", r#"<robot name="r"><link name="a"/><joint name="j"><parent link="a"/><child link="b"/></joint></robot>"#.into(), "lacks the attribute `type`"),
        ("joint without child", robot(&[link("a"), r#"<joint name="j" type="fixed"><parent link="a"/></joint>"#.into()]), "joint `j`: <joint> lacks <child>"),
        ("joint without parent", robot(&[link("a"), r#"<joint name="j" type="fixed"><child link="a"/></joint>"#.into()]), "joint `j`: <joint> lacks <parent>"),
        ("parent without link", robot(&[link("a"), r#"<joint name="j" type="fixed"><parent/><child link="a"/></joint>"#.into()]), "<parent> lacks the attribute `link`"),
        ("second inertial", one_body(&format!("{BODY}{BODY}")), "a second <inertial>"),
        ("inertial without mass", one_body(r#"<inertial><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>"#), "lacks <mass>"),
        ("inertial without inertia", one_body(r#"<inertial><mass value="1"/></inertial>"#), "lacks <inertia>"),
        ("inertia without ixy", one_body(r#"<inertial><mass value="1"/><inertia ixx="1" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>"#), "lacks the attribute `ixy`"),
        ("duplicate link", robot(&[link("a"), link("a")]), "link `a` is there already in line 2"),
        ("duplicate joint", three([joint("j", "fixed", "base", "a", ""), joint("j", "fixed", "a", "b", ""), joint("k", "fixed", "b", "c", "")]), "joint `j` is there already"),
        ("unknown child", robot(&[link("base"), link("hand"), joint("j", "fixed", "base", "hnad", "")]), "did you mean `hand`?"),
        ("unknown parent", robot(&[link("base"), link("hand"), joint("j", "fixed", "bsae", "hand", "")]), "did you mean `base`?"),
        ("self joint", robot(&[link("a"), joint("j", "continuous", "a", "a", "")]), "connects the link `a` with itself"),
        ("two roots", robot(&[link("a"), link("b")]), "2 root links (`a`, `b`)"),
        ("two trees", three([joint("j", "fixed", "base", "a", ""), joint("k", "fixed", "b", "c", ""), String::new()]), "2 root links (`base`, `b`)"),
        ("two parents", three([joint("j", "fixed", "base", "c", ""), joint("k", "fixed", "a", "c", ""), joint("l", "fixed", "base", "a", "")]), "link `c` has several parents"),
        ("cycle", three([joint("j", "fixed", "a", "b", ""), joint("k", "fixed", "b", "c", ""), joint("l", "fixed", "c", "a", "")]), "close a circle"),
        ("nothing but a cycle", robot(&[link("a"), link("b"), joint("j", "fixed", "a", "b", ""), joint("k", "fixed", "b", "a", "")]), "`k` → `j` → `k` close a circle"),
        ("negative mass", one_body(&inertial("-2", "1", "1", "1")), "link `a`: the mass is -2 kg"),
        ("NaN mass", one_body(&inertial("NaN", "1", "1", "1")), "NaN is not allowed"),
        ("infinite mass", one_body(&inertial("inf", "1", "1", "1")), "`inf` is not finite"),
        ("overflowing mass", one_body(&inertial("1e400", "1", "1", "1")), "`1e400` is not finite"),
("overflowing energy", one_body(&inertial("1e308", "1", "1", "1").replace("<mass", "<origin xyz=\"1e200 0 0\"/><mass")), "the kinetic energy overflows"),
        ("mass in words", one_body(&inertial("heavy", "1", "1", "1")), "`heavy` is not a number"),
        ("mass with unit", one_body(&inertial("1 kg", "1", "1", "1")), "`kg` is not a number"),
        ("decimal comma", one_body(&inertial("1,5", "1", "1", "1")), "`1,5` is not a number"),
        ("empty number", one_body(&inertial("", "1", "1", "1")), "one number is expected"),
        ("negative inertia", one_body(&inertial("1", "-1", "1", "1")), "not positive semidefinite"),
        ("indefinite inertia", one_body(r#"<inertial><mass value="1"/><inertia ixx="1" ixy="5" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>"#), "not positive semidefinite"),
        ("huge indefinite inertia", one_body(r#"<inertial><mass value="1"/><inertia ixx="1e308" ixy="-1.7e308" ixz="0" iyy="1e308" iyz="0" izz="1e308"/></inertial>"#), "not positive semidefinite"),
        ("a bad word among numbers", one_joint("continuous", r#"<axis xyz="0 foo 0 1"/>"#), "`foo` is not a number"),
        ("too few numbers", one_joint("continuous", r#"<axis xyz="0 1"/>"#), "3 numbers, separated by blanks, are expected"),
        ("too many numbers", one_joint("continuous", r#"<origin xyz="0 0 0 0"/>"#), "3 numbers, separated by blanks, are expected"),
        ("axis without xyz", one_joint("continuous", "<axis/>"), "<axis> lacks the attribute `xyz`"),
        ("zero axis", one_joint("continuous", r#"<axis xyz="0 0 -0.0"/>"#), "joint `j`: the axis is zero"),
        ("NaN axis", one_joint("continuous", r#"<axis xyz="0 nan 1"/>"#), "NaN is not allowed"),
        ("infinite origin", one_joint("continuous", r#"<origin rpy="0 -infinity 1"/>"#), "`-infinity` is not finite"),
        ("second axis", one_joint("continuous", r#"<axis xyz="0 0 1"/><axis xyz="0 1 0"/>"#), "a second <axis>"),
        ("limit without velocity", one_joint("revolute", r#"<limit lower="0" upper="1" effort="1"/>"#), "lacks the attribute `velocity`"),
        ("NaN limit", one_joint("revolute", r#"<limit lower="nan" upper="1" effort="1" velocity="1"/>"#), "NaN is not allowed"),
        ("negative damping", one_joint("continuous", r#"<dynamics damping="-0.5"/>"#), "its damping is -0.5"),
        ("negative friction", one_joint("continuous", r#"<dynamics friction="-1"/>"#), "its friction is -1"),
        ("unknown type", one_joint("revolut", ""), "did you mean `revolute`?"),
        ("spherical", one_joint("spherical", ""), "joint `j` is of type spherical, which is not in URDF: use three continuous joints"),
        ("zero normal", one_joint("planar", r#"<axis xyz="0 0 0"/>"#), "joint `j`: the axis is zero"),
        ("planar mimic", three([joint("j", "planar", "base", "a", &mimic("k")), joint("k", "continuous", "a", "b", ""), joint("l", "fixed", "b", "c", "")]), "joint `j` mimics `k`, but `j` is planar: only joints of one coordinate"),
        ("mimic of a planar joint", three([joint("j", "continuous", "base", "a", &mimic("k")), joint("k", "planar", "a", "b", ""), joint("l", "fixed", "b", "c", "")]), "joint `j` mimics `k`, but `k` is planar: only joints of one coordinate"),
        ("mimic of a floating joint", three([joint("j", "continuous", "base", "a", &mimic("k")), joint("k", "floating", "a", "b", ""), joint("l", "fixed", "b", "c", "")]), "joint `j` mimics `k`, but `k` is floating: only joints of one coordinate"),
        ("coordinate of a planar joint", three([joint("p", "planar", "base", "a", ""), joint("p.theta", "continuous", "a", "b", ""), joint("l", "fixed", "b", "c", "")]), "joint `p.theta` has the name of a coordinate of the planar joint `p`"),
        ("point mass that floats", one_joint("floating", "").replace(r#""1" ixy"#, r#""0" ixy"#).replace(r#"iyy="1""#, r#"iyy="0""#).replace(r#"izz="1""#, r#"izz="0""#), "joint `j` moves no inertia"),
        ("mimic of nothing", one_joint("continuous", &mimic("k")), "joint `j` mimics `k`, but there is no such joint"),
        ("mimic without joint", one_joint("continuous", "<mimic/>"), "<mimic> lacks the attribute `joint`"),
        ("mimic of itself", one_joint("continuous", &mimic("j")), "joint `j` mimics itself"),
        ("mimic multiplier", three([joint("j", "continuous", "base", "a", r#"<mimic joint="k" multiplier="two"/>"#), joint("k", "continuous", "a", "b", ""), joint("l", "fixed", "b", "c", "")]), "`two` is not a number"),
        ("mimic circle of two", three([joint("j", "continuous", "base", "a", &mimic("k")), joint("k", "continuous", "a", "b", &mimic("j")), joint("l", "fixed", "b", "c", "")]), "follow one another in a circle: `j` → `k` → `j`"),
        ("mimic circle of three", three([joint("j", "continuous", "base", "a", &mimic("k")), joint("k", "continuous", "a", "b", &mimic("l")), joint("l", "continuous", "b", "c", &mimic("j"))]), "`j` → `k` → `l` → `j`"),
        ("mimic of a fixed joint", three([joint("j", "continuous", "base", "a", &mimic("k")), joint("k", "fixed", "a", "b", ""), joint("l", "fixed", "b", "c", "")]), "mimics `k`, which is fixed"),
        ("massless end", robot(&[link("base"), r#"<link name="a"/>"#.into(), joint("j", "continuous", "base", "a", "")]), "link `a`, which joint `j` moves, has no mass"),
        ("massless branch", three([joint("j", "continuous", "base", "a", ""), joint("k", "fixed", "a", "b", ""), joint("l", "continuous", "b", "c", "")]).replace(&link("c"), r#"<link name="c"/>"#), "link `c`, which joint `l` moves, has no mass"),
        ("point mass on the axis", one_body(&inertial("1", "0", "0", "0")), "joint `j` moves no inertia"),
        ("bad visual", robot(&[r#"<link name="a"><visual><geometry><box size="1 1"/></geometry></visual></link>"#.into()]), "3 numbers"),
        ("empty geometry", robot(&[r#"<link name="a"><collision><geometry/></collision></link>"#.into()]), "<geometry> has no box"),
    ]
}

#[test]
fn every_broken_urdf_is_refused_with_its_culprit() {
    let corpus = corpus();
    assert!(corpus.len() >= 45);
    let mut wrong = Vec::new();
    for (name, text, part) in corpus {
        let message = refused(&text);
        if !message.contains(part) {
            wrong.push(format!(
                "{name}: `{part}` is not in\n{}",
                message.chars().take(800).collect::<String>()
            ));
        }
        assert!(message.len() < 60_000, "{name}: the message is too long");
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n\n"));
}

#[test]
fn every_broken_file_is_refused_with_what_its_first_comment_says() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/bad_urdf_files");
    let mut files = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let text = std::fs::read_to_string(&path).unwrap();
        let expected = text
            .split("expect: ")
            .nth(1)
            .unwrap()
            .split(" -->")
            .next()
            .unwrap();
        let message = refused(&text);
        for part in expected.split(" && ") {
            assert!(
                message.contains(part),
                "{}: `{part}` is not in\n{message}",
                path.display()
            );
        }
        files += 1;
    }
    assert!(files >= 5);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn a_cut_urdf_never_panics(end in 0_usize..2000) {
        let text = model("cartpole/cartpole.urdf");
        let mut end = end.min(text.len());
        while !text.is_char_boundary(end) {
            end -= 1;
        }
        let _ = urdf::read(&text[..end], &Options::default());
    }

    #[test]
    fn a_mutated_urdf_never_panics_and_what_is_read_has_finite_energies(
        edits in prop::collection::vec((any::<prop::sample::Index>(), prop::sample::select(vec![
            "", "<", ">", "\"", "/", "-", "e", "9", "1e308", "nan", " ", "&", "é", "<!--", "-->", "<link name=\"x\">", "</link>", "xyz=\"1 2 3\"", "pole", "cart",
            "prismatic", "fixed", "planar", "floating", "<mimic joint=\"pole\"/>", "\u{0}",
        ]), 0_usize..12), 1..5),
        floating_base: bool,
        kind in prop::sample::select(vec!["continuous", "planar", "floating"]),
    ) {
        let mut text = model("cartpole/cartpole.urdf").replace("continuous", kind);
        for (place, insert, removed) in edits {
            let mut start = place.index(text.len());
            while !text.is_char_boundary(start) {
                start -= 1;
            }
            let mut end = (start + removed).min(text.len());
            while !text.is_char_boundary(end) {
                end += 1;
            }
            text.replace_range(start..end, insert);
        }
        let options = Options { floating_base, ..Options::default() };
        if let Ok(urdf) = urdf::read(&text, &options) {
            let tree = &urdf.tree;
            let mut q = vec![0.3_f64; tree.nq()];
            lagrange::state::normalize(tree.coordinates(), &mut q);
            prop_assert!(tree.kinetic(&q, &vec![0.1_f64; tree.nv()]).is_finite());
            prop_assert!(tree.potential(&q).is_finite());
            // What is read can be written, and is then read as the same.
            let again = urdf::read(&urdf::write(&urdf), &options).map_err(|p| TestCaseError::fail(p.to_string()))?;
            prop_assert_eq!(again.tree.joints(), tree.joints());
            prop_assert_eq!(again.tree.links(), tree.links());
        }
    }
}

/// Texts within the bounds that ask for the most work.
#[test]
fn hostile_texts_are_read_or_refused_in_bounded_time() {
    let n = 9_000;
    let many = |part: &dyn Fn(usize) -> String| {
        let parts: String = (0..n).map(part).collect();
        format!("<robot name=\"r\">{parts}</robot>")
    };
    let padding = " ".repeat(15 << 20);
    let texts = [
        (
            "links without joints",
            many(&|i| format!("<link name=\"l{i}\"/>")),
        ),
        (
            "equal names behind much text",
            format!("{}{padding}", many(&|_| "<link name=\"l\"/>".into())),
        ),
        (
            "equal names after much text",
            many(&|_| "<link name=\"l\"/>".into()).replacen('<', &format!("<!--{padding}--><"), 1),
        ),
        (
            "unknown links",
            many(&|i| {
                format!(
                    "<link name=\"link_{i}\"/><joint name=\"j{i}\" type=\"fixed\"><parent link=\"lnik_{i}\"/><child link=\"lnk_{i}\"/></joint>"
                )
            }),
        ),
        (
            "planar joints without end",
            many(&|i| {
                let (name, from, to) = (format!("j{i}"), format!("l{i}"), format!("l{}", i + 1));
                format!(
                    "<link name=\"l{i}\"/>{}",
                    joint(&name, "planar", &from, &to, "")
                )
            }),
        ),
        (
            "mimics in a long circle",
            many(&|i| {
                format!(
                    "<link name=\"l{i}\"/>{}",
                    joint(
                        &format!("j{i}"),
                        "continuous",
                        &format!("l{i}"),
                        &format!("l{}", i + 1),
                        &format!("<mimic joint=\"j{}\"/>", (i + 1) % n)
                    )
                )
            }),
        ),
        (
            "links in a long circle",
            many(&|i| {
                format!(
                    "<link name=\"l{i}\"/>{}",
                    joint(
                        &format!("j{i}"),
                        "fixed",
                        &format!("l{i}"),
                        &format!("l{}", (i + 1) % n),
                        ""
                    )
                )
            }),
        ),
        ("unknown elements", many(&|i| format!("<e{i}/>"))),
        (
            "unknown attributes",
            many(&|i| format!("<link name=\"l{i}\" a{i}=\"1\"/>")),
        ),
        (
            "many attributes",
            format!(
                "<robot {}/>",
                (0..1_000_000)
                    .map(|i| format!("a{i}=\"\" "))
                    .collect::<String>()
            ),
        ),
        (
            "many namespaces",
            format!(
                "<robot {}/>",
                (0..5_000)
                    .map(|i| format!("xmlns:a{i}=\"u{i}\" "))
                    .collect::<String>()
            ),
        ),
        ("open brackets", "<!".repeat(1 << 20)),
        (
            "a long name",
            format!(
                "<robot name=\"r\"><link name=\"{0}\"/><link name=\"{0}\"/></robot>",
                "x".repeat(1 << 20)
            ),
        ),
    ];
    for (name, text) in texts {
        let start = Instant::now();
        let result = urdf::read(&text, &Options::default());
        let message = result.map_or_else(|p| p.to_string(), |_| String::new());
        eprintln!(
            "{name}: {:?}, {}",
            start.elapsed(),
            message.chars().take(120).collect::<String>()
        );
        assert!(
            start.elapsed() < Duration::from_secs(10),
            "{name}: {:?}",
            start.elapsed()
        );
        assert!(
            message.len() < 100_000,
            "{name}: {} bytes of message",
            message.len()
        );
    }
}

#[test]
fn a_large_chain_of_mimics_is_read_in_bounded_time() {
    let mut parts = vec![link("l0")];
    for i in 0..3000 {
        parts.push(link(&format!("l{}", i + 1)));
        let follow = if i > 0 {
            format!("<mimic joint=\"j{}\"/>", i - 1)
        } else {
            String::new()
        };
        parts.push(joint(
            &format!("j{i}"),
            "continuous",
            &format!("l{i}"),
            &format!("l{}", i + 1),
            &follow,
        ));
    }
    let start = Instant::now();
    let tree = good(&robot(&parts)).tree;
    eprintln!("read in {:?}", start.elapsed());
    assert_eq!((tree.dof(), tree.bodies().len()), (1, 3000));
    assert!(start.elapsed() < Duration::from_secs(10));
}

#[test]
#[ignore = "prints a time"]
fn time_of_the_kinetic_energy() {
    let Some(folder) = reference_robots() else {
        return;
    };
    for robot in ["cartpole_roehrl2020", "kuka_iiwa", "talos_reduced"] {
        let tree =
            good(&std::fs::read_to_string(folder.join(format!("{robot}.urdf"))).unwrap()).tree;
        let (q, v) = (vec![0.3_f64; tree.dof()], vec![0.7_f64; tree.dof()]);
        let mut least = f64::INFINITY;
        let mut sum = 0.0;
        for _ in 0..50 {
            let start = Instant::now();
            for _ in 0..1000 {
                sum += tree.kinetic(std::hint::black_box(&q), std::hint::black_box(&v));
            }
            least = least.min(start.elapsed().as_secs_f64() * 1e6);
        }
        eprintln!("{robot}: n = {}, T in {least:.1} ns ({sum:e})", tree.dof());
    }
}
