//! Forward differentiation of a graph, within the graph.

use super::graph::{Function, Graph, Id, Node};

/// The graph grew beyond what a program is worth.
#[derive(Debug)]
pub struct TooLarge;

/// ∂(root)/∂(variable) for each of `roots`; grows the graph by no more than `limit` nodes in all.
pub fn derivative(
    graph: &mut Graph,
    roots: &[Id],
    variable: u32,
    limit: usize,
) -> Result<Vec<Id>, TooLarge> {
    let zero = graph.constant(0.0);
    let top = roots.iter().max().map_or(0, |&id| id as usize + 1);
    let mut needed = vec![false; top];
    for &root in roots {
        needed[root as usize] = true;
    }
    mark_arguments(graph, &mut needed);
    // Arguments have smaller numbers: in ascending order they are done before they are asked for.
    let mut slope = vec![zero; top];
    for id in 0..top {
        if needed[id] {
            slope[id] = rule(graph, id as Id, variable, &slope, zero);
            if graph.len() > limit {
                return Err(TooLarge);
            }
        }
    }
    Ok(roots.iter().map(|&root| slope[root as usize]).collect())
}

/// Marks all that the marked nodes are made of. Arguments have smaller numbers than what is made of them.
pub fn mark_arguments(graph: &Graph, needed: &mut [bool]) {
    for id in (0..needed.len()).rev() {
        if needed[id] {
            for argument in graph.arguments(id as Id) {
                needed[argument as usize] = true;
            }
        }
    }
}

fn rule(graph: &mut Graph, id: Id, variable: u32, slope: &[Id], zero: Id) -> Id {
    let s = |a: Id| slope[a as usize];
    match graph.node(id) {
        Node::Constant(_) => zero,
        Node::Variable(index) if index == variable => graph.constant(1.0),
        Node::Variable(_) => zero,
        Node::Add(a, b) => graph.add(s(a), s(b)),
        Node::Subtract(a, b) => graph.subtract(s(a), s(b)),
        Node::Negate(a) => graph.negate(s(a)),
        Node::Multiply(a, b) => {
            let left = graph.multiply(s(a), b);
            let right = graph.multiply(a, s(b));
            graph.add(left, right)
        }
        Node::Divide(a, b) => {
            // (a/b)' = (a' − (a/b) b') / b
            let shrink = graph.multiply(id, s(b));
            let rest = graph.subtract(s(a), shrink);
            graph.divide(rest, b)
        }
        // A zero slope ends here: a derivative that is infinite elsewhere must not meet it.
        Node::Powi(a, _) | Node::Powf(a, _) | Node::Apply(_, a) if s(a) == zero => zero,
        Node::Powi(a, n) => {
            let power = graph.powi(a, n - 1);
            let factor = graph.constant(f64::from(n));
            let inner = graph.multiply(factor, power);
            graph.multiply(inner, s(a))
        }
        Node::Powf(a, bits) => {
            let n = f64::from_bits(bits);
            let power = graph.powf(a, n - 1.0);
            let factor = graph.constant(n);
            let inner = graph.multiply(factor, power);
            graph.multiply(inner, s(a))
        }
        Node::Atan2(y, x) => {
            // (x y' − y x') / (x² + y²)
            let (xx, yy) = (graph.multiply(x, x), graph.multiply(y, y));
            let square = graph.add(xx, yy);
            let (left, right) = (graph.multiply(x, s(y)), graph.multiply(y, s(x)));
            let top = graph.subtract(left, right);
            graph.divide(top, square)
        }
        Node::Apply(function, a) => {
            let slope = function_slope(graph, function, a, id);
            graph.multiply(slope, s(a))
        }
    }
}

/// The derivative of `function` at `a`; `value` is the node function(a).
fn function_slope(graph: &mut Graph, function: Function, a: Id, value: Id) -> Id {
    let one = graph.constant(1.0);
    match function {
        Function::Sin => graph.apply(Function::Cos, a),
        Function::Cos => {
            let sine = graph.apply(Function::Sin, a);
            graph.negate(sine)
        }
        Function::Tan => {
            let square = graph.multiply(value, value);
            graph.add(one, square)
        }
        Function::Asin | Function::Acos => {
            let square = graph.multiply(a, a);
            let rest = graph.subtract(one, square);
            let root = graph.apply(Function::Sqrt, rest);
            let slope = graph.divide(one, root);
            if function == Function::Asin {
                slope
            } else {
                graph.negate(slope)
            }
        }
        Function::Atan => {
            let square = graph.multiply(a, a);
            let sum = graph.add(one, square);
            graph.divide(one, sum)
        }
        Function::Sinh => graph.apply(Function::Cosh, a),
        Function::Cosh => graph.apply(Function::Sinh, a),
        Function::Tanh => {
            let square = graph.multiply(value, value);
            graph.subtract(one, square)
        }
        Function::Exp => value,
        Function::Ln => graph.divide(one, a),
        Function::Sqrt => {
            let half = graph.constant(0.5);
            graph.divide(half, value)
        }
        Function::Abs => graph.apply(Function::Sign, a),
        Function::Sign => graph.constant(0.0),
    }
}
