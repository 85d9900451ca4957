//! Which contacts stick, slide, rest and let go at a given state.
//!
//! What moves, w·v ≠ 0, slides. For the rest, a = W v̇ = A λ + b with A = W M⁻¹ Wᵀ and b = W M⁻¹ (f + forces of what slides), with
//! λ in its box: −F₊ₛ ≤ λ ≤ F₋ₛ for friction, λ ≥ 0 for stops. What reaches the end of its box lets go in the direction of its a.
//! Where a law brakes less than it held, this is asked again with the lower force, until no more let go. (Moreau, "Unilateral contact
//! and dry friction in finite freedom dynamics", 1988; Lötstedt, "Coulomb friction in two-dimensional rigid body systems", 1981.)

use super::complementarity::{Complementarity, Place};
use super::factor::{DEPENDENT, factorise};
use super::law::Kind;
use super::motion::{Contact, Motion, Work, check_friction, dot, levels};
use super::{At, BORDER, ContactError, ContactSystem, Direction, Law};
use crate::{PhaseSpace, Space};

/// The state of each law, with the memory to find it.
#[derive(Debug, Clone, Default)]
pub(super) struct Mode {
    pub contacts: Vec<Contact>,
    /// The laws that hold; those that depend on others come after these.
    pub at_rest: Vec<usize>,
    /// Friction that stays at rest whatever it takes.
    pub held: Vec<bool>,
    pub problem: Complementarity,
    candidates: Vec<usize>,
    border: Vec<usize>,
    /// Friction that holds nothing.
    loose: Vec<usize>,
    factor: Vec<f64>,
}

impl Mode {
    pub fn new(laws: usize) -> Self {
        Mode {
            contacts: vec![Contact::Open; laws],
            held: vec![false; laws],
            ..Mode::default()
        }
    }

