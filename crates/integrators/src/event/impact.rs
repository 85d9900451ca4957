//! Impacts: velocities that jump.
//!
//! Forces that stay finite do nothing in an instant; friction does not know of the blow of a stop here, so v jumps by the impulses
//! Λ ≥ 0 of the closed stops alone: M (v⁺ − v⁻) = Wᵀ Λ. Each obeys Newton's law where it acts, w·v⁺ ≥ −e min(w·v⁻, 0) and Λ ≥ 0,
//! one of the two with equality: a complementarity problem with A = W M⁻¹ Wᵀ and b = W v⁻ + e min(W v⁻, 0). The energy changes by
//! ½ Σ Λ (w·v⁺ + w·v⁻), where a stop that gives an impulse has w·v⁺ = −e w·v⁻ if bodies approach there or rest, so that it does not
//! rise. Where they part already, with w·v⁻ > 0 and w·v⁺ = 0, it would: such a stop is not asked, and struck in its turn, in the same
//! instant, if the blow makes them approach. Only the last blow that an instant may have is at all closed stops at once.

use super::complementarity::Complementarity;
use super::law::{Kind, Strike};
use super::motion::{Motion, Work, dot};
use super::rest::Rest;
use super::{ContactError, ContactSystem, Event, EventKind};
use crate::Space;

/// Memory of the impacts.
#[derive(Debug, Clone, Default)]
pub(super) struct Impact {
    closed: Vec<usize>,
    before: Vec<f64>,
    /// −w·v⁺ of Newton's law where it acts.
    wanted: Vec<f64>,
    /// What of w·v⁻ is rounding, for each law.
    rounding: Vec<f64>,
}

impl Impact {
    /// One blow at what approaches at closed stops, with the `restitution(law, e, speed of approach)` in place of a law's own e; whether there was one.
    /// The `last` one of an instant is at those where bodies part as well: nothing approaches after it. Of the laws that are `still`, those that move
    /// now are none any more; stops without rebound are.
    pub fn strike<S: ContactSystem>(
        &mut self,
        (motion, last): (&Motion<'_, S>, bool),
        (time, x, u): (f64, &mut [f64], &S::Input),
        restitution: impl Fn(usize, f64, f64) -> f64,
        (problem, rest, work): (&mut Complementarity, &mut Rest, &mut Work<S::Memory>),
        still: &mut [bool],
        events: &mut Vec<Event>,
    ) -> Result<bool, ContactError<S::Error>> {
        let laws = motion.laws;
        if !self.collect(motion, x, last) {
            return Ok(false);
        }
        // No law slides in an instant.
        let at_impact = Motion {
            contacts: &[],
            at_rest: &[],
            space: motion.space,
            ..*motion
        };
        at_impact.free(time, x, u, work)?;
        work.find_levers(self.closed.iter().map(|&k| &laws[k]));
        let (n, nv) = (self.closed.len(), work.acceleration.len());
        problem.resize(n);
        for (row, &k) in self.closed.iter().enumerate() {
            let w = &laws[k].direction;
            for (entry, lever) in problem.a[row * n..(row + 1) * n]
                .iter_mut()
                .zip(work.lever.chunks_exact(nv))
            {
                *entry = dot(w, lever);
            }
            let strike = Strike {
                speed: self.wanted[row],
                mass: 1.0 / problem.a[row * n + row],
            };
            self.wanted[row] = match &laws[k].kind {
                Kind::Stop { restitution: e, .. } if strike.speed > 0.0 => {
                    let value = e.at(strike);
                    if !(0.0..=1.0).contains(&value) {
                        return Err(ContactError::Restitution {
                            law: k,
                            time,
                            value,
                        });
                    }
                    restitution(k, value, strike.speed) * strike.speed
                }
                _ => 0.0,
            };
            problem.b[row] = self.before[row] - self.wanted[row];
            problem.upper[row] = f64::INFINITY;
        }
        problem.solve().map_err(|_| ContactError::Complementarity {
            what: "impulses",
            time,
        })?;
        let (q, v) = x.split_at_mut(motion.space.positions.dim());
        self.rounding.clear();
        self.rounding.extend(laws.iter().map(|law| law.slip(v).1));
        for (lever, impulse) in work.lever.chunks_exact(nv).zip(&problem.x) {
            for (v, lever) in v.iter_mut().zip(lever) {
                *v += lever * impulse;
            }
        }
        for &k in &self.closed {
            laws[k].close(q);
        }
        let struck = || {
            let acts = problem.x.iter().map(|impulse| *impulse > 0.0);
            self.closed
                .iter()
                .zip(acts)
                .enumerate()
                .filter_map(|(row, (&k, acts))| acts.then_some((row, k)))
        };
        for ((still, law), before) in still.iter_mut().zip(laws).zip(&self.rounding) {
            let (slip, rounding) = law.slip(v);
            *still &= slip.abs() <= rounding + before;
        }
        // What does not rebound is at rest.
        struck()
            .filter(|&(row, _)| self.wanted[row] == 0.0)
            .for_each(|(_, k)| still[k] = true);
        rest.apply(laws, (0..laws.len()).filter(|&k| still[k]), q, v);
        for (row, law) in struck() {
            events.push(Event {
                time,
                law,
                kind: EventKind::Impact {
                    before: self.before[row],
                    after: laws[law].slip(v).0,
                },
            });
        }
        Ok(true)
    }

    /// The closed stops, those where bodies `part` only if asked, their w·v⁻ and, in `wanted`, their speeds of approach; whether anything approaches
    /// one of them.
    fn collect<S: ContactSystem>(&mut self, motion: &Motion<'_, S>, x: &[f64], part: bool) -> bool {
        let (q, v) = motion.split(x);
        self.closed.clear();
        self.before.clear();
        self.wanted.clear();
        let mut approaches = false;
        for (k, law) in motion.laws.iter().enumerate() {
            if matches!(law.kind, Kind::Friction { .. }) {
                continue;
            }
            let (gap, rounding) = law.gap(q);
            if gap > rounding {
                continue;
            }
            let (slip, rounding) = law.slip(v);
            if slip > rounding && !part {
                continue;
            }
            let approach = if slip < -rounding { -slip } else { 0.0 };
            approaches |= approach > 0.0;
            self.closed.push(k);
            self.before.push(slip);
            self.wanted.push(approach);
        }
        approaches
    }
}
