//! The expression graph.

use std::collections::HashMap;

use crate::expression::{Binary, Unary};

/// A node, by its number; a node's arguments have smaller numbers.
pub type Id = u32;

/// One operation. Constants are kept by their bits, so that nodes can be looked up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Node {
    Constant(u64),
    Variable(u32),
    Add(Id, Id),
    Subtract(Id, Id),
    Multiply(Id, Id),
    Divide(Id, Id),
    Negate(Id),
    Powi(Id, i32),
    One(Unary, Id),
    Two(Binary, Id, Id),
}

/// Rounding of a few operations after one another.
const ROUNDING: f64 = 8.0 * f64::EPSILON;

/// Nodes without repetition, simplified as they are made.
#[derive(Debug, Clone, Default)]
pub struct Graph {
    nodes: Vec<Node>,
    known: HashMap<Node, Id>,
    /// Where rounding is left out: what each node cannot exceed in size, whatever the variables are; infinity where nothing is known.
    sizes: Option<Vec<f64>>,
    /// Something asked for a value while there was none: what is recorded branches on its arguments.
    pub branched: bool,
}

impl Graph {
    /// The same graph, to which sums are added without their terms of the size of rounding: those of at most 8 ε of what the term
    /// beside them can be, which is what its own last places are worth. This concerns terms of constants, sines and cosines;
    /// variables have no largest size, and neither have the terms that contain one.
    ///
    /// What is added is equal but for rounding to what it would be with all terms; its derivatives need not be.
    pub fn without_rounding(self) -> Self {
        let mut sizes = Vec::with_capacity(self.nodes.len());
        for &node in &self.nodes {
            sizes.push(largest(node, &sizes));
        }
        Graph {
            sizes: Some(sizes),
            ..self
        }
    }

    pub fn len(&self) -> usize {
        self.nodes.len()
    }

    pub fn node(&self, id: Id) -> Node {
        self.nodes[id as usize]
    }

    /// A copy of the first `count` nodes.
    pub fn first(&self, count: usize) -> Vec<Node> {
        self.nodes.iter().take(count).copied().collect()
    }

    /// How many nodes `roots` are made of.
    pub fn needed(&self, roots: &[Id]) -> usize {
        let mut needed = vec![false; self.nodes.len()];
        roots.iter().for_each(|&root| needed[root as usize] = true);
        super::derivative::mark_arguments(self, &mut needed);
        needed.iter().filter(|&&needed| needed).count()
    }

    /// The node's arguments.
    pub fn arguments(&self, id: Id) -> impl Iterator<Item = Id> {
        let (a, b) = match self.node(id) {
            Node::Constant(_) | Node::Variable(_) => (None, None),
            Node::Add(a, b)
            | Node::Subtract(a, b)
            | Node::Multiply(a, b)
            | Node::Divide(a, b)
            | Node::Two(_, a, b) => (Some(a), Some(b)),
            Node::Negate(a) | Node::Powi(a, _) | Node::One(_, a) => (Some(a), None),
        };
        a.into_iter().chain(b)
    }

    /// The node as it is, without simplification; its arguments are there.
    pub fn put(&mut self, node: Node) -> Id {
        let next = self.nodes.len() as Id;
        if let Some(&known) = self.known.get(&node) {
            return known;
        }
        if let Some(sizes) = &mut self.sizes {
            sizes.push(largest(node, sizes));
        }
        self.nodes.push(node);
        self.known.insert(node, next);
        next
    }

    /// Whether `a` is rounding in a sum with `b`.
    fn is_rounding(&self, a: Id, b: Id) -> bool {
        self.sizes.as_ref().is_some_and(|sizes| {
            let (a, b) = (sizes[a as usize], sizes[b as usize]);
            b.is_finite() && a <= ROUNDING * b
        })
    }

    /// The constant x + y.
    fn constant_sum(&mut self, x: f64, y: f64) -> Id {
        let sum = x + y;
        let cancelled = sum.abs() <= ROUNDING * x.abs().max(y.abs());
        self.constant(if cancelled && self.sizes.is_some() {
            0.0
        } else {
            sum
        })
    }

