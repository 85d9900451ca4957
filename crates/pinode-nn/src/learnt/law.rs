//! What a learnt force is like: which signals it follows, how it changes with their signs, and a formula where a short one fits.
//!
//! Over states that it was trained on, with f_k the force there:
//!
//! - the share of a signal is the adjusted correlation ratio of f over bins of that signal alone;
//! - its odd share compares o = ½ [f(…, s, …) − f(…, −s, …)] with e = ½ [f(…, s, …) + f(…, −s, …)] where both states were seen:
//!   Σ o² / Σ [o² + (e − ē)²];
//! - the formula is f ≈ c₀ + Σ c_i φ_i with φ_i usual laws of what it sees, found one after the other by orthogonal least squares (Chen, Billings and
//!   Luo 1989): the next is the one that takes most from Σ f² beside those chosen.

use nalgebra::{DMatrix, DVector};
use serde::Serialize;

use super::dictionary::{Function, dictionary};
use super::{Described, LearntForce};
use crate::bins::explained_by;
use crate::digits::number;
use crate::model::Model;

/// So many states are looked at, spread evenly.
const MOST_STATES: usize = 4000;
/// Fewer say nothing.
const FEWEST_STATES: usize = 100;
/// Bins of a signal.
const BINS: usize = 24;
/// A signal with less than this share is not asked for its sign.
const WORTH: f64 = 0.1;
/// So many terms has a formula at most.
const MOST_TERMS: usize = 4;
/// A further term has to take so much of the variance.
const WORTH_A_TERM: f64 = 0.005;
/// A formula that explains less is none.
const FITS: f64 = 0.95;

/// What a learnt force is like, over the states that it was trained on.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Law {
    /// The joint that it acts on.
    pub joint: String,
    /// N or N·m.
    pub unit: String,
    /// Its root mean square.
    pub rms: f64,
    /// What it sees, what follows from most of it first.
    pub signals: Vec<Signal>,
    /// A formula where one fits.
    pub formula: Option<Formula>,
}

/// A signal that a learnt force sees.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Signal {
    /// `v.slider`, `cos(q.pole)`, `u.motor[-2]`.
    pub name: String,
    /// Its unit.
    pub unit: String,
    /// Where it was in training: the force is not known beyond.
    pub range: [f64; 2],
    /// Adjusted share of the force's variance that this signal explains by itself.
    pub share: f64,
    /// 1 for a force that changes its sign with the signal's, 0 for one that does not care; none where the signal says little or was seen
    /// with one sign only.
    pub odd_share: Option<f64>,
}

/// A short sum that does as the network does.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Formula {
    /// `-0.312 tanh(v.slider/0.01) - 0.118 v.slider·|v.slider|`, SI units.
    pub text: String,
    /// Its terms.
    pub terms: Vec<Term>,
    /// The share of the network's variance that it explains.
    pub share: f64,
}

/// A coefficient and what it stands before.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Term {
    /// `v.slider·|v.slider|`; `1` for a constant.
    pub function: String,
    /// In SI units.
    pub coefficient: f64,
}

impl Law {
    /// The law of output `output` of a force that is a part of `model`, over `states`: rows of values of its features. `None` where there are
    /// too few of them, or the output is not there.
    pub fn of(
        force: &LearntForce,
        output: usize,
        states: &[Vec<f64>],
        model: &Model,
    ) -> Option<Self> {
        let given = Described::given(force.outputs().get(output)?, model);
        if states.len() < FEWEST_STATES {
            return None;
        }
        let stride = states.len().div_ceil(MOST_STATES);
        let states: Vec<&[f64]> = states.iter().step_by(stride).map(Vec::as_slice).collect();
        let at = |x: &[f64]| force.at(x).get(output).copied().unwrap_or(f64::NAN);
        let values: Vec<f64> = states.iter().map(|x| at(x)).collect();
        if values.iter().any(|f| !f.is_finite()) {
            return None;
        }
        let seen: Vec<Described> = force
            .features()
            .iter()
            .map(|feature| Described::seen(feature.quantity, model))
            .collect();
        let mut signals: Vec<Signal> = seen
            .iter()
            .zip(force.features())
            .enumerate()
            .map(|(k, (described, feature))| {
                let column: Vec<f64> = states.iter().map(|x| x[k]).collect();
                let share = explained_by(&values, &[&column], BINS);
                let mirrored = |x: &&[f64]| {
                    let mut other = x.to_vec();
                    other[k] = -other[k];
                    let seen = x[k] > 0.0 && force.outside(&other).is_none();
                    seen.then(|| (at(x), at(&other)))
                };
                let pairs: Vec<(f64, f64)> = match share > WORTH {
                    true => states.iter().filter_map(mirrored).collect(),
                    false => Vec::new(),
                };
                Signal {
                    name: described.name.clone(),
                    unit: described.unit.clone(),
                    range: feature.range,
                    share,
                    odd_share: odd_share(&pairs),
                }
            })
            .collect();
        signals.sort_by(|a, b| b.share.total_cmp(&a.share));
        let names: Vec<&str> = seen.iter().map(|s| s.name.as_str()).collect();
        let functions = dictionary(force.features(), &names, model.mechanics.coordinates());
        Some(Law {
            joint: given.name,
            unit: given.unit,
            rms: (squares(&values) / values.len() as f64).sqrt(),
            signals,
            formula: formula(&values, &states, &functions),
        })
    }

