//! Effects that change the mechanics: against models in which the change is made by hand.

use std::path::{Path, PathBuf};

use integrators::{Differentiable, Gradient, Jacobian, Space, System};
use pinode_nn::diagnose::diagnose;
use pinode_nn::effect::{Inertial, Misplaced, default_smoothing, registry, tilt_direction};
use pinode_nn::free_run::{Scheme, simulate_by};
use pinode_nn::hybrid::{Hybrid, HybridMotion, Placed, State};
use pinode_nn::log::{Log, Run};
use pinode_nn::model::{EffectEntry, Model, Revision, Target};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

fn models() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models")
}

fn cartpole_urdf() -> String {
    std::fs::read_to_string(models().join("cartpole/cartpole.urdf")).unwrap()
}

/// The model of `urdf` with what `toml` says besides.
fn model(urdf: &str, toml: &str) -> Model {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("robot.urdf"), urdf).unwrap();
    let text = format!("urdf = \"robot.urdf\"\n{toml}");
    Model::parse(&dir.path().join("model.toml"), text).unwrap_or_else(|e| panic!("{e}"))
}

/// v̇ without inputs.
fn acceleration(model: &Model, q: &[f64], v: &[f64]) -> Vec<f64> {
    let hybrid = Hybrid::of(model);
    let theta = hybrid.theta();
    let u = vec![vec![0.0; 2]; hybrid.inputs()];
    let inputs = hybrid.drive(&[0.0, 1.0], &u, 1, &theta, &[]);
    let mut memory = hybrid.memory(&[]);
    let state = State { q, v, h: &[] };
    hybrid
        .acceleration(state, &theta, &inputs, 0, &mut memory)
        .unwrap();
    memory.acceleration.as_slice().to_vec()
}

fn assert_equal(found: &[f64], expected: &[f64], relative: f64) {
    let size = expected.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    assert!(size > 0.0);
    for (a, b) in found.iter().zip(expected) {
        assert!((a - b).abs() < relative * size, "{found:?} {expected:?}");
    }
}

/// States in which everything moves: (q, v) of a mechanism.
fn states(model: &Model) -> Vec<(Vec<f64>, Vec<f64>)> {
    let (mechanics, nv) = (&model.mechanics, model.mechanics.nv());
    (0..5)
        .map(|k| {
            let wave = |i: usize, w: f64| (w * i as f64 + 1.3 * f64::from(k)).sin();
            let motion: Vec<f64> = (0..nv).map(|i| wave(i, 0.8)).collect();
            let q = mechanics.integrate(&mechanics.neutral(), &motion).unwrap();
            (q, (0..nv).map(|i| 2.0 * wave(i, 1.7)).collect())
        })
        .collect()
}

/// The URDF with `mass` welded to a link as a point, so many `times` as far from the joint of its body as the centre of mass.
fn heavier(urdf: &str, model: &Model, link: &str, (mass, times): (f64, f64)) -> String {
    let tree = model.tree.as_ref().unwrap();
    let named = tree.links().iter().find(|l| l.name == link).unwrap();
    let body = &tree.bodies()[named.body.unwrap()];
    let ([x, y, z], to) = (<[f64; 3]>::from(times * body.centre), &body.name);
    let load = format!(
        r#"<link name="load"><inertial><mass value="{mass}"/>
             <inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial></link>
           <joint name="to_load" type="fixed"><parent link="{to}"/><child link="load"/><origin xyz="{x:?} {y:?} {z:?}"/></joint>
         </robot>"#
    );
    urdf.replace("</robot>", &load)
}

#[test]
fn an_added_mass_is_a_heavier_link_of_the_urdf() {
    let quadruped = std::fs::read_to_string(models().join("quadruped/quadruped.urdf")).unwrap();
    for (urdf, base, link, mass) in [
        (cartpole_urdf(), "", "pole", 0.05),
        (cartpole_urdf(), "", "sphere", 0.05),
        (cartpole_urdf(), "", "cart", 0.2),
        (quadruped.clone(), "base = \"floating\"", "trunk", 3.0),
        (quadruped, "base = \"floating\"", "HL_shank", 0.4),
    ] {
        let effect = format!("[[effect]]\nkind = \"added_mass\"\nlink = \"{link}\"\nmass = {mass}");
        let added = model(&urdf, &format!("{base}\n{effect}"));
        let expected = model(&heavier(&urdf, &added, link, (mass, 1.0)), base);
        let plain = model(&urdf, base);
        for (q, v) in states(&added) {
            let found = acceleration(&added, &q, &v);
            assert_equal(&found, &acceleration(&expected, &q, &v), 1e-10);
            let without = acceleration(&plain, &q, &v);
            let moved = found.iter().zip(&without).map(|(a, b)| (a - b).abs());
            assert!(moved.fold(0.0, f64::max) > 1e-3, "{link}");
        }
    }
}

