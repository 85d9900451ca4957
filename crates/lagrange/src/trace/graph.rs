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

/// Nodes without repetition, simplified as they are made.
#[derive(Debug, Clone, Default)]
pub struct Graph {
    nodes: Vec<Node>,
    known: HashMap<Node, Id>,
    /// Something asked for a value while there was none: the energies branch on their arguments.
    pub branched: bool,
}

impl Graph {
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

    fn put(&mut self, node: Node) -> Id {
        let next = self.nodes.len() as Id;
        *self.known.entry(node).or_insert_with(|| {
            self.nodes.push(node);
            next
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
            (Some(x), Some(y)) => return self.constant(x + y),
            (Some(0.0), None) => return b,
            (None, Some(0.0)) => return a,
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
            (Some(x), Some(y)) => return self.constant(x - y),
            (Some(0.0), None) => return self.negate(b),
            (None, Some(0.0)) => return a,
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