    /// In sentences.
    pub fn sentences(&self) -> Vec<String> {
        let mut said = Vec::new();
        let follows: Vec<String> = self
            .signals
            .iter()
            .filter(|s| s.share > WORTH)
            .map(|s| {
                let sign = match s.odd_share {
                    Some(x) if x > 0.8 => ", odd in it",
                    Some(x) if x < 0.2 => ", even in it",
                    _ => "",
                };
                format!("{:.0} % from {}{sign}", 100.0 * s.share, s.name)
            })
            .collect();
        if !follows.is_empty() {
            said.push(format!(
                "The learnt force on `{}`, {} {} (root mean square), follows by itself {}.",
                self.joint,
                number(self.rms),
                self.unit,
                follows.join("; ")
            ));
        }
        said.push(match &self.formula {
            Some(formula) => format!(
                "A formula explains {:.1} % of it: {} {}, in SI units.",
                100.0 * formula.share,
                formula.text,
                self.unit
            ),
            None => format!(
                "No sum of at most {MOST_TERMS} usual laws explains {:.0} % of it.",
                100.0 * FITS
            ),
        });
        let ranges: Vec<String> = self
            .signals
            .iter()
            .map(|s| {
                let [low, high] = s.range;
                let unit = if s.unit == "1" {
                    String::new()
                } else {
                    format!(" {}", s.unit)
                };
                format!("{} from {} to {}{unit}", s.name, number(low), number(high))
            })
            .collect();
        said.push(format!(
            "That is known for {} and not beyond.",
            ranges.join(", ")
        ));
        said
    }
}

fn squares(values: &[f64]) -> f64 {
    values.iter().map(|x| x * x).sum()
}

/// Of pairs f(s), f(−s).
fn odd_share(pairs: &[(f64, f64)]) -> Option<f64> {
    if pairs.len() < BINS {
        return None;
    }
    let n = pairs.len() as f64;
    let even_mean = pairs.iter().map(|(a, b)| 0.5 * (a + b)).sum::<f64>() / n;
    let odd: f64 = pairs.iter().map(|(a, b)| (0.5 * (a - b)).powi(2)).sum();
    let even: f64 = pairs
        .iter()
        .map(|(a, b)| (0.5 * (a + b) - even_mean).powi(2))
        .sum();
    Some(odd / (odd + even).max(f64::MIN_POSITIVE))
}

/// The shortest sum of `functions` that does as `values` at `states`.
fn formula(values: &[f64], states: &[&[f64]], functions: &[Function]) -> Option<Formula> {
    let n = values.len();
    let mean = values.iter().sum::<f64>() / n as f64;
    let centred: Vec<f64> = values.iter().map(|f| f - mean).collect();
    let total = squares(&centred);
    if total.is_nan() || total <= 0.0 {
        return None;
    }
    // Columns without their means; what was chosen is taken out of those that are left.
    let mut columns: Vec<DVector<f64>> = functions
        .iter()
        .map(|function| {
            let mut column = DVector::from_iterator(n, states.iter().map(|x| function.value(x)));
            let mean = column.mean();
            column.add_scalar_mut(-mean);
            column
        })
        .collect();
    let own: Vec<f64> = columns.iter().map(DVector::norm_squared).collect();
    let mut rest = DVector::from_vec(centred);
    let mut chosen: Vec<usize> = Vec::new();
    while chosen.len() < MOST_TERMS {
        let gain = |k: usize| {
            let square = columns[k].norm_squared();
            // What the chosen ones say already.
            match square > 1e-6 * own[k] && square.is_finite() {
                true => columns[k].dot(&rest).powi(2) / square,
                false => 0.0,
            }
        };
        let best = (0..columns.len())
            .map(|k| (k, gain(k)))
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .filter(|&(_, gain)| gain > WORTH_A_TERM * total);
        let Some((best, _)) = best else { break };
        let direction = columns[best].normalize();
        rest.axpy(-direction.dot(&rest), &direction, 1.0);
        for column in &mut columns {
            let along = direction.dot(column);
            column.axpy(-along, &direction, 1.0);
        }
        chosen.push(best);
    }
    let share = 1.0 - rest.norm_squared() / total;
    if chosen.is_empty() || share < FITS {
        return None;
    }
    let matrix = DMatrix::from_fn(n, chosen.len() + 1, |row, k| match k {
        0 => 1.0,
        k => functions[chosen[k - 1]].value(states[row]),
    });
    let solved = matrix
        .svd(true, true)
        .solve(&DVector::from_column_slice(values), 1e-12)
        .ok()?;
    let constant = Term {
        function: "1".to_owned(),
        coefficient: solved[0],
    };
    let mut terms: Vec<Term> = chosen
        .iter()
        .zip(solved.iter().skip(1))
        .map(|(&k, &coefficient)| Term {
            function: functions[k].name.clone(),
            coefficient,
        })
        .collect();
    if constant.coefficient.powi(2) * n as f64 > WORTH_A_TERM * squares(values) {
        terms.push(constant);
    }
    Some(Formula {
        text: text(&terms),
        terms,
        share,
    })
}

