//! The functions of formulas: one vocabulary for text, expression graph, programs and printed code.

use crate::Scalar;

/// A function that a formula can call.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Function {
    One(Unary),
    Two(Binary),
}

/// A function of one argument.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) enum Unary {
    Sin,
    Cos,
    Tan,
    Asin,
    Acos,
    Atan,
    Sinh,
    Cosh,
    Tanh,
    Exp,
    Ln,
    Sqrt,
    Abs,
    /// −1 below zero, else 1.
    Sign,
}

/// A function of two arguments.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) enum Binary {
    Atan2,
    Min,
    Max,
    Pow,
}

/// Every function under every name it has in a text, the commonest first.
pub(crate) const FUNCTIONS: &[(&str, Function)] = &[
    ("sin", Function::One(Unary::Sin)),
    ("cos", Function::One(Unary::Cos)),
    ("tan", Function::One(Unary::Tan)),
    ("asin", Function::One(Unary::Asin)),
    ("acos", Function::One(Unary::Acos)),
    ("atan", Function::One(Unary::Atan)),
    ("atan2", Function::Two(Binary::Atan2)),
    ("sinh", Function::One(Unary::Sinh)),
    ("cosh", Function::One(Unary::Cosh)),
    ("tanh", Function::One(Unary::Tanh)),
    ("exp", Function::One(Unary::Exp)),
    ("ln", Function::One(Unary::Ln)),
    ("log", Function::One(Unary::Ln)),
    ("sqrt", Function::One(Unary::Sqrt)),
    ("abs", Function::One(Unary::Abs)),
    ("sign", Function::One(Unary::Sign)),
    ("min", Function::Two(Binary::Min)),
    ("max", Function::Two(Binary::Max)),
    ("pow", Function::Two(Binary::Pow)),
];

/// Every constant that has a name in a text.
pub(crate) const CONSTANTS: &[(&str, f64)] =
    &[("pi", std::f64::consts::PI), ("e", std::f64::consts::E)];

impl Function {
    /// Number of arguments.
    pub fn arity(self) -> usize {
        match self {
            Function::One(_) => 1,
            Function::Two(_) => 2,
        }
    }

    /// The name in a text.
    pub fn name(self) -> &'static str {
        FUNCTIONS
            .iter()
            .find(|(_, f)| *f == self)
            .map_or("", |(name, _)| name)
    }

    /// The name in C's `math.h`; none where C has an expression instead.
    pub fn c_name(self) -> Option<&'static str> {
        match self {
            // `fmin` and `fmax` pass over NaN.
            Function::One(Unary::Sign) | Function::Two(Binary::Min | Binary::Max) => None,
            Function::One(Unary::Ln) => Some("log"),
            Function::One(Unary::Abs) => Some("fabs"),
            other => Some(other.name()),
        }
    }

    /// The method of Rust's `f64`; none where Rust has an expression instead.
    pub fn rust_name(self) -> Option<&'static str> {
        match self {
            // `f64::min` and `f64::max` pass over NaN.
            Function::One(Unary::Sign) | Function::Two(Binary::Min | Binary::Max) => None,
            Function::Two(Binary::Pow) => Some("powf"),
            other => Some(other.name()),
        }
    }

    /// The command in LaTeX's math mode.
    pub fn latex_name(self) -> &'static str {
        match self {
            Function::One(Unary::Sin) => r"\sin",
            Function::One(Unary::Cos) => r"\cos",
            Function::One(Unary::Tan) => r"\tan",
            Function::One(Unary::Asin) => r"\arcsin",
            Function::One(Unary::Acos) => r"\arccos",
            Function::One(Unary::Atan) => r"\arctan",
            Function::One(Unary::Sinh) => r"\sinh",
            Function::One(Unary::Cosh) => r"\cosh",
            Function::One(Unary::Tanh) => r"\tanh",
            Function::One(Unary::Exp) => r"\exp",
            Function::One(Unary::Ln) => r"\ln",
            Function::One(Unary::Sqrt) => r"\sqrt",
            Function::One(Unary::Abs) => r"\operatorname{abs}",
            Function::One(Unary::Sign) => r"\operatorname{sign}",
            Function::Two(Binary::Atan2) => r"\operatorname{atan2}",
            Function::Two(Binary::Min) => r"\min",
            Function::Two(Binary::Max) => r"\max",
            Function::Two(Binary::Pow) => r"\operatorname{pow}",
        }
    }
}

