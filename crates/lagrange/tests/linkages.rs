//! Linkages of `models/` against closed forms of their kinematics, against the same mechanism in one coordinate, and over long runs.

use std::path::Path;

use crate::common::load::tree;
use integrators::Rk4;
use lagrange::constraint::{Constrained, LinkPoint, Loop, Loops};
use lagrange::mechanism::Tree;
use lagrange::urdf::Options;
use lagrange::{Dynamics, Error, ForwardDynamicsDerivatives, Mechanics};
use nalgebra::{DVector, Vector3};

type Linkage = Constrained<Dynamics<Tree>, Loops>;

fn model(path: &str) -> Dynamics<Tree> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../models")
        .join(path);
    tree(&std::fs::read_to_string(path).unwrap(), &Options::default())
}

fn pin(name: &str, a: (&str, [f64; 3]), b: (&str, [f64; 3]), components: [bool; 3]) -> Loop {
    let point = |(link, point): (&str, [f64; 3])| LinkPoint {
        link: link.into(),
        point,
    };
    Loop {
        name: name.into(),
        a: point(a),
        b: point(b),
        components,
    }
}

fn closed(free: Dynamics<Tree>, loops: Vec<Loop>) -> Linkage {
    let loops = Loops::new(free.lagrangian(), loops).unwrap();
    Constrained::new(free, loops).unwrap()
}

const IN_PLANE: [bool; 3] = [true, false, true];

fn four_bar() -> Linkage {
    let ends = (("coupler", [0.24, 0.0, 0.07]), ("rocker", [0.0, 0.0, 0.17]));
    closed(
        model("four_bar/four_bar.urdf"),
        vec![pin("pin", ends.0, ends.1, IN_PLANE)],
    )
}

fn slider_crank() -> Linkage {
    let ends = (("rod", [0.12, 0.0, -0.05]), ("slider", [0.0; 3]));
    closed(
        model("slider_crank/slider_crank.urdf"),
        vec![pin("wrist", ends.0, ends.1, IN_PLANE)],
    )
}

/// Lower and upper joint of every leg, in the base's frame at 0.
type Legs = Vec<(Vector3<f64>, Vector3<f64>)>;

fn stewart() -> (Linkage, Legs) {
    let base = [
        [0.295, 0.052],
        [-0.103, 0.282],
        [-0.193, 0.23],
        [-0.193, -0.23],
        [-0.103, -0.282],
        [0.295, -0.052],
    ];
    let top = [
        [0.116, 0.138],
        [0.062, 0.169],
        [-0.177, 0.031],
        [-0.177, -0.031],
        [0.062, -0.169],
        [0.116, -0.138],
    ];
    let joints: Legs = (base.iter().zip(&top))
        .map(|(b, p)| (Vector3::new(b[0], b[1], 0.0), Vector3::new(p[0], p[1], 0.4)))
        .collect();
    let loops = (1..6)
        .map(|i| {
            let along = joints[i].1 - joints[i].0;
            let on_platform = joints[i].1 - joints[0].1;
            let (rod, name) = (format!("rod{}", i + 1), format!("ball{}", i + 1));
            pin(
                &name,
                (&rod, along.into()),
                ("platform", on_platform.into()),
                [true; 3],
            )
        })
        .collect();
    (closed(model("stewart/stewart.urdf"), loops), joints)
}

