//! Functions of several numbers, recorded once: their values and derivatives as straight-line programs.

use std::collections::BTreeSet;

use super::derivative::derivative;
use super::graph::Id;
use super::program::Program;
use super::traced::{Traced, trace, variable};
use crate::lanes::{LANES, Lanes};
use crate::processor::Processor;

/// A graph larger than this, with all derivatives, is given up.
const MOST_NODES: usize = 20_000;

/// y = f(x), f written over [`Scalar`](crate::Scalar), as a program for y and one for y and those of ∂y/∂x that are not zero by the shape of f.
///
/// A program knows what f multiplies by zero or one and what it computes twice; dual numbers carry all derivatives through every operation. On eight
/// states at once it uses the vectors of the processor.
///
/// ```
/// use lagrange::{LANES, Recorded, RecordedMemory, Scalar};
///
/// /// Stribeck's friction of the speed v: f = −(c + (s − c) e^(−v²)) tanh(100 v), and its power.
/// fn friction<D: Scalar>(x: &[D]) -> Vec<D> {
///     let [v, c, s] = x else { return Vec::new() };
///     let force = -(*c + (*s - *c) * (-*v * *v).exp()) * (*v * 100.0).tanh();
///     vec![force, force * *v]
/// }
///
/// let recorded = Recorded::of(3, 0..2, friction).ok_or("it branches")?;
/// let mut memory = RecordedMemory::default();
/// let x = [0.2, 0.3, 0.5];
/// let y: Vec<f64> = recorded.values([0.2, 0.3, 0.5], &mut memory).collect();
/// assert_eq!(y, friction(&x));
/// // ∂y_i/∂x_k: in v and c, which were asked for.
/// for (row, column, value) in recorded.parts(x, &mut memory) {
///     let Some(column) = column else {
///         assert_eq!(value, y[row]);
///         continue;
///     };
///     let mut there = x;
///     there[column] += 1e-7;
///     let slope = (friction(&there)[row] - y[row]) / 1e-7;
///     assert!((value - slope).abs() < 1e-6);
/// }
/// let eight = x.map(|x| [x; LANES]);
/// assert!(recorded.values_lanes(eight, &mut memory).zip(&y).all(|(all, y)| all.iter().all(|x| (x - y).abs() < 1e-14)));
/// # Ok::<(), &str>(())
/// ```
#[derive(Debug, Clone)]
pub struct Recorded {
    values: Program,
    parts: Program,
    /// What the outputs of `parts` are: y_row, or its derivative in x_column.
    places: Vec<(usize, Option<usize>)>,
}

/// Memory of one thread for the calls of any [`Recorded`]; it grows to what the largest needs.
#[derive(Debug, Clone)]
pub struct RecordedMemory {
    single: Vec<f64>,
    lanes: Vec<Lanes<true>>,
    processor: Processor,
}

impl Default for RecordedMemory {
    fn default() -> Self {
        RecordedMemory {
            single: Vec::new(),
            lanes: Vec::new(),
            processor: Processor::here(),
        }
    }
}

impl Recorded {
    /// Records what `function` computes of so many `inputs`, and its derivatives in those of `columns`. `None` where it decides by the value of a number
    /// ([`Scalar::re`](crate::Scalar::re) is NaN there, and it has to come to an end all the same), and where it is too long. Columns that are not there are
    /// left out. All numbers that `function` uses have to come from its arguments and from constants that it makes itself: see [`Traced`].
    pub fn of(
        inputs: usize,
        columns: impl IntoIterator<Item = usize>,
        function: impl FnOnce(&[Traced]) -> Vec<Traced>,
    ) -> Option<Self> {
        let (mut graph, outputs) = trace(|| {
            let x: Vec<Traced> = (0..inputs).map(variable).collect();
            function(&x)
        });
        if graph.branched || graph.len() > MOST_NODES {
            return None;
        }
        let mut roots: Vec<Id> = outputs.iter().map(|y| y.0).collect();
        let values = Program::new(&graph, inputs, &roots);
        let mut places: Vec<(usize, Option<usize>)> =
            (0..roots.len()).map(|row| (row, None)).collect();
        let zero = graph.constant(0.0);
        let outputs = roots.clone();
        let columns: BTreeSet<usize> = columns.into_iter().collect();
        for &column in columns.range(..inputs) {
            let slopes = derivative(&mut graph, &outputs, column as u32, MOST_NODES).ok()?;
            for (row, slope) in slopes.into_iter().enumerate() {
                if slope != zero {
                    places.push((row, Some(column)));
                    roots.push(slope);
                }
            }
        }
        Some(Recorded {
            values,
            parts: Program::new(&graph, inputs, &roots),
            places,
        })
    }

