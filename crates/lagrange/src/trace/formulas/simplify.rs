//! Identities of sine and cosine.

use crate::expression::Unary;

use super::polynomial::{Algebra, Atom, Coefficient, Kind, Monomial, Polynomial};

/// sin² + cos² = 1 wherever both stand with the same factor, and 1 − sin² = cos², 1 − cos² = sin².
pub fn pythagoras(algebra: &Algebra, mut polynomial: Polynomial) -> Polynomial {
    if polynomial.0.len() < 2 {
        return polynomial;
    }
    let angles = algebra.angles();
    while angles
        .iter()
        .any(|&angle| pythagoras_once(&mut polynomial, angle))
    {}
    polynomial
}

/// One application; whether there was one. Every one lowers the number of terms, or at the same number the degree.
fn pythagoras_once(polynomial: &mut Polynomial, (sine, cosine): (Atom, Atom)) -> bool {
    let squares: Vec<(Monomial, Coefficient, Atom, Atom)> = polynomial
        .0
        .iter()
        .flat_map(|(m, &c)| {
            [(sine, cosine), (cosine, sine)]
                .into_iter()
                .filter(|&(square, _)| m.exponent(square) >= 2)
                .map(move |(square, other)| (m.clone(), c, square, other))
        })
        .collect();
    for (monomial, c, square, other) in squares {
        let rest = monomial.times_power(square, -2);
        let partner = rest.times_power(other, 2);
        if let Some(&d) = polynomial.0.get(&partner) {
            // c s² + c c² = c; of unequal ones the smaller part, where it meets a term that is there.
            let smaller = c.value * d.value > 0.0 && c.value.abs() < d.value.abs();
            if c.equals(d) || (smaller && polynomial.0.contains_key(&rest)) {
                polynomial.0.remove(&monomial);
                if c.equals(d) {
                    polynomial.0.remove(&partner);
                } else {
                    polynomial.add_term(partner, c.negated());
                }
                polynomial.add_term(rest, c);
                return true;
            }
        }
        // c s² − c = −c c²
        if polynomial
            .0
            .get(&rest)
            .is_some_and(|d| d.negated().equals(c))
        {
            polynomial.0.remove(&monomial);
            polynomial.0.remove(&rest);
            polynomial.add_term(partner, c.negated());
            return true;
        }
    }
    false
}

/// The shortest of the forms that the identities give; 0 wherever they make it 0.
pub fn simplest(algebra: &mut Algebra, polynomial: &Polynomial) -> Polynomial {
    let mut best = contracted(algebra, pythagoras(algebra, polynomial.clone()));
    for (sine, cosine) in algebra.angles() {
        for (from, to) in [(sine, cosine), (cosine, sine)] {
            let other = pythagoras(algebra, without_squares(&best, from, to));
            let other = contracted(algebra, other);
            if cost(&other) < cost(&best) {
                best = other;
            }
        }
    }
    without_noise(algebra, best)
}

/// Number of terms, then of factors.
fn cost(polynomial: &Polynomial) -> (usize, i32) {
    let factors = polynomial.0.keys().flat_map(|m| &m.0);
    (polynomial.0.len(), factors.map(|(_, n)| n.abs()).sum())
}

/// `from`² = 1 − `to`², as often as it goes.
fn without_squares(polynomial: &Polynomial, from: Atom, to: Atom) -> Polynomial {
    let mut open = polynomial.clone();
    loop {
        let square = open.0.iter().find(|(m, _)| m.exponent(from) >= 2);
        let Some((monomial, c)) = square.map(|(m, c)| (m.clone(), *c)) else {
            return open;
        };
        open.0.remove(&monomial);
        let rest = monomial.times_power(from, -2);
        open.add_term(rest.times_power(to, 2), c.negated());
        open.add_term(rest, c);
    }
}

/// cos a cos b ∓ sin a sin b = cos(a ± b) and sin a cos b ± cos a sin b = sin(a ± b), wherever both stand with the same factor.
fn contracted(algebra: &mut Algebra, mut polynomial: Polynomial) -> Polynomial {
    while let Some(shorter) = contracted_once(algebra, &polynomial) {
        polynomial = pythagoras(algebra, shorter);
    }
    polynomial
}