#[test]
fn a_payload_is_a_load_that_the_urdf_holds_away_from_the_centre_of_mass() {
    let quadruped = std::fs::read_to_string(models().join("quadruped/quadruped.urdf")).unwrap();
    for (urdf, base, link, mass, place) in [
        (cartpole_urdf(), "", "pole", 0.05, 1.0),
        (cartpole_urdf(), "", "sphere", 0.05, 1.7),
        (cartpole_urdf(), "", "pole", 0.02, 0.4),
        (quadruped, "base = \"floating\"", "HL_shank", 0.4, 2.1),
    ] {
        let effect = format!(
            "[[effect]]\nkind = \"payload\"\nlink = \"{link}\"\nmass = {mass}\nplace = {place}"
        );
        let tilt = "\n[[effect]]\nkind = \"gravity_tilt\"\njoint = \"slider\"\nangle = 0.2\n";
        // On a slope too, for the weight of a load is tilted with the others.
        let slopes = if base.is_empty() {
            &["", tilt][..]
        } else {
            &[""][..]
        };
        for slope in slopes {
            let loaded = model(&urdf, &format!("{base}\n{effect}{slope}"));
            let heavy = heavier(&urdf, &loaded, link, (mass, place));
            let expected = model(&heavy, &format!("{base}{slope}"));
            for (q, v) in states(&loaded) {
                let found = acceleration(&loaded, &q, &v);
                assert_equal(&found, &acceleration(&expected, &q, &v), 1e-10);
            }
        }
    }
}

/// Two links that turn about different axes on a cart, the second with its centre of mass `place` times as far from its joint and with `more` inertia about the axes
/// normal to the line there.
fn oblique(place: f64, more: f64) -> String {
    let centre = [0.05, -0.02, -0.2];
    let square: f64 = centre.iter().map(|x| x * x).sum();
    let own = [
        [0.004, 1e-4, -3e-4],
        [1e-4, 0.0046, 2e-4],
        [-3e-4, 2e-4, 0.0011],
    ];
    let moment = |i: usize, k: usize| {
        let normal = if i == k { 1.0 } else { 0.0 } - centre[i] * centre[k] / square;
        own[i][k] + more * normal
    };
    let [x, y, z] = centre.map(|x| place * x);
    format!(
        r#"<robot name="oblique"><link name="base"/>
        <link name="cart"><inertial><mass value="0.8"/><inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial></link>
        <link name="upper"><inertial><origin xyz="0.01 0.02 -0.15"/><mass value="0.6"/>
          <inertia ixx="0.002" ixy="0" ixz="0" iyy="0.002" iyz="0" izz="0.001"/></inertial></link>
        <link name="lower"><inertial><origin xyz="{x} {y} {z}"/><mass value="0.4"/>
          <inertia ixx="{}" ixy="{}" ixz="{}" iyy="{}" iyz="{}" izz="{}"/></inertial></link>
        <joint name="rail" type="prismatic"><parent link="base"/><child link="cart"/><axis xyz="1 0 0"/>
          <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
        <joint name="shoulder" type="continuous"><parent link="cart"/><child link="upper"/><axis xyz="0 1 0"/></joint>
        <joint name="elbow" type="continuous"><parent link="upper"/><child link="lower"/><origin xyz="0 0 -0.3"/><axis xyz="0.6 0.8 0"/></joint>
        </robot>"#,
        moment(0, 0),
        moment(0, 1),
        moment(0, 2),
        moment(1, 1),
        moment(1, 2),
        moment(2, 2),
    )
}