fn text(terms: &[Term]) -> String {
    let mut text = String::new();
    for term in terms {
        let sign = match (term.coefficient < 0.0, text.is_empty()) {
            (true, true) => "-",
            (false, true) => "",
            (true, false) => " - ",
            (false, false) => " + ",
        };
        text += &format!("{sign}{}", number(term.coefficient.abs()));
        if term.function != "1" {
            text += &format!(" {}", term.function);
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bins::pseudo;
    use crate::learnt::{Feature, Quantity};

    fn functions() -> Vec<Function> {
        let feature = |quantity, range| Feature {
            quantity,
            offset: 0.0,
            width: 1.0,
            range,
        };
        let features = [
            feature(Quantity::Position(0), [-0.4, 0.4]),
            feature(Quantity::Velocity(0), [-1.0, 1.0]),
        ];
        dictionary(&features, &["q.cart", "v.cart"], &[])
    }

    fn states() -> Vec<Vec<f64>> {
        (0..3000)
            .map(|k| vec![0.4 * pseudo(k, 0.2), pseudo(k, 0.7)])
            .collect()
    }

    fn found(law: fn(f64, f64) -> f64) -> Option<Formula> {
        let states = states();
        let values: Vec<f64> = states.iter().map(|x| law(x[0], x[1])).collect();
        let states: Vec<&[f64]> = states.iter().map(Vec::as_slice).collect();
        formula(&values, &states, &functions())
    }

    #[test]
    fn drag_and_a_spring_are_told_by_their_formula() {
        let formula = found(|q, v| -1.5 * v * v.abs() - 8.0 * q + 0.5).unwrap();
        assert!(formula.share > 0.999_999);
        let of = |name: &str| {
            let term = formula.terms.iter().find(|t| t.function == name);
            term.unwrap_or_else(|| panic!("{}", formula.text))
                .coefficient
        };
        assert!(
            (of("v.cart·|v.cart|") + 1.5).abs() < 1e-9,
            "{}",
            formula.text
        );
        assert!((of("q.cart") + 8.0).abs() < 1e-9);
        assert!((of("1") - 0.5).abs() < 1e-9);
        assert_eq!(formula.terms.len(), 3);
    }

    #[test]
    fn friction_that_grows_along_the_rail_is_a_product() {
        let formula = found(|q, v| -(0.3 + 0.5 * q) * (v / 0.01).tanh()).unwrap();
        let names: Vec<&str> = formula.terms.iter().map(|t| t.function.as_str()).collect();
        assert!(names.contains(&"tanh(v.cart/0.01)"), "{}", formula.text);
        assert!(
            names.contains(&"q.cart·tanh(v.cart/0.01)"),
            "{}",
            formula.text
        );
    }

    #[test]
    fn what_is_no_usual_law_gets_no_formula() {
        assert_eq!(found(|q, v| (40.0 * q).sin() * (17.0 * v).cos()), None);
        assert_eq!(found(|_, _| 2.0), None);
    }

    #[test]
    fn a_force_that_turns_with_the_sign_is_odd() {
        let pairs: Vec<(f64, f64)> = (0..100)
            .map(|k| pseudo(k, 0.1))
            .map(|v| (v.powi(3) + 1.0, -v.powi(3) + 1.0))
            .collect();
        assert!(odd_share(&pairs).unwrap() > 0.999);
        let even: Vec<(f64, f64)> = pairs.iter().map(|(a, _)| (*a, *a)).collect();
        assert!(odd_share(&even).unwrap() < 0.001);
        assert_eq!(odd_share(&pairs[..3]), None);
    }
}
