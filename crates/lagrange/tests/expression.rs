//! Formulas as text: what they mean, and what is said about those that mean nothing.

use approx::assert_relative_eq;
use lagrange::{Expression, caret};
use num_dual::{Dual64, HyperDual64};
use proptest::prelude::*;

const NAMES: [&str; 3] = ["x", "phi", "phi_dot"];

fn value(text: &str, at: [f64; 3]) -> f64 {
    match Expression::parse(text, &NAMES) {
        Ok(expression) => expression.evaluate(|slot| at[slot]),
        Err(errors) => panic!("{text}: {errors:?}"),
    }
}

#[test]
fn operators_bind_and_group_as_in_mathematics() {
    let x = 1.7;
    for (text, expected) in [
        ("-x^2", -(x * x)),
        ("(-x)^2", x * x),
        ("2^3^2", 512.0),
        ("2^-x", 2.0_f64.powf(-x)),
        ("2^-x^2", 2.0_f64.powf(-x * x)),
        ("-2^-2", -0.25),
        ("8 - 3 - x", 5.0 - x),
        ("8/4/x", 2.0 / x),
        ("8/4*x", 2.0 * x),
        ("2*-x", -2.0 * x),
        ("2 - -x", 2.0 + x),
        ("- - x", x),
        ("+x", x),
        ("3 - x*2", 3.0 - 2.0 * x),
        ("1 - x", 1.0 - x),
        ("1/x", 1.0 / x),
        ("x - 1", x - 1.0),
        ("x/3", x / 3.0),
        ("-x*x", -(x * x)),
        ("2*x^2", 2.0 * x * x),
        ("1e-3 + .5 + 2. + 1E2*x", 2.501 + 100.0 * x),
        ("2*e", 2.0 * std::f64::consts::E),
        ("pi*x", std::f64::consts::PI * x),
        ("x^0.5", x.sqrt()),
        ("pow(x, 3)", x * x * x),
        ("x^x", x.powf(x)),
        ("(0 - x)^(x - x + 3)", -x * x * x),
        ("atan2(1, -x)", 1.0_f64.atan2(-x)),
        ("min(x, 2) + max(x, 2)", x + 2.0),
        ("abs(-x) + abs(x)", 2.0 * x),
        ("ln(e^x) + log(x)", x + x.ln()),
        ("sin(x)^2 + cos(x)^2", 1.0),
        ("tan(x) - sin(x)/cos(x)", 0.0),
        ("asin(sin(0.3)) + acos(cos(0.4)) + atan(tan(0.5))", 1.2),
        ("cosh(x)^2 - sinh(x)^2", 1.0),
        ("tanh(x)*cosh(x)", x.sinh()),
        ("exp(x)*sqrt(x)", x.exp() * x.sqrt()),
        ("\n\tx\n+\r\n1 ", x + 1.0),
    ] {
        assert_relative_eq!(
            value(text, [x, 0.0, 0.0]),
            expected,
            max_relative = 1e-14,
            epsilon = 1e-15
        );
    }
}

#[test]
fn a_deep_stack_is_evaluated_too() {
    // Every parenthesis keeps two more values alive.
    let depth = 150;
    let text = format!("{}x{}", "x + x*(".repeat(depth), ")".repeat(depth));
    let mut expected = 1.5;
    for _ in 0..depth {
        expected = 1.5 + 1.5 * expected;
    }
    assert_relative_eq!(
        value(&text, [1.5, 0.0, 0.0]),
        expected,
        max_relative = 1e-13
    );
}

#[test]
fn long_sums_are_no_nesting() {
    let text = vec!["x"; 10_000].join(" + ");
    assert_eq!(value(&text, [0.5, 0.0, 0.0]), 5000.0);
}