#[test]
fn the_four_bar_obeys_freudenstein() {
    let four_bar = four_bar();
    let (a, b, c, d) = (0.1, 0.25, 0.17, 0.24);
    // K₁ cos θ₄ − K₂ cos θ₂ + K₃ = cos(θ₂ − θ₄), angles from the line of the ground pivots.
    let (k1, k2) = (d / a, d / c);
    let k3 = (a * a - b * b + c * c + d * d) / (2.0 * a * c);
    let mut guess = vec![0.0; 3];
    for step in 0..=72 {
        let angle = std::f64::consts::TAU * f64::from(step) / 72.0;
        guess[0] = angle;
        guess[1] -= std::f64::consts::TAU / 72.0;
        let (q, v) = four_bar
            .project_holding(&guess, &[1.0, 0.0, 0.0], &[0])
            .unwrap();
        assert_eq!((q[0], v[0]), (angle, 1.0));
        let upright = std::f64::consts::FRAC_PI_2;
        let (t2, t4) = (upright + q[0], upright + q[2]);
        let t3 = (7.0_f64 / 24.0).atan() + q[0] + q[1];
        let error = k1 * t4.cos() - k2 * t2.cos() + k3 - (t2 - t4).cos();
        assert!(error.abs() < 1e-12, "{angle}: {error:e}");
        // ω₄ = ω₂ a/c · sin(θ₂ − θ₃)/sin(θ₄ − θ₃), ω₃ = ω₂ a/b · sin(θ₄ − θ₂)/sin(θ₃ − θ₄)
        let w4 = a / c * (t2 - t3).sin() / (t4 - t3).sin();
        let w3 = a / b * (t4 - t2).sin() / (t3 - t4).sin();
        assert!((v[2] - w4).abs() < 1e-11 && (v[0] + v[1] - w3).abs() < 1e-11);
        guess = q;
    }
}

#[test]
fn the_slider_follows_its_crank() {
    let linkage = slider_crank();
    let (r, l, speed) = (0.05_f64, 0.13_f64, 3.0_f64);
    let mut guess = vec![0.0; 3];
    for step in 0..=48 {
        let q0 = std::f64::consts::TAU * f64::from(step) / 48.0;
        guess[0] = q0;
        guess[1] -= std::f64::consts::TAU / 48.0;
        let (q, v) = linkage
            .project_holding(&guess, &[speed, 0.0, 0.0], &[0])
            .unwrap();
        let (s, c) = (std::f64::consts::FRAC_PI_2 + q0).sin_cos();
        // x = r cos θ + √(l² − r² sin² θ)
        let root = (l * l - r * r * s * s).sqrt();
        let x = r * c + root;
        let dx = -r * s - r * r * s * c / root;
        let d2x = -r * c - r * r * (c * c - s * s) / root - (r * r * s * c).powi(2) / root.powi(3);
        assert!((0.12 + q[2] - x).abs() < 1e-13);
        assert!((v[2] - dx * speed).abs() < 1e-12);
        // The acceleration of the slider from that of the crank.
        let (a, _) = linkage
            .forward_dynamics_with_multipliers(&q, &v, &[0.3, 0.0, 1.0])
            .unwrap();
        let expected = d2x * speed * speed + dx * a[0];
        assert!((a[2] - expected).abs() < 1e-10 * (1.0 + expected.abs()));
        guess = q;
    }
}

/// v̇ of the crank alone, from the energies along the closed loop: T = ½ m(θ) θ̇² and V(θ), with positions and rates of the other
/// coordinates from the closure, and dm/dθ, dV/dθ by differences of order 6.
fn by_elimination(linkage: &Linkage, start: &[f64], rate: f64, torque: f64) -> f64 {
    let at = |crank: f64| {
        let mut guess = start.to_vec();
        guess[0] = crank;
        let (q, unit) = linkage
            .project_holding(&guess, &[1.0, 0.0, 0.0], &[0])
            .unwrap();
        let inertia = 2.0 * linkage.kinetic_energy(&q, &unit).unwrap();
        (inertia, linkage.potential_energy(&q).unwrap())
    };
    let h = 4e-3;
    let slope = |f: &dyn Fn(f64) -> f64| {
        let pair = |k: f64| f(start[0] + k * h) - f(start[0] - k * h);
        (45.0 * pair(1.0) - 9.0 * pair(2.0) + pair(3.0)) / (60.0 * h)
    };
    let (by_inertia, gravity) = (slope(&|x| at(x).0), slope(&|x| at(x).1));
    (torque - 0.5 * by_inertia * rate * rate - gravity) / at(start[0]).0
}

