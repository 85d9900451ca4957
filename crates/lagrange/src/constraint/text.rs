//! Constraints written as text.

use super::Constraint;
use crate::{Expression, ExpressionError, Scalar};

/// The constraints of a [`TextLagrangian`](crate::TextLagrangian): formulas φ in its coordinates and constants, each meant as φ = 0.
///
/// A formula may have one `=`: `x^2 + z^2 = l^2` is φ = x² + z² − l².
///
/// ```
/// use lagrange::constraint::Constrained;
/// use lagrange::{Dynamics, Mechanics, TextLagrangian, TextSource};
///
/// let text = TextLagrangian::new(&TextSource {
///     coordinates: vec!["x".into(), "z".into()],
///     kinetic: "0.5*m*(x_dot^2 + z_dot^2)".into(),
///     potential: "m*g*z".into(),
///     constraints: vec!["x^2 + z^2 = l^2".into()],
///     parameters: [("m", 0.2), ("g", 9.81), ("l", 0.5)].map(|(name, x)| (name.into(), x)).to_vec(),
///     ..TextSource::default()
/// })
/// .map_err(|problems| problems[0].clone())?;
/// let constraints = text.constraints().clone();
/// let coordinates = text.coordinates().to_vec();
/// let pendulum = Constrained::new(Dynamics::new(text, coordinates)?, constraints)?;
/// // Held out horizontally, the mass falls freely: v̇ = (0, −g).
/// let a = pendulum.forward_dynamics(&[0.5, 0.0], &[0.0, 0.0], &[0.0, 0.0])?;
/// assert!(a[0].abs() < 1e-12 && (a[1] + 9.81).abs() < 1e-12);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TextConstraints {
    texts: Vec<String>,
    /// Number of coordinates: the formulas have the slots q, v, constants.
    coordinates: usize,
    general: Vec<Equation>,
    /// With the nominal constants put in.
    nominal: Vec<Equation>,
}

impl TextConstraints {
    /// Of formulas over the slots q, v, constants, in which `value` gives the nominal constants.
    pub(crate) fn new(
        texts: &[String],
        formulas: Vec<Equation>,
        coordinates: usize,
        value: impl Fn(usize) -> Option<f64>,
    ) -> Self {
        TextConstraints {
            texts: texts.to_vec(),
            coordinates,
            nominal: formulas.iter().map(|f| f.bind(&value)).collect(),
            general: formulas,
        }
    }

    /// The formulas as they were written.
    pub fn texts(&self) -> &[String] {
        &self.texts
    }

    /// Whether a formula uses the variable of this slot.
    pub(crate) fn uses(&self, slot: usize) -> bool {
        self.general.iter().any(|f| f.first_use(slot).is_some())
    }
}

impl Constraint for TextConstraints {
    fn len(&self) -> usize {
        self.general.len()
    }

    /// `constraints[i]`, as in a model file.
    fn name(&self, equation: usize) -> String {
        format!("constraints[{equation}]")
    }

    fn residual<D: Scalar>(&self, q: &[D], out: &mut [D]) {
        for (out, formula) in out.iter_mut().zip(&self.nominal) {
            *out = formula.evaluate(|slot| q[slot]);
        }
    }

    fn residual_with<D: Scalar>(&self, q: &[D], p: &[D], out: &mut [D]) {
        let n = self.coordinates;
        for (out, formula) in out.iter_mut().zip(&self.general) {
            *out = formula.evaluate(|slot| if slot < n { q[slot] } else { p[slot - 2 * n] });
        }
    }

    fn uses_constant(&self, index: usize) -> bool {
        self.uses(2 * self.coordinates + index)
    }
}

/// A formula with at most one `=`: φ = left − right.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Equation {
    left: Expression,
    right: Option<Expression>,
}

impl Equation {
    /// Parses `text`.
    ///
    /// # Errors
    /// As [`Expression::parse`], and for comparisons.
    pub fn parse(text: &str, variables: &[&str]) -> Result<Self, Vec<ExpressionError>> {
        let refuse =
            |offset: usize, message: &str| Err(vec![ExpressionError::new(text, offset, message)]);
        if let Some(offset) = text.find(['<', '>', '!']) {
            return refuse(
                offset,
                "a constraint is an equation, φ(q) = 0: an inequality is a stop, which is not holonomic",
            );
        }
        let Some((left, right)) = text.split_once('=') else {
            let left = Expression::parse(text, variables)?;
            return Ok(Equation { left, right: None });
        };
        let behind = left.len() + 1;
        if let Some(second) = right.find('=') {
            return refuse(
                behind + second,
                "a second `=`: write every equation as a constraint of its own",
            );
        }
        if left.trim().is_empty() || right.trim().is_empty() {
            return refuse(left.len(), "nothing stands on one side of the `=`");
        }
        // Blanks ahead keep the columns of the right-hand side.
        let ahead = " ".repeat(left.chars().count() + 1);
        let left = Expression::parse(left, variables);
        let right = Expression::parse(&format!("{ahead}{right}"), variables);
        match (left, right) {
            (Ok(left), Ok(right)) => Ok(Equation {
                left,
                right: Some(right),
            }),
            (left, right) => Err(left
                .err()
                .into_iter()
                .chain(right.err())
                .flatten()
                .collect()),
        }
    }

    /// As [`Expression::first_use`].
    pub fn first_use(&self, slot: usize) -> Option<usize> {
        let right = || self.right.as_ref()?.first_use(slot);
        self.left.first_use(slot).or_else(right)
    }

    fn bind(&self, value: impl Fn(usize) -> Option<f64>) -> Self {
        Equation {
            left: self.left.bind(&value),
            right: self.right.as_ref().map(|right| right.bind(&value)),
        }
    }

    fn evaluate<D: Scalar>(&self, variable: impl Fn(usize) -> D) -> D {
        let left = self.left.evaluate(&variable);
        match &self.right {
            None => left,
            Some(right) => left - right.evaluate(&variable),
        }
    }
}