    /// Number of rows of y.
    pub fn outputs(&self) -> usize {
        self.values.outputs_len()
    }

    /// y; x as long as there are inputs, NaN where it is shorter.
    pub fn values<'a>(
        &'a self,
        x: impl IntoIterator<Item = f64>,
        memory: &'a mut RecordedMemory,
    ) -> impl Iterator<Item = f64> + 'a {
        run(&self.values, x, memory)
    }

    /// y and its derivatives: row of y, column of x or none for y itself, and the number. What is not there is zero.
    pub fn parts<'a>(
        &'a self,
        x: impl IntoIterator<Item = f64>,
        memory: &'a mut RecordedMemory,
    ) -> impl Iterator<Item = (usize, Option<usize>, f64)> + 'a {
        let all = run(&self.parts, x, memory);
        let places = self.places.iter().zip(all);
        places.map(|(&(row, column), part)| (row, column, part))
    }

    /// [`values`](Self::values) of eight states.
    pub fn values_lanes<'a>(
        &'a self,
        x: impl IntoIterator<Item = [f64; LANES]>,
        memory: &'a mut RecordedMemory,
    ) -> impl Iterator<Item = [f64; LANES]> + 'a {
        put(&self.values, x, &mut memory.lanes);
        self.values.run_on(memory.processor, &mut memory.lanes);
        self.values.lane_outputs(&memory.lanes)
    }

    /// [`parts`](Self::parts) of eight states.
    pub fn parts_lanes<'a>(
        &'a self,
        x: impl IntoIterator<Item = [f64; LANES]>,
        memory: &'a mut RecordedMemory,
    ) -> impl Iterator<Item = (usize, Option<usize>, [f64; LANES])> + 'a {
        put(&self.parts, x, &mut memory.lanes);
        self.parts.run_on(memory.processor, &mut memory.lanes);
        let all = self.parts.lane_outputs(&memory.lanes);
        let places = self.places.iter().zip(all);
        places.map(|(&(row, column), part)| (row, column, part))
    }
}

fn run<'a>(
    program: &'a Program,
    x: impl IntoIterator<Item = f64>,
    memory: &'a mut RecordedMemory,
) -> impl Iterator<Item = f64> + 'a {
    let registers = &mut memory.single;
    if registers.len() < program.size() {
        registers.resize(program.size(), 0.0);
    }
    let mut x = x.into_iter();
    registers[..program.inputs()].fill_with(|| x.next().unwrap_or(f64::NAN));
    program.put_constants(registers);
    program.run(registers);
    program.outputs(registers)
}

/// Puts the inputs in their place; of those that are missing nothing is known.
fn put(program: &Program, x: impl IntoIterator<Item = [f64; LANES]>, lanes: &mut Vec<Lanes<true>>) {
    if lanes.len() < program.size() {
        lanes.resize(program.size(), Lanes([0.0; LANES]));
    }
    let mut x = x.into_iter();
    lanes[..program.inputs()].fill_with(|| Lanes(x.next().unwrap_or([f64::NAN; LANES])));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Scalar;

    #[test]
    fn what_decides_by_a_number_has_no_record() {
        let branching = |x: &[Traced]| match x[0].re() > 0.0 {
            true => vec![x[0]],
            false => vec![x[0] * x[0]],
        };
        assert!(Recorded::of(1, 0..1, branching).is_none());
        assert!(Recorded::of(1, 0..1, |x: &[Traced]| vec![x[0].abs()]).is_some());
    }

    #[test]
    fn derivatives_are_listed_where_they_are_not_zero_and_in_the_columns_asked_for() {
        let function = |x: &[Traced]| vec![x[0] * x[1], x[2] + 3.0];
        let recorded = Recorded::of(3, [1, 2, 7], function).map(|r| r.places);
        let expected = [(0, None), (1, None), (0, Some(1)), (1, Some(2))];
        assert_eq!(recorded.as_deref(), Some(&expected[..]));
    }
}