#[test]
fn dual_numbers_give_the_analytic_derivative() {
    let x: f64 = 0.6;
    let cosh2 = x.cosh().powi(2);
    for (text, expected) in [
        ("x^2", 2.0 * x),
        ("x^-3", -3.0 * x.powi(-4)),
        ("x^2.5", 2.5 * x.powf(1.5)),
        ("2^x", x.exp2() * 2.0_f64.ln()),
        ("x^x", x.powf(x) * (x.ln() + 1.0)),
        ("sin(2*x)", 2.0 * (2.0 * x).cos()),
        ("cos(x)*x", x.cos() - x * x.sin()),
        ("tan(x)", 1.0 / x.cos().powi(2)),
        ("asin(x)", 1.0 / (1.0 - x * x).sqrt()),
        ("acos(x)", -1.0 / (1.0 - x * x).sqrt()),
        ("atan(x)", 1.0 / (1.0 + x * x)),
        ("atan2(x, 2)", 2.0 / (4.0 + x * x)),
        ("atan2(2, x)", -2.0 / (4.0 + x * x)),
        ("sinh(x)", x.cosh()),
        ("cosh(x)", x.sinh()),
        ("tanh(x)", 1.0 / cosh2),
        ("exp(-x^2)", -2.0 * x * (-x * x).exp()),
        ("ln(x)", 1.0 / x),
        ("sqrt(x)", 0.5 / x.sqrt()),
        ("abs(x - 1)", -1.0),
        ("min(x, x^2)", 2.0 * x),
        ("max(x, x^2)", 1.0),
        ("(1 - x)/(1 + x)", -2.0 / (1.0 + x).powi(2)),
    ] {
        let expression = Expression::parse(text, &["x"]).unwrap();
        let slope = expression.evaluate(|_| Dual64::new(x, 1.0)).eps;
        assert_relative_eq!(slope, expected, max_relative = 1e-13);
    }
    let second = Expression::parse("x^2*sin(y)", &["x", "y"]).unwrap();
    let at = [
        HyperDual64::new(0.6, 1.0, 0.0, 0.0),
        HyperDual64::new(0.2, 0.0, 1.0, 0.0),
    ];
    let mixed = second.evaluate(|slot| at[slot]).eps1eps2;
    assert_relative_eq!(mixed, 1.2 * 0.2_f64.cos(), max_relative = 1e-14);
}

#[test]
fn faults_are_named_with_their_column() {
    let deep_parentheses = format!("{}x{}", "(".repeat(300), ")".repeat(300));
    let deep_signs = format!("{}x", "-".repeat(100_000 / 2));
    let deep_powers = format!("{}x", "x^".repeat(300));
    let deep_calls = format!("{}x{}", "sin(".repeat(300), ")".repeat(300));
    let too_long = "x+".repeat(40_000);
    for (text, column, fragment) in [
        ("", 1, "empty"),
        ("  \n ", 1, "empty"),
        ("x +", 4, "missing before the end"),
        ("* x", 1, "missing before `*`"),
        ("x * / 2", 5, "missing before `/`"),
        ("2 x", 3, "operator is missing before `x`"),
        ("x phi", 3, "operator is missing before `phi`"),
        ("2(x)", 2, "operator is missing before `(`"),
        ("(x)(x)", 4, "operator is missing before `(`"),
        ("x 2", 3, "operator is missing before the number 2"),
        ("2*x**2", 4, "`^`, not `**`"),
        ("x)", 2, "no `(` before"),
        ("2*(x + 1", 3, "not closed"),
        ("sin(x", 4, "not closed"),
        ("()", 2, "nothing stands between"),
        ("x, 2", 2, "outside of a function's arguments"),
        ("(x, 2)", 3, "outside of a function's arguments"),
        ("0,5*x", 2, "decimal point is `.`"),
        ("y + 1", 1, "unknown name `y`"),
        ("x*t", 3, "unknown name `t`; an energy that depends on time"),
        ("x*phi_dt", 3, "did you mean `phi_dot`"),
        ("x*Phi", 3, "did you mean `phi`"),
        ("cso(x)", 1, "did you mean `cos`"),
        ("x*dphi", 3, "did you mean `phi_dot`"),
        ("x*phi_d", 3, "did you mean `phi_dot`"),
        ("phidot", 1, "did you mean `phi_dot`"),
        ("sgn(x)", 1, "did you mean `sign`"),
        ("arctan2(x, 1)", 1, "did you mean `atan2`"),
        ("frobnicate(x)", 1, "known are sin, cos"),
        ("1 + sin", 5, "`sin` has no arguments"),
        ("sin x", 1, "write sin(…)"),
        ("sin()", 1, "takes 1 argument, 0 given"),
        ("sin(x, phi)", 1, "takes 1 argument, 2 given"),
        ("2*atan2(x)", 3, "takes 2 arguments, 1 given"),
        ("max(x, 1, 2)", 1, "takes 2 arguments, 3 given"),
        ("max(x,)", 7, "missing before `)`"),
        ("x(2)", 1, "no function; a product is written x*(…)"),
        ("pi(2)", 1, "no function"),
        ("1/0", 2, "constant computed here is inf"),
        ("x*sqrt(0 - 1)", 3, "constant computed here is NaN"),
        ("x + ln(0)", 5, "constant computed here is -inf"),
        ("1e", 1, "exponent of this number has no digits"),
        ("x + 2e+", 5, "exponent of this number has no digits"),
        ("1e999", 1, "too large"),
        ("1.2.3", 1, "second decimal point"),
        (".", 1, "lone `.`"),
        ("2·x", 2, "product is written `*`"),
        ("x − 1", 3, "minus is the plain `-`"),
        ("x²", 2, "square is written `^2`"),
        ("θ", 1, "names have the letters"),
        ("x*phi'", 6, "written `x_dot`"),
        ("[x]", 1, "group with `(`"),
        ("x = 2", 3, "without comparisons"),
        ("x # y", 3, "unexpected character `#`"),
        ("x\u{0}", 2, "unexpected character"),
        (&deep_parentheses, 201, "nested more than 200"),
        (&deep_signs, 201, "nested more than 200"),
        (&deep_powers, 402, "nested more than 200"),
        (&deep_calls, 801, "nested more than 200"),
        (&too_long, 1, "80000 bytes"),
    ] {
        let shown: String = text.chars().take(40).collect();
        let errors = match Expression::parse(text, &NAMES) {
            Ok(_) => panic!("`{shown}` was accepted"),
            Err(errors) => errors,
        };
        assert_eq!(errors[0].column, column, "`{shown}`: {}", errors[0]);
        assert!(
            errors[0].message.contains(fragment),
            "`{shown}`: {}",
            errors[0]
        );
    }
}

