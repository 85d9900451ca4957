//! Expressions as text: parsed once, evaluated on any [`Scalar`].

mod flat;
mod function;
mod lexer;
mod parser;
mod tape;

use std::any::TypeId;
use std::fmt;

use crate::{Position, Scalar};
use flat::Flat;
use tape::Tape;

pub(crate) use function::{Binary, CONSTANTS, FUNCTIONS, Function, Unary};

/// Longest text, bytes.
const MAX_LENGTH: usize = 64 * 1024;

/// A formula, parsed.
///
/// - Operators, from weak to tight: `+ -`, `* /`, sign, `^`. `^` groups to the right, so `2^3^2` is 2⁹; `-x^2` is −(x²).
/// - Functions: `sin cos tan asin acos atan sinh cosh tanh exp sqrt abs`, `sign` (−1 below zero, else 1), `ln` and `log` (both the
///   natural logarithm), and of two arguments `atan2(y, x) min max pow`.
/// - Constants: `pi`, `e`. Numbers: `2`, `0.5`, `.5`, `1e-3`. A product always needs its `*`.
///
/// `abs`, `min` and `max` choose by the real part and are differentiated as chosen. A power with a constant integer exponent is
/// exact for any base; with an exponent that varies, it is exp(b ln a), which for a ≤ 0 has no derivative along b.
///
/// A text has at most 64 KiB and 200 levels of nesting.
///
/// ```
/// use lagrange::Expression;
/// use num_dual::Dual64;
///
/// let height = Expression::parse("l*(1 - cos(phi))", &["phi", "l"])?;
/// assert_eq!(height.evaluate(|slot| [0.0, 2.0][slot]), 0.0);
///
/// // d/dphi at phi = 1, l = 2
/// let slope = height.evaluate(|slot| [Dual64::new(1.0, 1.0), Dual64::from_re(2.0)][slot]);
/// assert!((slope.eps - 2.0 * 1.0_f64.sin()).abs() < 1e-15);
///
/// let errors = Expression::parse("l*cos(fhi)", &["phi", "l"]).unwrap_err();
/// assert_eq!(errors[0].to_string(), "column 7: unknown name `fhi`; did you mean `phi`?");
/// # Ok::<(), Vec<lagrange::ExpressionError>>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Expression {
    tape: Tape,
    /// The tape for plain numbers, where it can be had.
    flat: Option<Flat>,
    /// Column of the first use of every variable.
    first_use: Vec<Option<usize>>,
}

impl Expression {
    /// Parses `text`; `variables[slot]` names the variable of that slot.
    ///
    /// # Errors
    /// Every unknown name, and the first fault of grammar.
    pub fn parse(text: &str, variables: &[&str]) -> Result<Self, Vec<ExpressionError>> {
        if text.len() > MAX_LENGTH {
            let message = format!(
                "the expression has {} bytes, more than {MAX_LENGTH}: shorten it",
                text.len()
            );
            return Err(vec![ExpressionError::new(text, 0, message)]);
        }
        let (tape, first_use) = parser::parse(text, variables)?;
        let column = |offset: Option<usize>| offset.map(|o| column(text, o));
        Ok(Expression {
            flat: Flat::of(&tape),
            tape,
            first_use: first_use.into_iter().map(column).collect(),
        })
    }

    /// The value, with `variable(slot)` for the variables. Allocates nothing unless more than 32 intermediate values are alive.
    ///
    /// On f64 every common subexpression is computed once; the value is the same to the last bit.
    #[inline]
    pub fn evaluate<D: Scalar>(&self, variable: impl Fn(usize) -> D) -> D {
        match &self.flat {
            Some(flat) if is_plain::<D>() => D::constant(flat.value(|slot| variable(slot).re())),
            _ => self.tape.evaluate(variable),
        }
    }

    /// The same formula with the number `value(slot)` in place of every variable that has one; constant parts are computed now.
    pub fn bind(&self, value: impl Fn(usize) -> Option<f64>) -> Self {
        let tape = self.tape.bind(&value);
        Expression {
            flat: Flat::of(&tape),
            tape,
            first_use: self
                .first_use
                .iter()
                .enumerate()
                .map(|(slot, column)| column.filter(|_| value(slot).is_none()))
                .collect(),
        }
    }

    /// The column at which a variable is first used, from 1; `None` if the formula is free of it.
    pub fn first_use(&self, slot: usize) -> Option<usize> {
        self.first_use.get(slot).copied().flatten()
    }
}

/// Whether the scalar is f64 itself: then it is its own real part, and nothing is lost with that alone.
pub(crate) fn is_plain<D: Scalar>() -> bool {
    TypeId::of::<D>() == TypeId::of::<f64>()
}

