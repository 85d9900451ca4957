//! Effects that change the mechanics: what they add to M, C and G, and v̇ with them.
//!
//! With the equations ID_t = M_t v̇ + C_t v + G_t of some mechanisms t (the point masses; the bodies under a gravity of another
//! direction, of which only G counts) and factors c_t of the effects' parameters p:
//!
//! (M₀ + Σ c_t M_t + Σ s_i I_i e_i e_iᵀ) v̇ = Q − (C₀ v + G₀) − Σ c_t (C_t v + G_t)
//!
//! with s = 1 for a rotor, −1 for a motor that moves by itself,
//!
//! and for x among q, v and all constants ∂v̇/∂x = −M⁻¹ ∂ID/∂x at fixed v̇, ID the sum.

mod derivatives;
mod momenta;
mod variants;

use std::sync::Arc;

use lagrange::{Error, Mechanics, Workspace};
use lagrange::{InverseDynamicsDerivatives, InverseDynamicsGradient};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use super::{Hybrid, State};
use crate::effect::Inertial;
use crate::entries::Start;

pub(super) use variants::Variants;

/// What the effects of one model add.
pub(super) struct Extra {
    /// Where the parameters of these effects lie in θ: slot by slot.
    pub parameters: Vec<usize>,
    terms: Vec<Term>,
    rotors: Vec<Rotor>,
    /// The bodies with a point mass, and its slot.
    points: Vec<(usize, usize)>,
    /// Number of bodies.
    bodies: usize,
    /// Whether each effect has a place: else there is no motion.
    in_place: bool,
}

/// Inertia on one entry of v.
struct Rotor {
    v: usize,
    slot: usize,
    /// −1 where it is taken away.
    sign: f64,
}

/// The equations of one mechanism.
struct Term {
    mechanics: Arc<dyn Mechanics>,
    /// Whether its constants are the point masses, and not those of the model's mechanics.
    of_points: bool,
    factor: Factor,
}

#[derive(Clone, Copy)]
enum Factor {
    /// 1.
    One,
    /// The sine of a slot's angle, of G alone.
    Sine(usize),
    /// Its cosine less 1, of G alone.
    CosineLessOne(usize),
}

impl Factor {
    /// The factor, and its derivative with the slot it is in.
    fn at(self, p: &[f64]) -> (f64, Option<(usize, f64)>) {
        match self {
            Factor::One => (1.0, None),
            Factor::Sine(slot) => (p[slot].sin(), Some((slot, p[slot].cos()))),
            // 1 − cos α without cancellation.
            Factor::CosineLessOne(slot) => (
                -2.0 * (0.5 * p[slot]).sin().powi(2),
                Some((slot, -p[slot].sin())),
            ),
        }
    }

    /// Whether M and C do not count.
    fn is_weight(self) -> bool {
        !matches!(self, Factor::One)
    }
}

/// Memory of one thread for one set of free constants.
pub(super) struct ExtraMemory {
    works: Vec<Workspace>,
    /// The parameters, slot by slot, and the point masses, body by body.
    p: Vec<f64>,
    masses: Vec<f64>,
    zeros: Vec<f64>,
    mass: DMatrix<f64>,
    part_of_mass: DMatrix<f64>,
    bias: DVector<f64>,
    part: DVector<f64>,
    row: Vec<f64>,
    /// The bodies with a point mass.
    added: Vec<usize>,
    derivatives: InverseDynamicsDerivatives,
    of_terms: Vec<InverseDynamicsDerivatives>,
    gradient: InverseDynamicsGradient,
    gradients: Vec<InverseDynamicsGradient>,
    /// ∂ID/∂p of the last derivatives, one column a slot.
    pub by_slot: DMatrix<f64>,
    /// λᵀ ∂ID/∂p of the last gradient.
    pub of_slots: Vec<f64>,
}