#[test]
fn a_link_whose_centre_and_inertia_are_others_is_one_whose_urdf_says_so() {
    let centre = "[[effect]]\nkind = \"centre_of_mass\"\nlink = \"lower\"\nplace = 1.3\n";
    let inertia = "[[effect]]\nkind = \"link_inertia\"\nlink = \"lower\"\ninertia = 0.002\n";
    let less = "[[effect]]\nkind = \"link_inertia\"\nlink = \"lower\"\ninertia = -0.002\n";
    let tilt = "[[effect]]\nkind = \"gravity_tilt\"\njoint = \"rail\"\nangle = 0.2\n";
    let plain = oblique(1.0, 0.0);
    for (effects, place, more) in [
        (centre.to_owned(), 1.3, 0.0),
        (inertia.to_owned(), 1.0, 0.002),
        (less.to_owned(), 1.0, -0.002),
        (format!("{centre}{inertia}"), 1.3, 0.002),
    ] {
        for slope in ["", tilt] {
            let changed = model(&plain, &format!("{effects}{slope}"));
            let expected = model(&oblique(place, more), slope);
            for (q, v) in states(&changed) {
                let found = acceleration(&changed, &q, &v);
                assert_equal(&found, &acceleration(&expected, &q, &v), 1e-10);
            }
        }
    }
}

/// The base of an arm that turns about a vertical axis is as little level as any.
#[test]
fn a_tilt_is_looked_for_about_the_first_joint_of_each_horizontal_direction() {
    let joint = |name: &str, parent: &str, axis: &str| {
        format!(
            r#"<link name="of_{name}"><inertial><origin xyz="0.1 0 0.1"/><mass value="1"/>
              <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
              <joint name="{name}" type="continuous"><parent link="{parent}"/><child link="of_{name}"/><axis xyz="{axis}"/></joint>"#
        )
    };
    let told = |joints: &[(&str, &str)]| {
        let mut urdf = r#"<robot name="arm"><link name="base"/>"#.to_owned();
        let mut parent = "base".to_owned();
        for (name, axis) in joints {
            urdf += &joint(name, &parent, axis);
            parent = format!("of_{name}");
        }
        let hybrid = Hybrid::of(&model(&(urdf + "</robot>"), ""));
        let is_told = |c: &usize| hybrid.may_change(Inertial::Tilt, *c);
        (0..joints.len()).filter(is_told).collect::<Vec<_>>()
    };
    let (yaw, level, across) = ("0 0 1", "0 -1 0", "1 0 0");
    assert_eq!(
        told(&[("yaw", yaw), ("shoulder", level), ("elbow", level)]),
        [1]
    );
    assert_eq!(
        told(&[("yaw", yaw), ("shoulder", level), ("roll", across)]),
        [1, 2]
    );
    // A joint on the base tells it by itself.
    assert_eq!(told(&[("shoulder", level), ("roll", across)]), [0]);
    assert!(told(&[("yaw", yaw), ("wheel", yaw)]).is_empty());
}

#[test]
fn only_of_what_turns_the_inertia_shows() {
    let candidates = |link: &str| {
        let hybrid = Hybrid::of(&model(&oblique(1.0, 0.0), ""));
        let target = hybrid.links().iter().position(|l| l.name == link).unwrap();
        [Inertial::Centre, Inertial::OfLink].map(|change| hybrid.may_change(change, target))
    };
    assert_eq!(candidates("cart"), [false, false]);
    assert_eq!(candidates("upper"), [true, true]);
    assert_eq!(candidates("lower"), [true, true]);
}

/// A bob of 0.3 kg on a rod of 0.5 m, from energies and from a URDF.
#[test]
fn the_inertia_of_a_rotor_adds_to_that_of_a_pendulum() {
    const EFFECT: &str =
        "[[effect]]\nkind = \"reflected_inertia\"\njoint = \"hinge\"\ninertia = 0.04\n";
    let energies = format!(
        "[lagrangian]\ncoordinates = ['hinge']\nangles = ['hinge']\nkinetic = '0.5*0.3*0.25*hinge_dot^2'\n\
         potential = '-0.3*9.81*0.5*cos(hinge)'\n{EFFECT}"
    );
    let urdf = r#"<robot name="pendulum"><link name="base"/>
        <link name="bob"><inertial><origin xyz="0 0 -0.5"/><mass value="0.3"/>
          <inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial></link>
        <joint name="hinge" type="continuous"><parent link="base"/><child link="bob"/><axis xyz="0 1 0"/></joint></robot>"#;
    for model in [
        Model::parse(Path::new("m.toml"), energies).unwrap_or_else(|e| panic!("{e}")),
        model(urdf, EFFECT),
    ] {
        for (q, v) in [(0.7_f64, 2.0), (-2.0, 0.0)] {
            let expected = -0.3 * 9.81 * 0.5 * q.sin() / (0.3 * 0.25 + 0.04);
            assert_equal(&acceleration(&model, &[q], &[v]), &[expected], 1e-13);
        }
    }
}

