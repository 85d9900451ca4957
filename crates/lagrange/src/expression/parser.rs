//! Tokens to a tape, by precedence climbing (Pratt).

use super::lexer::{Kind, Lexer, Token};
use super::tape::{Builder, Operator, Tape};
use super::{Binary, CONSTANTS, ExpressionError, FUNCTIONS, Function, nearest};

/// Parentheses, signs and powers may stand in one another this deep.
const MAX_NESTING: usize = 200;
/// What people call the time.
const TIME: [&str; 2] = ["t", "time"];
/// After so many unknown names the rest of the text is not read.
const MAX_ERRORS: usize = 20;

/// The operator `^`.
const POWER: Operator = Operator::Two(Binary::Pow);

/// How tightly a sign binds its operand: weaker than `^`, tighter than `*`.
const SIGN: u8 = 5;

/// An operator with its binding power to the left and to the right.
fn infix(kind: Kind<'_>) -> Option<(Operator, u8, u8)> {
    Some(match kind {
        Kind::Plus => (Operator::Add, 1, 2),
        Kind::Minus => (Operator::Sub, 1, 2),
        Kind::Star => (Operator::Mul, 3, 4),
        Kind::Slash => (Operator::Div, 3, 4),
        Kind::Caret => (POWER, 8, 7),
        _ => return None,
    })
}

pub(super) struct Parser<'a, 'n> {
    text: &'a str,
    lexer: Lexer<'a>,
    current: Token<'a>,
    variables: &'n [&'n str],
    builder: Builder,
    /// Byte at which a variable is first used.
    first_use: Vec<Option<usize>>,
    nesting: usize,
    unknown: Vec<&'a str>,
    errors: Vec<ExpressionError>,
}

/// What a text was parsed to.
pub(super) type Parsed = (Tape, Vec<Option<usize>>);

pub(super) fn parse(text: &str, variables: &[&str]) -> Result<Parsed, Vec<ExpressionError>> {
    let mut parser = Parser {
        text,
        lexer: Lexer::new(text),
        current: Token {
            kind: Kind::End,
            start: 0,
        },
        variables,
        builder: Builder::default(),
        first_use: vec![None; variables.len()],
        nesting: 0,
        unknown: Vec::new(),
        errors: Vec::new(),
    };
    if let Err(error) = parser.whole() {
        parser.errors.push(error);
    }
    if parser.errors.is_empty() {
        Ok((parser.builder.finish(), parser.first_use))
    } else {
        parser.errors.sort_by_key(|e| e.offset);
        Err(parser.errors)
    }
}