#[test]
fn all_unknown_names_are_reported_at_once_each_once() {
    let errors = Expression::parse("foo*x + bar(phi, foo) - bax^2 + (", &NAMES).unwrap_err();
    let columns: Vec<usize> = errors.iter().map(|e| e.column).collect();
    assert_eq!(columns, [1, 9, 25, 34]);
}

#[test]
fn columns_count_characters_and_the_caret_stands_below() {
    let text = "x +\n  phi*  oops + 1";
    let error = &Expression::parse(text, &NAMES).unwrap_err()[0];
    assert_eq!(error.column, 13);
    assert_eq!(caret(text, error.column), "  phi*  oops + 1\n        ^");
    assert_eq!(caret("x*", 3), "x*\n  ^");
    assert_eq!(caret("", 1), "\n^");
    let long = format!("{}oops{}", "x + ".repeat(50), " + x".repeat(50));
    let rendered = caret(&long, 201);
    let lines: Vec<&str> = rendered.lines().collect();
    let below = lines[1].chars().count() - 1;
    assert!(
        lines[0]
            .chars()
            .skip(below)
            .collect::<String>()
            .starts_with("oops"),
        "{rendered}"
    );
    assert!(lines[0].chars().count() < 90);
}

#[test]
fn first_use_tells_which_variables_a_formula_has() {
    let expression = Expression::parse("2*phi + phi^2*x", &NAMES).unwrap();
    assert_eq!(
        [0, 1, 2, 9].map(|slot| expression.first_use(slot)),
        [Some(15), Some(3), None, None]
    );
    let bound = expression.bind(|slot| (slot == 0).then_some(3.0));
    assert_eq!(bound.first_use(0), None);
    assert_eq!(bound.evaluate(|slot| [f64::NAN, 2.0, f64::NAN][slot]), 16.0);
}

