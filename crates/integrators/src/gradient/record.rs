//! What a step leaves behind for its derivative.

use crate::{Differentiable, Jacobian, Space, System};

/// A system that records where its rate is asked for, in the order of the calls: a method then steps as ever, to the bit.
pub(crate) struct Recorded<'a, S>(pub &'a S);

/// The memory of the system, and the record: for every call the state and, of the rate, the curved directions.
pub(crate) struct Tape<M> {
    pub memory: M,
    pub record: Vec<f64>,
    /// Where the next call goes.
    pub at: usize,
}

impl<M> Tape<M> {
    /// Writes numbers behind the last ones.
    pub fn push(&mut self, numbers: &[f64]) {
        let end = self.at + numbers.len();
        if let Some(place) = self.record.get_mut(self.at..end) {
            place.copy_from_slice(numbers);
        }
        self.at = end;
    }
}

/// Numbers that one step of `stages` calls leaves. Where space is not flat, the state where it begins comes first: a chart's zero is that
/// state but for rounding.
pub(crate) fn numbers_per_step<P: Space>(space: &P, stages: usize) -> usize {
    before_calls(space) + stages * numbers_per_call(space)
}

/// Numbers of a step before those of its calls.
pub(crate) fn before_calls<P: Space>(space: &P) -> usize {
    if space.is_flat() { 0 } else { space.dim() }
}

/// Numbers that one call leaves.
pub(crate) fn numbers_per_call<P: Space>(space: &P) -> usize {
    space.dim() + space.curved().len()
}

impl<S: System> System for Recorded<'_, S> {
    type Space = S::Space;
    type Input = S::Input;
    type Memory = Tape<S::Memory>;
    type Error = S::Error;

    fn space(&self) -> &S::Space {
        self.0.space()
    }

    fn memory(&self) -> Self::Memory {
        Tape {
            memory: self.0.memory(),
            record: Vec::new(),
            at: 0,
        }
    }

    fn rate(
        &self,
        t: f64,
        x: &[f64],
        u: &S::Input,
        tape: &mut Self::Memory,
        dx: &mut [f64],
    ) -> Result<(), S::Error> {
        self.0.rate(t, x, u, &mut tape.memory, dx)?;
        tape.push(x);
        tape.push(&dx[self.space().curved()]);
        Ok(())
    }
}

/// A system whose rate is taken from its linearisation, which is kept.
pub(crate) struct Linearized<'a, S>(pub &'a S);

/// The memory of the system, and the rates and derivatives of the calls of one step.
pub(crate) struct Stages<M> {
    pub memory: M,
    pub rates: Vec<Vec<f64>>,
    pub by: Vec<Jacobian>,
    /// The number of the next call.
    pub at: usize,
}

impl<S: Differentiable> System for Linearized<'_, S> {
    type Space = S::Space;
    type Input = S::Input;
    type Memory = Stages<S::Memory>;
    type Error = S::Error;

    fn space(&self) -> &S::Space {
        self.0.space()
    }

    fn memory(&self) -> Self::Memory {
        Stages {
            memory: self.0.memory(),
            rates: Vec::new(),
            by: Vec::new(),
            at: 0,
        }
    }

    fn rate(
        &self,
        t: f64,
        x: &[f64],
        u: &S::Input,
        stages: &mut Self::Memory,
        dx: &mut [f64],
    ) -> Result<(), S::Error> {
        if stages.at == stages.by.len() {
            stages.by.push(Jacobian::zeros(self.0));
            stages.rates.push(vec![0.0; dx.len()]);
        }
        let at = stages.at;
        self.0
            .linearize((t, x, u), &mut stages.memory, dx, &mut stages.by[at])?;
        stages.rates[at].copy_from_slice(dx);
        stages.at += 1;
        Ok(())
    }
}
