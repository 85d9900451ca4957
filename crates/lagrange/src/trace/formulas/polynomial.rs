//! Expressions as sums of monomials: the normal form in which equal terms meet.

use std::collections::{BTreeMap, HashMap};
use std::rc::Rc;

use crate::expression::{Binary, Unary};
use crate::trace::derivative::{TooLarge, mark_arguments};
use crate::trace::graph::{Graph, Id, Node};

/// What monomials are made of, by its number in the [`Algebra`].
pub type Atom = u32;

/// A product of powers: atoms in ascending order, no exponent 0.
#[derive(Debug, Clone, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Monomial(pub Vec<(Atom, i32)>);

/// A number, and how large the numbers were that it is the sum of: what is below the rounding of these is no term.
#[derive(Debug, Clone, Copy)]
pub struct Coefficient {
    pub value: f64,
    size: f64,
}

/// Units in the last place by which a sum may miss 0 and still be 0.
const ROUNDING: f64 = 8.0 * f64::EPSILON;

impl Coefficient {
    pub fn new(value: f64) -> Self {
        Coefficient {
            value,
            size: value.abs(),
        }
    }

    pub fn is_rounding(self) -> bool {
        self.value.abs() <= ROUNDING * self.size
    }

    pub fn add(self, other: Coefficient) -> Coefficient {
        Coefficient {
            value: self.value + other.value,
            size: self.size + other.size,
        }
    }

    pub fn times(self, other: Coefficient) -> Coefficient {
        Coefficient {
            value: self.value * other.value,
            size: self.size * other.size,
        }
    }

    pub fn negated(self) -> Coefficient {
        Coefficient {
            value: -self.value,
            ..self
        }
    }

    /// Whether the two are one number but for rounding.
    pub fn equals(self, other: Coefficient) -> bool {
        self.add(other.negated()).is_rounding()
    }
}

/// A sum of monomials with coefficients other than 0.
#[derive(Debug, Clone, Default)]
pub struct Polynomial(pub BTreeMap<Monomial, Coefficient>);

/// A polynomial that can be looked up.
type Key = Vec<(Monomial, u64)>;

/// What an atom is.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub enum Kind {
    Variable(u32),
    One(Unary, Key),
    Two(Binary, Key, Key),
    /// A sum that something is divided by.
    Sum(Key),
}

impl Monomial {
    pub fn exponent(&self, atom: Atom) -> i32 {
        self.0
            .iter()
            .find(|(a, _)| *a == atom)
            .map_or(0, |&(_, n)| n)
    }

    /// The product with atomⁿ.
    pub fn times_power(&self, atom: Atom, n: i32) -> Monomial {
        self.times(&Monomial(vec![(atom, n)]))
    }

    pub fn times(&self, other: &Monomial) -> Monomial {
        let mut product = Vec::with_capacity(self.0.len() + other.0.len());
        let (mut a, mut b) = (self.0.iter().peekable(), other.0.iter().peekable());
        loop {
            let next = match (a.peek(), b.peek()) {
                (Some(x), Some(y)) if x.0 == y.0 => {
                    let power = (x.0, x.1 + y.1);
                    a.next();
                    b.next();
                    power
                }
                (Some(x), Some(y)) if x.0 < y.0 => {
                    let power = **x;
                    a.next();
                    power
                }
                (Some(x), None) => {
                    let power = **x;
                    a.next();
                    power
                }
                (_, Some(y)) => {
                    let power = **y;
                    b.next();
                    power
                }
                (None, None) => return Monomial(product),
            };
            if next.1 != 0 {
                product.push(next);
            }
        }
    }
}

impl Polynomial {
    pub fn constant(x: f64) -> Self {
        Polynomial::term(Monomial::default(), Coefficient::new(x))
    }

    pub fn term(monomial: Monomial, coefficient: Coefficient) -> Self {
        let mut sum = Polynomial::default();
        sum.add_term(monomial, coefficient);
        sum
    }

