//! The laws of contact.

use std::fmt;
use std::sync::Arc;

use super::Friction;

/// A law between a generalized velocity w·v and the force w λ that it brings into M v̇ = f + w λ, for a fixed direction w.
///
/// For one coordinate, w is a unit vector; for what happens between two, such as the backlash between a motor and its load, w = e_m − e_l.
/// [`friction`](Self::friction) and [`stop`](Self::stop) make one.
#[derive(Clone)]
pub struct Law {
    pub(super) direction: Vec<f64>,
    /// The entry of w that is not 0, if there is only one.
    only: Option<(usize, f64)>,
    pub(super) kind: Kind,
}

#[derive(Clone)]
pub(super) enum Kind {
    Friction {
        size: Arc<dyn Friction>,
        belt: f64,
    },
    Stop {
        row: Vec<f64>,
        offset: f64,
        restitution: Restitution,
    },
}

/// e in ġ⁺ = −e ġ⁻.
#[derive(Clone)]
pub(super) enum Restitution {
    Constant(f64),
    Of(Arc<dyn Fn(Strike) -> f64 + Send + Sync>),
}

/// A blow, as a [restitution](Law::with_restitution) that is no constant knows it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Strike {
    /// |ġ⁻|, in the unit of w·v; 0 at a closed stop that nothing approaches.
    pub speed: f64,
    /// What is effectively thrown against the stop by itself, 1/(w·M⁻¹w): kg for a length, kg·m² for an angle.
    pub mass: f64,
}

impl Restitution {
    pub fn at(&self, strike: Strike) -> f64 {
        match self {
            Restitution::Constant(e) => *e,
            Restitution::Of(law) => law(strike),
        }
    }
}

impl Law {
    /// Dry friction: with the slip s = w·v, λ = −F₊(s) for s > 0, λ = F₋(|s|) for s < 0, and λ ∈ [−F₊ₛ, F₋ₛ] at s = 0, where F are
    /// the sliding and Fₛ the breakaway forces of `size`.
    pub fn friction(direction: &[f64], size: impl Friction + 'static) -> Self {
        Law {
            direction: direction.to_vec(),
            only: only(direction),
            kind: Kind::Friction {
                size: Arc::new(size),
                belt: 0.0,
            },
        }
    }

    /// The same friction against something that moves by itself, as a conveyor's belt: the slip is s = w·v − `speed`. A stop is as
    /// it was.
    #[must_use]
    pub fn on_belt(mut self, speed: f64) -> Self {
        if let Kind::Friction { belt, .. } = &mut self.kind {
            *belt = speed;
        }
        self
    }

    /// A stop: the gap g = w·q + `offset` stays at or above 0 by a force λ ≥ 0 that is there only at g = 0. An impact turns the
    /// velocity of approach ġ⁻ = w·v⁻ < 0 into ġ⁺ = −e ġ⁻ (Newton), with the `restitution` e in [0, 1].
    ///
    /// Two of them with w and −w make a stop for both sides. Stops that are struck in one instant and depend on each other keep energy
    /// from rising only if they have one e: Newton's law with different ones can add to it.
    pub fn stop(direction: &[f64], offset: f64, restitution: f64) -> Self {
        Self::stop_of_gap(direction, direction, offset, restitution)
    }

    /// [`stop`](Self::stop) where positions have more numbers than directions of motion: g = `row`·q + `offset` with ġ = w·v.
    pub fn stop_of_gap(row: &[f64], direction: &[f64], offset: f64, restitution: f64) -> Self {
        Law {
            direction: direction.to_vec(),
            only: only(direction),
            kind: Kind::Stop {
                row: row.to_vec(),
                offset,
                restitution: Restitution::Constant(restitution),
            },
        }
    }

    /// The same stop with a restitution that depends on the blow, as that of rubber on the speed or that of a spring and a damper on
    /// the mass. What it returns must lie in [0, 1]. A friction is as it was.
    ///
    /// Where e tends to 1 for slow blows, a body that bounces on the stop does not come to rest in a finite number of them.
    #[must_use]
    pub fn with_restitution(mut self, law: impl Fn(Strike) -> f64 + Send + Sync + 'static) -> Self {
        if let Kind::Stop { restitution, .. } = &mut self.kind {
            *restitution = Restitution::Of(Arc::new(law));
        }
        self
    }

    pub(super) fn check(&self, nq: usize, nv: usize) -> Result<(), LawFault> {
        let length = |what, values: &[f64], expected| {
            if values.len() == expected {
                Ok(())
            } else {
                Err(LawFault::Length {
                    what,
                    found: values.len(),
                    expected,
                })
            }
        };
        let finite = |what, values: &[f64]| match values.iter().find(|x| !x.is_finite()) {
            None => Ok(()),
            Some(&value) => Err(LawFault::NotFinite { what, value }),
        };
        length("the direction w", &self.direction, nv)?;
        finite("the direction w", &self.direction)?;
        if self.direction.iter().all(|w| *w == 0.0) {
            return Err(LawFault::NoDirection);
        }
        match &self.kind {
            Kind::Friction { belt, .. } => finite("the speed of the belt", &[*belt]),
            Kind::Stop {
                row,
                offset,
                restitution,
            } => {
                length("the row of the gap", row, nq)?;
                finite("the row of the gap", row)?;
                finite("the offset", &[*offset])?;
                match restitution {
                    Restitution::Constant(e) if !(0.0..=1.0).contains(e) => {
                        Err(LawFault::Restitution { value: *e })
                    }
                    _ => Ok(()),
                }
            }
        }
    }

