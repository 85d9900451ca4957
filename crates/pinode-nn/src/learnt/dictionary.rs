//! Usual laws of what a network sees: the terms of which the formula of a learnt force is made.

use lagrange::Coordinate;

use super::{Feature, Quantity};
use crate::digits::{exponent, short};

/// Shares of the fastest speed over which a sign change is spread.
const SHARPNESS: [f64; 4] = [0.003, 0.01, 0.03, 0.1];

/// A function of what a network sees.
pub struct Function {
    /// `v.slider·|v.slider|`.
    pub name: String,
    factors: Vec<(usize, Curve)>,
}

#[derive(Clone, Copy)]
enum Curve {
    Power(i32),
    /// s |s|
    Square,
    Size,
    Sine(f64),
    Cosine(f64),
    /// tanh(s / width)
    Sign(f64),
}

/// What friction, drag and drives make of a velocity or an input.
const OF_A_FLOW: [Curve; 5] = [
    Curve::Power(1),
    Curve::Power(2),
    Curve::Power(3),
    Curve::Square,
    Curve::Size,
];

impl Curve {
    fn value(self, s: f64) -> f64 {
        match self {
            Curve::Power(n) => s.powi(n),
            Curve::Square => s * s.abs(),
            Curve::Size => s.abs(),
            Curve::Sine(k) => (k * s).sin(),
            Curve::Cosine(k) => (k * s).cos(),
            Curve::Sign(width) => (s / width).tanh(),
        }
    }

    fn name(self, s: &str) -> String {
        let times = |k: f64| {
            if k == 1.0 {
                String::new()
            } else {
                format!("{k} ")
            }
        };
        match self {
            Curve::Power(1) => s.to_owned(),
            Curve::Power(2) => format!("{s}²"),
            Curve::Power(3) => format!("{s}³"),
            Curve::Power(n) => format!("{s}^{n}"),
            Curve::Square => format!("{s}·|{s}|"),
            Curve::Size => format!("|{s}|"),
            Curve::Sine(k) => format!("sin({}{s})", times(k)),
            Curve::Cosine(k) => format!("cos({}{s})", times(k)),
            Curve::Sign(width) => format!("tanh({s}/{})", short(width)),
        }
    }
}

impl Function {
    fn of(names: &[&str], factors: Vec<(usize, Curve)>) -> Self {
        let words: Vec<String> = factors
            .iter()
            .map(|&(k, law)| law.name(names.get(k).copied().unwrap_or_default()))
            .collect();
        Function {
            name: words.join("·"),
            factors,
        }
    }

    /// At what a network sees; NaN where something of it is missing.
    pub fn value(&self, x: &[f64]) -> f64 {
        let factor = |&(k, law): &(usize, Curve)| law.value(x.get(k).copied().unwrap_or(f64::NAN));
        self.factors.iter().map(factor).product()
    }
}

/// The usual laws of these features: springs, waves and weights of positions, friction and drag of velocities, what inputs do, and friction that
/// depends on the place.
pub fn dictionary(
    features: &[Feature],
    names: &[&str],
    coordinates: &[Coordinate],
) -> Vec<Function> {
    let of = |pick: &dyn Fn(Quantity) -> Vec<Curve>| -> Vec<(usize, Curve)> {
        let each = features.iter().enumerate();
        each.flat_map(|(k, f)| pick(f.quantity).into_iter().map(move |law| (k, law)))
            .collect()
    };
    let is_angle = |c: usize| coordinates.get(c).is_some_and(|c| c.angular);
    let places = of(&|quantity| match quantity {
        Quantity::Position(c) if is_angle(c) => vec![
            Curve::Power(1),
            Curve::Power(2),
            Curve::Power(3),
            Curve::Sine(1.0),
            Curve::Cosine(1.0),
            Curve::Sine(2.0),
            Curve::Cosine(2.0),
        ],
        Quantity::Position(_) => vec![Curve::Power(1), Curve::Power(2), Curve::Power(3)],
        Quantity::Cosine(_) | Quantity::Sine(_) => vec![Curve::Power(1), Curve::Power(2)],
        _ => Vec::new(),
    });
    let inputs = of(&|quantity| match quantity {
        Quantity::Input { .. } => OF_A_FLOW.to_vec(),
        _ => Vec::new(),
    });
    let mut speeds = of(&|quantity| match quantity {
        Quantity::Velocity(_) => OF_A_FLOW.to_vec(),
        _ => Vec::new(),
    });
    for (k, feature) in features.iter().enumerate() {
        let fastest = feature.range[0].abs().max(feature.range[1].abs());
        if matches!(feature.quantity, Quantity::Velocity(_)) && fastest > 0.0 && fastest.is_finite()
        {
            speeds.extend(SHARPNESS.map(|share| (k, Curve::Sign(one_digit(share * fastest)))));
        }
    }
    let mut functions: Vec<Function> = [&places, &inputs, &speeds]
        .into_iter()
        .flatten()
        .map(|&factor| Function::of(names, vec![factor]))
        .collect();
    for &place in &places {
        let other_places = places.iter().filter(|other| other.0 > place.0);
        for &other in speeds.iter().chain(&inputs).chain(other_places) {
            functions.push(Function::of(names, vec![place, other]));
        }
    }
    functions
}

/// 0.0312 is 0.03.
fn one_digit(x: f64) -> f64 {
    let size = 10_f64.powi(exponent(x, 0));
    (x / size).round() * size
}
