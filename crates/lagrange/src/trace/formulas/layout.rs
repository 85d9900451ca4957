//! Polynomials as they are written: common factors before, equal motions together, in the order of a textbook.

use super::form::{Form, Symbol};
use super::polynomial::{Algebra, Atom, Coefficient, Kind, Monomial, Polynomial, primitive};
use super::simplify::tidied;
use crate::expression::{Function, Unary};

/// Lays out the polynomials of one algebra whose variables are q, v and the parameters, in this order.
pub struct Layout<'a> {
    pub algebra: &'a Algebra,
    pub sizes: Sizes,
}

/// How many entries q and v have; the variables are q, v and the parameters, in this order.
#[derive(Debug, Clone, Copy)]
pub struct Sizes {
    pub nq: usize,
    pub nv: usize,
}

impl Sizes {
    /// The name of the variable with this index.
    pub fn symbol(self, index: u32) -> Symbol {
        let index = index as usize;
        if index < self.nq {
            Symbol::Coordinate(index)
        } else if index < self.nq + self.nv {
            Symbol::Velocity(index - self.nq)
        } else {
            Symbol::Parameter(index - self.nq - self.nv)
        }
    }
}

/// Where a factor stands in a product.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
enum Rank {
    /// A sum of constants.
    Bracket,
    Parameter(u32),
    Constant(Atom),
    Coordinate(u32),
    /// By its argument, then by its name.
    Function(Vec<(Monomial, u64)>, &'static str),
    Other(Atom),
    Velocity(u32),
}

impl Layout<'_> {
    /// The formula.
    pub fn form(&self, polynomial: &Polynomial) -> Form {
        if polynomial.0.len() < 2 {
            return Form::sum(polynomial.0.iter().map(|(m, c)| self.term(m, c.value)));
        }
        let (content, mut factor, mut rest) = primitive(polynomial);
        if content.0.is_empty() && factor.abs() == 1.0 {
            return self.grouped(polynomial);
        }
        // The first term in the bracket is positive.
        let terms = self.sorted(&rest);
        if terms.first().is_some_and(|(_, c)| *c < 0.0) {
            factor = -factor;
            rest.0.values_mut().for_each(|c| *c = c.negated());
        }
        let inner = self.grouped(&rest);
        let place = self.rank_of_sum(&rest);
        let mut factors: Vec<(Rank, Form)> = self.factors(&content);
        let at = factors.partition_point(|(rank, _)| *rank <= place);
        factors.insert(at, (place, inner));
        Form::product(factor, factors.into_iter().map(|(_, form)| form))
    }

    /// A bracket of constants stands before the constants, another one behind what it is of the kind of.
    fn rank_of_sum(&self, sum: &Polynomial) -> Rank {
        let atoms = sum.0.keys().flat_map(|m| &m.0);
        let ranks = atoms.map(|&(atom, _)| self.rank(atom));
        match ranks.max() {
            Some(Rank::Velocity(_)) => Rank::Velocity(u32::MAX),
            Some(Rank::Parameter(_) | Rank::Constant(_)) | None => Rank::Bracket,
            Some(_) => Rank::Other(Atom::MAX),
        }
    }

    /// The sum, with the terms that differ in constants alone taken together.
    fn grouped(&self, sum: &Polynomial) -> Form {
        let mut groups: Vec<(Monomial, Vec<(Monomial, f64)>)> = Vec::new();
        for (monomial, c) in self.sorted(sum) {
            let is_state = |&&(atom, _): &&(Atom, i32)| self.moves(atom);
            let state = Monomial(monomial.0.iter().filter(is_state).copied().collect());
            let constant = Monomial(
                monomial
                    .0
                    .iter()
                    .filter(|p| !is_state(p))
                    .copied()
                    .collect(),
            );
            let known = groups.iter_mut().find(|(s, _)| *s == state);
            match known.filter(|_| !state.0.is_empty()) {
                Some((_, constants)) => constants.push((constant, c)),
                None => groups.push((state, vec![(constant, c)])),
            }
        }
        let mut forms: Vec<Form> = Vec::with_capacity(groups.len());
        for (state, constants) in groups {
            if let [(constant, c)] = constants.as_slice() {
                forms.push(self.term(&constant.times(&state), *c));
                continue;
            }
            // −a − b = −(a + b)
            let sign = if constants.iter().all(|(_, c)| *c < 0.0) {
                -1.0
            } else {
                1.0
            };
            let mut bracket = Polynomial::default();
            for (m, c) in &constants {
                bracket.add_term(m.clone(), Coefficient::new(sign * c));
            }
            let state = self.factors(&state).into_iter().map(|(_, form)| form);
            forms.push(Form::product(
                sign,
                std::iter::once(self.form(&bracket)).chain(state),
            ));
        }
        // A sum begins with a positive term where it has one.
        if let Some(first) = forms.iter().position(|f| !f.unsigned().0) {
            let first = forms.remove(first);
            forms.insert(0, first);
        }
        Form::sum(forms)
    }