#[test]
fn a_tilt_is_a_turned_gravity_of_what_was_added_too() {
    let urdf = cartpole_urdf();
    let mass = "[[effect]]\nkind = \"added_mass\"\nlink = \"pole\"\nmass = 0.05\n";
    for more in ["", mass] {
        for (joint, angle, sign) in [
            ("slider", 0.2_f64, -1.0),
            ("slider", -0.45, -1.0),
            ("pole", 0.3, 1.0),
        ] {
            let effect = format!(
                "{more}[[effect]]\nkind = \"gravity_tilt\"\njoint = \"{joint}\"\nangle = {angle}"
            );
            let tilted = model(&urdf, &effect);
            let (sin, cos) = angle.sin_cos();
            let gravity = [sign * 9.81 * sin, 0.0, -9.81 * cos];
            let expected = model(&urdf, &format!("gravity = {gravity:?}\n{more}"));
            for (q, v) in states(&tilted) {
                let found = acceleration(&tilted, &q, &v);
                assert_equal(&found, &acceleration(&expected, &q, &v), 1e-11);
            }
        }
    }
}

/// A slider that hangs in mid air needs m g sin α to stay: the positive end is up.
#[test]
fn a_positive_tilt_raises_the_positive_end_and_turns_the_base_about_a_hinge() {
    let tree = model(&cartpole_urdf(), "").tree.unwrap();
    assert_eq!(tilt_direction(&tree, 0), Some([-1.0, 0.0, 0.0]));
    // The base turns about +y: its x axis goes down.
    let d = tilt_direction(&tree, 1).unwrap();
    assert!(
        (d[0] - 1.0).abs() < 1e-15 && d[1] == 0.0 && d[2] == 0.0,
        "{d:?}"
    );
    let effect = "[[effect]]\nkind = \"gravity_tilt\"\njoint = \"slider\"\nangle = 0.1\n";
    let found = acceleration(&model(&cartpole_urdf(), effect), &[0.0, 0.0], &[0.0, 0.0]);
    assert!(found[0] < -0.9, "{found:?}");
}

