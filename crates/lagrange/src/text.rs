//! A mechanism whose energies are written as text.

use std::fmt;

use crate::caret;
use crate::constraint::{Constraint, Equation, TextConstraints};
use crate::expression::{is_identifier, is_plain, nearest, reserved};
use crate::trace::mass_depends_on_velocity;
use crate::{Coordinate, Expression, ExpressionError, Lagrangian, Parameter, Role, Scalar};

/// The energies of a mechanism as text, see [`TextLagrangian`].
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TextSource {
    /// Names of the coordinates; the velocity of `x` is written `x_dot`.
    pub coordinates: Vec<String>,
    /// Which of them are angles (rad): these wrap. The others are displacements (m).
    pub angles: Vec<String>,
    /// T, J.
    pub kinetic: String,
    /// V, J.
    pub potential: String,
    /// Holonomic constraints φ = 0: φ, or an equation with one `=`, in the coordinates and constants; see [`TextConstraints`].
    pub constraints: Vec<String>,
    /// Names and values of the constants.
    pub parameters: Vec<(String, f64)>,
}

/// A part of a [`TextSource`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Field {
    /// The coordinate of this index; index 0 also when there is none.
    Coordinates(usize),
    /// The angle of this index.
    Angles(usize),
    /// The kinetic energy.
    Kinetic,
    /// The potential energy.
    Potential,
    /// The constraint of this index.
    Constraint(usize),
    /// The parameter of this index.
    Parameter(usize),
}

impl fmt::Display for Field {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Field::Coordinates(i) => write!(f, "coordinates[{i}]"),
            Field::Angles(i) => write!(f, "angles[{i}]"),
            Field::Kinetic => write!(f, "kinetic"),
            Field::Potential => write!(f, "potential"),
            Field::Constraint(i) => write!(f, "constraints[{i}]"),
            Field::Parameter(i) => write!(f, "parameters[{i}]"),
        }
    }
}

/// A fault of a [`TextSource`], or something in it that is probably not meant.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct TextProblem {
    /// Where.
    pub field: Field,
    /// The character of that field's text, from 1; `None` for the field as a whole.
    pub column: Option<usize>,
    /// What is wrong and how to mend it.
    pub message: String,
}

impl TextProblem {
    fn new(field: Field, column: Option<usize>, message: impl Into<String>) -> Self {
        TextProblem {
            field,
            column,
            message: message.into(),
        }
    }

    /// The message, and under it the place in the formula with a caret.
    pub fn render(&self, source: &TextSource) -> String {
        let text = match self.field {
            Field::Kinetic => &source.kinetic,
            Field::Potential => &source.potential,
            Field::Constraint(i) if i < source.constraints.len() => &source.constraints[i],
            _ => return self.to_string(),
        };
        match self.column {
            Some(column) => format!("{self}\n{}", caret(text, column)),
            None => self.to_string(),
        }
    }
}

impl fmt::Display for TextProblem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.column {
            Some(column) => write!(f, "{}, column {column}: {}", self.field, self.message),
            None => write!(f, "{}: {}", self.field, self.message),
        }
    }
}

impl std::error::Error for TextProblem {}

/// A mechanism given by T and V as formulas in its coordinates, velocities and constants; see [`Expression`] for the notation.
///
/// As a [`Lagrangian`] it is the free mechanism; its constraints, where it has some, are [`constraints`](Self::constraints), for
/// [`Constrained`](crate::constraint::Constrained).
///
/// ```
/// use lagrange::{Lagrangian, TextLagrangian, TextSource};
///
/// let pendulum = TextLagrangian::new(&TextSource {
///     coordinates: vec!["phi".into()],
///     angles: vec!["phi".into()],
///     kinetic: "0.5*m*l^2*phi_dot^2".into(),
///     potential: "-m*g*l*cos(phi)".into(),
///     parameters: vec![("m".into(), 2.0), ("l".into(), 0.5), ("g".into(), 9.81)],
///     ..TextSource::default()
/// })
/// .map_err(|problems| problems[0].clone())?;
/// assert_eq!(pendulum.kinetic(&[0.3], &[4.0]), 4.0);
/// assert_eq!(pendulum.parameters()[1].name, "l");
/// # Ok::<(), lagrange::TextProblem>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct TextLagrangian {
    coordinates: Vec<Coordinate>,
    parameters: Vec<Parameter>,
    /// In q, v and the parameters, in this order of slots.
    general: Energies,
    /// The same with the nominal parameters put in.
    nominal: Energies,
    constraints: TextConstraints,
    kinetic_is_quadratic: bool,
    warnings: Vec<TextProblem>,
}