    pub fn constant(&mut self, x: f64) -> Id {
        // −0 and 0 are one constant.
        self.put(Node::Constant((x + 0.0).to_bits()))
    }

    pub fn variable(&mut self, index: u32) -> Id {
        self.put(Node::Variable(index))
    }

    /// The value of a constant node.
    pub fn value(&self, id: Id) -> Option<f64> {
        match self.node(id) {
            Node::Constant(bits) => Some(f64::from_bits(bits)),
            _ => None,
        }
    }

    pub fn add(&mut self, a: Id, b: Id) -> Id {
        match (self.value(a), self.value(b)) {
            (Some(x), Some(y)) => return self.constant_sum(x, y),
            (Some(0.0), None) => return b,
            (None, Some(0.0)) => return a,
            _ if self.is_rounding(a, b) => return b,
            _ if self.is_rounding(b, a) => return a,
            _ => {}
        }
        if a == b {
            let two = self.constant(2.0);
            return self.multiply(two, a);
        }
        match (self.node(a), self.node(b)) {
            (_, Node::Negate(y)) => self.subtract(a, y),
            (Node::Negate(x), _) => self.subtract(b, x),
            _ => self.put(Node::Add(a.min(b), a.max(b))),
        }
    }

    pub fn subtract(&mut self, a: Id, b: Id) -> Id {
        match (self.value(a), self.value(b)) {
            (Some(x), Some(y)) => return self.constant_sum(x, -y),
            (Some(0.0), None) => return self.negate(b),
            (None, Some(0.0)) => return a,
            _ if self.is_rounding(a, b) => return self.negate(b),
            _ if self.is_rounding(b, a) => return a,
            _ => {}
        }
        if a == b {
            return self.constant(0.0);
        }
        match self.node(b) {
            Node::Negate(y) => self.add(a, y),
            _ => self.put(Node::Subtract(a, b)),
        }
    }

    pub fn negate(&mut self, a: Id) -> Id {
        match self.node(a) {
            Node::Constant(bits) => self.constant(-f64::from_bits(bits)),
            Node::Negate(x) => x,
            Node::Subtract(x, y) => self.subtract(y, x),
            _ => self.put(Node::Negate(a)),
        }
    }

    pub fn multiply(&mut self, a: Id, b: Id) -> Id {
        match (self.value(a), self.value(b)) {
            (Some(x), Some(y)) => return self.constant(x * y),
            (None, Some(_)) => return self.multiply(b, a),
            (Some(0.0), None) => return a,
            (Some(1.0), None) => return b,
            (Some(-1.0), None) => return self.negate(b),
            _ => {}
        }
        match (self.node(a), self.node(b)) {
            (Node::Negate(x), _) => {
                let product = self.multiply(x, b);
                self.negate(product)
            }
            (_, Node::Negate(y)) => {
                let product = self.multiply(a, y);
                self.negate(product)
            }
            // Constants gather on the left: c (d x) = (c d) x, x (c y) = c (x y).
            (Node::Constant(_), Node::Multiply(c, x)) if self.value(c).is_some() => {
                let constant = self.multiply(a, c);
                self.multiply(constant, x)
            }
            (_, Node::Multiply(c, y)) if self.value(c).is_some() => {
                let product = self.multiply(a, y);
                self.multiply(c, product)
            }
            (Node::Multiply(c, x), _) if self.value(c).is_some() => {
                let product = self.multiply(x, b);
                self.multiply(c, product)
            }
            (Node::Constant(_), _) => self.put(Node::Multiply(a, b)),
            _ => self.put(Node::Multiply(a.min(b), a.max(b))),
        }
    }

