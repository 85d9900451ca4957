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
mod number;
mod variants;

use std::sync::Arc;

use lagrange::{Coordinate, Error, InverseDynamicsDerivatives, Mechanics, Workspace};
use nalgebra::{Cholesky, DMatrix, DVector};

use super::Hybrid;
use crate::effect::Inertial;
use crate::entries::Start;
use number::{Number, add_scaled};

pub(super) use derivatives::RowMemory;
pub(super) use variants::Variants;
use variants::{FAMILIES, share, spread};

/// What the effects of one model add.
pub(super) struct Extra {
    /// Where the parameters of these effects lie in θ: slot by slot.
    pub parameters: Vec<usize>,
    terms: Vec<Term>,
    rotors: Vec<Rotor>,
    points: Vec<Point>,
    /// The bodies that have some, each once.
    loaded: Vec<usize>,
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

/// Point masses on the line from the joint of a body through its centre of mass.
struct Point {
    body: usize,
    /// Of the body among those that have some.
    column: usize,
    /// Of the effect's first parameter.
    slot: usize,
    what: Load,
}

/// What is put on that line; places in ways from the joint to the centre of mass.
#[derive(Clone, Copy, PartialEq)]
enum Load {
    /// A mass at the centre of mass.
    Mass,
    /// A mass at the place of this slot.
    At(usize),
    /// This mass, kg, away from the centre of mass to the place of the slot.
    Moved(f64),
    /// Inertia without a mass: so many masses of ½ ∂²/∂s² for 1 kg·m².
    Spread(f64),
}

impl Point {
    /// What it adds to the mass of its body in a family of point masses, and the derivatives of that with its slots.
    fn in_family(&self, family: usize, p: &[f64]) -> (f64, [(usize, f64); 2]) {
        let (x, none) = (p[self.slot], (self.slot, 0.0));
        let (at_centre, _) = share(family, 1.0);
        let linear = |per: f64| (x * per, [(self.slot, per), none]);
        match self.what {
            Load::Mass => linear(at_centre),
            Load::At(place) => {
                let (share, slope) = share(family, p[place]);
                (x * share, [(self.slot, share), (place, x * slope)])
            }
            Load::Moved(mass) => {
                let (share, slope) = share(family, x);
                (
                    mass * (share - at_centre),
                    [(self.slot, mass * slope), none],
                )
            }
            Load::Spread(masses) => linear(masses * spread(family)),
        }
    }
}

/// The equations of one mechanism.
struct Term {
    mechanics: Arc<dyn Mechanics>,
    /// The family of point masses that are its constants; none where those are the constants of the model's mechanics.
    family: Option<usize>,
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

/// Memory of one thread for one set of free constants: for one state, or for eight at once.
pub(super) struct ExtraMemory<T: Number = f64> {
    works: Vec<Workspace>,
    /// The parameters, slot by slot, and the point masses of each family, body by body.
    p: Vec<f64>,
    masses: [Vec<f64>; FAMILIES],
    zeros: Vec<T>,
    mass: DMatrix<T>,
    part_of_mass: DMatrix<T>,
    factor: T::Factor,
    bias: DVector<T>,
    part: DVector<T>,
    derivatives: InverseDynamicsDerivatives<T>,
    of_terms: Vec<InverseDynamicsDerivatives<T>>,
    /// ∂ID/∂p of the last derivatives, one column a slot.
    pub by_slot: DMatrix<T>,
}

impl Extra {
    /// `None` where no effect of `hybrid` changes the mechanics.
    pub fn of(hybrid: &Hybrid) -> Option<Self> {
        let mut extra = Extra {
            parameters: Vec::new(),
            terms: Vec::new(),
            rotors: Vec::new(),
            points: Vec::new(),
            loaded: Vec::new(),
            bodies: 0,
            in_place: true,
        };
        let variants = hybrid.variants.as_deref();
        let mut tilts = Vec::new();
        for (effect, range) in hybrid.effects.iter().zip(&hybrid.ranges) {
            let own = hybrid.constants[range.clone()].iter();
            let values: Vec<f64> = own.map(|c| c.value).collect();
            let Some(change) = effect.kind.changes(&values) else {
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
                Inertial::PointMass | Inertial::Payload | Inertial::Centre | Inertial::OfLink => {
                    if change == Inertial::Payload {
                        extra.parameters.push(range.start + parameter + 1);
                    }
                    let tree = variants.map(|v| v.tree());
                    let loaded = tree.and_then(|tree| {
                        let index = tree.links().get(effect.target)?.body?;
                        Some((index, tree.bodies().get(index)?))
                    });
                    match loaded {
                        Some((index, body)) => {
                            let what = match change {
                                Inertial::Payload => Load::At(slot + 1),
                                Inertial::Centre => Load::Moved(body.mass),
                                Inertial::OfLink => Load::Spread(1.0 / body.centre.norm_squared()),
                                _ => Load::Mass,
                            };
                            extra.load_body(index, slot, what);
                        }
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
        let families = match extra.points.as_slice() {
            [] => 0,
            points if points.iter().all(|point| point.what == Load::Mass) => 1,
            _ => FAMILIES,
        };
        let points = |family| variants.and_then(|v| v.points(family));
        let mut put = |mechanics, family, factor| match mechanics {
            Some(mechanics) => extra.terms.push(Term {
                mechanics,
                family,
                factor,
            }),
            None => extra.in_place = false,
        };
        for (c, slot) in tilts {
            let tilted = |family| variants.and_then(|v| v.tilted(c, family));
            put(tilted(None), None, Factor::Sine(slot));
            let own = Some(hybrid.mechanics.clone());
            put(own, None, Factor::CosineLessOne(slot));
            for family in 0..families {
                put(tilted(Some(family)), Some(family), Factor::Sine(slot));
                put(points(family), Some(family), Factor::CosineLessOne(slot));
            }
        }
        for family in 0..families {
            put(points(family), Some(family), Factor::One);
        }
        Some(extra)
    }

    fn load_body(&mut self, body: usize, slot: usize, what: Load) {
        let known = self.loaded.iter().position(|other| *other == body);
        let column = known.unwrap_or(self.loaded.len());
        if known.is_none() {
            self.loaded.push(body);
        }
        self.points.push(Point {
            body,
            column,
            slot,
            what,
        });
    }

    /// For `nv` velocities and derivatives in `selected` constants of the mechanics.
    pub fn memory<T: Number>(&self, nv: usize, selected: usize) -> ExtraMemory<T> {
        let matrix = |columns| DMatrix::from_element(nv, columns, T::constant(0.0));
        let vector = || DVector::from_element(nv, T::constant(0.0));
        let derivatives = |constants| InverseDynamicsDerivatives {
            by_q: matrix(nv),
            by_v: matrix(nv),
            by_p: matrix(constants),
        };
        let of = |term: &Term| match term.family {
            Some(_) => derivatives(self.loaded.len()),
            None => derivatives(selected),
        };
        let terms = self.terms.iter();
        ExtraMemory {
            works: terms.clone().map(|t| t.mechanics.workspace()).collect(),
            p: vec![0.0; self.parameters.len()],
            masses: std::array::from_fn(|_| vec![0.0; self.bodies]),
            zeros: vec![T::constant(0.0); nv],
            mass: matrix(nv),
            part_of_mass: matrix(nv),
            factor: T::factor(nv),
            bias: vector(),
            part: vector(),
            derivatives: derivatives(selected),
            of_terms: terms.map(of).collect(),
            by_slot: matrix(self.parameters.len()),
        }
    }

    /// The parameters of the effects, and the point masses.
    fn load<T: Number>(&self, theta: &[f64], memory: &mut ExtraMemory<T>) {
        for (to, &index) in memory.p.iter_mut().zip(&self.parameters) {
            *to = match self.in_place {
                true => theta[index],
                false => f64::NAN,
            };
        }
        for (family, masses) in memory.masses.iter_mut().enumerate() {
            masses.fill(0.0);
            for point in &self.points {
                masses[point.body] += point.in_family(family, &memory.p).0;
            }
        }
    }

    /// Adds to M.
    fn add_mass<T: Number>(&self, q: &[T], memory: &mut ExtraMemory<T>, mass: &mut DMatrix<T>) {
        for (term, work) in self.terms.iter().zip(&mut memory.works) {
            if !term.factor.is_weight() {
                let part = &mut memory.part_of_mass;
                let masses = &memory.masses[term.family.unwrap_or_default()];
                T::mass_matrix(&*term.mechanics, q, masses, work, part);
                add_scaled(mass.iter_mut(), 1.0, part.iter());
            }
        }
        for &Rotor { v, slot, sign } in &self.rotors {
            let own = &mut mass[(v, v)];
            *own = own.plus(sign * memory.p[slot], T::constant(1.0));
        }
        if !self.in_place {
            mass.fill(T::constant(f64::NAN));
        }
    }

    /// M of the whole model, into `mass`.
    pub fn mass_matrix<T: Number>(
        &self,
        (mechanics, constants): (&dyn Mechanics, &[f64]),
        q: &[T],
        theta: &[f64],
        work: &mut Workspace,
        memory: &mut ExtraMemory<T>,
        mass: &mut DMatrix<T>,
    ) {
        self.load(theta, memory);
        T::mass_matrix(mechanics, q, constants, work, mass);
        self.add_mass(q, memory, mass);
    }

    /// Adds to C v + G.
    pub fn add_bias<T: Number>(
        &self,
        (q, v): (&[T], &[T]),
        (theta, constants): (&[f64], &[f64]),
        memory: &mut ExtraMemory<T>,
        bias: &mut DVector<T>,
    ) {
        self.load(theta, memory);
        for (term, work) in self.terms.iter().zip(&mut memory.works) {
            let p = term.family.map_or(constants, |f| &memory.masses[f]);
            let part = &mut memory.part;
            match term.factor.is_weight() {
                true => T::gravity_force(&*term.mechanics, q, p, work, part),
                false => T::bias_force(&*term.mechanics, (q, v), p, work, part),
            }
            add_scaled(bias.iter_mut(), term.factor.at(&memory.p).0, part.iter());
        }
    }

    /// What the effects add to ID(q, v, v̇ = `a`), into `out`.
    pub fn inverse_dynamics(
        &self,
        (q, v, a): (&[f64], &[f64], &[f64]),
        (theta, constants): (&[f64], &[f64]),
        memory: &mut ExtraMemory,
        out: &mut DVector<f64>,
    ) {
        out.fill(0.0);
        self.add_bias((q, v), (theta, constants), memory, out);
        // M v̇ as M v is the momentum.
        self.add_momentum((q, a), theta, memory, out.as_mut_slice());
    }

    /// M and its factor, into `memory`.
    fn factorise<T: Number>(
        &self,
        mechanics: (&dyn Mechanics, &[f64]),
        q: &[T],
        theta: &[f64],
        work: &mut Workspace,
        memory: &mut ExtraMemory<T>,
    ) {
        let mut mass = std::mem::take(&mut memory.mass);
        self.mass_matrix(mechanics, q, theta, work, memory, &mut mass);
        T::factorise(&mass, &mut memory.factor);
        memory.mass = mass;
    }

    /// v̇, in place of Q in `out`; the factor of M stays in `memory`.
    pub fn forward_dynamics<T: Number>(
        &self,
        (mechanics, constants): (&dyn Mechanics, &[f64]),
        (q, v): (&[T], &[T]),
        theta: &[f64],
        work: &mut Workspace,
        memory: &mut ExtraMemory<T>,
        out: &mut [T],
    ) -> Result<(), Error> {
        self.factorise((mechanics, constants), q, theta, work, memory);
        let mut bias = std::mem::take(&mut memory.bias);
        T::bias_force(mechanics, (q, v), constants, work, &mut bias);
        self.add_bias((q, v), (theta, constants), memory, &mut bias);
        add_scaled(&mut *out, -1.0, &bias);
        memory.bias = bias;
        T::solve(&memory.factor, out);
        match T::lost(out) {
            None => Ok(()),
            Some(state) => {
                let q: Vec<f64> = q.iter().map(|q| q.of_state(state)).collect();
                let mass = memory.mass.map(|m| m.of_state(state));
                Err(match Cholesky::new(mass.clone()) {
                    None => singular(mechanics.coordinates(), &q, &mass),
                    Some(_) => Error::AccelerationNotFinite { q },
                })
            }
        }
    }
}

/// Why M has no factor: which velocity moves no mass of its own.
fn singular(coordinates: &[Coordinate], q: &[f64], mass: &DMatrix<f64>) -> Error {
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
    Error::singular_mass_matrix(coordinates, q, pivot, mass[(pivot, pivot)] - taken)
}