/// One fault of an expression.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct ExpressionError {
    /// The byte at which the fault begins.
    pub offset: usize,
    /// The character at which it begins, from 1, counted from the start of the text.
    pub column: usize,
    /// What is wrong and how to mend it.
    pub message: String,
}

impl ExpressionError {
    pub(crate) fn new(text: &str, offset: usize, message: impl Into<String>) -> Self {
        ExpressionError {
            offset,
            column: column(text, offset),
            message: message.into(),
        }
    }
}

impl fmt::Display for ExpressionError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "column {}: {}", self.column, self.message)
    }
}

impl std::error::Error for ExpressionError {}

/// Two lines: the line of `text` around the character `column` (from 1, counted from the start of the text), and a caret below it.
///
/// ```
/// assert_eq!(lagrange::caret("m*g*hh", 5), "m*g*hh\n    ^");
/// ```
pub fn caret(text: &str, column: usize) -> String {
    const AROUND: usize = 40;
    let index = column.saturating_sub(1);
    let offset = text
        .char_indices()
        .nth(index)
        .map_or(text.len(), |(i, _)| i);
    let before = text.get(..offset).unwrap_or("");
    let line: Vec<char> = text
        .lines()
        .nth(Position::of(text, offset).line - 1)
        .unwrap_or("")
        .chars()
        .collect();
    let place = before
        .rsplit('\n')
        .next()
        .map_or(0, |s| s.chars().count())
        .min(line.len());
    let from = place.saturating_sub(AROUND);
    let to = (place + AROUND).min(line.len());
    let shown: String = line
        .get(from..to)
        .unwrap_or(&[])
        .iter()
        .map(|&c| if c.is_control() { ' ' } else { c })
        .collect();
    let head = if from > 0 { "… " } else { "" };
    let tail = if to < line.len() { " …" } else { "" };
    let indent = " ".repeat(head.chars().count() + place - from);
    format!("{head}{shown}{tail}\n{indent}^")
}

fn column(text: &str, offset: usize) -> usize {
    text.get(..offset).unwrap_or(text).chars().count() + 1
}

/// Whether `name` is spelled as a name: a letter or `_`, then letters, digits and `_`, all ASCII.
pub(crate) fn is_identifier(name: &str) -> bool {
    name.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
        && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
}

/// What a name already means in every expression: "function" or "constant".
pub(crate) fn reserved(name: &str) -> Option<&'static str> {
    if FUNCTIONS.iter().any(|(f, _)| *f == name) {
        Some("function")
    } else if CONSTANTS.iter().any(|(c, _)| *c == name) {
        Some("constant")
    } else {
        None
    }
}

/// What functions are called elsewhere.
const ELSEWHERE: [(&str, &str); 8] = [
    ("sgn", "sign"),
    ("signum", "sign"),
    ("arcsin", "asin"),
    ("arccos", "acos"),
    ("arctan", "atan"),
    ("arctan2", "atan2"),
    ("fabs", "abs"),
    ("power", "pow"),
];

/// The velocity that `name` is in another spelling: `dx`, `d_x`, `xd`, `x_d`, `xdot` or `dotx` for `x_dot`.
fn velocity_spelt_otherwise(name: &str) -> impl Iterator<Item = String> {
    let before = ["dot_", "dot", "d_", "d"].map(|mark| name.strip_prefix(mark));
    let behind = ["_d", "dot", "d"].map(|mark| name.strip_suffix(mark));
    let coordinates = before.into_iter().chain(behind).flatten();
    coordinates.map(|coordinate| format!("{coordinate}_dot"))
}

/// The known name that `name` is most likely a slip of: the same but for case, another spelling of it, or not more than a third of its
/// letters away.
pub(crate) fn nearest<'k>(
    name: &str,
    known: impl Iterator<Item = &'k str> + Clone,
) -> Option<&'k str> {
    let elsewhere = ELSEWHERE.iter().find(|(other, _)| *other == name);
    let mut spelt =
        velocity_spelt_otherwise(name).chain(elsewhere.map(|(_, ours)| (*ours).to_owned()));
    let meant = spelt.find_map(|spelt| known.clone().find(|k| *k == spelt));
    if meant.is_some() {
        return meant;
    }
    let allowed = (name.chars().count() / 3).max(1);
    known
        .map(|k| {
            let distance = if k.eq_ignore_ascii_case(name) {
                0
            } else {
                strsim::osa_distance(name, k)
            };
            (distance, k)
        })
        // A name of one letter is as near to every other one.
        .filter(|&(distance, k)| {
            distance <= allowed && distance < k.chars().count().max(name.chars().count())
        })
        .min_by_key(|&(distance, _)| distance)
        .map(|(_, k)| k)
}
