//! What the symbols of formulas are called.

use std::collections::HashSet;

use super::form::Symbol;
use super::latex::latex_name;
use crate::expression::{is_identifier, reserved};
use crate::{Coordinate, Parameter, Role};

/// Names for texts: letters, digits and `_`, each once.
#[derive(Debug, Clone)]
pub struct Names {
    /// One for every entry of q.
    pub coordinates: Vec<String>,
    /// One for every entry of v.
    pub velocities: Vec<String>,
    /// One for every constant.
    pub parameters: Vec<String>,
    /// The poses among the coordinates.
    pub floating: Vec<String>,
    /// What named subexpressions begin with.
    pub prefix: &'static str,
}

impl Names {
    pub fn of(coordinates: &[Coordinate], parameters: &[Parameter]) -> Self {
        let mut taken = HashSet::new();
        let mut names = Names {
            coordinates: Vec::new(),
            velocities: Vec::new(),
            parameters: Vec::new(),
            floating: Vec::new(),
            prefix: "t",
        };
        // Constants that the energies name keep their names first.
        for parameter in parameters {
            let wanted = match parameter.role {
                Role::MassScale => format!("scale_{}", parameter.name),
                _ => parameter.name.clone(),
            };
            names.parameters.push(free(&wanted, &mut taken));
        }
        for coordinate in coordinates {
            let stem = free(&coordinate.name, &mut taken);
            if coordinate.floating {
                let of = |part: &&str| format!("{stem}_{part}");
                names.coordinates.extend(POSE.iter().map(of));
                names.velocities.extend(TWIST.iter().map(of));
                names.floating.push(stem);
            } else {
                names
                    .velocities
                    .push(free(&format!("{stem}_dot"), &mut taken));
                names.coordinates.push(stem);
            }
        }
        let clashes = |prefix: &str| {
            taken.iter().any(|name: &String| {
                name.strip_prefix(prefix)
                    .is_some_and(|rest| rest.chars().all(|c| c.is_ascii_digit()))
            })
        };
        let prefixes = ["t", "s", "w", "common_"];
        names.prefix = prefixes
            .into_iter()
            .find(|p| !clashes(p))
            .unwrap_or("named_expression_");
        names
    }

    /// As a text has it.
    pub fn text(&self, symbol: Symbol) -> String {
        let name = match symbol {
            Symbol::Parameter(i) => self.parameters.get(i),
            Symbol::Coordinate(i) => self.coordinates.get(i),
            Symbol::Velocity(i) => self.velocities.get(i),
            Symbol::Named(i) => return format!("{}{}", self.prefix, i + 1),
        };
        name.cloned().unwrap_or_default()
    }

    /// As LaTeX has it; the velocity of a coordinate gets its dot.
    pub fn latex(&self, symbol: Symbol) -> String {
        if let Symbol::Velocity(i) = symbol {
            let name = self.text(symbol);
            let coordinate = self.coordinates.iter().find(|c| format!("{c}_dot") == name);
            return match coordinate {
                Some(coordinate) => dotted(&latex_name(coordinate)),
                None => latex_name(self.velocities.get(i).map_or("", String::as_str)),
            };
        }
        latex_name(&self.text(symbol))
    }
}

/// The dot stands on the letter, not on its index.
fn dotted(name: &str) -> String {
    match name.split_once("_{") {
        Some((stem, index)) => format!(r"\dot{{{stem}}}_{{{index}"),
        None => format!(r"\dot{{{name}}}"),
    }
}

const POSE: [&str; 7] = ["x", "y", "z", "qw", "qx", "qy", "qz"];
const TWIST: [&str; 6] = ["vx", "vy", "vz", "wx", "wy", "wz"];

/// `wanted` as a name that a text can have and that is not taken yet.
fn free(wanted: &str, taken: &mut HashSet<String>) -> String {
    let name = identifier(wanted);
    let mut free = name.clone();
    let mut count = 1;
    while !taken.insert(free.clone()) {
        count += 1;
        free = format!("{name}_{count}");
    }
    free
}

/// `wanted` with `_` for everything that no name has.
pub fn identifier(wanted: &str) -> String {
    let allowed = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
    let name: String = wanted.chars().map(allowed).collect();
    if is_identifier(&name) && reserved(&name).is_none() {
        name
    } else {
        format!("q_{name}")
    }
}

/// What a function must not be called: the keywords of Rust (2024) and C23, `main`, macros of C compilers, and what identifies nothing.
const TAKEN: &str = " abstract as async await become box break const continue crate do dyn else enum extern false final fn for gen if \
    impl in let loop macro match mod move mut override priv pub ref return self static struct super trait true try type typeof unsafe \
    unsized use virtual where while yield \
    alignas alignof asm auto bool case char constexpr default double float goto inline int long nullptr register restrict short signed \
    sizeof static_assert switch thread_local typedef typeof_unqual union unsigned void volatile \
    main linux unix _ ";

/// The functions and macros of `math.h`, for `double`.
const MATH_H: &str = " acos acosh asin asinh atan atan2 atanh cbrt ceil copysign cos cosh drem erf erfc exp exp10 exp2 expm1 fabs fdim \
    finite floor fma fmax fmin fmod fpclassify frexp gamma hypot ilogb infinity isfinite isgreater isgreaterequal isinf isless \
    islessequal islessgreater isnan isnormal isunordered j0 j1 jn ldexp lgamma llrint llround log log10 log1p log2 logb lrint lround \
    modf nan nearbyint nextafter nexttoward pow remainder remquo rint round scalb scalbln scalbn signbit signgam significand sin sincos \
    sinh sqrt tan tanh tgamma trunc y0 y1 yn ";

/// `wanted` as the name of a function in Rust and C: with `_model` behind it where one of them means something else by it.
pub fn function_name(wanted: &str) -> String {
    let name = identifier(wanted).to_lowercase();
    let holds = |list: &str, name: &str| list.contains(&format!(" {name} "));
    // sinf and sinl are sin in other precisions.
    let stem = name.strip_suffix(['f', 'l']).unwrap_or(&name);
    if holds(TAKEN, &name) || holds(MATH_H, &name) || holds(MATH_H, stem) {
        name + "_model"
    } else {
        name
    }
}

#[cfg(test)]
mod tests {
    use super::function_name;

    #[test]
    fn a_model_named_like_a_keyword_gives_a_function_that_compiles() {
        for name in [
            "double", "if", "fn", "self", "main", "Double", "SELF", "int", "match", "yield",
            "while", "abstract", "yn", "expf", "_", "linux", "restrict", "unsafe", "try",
        ] {
            let expected = format!("{}_model", name.to_lowercase());
            assert_eq!(function_name(name), expected);
        }
        // Those of the expressions' functions have a prefix of their own, unless they were written in capitals.
        assert_eq!(function_name("sin"), "q_sin");
        assert_eq!(function_name("SIN"), "sin_model");
        for name in ["cartpole", "four_bar", "doubles", "model", "selfie"] {
            assert_eq!(function_name(name), name);
        }
        assert_eq!(function_name("2 links"), "q_2_links");
    }
}