#[test]
fn one_coordinate_and_three_under_constraints_are_the_same_motion() {
    for (linkage, angles) in [
        (four_bar(), [0.2, 1.1, -0.9, 2.5]),
        (slider_crank(), [0.3, 1.6, -2.0, 3.0]),
    ] {
        for (angle, rate) in angles.into_iter().zip([0.0, 4.0, -7.0, 2.0]) {
            let (q, v) = linkage
                .project_holding(&[angle, -angle, 0.0], &[rate, 0.0, 0.0], &[0])
                .unwrap();
            let torque = 0.15;
            let a = linkage
                .forward_dynamics(&q, &v, &[torque, 0.0, 0.0])
                .unwrap();
            let expected = by_elimination(&linkage, &q, rate, torque);
            assert!(
                (a[0] - expected).abs() < 1e-8 * (1.0 + expected.abs()),
                "{angle}: {} {expected}",
                a[0]
            );
        }
    }
}

/// The largest |φ|, |φ̇| and |ΔE| (over the largest T) in `seconds` of Runge-Kutta steps.
fn drift(linkage: &Linkage, q: &[f64], v: &[f64], h: f64, seconds: f64) -> [f64; 3] {
    let n = v.len();
    let p = linkage.nominal();
    let mut work = linkage.workspace();
    let mut a = DVector::zeros(n);
    let mut rk4 = Rk4::new(2 * n);
    let mut x: Vec<f64> = q.iter().chain(v).copied().collect();
    let start = linkage.total_energy(q, v).unwrap();
    let (mut worst, mut moving) = ([0.0_f64; 3], 0.0_f64);
    for k in 0..(seconds / h).round() as usize {
        rk4.step(k as f64 * h, h, &mut x, |_t, x, dx| {
            let (q, v) = x.split_at(n);
            a.fill(0.0);
            linkage.forward_dynamics_into(q, v, &p, &mut work, &mut a)?;
            dx[..n].copy_from_slice(v);
            dx[n..].copy_from_slice(a.as_slice());
            Ok::<(), Error>(())
        })
        .unwrap();
        if k % 20 == 0 {
            let (q, v) = x.split_at(n);
            let rate = linkage.jacobian(q).unwrap() * DVector::from_column_slice(v);
            let energy = linkage.total_energy(q, v).unwrap() - start;
            for (worst, now) in worst.iter_mut().zip([
                linkage.residual(q).unwrap().amax(),
                rate.amax(),
                energy.abs(),
            ]) {
                *worst = worst.max(now);
            }
            moving = moving.max(linkage.kinetic_energy(q, v).unwrap());
        }
    }
    worst[2] /= moving;
    worst
}

/// Says and checks the drift at two steps: what the method loses falls with the fourth power of the step.
fn drifts_little(name: &str, linkage: &Linkage, x: (&[f64], &[f64]), seconds: f64) -> [f64; 3] {
    let (q, v) = x;
    let [coarse, fine] = [1e-3, 5e-4].map(|h| drift(linkage, q, v, h, seconds));
    for (h, [open, opening, energy]) in [(1.0, coarse), (0.5, fine)] {
        eprintln!(
            "{name}, {seconds} s at {h} ms: |φ| {open:.1e} m, |φ̇| {opening:.1e} m/s, energy {energy:.1e}"
        );
    }
    let [open, opening, energy] = coarse;
    assert!(open < 2e-8 && opening < 2e-6 && energy < 2e-5);
    for (coarse, fine) in coarse.into_iter().zip(fine) {
        assert!(fine < coarse / 12.0 || fine < 1e-13, "{coarse:e} {fine:e}");
    }
    coarse
}

#[test]
fn the_four_bar_stays_closed_and_keeps_its_energy_for_20_s() {
    let four_bar = four_bar();
    // Fast enough to turn over.
    let (q, v) = four_bar
        .project_holding(&[0.0; 3], &[12.0, 0.0, 0.0], &[0])
        .unwrap();
    let [open, ..] = drifts_little("four-bar", &four_bar, (&q, &v), 20.0);
    // The loop does not open further with time …
    let [short, ..] = drift(&four_bar, &q, &v, 1e-3, 2.0);
    assert!(open < 3.0 * short, "{open:e} {short:e}");
    // … as it does without stabilisation.
    let bare = four_bar.clone().with_stabilisation(0.0).unwrap();
    let [bare_open, ..] = drift(&bare, &q, &v, 1e-3, 20.0);
    eprintln!("without stabilisation: |φ| {bare_open:.1e} m");
    assert!(bare_open > 10.0 * open);
}

