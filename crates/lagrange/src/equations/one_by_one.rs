//! Eight states, one after the other: for mechanisms whose equations are not evaluated in lanes.

use super::Workspace;
use super::workspace::Gradients;
use crate::{Error, LANES, Mechanics};
use crate::{ForwardDynamicsDerivatives, ForwardDynamicsGradient};
use crate::{InverseDynamicsDerivatives, InverseDynamicsGradient};

/// One vector of eight states.
type Eight<'a> = &'a [[f64; LANES]];

pub(crate) fn inverse_dynamics<M: Mechanics + ?Sized>(
    mechanics: &M,
    (q, v, a): (Eight, Eight, Eight),
    p: &[f64],
    work: &mut Workspace,
    out: &mut [[f64; LANES]],
) {
    let mut one = std::mem::take(&mut work.lane);
    for lane in 0..LANES {
        one.load(lane, q, v, a);
        mechanics.inverse_dynamics_into(&one.q, &one.v, &one.a, p, work, &mut one.out);
        one.store(lane, out);
    }
    work.lane = one;
}

pub(crate) fn forward_dynamics<M: Mechanics + ?Sized>(
    mechanics: &M,
    (q, v): (Eight, Eight),
    p: &[f64],
    work: &mut Workspace,
    out: &mut [[f64; LANES]],
) -> Result<(), Error> {
    let mut one = std::mem::take(&mut work.lane);
    let mut solved = Ok(());
    for lane in 0..LANES {
        one.load(lane, q, v, out);
        one.out.copy_from_slice(&one.a);
        solved = mechanics.forward_dynamics_into(&one.q, &one.v, p, work, &mut one.out);
        if solved.is_err() {
            break;
        }
        one.store(lane, out);
    }
    work.lane = one;
    solved
}

pub(crate) fn mass_matrix<M: Mechanics + ?Sized>(
    mechanics: &M,
    q: Eight,
    p: &[f64],
    work: &mut Workspace,
    out: &mut [[f64; LANES]],
) {
    let mut one = std::mem::take(&mut work.lane);
    let mut mass = std::mem::take(&mut work.lane_matrix);
    for lane in 0..LANES {
        one.load(lane, q, &[], &[]);
        mechanics.mass_matrix_into(&one.q, p, work, &mut mass);
        store(lane, mass.as_slice(), out);
    }
    work.lane = one;
    work.lane_matrix = mass;
}

pub(crate) fn coriolis_matrix<M: Mechanics + ?Sized>(
    mechanics: &M,
    (q, v): (Eight, Eight),
    p: &[f64],
    work: &mut Workspace,
    out: &mut [[f64; LANES]],
) {
    let mut one = std::mem::take(&mut work.lane);
    let mut coriolis = std::mem::take(&mut work.lane_matrix);
    for lane in 0..LANES {
        one.load(lane, q, v, &[]);
        mechanics.coriolis_matrix_into(&one.q, &one.v, p, work, &mut coriolis);
        store(lane, coriolis.as_slice(), out);
    }
    work.lane = one;
    work.lane_matrix = coriolis;
}

pub(crate) fn gravity_force<M: Mechanics + ?Sized>(
    mechanics: &M,
    q: Eight,
    p: &[f64],
    work: &mut Workspace,
    out: &mut [[f64; LANES]],
) {
    let mut one = std::mem::take(&mut work.lane);
    for lane in 0..LANES {
        one.load(lane, q, &[], &[]);
        mechanics.gravity_force_into(&one.q, p, work, &mut one.out);
        one.store(lane, out);
    }
    work.lane = one;
}

pub(crate) fn bias_force<M: Mechanics + ?Sized>(
    mechanics: &M,
    (q, v): (Eight, Eight),
    p: &[f64],
    work: &mut Workspace,
    out: &mut [[f64; LANES]],
) {
    let mut one = std::mem::take(&mut work.lane);
    for lane in 0..LANES {
        one.load(lane, q, v, &[]);
        mechanics.bias_force_into(&one.q, &one.v, p, work, &mut one.out);
        one.store(lane, out);
    }
    work.lane = one;
}

pub(crate) fn inverse_derivatives<M: Mechanics + ?Sized>(
    mechanics: &M,
    (q, v, a): (Eight, Eight, Eight),
    p: &[f64],
    constants: &[usize],
    work: &mut Workspace,
    out: &mut InverseDynamicsDerivatives<[f64; LANES]>,
) {
    let mut one = std::mem::take(&mut work.lane);
    let mut derivatives = work.take_derivatives(mechanics.nv(), p.len());
    let by = &mut derivatives.inverse;
    for lane in 0..LANES {
        one.load(lane, q, v, a);
        let (q, v, a) = (&one.q, &one.v, &one.a);
        mechanics.inverse_dynamics_derivatives_into(q, v, a, p, constants, work, by);
        store(lane, by.by_q.as_slice(), out.by_q.as_mut_slice());
        store(lane, by.by_v.as_slice(), out.by_v.as_mut_slice());
        store(lane, by.by_p.as_slice(), out.by_p.as_mut_slice());
    }
    work.lane = one;
    work.derivatives = Some(derivatives);
}