    /// Adds a term; terms that cancel but for rounding go.
    pub fn add_term(&mut self, monomial: Monomial, coefficient: Coefficient) {
        if coefficient.value == 0.0 {
            return;
        }
        match self.0.entry(monomial) {
            std::collections::btree_map::Entry::Vacant(place) => {
                place.insert(coefficient);
            }
            std::collections::btree_map::Entry::Occupied(mut place) => {
                let sum = place.get().add(coefficient);
                if sum.is_rounding() {
                    place.remove();
                } else {
                    place.insert(sum);
                }
            }
        }
    }

    pub fn plus(&self, other: &Polynomial, sign: f64) -> Polynomial {
        let mut sum = self.clone();
        for (monomial, coefficient) in &other.0 {
            let signed = coefficient.times(Coefficient::new(sign));
            sum.add_term(monomial.clone(), signed);
        }
        sum
    }

    fn scaled(&self, factor: f64) -> Polynomial {
        Polynomial::default().plus(self, factor)
    }

    fn key(&self) -> Key {
        let term = |(m, c): (&Monomial, &Coefficient)| (m.clone(), c.value.to_bits());
        self.0.iter().map(term).collect()
    }

    pub fn from_key(key: &Key) -> Polynomial {
        let term =
            |(m, bits): &(Monomial, u64)| (m.clone(), Coefficient::new(f64::from_bits(*bits)));
        Polynomial(key.iter().map(term).collect())
    }

    /// The constant it is, if it is one.
    fn value(&self) -> Option<f64> {
        let mut terms = self.0.iter();
        match (terms.next(), terms.next()) {
            (None, _) => Some(0.0),
            (Some((m, c)), None) if m.0.is_empty() => Some(c.value),
            _ => None,
        }
    }
}

/// The atoms of some polynomials.
#[derive(Debug)]
pub struct Algebra {
    kinds: Vec<Kind>,
    known: HashMap<Kind, Atom>,
    /// Most terms of a polynomial.
    limit: usize,
}

impl Algebra {
    /// The first atoms are the variables, in this order.
    pub fn new(variables: usize, limit: usize) -> Self {
        let mut algebra = Algebra {
            kinds: Vec::new(),
            known: HashMap::new(),
            limit,
        };
        for variable in 0..variables {
            algebra.atom(Kind::Variable(variable as u32));
        }
        algebra
    }

    pub fn kind(&self, atom: Atom) -> &Kind {
        &self.kinds[atom as usize]
    }

    pub fn atoms(&self) -> impl Iterator<Item = (Atom, &Kind)> {
        (0..).zip(&self.kinds)
    }

    fn atom(&mut self, kind: Kind) -> Atom {
        if let Some(&atom) = self.known.get(&kind) {
            return atom;
        }
        let atom = self.kinds.len() as Atom;
        self.kinds.push(kind.clone());
        self.known.insert(kind, atom);
        atom
    }

    /// The graph's `roots` as polynomials.
    pub fn expand(&mut self, graph: &Graph, roots: &[Id]) -> Result<Vec<Polynomial>, TooLarge> {
        let mut needed = vec![false; roots.iter().max().map_or(0, |&id| id as usize + 1)];
        roots.iter().for_each(|&root| needed[root as usize] = true);
        mark_arguments(graph, &mut needed);
        let mut done: Vec<Rc<Polynomial>> = Vec::with_capacity(needed.len());
        for (id, needed) in needed.iter().enumerate() {
            let polynomial = match needed {
                true => self.node(graph.node(id as Id), &done)?,
                false => Rc::default(),
            };
            done.push(polynomial);
        }
        Ok(roots.iter().map(|&r| (*done[r as usize]).clone()).collect())
    }