#[test]
fn the_slider_crank_and_the_stewart_platform_keep_their_energy() {
    let linkage = slider_crank();
    let (q, v) = linkage
        .project_holding(&[0.0; 3], &[15.0, 0.0, 0.0], &[0])
        .unwrap();
    drifts_little("slider-crank", &linkage, (&q, &v), 10.0);
    let (stewart, _) = stewart();
    let (q, v) = stewart.project(&[0.02; 21], &[0.3; 21]).unwrap();
    drifts_little("Stewart platform", &stewart, (&q, &v), 0.15);
}

#[test]
fn legs_of_the_stewart_platform_are_as_long_as_its_pose_says() {
    let (stewart, joints) = stewart();
    assert_eq!((stewart.nv(), stewart.names().len()), (21, 15));
    assert!(stewart.dropped().is_empty());
    assert!(stewart.residual(&[0.0; 21]).unwrap().amax() < 1e-15);
    // Extensions of the six legs, which are coordinates 2, 5, …, 17.
    let legs: Vec<usize> = (0..6).map(|i| 3 * i + 2).collect();
    let mut guess = vec![0.0; 21];
    for (k, &leg) in legs.iter().enumerate() {
        guess[leg] = [0.03, -0.02, 0.01, 0.025, -0.015, 0.005][k];
    }
    let (q, _) = stewart.project_holding(&guess, &[0.0; 21], &legs).unwrap();
    let tree = stewart.free().lagrangian();
    let poses = tree.link_poses(&q).unwrap();
    let platform = tree
        .links()
        .iter()
        .position(|l| l.name == "platform")
        .unwrap();
    for (&leg, (lower, upper)) in legs.iter().zip(&joints) {
        let on_platform = nalgebra::Point3::from(upper - joints[0].1);
        let length = ((poses[platform] * on_platform).coords - lower).norm();
        let expected = (upper - lower).norm() + guess[leg];
        assert_eq!(q[leg], guess[leg]);
        assert!((length - expected).abs() < 1e-12, "{length} {expected}");
    }
    // The base and the platform are symmetric about x: equal extensions of all legs do not roll the platform.
    for &leg in &legs {
        guess[leg] = 0.03;
    }
    let (q, _) = stewart.project_holding(&guess, &[0.0; 21], &legs).unwrap();
    let pose = tree.link_poses(&q).unwrap()[platform];
    let up = pose * Vector3::z();
    assert!(up.y.abs() < 1e-12, "{up}");
}

#[test]
fn derivatives_of_the_linkages_equal_differences() {
    let (stewart, _) = stewart();
    let cases: [(&Linkage, Vec<f64>, Vec<f64>); 3] = [
        (&four_bar(), vec![0.4, -0.3, 0.2], vec![3.0, 0.0, 0.0]),
        (&slider_crank(), vec![0.9, -0.8, 0.0], vec![5.0, 0.0, 0.0]),
        (&stewart, vec![0.03; 21], vec![0.4; 21]),
    ];
    for (linkage, q, v) in cases {
        let (q, v) = linkage.project(&q, &v).unwrap();
        let n = v.len();
        let force: Vec<f64> = (0..n).map(|i| (1.3 * i as f64).sin()).collect();
        let p = linkage.nominal();
        let constants: Vec<usize> = (0..p.len()).collect();
        let mut at = ForwardDynamicsDerivatives::zeros(n, p.len());
        let mut work = linkage.workspace();
        linkage
            .forward_dynamics_derivatives_into(&q, &v, &force, &p, &constants, &mut work, &mut at)
            .unwrap();
        // Every fourth column of each is enough for the platform.
        let stride = if n > 3 { 4 } else { 1 };
        let compare = |name: &str, exact: &nalgebra::DMatrix<f64>, which: usize| {
            let scale = 1.0 + exact.amax();
            for j in (0..exact.ncols()).step_by(stride) {
                let accelerate = |h: f64| {
                    let mut x = [q.clone(), v.clone(), force.clone(), p.clone()];
                    x[which][j] += h;
                    let mut a = DVector::from_column_slice(&x[2]);
                    let mut work = linkage.workspace();
                    linkage
                        .forward_dynamics_into(&x[0], &x[1], &x[3], &mut work, &mut a)
                        .unwrap();
                    a
                };
                let h = 1e-3;
                let numeric = ((accelerate(h) - accelerate(-h)) * 8.0
                    - (accelerate(2.0 * h) - accelerate(-2.0 * h)))
                    / (12.0 * h);
                let error = (exact.column(j) - numeric).amax() / scale;
                assert!(error < 1e-7, "{name}[{j}] of {n}: {error:e}");
            }
        };
        compare("q", &at.by_q, 0);
        compare("v", &at.by_v, 1);
        compare("Q", &at.by_force, 2);
        compare("p", &at.by_p, 3);
        let constrained_rank = at.by_force.clone().rank(1e-9 * at.by_force.amax());
        assert_eq!(constrained_rank, n - linkage.names().len());
    }
}

