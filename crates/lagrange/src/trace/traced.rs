//! A scalar that writes down what is computed with it.

use std::cell::RefCell;
use std::ops::{Add, Div, Mul, Neg, Sub};

use super::graph::{Graph, Id};
use crate::Scalar;
use crate::expression::{Binary, Unary};

thread_local! {
    static GRAPH: RefCell<Graph> = RefCell::new(Graph::default());
}

/// A number that is not computed but written down, in the graph of this thread: what a function over [`Scalar`] is [recorded](crate::Recorded) by.
///
/// It belongs to the record in which it was made: in another one, on another thread or after its end it stands for another number. Two are equal where the
/// same is written down, whatever the values are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Traced(pub(crate) Id);

/// Runs `record` on a fresh graph of this thread; returns the graph and what `record` returned.
pub fn trace<T>(record: impl FnOnce() -> T) -> (Graph, T) {
    let mut graph = Graph::default();
    let result = go_on(&mut graph, record);
    (graph, result)
}

/// Runs `record`, which adds to `graph`.
pub fn go_on<T>(graph: &mut Graph, record: impl FnOnce() -> T) -> T {
    let outer = GRAPH.with(|here| here.replace(std::mem::take(graph)));
    let result = record();
    *graph = GRAPH.with(|here| here.replace(outer));
    result
}

/// Number of nodes of this thread's graph.
pub fn size() -> usize {
    GRAPH.with(|graph| graph.borrow().len())
}

/// The variable with this index.
pub fn variable(index: usize) -> Traced {
    with(|graph| graph.variable(index as u32))
}

fn with(f: impl FnOnce(&mut Graph) -> Id) -> Traced {
    GRAPH.with(|graph| Traced(f(&mut graph.borrow_mut())))
}

macro_rules! operator {
    ($trait:ident, $method:ident, $node:ident) => {
        impl $trait for Traced {
            type Output = Traced;
            fn $method(self, other: Traced) -> Traced {
                with(|graph| graph.$node(self.0, other.0))
            }
        }
        impl $trait<f64> for Traced {
            type Output = Traced;
            fn $method(self, other: f64) -> Traced {
                with(|graph| {
                    let other = graph.constant(other);
                    graph.$node(self.0, other)
                })
            }
        }
    };
}

operator!(Add, add, add);
operator!(Sub, sub, subtract);
operator!(Mul, mul, multiply);
operator!(Div, div, divide);

impl Neg for Traced {
    type Output = Traced;
    fn neg(self) -> Traced {
        with(|graph| graph.negate(self.0))
    }
}

macro_rules! functions {
    ($($method:ident: $function:ident),*) => {
        $(fn $method(self) -> Self {
            with(|graph| graph.one(Unary::$function, self.0))
        })*
    };
}

macro_rules! functions_of_two {
    ($($method:ident: $function:ident),*) => {
        $(fn $method(self, other: Self) -> Self {
            with(|graph| graph.two(Binary::$function, self.0, other.0))
        })*
    };
}

impl Scalar for Traced {
    fn constant(x: f64) -> Self {
        with(|graph| graph.constant(x))
    }

    /// There is no value yet. Who asks means to branch, and a trace of one branch is no formula for the other.
    fn re(self) -> f64 {
        GRAPH.with(|graph| {
            let graph = &mut *graph.borrow_mut();
            graph.value(self.0).unwrap_or_else(|| {
                graph.branched = true;
                f64::NAN
            })
        })
    }

    functions!(
        sin: Sin, cos: Cos, tan: Tan, asin: Asin, acos: Acos, atan: Atan, sinh: Sinh, cosh: Cosh, tanh: Tanh, exp: Exp,
        ln: Ln, sqrt: Sqrt, abs: Abs, sign: Sign
    );
    functions_of_two!(atan2: Atan2, min: Min, max: Max, pow: Pow);

    fn sin_cos(self) -> (Self, Self) {
        (self.sin(), self.cos())
    }

    fn powi(self, n: i32) -> Self {
        with(|graph| graph.powi(self.0, n))
    }

    fn powf(self, n: f64) -> Self {
        self.pow(Self::constant(n))
    }
}
