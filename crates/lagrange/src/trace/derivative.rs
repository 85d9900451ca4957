//! Differentiation of a graph, within the graph: forward along a direction, backward from one node.

use super::graph::{Graph, Id, Node};
use super::traced::{Traced, go_on, size};
use crate::Scalar;

/// The graph grew beyond what it is wanted for.
#[derive(Debug)]
pub struct TooLarge;

/// ∂(root)/∂(variable) for each of `roots`; the graph grows to no more than about `limit` nodes.
pub fn derivative(
    graph: &mut Graph,
    roots: &[Id],
    variable: u32,
    limit: usize,
) -> Result<Vec<Id>, TooLarge> {
    let one = graph.constant(1.0);
    along(graph, roots, &[(variable, one)], limit)
}

/// d(root)/ds for each of `roots`, where the variables of `direction` change at the rates given there; forward mode.
pub fn along(
    graph: &mut Graph,
    roots: &[Id],
    direction: &[(u32, Id)],
    limit: usize,
) -> Result<Vec<Id>, TooLarge> {
    let needed = needed_for(graph, roots);
    let nodes = graph.first(needed.len());
    go_on(graph, || {
        let zero = Traced::zero();
        // Arguments have smaller numbers: in ascending order they are done before they are asked for.
        let mut slope = vec![zero; nodes.len()];
        for (id, &node) in nodes.iter().enumerate() {
            if needed[id] {
                slope[id] = match node {
                    Node::Constant(_) => zero,
                    Node::Variable(index) => direction
                        .iter()
                        .find(|(variable, _)| *variable == index)
                        .map_or(zero, |&(_, rate)| Traced(rate)),
                    _ => rule(node, Traced(id as Id), &slope, zero),
                };
                if size() > limit {
                    return Err(TooLarge);
                }
            }
        }
        Ok(roots.iter().map(|&root| slope[root as usize].0).collect())
    })
}

/// ∂(root)/∂(variable) for each of `variables`, in one sweep from the root to its arguments; reverse mode.
pub fn gradient(
    graph: &mut Graph,
    root: Id,
    variables: &[u32],
    limit: usize,
) -> Result<Vec<Id>, TooLarge> {
    let needed = needed_for(graph, &[root]);
    let nodes = graph.first(needed.len());
    // Whether a node depends on one of the variables.
    let mut moves = vec![false; nodes.len()];
    for (id, node) in nodes.iter().enumerate() {
        moves[id] = match node {
            Node::Variable(index) => variables.contains(index),
            _ => graph.arguments(id as Id).any(|a| moves[a as usize]),
        };
    }
    go_on(graph, || {
        let zero = Traced::zero();
        // ∂(root)/∂(node), complete once all that is made of the node has been passed.
        let mut adjoint = vec![zero; nodes.len()];
        if let Some(last) = adjoint.last_mut() {
            *last = Traced::constant(1.0);
        }
        for (id, &node) in nodes.iter().enumerate().rev() {
            let weight = adjoint[id];
            if !needed[id] || !moves[id] || weight == zero {
                continue;
            }
            let mut give = |to: Id, slope: &dyn Fn() -> Traced| {
                let to = to as usize;
                if moves[to] {
                    adjoint[to] = adjoint[to] + slope();
                }
            };
            let value = Traced(id as Id);
            match node {
                Node::Constant(_) | Node::Variable(_) => {}
                Node::Add(a, b) => {
                    give(a, &|| weight);
                    give(b, &|| weight);
                }
                Node::Subtract(a, b) => {
                    give(a, &|| weight);
                    give(b, &|| -weight);
                }
                Node::Negate(a) => give(a, &|| -weight),
                Node::Multiply(a, b) => {
                    give(a, &|| weight * Traced(b));
                    give(b, &|| weight * Traced(a));
                }
                Node::Divide(a, b) => {
                    give(a, &|| weight / Traced(b));
                    give(b, &|| -(weight / Traced(b) * value));
                }
                Node::Powi(a, n) => give(a, &|| weight * powi_slope(Traced(a), n)),
                Node::One(f, a) => give(a, &|| weight * f.slope(Traced(a), value)),
                Node::Two(f, a, b) => {
                    give(a, &|| weight * f.slope_left(Traced(a), Traced(b)));
                    give(b, &|| weight * f.slope_right(Traced(a), Traced(b), value));
                }
            }
            if size() > limit {
                return Err(TooLarge);
            }
        }
        let of = |variable: &u32| {
            let place = nodes.iter().position(|n| *n == Node::Variable(*variable));
            place.map_or(zero, |id| adjoint[id]).0
        };
        Ok(variables.iter().map(of).collect())
    })
}

/// Which nodes up to the last of `roots` these are made of.
fn needed_for(graph: &Graph, roots: &[Id]) -> Vec<bool> {
    let mut needed = vec![false; roots.iter().max().map_or(0, |&id| id as usize + 1)];
    for &root in roots {
        needed[root as usize] = true;
    }
    mark_arguments(graph, &mut needed);
    needed
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

/// The slope of `node`, whose value is `value`, from the slopes of its arguments.
fn rule(node: Node, value: Traced, slope: &[Traced], zero: Traced) -> Traced {
    let s = |a: Id| slope[a as usize];
    match node {
        Node::Constant(_) | Node::Variable(_) => zero,
        Node::Add(a, b) => s(a) + s(b),
        Node::Subtract(a, b) => s(a) - s(b),
        Node::Negate(a) => -s(a),
        Node::Multiply(a, b) => s(a) * Traced(b) + Traced(a) * s(b),
        // (a/b)' = (a' − (a/b) b') / b
        Node::Divide(a, b) => (s(a) - value * s(b)) / Traced(b),
        // A zero slope ends here: a derivative that is infinite elsewhere must not meet it.
        Node::Powi(a, _) | Node::One(_, a) if s(a) == zero => zero,
        Node::Powi(a, n) => powi_slope(Traced(a), n) * s(a),
        Node::One(f, a) => f.slope(Traced(a), value) * s(a),
        Node::Two(f, a, b) => {
            let (x, y) = (Traced(a), Traced(b));
            let mut sum = zero;
            if s(a) != zero {
                sum = sum + f.slope_left(x, y) * s(a);
            }
            if s(b) != zero {
                sum = sum + f.slope_right(x, y, value) * s(b);
            }
            sum
        }
    }
}

/// n xⁿ⁻¹
fn powi_slope(x: Traced, n: i32) -> Traced {
    x.powi(n - 1) * f64::from(n)
}
