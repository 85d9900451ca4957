//! Eight states, one after the other: for mechanisms whose equations are not evaluated in lanes.

use super::Workspace;
use crate::{Error, LANES, Mechanics};

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
        for (to, from) in out.iter_mut().zip(mass.as_slice()) {
            to[lane] = *from;
        }
    }
    work.lane = one;
    work.lane_matrix = mass;
}