#[test]
fn a_row_times_the_derivatives_of_a_linkage_is_one_sweep() {
    let (stewart, _) = stewart();
    let cases: [(&Linkage, Vec<f64>, f64); 3] = [
        (&four_bar(), vec![0.4, -0.3, 0.2], 2.0),
        (&slider_crank(), vec![0.9, -0.8, 0.0], 5.0),
        (&stewart, vec![0.03; 21], 0.4),
    ];
    for (linkage, near, speed) in cases {
        let wave = |size: f64, phase: f64| -> Vec<f64> {
            let entry = |i: usize| size * (2.3 * i as f64 + phase).sin();
            (0..near.len()).map(entry).collect()
        };
        for phase in [0.1, 1.7, 4.0] {
            // Off φ = 0, φ̇ = 0, where the stabilisation pulls, and on it.
            let shift = wave(0.02, phase);
            let q: Vec<f64> = near.iter().zip(&shift).map(|(q, d)| q + d).collect();
            let (v, force) = (wave(speed, 2.0 * phase), wave(3.0, 3.0 * phase));
            crate::rows::assert_product(linkage, (&q, &v, &force));
            let (q, v) = linkage.project(&q, &v).unwrap();
            crate::rows::assert_product(linkage, (&q, &v, &force));
        }
    }
}

#[test]
fn a_row_times_the_derivatives_of_a_loop_over_a_joint_that_follows_another() {
    let joint = |name: &str, kind: &str, parent: &str, axis: &str, mimic: &str| {
        format!(
            r#"<link name="{name}"><inertial><origin xyz="0.1 0 0.05"/><mass value="1"/>
  <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.01"/></inertial></link>
<joint name="j{name}" type="{kind}"><parent link="{parent}"/><child link="{name}"/><origin xyz="0.2 0.1 -0.1" rpy="0.3 -0.2 0.5"/>
  <axis xyz="{axis}"/><limit lower="-9" upper="9" effort="9" velocity="9"/>{mimic}</joint>"#
        )
    };
    let text = [
        r#"<robot name="follower"><link name="world"/>"#.to_owned(),
        joint("a", "revolute", "world", "0 1 0.2", ""),
        joint("b", "prismatic", "a", "1 0 0.4", ""),
        joint(
            "c",
            "revolute",
            "b",
            "0.1 1 0",
            r#"<mimic joint="ja" multiplier="-0.5" offset="0.1"/>"#,
        ),
        joint("d", "revolute", "c", "1 0 0", ""),
        "</robot>".to_owned(),
    ]
    .concat();
    let free = tree(&text, &Options::default());
    let (start, tip) = (vec![0.3, -0.1, 0.7], [0.1, 0.2, -0.15]);
    let link = (free.lagrangian().links().iter())
        .position(|l| l.name == "d")
        .unwrap();
    let place = free.lagrangian().point_position(&start, link, tip);
    let held = pin("tip", ("d", tip), ("world", place), [false, true, true]);
    let loops = Loops::new(free.lagrangian(), vec![held]).unwrap();
    let follower = Constrained::near(free, loops, &start).unwrap();
    assert_eq!((follower.nv(), follower.names().len()), (3, 2));
    let (v, force) = ([0.8, -0.3, 1.2], [0.4, 2.0, -1.0]);
    crate::rows::assert_product(&follower, (&start, &v, &force));
    crate::rows::assert_product(&follower, (&[0.33, -0.12, 0.6], &v, &force));
}

