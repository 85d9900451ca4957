//! Usual laws of what a network sees: the terms of which the formula of a learnt force is made.

use lagrange::Coordinate;

use super::{Feature, Quantity};
use crate::digits::{exponent, number};

/// Shares of the fastest speed over which a sign change is spread.
const SHARPNESS: [f64; 4] = [0.003, 0.01, 0.03, 0.1];

/// A function of what a network sees.
pub struct Function {
    /// `v.slider·|v.slider|`.
    pub name: String,
    factors: Vec<(usize, Law)>,
}

#[derive(Clone, Copy)]
enum Law {
    Power(i32),
    /// s |s|
    Square,
    Size,
    Sine(f64),
    Cosine(f64),
    /// tanh(s / width)
    Sign(f64),
}

impl Law {
    fn value(self, s: f64) -> f64 {
        match self {
            Law::Power(n) => s.powi(n),
            Law::Square => s * s.abs(),
            Law::Size => s.abs(),
            Law::Sine(k) => (k * s).sin(),
            Law::Cosine(k) => (k * s).cos(),
            Law::Sign(width) => (s / width).tanh(),
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
            Law::Power(1) => s.to_owned(),
            Law::Power(2) => format!("{s}²"),
            Law::Power(3) => format!("{s}³"),
            Law::Power(n) => format!("{s}^{n}"),
            Law::Square => format!("{s}·|{s}|"),
            Law::Size => format!("|{s}|"),
            Law::Sine(k) => format!("sin({}{s})", times(k)),
            Law::Cosine(k) => format!("cos({}{s})", times(k)),
            Law::Sign(width) => format!("tanh({s}/{})", short(width)),
        }
    }
}

/// A width of one digit as it is written.
fn short(width: f64) -> String {
    let text = number(width);
    match text.contains('.') && !text.contains('×') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
        false => text,
    }
}

impl Function {
    fn of(names: &[&str], factors: Vec<(usize, Law)>) -> Self {
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
        let factor = |&(k, law): &(usize, Law)| law.value(x.get(k).copied().unwrap_or(f64::NAN));
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
    let of = |pick: &dyn Fn(Quantity) -> Vec<Law>| -> Vec<(usize, Law)> {
        let each = features.iter().enumerate();
        each.flat_map(|(k, f)| pick(f.quantity).into_iter().map(move |law| (k, law)))
            .collect()
    };
    let is_angle = |c: usize| coordinates.get(c).is_some_and(|c| c.angular);
    let places = of(&|quantity| match quantity {
        Quantity::Position(c) if is_angle(c) => vec![
            Law::Power(1),
            Law::Power(2),
            Law::Power(3),
            Law::Sine(1.0),
            Law::Cosine(1.0),
            Law::Sine(2.0),
            Law::Cosine(2.0),
        ],
        Quantity::Position(_) => vec![Law::Power(1), Law::Power(2), Law::Power(3)],
        Quantity::Cosine(_) | Quantity::Sine(_) => vec![Law::Power(1), Law::Power(2)],
        _ => Vec::new(),
    });
    let inputs = of(&|quantity| match quantity {
        Quantity::Input { .. } => vec![
            Law::Power(1),
            Law::Power(2),
            Law::Power(3),
            Law::Square,
            Law::Size,
        ],
        _ => Vec::new(),
    });
    let mut speeds = of(&|quantity| match quantity {
        Quantity::Velocity(_) => vec![
            Law::Power(1),
            Law::Power(2),
            Law::Power(3),
            Law::Square,
            Law::Size,
        ],
        _ => Vec::new(),
    });
    for (k, feature) in features.iter().enumerate() {
        let fastest = feature.range[0].abs().max(feature.range[1].abs());
        if matches!(feature.quantity, Quantity::Velocity(_)) && fastest > 0.0 && fastest.is_finite()
        {
            speeds.extend(SHARPNESS.map(|share| (k, Law::Sign(one_digit(share * fastest)))));
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