    fn node(&mut self, node: Node, done: &[Rc<Polynomial>]) -> Result<Rc<Polynomial>, TooLarge> {
        let of = |id: Id| done[id as usize].clone();
        let polynomial = match node {
            Node::Constant(bits) => Polynomial::constant(f64::from_bits(bits)),
            Node::Variable(index) => self.power(Kind::Variable(index), 1),
            Node::Add(a, b) => self.reduced(of(a).plus(&of(b), 1.0)),
            Node::Subtract(a, b) => self.reduced(of(a).plus(&of(b), -1.0)),
            Node::Negate(a) => of(a).scaled(-1.0),
            Node::Multiply(a, b) => self.multiply(&of(a), &of(b))?,
            Node::Divide(a, b) => {
                let inverse = self.powi(&of(b), -1)?;
                self.multiply(&of(a), &inverse)?
            }
            Node::Powi(a, n) => self.powi(&of(a), n)?,
            Node::One(f, a) => self.one(f, &of(a)),
            Node::Two(Binary::Pow, a, b) => self.pow(&of(a), &of(b))?,
            Node::Two(f, a, b) => self.power(Kind::Two(f, of(a).key(), of(b).key()), 1),
        };
        if polynomial.0.len() > self.limit || self.kinds.len() > self.limit {
            return Err(TooLarge);
        }
        Ok(Rc::new(polynomial))
    }

    fn power(&mut self, kind: Kind, n: i32) -> Polynomial {
        let atom = self.atom(kind);
        Polynomial::term(Monomial(vec![(atom, n)]), Coefficient::new(1.0))
    }

    fn multiply(&mut self, a: &Polynomial, b: &Polynomial) -> Result<Polynomial, TooLarge> {
        if a.0.len() * b.0.len() > 16 * self.limit {
            return Err(TooLarge);
        }
        let mut product = Polynomial::default();
        for (m, c) in &a.0 {
            for (n, d) in &b.0 {
                let (monomial, coefficient) = (m.times(n), c.times(*d));
                match self.opened(&monomial) {
                    None => product.add_term(monomial, coefficient),
                    // A root squared, or a denominator that a factor cancels.
                    Some((rest, inside, power)) => {
                        let inside = self.powi(&inside, power)?;
                        let rest = Polynomial::term(rest, coefficient);
                        product = product.plus(&self.multiply(&rest, &inside)?, 1.0);
                    }
                }
            }
        }
        Ok(self.reduced(product))
    }

    /// A monomial with √x to a power beyond ±1, or a sum to a positive power, as (the rest, x, its power).
    fn opened(&self, monomial: &Monomial) -> Option<(Monomial, Polynomial, i32)> {
        monomial
            .0
            .iter()
            .find_map(|&(atom, n)| match self.kind(atom) {
                Kind::One(Unary::Sqrt, key) if n.abs() >= 2 => {
                    let rest = monomial.times_power(atom, -(n / 2) * 2);
                    Some((rest, Polynomial::from_key(key), n / 2))
                }
                Kind::Sum(key) if n > 0 => {
                    let rest = monomial.times_power(atom, -n);
                    Some((rest, Polynomial::from_key(key), n))
                }
                _ => None,
            })
    }

    fn powi(&mut self, base: &Polynomial, n: i32) -> Result<Polynomial, TooLarge> {
        if n >= 0 {
            let mut product = Polynomial::constant(1.0);
            for _ in 0..n {
                product = self.multiply(&product, base)?;
            }
            return Ok(product);
        }
        let mut terms = base.0.iter();
        match (terms.next(), terms.next()) {
            // 1/0 is no polynomial.
            (None, _) => Err(TooLarge),
            (Some((monomial, c)), None) => {
                let inverse = Monomial(monomial.0.iter().map(|&(a, m)| (a, m * n)).collect());
                let coefficient = Coefficient::new(c.value.powi(n));
                let inverse = Polynomial::term(inverse, coefficient);
                self.multiply(&inverse, &Polynomial::constant(1.0))
            }
            _ => {
                // The common factors of a sum and its sign are no part of the atom: x y + x z = x (y + z).
                let (content, factor, sum) = primitive(base);
                let outside = Monomial(content.0.iter().map(|&(a, m)| (a, m * n)).collect());
                let outside = Polynomial::term(outside, Coefficient::new(factor.powi(n)));
                let inside = self.power(Kind::Sum(sum.key()), n);
                self.multiply(&outside, &inside)
            }
        }
    }

