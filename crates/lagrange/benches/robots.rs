//! Every call of [`Mechanics`] on robots, over 64 random states: `cargo bench -p lagrange --bench robots`.
//!
//! The names are those of the rows in BENCHMARKS.md; `benches/peers` runs the same in Pinocchio and MuJoCo.
#![allow(clippy::unwrap_used)] // a bench may stop
#![allow(missing_docs)] // of what criterion's macros write

mod support;

use criterion::{BenchmarkGroup, Criterion, criterion_group, criterion_main};
use lagrange::{
    ForwardDynamicsDerivatives, ForwardDynamicsGradient, InverseDynamicsDerivatives,
    InverseDynamicsGradient, LANES, Mechanics,
};
use nalgebra::{DMatrix, DVector};

use support::cpu_time::CpuTime;
use support::robot::{self, Robot, State};

fn robots(criterion: &mut Criterion<CpuTime>) {
    for robot in robot::all() {
        let mut group = criterion.benchmark_group(&robot.name);
        matrices_and_forces(&mut group, &robot);
        dynamics(&mut group, &robot);
        derivatives(&mut group, &robot);
        lanes(&mut group, &robot);
        group.finish();
    }
}

/// Times `call` over the robot's states, one after the other.
fn over_states(
    group: &mut BenchmarkGroup<'_, CpuTime>,
    name: &str,
    robot: &Robot,
    mut call: impl FnMut(&State) -> f64,
) {
    let mut states = robot.states.iter().cycle();
    group.bench_function(name, |bencher| {
        bencher.iter(|| call(states.next().unwrap()))
    });
}

fn matrices_and_forces(group: &mut BenchmarkGroup<'_, CpuTime>, robot: &Robot) {
    let mechanics = &robot.mechanics;
    let (n, p) = (mechanics.nv(), mechanics.nominal());
    let work = &mut mechanics.workspace();
    let (mut mass, mut coriolis) = (DMatrix::zeros(n, n), DMatrix::zeros(n, n));
    let mut force = DVector::zeros(n);

    over_states(group, "mass_matrix", robot, |s| {
        mechanics.mass_matrix_into(&s.q, &p, work, &mut mass);
        mass[0]
    });
    over_states(group, "coriolis_matrix", robot, |s| {
        mechanics.coriolis_matrix_into(&s.q, &s.v, &p, work, &mut coriolis);
        coriolis[0]
    });
    over_states(group, "gravity_force", robot, |s| {
        mechanics.gravity_force_into(&s.q, &p, work, &mut force);
        force[0]
    });
    over_states(group, "bias_force", robot, |s| {
        mechanics.bias_force_into(&s.q, &s.v, &p, work, &mut force);
        force[0]
    });
    over_states(group, "M_C_G_together", robot, |s| {
        let (mass, coriolis, gravity) = (&mut mass, &mut coriolis, &mut force);
        mechanics.equations_into(&s.q, &s.v, &p, work, mass, coriolis, gravity);
        mass[0] + coriolis[0] + gravity[0]
    });
    over_states(group, "energies", robot, |s| {
        mechanics.kinetic_energy_with(&s.q, &s.v, &p) + mechanics.potential_energy_with(&s.q, &p)
    });
}

fn dynamics(group: &mut BenchmarkGroup<'_, CpuTime>, robot: &Robot) {
    let mechanics = &robot.mechanics;
    let p = mechanics.nominal();
    let work = &mut mechanics.workspace();
    let mut out = DVector::zeros(mechanics.nv());

    over_states(group, "inverse_dynamics", robot, |s| {
        mechanics.inverse_dynamics_into(&s.q, &s.v, &s.a, &p, work, &mut out);
        out[0]
    });
    over_states(group, "forward_dynamics", robot, |s| {
        out.copy_from_slice(&s.a);
        mechanics
            .forward_dynamics_into(&s.q, &s.v, &p, work, &mut out)
            .unwrap();
        out[0]
    });
}

fn derivatives(group: &mut BenchmarkGroup<'_, CpuTime>, robot: &Robot) {
    let mechanics = &robot.mechanics;
    let (n, p) = (mechanics.nv(), mechanics.nominal());
    let work = &mut mechanics.workspace();
    let mut inverse = InverseDynamicsDerivatives::zeros(n, 0);
    let mut forward = ForwardDynamicsDerivatives::zeros(n, 0);

    over_states(group, "inverse_dynamics_derivatives", robot, |s| {
        let out = &mut inverse;
        mechanics.inverse_dynamics_derivatives_into(&s.q, &s.v, &s.a, &p, &[], work, out);
        inverse.by_q[0]
    });
    over_states(group, "forward_dynamics_derivatives", robot, |s| {
        let out = &mut forward;
        mechanics
            .forward_dynamics_derivatives_into(&s.q, &s.v, &s.a, &p, &[], work, out)
            .unwrap();
        forward.by_q[0]
    });
    let np = p.len();
    let mut inverse = InverseDynamicsGradient::zeros(n, np);
    let mut forward = ForwardDynamicsGradient::zeros(n, np);
    over_states(group, "inverse_dynamics_gradient", robot, |s| {
        let out = &mut inverse;
        mechanics.inverse_dynamics_gradient_into(&s.q, &s.v, &s.a, &p, &s.a, work, out);
        inverse.by_q[0]
    });
    over_states(group, "forward_dynamics_gradient", robot, |s| {
        let out = &mut forward;
        mechanics
            .forward_dynamics_gradient_into(&s.q, &s.v, &s.a, &p, &s.a, work, out)
            .unwrap();
        forward.by_q[0]
    });
}