/// Two equal cranks of length `r` on pivots `d` apart, joined by a coupler of length `d`: a parallelogram.
fn parallelogram(plane: &str) -> Dynamics<Tree> {
    let link = |name: &str, length: f64| {
        format!(
            r#"<link name="{name}"><inertial><origin xyz="{} 0 0"/><mass value="1"/>
  <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>"#,
            length / 2.0
        )
    };
    let joint = |name: &str, parent: &str, child: &str, xyz: &str| {
        format!(
            r#"<joint name="{name}" type="continuous"><parent link="{parent}"/><child link="{child}"/>
  <origin xyz="{xyz}"/><axis xyz="0 -1 0"/></joint>"#
        )
    };
    let text = [
        r#"<robot name="parallelogram"><link name="world"/><link name="ground"/>"#.to_owned(),
        format!(
            r#"<joint name="foot" type="fixed"><parent link="world"/><child link="ground"/><origin xyz="0 0 0" rpy="{plane}"/></joint>"#
        ),
        link("left", 0.2),
        link("right", 0.2),
        link("coupler", 0.5),
        joint("left", "ground", "left", "0 0 0"),
        joint("right", "ground", "right", "0.5 0 0"),
        joint("coupler", "left", "coupler", "0.2 0 0"),
        "</robot>".to_owned(),
    ];
    tree(&text.concat(), &Options::default())
}

fn knee() -> Loop {
    pin(
        "knee",
        ("coupler", [0.5, 0.0, 0.0]),
        ("right", [0.2, 0.0, 0.0]),
        [true; 3],
    )
}

#[test]
fn a_dead_centre_is_an_error_that_names_the_equation() {
    let linkage = closed(parallelogram("0 0 0"), vec![knee()]);
    assert_eq!(linkage.names(), ["knee.x", "knee.z"]);
    let dropped: Vec<String> = linkage.dropped().iter().map(|d| d.to_string()).collect();
    assert_eq!(
        dropped,
        ["`knee.y` is redundant and left out: no motion of the mechanism changes it"]
    );
    // All bars on one line.
    let flat = linkage.forward_dynamics(&[0.0; 3], &[0.0; 3], &[0.0; 3]);
    let Err(Error::SingularConstraint { name, q, .. }) = flat else {
        panic!("{flat:?}");
    };
    assert_eq!((name.as_str(), q), ("knee.x", vec![0.0; 3]));
    // The parallelogram stands up: both cranks turn alike, the coupler stays level.
    let (q, v) = linkage
        .project_holding(&[0.7, 0.7, -0.7], &[1.0, 0.0, 0.0], &[0])
        .unwrap();
    assert!((q[1] - 0.7).abs() < 1e-12 && (q[2] + 0.7).abs() < 1e-12);
    assert!((v[1] - 1.0).abs() < 1e-12 && (v[2] + 1.0).abs() < 1e-12);
    linkage.forward_dynamics(&q, &v, &[0.0; 3]).unwrap();
}

#[test]
fn in_an_oblique_plane_one_of_three_equations_follows_from_the_others() {
    let straight = closed(parallelogram("0 0 0"), vec![knee()]);
    // Gravity is the same along both planes: this one is turned about the vertical.
    let oblique = closed(parallelogram("0 0 0.6"), vec![knee()]);
    assert_eq!(oblique.names().len(), 2);
    assert_eq!(oblique.dropped().len(), 1);
    assert!(
        oblique.dropped()[0]
            .to_string()
            .contains("the other equations imply it"),
        "{}",
        oblique.dropped()[0]
    );
    let (q, v) = straight
        .project_holding(&[0.7, 0.7, -0.7], &[2.0, 0.0, 0.0], &[0])
        .unwrap();
    let accelerate =
        |linkage: &Linkage| linkage.forward_dynamics(&q, &v, &[0.4, 0.0, 0.0]).unwrap();
    assert!((accelerate(&straight) - accelerate(&oblique)).amax() < 1e-11);
    // A second pin beside the first adds nothing but its own position across the plane.
    let twice = closed(
        parallelogram("0 0 0"),
        vec![
            knee(),
            pin(
                "knee again",
                ("coupler", [0.5, 0.1, 0.0]),
                ("right", [0.2, 0.1, 0.0]),
                [true; 3],
            ),
        ],
    );
    assert_eq!(twice.names(), ["knee.x", "knee.z"]);
    assert_eq!(twice.dropped().len(), 4);
    assert!((accelerate(&straight) - accelerate(&twice)).amax() < 1e-11);
}

