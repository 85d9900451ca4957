//! Formulas as text: the notation of [`Expression`](crate::Expression), Rust, C.

use super::form::{Form, Product, Symbol};
use crate::expression::{Binary, Function};

/// How formulas are spelled.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Notation {
    Text,
    Rust,
    C,
}

/// How tightly a formula holds together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Tightness {
    Sum,
    Product,
    Power,
    Whole,
}

/// Writes formulas in one notation; `symbol` spells the names.
pub struct Writer<'a> {
    pub notation: Notation,
    pub symbol: &'a dyn Fn(Symbol) -> String,
}

impl Writer<'_> {
    /// The formula.
    pub fn write(&self, form: &Form) -> String {
        self.written(form).0
    }

    fn times(&self) -> &'static str {
        if self.notation == Notation::Text {
            "*"
        } else {
            " * "
        }
    }

    fn over(&self) -> &'static str {
        if self.notation == Notation::Text {
            "/"
        } else {
            " / "
        }
    }

    fn number(&self, x: f64) -> String {
        match self.notation {
            Notation::Text if x.fract() == 0.0 && x.abs() < 1e15 => format!("{x}"),
            _ => format!("{x:?}"),
        }
    }

    fn written(&self, form: &Form) -> (String, Tightness) {
        match form {
            Form::Number(x) if *x < 0.0 => (format!("-{}", self.number(-x)), Tightness::Sum),
            Form::Number(x) => self.fraction(*x),
            Form::Symbol(symbol) => ((self.symbol)(*symbol), Tightness::Whole),
            Form::Sum(terms) => (self.sum(terms), Tightness::Sum),
            Form::Product(p) if p.coefficient < 0.0 => {
                let (_, positive) = form.unsigned();
                let product = self.at_least(&positive, Tightness::Product);
                (format!("-{product}"), Tightness::Sum)
            }
            Form::Product(p) => (self.product(p), Tightness::Product),
            Form::Power(base, n) => self.power(base, *n),
            Form::Call(function, arguments) => self.call(*function, arguments),
        }
    }

    /// A positive number; in text one with many digits is written as a fraction where it is one.
    fn fraction(&self, x: f64) -> (String, Tightness) {
        match fraction(x).filter(|_| self.notation == Notation::Text) {
            Some((p, q)) => (format!("{p}/{q}"), Tightness::Product),
            None => (self.number(x), Tightness::Whole),
        }
    }

    fn at_least(&self, form: &Form, tightness: Tightness) -> String {
        let (text, own) = self.written(form);
        if own >= tightness {
            text
        } else {
            format!("({text})")
        }
    }

    fn sum(&self, terms: &[Form]) -> String {
        let mut text = String::new();
        for (i, term) in terms.iter().enumerate() {
            let (negative, term) = term.unsigned();
            text.push_str(match (i, negative) {
                (0, false) => "",
                (0, true) => "-",
                (_, false) => " + ",
                (_, true) => " - ",
            });
            text.push_str(&self.at_least(&term, Tightness::Product));
        }
        text
    }

    fn product(&self, product: &Product) -> String {
        let Product {
            coefficient,
            over,
            under,
        } = product;
        let (mut top, mut bottom) = (Vec::new(), Vec::new());
        match fraction(*coefficient).filter(|_| self.notation == Notation::Text) {
            Some((p, q)) => {
                if p != 1 || over.is_empty() {
                    top.push(p.to_string());
                }
                bottom.push(q.to_string());
            }
            None if *coefficient != 1.0 || over.is_empty() => top.push(self.number(*coefficient)),
            None => {}
        }
        // A quotient within a product would be read from the left.
        top.extend(over.iter().map(|f| self.factor(f)));
        bottom.extend(under.iter().map(|f| self.factor(f)));
        let top = top.join(self.times());
        match bottom.len() {
            0 => top,
            1 if under.len() != 1 || self.is_one_factor(&under[0]) => {
                format!("{top}{}{}", self.over(), bottom[0])
            }
            _ => format!("{top}{}({})", self.over(), bottom.join(self.times())),
        }
    }

    /// As a factor of a product: powers may be written as products.
    fn factor(&self, form: &Form) -> String {
        let (text, own) = self.written(form);
        let is_power = matches!(form, Form::Power(..)) && own == Tightness::Product;
        if own >= Tightness::Power || is_power {
            text
        } else {
            format!("({text})")
        }
    }

    /// Whether it is written without a `*` of its own.
    fn is_one_factor(&self, form: &Form) -> bool {
        !matches!(form, Form::Power(..)) || self.written(form).1 >= Tightness::Power
    }

    fn power(&self, base: &Form, n: i32) -> (String, Tightness) {
        if n < 0 {
            let form = Form::Product(Product {
                coefficient: 1.0,
                over: Vec::new(),
                under: vec![Form::power(base.clone(), -n)],
            });
            return self.written(&form);
        }
        match self.notation {
            Notation::Text => {
                let base = self.at_least(base, Tightness::Whole);
                (format!("{base}^{n}"), Tightness::Power)
            }
            // As often as this a product is faster than a call.
            _ if n <= 3 && matches!(base, Form::Symbol(_)) => {
                let base = self.write(base);
                let factors = vec![base.as_str(); n.unsigned_abs() as usize];
                (factors.join(self.times()), Tightness::Product)
            }
            Notation::Rust => {
                let base = self.receiver(base);
                (format!("{base}.powi({n})"), Tightness::Whole)
            }
            Notation::C => (
                format!("pow({}, {n}.0)", self.write(base)),
                Tightness::Whole,
            ),
        }
    }

    /// What a Rust method is called on.
    fn receiver(&self, form: &Form) -> String {
        match form {
            Form::Number(x) if *x >= 0.0 => format!("{x:?}_f64"),
            Form::Number(x) => format!("({x:?}_f64)"),
            other => self.at_least(other, Tightness::Whole),
        }
    }

    fn call(&self, function: Function, arguments: &[Form]) -> (String, Tightness) {
        let name = match self.notation {
            Notation::Text => Some(function.name()),
            Notation::Rust => function.rust_name(),
            Notation::C => function.c_name(),
        };
        let written = arguments.iter().map(|a| self.write(a));
        let text = match (self.notation, name) {
            (Notation::Rust, Some(name)) => {
                let receiver = arguments.first().map(|a| self.receiver(a));
                let rest: Vec<String> = written.skip(1).collect();
                let receiver = receiver.unwrap_or_default();
                format!("{receiver}.{name}({})", rest.join(", "))
            }
            (_, Some(name)) => {
                let arguments: Vec<String> = written.collect();
                format!("{name}({})", arguments.join(", "))
            }
            (notation, None) => {
                return self.choice(notation, function, &written.collect::<Vec<_>>());
            }
        };
        (text, Tightness::Whole)
    }

    /// The sign, and the smaller or larger one, where NaN on either side wins: neither C nor Rust has them as they are here.
    fn choice(
        &self,
        notation: Notation,
        function: Function,
        arguments: &[String],
    ) -> (String, Tightness) {
        let text = match (notation, function, arguments) {
            (Notation::C, Function::Two(f), [x, y]) => {
                let relation = if f == Binary::Min { "<=" } else { ">=" };
                format!("({x} {relation} {y} || isnan({x}) ? {x} : {y})")
            }
            (Notation::Rust, Function::Two(f), [x, y]) => {
                let name = if f == Binary::Min { SMALLER } else { LARGER };
                format!("{name}({x}, {y})")
            }
            (Notation::C, _, [x, ..]) => format!("(({x}) < 0.0 ? -1.0 : 1.0)"),
            (_, _, [x, ..]) => {
                let text = format!("if {x} < 0.0 {{ -1.0 }} else {{ 1.0 }}");
                return (text, Tightness::Sum);
            }
            (_, _, []) => String::new(),
        };
        (text, Tightness::Whole)
    }
}

/// What `min` and `max` are called in emitted Rust.
pub const SMALLER: &str = "smaller";
pub const LARGER: &str = "larger";

/// p and q with x = p/q to the last bit, where x is a fraction of small numbers and takes many digits otherwise.
pub fn fraction(x: f64) -> Option<(u32, u32)> {
    if format!("{x}").len() <= 9 || x <= 0.0 {
        return None;
    }
    (3..=96_u32).find_map(|q| {
        let p = (x * f64::from(q)).round();
        ((1.0..1000.0).contains(&p) && p / f64::from(q) == x).then_some((p as u32, q))
    })
}