    pub fn divide(&mut self, a: Id, b: Id) -> Id {
        match (self.value(a), self.value(b)) {
            (Some(x), Some(y)) => self.constant(x / y),
            (Some(0.0), None) => a,
            (None, Some(y)) => {
                let inverse = self.constant(1.0 / y);
                self.multiply(inverse, a)
            }
            _ => self.put(Node::Divide(a, b)),
        }
    }

    pub fn powi(&mut self, a: Id, n: i32) -> Id {
        match (self.value(a), n) {
            (Some(x), _) => self.constant(x.powi(n)),
            (None, 0) => self.constant(1.0),
            (None, 1) => a,
            (None, 2) => self.multiply(a, a),
            _ => self.put(Node::Powi(a, n)),
        }
    }

    pub fn one(&mut self, f: Unary, a: Id) -> Id {
        match (f, self.node(a)) {
            (_, Node::Constant(bits)) => self.constant(f.of(f64::from_bits(bits))),
            (Unary::Cos, Node::Negate(x)) => self.one(f, x),
            (Unary::Sin, Node::Negate(x)) => {
                let sine = self.one(f, x);
                self.negate(sine)
            }
            _ => self.put(Node::One(f, a)),
        }
    }

    pub fn two(&mut self, f: Binary, a: Id, b: Id) -> Id {
        match (f, self.value(a), self.value(b)) {
            // Not through the logarithm.
            (Binary::Pow, Some(x), Some(y)) => self.constant(x.powf(y)),
            (_, Some(x), Some(y)) => self.constant(f.of(x, y)),
            (Binary::Pow, None, Some(0.0)) => self.constant(1.0),
            (Binary::Pow, None, Some(1.0)) => a,
            (Binary::Min | Binary::Max, ..) if a == b => a,
            _ => self.put(Node::Two(f, a, b)),
        }
    }
}

/// What a node cannot exceed in size, given that of its arguments.
fn largest(node: Node, sizes: &[f64]) -> f64 {
    let of = |a: Id| sizes[a as usize];
    let size = match node {
        Node::Constant(bits) => f64::from_bits(bits).abs(),
        Node::Add(a, b) | Node::Subtract(a, b) => of(a) + of(b),
        Node::Multiply(a, b) => of(a) * of(b),
        Node::Negate(a) => of(a),
        Node::Powi(a, n) if n > 0 => of(a).powi(n),
        Node::One(Unary::Sin | Unary::Cos | Unary::Tanh | Unary::Sign, _) => 1.0,
        Node::Two(Binary::Min | Binary::Max, a, b) => of(a).max(of(b)),
        _ => f64::INFINITY,
    };
    // 0 times infinity
    if size.is_nan() { f64::INFINITY } else { size }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_term_below_the_last_places_of_the_other_goes_where_it_is_asked_for() {
        for without in [true, false] {
            let mut graph = Graph::default();
            let x = graph.variable(0);
            let sine = graph.one(Unary::Sin, x);
            if without {
                graph = graph.without_rounding();
            }
            let [large, tiny, small] = [9.81, 1e-16, 1e-13].map(|c| graph.constant(c));
            let weight = graph.multiply(large, sine);
            let gone =
                |graph: &Graph, id: Id, left: Id| assert_eq!(id == left, without, "{graph:?}");

            let sum = graph.add(weight, tiny);
            gone(&graph, sum, weight);
            let difference = graph.subtract(tiny, weight);
            let negative = graph.negate(weight);
            gone(&graph, difference, negative);
            // 0.1 + 0.2 − 0.3 = 5.6e-17
            let [a, b, c] = [0.1, 0.2, 0.3].map(|c| graph.constant(c));
            let sum = graph.add(a, b);
            let sum = graph.subtract(sum, c);
            let zero = graph.constant(0.0);
            gone(&graph, sum, zero);

            // Terms that are more, and those beside one of which nothing is known.
            let sum = graph.add(weight, small);
            assert!(matches!(graph.node(sum), Node::Add(..)));
            let sum = graph.add(x, tiny);
            assert!(matches!(graph.node(sum), Node::Add(..)));
        }
    }
}