#[test]
fn a_loop_that_cannot_close_is_refused_by_name() {
    let free = parallelogram("0 0 0");
    let far = pin(
        "knee",
        ("coupler", [0.5, 0.0, 0.0]),
        ("right", [2.0, 0.0, 0.0]),
        IN_PLANE,
    );
    let loops = Loops::new(free.lagrangian(), vec![far]).unwrap();
    let error = Constrained::new(free, loops).unwrap_err();
    let Error::Inconsistent { name, residual, .. } = &error else {
        panic!("{error}");
    };
    assert!(name.starts_with("knee.") && residual.abs() > 0.1, "{error}");
}

/// A body that swings about a pin: a free body in the plane whose point is pinned to the world by a loop, and a hinge.
#[test]
fn a_pinned_free_body_is_a_physical_pendulum() {
    let body = r#"<link name="body"><inertial><origin xyz="0 0 -0.3"/><mass value="1.5"/>
  <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.02"/></inertial></link>"#;
    let slide = |name: &str, parent: &str, child: &str, axis: &str| {
        format!(
            r#"<joint name="{name}" type="prismatic"><parent link="{parent}"/><child link="{child}"/><axis xyz="{axis}"/>
  <limit lower="-9" upper="9" effort="9" velocity="9"/></joint>"#
        )
    };
    let hinge = |parent: &str| {
        format!(
            r#"<joint name="turn" type="continuous"><parent link="{parent}"/><child link="body"/><axis xyz="0 1 0"/></joint>"#
        )
    };
    let free = [
        r#"<robot name="free"><link name="world"/><link name="across"/><link name="up"/>"#
            .to_owned(),
        slide("x", "world", "across", "1 0 0"),
        slide("z", "across", "up", "0 0 1"),
        body.to_owned(),
        hinge("up"),
        "</robot>".to_owned(),
    ]
    .concat();
    let hinged = [
        r#"<robot name="hinged"><link name="world"/>"#.to_owned(),
        body.to_owned(),
        hinge("world"),
        "</robot>".to_owned(),
    ]
    .concat();
    let hinged = tree(&hinged, &Options::default());
    let pinned = closed(
        tree(&free, &Options::default()),
        vec![pin(
            "pivot",
            ("body", [0.0; 3]),
            ("world", [0.0; 3]),
            IN_PLANE,
        )],
    );
    let (m, l, i, g) = (1.5, 0.3, 0.03, 9.81);
    for (angle, rate) in [(0.4_f64, 1.0_f64), (-2.0, 3.0), (3.0, -4.0)] {
        let (a, force) = pinned
            .forward_dynamics_with_multipliers(&[0.0, 0.0, angle], &[0.0, 0.0, rate], &[0.0; 3])
            .unwrap();
        let expected = hinged.forward_dynamics(&[angle], &[rate], &[0.0]).unwrap()[0];
        let closed_form = -m * g * l * angle.sin() / (i + m * l * l);
        assert!((expected - closed_form).abs() < 1e-12);
        assert!((a[2] - expected).abs() < 1e-12 && a[0].abs() < 1e-12 && a[1].abs() < 1e-12);
        // Newton: the pin's force on the body and its weight move the centre of mass, at (−l sin, −l cos).
        let (s, c) = angle.sin_cos();
        let x = -l * (c * expected - s * rate * rate);
        let z = l * (s * expected + c * rate * rate);
        assert!((force[0] - m * x).abs() < 1e-11, "{force}");
        assert!((force[1] - m * (z + g)).abs() < 1e-11, "{force}");
    }
}

