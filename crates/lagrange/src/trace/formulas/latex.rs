//! Formulas in LaTeX.

use super::form::{Form, Symbol};
use super::write::fraction;
use crate::expression::{Binary, Function, Unary};

/// The formula in math mode; `symbol` spells the names.
pub fn latex(form: &Form, symbol: &dyn Fn(Symbol) -> String) -> String {
    match form {
        Form::Number(x) if *x < 0.0 => format!("-{}", number(-x)),
        Form::Number(x) => number(*x),
        Form::Symbol(s) => symbol(*s),
        Form::Sum(terms) => {
            let mut text = String::new();
            for (i, term) in terms.iter().enumerate() {
                let (negative, term) = term.unsigned();
                text.push_str(match (i, negative) {
                    (0, false) => "",
                    (0, true) => "-",
                    (_, false) => " + ",
                    (_, true) => " - ",
                });
                text.push_str(&latex(&term, symbol));
            }
            text
        }
        Form::Product(p) if p.coefficient < 0.0 => {
            let (_, positive) = form.unsigned();
            format!("-{}", grouped_if_sum(&positive, symbol))
        }
        Form::Product(p) => {
            let small = fraction(p.coefficient);
            let (p_number, q_number) = match small {
                Some((p, q)) => (f64::from(p), f64::from(q)),
                None if p.coefficient == 0.5 => (1.0, 2.0),
                None => (p.coefficient, 1.0),
            };
            let side = |number_of: f64, factors: &[Form]| -> String {
                let alone = factors.len() == 1 && number_of == 1.0;
                let mut parts = Vec::new();
                if number_of != 1.0 || factors.is_empty() {
                    parts.push(number(number_of));
                }
                for factor in factors {
                    parts.push(match alone {
                        true => latex(factor, symbol),
                        false => grouped_if_sum(factor, symbol),
                    });
                }
                parts.join(r" \, ")
            };
            if p.under.is_empty() && q_number == 1.0 {
                side(p_number, &p.over)
            } else if p.under.is_empty() {
                let rest = side(1.0, &p.over);
                let rest = if p.over.len() == 1 {
                    grouped_if_sum(&p.over[0], symbol)
                } else {
                    rest
                };
                format!(
                    r"\frac{{{}}}{{{}}} \, {rest}",
                    number(p_number),
                    number(q_number)
                )
            } else {
                let (top, bottom) = (side(p_number, &p.over), side(q_number, &p.under));
                format!(r"\frac{{{top}}}{{{bottom}}}")
            }
        }
        Form::Power(base, n) => match &**base {
            // sin² x
            Form::Call(f @ Function::One(g), a) if *n > 0 && has_power_style(*g) => {
                format!("{}^{{{n}}}{}", f.latex_name(), arguments(a, symbol))
            }
            Form::Symbol(s) => {
                let name = symbol(*s);
                let dotted = name.starts_with(r"\dot");
                match dotted || !name.contains('^') {
                    true => format!("{name}^{{{n}}}"),
                    false => format!("{{{name}}}^{{{n}}}"),
                }
            }
            other => format!(r"\left( {} \right)^{{{n}}}", latex(other, symbol)),
        },
        Form::Call(Function::One(Unary::Sqrt), a) => {
            let inner: Vec<String> = a.iter().map(|a| latex(a, symbol)).collect();
            format!(r"\sqrt{{{}}}", inner.join(", "))
        }
        Form::Call(Function::One(Unary::Abs), a) => {
            let inner: Vec<String> = a.iter().map(|a| latex(a, symbol)).collect();
            format!(r"\left| {} \right|", inner.join(", "))
        }
        Form::Call(Function::Two(Binary::Pow), a) => match a.as_slice() {
            [base, exponent] => format!(
                "{{{}}}^{{{}}}",
                grouped(base, symbol),
                latex(exponent, symbol)
            ),
            _ => String::new(),
        },
        Form::Call(f, a) => format!("{}{}", f.latex_name(), arguments(a, symbol)),
    }
}

fn has_power_style(function: Unary) -> bool {
    !matches!(
        function,
        Unary::Sqrt | Unary::Abs | Unary::Sign | Unary::Exp
    )
}

fn arguments(arguments: &[Form], symbol: &dyn Fn(Symbol) -> String) -> String {
    let inner: Vec<String> = arguments.iter().map(|a| latex(a, symbol)).collect();
    match arguments {
        [Form::Symbol(_)] => format!(" {}", inner.concat()),
        _ => format!(r"\left( {} \right)", inner.join(", ")),
    }
}

fn grouped(form: &Form, symbol: &dyn Fn(Symbol) -> String) -> String {
    match form {
        Form::Symbol(_) => latex(form, symbol),
        Form::Number(x) if *x >= 0.0 => latex(form, symbol),
        _ => format!(r"\left( {} \right)", latex(form, symbol)),
    }
}

fn grouped_if_sum(form: &Form, symbol: &dyn Fn(Symbol) -> String) -> String {
    match form {
        Form::Sum(_) => grouped(form, symbol),
        _ => latex(form, symbol),
    }
}

/// `1.5`, `2 \cdot 10^{-17}`, `\frac{1}{3}`.
fn number(x: f64) -> String {
    if let Some((p, q)) = fraction(x) {
        return format!(r"\frac{{{p}}}{{{q}}}");
    }
    let text = if x.fract() == 0.0 && x.abs() < 1e15 {
        format!("{x}")
    } else {
        format!("{x:?}")
    };
    match text.split_once('e') {
        Some((mantissa, exponent)) => format!(r"{mantissa} \cdot 10^{{{exponent}}}"),
        None => text,
    }
}

/// A name: Greek letters by their command, digits and what follows a `_` as index, `_dot` as a dot.
///
/// ```text
/// phi_dot → \dot{\phi}    m_cart → m_{\mathrm{cart}}    theta1 → \theta_{1}
/// ```
pub fn latex_name(name: &str) -> String {
    let (stem, index) = match name.split_once('_') {
        Some((stem, index)) if !stem.is_empty() && !index.is_empty() => (stem, index.to_owned()),
        _ => {
            let letters = name.trim_end_matches(|c: char| c.is_ascii_digit());
            match letters.len() {
                0 => (name, String::new()),
                n => (letters, name.get(n..).unwrap_or("").to_owned()),
            }
        }
    };
    let part = |part: &str| -> String {
        if GREEK.contains(&part) {
            format!(r"\{part}")
        } else if part.chars().count() == 1 || part.chars().all(|c| c.is_ascii_digit()) {
            part.to_owned()
        } else {
            format!(r"\mathrm{{{}}}", part.replace('_', r"\_"))
        }
    };
    if index.is_empty() {
        part(stem)
    } else {
        format!("{}_{{{}}}", part(stem), part(&index))
    }
}

const GREEK: &[&str] = &[
    "alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta", "iota", "kappa",
    "lambda", "mu", "nu", "xi", "pi", "rho", "sigma", "tau", "upsilon", "phi", "chi", "psi",
    "omega", "Gamma", "Delta", "Theta", "Lambda", "Xi", "Pi", "Sigma", "Upsilon", "Phi", "Psi",
    "Omega",
];