#[derive(Debug, Clone, PartialEq)]
struct Energies {
    kinetic: Expression,
    potential: Expression,
}

impl TextLagrangian {
    /// Parses and checks `source`.
    ///
    /// # Errors
    /// All that is wrong with it, field by field: names (spelling, doubles, clashes with functions, constants and velocities),
    /// parameters that are not finite, angles that are no coordinates, formulas that do not parse, velocities in V or in a
    /// constraint, energies and constraints that are not finite at any of some ordinary states.
    pub fn new(source: &TextSource) -> Result<Self, Vec<TextProblem>> {
        let n = source.coordinates.len();
        let mut problems = name_problems(source);
        let velocities: Vec<String> = source.coordinates.iter().map(|c| velocity(c)).collect();
        let names: Vec<&str> = source
            .coordinates
            .iter()
            .chain(&velocities)
            .map(String::as_str)
            .chain(source.parameters.iter().map(|(name, _)| name.as_str()))
            .collect();
        let mut note = |field: Field, errors: Vec<ExpressionError>| {
            let here = |e: ExpressionError| TextProblem::new(field, Some(e.column), e.message);
            problems.extend(errors.into_iter().map(here));
        };
        let mut energy = |field: Field, text: &str| {
            Expression::parse(text, &names)
                .map_err(|errors| note(field, errors))
                .ok()
        };
        let kinetic = energy(Field::Kinetic, &source.kinetic);
        let potential = energy(Field::Potential, &source.potential);
        let equation = |(i, text): (usize, &String)| {
            Equation::parse(text, &names)
                .map_err(|errors| note(Field::Constraint(i), errors))
                .ok()
        };
        let formulas: Vec<Option<Equation>> = source
            .constraints
            .iter()
            .enumerate()
            .map(equation)
            .collect();
        if let Some(potential) = &potential {
            problems.extend((n..2 * n).filter_map(|slot| {
                let column = potential.first_use(slot)?;
                let name = names.get(slot)?;
                Some(TextProblem::new(
                    Field::Potential,
                    Some(column),
                    format!(
                        "`{name}` is a velocity: V depends on the coordinates alone (a force that depends on velocity is an effect, not an energy)"
                    ),
                ))
            }));
        }
        for (i, formula) in formulas.iter().enumerate() {
            problems.extend(constraint_problems(i, formula.as_ref(), n, &names));
        }
        let formulas: Vec<Equation> = formulas.into_iter().flatten().collect();
        let (Some(kinetic), Some(potential)) = (kinetic, potential) else {
            return Err(problems);
        };
        if !problems.is_empty() {
            return Err(problems);
        }

        let general = Energies { kinetic, potential };
        let value = |slot: usize| source.parameters.get(slot.checked_sub(2 * n)?).map(|p| p.1);
        let constraints = TextConstraints::new(&source.constraints, formulas, n, value);
        let mut lagrangian = TextLagrangian {
            coordinates: coordinates(source),
            parameters: parameters(source),
            nominal: Energies {
                kinetic: general.kinetic.bind(value),
                potential: general.potential.bind(value),
            },
            warnings: unused(source, &general, &constraints, &names),
            constraints,
            general,
            kinetic_is_quadratic: false,
        };
        match lagrangian.probe() {
            Ok(quadratic) => lagrangian.kinetic_is_quadratic = quadratic,
            Err(problems) => return Err(problems),
        }
        if mass_depends_on_velocity(&lagrangian) {
            lagrangian.warnings.push(TextProblem::new(
                Field::Kinetic,
                None,
                "M = ∂²T/∂v∂v depends on the velocities: Newton's T is at most quadratic in them; is an exponent wrong?",
            ));
        }
        Ok(lagrangian)
    }