pub(crate) fn forward_derivatives<M: Mechanics + ?Sized>(
    mechanics: &M,
    (q, v, force): (Eight, Eight, Eight),
    p: &[f64],
    constants: &[usize],
    work: &mut Workspace,
    out: &mut ForwardDynamicsDerivatives<[f64; LANES]>,
) -> Result<(), Error> {
    let mut one = std::mem::take(&mut work.lane);
    let mut derivatives = work.take_derivatives(mechanics.nv(), p.len());
    let by = &mut derivatives.forward;
    let mut solved = Ok(());
    for lane in 0..LANES {
        one.load(lane, q, v, force);
        let (q, v, a) = (&one.q, &one.v, &one.a);
        solved = mechanics.forward_dynamics_derivatives_into(q, v, a, p, constants, work, by);
        if solved.is_err() {
            break;
        }
        for (from, to) in [
            (by.acceleration.as_slice(), out.acceleration.as_mut_slice()),
            (by.by_q.as_slice(), out.by_q.as_mut_slice()),
            (by.by_v.as_slice(), out.by_v.as_mut_slice()),
            (by.by_force.as_slice(), out.by_force.as_mut_slice()),
            (by.by_p.as_slice(), out.by_p.as_mut_slice()),
        ] {
            store(lane, from, to);
        }
    }
    work.lane = one;
    work.derivatives = Some(derivatives);
    solved
}

pub(crate) fn inverse_gradient<M: Mechanics + ?Sized>(
    mechanics: &M,
    (q, v, a): (Eight, Eight, Eight),
    p: &[f64],
    weight: Eight,
    work: &mut Workspace,
    out: &mut InverseDynamicsGradient<[f64; LANES]>,
) {
    let mut one = std::mem::take(&mut work.lane);
    let mut gradients = work.take_gradients(mechanics.nv(), p.len());
    let Gradients {
        inverse: by,
        weight: row,
        ..
    } = &mut *gradients;
    for lane in 0..LANES {
        one.load(lane, q, v, a);
        load(lane, weight, row);
        let (q, v, a) = (&one.q, &one.v, &one.a);
        mechanics.inverse_dynamics_gradient_into(q, v, a, p, row, work, by);
        for (from, to) in [
            (&by.by_q, &mut out.by_q),
            (&by.by_v, &mut out.by_v),
            (&by.by_a, &mut out.by_a),
            (&by.by_p, &mut out.by_p),
        ] {
            store(lane, from.as_slice(), to.as_mut_slice());
        }
    }
    work.lane = one;
    work.gradients = Some(gradients);
}

pub(crate) fn forward_gradient<M: Mechanics + ?Sized>(
    mechanics: &M,
    (q, v, force): (Eight, Eight, Eight),
    p: &[f64],
    weight: Eight,
    work: &mut Workspace,
    out: &mut ForwardDynamicsGradient<[f64; LANES]>,
) -> Result<(), Error> {
    let mut one = std::mem::take(&mut work.lane);
    let mut gradients = work.take_gradients(mechanics.nv(), p.len());
    let Gradients {
        forward: by,
        weight: row,
        ..
    } = &mut *gradients;
    let mut solved = Ok(());
    for lane in 0..LANES {
        one.load(lane, q, v, force);
        load(lane, weight, row);
        let (q, v, a) = (&one.q, &one.v, &one.a);
        solved = mechanics.forward_dynamics_gradient_into(q, v, a, p, row, work, by);
        if solved.is_err() {
            break;
        }
        for (from, to) in [
            (&by.acceleration, &mut out.acceleration),
            (&by.by_q, &mut out.by_q),
            (&by.by_v, &mut out.by_v),
            (&by.by_force, &mut out.by_force),
            (&by.by_p, &mut out.by_p),
        ] {
            store(lane, from.as_slice(), to.as_mut_slice());
        }
    }
    work.lane = one;
    work.gradients = Some(gradients);
    solved
}

fn load(lane: usize, from: Eight, to: &mut [f64]) {
    for (to, from) in to.iter_mut().zip(from) {
        *to = from[lane];
    }
}

fn store(lane: usize, from: &[f64], to: &mut [[f64; LANES]]) {
    for (to, from) in to.iter_mut().zip(from) {
        to[lane] = *from;
    }
}
