//! The parsed expression: operations in postfix order.

use super::{Binary, Unary};
use crate::Scalar;

/// What makes one value of two.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Operator {
    Add,
    Sub,
    Mul,
    Div,
    Two(Binary),
}

impl Operator {
    fn of<D: Scalar>(self, a: D, b: D) -> D {
        match self {
            Operator::Add => a + b,
            Operator::Sub => a - b,
            Operator::Mul => a * b,
            Operator::Div => a / b,
            Operator::Two(f) => f.of(a, b),
        }
    }
}

/// `b` as an integer power, if it is one of moderate size.
fn integer(b: f64) -> Option<i32> {
    (b.fract() == 0.0 && b.abs() <= 1000.0).then_some(b as i32)
}

fn constant_power<D: Scalar>(a: D, b: f64) -> D {
    match integer(b) {
        Some(n) => a.powi(n),
        None => a.powf(b),
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Op {
    Constant(f64),
    Variable(u32),
    Negate,
    Unary(Unary),
    Operator(Operator),
    // One constant operand: cheaper on dual numbers than a constant lifted to one.
    AddConstant(f64),
    MulConstant(f64),
    DivConstant(f64),
    Powi(i32),
    Powf(f64),
}

/// Operations in postfix order; constants are folded.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Tape {
    ops: Vec<Op>,
    /// Most values alive at once.
    depth: usize,
}

/// Depths up to here are evaluated on the stack of the thread; deeper ones on the heap.
const INLINE: usize = 32;

impl Tape {
    pub fn ops(&self) -> &[Op] {
        &self.ops
    }

    /// The value, with `variable(slot)` for the variables.
    pub fn evaluate<D: Scalar>(&self, variable: impl Fn(usize) -> D) -> D {
        // Several sizes, because filling the array costs as much as a short tape when D is wide.
        match self.depth {
            0..=4 => self.run(&mut [D::zero(); 4], variable),
            5..=8 => self.run(&mut [D::zero(); 8], variable),
            9..=INLINE => self.run(&mut [D::zero(); INLINE], variable),
            depth => self.run(&mut vec![D::zero(); depth], variable),
        }
    }

    fn run<D: Scalar>(&self, stack: &mut [D], variable: impl Fn(usize) -> D) -> D {
        let mut height = 0;
        for &op in &self.ops {
            match op {
                Op::Constant(c) => {
                    stack[height] = D::constant(c);
                    height += 1;
                }
                Op::Variable(slot) => {
                    stack[height] = variable(slot as usize);
                    height += 1;
                }
                Op::Operator(f) => {
                    height -= 1;
                    stack[height - 1] = f.of(stack[height - 1], stack[height]);
                }
                Op::Negate => stack[height - 1] = -stack[height - 1],
                Op::Unary(f) => stack[height - 1] = f.of(stack[height - 1]),
                Op::AddConstant(c) => stack[height - 1] = stack[height - 1] + c,
                Op::MulConstant(c) => stack[height - 1] = stack[height - 1] * c,
                Op::DivConstant(c) => stack[height - 1] = stack[height - 1] / c,
                Op::Powi(n) => stack[height - 1] = stack[height - 1].powi(n),
                Op::Powf(b) => stack[height - 1] = stack[height - 1].powf(b),
            }
        }
        stack[0]
    }

    /// The same with constants in the slots where `value` has one.
    pub fn bind(&self, value: impl Fn(usize) -> Option<f64>) -> Tape {
        let mut b = Builder::default();
        for &op in &self.ops {
            match op {
                Op::Constant(c) => b.constant(c),
                Op::Variable(slot) => match value(slot as usize) {
                    Some(c) => b.constant(c),
                    None => b.variable(slot as usize),
                },
                Op::Negate => b.negate(),
                Op::Unary(f) => b.unary(f),
                Op::Operator(f) => b.operator(f),
                Op::AddConstant(c) => b.with_constant(Operator::Add, c),
                Op::MulConstant(c) => b.with_constant(Operator::Mul, c),
                Op::DivConstant(c) => b.with_constant(Operator::Div, c),
                Op::Powi(n) => b.with_constant(Operator::Two(Binary::Pow), f64::from(n)),
                Op::Powf(c) => b.with_constant(Operator::Two(Binary::Pow), c),
            }
        }
        b.finish()
    }
}

/// Writes a tape operand by operand, operation after operands.
#[derive(Debug, Default)]
pub(super) struct Builder {
    ops: Vec<Op>,
    /// For every value that is on the stack by now, where its operations begin.
    starts: Vec<usize>,
}

impl Builder {
    pub fn constant(&mut self, c: f64) {
        self.starts.push(self.ops.len());
        self.ops.push(Op::Constant(c));
    }

    pub fn variable(&mut self, slot: usize) {
        self.starts.push(self.ops.len());
        self.ops.push(Op::Variable(slot as u32));
    }

    pub fn negate(&mut self) {
        match self.ops.last_mut() {
            Some(Op::Constant(c)) => *c = -*c,
            _ => self.ops.push(Op::Negate),
        }
    }

    pub fn unary(&mut self, f: Unary) {
        match self.ops.last_mut() {
            Some(Op::Constant(c)) => *c = f.of(*c),
            _ => self.ops.push(Op::Unary(f)),
        }
    }

    pub fn operator(&mut self, f: Operator) {
        let Some(right) = self.starts.pop() else {
            return;
        };
        let left = self.starts.last().copied().unwrap_or(0);
        match (
            self.lone_constant(left, right),
            self.lone_constant(right, self.ops.len()),
        ) {
            (Some(a), Some(b)) => {
                self.ops.truncate(left);
                self.ops.push(Op::Constant(match f {
                    Operator::Two(Binary::Pow) => constant_power(a, b),
                    _ => f.of(a, b),
                }));
            }
            (None, Some(b)) => {
                let op = match f {
                    Operator::Add => Op::AddConstant(b),
                    Operator::Sub => Op::AddConstant(-b),
                    Operator::Mul => Op::MulConstant(b),
                    Operator::Div => Op::DivConstant(b),
                    Operator::Two(Binary::Pow) => integer(b).map_or(Op::Powf(b), Op::Powi),
                    Operator::Two(_) => {
                        self.ops.push(Op::Operator(f));
                        return;
                    }
                };
                self.ops.pop();
                self.ops.push(op);
            }
            (Some(a), None) if matches!(f, Operator::Add | Operator::Sub | Operator::Mul) => {
                self.ops.remove(left);
                match f {
                    Operator::Mul => self.ops.push(Op::MulConstant(a)),
                    Operator::Sub => {
                        self.ops.push(Op::Negate);
                        self.ops.push(Op::AddConstant(a));
                    }
                    _ => self.ops.push(Op::AddConstant(a)),
                }
            }
            _ => self.ops.push(Op::Operator(f)),
        }
    }

    fn with_constant(&mut self, f: Operator, c: f64) {
        self.constant(c);
        self.operator(f);
    }

    /// The constant that the operations `from..to` are, if they are no more than that.
    fn lone_constant(&self, from: usize, to: usize) -> Option<f64> {
        match self.ops.get(from..to) {
            Some([Op::Constant(c)]) => Some(*c),
            _ => None,
        }
    }

    /// The constant that was written last, if the last value is one.
    pub fn last_constant(&self) -> Option<f64> {
        match self.ops.last() {
            Some(Op::Constant(c)) => Some(*c),
            _ => None,
        }
    }

    pub fn finish(self) -> Tape {
        let (mut height, mut depth) = (0_usize, 1);
        for op in &self.ops {
            match op {
                Op::Constant(_) | Op::Variable(_) => height += 1,
                Op::Operator(_) => height -= 1,
                _ => {}
            }
            depth = depth.max(height);
        }
        Tape {
            ops: self.ops,
            depth,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tape(build: impl Fn(&mut Builder)) -> Tape {
        let mut b = Builder::default();
        build(&mut b);
        b.finish()
    }

    #[test]
    fn constants_are_folded_on_both_sides() {
        // 2 * (3 + 4) * x - 1
        let t = tape(|b| {
            b.constant(2.0);
            b.constant(3.0);
            b.constant(4.0);
            b.operator(Operator::Add);
            b.operator(Operator::Mul);
            b.variable(0);
            b.operator(Operator::Mul);
            b.constant(1.0);
            b.operator(Operator::Sub);
        });
        assert_eq!(
            t.ops,
            [
                Op::Variable(0),
                Op::MulConstant(14.0),
                Op::AddConstant(-1.0)
            ]
        );
        assert_eq!(t.depth, 1);
        assert_eq!(t.evaluate(|_| 0.5), 6.0);
    }

    #[test]
    fn binding_every_variable_leaves_one_constant() {
        // (x - y)^x with x = 3, y = 1
        let t = tape(|b| {
            b.variable(0);
            b.variable(1);
            b.operator(Operator::Sub);
            b.variable(0);
            b.operator(Operator::Two(Binary::Pow));
        });
        let bound = t.bind(|slot| Some([3.0, 1.0][slot]));
        assert_eq!(bound.ops, [Op::Constant(8.0)]);
        assert_eq!(
            t.bind(|slot| (slot == 1).then_some(1.0)).evaluate(|_| 3.0),
            t.evaluate(|slot| [3.0, 1.0][slot])
        );
    }

    #[test]
    fn nan_wins_over_every_number_in_min_and_max() {
        for f in [Binary::Min, Binary::Max] {
            assert!(f.of(f64::NAN, 1.0).is_nan());
            assert!(f.of(1.0, f64::NAN).is_nan());
        }
        assert_eq!(Binary::Min.of(1.0, 2.0), 1.0);
        assert_eq!(Binary::Max.of(1.0, 2.0), 2.0);
    }
}