/// On every joint of a mechanism, with every one of these effects and with a body that floats: rows pulled back and derivatives against
/// differences.
#[test]
fn derivatives_of_changed_mechanics_are_exact_on_bodies_that_float_as_well() {
    let load = |path: &str| Model::load(&models().join(path)).unwrap();
    for (model, joint, links) in [
        (load("quadruped/quadruped.toml"), 3, [0, 3]),
        (load("arm7/arm7.toml"), 1, [3, 4]),
    ] {
        let mut hybrid = Hybrid::of(&model);
        let mut place = |kind: &str, target: usize, values: &[f64]| {
            let placed = Placed {
                kind: registry::find(kind).unwrap(),
                target,
                smoothing: default_smoothing(true),
                fixed: false,
            };
            hybrid.add(placed, values);
        };
        place("reflected_inertia", joint, &[0.07]);
        for link in links {
            place("added_mass", link, &[0.5]);
        }
        place("payload", links[1], &[0.3, 1.6]);
        place("centre_of_mass", links[1], &[0.7]);
        place("link_inertia", links[0], &[0.02]);
        place("gravity_tilt", joint, &[0.1]);
        for constant in hybrid.constants_mut() {
            constant.tolerance = f64::INFINITY;
        }
        let (theta, free) = (hybrid.theta(), hybrid.free());
        let u = vec![vec![0.3; 2]; hybrid.inputs()];
        let inputs = hybrid.drive(&[0.0, 1.0], &u, 1, &theta, &free);
        let motion = HybridMotion::new(&hybrid, &theta, &free, &inputs);
        let (q, v) = states(&model).remove(2);
        let x = [q, v].concat();
        let nt = motion.space().tangent_dim();
        let (mut memory, at) = (motion.memory(), (0.0, x.as_slice(), &0));
        let (mut dx, mut by) = (vec![0.0; nt], Jacobian::zeros(&motion));
        motion.linearize(at, &mut memory, &mut dx, &mut by).unwrap();
        let mut again = vec![0.0; nt];
        motion.rate(0.0, &x, &0, &mut memory, &mut again).unwrap();
        assert_equal(&again, &dx, 1e-11);

        let weight: Vec<f64> = (0..nt).map(|i| (0.3 + 1.9 * i as f64).sin()).collect();
        let mut row = Gradient::zeros(&motion);
        motion
            .pull_back(at, &mut memory, &weight, &mut again, &mut row)
            .unwrap();
        assert_equal(&again, &dx, 1e-11);
        for (matrix, row) in [(&by.state, &row.state), (&by.parameters, &row.parameters)] {
            for (column, found) in matrix.column_iter().zip(row) {
                let expected: f64 = column.iter().zip(&weight).map(|(a, w)| a * w).sum();
                let error = (found - expected).abs();
                assert!(error < 1e-11 * matrix.amax(), "{found} {expected}");
            }
        }

        let h = 1e-6;
        for j in 0..nt + free.len() {
            let mut rate = |sign: f64| {
                let (mut xi, mut theta) = (vec![0.0; nt], theta.clone());
                match j.checked_sub(nt) {
                    None => xi[j] = sign * h,
                    Some(k) => theta[free[k]] += sign * h,
                }
                let inputs = hybrid.drive(&[0.0, 1.0], &u, 1, &theta, &[]);
                let motion = HybridMotion::new(&hybrid, &theta, &[], &inputs);
                let mut moved = vec![0.0; x.len()];
                motion.space().move_into(&x, &xi, &mut moved);
                let mut out = vec![0.0; nt];
                motion.rate(0.0, &moved, &0, &mut memory, &mut out).unwrap();
                out
            };
            let exact = match j.checked_sub(nt) {
                None => by.state.column(j),
                Some(k) => by.parameters.column(k),
            };
            for ((up, down), exact) in rate(1.0).iter().zip(rate(-1.0)).zip(exact.iter()) {
                let found = (up - down) / (2.0 * h);
                let allowed = 1e-6 * by.state.amax().max(by.parameters.amax());
                let error = (found - exact).abs();
                assert!(error < allowed, "{j}: {exact}, {found} by differences");
            }
        }
    }
}

/// Momenta and contacts count what the effects add.
#[test]
fn variational_steps_and_steps_with_contacts_follow_the_changed_mechanics() {
    let model = model(
        &cartpole_urdf(),
        r#"
        [[effect]]
        kind = "added_mass"
        link = "pole"
        mass = 0.05
        [[effect]]
        kind = "reflected_inertia"
        joint = "slider"
        inertia = 0.3
        [[effect]]
        kind = "gravity_tilt"
        joint = "slider"
        angle = 0.1
        "#,
    );
    let t: Vec<f64> = (0..51).map(|k| 0.02 * f64::from(k)).collect();
    let roll = |scheme| simulate_by(scheme, &model, "0", &t, &[], &[0.0, 2.0, 0.3, 1.0], 1e-3);
    let expected = roll(Scheme::Rk4).unwrap();
    for scheme in [Scheme::Variational, Scheme::Contacts] {
        for (a, b) in roll(scheme).unwrap().iter().zip(&expected) {
            assert_equal(a, b, 1e-8);
        }
    }
}

#[test]
fn a_model_with_changed_mechanics_reads_back_as_written() {
    let model = Model::load(&models().join("cartpole/cartpole.toml")).unwrap();
    let links = model.tree.as_ref().unwrap().links();
    let pole = links.iter().position(|l| l.name == "pole").unwrap();
    let mut revision = Revision::of(&model);
    for (kind, target, value) in [
        ("added_mass", Target::Link(pole), 0.015),
        ("reflected_inertia", Target::Coordinate(0), 0.05),
        ("gravity_tilt", Target::Coordinate(0), -0.02),
    ] {
        let entry = EffectEntry {
            kind: registry::find(kind).unwrap(),
            target,
            values: vec![value],
            smoothing: None,
            fixed: false,
        };
        revision.effects.push((entry, "Found.".into()));
    }
    let dir = tempfile::tempdir().unwrap();
    let path = model
        .write_revision(dir.path(), "m.toml", &revision)
        .unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    assert!(text.contains("link = \"pole\"\nmass = 0.015"), "{text}");
    let again = Model::load(&path).unwrap();
    let written: Vec<_> = revision.effects.iter().map(|(e, _)| e.clone()).collect();
    assert_eq!(again.effects, written);
    assert_eq!(again.target_name(Target::Link(pole)), "pole");

    // Other numbers, and one of them less.
    let mut fewer = Revision::of(&again);
    fewer.effects.remove(3);
    fewer.effects[2].0.values[0] = 0.025;
    let path = again.write_revision(dir.path(), "n.toml", &fewer).unwrap();
    let written: Vec<_> = fewer.effects.iter().map(|(e, _)| e.clone()).collect();
    assert_eq!(Model::load(&path).unwrap().effects, written);
}

