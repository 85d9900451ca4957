//! How well the rest of the model is known: `[tolerance]`.

use lagrange::{Mechanics, Role};

use super::document::{Faults, Section, number};
use super::mechanism::{Mechanism, find_coordinate};
use crate::naming::{hint, quoted};

/// Standard deviations of what a fit may move beside the effects: priors.
#[derive(Debug, Clone, PartialEq)]
pub struct Tolerance {
    /// Of masses and inertias, relative.
    pub mass: f64,
    /// Of input gains, relative.
    pub gain: f64,
    /// Of sensor zeros, per coordinate, m or rad; `None`: two quanta.
    pub zero: Vec<Option<f64>>,
    /// Of constants named in the energies: index in [`Mechanics::parameters`] and relative standard deviation, 0 = exact.
    pub parameters: Vec<(usize, f64)>,
}

impl Tolerance {
    /// The defaults for a mechanism with so many coordinates.
    pub fn new(coordinates: usize) -> Self {
        Tolerance {
            mass: 0.02,
            gain: 0.01,
            zero: vec![None; coordinates],
            parameters: Vec::new(),
        }
    }
}

/// The `[tolerance]` table.
pub(super) fn read(
    root: &Section,
    mechanism: Option<&Mechanism>,
    faults: &mut Faults,
) -> Tolerance {
    let mut tolerance = Tolerance::new(mechanism.map_or(0, |m| m.mechanics.coordinates().len()));
    let Some(section) = root.section("tolerance", "[tolerance]", faults) else {
        return tolerance;
    };
    section.check_keys(&["mass", "gain", "zero", "parameters"], faults);
    let not_negative = |x: f64| x >= 0.0;
    let mut relative = |key| section.number_that(key, "0 or positive", not_negative, faults);
    if let Some(mass) = relative("mass") {
        tolerance.mass = mass;
    }
    if let Some(gain) = relative("gain") {
        tolerance.gain = gain;
    }
    if let Some(zeros) = section.section("zero", "[tolerance.zero]", faults) {
        for (name, _) in zeros.entries() {
            let value = zeros.number_that(name.value, "0 or positive", not_negative, faults);
            if let Some(index) =
                mechanism.and_then(|m| find_coordinate(m, name.value, name.offset(), faults))
                && let Some(zero) = tolerance.zero.get_mut(index)
            {
                *zero = value;
            }
        }
    }
    if let Some(constants) = section.section("parameters", "[tolerance.parameters]", faults) {
        for (name, _) in constants.entries() {
            let value = constants.number_that(name.value, "0 or positive", not_negative, faults);
            if let Some(mechanics) = mechanism.map(|m| m.mechanics.as_ref())
                && let Some(index) =
                    find_parameter(mechanics, Role::Constant, name.value, name.offset(), faults)
                && let Some(value) = value
            {
                tolerance.parameters.push((index, value));
            }
        }
    }
    tolerance
}

/// The `[mass_scale]` table applied to the nominal parameters.
pub(super) fn parameter_values(
    root: &Section,
    mechanics: Option<&dyn Mechanics>,
    faults: &mut Faults,
) -> Vec<f64> {
    let mut values = mechanics.map_or_else(Vec::new, |m| m.nominal());
    let Some(section) = root.section("mass_scale", "[mass_scale]", faults) else {
        return values;
    };
    for (name, value) in section.entries() {
        let factor = number(name.value, value, faults).filter(|factor| {
            if factor.value <= 0.0 {
                faults.at(
                    factor.offset(),
                    format!(
                        "{} is {}: a factor on mass and inertia must be positive",
                        quoted(name.value),
                        factor.value
                    ),
                );
            }
            factor.value > 0.0
        });
        let index = mechanics
            .and_then(|m| find_parameter(m, Role::MassScale, name.value, name.offset(), faults));
        if let (Some(factor), Some(index)) = (factor, index)
            && let Some(value) = values.get_mut(index)
        {
            *value = factor.value;
        }
    }
    values
}

fn find_parameter(
    mechanics: &dyn Mechanics,
    role: Role,
    name: &str,
    offset: usize,
    faults: &mut Faults,
) -> Option<usize> {
    let parameters = mechanics.parameters();
    let index = parameters
        .iter()
        .position(|p| p.role == role && p.name == name);
    if index.is_none() {
        let names: Vec<&str> = parameters
            .iter()
            .filter(|p| p.role == role)
            .map(|p| p.name.as_str())
            .collect();
        let (what, plural) = match role {
            Role::MassScale => ("moving link", "moving links with mass"),
            _ => ("parameter", "[lagrangian.parameters]"),
        };
        faults.at(
            offset,
            format!(
                "unknown {what} {}{}",
                quoted(name),
                hint(name, plural, &names)
            ),
        );
    }
    index
}