/// Eight states side by side: q, v and v̇ or Q.
type Batch = [Vec<[f64; LANES]>; 3];

/// Eight states at once; a figure is for all eight.
fn lanes(group: &mut BenchmarkGroup<'_, CpuTime>, robot: &Robot) {
    let batches: Vec<Batch> = robot
        .states
        .as_chunks::<LANES>()
        .0
        .iter()
        .map(|eight| {
            [
                side_by_side(eight, |s| &s.q),
                side_by_side(eight, |s| &s.v),
                side_by_side(eight, |s| &s.a),
            ]
        })
        .collect();
    lanes_of_terms(group, robot, &batches);
    lanes_of_derivatives(group, robot, &batches);
}

/// Times `call` over the batches, one after the other.
fn over_batches(
    group: &mut BenchmarkGroup<'_, CpuTime>,
    name: &str,
    batches: &[Batch],
    mut call: impl FnMut(&Batch) -> f64,
) {
    let mut batches = batches.iter().cycle();
    group.bench_function(name, |bencher| {
        bencher.iter(|| call(batches.next().unwrap()))
    });
}

fn lanes_of_terms(group: &mut BenchmarkGroup<'_, CpuTime>, robot: &Robot, batches: &[Batch]) {
    let mechanics = &robot.mechanics;
    let (n, p) = (mechanics.nv(), mechanics.nominal());
    let work = &mut mechanics.workspace();
    let mut out = vec![[0.0; LANES]; n];
    let (mut mass, mut matrix) = (vec![[0.0; LANES]; n * n], vec![[0.0; LANES]; n * n]);

    over_batches(group, "inverse_dynamics_lanes", batches, |[q, v, a]| {
        mechanics.inverse_dynamics_lanes_into(q, v, a, &p, work, &mut out);
        out[0][0]
    });
    over_batches(group, "forward_dynamics_lanes", batches, |[q, v, force]| {
        out.copy_from_slice(force);
        mechanics
            .forward_dynamics_lanes_into(q, v, &p, work, &mut out)
            .unwrap();
        out[0][0]
    });
    over_batches(group, "mass_matrix_lanes", batches, |[q, _, _]| {
        mechanics.mass_matrix_lanes_into(q, &p, work, &mut mass);
        mass[0][0]
    });
    over_batches(group, "coriolis_matrix_lanes", batches, |[q, v, _]| {
        mechanics.coriolis_matrix_lanes_into(q, v, &p, work, &mut matrix);
        matrix[0][0]
    });
    over_batches(group, "gravity_force_lanes", batches, |[q, _, _]| {
        mechanics.gravity_force_lanes_into(q, &p, work, &mut out);
        out[0][0]
    });
    over_batches(group, "bias_force_lanes", batches, |[q, v, _]| {
        mechanics.bias_force_lanes_into(q, v, &p, work, &mut out);
        out[0][0]
    });
    over_batches(group, "M_C_G_together_lanes", batches, |[q, v, _]| {
        let (mass, matrix) = (&mut mass, &mut matrix);
        mechanics.equations_lanes_into(q, v, &p, work, mass, matrix, &mut out);
        mass[0][0] + matrix[0][0] + out[0][0]
    });
}

fn lanes_of_derivatives(group: &mut BenchmarkGroup<'_, CpuTime>, robot: &Robot, batches: &[Batch]) {
    let mechanics = &robot.mechanics;
    let (n, p) = (mechanics.nv(), mechanics.nominal());
    let work = &mut mechanics.workspace();
    let mut inverse = InverseDynamicsDerivatives::lanes(n, 0);
    let mut forward = ForwardDynamicsDerivatives::lanes(n, 0);
    let mut inverse_row = InverseDynamicsGradient::lanes(n, p.len());
    let mut forward_row = ForwardDynamicsGradient::lanes(n, p.len());

    let name = "inverse_dynamics_derivatives_lanes";
    over_batches(group, name, batches, |[q, v, a]| {
        let out = &mut inverse;
        mechanics.inverse_dynamics_derivatives_lanes_into(q, v, a, &p, &[], work, out);
        inverse.by_q[0][0]
    });
    let name = "forward_dynamics_derivatives_lanes";
    over_batches(group, name, batches, |[q, v, force]| {
        let out = &mut forward;
        mechanics
            .forward_dynamics_derivatives_lanes_into(q, v, force, &p, &[], work, out)
            .unwrap();
        forward.by_q[0][0]
    });
    let name = "inverse_dynamics_gradient_lanes";
    over_batches(group, name, batches, |[q, v, a]| {
        let out = &mut inverse_row;
        mechanics.inverse_dynamics_gradient_lanes_into(q, v, a, &p, a, work, out);
        inverse_row.by_q[0][0]
    });
    let name = "forward_dynamics_gradient_lanes";
    over_batches(group, name, batches, |[q, v, force]| {
        let out = &mut forward_row;
        mechanics
            .forward_dynamics_gradient_lanes_into(q, v, force, &p, v, work, out)
            .unwrap();
        forward_row.by_q[0][0]
    });
}

/// Entry i of eight vectors in the lanes of entry i.
fn side_by_side(states: &[State; LANES], of: impl Fn(&State) -> &Vec<f64>) -> Vec<[f64; LANES]> {
    let length = of(&states[0]).len();
    (0..length)
        .map(|i| std::array::from_fn(|lane| of(&states[lane])[i]))
        .collect()
}

criterion_group! {
    name = benches;
    config = support::criterion();
    targets = robots
}
criterion_main!(benches);