    fn one(&mut self, f: Unary, x: &Polynomial) -> Polynomial {
        if let Some(x) = x.value() {
            return Polynomial::constant(f.of(x));
        }
        let negative = x.0.values().next().is_some_and(|c| c.value < 0.0);
        match f {
            Unary::Sin | Unary::Tan | Unary::Asin | Unary::Atan | Unary::Sinh | Unary::Tanh
                if negative =>
            {
                self.power(Kind::One(f, x.scaled(-1.0).key()), 1)
                    .scaled(-1.0)
            }
            Unary::Cos | Unary::Cosh | Unary::Abs if negative => {
                self.power(Kind::One(f, x.scaled(-1.0).key()), 1)
            }
            _ => self.power(Kind::One(f, x.key()), 1),
        }
    }

    /// sin or cos of a polynomial.
    pub fn circular(&mut self, f: Unary, x: &Polynomial) -> Polynomial {
        self.one(f, x)
    }

    fn pow(&mut self, base: &Polynomial, exponent: &Polynomial) -> Result<Polynomial, TooLarge> {
        if let Some(n) = exponent.value() {
            if n.fract() == 0.0 && n.abs() <= 16.0 {
                return self.powi(base, n as i32);
            }
            if (n - 0.5).fract() == 0.0 && n.abs() <= 8.0 {
                // x^(k/2) = √xᵏ
                let root = self.one(Unary::Sqrt, base);
                return self.powi(&root, (2.0 * n) as i32);
            }
        }
        Ok(self.power(Kind::Two(Binary::Pow, base.key(), exponent.key()), 1))
    }

    /// The sine and the cosine of one argument, for all arguments that have both.
    pub fn angles(&self) -> Vec<(Atom, Atom)> {
        let angle = |(sine, kind): (Atom, &Kind)| match kind {
            Kind::One(Unary::Sin, x) => {
                let cosine = self.known.get(&Kind::One(Unary::Cos, x.clone()))?;
                Some((sine, *cosine))
            }
            _ => None,
        };
        self.atoms().filter_map(angle).collect()
    }

    fn reduced(&self, polynomial: Polynomial) -> Polynomial {
        super::simplify::pythagoras(self, polynomial)
    }
}

/// A sum as (monomial, number, rest), multiplied the sum, with the rest free of common factors and its first term positive. The
/// number is other than ±1 where all coefficients are equal but for sign.
pub fn primitive(sum: &Polynomial) -> (Monomial, f64, Polynomial) {
    let mut content: Option<Vec<(Atom, i32)>> = None;
    for monomial in sum.0.keys() {
        content = Some(match content {
            None => monomial.0.clone(),
            Some(common) => {
                let mut both: Vec<(Atom, i32)> = Vec::new();
                for &(atom, n) in &common {
                    both.push((atom, n.min(monomial.exponent(atom))));
                }
                for &(atom, m) in &monomial.0 {
                    if !common.iter().any(|(a, _)| *a == atom) {
                        both.push((atom, m.min(0)));
                    }
                }
                both.retain(|(_, n)| *n != 0);
                both.sort_unstable();
                both
            }
        });
    }
    let content = Monomial(content.unwrap_or_default());
    let first = sum.0.values().next().map_or(1.0, |c| c.value);
    let even = sum.0.values().all(|c| {
        let size = Coefficient::new(c.value.abs());
        size.equals(Coefficient::new(first.abs()))
    });
    let factor = if even { first } else { first.signum() };
    let inverse = Monomial(content.0.iter().map(|&(a, n)| (a, -n)).collect());
    let rest = |(m, c): (&Monomial, &Coefficient)| {
        let value = if even {
            c.value.signum() * first.signum()
        } else {
            c.value * factor
        };
        (m.times(&inverse), Coefficient::new(value))
    };
    let rest = Polynomial(sum.0.iter().map(rest).collect());
    (content, factor, rest)
}
