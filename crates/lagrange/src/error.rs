//! What can go wrong, and where.

use std::fmt;

use crate::Coordinate;

/// A place in a text, both counted from 1; the column counts characters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Position {
    /// Line, from 1.
    pub line: usize,
    /// Column, from 1.
    pub column: usize,
}

impl Position {
    /// The position of byte `offset` in `text`; the end of the text when `offset` lies behind it.
    pub fn of(text: &str, offset: usize) -> Self {
        let mut end = offset.min(text.len());
        while !text.is_char_boundary(end) {
            end -= 1;
        }
        let before = text.get(..end).unwrap_or(text);
        let line_start = before.rfind('\n').map_or(0, |i| i + 1);
        Position {
            line: before.matches('\n').count() + 1,
            column: before.get(line_start..).unwrap_or("").chars().count() + 1,
        }
    }
}

/// One fault in a model's source, or one loss in reading it (a warning).
///
/// The message names culprit, value, condition and cure.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Problem {
    /// Where, when the source is a text.
    pub position: Option<Position>,
    /// What, why and how to mend it.
    pub message: String,
}

impl Problem {
    /// A problem at a place.
    pub fn at(position: Position, message: impl Into<String>) -> Self {
        Problem {
            position: Some(position),
            message: message.into(),
        }
    }
    /// A problem of the whole source.
    pub fn general(message: impl Into<String>) -> Self {
        Problem {
            position: None,
            message: message.into(),
        }
    }
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.position {
            Some(p) => write!(f, "{}:{}: {}", p.line, p.column, self.message),
            None => write!(f, "{}", self.message),
        }
    }
}

/// All problems of one source: `file:line:column: message`, a line each.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Problems {
    /// The file, or what else the source is called.
    pub source: String,
    /// At least one, in the order of the source.
    pub list: Vec<Problem>,
}

impl fmt::Display for Problems {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, problem) in self.list.iter().enumerate() {
            if i > 0 {
                writeln!(f)?;
            }
            match problem.position {
                Some(_) => write!(f, "{}:{problem}", self.source)?,
                None => write!(f, "{}: {problem}", self.source)?,
            }
        }
        Ok(())
    }
}

impl std::error::Error for Problems {}

