//! Energies written as text beside the same energies written in Rust: `cargo bench -p lagrange --bench text_energies`.
//!
//! T and V on `f64`, and the equations that follow from them, by compiled programs as a user gets them and by dual numbers alone.
#![allow(clippy::unwrap_used)] // a bench may stop
#![allow(missing_docs)] // of what criterion's macros write

mod support;

use criterion::{Criterion, criterion_group, criterion_main};
use lagrange::{Dynamics, Lagrangian, Mechanics, Scalar, TextLagrangian, TextSource};
use nalgebra::{DMatrix, DVector};

use support::cpu_time::CpuTime;
use support::robot::{STATES, states};

const G: f64 = 9.81;

/// A pole on a cart: q = (x, θ from upright). Masses in kg, lengths in m, inertia about the centre in kg·m².
#[derive(Clone)]
struct CartPole;

impl CartPole {
    const CART: f64 = 0.466;
    const POLE: f64 = 0.06;
    const CENTRE: f64 = 0.201;
    const INERTIA: f64 = 0.00099;
    const KINETIC: &str =
        "0.5*(mc + mp)*x_dot^2 + mp*c*cos(th)*x_dot*th_dot + 0.5*(I + mp*c^2)*th_dot^2";
    const POTENTIAL: &str = "mp*g*c*cos(th)";
}

impl Lagrangian for CartPole {
    fn dof(&self) -> usize {
        2
    }
    fn kinetic<D: Scalar>(&self, q: &[D], v: &[D]) -> D {
        let (mp, c) = (Self::POLE, Self::CENTRE);
        v[0] * v[0] * (0.5 * (Self::CART + mp))
            + q[1].cos() * v[0] * v[1] * (mp * c)
            + v[1] * v[1] * (0.5 * (Self::INERTIA + mp * c * c))
    }
    fn potential<D: Scalar>(&self, q: &[D]) -> D {
        q[1].cos() * (Self::POLE * G * Self::CENTRE)
    }
}

/// Two bars, the angle of the second against the first; masses in kg, lengths in m.
#[derive(Clone)]
struct DoublePendulum;

impl DoublePendulum {
    const M: [f64; 2] = [0.243, 0.2025];
    const L: f64 = 0.28;
    const C: [f64; 2] = [0.14, 0.115];
    const I: [f64; 2] = [1.840725e-3, 1.069875e-3];
    const KINETIC: &str = "0.5*(I1 + m1*c1^2)*a_dot^2 + 0.5*I2*(a_dot + b_dot)^2
+ 0.5*m2*(l^2*a_dot^2 + c2^2*(a_dot + b_dot)^2 + 2*l*c2*a_dot*(a_dot + b_dot)*cos(b))";
    const POTENTIAL: &str = "-m1*g*c1*cos(a) - m2*g*(l*cos(a) + c2*cos(a + b))";
}

impl Lagrangian for DoublePendulum {
    fn dof(&self) -> usize {
        2
    }
    fn kinetic<D: Scalar>(&self, q: &[D], v: &[D]) -> D {
        let ([m1, m2], [c1, c2], [i1, i2], l) = (Self::M, Self::C, Self::I, Self::L);
        let both = v[0] + v[1];
        v[0] * v[0] * (0.5 * (i1 + m1 * c1 * c1 + m2 * l * l))
            + both * both * (0.5 * (i2 + m2 * c2 * c2))
            + v[0] * both * q[1].cos() * (m2 * l * c2)
    }
    fn potential<D: Scalar>(&self, q: &[D]) -> D {
        let ([m1, m2], [c1, c2]) = (Self::M, Self::C);
        q[0].cos() * (-(m1 * c1 + m2 * Self::L) * G) - (q[0] + q[1]).cos() * (m2 * c2 * G)
    }
}

/// Three point masses of 1 kg on massless rods of 1 m; every angle against the rod before.
#[derive(Clone)]
struct TriplePendulum;

impl TriplePendulum {
    const KINETIC: &str = "0.5*m*l^2*(a_dot^2 + (a_dot*cos(a) + (a_dot + b_dot)*cos(a + b))^2
+ (a_dot*sin(a) + (a_dot + b_dot)*sin(a + b))^2
+ (a_dot*cos(a) + (a_dot + b_dot)*cos(a + b) + (a_dot + b_dot + c_dot)*cos(a + b + c))^2
+ (a_dot*sin(a) + (a_dot + b_dot)*sin(a + b) + (a_dot + b_dot + c_dot)*sin(a + b + c))^2)";
    const POTENTIAL: &str = "-m*g*l*(3*cos(a) + 2*cos(a + b) + cos(a + b + c))";
}

impl Lagrangian for TriplePendulum {
    fn dof(&self) -> usize {
        3
    }
    fn kinetic<D: Scalar>(&self, q: &[D], v: &[D]) -> D {
        let (mut angle, mut rate) = (D::zero(), D::zero());
        let (mut x, mut y, mut sum) = (D::zero(), D::zero(), D::zero());
        for (q, v) in q.iter().zip(v) {
            angle = angle + *q;
            rate = rate + *v;
            x = x + rate * angle.cos();
            y = y + rate * angle.sin();
            sum = sum + x * x + y * y;
        }
        sum * 0.5
    }
    fn potential<D: Scalar>(&self, q: &[D]) -> D {
        let (b, c) = (q[0] + q[1], q[0] + q[1] + q[2]);
        -(q[0].cos() * 3.0 + b.cos() * 2.0 + c.cos()) * G
    }
}