    /// The terms: fewer velocities first, then fewer functions of the state, then by parameters.
    fn sorted(&self, sum: &Polynomial) -> Vec<(Monomial, f64)> {
        let key = |monomial: &Monomial| {
            let mut ranks: Vec<(Rank, i32)> = monomial
                .0
                .iter()
                .map(|&(atom, n)| (self.rank(atom), -n))
                .collect();
            ranks.sort();
            let degree = |of: &dyn Fn(&Rank) -> bool| -> i32 {
                ranks
                    .iter()
                    .filter(|(rank, _)| of(rank))
                    .map(|(_, n)| n.abs())
                    .sum()
            };
            let velocities = degree(&|rank| matches!(rank, Rank::Velocity(_)));
            let state = degree(&|rank| {
                !matches!(rank, Rank::Bracket | Rank::Parameter(_) | Rank::Constant(_))
            });
            (velocities, state, ranks)
        };
        let mut terms: Vec<(Monomial, f64)> =
            sum.0.iter().map(|(m, c)| (m.clone(), c.value)).collect();
        terms.sort_by_cached_key(|(monomial, _)| key(monomial));
        terms
    }

    fn term(&self, monomial: &Monomial, coefficient: f64) -> Form {
        let factors = self.factors(monomial);
        Form::product(coefficient, factors.into_iter().map(|(_, form)| form))
    }

    fn factors(&self, monomial: &Monomial) -> Vec<(Rank, Form)> {
        let factor = |&(atom, n): &(Atom, i32)| (self.rank(atom), Form::power(self.atom(atom), n));
        let mut factors: Vec<(Rank, Form)> = monomial.0.iter().map(factor).collect();
        factors.sort_by(|a, b| a.0.cmp(&b.0));
        factors
    }

    fn atom(&self, atom: Atom) -> Form {
        let of = |key: &Vec<_>| self.form(&tidied(Polynomial::from_key(key)));
        match self.algebra.kind(atom) {
            Kind::Variable(index) => Form::Symbol(self.sizes.symbol(*index)),
            Kind::One(f, x) => Form::Call(Function::One(*f), vec![of(x)]),
            Kind::Two(f, a, b) => Form::Call(Function::Two(*f), vec![of(a), of(b)]),
            Kind::Sum(key) => of(key),
        }
    }

    /// Whether it depends on q or v.
    fn moves(&self, atom: Atom) -> bool {
        let any = |key: &Vec<(Monomial, u64)>| {
            key.iter()
                .flat_map(|(m, _)| &m.0)
                .any(|&(a, _)| self.moves(a))
        };
        match self.algebra.kind(atom) {
            Kind::Variable(index) => (*index as usize) < self.sizes.nq + self.sizes.nv,
            Kind::One(_, x) | Kind::Sum(x) => any(x),
            Kind::Two(_, a, b) => any(a) || any(b),
        }
    }

    fn rank(&self, atom: Atom) -> Rank {
        match self.algebra.kind(atom) {
            Kind::Variable(index) => match self.sizes.symbol(*index) {
                Symbol::Coordinate(_) => Rank::Coordinate(*index),
                Symbol::Velocity(_) => Rank::Velocity(*index),
                _ => Rank::Parameter(*index),
            },
            _ if !self.moves(atom) => Rank::Constant(atom),
            Kind::One(f @ (Unary::Sin | Unary::Cos), x) => {
                Rank::Function(x.clone(), Function::One(*f).name())
            }
            _ => Rank::Other(atom),
        }
    }
}