/// An error of the equations of motion.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The mass matrix is not positive definite, to rounding.
    #[error(
        "mass matrix is not positive definite at q = {q:?} (pivot {pivot} is {value:e}): velocity {pivot}, that of {velocity}, moves no mass there, \
         or none that those before it do not move already (joints in line, a gimbal's lock, massless links between joints, a square that \
         is missing in T); give what it moves a mass and inertia, leave it out, or where other configurations have an acceleration, start from one"
    )]
    SingularMassMatrix {
        /// The configuration.
        q: Vec<f64>,
        /// The velocity at which the factorisation stopped.
        pivot: usize,
        /// The coordinate that has it, in quotes.
        velocity: String,
        /// What those before it leave of its diagonal entry, kg or kg·m².
        value: f64,
    },
    /// An energy has no finite derivative at a state.
    #[error(
        "the force that follows from {energy} is NaN or infinite at q = {q:?}: the energy has a singular point at or near this state, or \
         overflows"
    )]
    EnergyNotFinite {
        /// `V`, or `T`.
        energy: &'static str,
        /// The configuration.
        q: Vec<f64>,
    },
    /// A quaternion is not of length 1.
    #[error(
        "q[{index}..{}] is a quaternion of length {length}: it must be of length 1; use `state::normalize`",
        index + 4
    )]
    NotUnit {
        /// Its first entry in q.
        index: usize,
        /// Its length.
        length: f64,
    },
    /// The mass matrix is sound and the acceleration is not a number.
    #[error(
        "the acceleration at q = {q:?} is NaN or infinite, though the mass matrix is sound: the generalized force holds a NaN or \
         an infinity, or it or the velocities are too large"
    )]
    AccelerationNotFinite {
        /// The configuration.
        q: Vec<f64>,
    },
    /// A link was asked for by an index that there is not.
    #[error(
        "there is no link {link}: the mechanism has {count}, counted from 0 as in `Tree::links`"
    )]
    NoSuchLink {
        /// The index.
        link: usize,
        /// How many there are.
        count: usize,
    },
    /// A vector has the wrong length.
    #[error("{what} has {found} entries, this mechanism takes {expected}")]
    Dimension {
        /// Which vector.
        what: &'static str,
        /// Its length.
        found: usize,
        /// The length it should have.
        expected: usize,
    },
    /// A number is NaN or infinite.
    #[error("{what}[{index}] is {value}: every entry must be finite")]
    NotFinite {
        /// Which vector.
        what: &'static str,
        /// Which entry.
        index: usize,
        /// Its value.
        value: f64,
    },
    /// A number that must not be negative is.
    #[error("{what} is {value}: it must be 0 or more")]
    Negative {
        /// Which number.
        what: &'static str,
        /// Its value.
        value: f64,
    },
    /// The rank of the constraints' Jacobian falls at a configuration, a dead centre: the multipliers are not determined.
    #[error(
        "constraint `{name}` depends on those before it at q = {q:?} (its row of ∂φ/∂q is within {angle:.1e} rad of their span): \
         the multipliers are not determined at such a dead centre; start aside of it, or choose an arrangement that does not pass it"
    )]
    SingularConstraint {
        /// The equation that depends on those before it.
        name: String,
        /// The configuration.
        q: Vec<f64>,
        /// The angle between its row of J and the span of the rows before it, rad.
        angle: f64,
    },
    /// No state that obeys the constraints was found.
    #[error(
        "the constraints are not satisfied: the search for φ = 0 ends at q = {q:?}, where `{name}` is {residual:.3e}; \
         look for equations that contradict one another, or start nearer to a configuration that closes"
    )]
    Inconsistent {
        /// The equation with the largest residual there.
        name: String,
        /// Its residual (or, where the positions close, its rate).
        residual: f64,
        /// Where the search ended.
        q: Vec<f64>,
    },
    /// The numbers of a constraint are too large or too small to compute with.
    #[error(
        "constraint `{name}`: ∂φ/∂q is {gradient:e} at most, and must lie between 1e-12 and 1e100 to be told from rounding; \
         multiply the equation by a factor that brings it near 1, or leave it out if no motion changes it"
    )]
    ConstraintScale {
        /// The equation with the largest gradient.
        name: String,
        /// The largest entry of its row of ∂φ/∂q at the configurations looked at.
        gradient: f64,
    },
    /// A constraint or its derivative is NaN or infinite.
    #[error(
        "∂φ/∂q is not finite at q = {q:?} (equation `{name}` or one after it): the formula has a singular point there"
    )]
    ConstraintNotFinite {
        /// The first equation that cannot be used.
        name: String,
        /// The configuration.
        q: Vec<f64>,
    },
    /// A mechanism with constraints was to be constrained again.
    #[error(
        "the mechanism has constraints already: join all of them in one `Constrained`, as a pair (a, b)"
    )]
    ConstrainedTwice,
}

impl Error {
    /// The mass matrix at `q` has no factor: its velocity `pivot`, one of those of `coordinates`, is left `value` by those before it.
    pub fn singular_mass_matrix(
        coordinates: &[Coordinate],
        q: &[f64],
        pivot: usize,
        value: f64,
    ) -> Error {
        let mut before = 0;
        let of = coordinates.iter().find_map(|coordinate| {
            let entry = pivot.checked_sub(before)?;
            before += coordinate.nv();
            (entry < coordinate.nv()).then(|| match coordinate.nv() {
                1 => format!("`{}`", coordinate.name),
                n => format!("`{}` (entry {entry} of its {n}, from 0)", coordinate.name),
            })
        });
        Error::SingularMassMatrix {
            q: q.to_vec(),
            pivot,
            velocity: of.unwrap_or_else(|| "no coordinate".to_owned()),
            value,
        }
    }
}