    /// The coordinates, in the order of q.
    pub fn coordinates(&self) -> &[Coordinate] {
        &self.coordinates
    }

    /// Whether T is a quadratic form in v, tested at some fixed states: T(q, 0) = 0, T(q, s v) = s² T(q, v) and
    /// T(q, a + b) + T(q, a − b) = 2 T(q, a) + 2 T(q, b).
    ///
    /// Where it is not, the mass matrix depends on the velocity.
    pub fn kinetic_is_quadratic(&self) -> bool {
        self.kinetic_is_quadratic
    }

    /// The constraints φ = 0; empty where there are none.
    pub fn constraints(&self) -> &TextConstraints {
        &self.constraints
    }

    /// What is probably not meant: parameters that no energy uses, velocities that T does not use, a T that is more than quadratic in them.
    pub fn warnings(&self) -> &[TextProblem] {
        &self.warnings
    }

    /// Whether these are the nominal parameters as plain numbers, for which the constant parts of the energies are computed already.
    fn is_nominal<D: Scalar>(&self, p: &[D]) -> bool {
        let nominal = || self.parameters.iter().map(|p| p.nominal);
        is_plain::<D>()
            && p.iter()
                .zip(nominal())
                .all(|(p, nominal)| p.re() == nominal)
    }

    /// Evaluates the energies at ordinary states; whether T is quadratic there.
    fn probe(&self) -> Result<bool, Vec<TextProblem>> {
        let n = self.dof();
        let (mut kinetic_finite, mut potential_finite, mut quadratic) = (false, false, true);
        for k in 0..PROBES {
            let q = probe(3 * k, n, 0.2, 1.3);
            let a = probe(3 * k + 1, n, -1.5, 1.5);
            let b = probe(3 * k + 2, n, -1.5, 1.5);
            potential_finite |= self.potential(&q).is_finite();
            let at = |sa: f64, sb: f64| {
                let v: Vec<f64> = a.iter().zip(&b).map(|(a, b)| sa * a + sb * b).collect();
                self.kinetic(&q, &v)
            };
            let (ta, tb) = (at(1.0, 0.0), at(0.0, 1.0));
            if !ta.is_finite() || !tb.is_finite() {
                continue;
            }
            kinetic_finite = true;
            let scale = ta.abs() + tb.abs();
            let zero = |x: f64| x.abs() <= 1e-9 * scale;
            quadratic &= zero(at(0.0, 0.0))
                && zero(at(-1.0, 0.0) - ta)
                && zero(at(3.0, 0.0) - 9.0 * ta)
                && zero(at(1.0, 1.0) + at(1.0, -1.0) - 2.0 * (ta + tb));
            // Each velocity alone, so that a small term does not hide behind a large one. Doubling v rounds nothing.
            quadratic &= (0..n).all(|i| {
                let mut v = vec![0.0; n];
                let mut along = |x: f64| {
                    v.iter_mut().skip(i).take(1).for_each(|v| *v = x);
                    self.kinetic(&q, &v)
                };
                let (once, twice) = (along(0.7), along(1.4));
                (twice - 4.0 * once).abs() <= 1e-9 * once.abs()
            });
        }
        let mut problems = self.constraints_without_value();
        if !kinetic_finite {
            problems.push(without_value(Field::Kinetic, "T"));
        }
        if !potential_finite {
            problems.push(without_value(Field::Potential, "V"));
        }
        if problems.is_empty() {
            Ok(quadratic)
        } else {
            Err(problems)
        }
    }