/// A free body whose point is pinned to the world by a loop turns about that point like a body on a ball joint.
#[test]
fn a_floating_body_on_a_pin_turns_about_it() {
    let text = r#"<robot name="top"><link name="world"/>
  <link name="top"><inertial><origin xyz="0 0 0.2"/><mass value="1.5"/>
    <inertia ixx="0.02" ixy="0.001" ixz="0" iyy="0.03" iyz="0.002" izz="0.012"/></inertial></link>
  <joint name="free" type="floating"><parent link="world"/><child link="top"/></joint></robot>"#;
    let tip = [0.05, -0.02, -0.1];
    let top = closed(
        tree(text, &Options::default()),
        vec![pin(
            "tip",
            ("top", tip),
            ("world", [0.3, 0.1, 0.4]),
            [true; 3],
        )],
    );
    assert_eq!((top.nq(), top.nv(), top.names().len()), (7, 6, 3));
    let (q, v) = top
        .project(
            &[0.1, 0.2, 0.3, 0.8, 0.2, -0.4, 0.4],
            &[0.3, -0.2, 0.5, 2.0, -1.0, 3.0],
        )
        .unwrap();
    let turn = nalgebra::UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(
        q[3], q[4], q[5], q[6],
    ));
    assert!((turn.quaternion().norm() - 1.0).abs() < 1e-15);
    let at = Vector3::new(q[0], q[1], q[2]) + turn * Vector3::from(tip);
    assert!((at - Vector3::new(0.3, 0.1, 0.4)).norm() < 1e-12);
    // Euler about the pin, in the body's axes: I ω̇ + ω × I ω = r × m Rᵀ g, with I about the pin.
    let (a, force) = top
        .forward_dynamics_with_multipliers(&q, &v, &[0.0; 6])
        .unwrap();
    let omega = Vector3::new(v[3], v[4], v[5]);
    let alpha = Vector3::new(a[3], a[4], a[5]);
    let (m, r) = (1.5, Vector3::new(0.0, 0.0, 0.2) - Vector3::from(tip));
    let central = nalgebra::matrix![0.02, 0.001, 0.0; 0.001, 0.03, 0.002; 0.0, 0.002, 0.012];
    let inertia =
        central + (nalgebra::Matrix3::identity() * r.norm_squared() - r * r.transpose()) * m;
    let weight = turn.inverse() * Vector3::new(0.0, 0.0, -9.81 * m);
    let error = inertia * alpha + omega.cross(&(inertia * omega)) - r.cross(&weight);
    assert!(error.norm() < 1e-11, "{error}");
    // Newton: the pin's force and the weight move the centre of mass, r from the pin, which is at rest.
    let centre = alpha.cross(&r) + omega.cross(&omega.cross(&r));
    let pin_force = turn.inverse() * Vector3::new(force[0], force[1], force[2]);
    assert!((pin_force + weight - centre * m).norm() < 1e-11);

    // Derivatives along the velocities of the body.
    let push: Vec<f64> = (0..6).map(|i| (1.3 * f64::from(i)).sin()).collect();
    crate::rows::assert_product(&top, (&q, &v, &push));
    let off = [q[0] + 0.02, q[1], q[2] - 0.03, q[3], q[4], q[5], q[6]];
    crate::rows::assert_product(&top, (&off, &[0.3, -0.2, 0.5, 2.0, -1.0, 3.0], &push));
    let at = top.forward_dynamics_derivatives(&q, &v, &push).unwrap();
    for j in 0..6 {
        let accelerate = |h: f64| {
            let mut twist = [0.0; 6];
            twist[j] = h;
            let shift = turn * Vector3::new(twist[0], twist[1], twist[2]);
            let turned =
                turn * nalgebra::UnitQuaternion::new(Vector3::new(twist[3], twist[4], twist[5]));
            let u = turned.quaternion();
            let q = [
                q[0] + shift.x,
                q[1] + shift.y,
                q[2] + shift.z,
                u.w,
                u.i,
                u.j,
                u.k,
            ];
            top.forward_dynamics(&q, &v, &push).unwrap()
        };
        let h = 1e-3;
        let numeric = ((accelerate(h) - accelerate(-h)) * 8.0
            - (accelerate(2.0 * h) - accelerate(-2.0 * h)))
            / (12.0 * h);
        let error = (at.by_q.column(j) - &numeric).amax() / (1.0 + at.by_q.amax());
        assert!(error < 1e-8, "{j}: {error:e}");
    }
}
