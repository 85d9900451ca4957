//! Equations of motion against formulas written out by hand, and against independent engines.

use std::path::Path;

use crate::common::load::tree;
use crate::common::motion::advance;
use crate::common::oracle::{
    Agreement, Order, folder, from_sympy, json, numbers, on_a_chain_of_angles, texts,
};
use crate::common::written::{cart_pole_as_text, double_pendulum_as_text, model, text};
use lagrange::mechanism::{Angles, PoseForm};
use lagrange::urdf::Options;
use lagrange::{ForwardDynamicsDerivatives, Mechanics, TextSource};
use nalgebra::{DMatrix, DVector, Matrix2, Vector2};
use serde_json::Value;

/// |found − expected| ≤ tolerance · (the largest of the entries expected, and of `scale`).
fn close(what: &str, found: &[f64], expected: &[f64], tolerance: f64, scale: f64) {
    assert_eq!(found.len(), expected.len(), "{what}");
    let size = expected.iter().fold(scale, |s, x| s.max(x.abs()));
    for (i, (f, e)) in found.iter().zip(expected).enumerate() {
        // Written so that NaN fails.
        assert!(
            (f - e).abs() <= tolerance * size,
            "{what}: entry {i} is {f} against {e}, tolerance {:e}",
            tolerance * size
        );
    }
}

/// Two coordinates, every term by hand.
struct ByHand {
    mass: Matrix2<f64>,
    coriolis: Matrix2<f64>,
    gravity: Vector2<f64>,
    potential: f64,
}

/// (m_c + m_p + m_s) ẍ + k cos φ φ̈ − k sin φ φ̇² = Q_x,
/// k cos φ ẍ + J φ̈ − k g sin φ = Q_φ,
/// with k = (m_p/2 + m_s) l and J = (m_p/3 + m_s) l².
fn cart_pole(q: [f64; 2], v: [f64; 2]) -> ByHand {
    let (mc, mp, ms, l, g) = (0.466, 0.06, 0.012, 0.201, 9.81);
    let (k, j) = ((mp / 2.0 + ms) * l, (mp / 3.0 + ms) * l * l);
    let (sin, cos) = q[1].sin_cos();
    ByHand {
        mass: Matrix2::new(mc + mp + ms, k * cos, k * cos, j),
        coriolis: Matrix2::new(0.0, -k * sin * v[1], 0.0, 0.0),
        gravity: Vector2::new(0.0, -k * g * sin),
        potential: k * g * cos,
    }
}

/// Relative angles from hanging; a = I₁ + m₁ c₁² + m₂ L₁² + I₂ + m₂ c₂², b = m₂ L₁ c₂, d = I₂ + m₂ c₂²:
/// (a + 2 b cos e) s̈ + (d + b cos e) ë − b sin e ė (2 ṡ + ė) + g₁ sin s + g₂ sin(s + e) = Q_s,
/// (d + b cos e) s̈ + d ë + b sin e ṡ² + g₂ sin(s + e) = Q_e,
/// with g₁ = (m₁ c₁ + m₂ L₁) g and g₂ = m₂ c₂ g.
fn double_pendulum(q: [f64; 2], v: [f64; 2]) -> ByHand {
    let (m1, m2, l1, c1, c2, h, g) = (0.243, 0.2025, 0.28, 0.14, 0.115, 0.6, 9.81);
    let (i1, i2) = (1.840725e-3, 1.069875e-3);
    let a = i1 + m1 * c1 * c1 + m2 * l1 * l1 + i2 + m2 * c2 * c2;
    let (b, d) = (m2 * l1 * c2, i2 + m2 * c2 * c2);
    let (sin, cos) = q[1].sin_cos();
    let (upper, lower) = ((m1 * c1 + m2 * l1) * g, m2 * c2 * g);
    let both = q[0] + q[1];
    let coupling = d + b * cos;
    ByHand {
        mass: Matrix2::new(a + 2.0 * b * cos, coupling, coupling, d),
        coriolis: Matrix2::new(-v[1], -(v[0] + v[1]), v[0], 0.0) * (b * sin),
        gravity: Vector2::new(upper * q[0].sin() + lower * both.sin(), lower * both.sin()),
        potential: (m1 + m2) * g * h - upper * q[0].cos() - lower * both.cos(),
    }
}