#[test]
fn what_cannot_change_the_mechanics_is_refused_where_it_stands() {
    const UPRIGHT: &str = r#"<robot name="r"><link name="base"/>
        <link name="arm"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
        <joint name="turn" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/></joint></robot>"#;
    let tilt = "[[effect]]\nkind = 'gravity_tilt'\njoint = 'turn'\nangle = 0.1";
    let mass = |link: &str| format!("[[effect]]\nkind = 'added_mass'\nlink = '{link}'\nmass = 0.1");
    let text = "[lagrangian]\ncoordinates = ['x']\nkinetic = '0.5*x_dot^2'\npotential = '0'\n";
    let circle = "[lagrangian]\ncoordinates = ['x', 'z']\nkinetic = '0.5*(x_dot^2 + z_dot^2)'\npotential = '0'\n\
                  constraints = ['x^2 + z^2 = 1']\n[[effect]]\nkind = 'reflected_inertia'\njoint = 'x'\ninertia = 1";
    let relativistic = "[lagrangian]\ncoordinates = ['x']\nkinetic = 'x_dot^2 + x_dot^4'\npotential = '0'\n\
                        [[effect]]\nkind = 'reflected_inertia'\njoint = 'x'\ninertia = 1";
    let urdf = "urdf = 'upright.urdf'\n";
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("upright.urdf"), UPRIGHT).unwrap();
    for (text, place, parts) in [
        (format!("{urdf}{tilt}"), "4:9", ["gravity_tilt", "vertical"]),
        (
            format!("{urdf}gravity = [0, 0, 0]\n{tilt}"),
            "5:9",
            ["gravity_tilt", "`gravity` is 0"],
        ),
        (
            format!("{urdf}{}", mass("amr")),
            "4:8",
            ["unknown link `amr`", "nearest: `arm`"],
        ),
        (
            format!("{urdf}{}", mass("base")),
            "4:8",
            ["`base`", "welded to the world"],
        ),
        (
            format!("{urdf}{}", mass("arm").replace("link", "joint")),
            "4:9",
            ["added_mass acts on a link", "write `link"],
        ),
        (
            format!("{urdf}{}\n{}", mass("arm"), mass("arm")),
            "6:1",
            ["added_mass acts on this target already", "make them one"],
        ),
        (
            // No more than nine tenths of the arm's own.
            format!("{urdf}{}", mass("arm").replace("0.1", "-0.95")),
            "5:8",
            ["`mass` is -0.95", "at least -0.9 kg"],
        ),
        (
            format!("{urdf}{}", tilt.replace("0.1", "0.6")),
            "5:9",
            ["`angle` is 0.6", "from -0.5 to 0.5 rad"],
        ),
        (
            format!("{text}{}", mass("arm")),
            "7:8",
            ["added_mass", "needs the bodies of a URDF"],
        ),
        (
            format!("{text}{}", tilt.replace("turn", "x")),
            "7:9",
            ["gravity_tilt", "needs the bodies of a URDF"],
        ),
        (
            circle.to_owned(),
            "8:9",
            ["reflected_inertia", "without constraints"],
        ),
        (
            relativistic.to_owned(),
            "7:9",
            ["reflected_inertia", "not quadratic"],
        ),
    ] {
        let parsed = Model::parse(&dir.path().join("m.toml"), text.as_str());
        let Err(error) = parsed else {
            panic!("accepted: {text}");
        };
        let error = error.to_string();
        assert!(
            error.contains(&format!("m.toml:{place}:")),
            "{text}\n{error}"
        );
        for part in parts {
            assert!(error.contains(part), "{text}\n{error}");
        }
    }
    // A program is told as well, and gets no motion out of it.
    let model = model(UPRIGHT, "");
    let kind = registry::find("gravity_tilt").unwrap();
    let change = kind.inertial().unwrap();
    let p = &model.parameter_values;
    let refused = change.check(0, &*model.mechanics, p, model.tree.as_ref());
    assert!(
        matches!(refused, Err(Misplaced::Vertical { .. })),
        "{refused:?}"
    );
    let mut hybrid = Hybrid::of(&model);
    let placed = Placed {
        kind,
        target: 0,
        smoothing: default_smoothing(true),
        fixed: false,
    };
    hybrid.add(placed, &[0.1]);
    let theta = hybrid.theta();
    let inputs = hybrid.drive(&[0.0, 1.0], &[], 1, &theta, &[]);
    let mut memory = hybrid.memory(&[]);
    let state = State {
        q: &[0.1],
        v: &[0.2],
        h: &[],
    };
    assert!(
        hybrid
            .acceleration(state, &theta, &inputs, 0, &mut memory)
            .is_err()
    );
}