fn contracted_once(algebra: &mut Algebra, polynomial: &Polynomial) -> Option<Polynomial> {
    let angles = algebra.angles();
    for (i, &(sin_a, cos_a)) in angles.iter().enumerate() {
        for &(sin_b, cos_b) in angles.get(i + 1..).unwrap_or(&[]) {
            // The pairs of products, and whether their sum is a cosine.
            let pairs = [
                ((cos_a, cos_b), (sin_a, sin_b), true),
                ((sin_a, cos_b), (cos_a, sin_b), false),
            ];
            for ((x, y), (z, w), is_cosine) in pairs {
                for (monomial, &c) in &polynomial.0 {
                    if monomial.exponent(x) < 1 || monomial.exponent(y) < 1 {
                        continue;
                    }
                    let rest = monomial.times_power(x, -1).times_power(y, -1);
                    let partner = rest.times_power(z, 1).times_power(w, 1);
                    let Some(&d) = polynomial.0.get(&partner) else {
                        continue;
                    };
                    let same = c.equals(d);
                    if !same && !c.equals(d.negated()) {
                        continue;
                    }
                    let (f, plus) = match is_cosine {
                        true => (Unary::Cos, !same),
                        false => (Unary::Sin, same),
                    };
                    let (a, b) = (argument(algebra, sin_a)?, argument(algebra, sin_b)?);
                    let sign = if plus { 1.0 } else { -1.0 };
                    let value = algebra.circular(f, &a.plus(&b, sign));
                    let mut shorter = polynomial.clone();
                    shorter.0.remove(monomial);
                    shorter.0.remove(&partner);
                    for (m, unit) in &value.0 {
                        shorter.add_term(rest.times(m), c.times(*unit));
                    }
                    return Some(shorter);
                }
            }
        }
    }
    None
}

fn argument(algebra: &Algebra, sine: Atom) -> Option<Polynomial> {
    match algebra.kind(sine) {
        Kind::One(_, key) => Some(Polynomial::from_key(key)),
        _ => None,
    }
}

/// Drops the terms that are rounding beside another one: of those that differ in nothing but sines and cosines, which are at most 1,
/// the ones below four units in the last place of the largest.
///
/// Such terms come from rotations by π/2, whose cosine is 6·10⁻¹⁷ in floating point.
fn without_noise(algebra: &Algebra, polynomial: Polynomial) -> Polynomial {
    let bounded = |atom: Atom| matches!(algebra.kind(atom), Kind::One(Unary::Sin | Unary::Cos, _));
    let scale = |m: &Monomial| -> Monomial {
        Monomial(
            m.0.iter()
                .filter(|&&(a, n)| n < 0 || !bounded(a))
                .copied()
                .collect(),
        )
    };
    let mut largest: Vec<(Monomial, f64)> = Vec::new();
    for (m, c) in &polynomial.0 {
        let scale = scale(m);
        match largest.iter_mut().find(|(s, _)| *s == scale) {
            Some((_, size)) => *size = size.max(c.value.abs()),
            None => largest.push((scale, c.value.abs())),
        }
    }
    let kept = polynomial.0.into_iter().filter(|(m, c)| {
        let scale = scale(m);
        let size = largest
            .iter()
            .find(|(s, _)| *s == scale)
            .map_or(0.0, |l| l.1);
        c.value.abs() > 4.0 * f64::EPSILON * size
    });
    tidied(Polynomial(kept.collect()))
}

/// With short numbers in place of long ones that are the same but for rounding.
pub fn tidied(polynomial: Polynomial) -> Polynomial {
    let terms = polynomial.0.into_iter();
    Polynomial(
        terms
            .map(|(m, c)| (m, Coefficient::new(tidy(c.value))))
            .collect(),
    )
}

/// A decimal number of 15 digits in place of one of 16 or 17 that it differs from by no more than four units in the last place, if it
/// is much shorter: 0.00327 for 0.0032700000000000003, which 0.003 · 1.09 is in floating point.
fn tidy(x: f64) -> f64 {
    let short: f64 = format!("{x:.14e}").parse().unwrap_or(x);
    let close = (short - x).abs() <= 4.0 * f64::EPSILON * x.abs();
    let shorter = format!("{short:?}").len() + 3 < format!("{x:?}").len();
    if close && shorter { short } else { x }
}