fn agrees_with_hand(
    name: &str,
    mechanics: &impl Mechanics,
    by_hand: fn([f64; 2], [f64; 2]) -> ByHand,
) {
    for k in 0..200 {
        // Numbers that do not repeat, from a few turns and both directions of motion.
        let x = |i: i32, range: f64| {
            range * (1.3 * f64::from(i + 7 * k) + 0.4 * f64::from(k * k)).sin()
        };
        let (q, v, force) = (
            [x(0, 2.0), x(1, 7.0)],
            [x(2, 3.0), x(3, 9.0)],
            [x(4, 2.0), x(5, 1.0)],
        );
        let hand = by_hand(q, v);
        let (velocity, q_v) = (Vector2::from(v), (&q[..], &v[..]));
        let bias = hand.coriolis * velocity + hand.gravity;
        let acceleration = hand.mass.try_inverse().unwrap() * (Vector2::from(force) - bias);
        let kinetic = 0.5 * velocity.dot(&(hand.mass * velocity));
        let close = |what: &str, found: &[f64], expected: &[f64], scale: f64| {
            close(
                &format!("{name}, {what} at {q:?}, {v:?}"),
                found,
                expected,
                1e-12,
                scale,
            );
        };
        let of = mechanics;
        close(
            "M",
            of.mass_matrix(&q).unwrap().as_slice(),
            hand.mass.as_slice(),
            0.0,
        );
        let coriolis = of.coriolis_matrix(q_v.0, q_v.1).unwrap();
        let speed = hand.mass.amax() * velocity.amax();
        close("C", coriolis.as_slice(), hand.coriolis.as_slice(), speed);
        close(
            "G",
            of.gravity_force(&q).unwrap().as_slice(),
            hand.gravity.as_slice(),
            1.0,
        );
        close(
            "bias",
            of.bias_force(&q, &v).unwrap().as_slice(),
            bias.as_slice(),
            1.0,
        );
        let found = of.forward_dynamics(&q, &v, &force).unwrap();
        close("v̇", found.as_slice(), acceleration.as_slice(), 1.0);
        close("T", &[of.kinetic_energy(&q, &v).unwrap()], &[kinetic], 0.0);
        close(
            "V",
            &[of.potential_energy(&q).unwrap()],
            &[hand.potential],
            1.0,
        );
    }
}

#[test]
fn the_cart_pole_is_its_closed_form() {
    let urdf = model("cartpole/cartpole.urdf");
    agrees_with_hand("cart-pole (URDF)", &urdf, cart_pole);
    agrees_with_hand("cart-pole (text)", &cart_pole_as_text(), cart_pole);
}

#[test]
fn the_double_pendulum_is_its_closed_form() {
    let urdf = model("double_pendulum/double_pendulum.urdf");
    agrees_with_hand("double pendulum (URDF)", &urdf, double_pendulum);
    let text = double_pendulum_as_text();
    agrees_with_hand("double pendulum (text)", &text, double_pendulum);
}

/// Reference data of a mechanism, its coordinates in an order of their own.
struct Reference<'a> {
    name: String,
    order: Order,
    states: &'a [Value],
}

impl<'a> Reference<'a> {
    fn new(
        name: String,
        mechanics: &impl Mechanics,
        dof_order: &[&str],
        states: &'a Value,
    ) -> Self {
        let own: Vec<(String, usize, usize)> = mechanics
            .coordinates()
            .iter()
            .map(|c| (c.name.clone(), c.nq(), c.nv()))
            .collect();
        Reference {
            name,
            order: Order::new(&own, dof_order),
            states: states.as_array().unwrap(),
        }
    }

    fn vector(&self, value: &Value) -> Vec<f64> {
        self.order.vector(value)
    }

    fn matrix(&self, value: &Value) -> DMatrix<f64> {
        let n = self.order.nv();
        DMatrix::from_row_slice(n, n, &self.order.matrix(value))
    }