    /// Constraints that are not finite at any of the ordinary states.
    fn constraints_without_value(&self) -> Vec<TextProblem> {
        let mut finite = vec![false; self.constraints.len()];
        let mut values = vec![0.0; self.constraints.len()];
        for k in 0..PROBES {
            self.constraints
                .residual(&probe(3 * k, self.dof(), 0.2, 1.3), &mut values);
            for (finite, value) in finite.iter_mut().zip(&values) {
                *finite |= value.is_finite();
            }
        }
        let faulty = finite.iter().enumerate().filter(|(_, finite)| !**finite);
        faulty
            .map(|(i, _)| without_value(Field::Constraint(i), "φ"))
            .collect()
    }
}

/// Velocities in a constraint, or no coordinate.
fn constraint_problems(
    i: usize,
    formula: Option<&Equation>,
    n: usize,
    names: &[&str],
) -> Vec<TextProblem> {
    let Some(formula) = formula else {
        return Vec::new();
    };
    let field = Field::Constraint(i);
    let mut problems: Vec<TextProblem> = (n..2 * n)
        .filter_map(|slot| {
            let (column, name) = (formula.first_use(slot)?, names.get(slot)?);
            Some(TextProblem::new(
                field,
                Some(column),
                format!(
                    "`{name}` is a velocity: a holonomic constraint depends on the coordinates alone (its rate follows; a rolling \
                     or rate condition that is no rate of such a formula is not holonomic)"
                ),
            ))
        })
        .collect();
    if problems.is_empty() && (0..n).all(|slot| formula.first_use(slot).is_none()) {
        problems.push(TextProblem::new(
            field,
            None,
            "no coordinate stands in it: there is nothing that it constrains",
        ));
    }
    problems
}

fn without_value(field: Field, name: &str) -> TextProblem {
    TextProblem::new(
        field,
        None,
        format!(
            "{name} is NaN or infinite at each of {PROBES} ordinary states (coordinates between 0.2 and 1.3): \
             look for a division by 0, or for sqrt, ln, asin or acos of a number outside of their domain"
        ),
    )
}

const PROBES: usize = 4;

/// `n` numbers in (low, high), spread by the golden ratio: fixed, and in no special relation to one another.
fn probe(seed: usize, n: usize, low: f64, high: f64) -> Vec<f64> {
    const GOLDEN: f64 = 0.618_033_988_749_894_9;
    (1..=n)
        .map(|i| {
            low + (high - low) * (GOLDEN * i as f64 + 0.754_877_666 * seed as f64 + 0.1).fract()
        })
        .collect()
}

fn velocity(coordinate: &str) -> String {
    format!("{coordinate}_dot")
}

fn coordinates(source: &TextSource) -> Vec<Coordinate> {
    let coordinate = |name: &String| {
        let angular = source.angles.contains(name);
        Coordinate {
            name: name.clone(),
            joint: name.clone(),
            angular,
            wraps: angular,
            floating: false,
        }
    };
    source.coordinates.iter().map(coordinate).collect()
}

fn parameters(source: &TextSource) -> Vec<Parameter> {
    let parameter = |(name, nominal): &(String, f64)| Parameter {
        role: Role::Constant,
        name: name.clone(),
        nominal: *nominal,
    };
    source.parameters.iter().map(parameter).collect()
}

fn unused(
    source: &TextSource,
    energies: &Energies,
    constraints: &TextConstraints,
    names: &[&str],
) -> Vec<TextProblem> {
    let n = source.coordinates.len();
    let mut warnings = Vec::new();
    for (slot, name) in names.iter().enumerate().skip(n) {
        let in_kinetic = energies.kinetic.first_use(slot).is_some();
        let in_potential = energies.potential.first_use(slot).is_some();
        if slot < 2 * n && !in_kinetic {
            warnings.push(TextProblem::new(
                Field::Kinetic,
                None,
                format!("T does not contain `{name}`: this coordinate moves no mass"),
            ));
        } else if slot >= 2 * n && !in_kinetic && !in_potential && !constraints.uses(slot) {
            warnings.push(TextProblem::new(
                Field::Parameter(slot - 2 * n),
                None,
                format!("no energy uses the parameter `{name}`"),
            ));
        }
    }
    warnings
}

