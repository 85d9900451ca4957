//! Text to tokens.

use super::ExpressionError;

/// A token and the bytes it covers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Token<'a> {
    pub kind: Kind<'a>,
    pub start: usize,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Kind<'a> {
    Number(f64),
    Name(&'a str),
    Plus,
    Minus,
    Star,
    Slash,
    Caret,
    Open,
    Close,
    Comma,
    End,
}

impl Kind<'_> {
    /// How an error message calls it.
    pub fn describe(self) -> String {
        let symbol = match self {
            Kind::Number(x) => return format!("the number {x}"),
            Kind::Name(name) => return format!("`{name}`"),
            Kind::End => return "the end".into(),
            Kind::Plus => '+',
            Kind::Minus => '-',
            Kind::Star => '*',
            Kind::Slash => '/',
            Kind::Caret => '^',
            Kind::Open => '(',
            Kind::Close => ')',
            Kind::Comma => ',',
        };
        format!("`{symbol}`")
    }
}

pub(super) struct Lexer<'a> {
    text: &'a str,
    offset: usize,
}

impl<'a> Lexer<'a> {
    pub fn new(text: &'a str) -> Self {
        Lexer { text, offset: 0 }
    }

    fn rest(&self) -> &'a str {
        self.text.get(self.offset..).unwrap_or("")
    }

    /// Takes `length` bytes, which end on a character.
    fn take(&mut self, length: usize) -> &'a str {
        let taken = self.rest().get(..length).unwrap_or("");
        self.offset += taken.len();
        taken
    }

    /// The next token; [`Kind::End`] for ever when the text is over.
    pub fn next(&mut self) -> Result<Token<'a>, ExpressionError> {
        let blank = self.rest().len() - self.rest().trim_start().len();
        self.take(blank);
        let start = self.offset;
        let Some(first) = self.rest().chars().next() else {
            return Ok(Token {
                kind: Kind::End,
                start,
            });
        };
        let kind = match first {
            '0'..='9' | '.' => self.number()?,
            'a'..='z' | 'A'..='Z' | '_' => {
                let length = self.count(|c| c.is_ascii_alphanumeric() || c == '_');
                Kind::Name(self.take(length))
            }
            _ => {
                let kind = match first {
                    '+' => Kind::Plus,
                    '-' => Kind::Minus,
                    '*' => Kind::Star,
                    '/' => Kind::Slash,
                    '^' => Kind::Caret,
                    '(' => Kind::Open,
                    ')' => Kind::Close,
                    ',' => Kind::Comma,
                    _ => return Err(self.stray(first)),
                };
                self.take(1);
                if kind == Kind::Star && self.rest().starts_with('*') {
                    return Err(self.error(start, "a power is written `^`, not `**`"));
                }
                kind
            }
        };
        Ok(Token { kind, start })
    }

    fn error(&self, start: usize, message: impl Into<String>) -> ExpressionError {
        ExpressionError::new(self.text, start, message)
    }

    fn stray(&self, c: char) -> ExpressionError {
        let cure = match c {
            '\u{2212}' | '\u{2013}' => "; minus is the plain `-`".into(),
            '·' | '×' | '∙' | '⋅' => "; a product is written `*`".into(),
            '÷' | ':' => "; a quotient is written `/`".into(),
            '²' => "; a square is written `^2`".into(),
            '[' | '{' | ']' | '}' => "; group with `(` and `)`".into(),
            '\'' | '\u{307}' => "; the velocity of `x` is written `x_dot`".into(),
            '=' | '<' | '>' | '!' | '?' | '&' | '|' => {
                "; an energy is a plain expression, without comparisons".into()
            }
            ';' => "; the arguments of a function are separated by `,`".into(),
            c if !c.is_ascii() && c.is_alphabetic() => {
                "; names have the letters a-z, A-Z, digits and `_`".into()
            }
            _ => String::new(),
        };
        self.error(
            self.offset,
            format!("unexpected character `{}`{cure}", c.escape_debug()),
        )
    }

    /// How many bytes from here on satisfy `keep`, all ASCII.
    fn count(&self, keep: impl Fn(char) -> bool) -> usize {
        self.rest()
            .chars()
            .take_while(|&c| c.is_ascii() && keep(c))
            .count()
    }

    /// `12`, `1.5`, `.5`, `2.`, `1e-3`.
    fn number(&mut self) -> Result<Kind<'a>, ExpressionError> {
        let start = self.offset;
        let whole = self.count(|c| c.is_ascii_digit());
        self.take(whole);
        let mut digits = whole;
        if self.rest().starts_with('.') {
            self.take(1);
            let fraction = self.count(|c| c.is_ascii_digit());
            self.take(fraction);
            digits += fraction;
        }
        if digits == 0 {
            return Err(self.error(start, "a lone `.` is not a number"));
        }
        if self.rest().starts_with(['e', 'E']) {
            let after = self.rest().get(1..).unwrap_or("");
            let sign = usize::from(after.starts_with(['+', '-']));
            let digits = after.get(sign..).unwrap_or("");
            let digits = digits.chars().take_while(char::is_ascii_digit).count();
            if digits == 0 {
                return Err(self.error(
                    start,
                    "the exponent of this number has no digits (write `1e3`; or `*` before the constant `e`)",
                ));
            }
            self.take(1 + sign + digits);
        }
        let text = self.text.get(start..self.offset).unwrap_or("");
        if self.rest().starts_with('.') {
            return Err(self.error(
                start,
                format!("`{text}.` is followed by a second decimal point"),
            ));
        }
        match text.parse::<f64>() {
            Ok(x) if x.is_finite() => Ok(Kind::Number(x)),
            _ => Err(self.error(
                start,
                format!("`{text}` is too large for a number (at most 1.8e308)"),
            )),
        }
    }
}
