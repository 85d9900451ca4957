//! A formula as it is written: sums of products of powers.

use crate::expression::Function;

/// A name in a formula.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Symbol {
    Parameter(usize),
    Coordinate(usize),
    Velocity(usize),
    /// A subexpression that has a name, by its number in the order of definition.
    Named(usize),
}

/// A formula. Sums and products are flat: no sum stands directly in a sum, no product in a product.
#[derive(Debug, Clone, PartialEq)]
pub enum Form {
    Number(f64),
    Symbol(Symbol),
    Sum(Vec<Form>),
    Product(Product),
    /// To an integer power other than 0 and 1.
    Power(Box<Form>, i32),
    Call(Function, Vec<Form>),
}

/// coefficient · over / under.
#[derive(Debug, Clone, PartialEq)]
pub struct Product {
    pub coefficient: f64,
    pub over: Vec<Form>,
    pub under: Vec<Form>,
}

impl Form {
    /// Whether it is the number 0.
    pub fn is_zero(&self) -> bool {
        matches!(self, Form::Number(x) if *x == 0.0)
    }

    /// The sum of `terms`.
    pub fn sum(terms: impl IntoIterator<Item = Form>) -> Form {
        let mut flat = Vec::new();
        for term in terms {
            match term {
                Form::Sum(inner) => flat.extend(inner),
                zero if zero.is_zero() => {}
                other => flat.push(other),
            }
        }
        match flat.len() {
            0 => Form::Number(0.0),
            1 => flat.swap_remove(0),
            _ => Form::Sum(flat),
        }
    }

    /// The product of a number and `factors`; equal factors become a power.
    pub fn product(coefficient: f64, factors: impl IntoIterator<Item = Form>) -> Form {
        let mut product = Product {
            coefficient,
            over: Vec::new(),
            under: Vec::new(),
        };
        for factor in factors {
            match factor {
                Form::Number(x) => product.coefficient *= x,
                Form::Product(inner) => {
                    product.coefficient *= inner.coefficient;
                    inner
                        .over
                        .into_iter()
                        .for_each(|f| join(&mut product.over, f));
                    inner
                        .under
                        .into_iter()
                        .for_each(|f| join(&mut product.under, f));
                }
                Form::Power(base, n) if n < 0 => join(&mut product.under, Form::power(*base, -n)),
                other => join(&mut product.over, other),
            }
        }
        if product.coefficient == 0.0 || (product.over.is_empty() && product.under.is_empty()) {
            return Form::Number(product.coefficient);
        }
        if product.coefficient == 1.0 && product.under.is_empty() && product.over.len() == 1 {
            return product.over.swap_remove(0);
        }
        Form::Product(product)
    }

    /// a / b.
    pub fn quotient(a: Form, b: Form) -> Form {
        let inverse = match b {
            Form::Number(x) => Form::Number(1.0 / x),
            Form::Product(b) => Form::Product(Product {
                coefficient: 1.0 / b.coefficient,
                over: b.under,
                under: b.over,
            }),
            Form::Power(base, n) => Form::Power(base, -n),
            other => Form::Power(Box::new(other), -1),
        };
        Form::product(1.0, [a, inverse])
    }

    /// baseⁿ.
    pub fn power(base: Form, n: i32) -> Form {
        match (base, n) {
            (_, 0) => Form::Number(1.0),
            (base, 1) => base,
            (Form::Number(x), n) => Form::Number(x.powi(n)),
            (Form::Power(base, m), n) => Form::power(*base, m * n),
            (base, n) => Form::Power(Box::new(base), n),
        }
    }

    /// The formula and whether it is to be subtracted: a negative number or coefficient loses its sign.
    pub fn unsigned(&self) -> (bool, Form) {
        match self {
            Form::Number(x) if *x < 0.0 => (true, Form::Number(-x)),
            Form::Product(p) if p.coefficient < 0.0 => {
                let positive = Form::Product(Product {
                    coefficient: -p.coefficient,
                    ..p.clone()
                });
                (true, Form::product(1.0, [positive]))
            }
            other => (false, other.clone()),
        }
    }

    /// Roughly the number of characters it takes.
    pub fn width(&self) -> usize {
        let all = |forms: &[Form]| forms.iter().map(|f| f.width() + 3).sum::<usize>();
        match self {
            Form::Number(x) => format!("{x:?}").len(),
            Form::Symbol(_) => 5,
            Form::Sum(terms) => all(terms),
            Form::Product(p) => {
                let number = if p.coefficient.abs() == 1.0 {
                    1
                } else {
                    Form::Number(p.coefficient).width() + 3
                };
                number + all(&p.over) + all(&p.under) + 2
            }
            Form::Power(base, _) => base.width() + 8,
            Form::Call(_, arguments) => 5 + all(arguments),
        }
    }

    /// Calls `visit` with this formula and every part of it, parts first.
    pub fn visit(&self, visit: &mut impl FnMut(&Form)) {
        match self {
            Form::Number(_) | Form::Symbol(_) => {}
            Form::Sum(parts) | Form::Call(_, parts) => parts.iter().for_each(|p| p.visit(visit)),
            Form::Product(p) => p.over.iter().chain(&p.under).for_each(|p| p.visit(visit)),
            Form::Power(base, _) => base.visit(visit),
        }
        visit(self);
    }

    /// The same formula with `replacement` in place of every part that equals `part`.
    pub fn replace(&self, part: &Form, replacement: &Form) -> Form {
        if self == part {
            return replacement.clone();
        }
        let all = |forms: &[Form]| -> Vec<Form> {
            forms.iter().map(|f| f.replace(part, replacement)).collect()
        };
        match self {
            Form::Number(_) | Form::Symbol(_) => self.clone(),
            Form::Sum(terms) => Form::Sum(all(terms)),
            Form::Product(p) => Form::Product(Product {
                coefficient: p.coefficient,
                over: all(&p.over),
                under: all(&p.under),
            }),
            Form::Power(base, n) => Form::Power(Box::new(base.replace(part, replacement)), *n),
            Form::Call(f, arguments) => Form::Call(*f, all(arguments)),
        }
    }
}

/// Adds `factor` to `factors`, to the power of an equal one where there is one.
fn join(factors: &mut Vec<Form>, factor: Form) {
    let (base, n) = match factor {
        Form::Power(base, n) => (*base, n),
        other => (other, 1),
    };
    for known in factors.iter_mut() {
        let (same, m) = match &*known {
            Form::Power(known, m) => (**known == base, *m),
            other => (*other == base, 1),
        };
        if same {
            *known = Form::power(base, m + n);
            return;
        }
    }
    factors.push(Form::power(base, n));
}
