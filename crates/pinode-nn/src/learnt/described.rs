//! What a quantity that a network sees is called in its model, in which unit, and what it means.

use serde::Serialize;

use super::{Output, Quantity};
use crate::model::{Input, Model, Target};

/// A number that goes into a learnt force or comes out of it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Described {
    /// As in files of weights: `v.slider`, `cos(q.pole)`, `u.motor[-2]`; of what comes out, the joint.
    pub name: String,
    /// Its SI unit; `1` where it has none.
    pub unit: String,
    /// In words.
    pub meaning: String,
}

impl Described {
    /// What a network sees in this model.
    pub fn seen(quantity: Quantity, model: &Model) -> Self {
        let coordinates = model.mechanics.coordinates();
        let inputs: Vec<&str> = model.inputs.iter().map(|i| i.name.as_str()).collect();
        let of = |c: usize| {
            let found = coordinates.get(c);
            found.map_or(("", "", ""), |c| {
                (c.name.as_str(), c.unit(), c.force_unit())
            })
        };
        let (unit, meaning) = match quantity {
            Quantity::Position(c) => (of(c).1.to_owned(), format!("position of {}", of(c).0)),
            Quantity::Cosine(c) => (
                "1".to_owned(),
                format!("cosine of the angle of {}", of(c).0),
            ),
            Quantity::Sine(c) => ("1".to_owned(), format!("sine of the angle of {}", of(c).0)),
            Quantity::Velocity(c) => (format!("{}/s", of(c).1), format!("velocity of {}", of(c).0)),
            Quantity::Input { input, back } => {
                let own = model.inputs.get(input);
                let target = own.map_or(Target::Coordinate(usize::MAX), Input::target);
                let name = inputs.get(input).copied().unwrap_or_default();
                let gain = own.map_or(1.0, |i| i.gain);
                let when = match back {
                    0 => String::new(),
                    1 => ", one sample of the log ago".to_owned(),
                    back => format!(", {back} samples of the log ago"),
                };
                let on = model.target_name(target);
                match target {
                    Target::Coordinate(c) => {
                        let unit = of(c).2;
                        let meaning = format!(
                            "force of the input {name} on {on}: its gain of {gain} {unit} per unit times what its drive lets through{when}"
                        );
                        (unit.to_owned(), meaning)
                    }
                    _ => {
                        let meaning = format!(
                            "factor on the force and the torque of the input {name} on {on}: its gain of {gain} times what its drive lets through{when}"
                        );
                        ("1".to_owned(), meaning)
                    }
                }
            }
        };
        Described {
            name: quantity.name(coordinates, &inputs),
            unit,
            meaning,
        }
    }

    /// What a network adds to Q of this model.
    pub fn given(output: &Output, model: &Model) -> Self {
        let coordinate = model.mechanics.coordinates().get(output.coordinate);
        let (name, unit) = coordinate.map_or(("", ""), |c| (c.name.as_str(), c.force_unit()));
        Described {
            name: name.to_owned(),
            unit: unit.to_owned(),
            meaning: format!(
                "generalized force on {name}, on the right-hand side of M v̇ + C v + G = Q"
            ),
        }
    }
}
