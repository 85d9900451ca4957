//! The expression graph.

use std::collections::HashMap;

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
    Powf(Id, u64),
    Atan2(Id, Id),
    Apply(Function, Id),
}

/// A function of one argument.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Function {
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

impl Function {
    pub fn of(self, x: f64) -> f64 {
        match self {
            Function::Sin => x.sin(),
            Function::Cos => x.cos(),
            Function::Tan => x.tan(),
            Function::Asin => x.asin(),
            Function::Acos => x.acos(),
            Function::Atan => x.atan(),
            Function::Sinh => x.sinh(),
            Function::Cosh => x.cosh(),
            Function::Tanh => x.tanh(),
            Function::Exp => x.exp(),
            Function::Ln => x.ln(),
            Function::Sqrt => x.sqrt(),
            Function::Abs => x.abs(),
            Function::Sign => {
                if x < 0.0 {
                    -1.0
                } else {
                    1.0
                }
            }
        }
    }
}

/// Nodes without repetition, simplified as they are made.
#[derive(Debug, Default)]
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

    /// The node's arguments.
    pub fn arguments(&self, id: Id) -> impl Iterator<Item = Id> {
        let (a, b) = match self.node(id) {
            Node::Constant(_) | Node::Variable(_) => (None, None),
            Node::Add(a, b)
            | Node::Subtract(a, b)
            | Node::Multiply(a, b)
            | Node::Divide(a, b)
            | Node::Atan2(a, b) => (Some(a), Some(b)),
            Node::Negate(a) | Node::Powi(a, _) | Node::Powf(a, _) | Node::Apply(_, a) => {
                (Some(a), None)
            }
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

    pub fn powf(&mut self, a: Id, n: f64) -> Id {
        match self.value(a) {
            Some(x) => self.constant(x.powf(n)),
            None if n == 0.0 => self.constant(1.0),
            None if n == 1.0 => a,
            None => self.put(Node::Powf(a, n.to_bits())),
        }
    }

    pub fn atan2(&mut self, y: Id, x: Id) -> Id {
        match (self.value(y), self.value(x)) {
            (Some(y), Some(x)) => self.constant(y.atan2(x)),
            _ => self.put(Node::Atan2(y, x)),
        }
    }

    pub fn apply(&mut self, function: Function, a: Id) -> Id {
        match self.value(a) {
            Some(x) => self.constant(function.of(x)),
            None => self.put(Node::Apply(function, a)),
        }
    }
}