/// A formula as a tree, evaluated on its own.
#[derive(Debug, Clone)]
enum Tree {
    Number(f64),
    Variable(usize),
    Unary(&'static str, Box<Tree>),
    Call(&'static str, Box<Tree>, Box<Tree>),
    Infix(char, Box<Tree>, Box<Tree>),
    Power(Box<Tree>, i32),
}

impl Tree {
    /// Parentheses only where they are needed, and where `extra` says so.
    fn print(&self, extra: bool) -> String {
        let (text, _) = self.print_with_strength(extra);
        text
    }

    fn print_with_strength(&self, extra: bool) -> (String, u8) {
        let operand = |t: &Tree, least: u8| {
            let (text, strength) = t.print_with_strength(extra);
            if strength < least || extra {
                format!("( {text})")
            } else {
                text
            }
        };
        match self {
            Tree::Number(x) => (format!("{x:?}"), 9),
            Tree::Variable(slot) => (NAMES[*slot].into(), 9),
            Tree::Unary("-", t) => (format!("-{}", operand(t, 5)), 5),
            Tree::Unary(f, t) => (format!("{f}({})", t.print(extra)), 9),
            Tree::Call(f, a, b) => (format!("{f}({}, {})", a.print(extra), b.print(extra)), 9),
            Tree::Infix(op, a, b) => {
                let strength = if matches!(op, '+' | '-') { 1 } else { 3 };
                (
                    format!("{} {op} {}", operand(a, strength), operand(b, strength + 1)),
                    strength,
                )
            }
            Tree::Power(t, n) => (format!("{}^{n}", operand(t, 8)), 7),
        }
    }

    fn value(&self, at: [f64; 3]) -> f64 {
        match self {
            Tree::Number(x) => *x,
            Tree::Variable(slot) => at[*slot],
            Tree::Unary(f, t) => {
                let x = t.value(at);
                match *f {
                    "-" => -x,
                    "sin" => x.sin(),
                    "cos" => x.cos(),
                    "tanh" => x.tanh(),
                    "atan" => x.atan(),
                    "abs" => x.abs(),
                    other => panic!("{other}"),
                }
            }
            Tree::Call(f, a, b) => {
                let (a, b) = (a.value(at), b.value(at));
                match *f {
                    "min" => a.min(b),
                    "max" => a.max(b),
                    "atan2" => a.atan2(b),
                    other => panic!("{other}"),
                }
            }
            Tree::Infix(op, a, b) => {
                let (a, b) = (a.value(at), b.value(at));
                match op {
                    '+' => a + b,
                    '-' => a - b,
                    '*' => a * b,
                    '/' => a / b,
                    other => panic!("{other}"),
                }
            }
            Tree::Power(t, n) => t.value(at).powi(*n),
        }
    }
}

fn tree() -> impl Strategy<Value = Tree> {
    let leaf = prop_oneof![
        (0.1..9.0_f64).prop_map(Tree::Number),
        (1_u8..9).prop_map(|n| Tree::Number(f64::from(n))),
        (0..3_usize).prop_map(Tree::Variable),
    ];
    leaf.prop_recursive(6, 60, 2, |inner| {
        let unary = prop::sample::select(vec!["-", "sin", "cos", "tanh", "atan", "abs"]);
        let call = prop::sample::select(vec!["min", "max", "atan2"]);
        let infix = prop::sample::select(vec!['+', '-', '*', '/']);
        let pair = (inner.clone(), inner.clone());
        prop_oneof![
            (unary, inner.clone()).prop_map(|(f, t)| Tree::Unary(f, Box::new(t))),
            (call, pair.clone()).prop_map(|(f, (a, b))| Tree::Call(f, Box::new(a), Box::new(b))),
            (infix, pair).prop_map(|(op, (a, b))| Tree::Infix(op, Box::new(a), Box::new(b))),
            (inner, 0..5_i32).prop_map(|(t, n)| Tree::Power(Box::new(t), n)),
        ]
    })
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, cases: 512, ..ProptestConfig::default() })]

    #[test]
    fn a_printed_tree_parses_to_the_same_number(
        tree in tree(),
        extra in any::<bool>(),
        at in prop::array::uniform3(-2.0..2.0_f64),
    ) {
        let expected = tree.value(at);
        let text = tree.print(extra);
        match Expression::parse(&text, &NAMES) {
            Ok(expression) => {
                let found = expression.evaluate(|slot| at[slot]);
                // The tape does the same operations in the same order.
                prop_assert!(
                    found == expected || (found.is_nan() && expected.is_nan()),
                    "{text}: {found} and {expected}"
                );
                let bound = expression.bind(|slot| (slot != 1).then_some(at[slot])).evaluate(|slot| at[slot]);
                prop_assert!(bound == found || (bound.is_nan() && found.is_nan()), "{text}: bound {bound}, {found}");
            }
            // Only a constant part that is not finite may be refused.
            Err(errors) => prop_assert!(errors[0].message.contains("must be finite"), "{text}: {}", errors[0]),
        }
    }

    #[test]
    fn no_text_makes_the_parser_panic(text in any::<String>()) {
        if let Err(errors) = Expression::parse(&text, &NAMES) {
            for error in errors {
                caret(&text, error.column);
            }
        }
    }

    #[test]
    fn no_sequence_of_tokens_makes_the_parser_panic(
        tokens in prop::collection::vec(
            prop::sample::select(vec![
                "x", "phi", "y", "sin", "max", "e", "2", "0", ".5", "1e3", "1e", "+", "-", "*", "/", "^", "(", ")", "(", ")",
                ",", " ", "\n", "θ", "[",
            ]),
            0..40,
        )
    ) {
        let text = tokens.concat();
        match Expression::parse(&text, &NAMES) {
            Ok(expression) => { expression.evaluate(|_| Dual64::new(0.7, 1.0)); }
            Err(errors) => {
                prop_assert!(!errors.is_empty());
                for error in errors {
                    prop_assert!(error.column >= 1 && error.column <= text.chars().count() + 1);
                    caret(&text, error.column);
                }
            }
        }
    }
}