    /// Everything that is given, at every state, to `tolerance` relative to the largest entry. Christoffel's matrix takes n³ steps
    /// and is compared at the first `coriolis` states.
    fn agrees(&self, mechanics: &impl Mechanics, tolerance: f64, coriolis: usize) {
        for (k, state) in self.states.iter().enumerate() {
            let close = |what: &str, found: &[f64], expected: &[f64], scale: f64| {
                let what = format!("{} state {k}: {what}", self.name);
                close(&what, found, expected, tolerance, scale);
            };
            let at = |key: &str| self.vector(&state[key]);
            let (q, v, force) = (self.order.position(state), at("v"), at("tau"));
            let mass = mechanics.mass_matrix(&q).unwrap();
            close(
                "M",
                mass.as_slice(),
                self.matrix(&state["M"]).as_slice(),
                0.0,
            );
            let gravity = mechanics.gravity_force(&q).unwrap();
            let bias = mechanics.bias_force(&q, &v).unwrap();
            close("bias", bias.as_slice(), &at("bias"), 0.0);
            close("G", gravity.as_slice(), &at("G"), bias.amax());
            if k < coriolis && state["C_christoffel"].is_array() {
                let found = mechanics.coriolis_matrix(&q, &v).unwrap();
                let expected = self.matrix(&state["C_christoffel"]);
                close("C", found.as_slice(), expected.as_slice(), 0.0);
            }
            if k < coriolis && state["Cv"].is_array() {
                // Where a base floats, C v is unique and C is not.
                let found =
                    mechanics.coriolis_matrix(&q, &v).unwrap() * DVector::from_vec(v.clone());
                close("C v", found.as_slice(), &at("Cv"), 0.0);
            }
            let a = mechanics.forward_dynamics(&q, &v, &force).unwrap();
            // Rounding of M and of the bias grows by the condition of M on its way to v̇.
            let condition = state["cond_M"].as_f64().unwrap_or(1.0) * 1e-16 / tolerance;
            let expected = DVector::from_vec(at("qdd"));
            let scale = expected.amax() * condition.max(1.0);
            close("v̇", a.as_slice(), expected.as_slice(), scale);
            if state["tau_inverse_dynamics"].is_array() {
                let force = mechanics.inverse_dynamics(&q, &v, &at("a")).unwrap();
                close("Q", force.as_slice(), &at("tau_inverse_dynamics"), 0.0);
            }
            let energy = |key: &str| [state[key].as_f64().unwrap()];
            close(
                "T",
                &[mechanics.kinetic_energy(&q, &v).unwrap()],
                &energy("KE"),
                0.0,
            );
            close(
                "V",
                &[mechanics.potential_energy(&q).unwrap()],
                &energy("PE"),
                1.0,
            );
        }
    }

    /// The derivatives of the forward dynamics, where they are given, to `tolerance` of their largest entry.
    fn derives(&self, mechanics: &impl Mechanics, tolerance: f64) {
        let mut agreement = Agreement::of(format!("{}, derivatives", self.name));
        let (n, p) = (mechanics.nv(), mechanics.nominal());
        let mut work = mechanics.workspace();
        let mut found = ForwardDynamicsDerivatives::zeros(n, 0);
        let given = |state: &&Value| state["dqdd_dq"].is_array();
        for (k, state) in self.states.iter().filter(given).enumerate() {
            let q = self.order.position(state);
            let [v, force] = ["v", "tau"].map(|key| self.vector(&state[key]));
            mechanics
                .forward_dynamics_derivatives_into(&q, &v, &force, &p, &[], &mut work, &mut found)
                .unwrap();
            let place = format!("state {k}");
            let mut close = |what, found: &[f64], key: &str| {
                let expected = self.matrix(&state[key]);
                agreement.close(what, &place, found, expected.as_slice(), tolerance);
            };
            close("∂v̇/∂q", found.by_q.as_slice(), "dqdd_dq");
            close("∂v̇/∂v", found.by_v.as_slice(), "dqdd_dv");
            close("∂v̇/∂Q", found.by_force.as_slice(), "M_inverse");
        }
    }

    /// The free motion, Q = 0, and its energy.
    fn moves_along(&self, mechanics: &impl Mechanics, trajectory: &Value) {
        let times = numbers(&trajectory["t"]);
        let row = |key: &str, k: usize| self.vector(&trajectory[key][k]);
        let mut x = [row("q", 0), row("v", 0)].concat();
        for k in 1..times.len() {
            let steps = 500;
            let h = (times[k] - times[k - 1]) / steps as f64;
            advance(mechanics, &mut x, h, steps, |_| ()).unwrap();
            let expected = [row("q", k), row("v", k)].concat();
            close(
                &format!("{}: state at {} s", self.name, times[k]),
                &x,
                &expected,
                1e-8,
                0.0,
            );
            let (q, v) = x.split_at(self.order.nv());
            let energy = mechanics.total_energy(q, v).unwrap();
            let expected = numbers(&trajectory["energy"])[k];
            close("energy", &[energy], &[expected], 1e-8, 1.0);
        }
    }
}