impl Extra {
    /// `None` where no effect of `hybrid` changes the mechanics.
    pub fn of(hybrid: &Hybrid) -> Option<Self> {
        let mut extra = Extra {
            parameters: Vec::new(),
            terms: Vec::new(),
            rotors: Vec::new(),
            points: Vec::new(),
            bodies: 0,
            in_place: true,
        };
        let variants = hybrid.variants.as_deref();
        let mut tilts = Vec::new();
        for (effect, range) in hybrid.effects.iter().zip(&hybrid.ranges) {
            let Some(change) = effect.kind.inertial() else {
                continue;
            };
            let slot = extra.parameters.len();
            let parameter = effect.kind.inertial_parameter();
            extra.parameters.push(range.start + parameter);
            match change {
                Inertial::Rotor | Inertial::Motor => {
                    let coordinate = hybrid.coordinate_of(effect.kind, effect.target);
                    let sign = match change {
                        Inertial::Motor => -1.0,
                        _ => 1.0,
                    };
                    match hybrid.starts.get(coordinate) {
                        Some(&Start { v, .. }) => extra.rotors.push(Rotor { v, slot, sign }),
                        None => extra.in_place = false,
                    }
                }
                Inertial::PointMass => {
                    let link = variants.and_then(|v| v.tree().links().get(effect.target));
                    match link.and_then(|link| link.body) {
                        Some(body) => extra.points.push((body, slot)),
                        None => extra.in_place = false,
                    }
                }
                Inertial::Tilt => tilts.push((effect.target, slot)),
            }
        }
        if extra.parameters.is_empty() {
            return None;
        }
        extra.in_place &= hybrid.mechanics.constraints().is_none();
        extra.bodies = variants.map_or(0, |v| v.tree().bodies().len());
        let points = match extra.points.is_empty() {
            true => None,
            false => variants.and_then(|v| v.points()),
        };
        let mut put = |mechanics, of_points, factor| match mechanics {
            Some(mechanics) => extra.terms.push(Term {
                mechanics,
                of_points,
                factor,
            }),
            None => extra.in_place = false,
        };
        for (c, slot) in tilts {
            let tilted = |of_points| variants.and_then(|v| v.tilted(c, of_points));
            put(tilted(false), false, Factor::Sine(slot));
            let own = Some(hybrid.mechanics.clone());
            put(own, false, Factor::CosineLessOne(slot));
            if points.is_some() {
                put(tilted(true), true, Factor::Sine(slot));
                put(points.clone(), true, Factor::CosineLessOne(slot));
            }
        }
        if points.is_some() {
            put(points, true, Factor::One);
        }
        Some(extra)
    }

    /// For `nv` velocities, `np` constants of the mechanics and derivatives in `selected` of them.
    pub fn memory(&self, nv: usize, np: usize, selected: usize) -> ExtraMemory {
        let added: Vec<usize> = self.points.iter().map(|(body, _)| *body).collect();
        let of = |term: &Term| {
            if term.of_points {
                added.len()
            } else {
                selected
            }
        };
        let all = |term: &Term| if term.of_points { self.bodies } else { np };
        let terms = self.terms.iter();
        ExtraMemory {
            works: terms.clone().map(|t| t.mechanics.workspace()).collect(),
            p: vec![0.0; self.parameters.len()],
            masses: vec![0.0; self.bodies],
            zeros: vec![0.0; nv],
            mass: DMatrix::zeros(nv, nv),
            part_of_mass: DMatrix::zeros(nv, nv),
            bias: DVector::zeros(nv),
            part: DVector::zeros(nv),
            row: vec![0.0; nv],
            derivatives: InverseDynamicsDerivatives::zeros(nv, selected),
            of_terms: terms
                .clone()
                .map(|t| InverseDynamicsDerivatives::zeros(nv, of(t)))
                .collect(),
            gradient: InverseDynamicsGradient::zeros(nv, np),
            gradients: terms
                .map(|t| InverseDynamicsGradient::zeros(nv, all(t)))
                .collect(),
            by_slot: DMatrix::zeros(nv, self.parameters.len()),
            of_slots: vec![0.0; self.parameters.len()],
            added,
        }
    }

    /// The terms with their constants and memory.
    fn load(&self, theta: &[f64], memory: &mut ExtraMemory) {
        for (to, &index) in memory.p.iter_mut().zip(&self.parameters) {
            *to = match self.in_place {
                true => theta[index],
                false => f64::NAN,
            };
        }
        memory.masses.fill(0.0);
        for &(body, slot) in &self.points {
            memory.masses[body] += memory.p[slot];
        }
    }

    /// Adds to M.
    fn add_mass(&self, q: &[f64], memory: &mut ExtraMemory, mass: &mut DMatrix<f64>) {
        for (term, work) in self.terms.iter().zip(&mut memory.works) {
            if !term.factor.is_weight() {
                let part = &mut memory.part_of_mass;
                term.mechanics
                    .mass_matrix_into(q, &memory.masses, work, part);
                *mass += &*part;
            }
        }
        for &Rotor { v, slot, sign } in &self.rotors {
            mass[(v, v)] += sign * memory.p[slot];
        }
        if !self.in_place {
            mass.fill(f64::NAN);
        }
    }