impl<'a> Parser<'a, '_> {
    fn error(&self, start: usize, message: impl Into<String>) -> ExpressionError {
        ExpressionError::new(self.text, start, message)
    }

    fn advance(&mut self) -> Result<Token<'a>, ExpressionError> {
        let next = self.lexer.next()?;
        Ok(std::mem::replace(&mut self.current, next))
    }

    fn whole(&mut self) -> Result<(), ExpressionError> {
        self.advance()?;
        if self.current.kind == Kind::End {
            return Err(self.error(
                0,
                "the expression is empty: write 0 for an energy that vanishes",
            ));
        }
        self.expression(0)?;
        let Token { kind, start } = self.current;
        match kind {
            Kind::Close => Err(self.error(start, "`)` has no `(` before it")),
            Kind::Comma => Err(self.stray_comma(start)),
            _ => Ok(()),
        }
    }

    fn stray_comma(&self, start: usize) -> ExpressionError {
        self.error(
            start,
            "`,` stands outside of a function's arguments; the decimal point is `.`",
        )
    }

    /// An operand, and every operator behind it that binds at least as tightly as `least`.
    fn expression(&mut self, least: u8) -> Result<(), ExpressionError> {
        self.operand()?;
        loop {
            let Token { kind, start } = self.current;
            match infix(kind) {
                Some((operator, left, right)) if left >= least => {
                    self.advance()?;
                    // Sums and products go on in this loop; powers are the ones that nest.
                    match operator {
                        POWER => self.nested(right, start)?,
                        _ => self.expression(right)?,
                    }
                    self.builder.operator(operator);
                    self.check_folded(start)?;
                }
                None if matches!(kind, Kind::Number(_) | Kind::Name(_) | Kind::Open) => {
                    return Err(self.error(
                        start,
                        format!(
                            "an operator is missing before {} (a product is written `*`)",
                            kind.describe()
                        ),
                    ));
                }
                _ => return Ok(()),
            }
        }
    }

    /// An expression one level deeper, because of what stands at `start`.
    fn nested(&mut self, least: u8, start: usize) -> Result<(), ExpressionError> {
        self.nesting += 1;
        if self.nesting > MAX_NESTING {
            return Err(self.error(
                start,
                format!("nested more than {MAX_NESTING} deep: split the expression into sums"),
            ));
        }
        self.expression(least)?;
        self.nesting -= 1;
        Ok(())
    }

    fn operand(&mut self) -> Result<(), ExpressionError> {
        let Token { kind, start } = self.advance()?;
        match kind {
            Kind::Number(x) => self.builder.constant(x),
            Kind::Name(name) if self.current.kind == Kind::Open => self.call(name, start)?,
            Kind::Name(name) => self.name(name, start)?,
            Kind::Minus => {
                self.nested(SIGN, start)?;
                self.builder.negate();
            }
            Kind::Plus => self.nested(SIGN, start)?,
            Kind::Open => {
                if self.current.kind == Kind::Close {
                    return Err(
                        self.error(self.current.start, "nothing stands between `(` and `)`")
                    );
                }
                self.nested(0, start)?;
                self.close(start)?;
            }
            other => {
                return Err(self.error(
                    start,
                    format!(
                        "a number, a name or `(` is missing before {}",
                        other.describe()
                    ),
                ));
            }
        }
        Ok(())
    }

    /// The `)` of the `(` at `open`.
    fn close(&mut self, open: usize) -> Result<(), ExpressionError> {
        match self.current.kind {
            Kind::Close => self.advance().map(|_| ()),
            Kind::Comma => Err(self.stray_comma(self.current.start)),
            other => Err(self.error(
                open,
                format!(
                    "`(` is not closed: `)` is missing before {}",
                    other.describe()
                ),
            )),
        }
    }

    fn name(&mut self, name: &'a str, start: usize) -> Result<(), ExpressionError> {
        if let Some(slot) = self.variables.iter().position(|&v| v == name) {
            self.builder.variable(slot);
            if let Some(first) = self.first_use.get_mut(slot) {
                first.get_or_insert(start);
            }
        } else if let Some(&(_, value)) = CONSTANTS.iter().find(|(c, _)| *c == name) {
            self.builder.constant(value);
        } else if FUNCTIONS.iter().any(|(f, _)| *f == name) {
            return Err(self.error(
                start,
                format!("the function `{name}` has no arguments here: write {name}(…)"),
            ));
        } else {
            self.unknown_name(
                name,
                start,
                "name",
                self.variables.iter().copied().chain(constants()),
            )?;
            self.builder.variable(0);
        }
        Ok(())
    }

    /// Notes an unknown name once, and goes on.
    fn unknown_name<'k>(
        &mut self,
        name: &'a str,
        start: usize,
        what: &str,
        known: impl Iterator<Item = &'k str> + Clone,
    ) -> Result<(), ExpressionError> {
        if self.unknown.contains(&name) {
            return Ok(());
        }
        self.unknown.push(name);
        let cure = match nearest(name, known.clone()) {
            _ if TIME.contains(&name) => "an energy that depends on time, as of a motion that is prescribed, cannot be described yet".to_owned(),
            Some(near) => format!("did you mean `{near}`?"),
            None => {
                let list: Vec<&str> = known.take(30).collect();
                format!("known are {}", list.join(", "))
            }
        };
        let error = self.error(start, format!("unknown {what} `{name}`; {cure}"));
        if self.unknown.len() == MAX_ERRORS {
            return Err(error);
        }
        self.errors.push(error);
        Ok(())
    }

    /// `name(…)`; the current token is the `(`.
    fn call(&mut self, name: &'a str, start: usize) -> Result<(), ExpressionError> {
        let function = FUNCTIONS.iter().find(|(f, _)| *f == name).map(|&(_, f)| f);
        let value = self.variables.contains(&name) || constants().any(|c| c == name);
        if function.is_none() && value {
            return Err(self.error(
                start,
                format!("`{name}` is no function; a product is written {name}*(…)"),
            ));
        }
        let open = self.advance()?.start;
        let mut arguments = 0;
        if self.current.kind != Kind::Close {
            loop {
                self.nested(0, start)?;
                arguments += 1;
                if self.current.kind != Kind::Comma {
                    break;
                }
                self.advance()?;
            }
        }
        self.close(open)?;
        let Some(function) = function else {
            let functions = FUNCTIONS.iter().map(|&(f, _)| f);
            self.unknown_name(name, start, "function", functions)?;
            // One value stands for the whole call.
            for _ in 1..arguments {
                self.builder.operator(Operator::Add);
            }
            if arguments == 0 {
                self.builder.constant(0.0);
            }
            return Ok(());
        };
        let takes = function.arity();
        if arguments != takes {
            let s = if takes == 1 { "" } else { "s" };
            return Err(self.error(
                start,
                format!("`{name}` takes {takes} argument{s}, {arguments} given"),
            ));
        }
        match function {
            Function::One(f) => self.builder.unary(f),
            Function::Two(f) => self.builder.operator(Operator::Two(f)),
        }
        self.check_folded(start)
    }

    /// A constant part must be a number.
    fn check_folded(&self, start: usize) -> Result<(), ExpressionError> {
        match self.builder.last_constant() {
            Some(c) if !c.is_finite() && self.errors.is_empty() => Err(self.error(
                start,
                format!("the constant computed here is {c}: it must be finite"),
            )),
            _ => Ok(()),
        }
    }
}

fn constants<'k>() -> impl Iterator<Item = &'k str> + Clone {
    CONSTANTS.iter().map(|&(c, _)| c)
}