/// A recording of the cart-pole of the repository with one effect more, by its own equations, with the noise and the steps of its sensors;
/// the pole starts near its lower rest.
fn recording(effect: &str) -> Log {
    let cartpole = models().join("cartpole");
    let text = std::fs::read_to_string(cartpole.join("cartpole.toml")).unwrap();
    let text = format!("{text}\n{effect}");
    let model = Model::parse(&cartpole.join("truth.toml"), text).unwrap();
    let t: Vec<f64> = (0..1501).map(|k| 0.02 * f64::from(k)).collect();
    let wave = |t: f64, w: f64, phase: f64| (w * t + phase).sin();
    let u: Vec<f64> = t
        .iter()
        .map(|&t| 1.5 * wave(t, 2.3, 0.0) + 1.2 * wave(t, 5.9, 1.0) + 0.9 * wave(t, 11.3, 2.0))
        .collect();
    let initial = [0.0, 3.4, 0.0, 0.0];
    let u = vec![u];
    let states = simulate_by(Scheme::Rk4, &model, "0", &t, &u, &initial, 1e-3).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let slider = states.iter().map(|x| {
        let noise: f64 = rng.sample(StandardNormal);
        x[0] + 0.8e-3 * noise
    });
    let slider = slider.collect();
    let step = std::f64::consts::TAU / 4096.0;
    let pole = states.iter().map(|x| (x[1] / step).round() * step);
    Log {
        path: PathBuf::from("log.csv"),
        sha256: String::new(),
        runs: vec![Run {
            id: "0".into(),
            t,
            q: vec![slider, pole.collect()],
            v: vec![None, None],
            u,
        }],
        warnings: Vec::new(),
    }
}

/// The effect is the first that is named, or one of those that the log cannot tell from it, with its size to 15 %.
#[test]
fn the_diagnosis_names_what_changes_the_mechanics() {
    let model = Model::load(&models().join("cartpole/cartpole.toml")).unwrap();
    for (kind, key, target, parameter, value) in [
        ("added_mass", "link", "pole", "mass", 0.03),
        ("reflected_inertia", "joint", "slider", "inertia", 0.15),
        ("gravity_tilt", "joint", "slider", "angle", 0.03),
    ] {
        let effect =
            format!("[[effect]]\nkind = \"{kind}\"\n{key} = \"{target}\"\n{parameter} = {value}\n");
        let dir = tempfile::tempdir().unwrap();
        let log = recording(&effect);
        let outcome = diagnose(&model, &[log], &[], dir.path(), 0, &|_| {}).unwrap();
        let [named] = &outcome.diagnosis.effects[..] else {
            panic!("{kind}: {:?}", outcome.diagnosis.effects);
        };
        let right = named.kind == kind && named.target == target;
        let mut others = named.indistinguishable_from.iter();
        let undecided = others.any(|n| n.kind == kind && n.target == target);
        assert!(right || undecided, "{kind} is called {named:?}");
        if right {
            let found = named.parameters[parameter].value;
            assert!((found - value).abs() < 0.15 * value, "{kind}: {found}");
        }
        Model::load(&outcome.model).unwrap_or_else(|e| panic!("{e}"));
    }
}