    pub fn motion<'a, S: ContactSystem>(&'a self, system: &'a S, laws: &'a [Law]) -> Motion<'a, S> {
        Motion {
            system,
            laws,
            contacts: &self.contacts,
            at_rest: &self.at_rest,
            space: PhaseSpace {
                positions: system.positions(),
            },
        }
    }

    /// Finds the contacts at x. Those of `still` have w·v = 0 whatever the last digits of v say; of those of `let_go`, none that is
    /// at the end of its box stays at rest.
    pub fn find<S: ContactSystem>(
        &mut self,
        (system, laws): (&S, &[Law]),
        (time, x, u): (f64, &[f64], &S::Input),
        (still, let_go): (&[bool], &[bool]),
        work: &mut Work<S::Memory>,
    ) -> Result<(), ContactError<S::Error>> {
        let (q, v) = x.split_at(system.positions().dim());
        let at = At { time, q, v };
        self.sort(laws, at, still);
        if self.candidates.is_empty() {
            return Ok(());
        }
        // Each round but the last releases a law.
        loop {
            self.motion(system, laws).free(time, x, u, work)?;
            self.pose(laws, at, work)?;
            self.problem
                .solve()
                .map_err(|_| ContactError::Complementarity {
                    what: "forces",
                    time,
                })?;
            if !self.release(laws, at, let_go)? {
                break;
            }
        }
        self.list_at_rest(let_go);
        Ok(())
    }

    /// What the velocities decide, and the candidates for rest.
    fn sort(&mut self, laws: &[Law], at: At<'_>, still: &[bool]) {
        self.at_rest.clear();
        self.candidates.clear();
        for (k, law) in laws.iter().enumerate() {
            let (slip, rounding) = if still[k] { (0.0, 0.0) } else { law.slip(at.v) };
            let contact = match law.kind {
                Kind::Friction { .. } if slip > rounding => Contact::Slides(Direction::Positive),
                Kind::Friction { .. } if slip < -rounding => Contact::Slides(Direction::Negative),
                Kind::Friction { .. } => Contact::Sticks,
                Kind::Stop { .. } => {
                    let (gap, gap_rounding) = law.gap(at.q);
                    if gap <= gap_rounding && slip <= rounding {
                        Contact::Rests
                    } else {
                        Contact::Open
                    }
                }
            };
            if contact.at_rest() {
                self.candidates.push(k);
            }
            self.contacts[k] = contact;
        }
    }

    /// The complementarity problem of the candidates.
    fn pose<M, E>(
        &mut self,
        laws: &[Law],
        at: At<'_>,
        work: &mut Work<M>,
    ) -> Result<(), ContactError<E>> {
        work.find_levers(self.candidates.iter().map(|&k| &laws[k]));
        let (n, nv) = (self.candidates.len(), at.v.len());
        let problem = &mut self.problem;
        problem.resize(n);
        for (row, &k) in self.candidates.iter().enumerate() {
            let law = &laws[k];
            for (entry, lever) in problem.a[row * n..(row + 1) * n]
                .iter_mut()
                .zip(work.lever.chunks_exact(nv))
            {
                *entry = dot(&law.direction, lever);
            }
            problem.b[row] = dot(&law.direction, &work.acceleration);
            (problem.lower[row], problem.upper[row]) = match &law.kind {
                Kind::Stop { .. } => (0.0, f64::INFINITY),
                Kind::Friction { .. } if self.held[k] => (f64::NEG_INFINITY, f64::INFINITY),
                Kind::Friction { size, .. } => {
                    let (against_positive, against_negative) = levels(k, size.as_ref(), at)?;
                    (-against_positive, against_negative)
                }
            };
        }
        Ok(())
    }

    /// Lets the laws go that are at the end of their box; whether a friction falls by that.
    fn release<E>(
        &mut self,
        laws: &[Law],
        at: At<'_>,
        let_go: &[bool],
    ) -> Result<bool, ContactError<E>> {
        let problem = &self.problem;
        self.border.clear();
        self.loose.clear();
        let mut falls = false;
        for (row, &k) in self.candidates.iter().enumerate() {
            if problem.place[row] == Place::Free {
                continue;
            }
            let y = problem.y[row];
            // What holds nothing at rest never rests.
            let no_box = problem.lower[row] == problem.upper[row];
            let balanced = y.abs() <= BORDER * problem.scale(row);
            let at_border = balanced && !let_go[k] && !no_box;
            let Kind::Friction { size, .. } = &laws[k].kind else {
                if at_border {
                    self.border.push(row);
                } else {
                    self.contacts[k] = Contact::Open;
                }
                continue;
            };
            let positive = if no_box {
                y >= 0.0
            } else {
                problem.place[row] == Place::Lower
            };
            let direction = if positive {
                Direction::Positive
            } else {
                Direction::Negative
            };
            let sliding = size.sliding(direction, 0.0, at);
            check_friction(k, direction, at.time, sliding)?;
            let breakaway = if positive {
                -problem.lower[row]
            } else {
                problem.upper[row]
            };
            if sliding > breakaway * (1.0 + BORDER) {
                return Err(ContactError::Breakaway {
                    law: k,
                    time: at.time,
                    breakaway,
                    sliding,
                });
            }
            let fall = sliding < breakaway * (1.0 - BORDER);
            if no_box {
                self.loose.push(row);
            }
            // One that lets go without moving may be held by others.
            let mut held = || depends(&mut self.factor, problem, &problem.free, row);
            if at_border || (balanced && !no_box && (!fall || held())) {
                self.border.push(row);
            } else {
                self.contacts[k] = Contact::Slides(direction);
                falls |= fall;
            }
        }
        if falls {
            let contacts = &mut self.contacts;
            for &row in &self.loose {
                contacts[self.candidates[row]] = Contact::Sticks;
            }
            self.candidates
                .retain(|&k| !matches!(contacts[k], Contact::Slides(_)));
            for &k in &self.candidates {
                if contacts[k] == Contact::Open {
                    contacts[k] = Contact::Rests;
                }
            }
        }
        Ok(falls && !self.candidates.is_empty())
    }

    /// The laws that hold: those that carry, then those at the border. A friction at its border, or without a force, idles if others hold
    /// its w·v at 0 already.
    fn list_at_rest(&mut self, let_go: &[bool]) {
        let problem = &self.problem;
        if problem.place.len() != self.candidates.len() {
            return;
        }
        let order = || problem.free.iter().chain(&self.border).copied();
        factorise_rows(&mut self.factor, problem, order);
        let m = problem.free.len() + self.border.len();
        for (position, row) in order().enumerate() {
            let k = self.candidates[row];
            let depends = self.factor[position * m + position] == 0.0;
            let direction = match problem.place[row] {
                Place::Lower => Direction::Positive,
                Place::Upper => Direction::Negative,
                _ => {
                    self.at_rest.push(k);
                    continue;
                }
            };
            match self.contacts[k] {
                Contact::Sticks if depends => self.contacts[k] = Contact::Idles(direction),
                Contact::Sticks if let_go[k] => self.contacts[k] = Contact::Slides(direction),
                _ => self.at_rest.push(k),
            }
        }
        self.border.clear();
        let (candidates, contacts) = (&self.candidates, &mut self.contacts);
        self.border
            .extend((0..candidates.len()).filter(|&i| contacts[candidates[i]].at_rest()));
        for &row in &self.loose {
            if let Contact::Slides(direction) = contacts[candidates[row]]
                && depends(&mut self.factor, problem, &self.border, row)
            {
                contacts[candidates[row]] = Contact::Idles(direction);
            }
        }
    }
}

/// Whether this row of W M⁻¹ Wᵀ depends on those.
fn depends(factor: &mut Vec<f64>, problem: &Complementarity, those: &[usize], row: usize) -> bool {
    factorise_rows(factor, problem, || those.iter().copied().chain([row]));
    factor.last() == Some(&0.0)
}

/// The factor of W M⁻¹ Wᵀ for these rows, in this order; 0 on its diagonal where one depends on those before it.
fn factorise_rows<I: Iterator<Item = usize>>(
    factor: &mut Vec<f64>,
    problem: &Complementarity,
    rows: impl Fn() -> I,
) {
    let n = problem.b.len();
    factor.clear();
    for i in rows() {
        factor.extend(rows().map(|j| problem.a[i * n + j]));
    }
    factorise(factor, rows().count(), DEPENDENT);
}
