//! How the cost grows with the number of joints, on random chains and trees of 10 … 200 links:
//! `cargo bench -p lagrange --bench joints`.
//!
//! With PINODE_TREES set to a folder, their URDF are written there, for a peer to be timed on.
#![allow(clippy::unwrap_used)] // a bench may stop
#![allow(missing_docs)] // of what criterion's macros write

mod support;

use std::fmt::Write;

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use lagrange::Mechanics;
use nalgebra::DVector;

use support::cpu_time::CpuTime;
use support::random::Random;
use support::robot::Robot;

const JOINTS: [usize; 5] = [10, 20, 50, 100, 200];

/// Which link carries the k-th.
#[derive(Clone, Copy)]
enum Shape {
    /// The one before.
    Chain,
    /// Any of the last six: some long branches, many short ones.
    Tree,
}

impl Shape {
    fn name(self) -> &'static str {
        match self {
            Shape::Chain => "chain",
            Shape::Tree => "tree",
        }
    }
    fn parent(self, k: usize, random: &mut Random) -> usize {
        match self {
            Shape::Chain => k,
            Shape::Tree => k - random.below(k.min(6)),
        }
    }
}

fn joints(criterion: &mut Criterion<CpuTime>) {
    for shape in [Shape::Chain, Shape::Tree] {
        let robots = JOINTS.map(|n| (n, robot(shape, n)));
        let mut group = criterion.benchmark_group(shape.name());
        for (n, robot) in &robots {
            let mechanics = &robot.mechanics;
            let p = mechanics.nominal();
            let work = &mut mechanics.workspace();
            let mut out = DVector::zeros(mechanics.nv());
            let mut states = robot.states.iter().cycle();
            group.bench_function(BenchmarkId::new("inverse_dynamics", n), |bencher| {
                bencher.iter(|| {
                    let s = states.next().unwrap();
                    mechanics.inverse_dynamics_into(&s.q, &s.v, &s.a, &p, work, &mut out);
                    out[0]
                });
            });
            group.bench_function(BenchmarkId::new("forward_dynamics", n), |bencher| {
                bencher.iter(|| {
                    let s = states.next().unwrap();
                    out.copy_from_slice(&s.a);
                    mechanics
                        .forward_dynamics_into(&s.q, &s.v, &p, work, &mut out)
                        .unwrap();
                    out[0]
                });
            });
        }
        group.finish();
    }
}

fn robot(shape: Shape, n: usize) -> Robot {
    let name = format!("{}{n}", shape.name());
    let text = urdf(shape, n);
    if let Some(folder) = std::env::var_os("PINODE_TREES") {
        let path = std::path::Path::new(&folder).join(format!("{name}.urdf"));
        std::fs::write(path, &text).unwrap();
    }
    Robot::new(name, &text, false).unwrap()
}

/// `n` links on hinges with oblique axes, turned against each other; each is a body of 0.5 … 1.5 kg.
fn urdf(shape: Shape, n: usize) -> String {
    let mut random = Random(n as u64);
    let mut text = String::from("<robot name=\"random\">\n<link name=\"l0\"/>\n");
    for child in 1..=n {
        let parent = shape.parent(child - 1, &mut random);
        let mass = 1.0 + 0.5 * random.uniform();
        let [x, y, z] = [0, 1, 2].map(|_| mass * (0.02 + 0.01 * random.uniform()));
        let mut triple = |scale: f64| {
            let [x, y, z] = [0, 1, 2].map(|_| scale * random.uniform());
            format!("{x} {y} {z}")
        };
        let (centre, turn) = (triple(0.2), triple(3.0));
        let (origin, rpy) = (triple(0.3), triple(3.0));
        let axis = triple(1.0);
        writeln!(
            text,
            r#"<link name="l{child}"><inertial><origin xyz="{centre}" rpy="{turn}"/><mass value="{mass}"/>
  <inertia ixx="{}" ixy="0" ixz="0" iyy="{}" iyz="0" izz="{}"/></inertial></link>
<joint name="j{child}" type="revolute"><parent link="l{parent}"/><child link="l{child}"/>
  <origin xyz="{origin}" rpy="{rpy}"/><axis xyz="{axis}"/><limit lower="-9" upper="9" effort="9" velocity="9"/></joint>"#,
            y + z,
            x + z,
            x + y,
        )
        .unwrap();
    }
    text + "</robot>\n"
}

criterion_group! {
    name = benches;
    config = support::criterion();
    targets = joints
}
criterion_main!(benches);