/// Faults of names and of the values of parameters.
fn name_problems(source: &TextSource) -> Vec<TextProblem> {
    let mut problems = Vec::new();
    if source.coordinates.is_empty() {
        problems.push(TextProblem::new(
            Field::Coordinates(0),
            None,
            "there is no coordinate: name at least one",
        ));
    }
    let coordinates = source.coordinates.iter().enumerate();
    let parameters = source.parameters.iter().enumerate();
    let named: Vec<(Field, &str)> = coordinates
        .map(|(i, name)| (Field::Coordinates(i), name.as_str()))
        .chain(parameters.map(|(i, (name, _))| (Field::Parameter(i), name.as_str())))
        .collect();
    for (i, &(field, name)) in named.iter().enumerate() {
        let mut refuse = |message: String| problems.push(TextProblem::new(field, None, message));
        if !is_identifier(name) {
            refuse(format!(
                "`{}` is not a name: write a letter (a-z, A-Z) or `_`, then letters, digits and `_`",
                name.escape_debug()
            ));
        } else if let Some(what) = reserved(name) {
            refuse(format!("`{name}` is a {what}: choose another name"));
        } else if let Some((earlier, _)) = named.iter().take(i).find(|(_, n)| *n == name) {
            refuse(format!(
                "the name `{name}` is taken by {earlier}: choose another"
            ));
        }
        let of = source.coordinates.iter().find(|c| velocity(c) == name);
        if let Some(coordinate) = of {
            refuse(format!(
                "`{name}` is the velocity of the coordinate `{coordinate}`: choose another name"
            ));
        }
    }
    for (i, (name, value)) in source.parameters.iter().enumerate() {
        if !value.is_finite() {
            problems.push(TextProblem::new(
                Field::Parameter(i),
                None,
                format!("`{name}` is {value}: a parameter must be finite"),
            ));
        }
    }
    for (i, angle) in source.angles.iter().enumerate() {
        let message = if !source.coordinates.contains(angle) {
            let cure = match nearest(angle, source.coordinates.iter().map(String::as_str)) {
                Some(near) => format!("did you mean `{near}`?"),
                None => format!("coordinates are {}", source.coordinates.join(", ")),
            };
            format!("`{}` is not a coordinate; {cure}", angle.escape_debug())
        } else if source.angles.iter().take(i).any(|a| a == angle) {
            format!("`{angle}` stands here twice")
        } else {
            continue;
        };
        problems.push(TextProblem::new(Field::Angles(i), None, message));
    }
    problems
}

impl Lagrangian for TextLagrangian {
    fn dof(&self) -> usize {
        self.coordinates.len()
    }

    fn kinetic<D: Scalar>(&self, q: &[D], v: &[D]) -> D {
        let n = q.len();
        let variable = |slot: usize| if slot < n { q[slot] } else { v[slot - n] };
        self.nominal.kinetic.evaluate(variable)
    }

    fn potential<D: Scalar>(&self, q: &[D]) -> D {
        self.nominal.potential.evaluate(|slot| q[slot])
    }

    fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }

    fn kinetic_with<D: Scalar>(&self, q: &[D], v: &[D], p: &[D]) -> D {
        if self.is_nominal(p) {
            return self.kinetic(q, v);
        }
        let n = q.len();
        self.general.kinetic.evaluate(|slot| {
            if slot < n {
                q[slot]
            } else if slot < 2 * n {
                v[slot - n]
            } else {
                p[slot - 2 * n]
            }
        })
    }

    fn potential_with<D: Scalar>(&self, q: &[D], p: &[D]) -> D {
        if self.is_nominal(p) {
            return self.potential(q);
        }
        let n = q.len();
        let variable = |slot: usize| if slot < n { q[slot] } else { p[slot - 2 * n] };
        self.general.potential.evaluate(variable)
    }
}