    /// M of the whole model, into `mass`.
    pub fn mass_matrix(
        &self,
        (mechanics, constants): (&dyn Mechanics, &[f64]),
        q: &[f64],
        theta: &[f64],
        work: &mut Workspace,
        memory: &mut ExtraMemory,
        mass: &mut DMatrix<f64>,
    ) {
        self.load(theta, memory);
        mechanics.mass_matrix_into(q, constants, work, mass);
        self.add_mass(q, memory, mass);
    }

    /// Adds to C v + G.
    pub fn add_bias(
        &self,
        (q, v): (&[f64], &[f64]),
        (theta, constants): (&[f64], &[f64]),
        memory: &mut ExtraMemory,
        bias: &mut DVector<f64>,
    ) {
        self.load(theta, memory);
        for (term, work) in self.terms.iter().zip(&mut memory.works) {
            let p = match term.of_points {
                true => &memory.masses,
                false => constants,
            };
            let part = &mut memory.part;
            match term.factor.is_weight() {
                true => term.mechanics.gravity_force_into(q, p, work, part),
                false => term.mechanics.bias_force_into(q, v, p, work, part),
            }
            bias.axpy(term.factor.at(&memory.p).0, part, 1.0);
        }
    }

    /// v̇ from Q in `force`, and the factor of M.
    fn solve(
        &self,
        (mechanics, constants): (&dyn Mechanics, &[f64]),
        state: State<'_>,
        theta: &[f64],
        work: &mut Workspace,
        memory: &mut ExtraMemory,
        force: &mut DVector<f64>,
    ) -> Result<Cholesky<f64, Dyn>, Error> {
        let State { q, v, .. } = state;
        let mut mass = std::mem::take(&mut memory.mass);
        let mut bias = std::mem::take(&mut memory.bias);
        self.mass_matrix((mechanics, constants), q, theta, work, memory, &mut mass);
        mechanics.bias_force_into(q, v, constants, work, &mut bias);
        self.add_bias((q, v), (theta, constants), memory, &mut bias);
        *force -= &bias;
        memory.bias = bias;
        let Some(factor) = Cholesky::new(mass) else {
            let n = v.len();
            memory.mass = DMatrix::zeros(n, n);
            let mut mass = DMatrix::zeros(n, n);
            self.mass_matrix((mechanics, constants), q, theta, work, memory, &mut mass);
            return Err(singular(q, &mass));
        };
        factor.solve_mut(force);
        if force.iter().all(|a| a.is_finite()) {
            return Ok(factor);
        }
        memory.mass = factor.unpack_dirty();
        Err(Error::AccelerationNotFinite { q: q.to_vec() })
    }

    /// v̇, in place of Q in `out`.
    pub fn forward_dynamics(
        &self,
        mechanics: (&dyn Mechanics, &[f64]),
        state: State<'_>,
        theta: &[f64],
        work: &mut Workspace,
        memory: &mut ExtraMemory,
        out: &mut DVector<f64>,
    ) -> Result<(), Error> {
        let factor = self.solve(mechanics, state, theta, work, memory, out)?;
        memory.mass = factor.unpack_dirty();
        Ok(())
    }
}

/// Why M has no factor: which velocity moves no mass of its own.
fn singular(q: &[f64], mass: &DMatrix<f64>) -> Error {
    let finite = |x: &[f64]| x.iter().position(|x| !x.is_finite());
    if let Some(index) = finite(q) {
        return Error::NotFinite {
            what: "q",
            index,
            value: q[index],
        };
    }
    let leading = |k: usize| Cholesky::new(mass.view((0, 0), (k, k)).into_owned());
    let pivot = (0..mass.nrows())
        .find(|k| leading(k + 1).is_none())
        .unwrap_or(0);
    let column = mass.view((0, pivot), (pivot, 1)).into_owned();
    let taken = leading(pivot).map_or(f64::NAN, |before| column.dot(&before.solve(&column)));
    Error::SingularMassMatrix {
        q: q.to_vec(),
        pivot,
        value: mass[(pivot, pivot)] - taken,
    }
}