impl Unary {
    /// f(x).
    #[inline]
    pub fn of<D: Scalar>(self, x: D) -> D {
        match self {
            Unary::Sin => x.sin(),
            Unary::Cos => x.cos(),
            Unary::Tan => x.tan(),
            Unary::Asin => x.asin(),
            Unary::Acos => x.acos(),
            Unary::Atan => x.atan(),
            Unary::Sinh => x.sinh(),
            Unary::Cosh => x.cosh(),
            Unary::Tanh => x.tanh(),
            Unary::Exp => x.exp(),
            Unary::Ln => x.ln(),
            Unary::Sqrt => x.sqrt(),
            Unary::Abs => x.abs(),
            Unary::Sign => x.sign(),
        }
    }

    /// f′(x), where `value` is f(x).
    pub fn slope<D: Scalar>(self, x: D, value: D) -> D {
        let one = D::constant(1.0);
        match self {
            Unary::Sin => x.cos(),
            Unary::Cos => -x.sin(),
            Unary::Tan => value * value + 1.0,
            Unary::Asin => one / (one - x * x).sqrt(),
            Unary::Acos => -(one / (one - x * x).sqrt()),
            Unary::Atan => one / (x * x + 1.0),
            Unary::Sinh => x.cosh(),
            Unary::Cosh => x.sinh(),
            Unary::Tanh => one - value * value,
            Unary::Exp => value,
            Unary::Ln => one / x,
            Unary::Sqrt => D::constant(0.5) / value,
            Unary::Abs => x.sign(),
            Unary::Sign => D::zero(),
        }
    }
}

impl Binary {
    /// f(a, b).
    #[inline]
    pub fn of<D: Scalar>(self, a: D, b: D) -> D {
        match self {
            Binary::Atan2 => a.atan2(b),
            Binary::Min => a.min(b),
            Binary::Max => a.max(b),
            Binary::Pow => a.pow(b),
        }
    }

    /// ∂f/∂a at (a, b).
    pub fn slope_left<D: Scalar>(self, a: D, b: D) -> D {
        match self {
            Binary::Atan2 => b / (a * a + b * b),
            Binary::Min => chosen(b - a),
            Binary::Max => chosen(a - b),
            Binary::Pow => b * a.pow(b - 1.0),
        }
    }

    /// ∂f/∂b at (a, b), where `value` is f(a, b). That of aᵇ is aᵇ ln a, which wants a > 0.
    pub fn slope_right<D: Scalar>(self, a: D, b: D, value: D) -> D {
        match self {
            Binary::Atan2 => -(a / (a * a + b * b)),
            Binary::Min => D::constant(1.0) - chosen(b - a),
            Binary::Max => D::constant(1.0) - chosen(a - b),
            Binary::Pow => value * a.ln(),
        }
    }
}

/// 1 where `ahead` ≥ 0, else 0.
fn chosen<D: Scalar>(ahead: D) -> D {
    (ahead.sign() + 1.0) * 0.5
}

#[cfg(test)]
mod tests {
    use num_dual::Dual64;

    use super::*;

    #[test]
    fn every_slope_is_what_dual_numbers_say() {
        for &(name, function) in FUNCTIONS {
            for x in [-0.7, -0.2, 0.3, 0.8] {
                let domain = matches!(name, "ln" | "log" | "sqrt" | "pow");
                let x: f64 = if domain { x + 1.0 } else { x };
                for y in [-1.3, 0.45] {
                    let close = |by_rule: f64, by_dual: f64| {
                        let error = (by_rule - by_dual).abs();
                        assert!(error < 1e-14 * (1.0 + by_dual.abs()), "{name}({x}, {y})");
                    };
                    let moving = |x: f64| Dual64::new(x, 1.0);
                    match function {
                        Function::One(f) => close(f.slope(x, f.of(x)), f.of(moving(x)).eps),
                        Function::Two(f) => {
                            close(f.slope_left(x, y), f.of(moving(x), y.into()).eps);
                            let right = f.slope_right(x, y, f.of(x, y));
                            close(right, f.of(x.into(), moving(y)).eps);
                        }
                    }
                }
            }
        }
    }
}