fn robot(folder: &Path, robot: &str, variant: &str) {
    let urdf = std::fs::read_to_string(folder.join(format!("{robot}.urdf"))).unwrap();
    let options = Options {
        source: format!("{robot}.urdf"),
        ignore_mimic: !variant.ends_with("mimic"),
        floating_base: variant == "floating_quat",
        ..Options::default()
    };
    if variant == "floating_zyx" {
        // The base on joints of its own, and as this crate writes its pose by angles.
        let chain = on_a_chain_of_angles(&urdf, "base_link");
        agrees_with(folder, (robot, variant), &tree(&chain, &options));
        let by_angles = Options {
            floating_base: true,
            pose: PoseForm::Angles(Angles::default()),
            ..options
        };
        let mechanics = tree(&urdf, &by_angles);
        return agrees_with(folder, (robot, variant), &mechanics);
    }
    agrees_with(folder, (robot, variant), &tree(&urdf, &options));
}

fn agrees_with(folder: &Path, (robot, variant): (&str, &str), mechanics: &impl Mechanics) {
    let name = format!("{robot}/{variant}");
    let json = json(&folder.join(format!("{robot}.json")));
    let given = &json["variants"][variant];
    let mut names: Vec<String> = texts(&given["dof_order"])
        .into_iter()
        .map(str::to_owned)
        .collect();
    if mechanics.coordinates()[0].name == "base.x" {
        for name in &mut names {
            *name = name.replacen("base_", "base.", 1);
        }
    }
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let reference = Reference::new(name, mechanics, &names, &given["states"]);
    let coriolis = if mechanics.nv() > 12 { 2 } else { usize::MAX };
    reference.agrees(mechanics, 1e-10, coriolis);
    // Those of floating_zyx are differences of accelerations.
    let differences = variant == "floating_zyx";
    reference.derives(mechanics, if differences { 1e-8 } else { 1e-9 });
    if given["trajectory_tau0"].is_object() {
        reference.moves_along(mechanics, &given["trajectory_tau0"]);
    }
}

#[test]
fn robots_agree_with_other_engines() {
    let Some(folder) = folder() else { return };
    for (name, variant) in [
        ("cartpole_roehrl2020", "fixed"),
        ("cartpole_pybullet", "fixed"),
        ("double_pendulum_continuous", "fixed"),
        ("kuka_iiwa", "fixed"),
        ("panda", "fixed"),
        ("panda", "mimic"),
        ("stress_tree", "planar_coords"),
        ("stress_tree", "planar_coords_mimic"),
        ("kinova_j2s6s200", "fixed"),
        ("solo12", "fixed"),
        ("solo12", "floating_quat"),
        ("solo12", "floating_zyx"),
        ("talos_reduced", "fixed"),
        ("talos_reduced", "floating_quat"),
        ("talos_reduced", "floating_zyx"),
        ("pr2", "fixed"),
        ("pr2", "mimic"),
    ] {
        let start = std::time::Instant::now();
        robot(&folder, name, variant);
        eprintln!("{name}/{variant}: {:?}", start.elapsed());
    }
}

#[test]
fn energies_as_text_agree_with_a_computer_algebra_system() {
    let Some(folder) = folder() else { return };
    for name in [
        "cartpole_table2",
        "double_pendulum",
        "triple_pendulum_relative",
        "spherical_pendulum",
        "furuta_pendulum",
        "elastic_pendulum",
    ] {
        let json = json(&folder.join(format!("closed_{name}.json")));
        let parameters = json["parameters"].as_object().unwrap();
        let coordinates: Vec<String> = texts(&json["coordinates"])
            .into_iter()
            .map(|c| c.trim_end_matches("(t)").to_owned())
            .collect();
        let mechanics = text(&TextSource {
            angles: Vec::new(),
            kinetic: from_sympy(&json["lagrangian"]["T"]),
            potential: from_sympy(&json["lagrangian"]["V"]),
            parameters: parameters
                .iter()
                .map(|(name, x)| (name.clone(), x.as_f64().unwrap()))
                .collect(),
            coordinates,
            ..TextSource::default()
        });
        let names: Vec<&str> = texts(&json["coordinates"])
            .into_iter()
            .map(|c| c.trim_end_matches("(t)"))
            .collect();
        let reference = Reference::new(name.to_owned(), &mechanics, &names, &json["states"]);
        reference.agrees(&mechanics, 1e-10, usize::MAX);
    }
}
