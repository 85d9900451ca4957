//! The motion while no contact changes.
//!
//! With the laws A that hold and D that slide or idle, M v̇ = f + Σ_{k∈D} w_k λ_k + W_Aᵀ λ and W_A v̇ = 0, and so
//! (W_A M⁻¹ W_Aᵀ) λ = −W_A M⁻¹ (f + Σ_{k∈D} w_k λ_k).

use nalgebra::DMatrix;

use super::factor::{DEPENDENT, factorise, solve};
use super::law::Kind;
use super::{At, ContactError, ContactSystem, Direction, Friction, Law};
use crate::{PhaseSpace, Space, System};

/// What a law does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Contact {
    /// A friction that slides.
    Slides(Direction),
    /// A friction at rest.
    Sticks,
    /// A friction at rest because other laws hold its w·v at 0, itself at the end of its box against this direction: it gives its breakaway
    /// force, and no event of its own ends that.
    Idles(Direction),
    /// A stop that is not touched.
    Open,
    /// A stop that is leant on.
    Rests,
}

impl Contact {
    /// Whether it holds w·v̇ = 0.
    pub fn holds(self) -> bool {
        matches!(self, Contact::Sticks | Contact::Rests)
    }

    /// Whether w·v̇ = 0.
    pub fn at_rest(self) -> bool {
        self.holds() || matches!(self, Contact::Idles(_))
    }
}

/// Memory of the motion.
#[derive(Debug)]
pub(super) struct Work<M> {
    pub memory: M,
    /// M, then its factor.
    pub mass: DMatrix<f64>,
    /// f, then M⁻¹ f, then v̇.
    pub acceleration: Vec<f64>,
    /// M⁻¹ w for the laws asked for, nv each.
    pub lever: Vec<f64>,
    schur: Vec<f64>,
    force: Vec<f64>,
    /// λ of each law at rest.
    pub reaction: Vec<f64>,
    /// The sizes of what λ is the sum of.
    pub reaction_scale: Vec<f64>,
}

impl<M> Work<M> {
    pub fn new(nv: usize, laws: usize, memory: M) -> Self {
        Work {
            memory,
            mass: DMatrix::zeros(nv, nv),
            acceleration: vec![0.0; nv],
            lever: Vec::new(),
            schur: Vec::new(),
            force: Vec::new(),
            reaction: vec![0.0; laws],
            reaction_scale: vec![0.0; laws],
        }
    }

    /// M⁻¹ x in place, after [`Motion::free`].
    pub fn divide_by_mass(mass: &DMatrix<f64>, x: &mut [f64]) {
        solve(mass.as_slice(), x.len(), x);
    }

    /// M⁻¹ w into `lever` for each of `laws`, after [`Motion::free`].
    pub fn find_levers<'a>(&mut self, laws: impl Iterator<Item = &'a Law>) {
        let nv = self.acceleration.len();
        self.lever.clear();
        for law in laws {
            let start = self.lever.len();
            self.lever.extend_from_slice(&law.direction);
            if let Some(lever) = self.lever.get_mut(start..start + nv) {
                Self::divide_by_mass(&self.mass, lever);
            }
        }
    }
}

pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// A mechanism with its laws, in contacts that stay; as a [`System`], for methods that step such.
pub(super) struct Motion<'a, S: ContactSystem> {
    pub system: &'a S,
    pub laws: &'a [Law],
    pub contacts: &'a [Contact],
    /// The laws at rest; those that depend on others come after these.
    pub at_rest: &'a [usize],
    pub space: PhaseSpace<&'a S::Positions>,
}