fn text(
    kinetic: &str,
    potential: &str,
    angles: &[&str],
    constants: &[(&str, f64)],
) -> TextLagrangian {
    TextLagrangian::new(&TextSource {
        coordinates: angles.iter().map(|&a| a.into()).collect(),
        kinetic: kinetic.into(),
        potential: potential.into(),
        parameters: constants
            .iter()
            .map(|&(name, x)| (name.into(), x))
            .collect(),
        ..TextSource::default()
    })
    .map_err(|problems| problems.iter().map(ToString::to_string).collect::<String>())
    .unwrap()
}

fn text_energies(criterion: &mut Criterion<CpuTime>) {
    let constants = [
        ("mc", CartPole::CART),
        ("mp", CartPole::POLE),
        ("c", CartPole::CENTRE),
        ("I", CartPole::INERTIA),
        ("g", G),
    ];
    let written = text(
        CartPole::KINETIC,
        CartPole::POTENTIAL,
        &["x", "th"],
        &constants,
    );
    compare(criterion, "cartpole", CartPole, written);

    let ([m1, m2], [c1, c2], [i1, i2]) = (DoublePendulum::M, DoublePendulum::C, DoublePendulum::I);
    let constants = [
        ("m1", m1),
        ("m2", m2),
        ("l", DoublePendulum::L),
        ("c1", c1),
        ("c2", c2),
        ("I1", i1),
        ("I2", i2),
        ("g", G),
    ];
    let (kinetic, potential) = (DoublePendulum::KINETIC, DoublePendulum::POTENTIAL);
    let written = text(kinetic, potential, &["a", "b"], &constants);
    compare(criterion, "double_pendulum", DoublePendulum, written);

    let constants = [("m", 1.0), ("l", 1.0), ("g", G)];
    let (kinetic, potential) = (TriplePendulum::KINETIC, TriplePendulum::POTENTIAL);
    let written = text(kinetic, potential, &["a", "b", "c"], &constants);
    compare(criterion, "triple_pendulum", TriplePendulum, written);
}

/// The same calls on both, which must agree before they are timed.
fn compare(
    criterion: &mut Criterion<CpuTime>,
    name: &str,
    rust: impl Lagrangian + Clone,
    text: TextLagrangian,
) {
    let (a, b) = (Dynamics::of(rust.clone()), Dynamics::of(text.clone()));
    for s in states(&a) {
        let [x, y] =
            [&a as &dyn Mechanics, &b].map(|m| m.inverse_dynamics(&s.q, &s.v, &s.a).unwrap());
        assert!(
            (&x - &y).amax() <= 1e-12 * x.amax().max(1.0),
            "{name}: {x} in Rust, {y} as text"
        );
    }
    time(
        criterion,
        &format!("text/{name}/rust"),
        &a,
        &Dynamics::of(rust).by_duals(),
    );
    time(
        criterion,
        &format!("text/{name}/text"),
        &b,
        &Dynamics::of(text).by_duals(),
    );
}

/// Times the energies, the equations as a user gets them, and those `by_duals`.
fn time(
    criterion: &mut Criterion<CpuTime>,
    name: &str,
    mechanics: &impl Mechanics,
    by_duals: &impl Mechanics,
) {
    let mut group = criterion.benchmark_group(name);
    let states = states(mechanics);
    assert_eq!(states.len(), STATES);
    let mut states = states.iter().cycle();
    let p = mechanics.nominal();
    let n = mechanics.nv();
    group.bench_function("kinetic_energy", |bencher| {
        bencher.iter(|| {
            let s = states.next().unwrap();
            mechanics.kinetic_energy_with(&s.q, &s.v, &p)
        });
    });
    group.bench_function("potential_energy", |bencher| {
        bencher.iter(|| mechanics.potential_energy_with(&states.next().unwrap().q, &p));
    });
    for (route, mechanics) in [("", mechanics as &dyn Mechanics), ("_by_duals", by_duals)] {
        let work = &mut mechanics.workspace();
        let (mut mass, mut force) = (DMatrix::zeros(n, n), DVector::zeros(n));
        group.bench_function(format!("mass_matrix{route}"), |bencher| {
            bencher.iter(|| {
                mechanics.mass_matrix_into(&states.next().unwrap().q, &p, work, &mut mass);
                mass[0]
            });
        });
        group.bench_function(format!("inverse_dynamics{route}"), |bencher| {
            bencher.iter(|| {
                let s = states.next().unwrap();
                mechanics.inverse_dynamics_into(&s.q, &s.v, &s.a, &p, work, &mut force);
                force[0]
            });
        });
        group.bench_function(format!("forward_dynamics{route}"), |bencher| {
            bencher.iter(|| {
                let s = states.next().unwrap();
                force.copy_from_slice(&s.a);
                mechanics
                    .forward_dynamics_into(&s.q, &s.v, &p, work, &mut force)
                    .unwrap();
                force[0]
            });
        });
    }
    group.finish();
}

criterion_group! {
    name = benches;
    config = support::criterion();
    targets = text_energies
}
criterion_main!(benches);