    /// w·v less what the belt moves, and what of it is rounding.
    pub(super) fn slip(&self, v: &[f64]) -> (f64, f64) {
        let belt = match self.kind {
            Kind::Friction { belt, .. } => belt,
            Kind::Stop { .. } => 0.0,
        };
        sum(&self.direction, v, -belt)
    }

    /// g and what of it is rounding; ∞ for friction.
    pub(super) fn gap(&self, q: &[f64]) -> (f64, f64) {
        match &self.kind {
            Kind::Friction { .. } => (f64::INFINITY, 0.0),
            Kind::Stop { row, offset, .. } => sum(row, q, *offset),
        }
    }

    /// Takes the slip out of v, which is rounding or the root of an event, along w but for the entries that are `pinned`.
    pub(super) fn stop_slip(&self, v: &mut [f64], pinned: &[bool]) {
        if let Some((i, at_rest)) = self.coordinate() {
            v[i] = at_rest;
            return;
        }
        let (slip, _) = self.slip(v);
        let free = |&(i, w): &(usize, &f64)| *w != 0.0 && !pinned[i];
        let entries = || self.direction.iter().enumerate().filter(free);
        let square: f64 = entries().map(|(_, w)| w * w).sum();
        for (i, w) in entries() {
            v[i] -= w * slip / square;
        }
    }

    /// Takes the gap out of q, which is rounding.
    pub(super) fn close(&self, q: &mut [f64]) {
        let Kind::Stop { row, offset, .. } = &self.kind else {
            return;
        };
        if let Some((i, r)) = only(row) {
            q[i] = -offset / r;
            return;
        }
        let (gap, _) = self.gap(q);
        let square: f64 = row.iter().map(|r| r * r).sum();
        for (q, r) in q.iter_mut().zip(row).filter(|(_, r)| **r != 0.0) {
            *q -= r * gap / square;
        }
    }

    /// The only coordinate that w moves, and the velocity that it has at rest.
    pub(super) fn coordinate(&self) -> Option<(usize, f64)> {
        let (i, w) = self.only?;
        match &self.kind {
            Kind::Friction { belt, .. } => Some((i, belt / w)),
            Kind::Stop { .. } => Some((i, 0.0)),
        }
    }
}

/// The entry of a vector that is not 0, if there is only one.
fn only(vector: &[f64]) -> Option<(usize, f64)> {
    let mut entries = vector.iter().enumerate().filter(|(_, x)| **x != 0.0);
    match (entries.next(), entries.next()) {
        (Some((i, x)), None) => Some((i, *x)),
        _ => None,
    }
}

/// a·b + c, and what of it may be rounding. A sum of one term has none.
fn sum(a: &[f64], b: &[f64], c: f64) -> (f64, f64) {
    let (mut total, mut size, mut terms) = (c, c.abs(), usize::from(c != 0.0));
    for (a, b) in a.iter().zip(b).filter(|(a, _)| **a != 0.0) {
        total += a * b;
        size += (a * b).abs();
        terms += 1;
    }
    (
        total,
        if terms > 1 {
            super::ROUNDING * size
        } else {
            0.0
        },
    )
}

impl fmt::Debug for Law {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut text = f.debug_struct("Law");
        text.field("direction", &self.direction);
        match &self.kind {
            Kind::Friction { belt, .. } => text.field("belt", belt),
            Kind::Stop {
                row,
                offset,
                restitution,
            } => text.field("row", row).field("offset", offset).field(
                "restitution",
                match restitution {
                    Restitution::Constant(e) => e,
                    Restitution::Of(_) => &"of the blow",
                },
            ),
        };
        text.finish_non_exhaustive()
    }
}

/// What is wrong with a law.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LawFault {
    /// A vector of the wrong length.
    #[error("{what} has {found} entries where the mechanism has {expected}")]
    Length {
        /// Which vector.
        what: &'static str,
        /// Its length.
        found: usize,
        /// The mechanism's nq or nv.
        expected: usize,
    },
    /// A number that is none.
    #[error("{what} has the entry {value}: give a finite number")]
    NotFinite {
        /// Where.
        what: &'static str,
        /// NaN or an infinity.
        value: f64,
    },
    /// w = 0.
    #[error("the direction w is 0: give at least one entry that is not")]
    NoDirection,
    /// e outside of [0, 1].
    #[error("the restitution is {value}: it must be at least 0 and at most 1")]
    Restitution {
        /// e.
        value: f64,
    },
}