impl<'a, S: ContactSystem> Motion<'a, S> {
    pub fn split<'x>(&self, x: &'x [f64]) -> (&'x [f64], &'x [f64]) {
        x.split_at(self.space.positions.dim())
    }

    /// M⁻¹ (f + Σ w_k λ_k) of the laws k that slide or idle into `acceleration`, and the factor of M.
    pub fn free(
        &self,
        time: f64,
        x: &[f64],
        u: &S::Input,
        work: &mut Work<S::Memory>,
    ) -> Result<(), ContactError<S::Error>> {
        let (q, v) = self.split(x);
        let Work {
            memory,
            mass,
            acceleration,
            ..
        } = work;
        self.system
            .mass_and_force(time, (q, v), u, memory, mass, acceleration)
            .map_err(|source| ContactError::System { time, source })?;
        for (index, (law, contact)) in self.laws.iter().zip(self.contacts).enumerate() {
            let Kind::Friction { size, .. } = &law.kind else {
                continue;
            };
            let at = At { time, q, v };
            let (direction, value, speed) = match *contact {
                Contact::Slides(direction) => {
                    let speed = direction.sign() * law.slip(v).0;
                    (direction, size.sliding(direction, speed, at), speed)
                }
                Contact::Idles(direction) => (direction, size.breakaway(direction, at), 0.0),
                _ => continue,
            };
            // A trial step past the point of rest goes on smoothly, if need be to forces below 0.
            let sized = if speed < 0.0 { value.abs() } else { value };
            check_friction(index, direction, time, sized)?;
            let force = -direction.sign() * value;
            for (f, w) in acceleration.iter_mut().zip(&law.direction) {
                *f += w * force;
            }
        }
        if let Some((coordinate, value)) = factorise(mass.as_mut_slice(), v.len(), 0.0) {
            return Err(ContactError::Mass {
                time,
                coordinate,
                value,
            });
        }
        Work::<S::Memory>::divide_by_mass(mass, acceleration);
        Ok(())
    }

    /// v̇ into `acceleration`, and λ of the laws at rest into `reaction`.
    pub fn accelerate(
        &self,
        time: f64,
        x: &[f64],
        u: &S::Input,
        work: &mut Work<S::Memory>,
    ) -> Result<(), ContactError<S::Error>> {
        self.free(time, x, u, work)?;
        if self.at_rest.is_empty() {
            return Ok(());
        }
        work.find_levers(self.at_rest.iter().filter_map(|&k| self.laws.get(k)));
        let Work {
            acceleration,
            lever,
            schur,
            force,
            reaction,
            reaction_scale,
            ..
        } = work;
        let (n, nv) = (self.at_rest.len(), acceleration.len());
        schur.clear();
        force.clear();
        for &k in self.at_rest {
            let w = &self.laws[k].direction;
            schur.extend(lever.chunks_exact(nv).map(|lever| dot(w, lever)));
            force.push(-dot(w, acceleration));
        }
        for (row, &k) in self.at_rest.iter().enumerate() {
            reaction_scale[k] = force[row].abs() / schur[row * n + row];
        }
        // A row that depends on others is carried by these.
        factorise(schur, n, DEPENDENT);
        solve(schur, n, force);
        for ((&k, &force), lever) in self
            .at_rest
            .iter()
            .zip(force.iter())
            .zip(lever.chunks_exact(nv))
        {
            reaction[k] = force;
            reaction_scale[k] += force.abs();
            for (a, lever) in acceleration.iter_mut().zip(lever) {
                *a += lever * force;
            }
        }
        if let Some(&law) = self.at_rest.iter().find(|&&k| !reaction[k].is_finite()) {
            return Err(ContactError::Reaction {
                law,
                time,
                value: reaction[law],
            });
        }
        // Exactly 0 where a law holds one coordinate: what sticks does not creep.
        for &k in self.at_rest {
            if let Some((i, _)) = self.laws[k].coordinate() {
                acceleration[i] = 0.0;
            }
        }
        Ok(())
    }

    /// How far each law is from an event, below 0 past it, and the least of these: the velocity of a slide, the gap of an open
    /// stop, the force between what sticks and its breakaway, the force of a stop that is leant on.
    pub fn margins(
        &self,
        time: f64,
        x: &[f64],
        u: &S::Input,
        held: &[bool],
        work: &mut Work<S::Memory>,
        margin: &mut [f64],
    ) -> Result<f64, ContactError<S::Error>> {
        let (q, v) = self.split(x);
        if !self.at_rest.is_empty() {
            self.accelerate(time, x, u, work)?;
        }
        let at = At { time, q, v };
        let mut least = f64::INFINITY;
        for (k, ((law, contact), margin)) in self
            .laws
            .iter()
            .zip(self.contacts)
            .zip(margin.iter_mut())
            .enumerate()
        {
            let force = work.reaction[k];
            let rounding = super::RELEASE * work.reaction_scale[k];
            *margin = match (*contact, &law.kind) {
                (Contact::Slides(direction), Kind::Friction { .. }) => {
                    let (slip, rounding) = law.slip(v);
                    direction.sign() * slip + rounding
                }
                (Contact::Slides(_), Kind::Stop { .. }) | (Contact::Idles(_), _) => f64::INFINITY,
                (Contact::Open, _) => {
                    let (gap, rounding) = law.gap(q);
                    if gap >= -rounding && law.slip(v).0 >= 0.0 {
                        gap.max(0.0)
                    } else {
                        gap
                    }
                }
                (Contact::Sticks, Kind::Friction { size, .. }) if !held[k] => {
                    let (lower, upper) = levels(k, size.as_ref(), at)?;
                    (force + lower).min(upper - force) + rounding
                }
                (Contact::Rests, _) => force + rounding,
                (Contact::Sticks, _) => f64::INFINITY,
            };
            least = least.min(*margin);
        }
        Ok(least)
    }
}

/// The breakaway forces against positive and negative slides: −lower ≤ λ ≤ upper.
pub(super) fn levels<E>(
    law: usize,
    size: &dyn Friction,
    at: At<'_>,
) -> Result<(f64, f64), ContactError<E>> {
    let level = |direction| {
        let value = size.breakaway(direction, at);
        check_friction(law, direction, at.time, value).map(|()| value)
    };
    Ok((level(Direction::Positive)?, level(Direction::Negative)?))
}

pub(super) fn check_friction<E>(
    law: usize,
    direction: Direction,
    time: f64,
    value: f64,
) -> Result<(), ContactError<E>> {
    if value >= 0.0 && value.is_finite() {
        Ok(())
    } else {
        Err(ContactError::Friction {
            law,
            direction,
            time,
            value,
        })
    }
}

impl<'a, S: ContactSystem> System for Motion<'a, S> {
    type Space = PhaseSpace<&'a S::Positions>;
    type Input = S::Input;
    type Memory = Work<S::Memory>;
    type Error = ContactError<S::Error>;

    fn space(&self) -> &Self::Space {
        &self.space
    }

    fn memory(&self) -> Self::Memory {
        let nv = self.space.positions.tangent_dim();
        Work::new(nv, self.laws.len(), self.system.memory())
    }

    fn rate(
        &self,
        t: f64,
        x: &[f64],
        u: &S::Input,
        work: &mut Work<S::Memory>,
        dx: &mut [f64],
    ) -> Result<(), Self::Error> {
        self.accelerate(t, x, u, work)?;
        let (_, v) = self.split(x);
        let (dq, dv) = dx.split_at_mut(v.len());
        dq.copy_from_slice(v);
        dv.copy_from_slice(&work.acceleration);
        Ok(())
    }
}
