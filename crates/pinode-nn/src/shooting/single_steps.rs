//! Roll-outs taken apart into their steps.

use integrators::Method;
use lagrange::LANES;
use rayon::prelude::*;

use super::eight::{EightRoller, Member, alike};
use super::{Diverged, Roller, Trajectory, Variation};
use crate::hybrid::{DrivenInputs, Eight, Hybrid, Memory};

impl Roller<'_> {
    /// As [`roll_with_sensitivities`](Self::roll_with_sensitivities), and keeps the single steps.
    pub(crate) fn roll_step_by_step(
        &mut self,
        theta: &[f64],
        member: &Member<'_>,
    ) -> Result<(Trajectory, Variation), Diverged> {
        let Member {
            inputs,
            span: (first, count),
            initial,
        } = *member;
        let nx = initial.len();
        let system = self.with_sensitivities(theta, inputs, initial);
        let substeps = inputs.grid.substeps;
        let mut kept = Kept::new(self.hybrid, member, self.columns());
        let mut middle = vec![0.0; nx];
        for sample in first..first + count - 1 {
            for step in sample * substeps..(sample + 1) * substeps {
                let (a, b) = (inputs.grid.bounds[step], inputs.grid.bounds[step + 1]);
                middle.copy_from_slice(&self.state[..nx]);
                unit(nx, &mut self.state[nx..]);
                let (state, memory) = (&mut self.state, &mut self.memory);
                Method::step(&mut self.rk4, &system, a, b - a, &step, memory, state)?;
                let (x, own) = self.state.split_at(nx);
                for (m, x) in middle.iter_mut().zip(x) {
                    *m = 0.5 * (*m + x);
                }
                kept.step(own);
                kept.middle(self.hybrid, (theta, inputs, step), &middle, memory);
                let state = self.hybrid.parts(&middle);
                self.hybrid
                    .linearize(state, theta, &[], inputs, step, memory)
                    .map_err(Diverged::Dynamics)?;
                kept.steps.responses.extend_from_slice(memory.response());
            }
            Diverged::check(&self.state[..nx])?;
            kept.sample(&self.state[..nx]);
        }
        Ok((kept.out, kept.steps))
    }
}

/// The derivatives of x in itself, and of nothing else: I, then zeros.
fn unit(nx: usize, s: &mut [f64]) {
    s.fill(0.0);
    (0..nx).for_each(|i| s[i * nx + i] = 1.0);
}

/// What is kept of the steps of a window.
struct Kept {
    out: Trajectory,
    steps: Variation,
    /// S of the roll-out so far, and room for the next.
    total: Vec<f64>,
    next: Vec<f64>,
}

impl Kept {
    fn new(hybrid: &Hybrid, member: &Member<'_>, columns: usize) -> Self {
        let nx = hybrid.nx();
        let mut total = vec![0.0; nx * columns];
        unit(nx, &mut total);
        Kept {
            out: Trajectory {
                states: member.initial.to_vec(),
                sensitivities: total.clone(),
            },
            steps: Variation {
                nx,
                nv: hybrid.nv(),
                first: member.span.0 * member.inputs.grid.substeps,
                ..Variation::default()
            },
            next: total.clone(),
            total,
        }
    }

    /// A step of the derivatives `own`: S_{i+1} = F S_i + ∂x_{i+1}/∂θ at fixed x_i. What stands behind those in θ is R.
    fn step(&mut self, own: &[f64]) {
        let (transition, by_theta) = own.split_at(self.steps.nx * self.steps.nx);
        let (by_theta, reaction) = by_theta.split_at(self.total.len() - transition.len());
        multiply(transition, &self.total, &mut self.next);
        for (to, own) in self.next[transition.len()..].iter_mut().zip(by_theta) {
            *to += own;
        }
        std::mem::swap(&mut self.total, &mut self.next);
        self.steps.transitions.extend_from_slice(transition);
        self.steps.reactions.extend_from_slice(reaction);
    }

    /// The state in the middle of a step, and the forces there.
    fn middle(
        &mut self,
        hybrid: &Hybrid,
        (theta, inputs, step): (&[f64], &DrivenInputs, usize),
        middle: &[f64],
        memory: &mut Memory,
    ) {
        let (force, rates) = hybrid.forces(hybrid.parts(middle), theta, inputs, step, memory);
        self.steps.forces.extend_from_slice(force);
        self.steps.forces.extend_from_slice(rates);
        self.steps.middles.extend_from_slice(middle);
    }

    /// A sample at x.
    fn sample(&mut self, x: &[f64]) {
        self.out.states.extend_from_slice(x);
        self.out.sensitivities.extend_from_slice(&self.total);
    }
}

/// `out` = A B for column-major A, n × n, and B, n × any.
fn multiply(a: &[f64], b: &[f64], out: &mut [f64]) {
    let n = a.len().isqrt();
    for (b, out) in b.chunks_exact(n).zip(out.chunks_exact_mut(n)) {
        out.fill(0.0);
        for (a, b) in a.chunks_exact(n).zip(b) {
            for (out, a) in out.iter_mut().zip(a) {
                *out += a * b;
            }
        }
    }
}

/// The roll-outs of windows, eight at once where the model is stiff, else one after the other; none where they diverge.
pub(crate) fn roll_steps(
    (hybrid, theta, free): (&Hybrid, &[f64], &[usize]),
    members: &[Member<'_>],
) -> Vec<Option<(Trajectory, Variation)>> {
    if !hybrid.is_stiff() {
        let one = |member: &Member| {
            let mut roller = Roller::new(hybrid, free);
            roller.roll_step_by_step(theta, member).ok()
        };
        return members.par_iter().map(one).collect();
    }
    let together = |members: &[Member]| {
        let mut roller = EightRoller::new(hybrid, free);
        roller.roll_step_by_step(theta, members).ok()
    };
    let alone = |member: &Member| together(std::slice::from_ref(member))?.pop();
    let of_group = |members: &[Member]| -> Vec<Option<(Trajectory, Variation)>> {
        match together(members) {
            Some(rolled) => rolled.into_iter().map(Some).collect(),
            None => members.iter().map(alone).collect(),
        }
    };
    let groups = alike(members, LANES).into_par_iter();
    groups.flat_map_iter(of_group).collect()
}

impl EightRoller<'_> {
    /// Steps up to eight windows of a stiff model; after each step `keep` sees of every window the step on its grid and whether it ends at a sample,
    /// x before the step, and (x, S) after it: S from a unit at its beginning, in the state, θ_free and the forces (Q, ḣ) along the step.
    fn each_step(
        &mut self,
        theta: &[f64],
        members: &[Member<'_>],
        mut keep: impl FnMut((usize, usize, bool), (&[f64], &[f64])),
    ) -> Result<(), Diverged> {
        let Some(last) = members.last() else {
            return Ok(());
        };
        let count = last.span.1;
        let own = members;
        let members: [&Member; LANES] = std::array::from_fn(|k| members.get(k).unwrap_or(last));
        let inputs = members.map(|member| member.inputs);
        let substeps = last.inputs.grid.substeps;
        let nx = self.hybrid.nx();
        let columns = 1 + nx + self.free.len() + nx - self.hybrid.nv();
        self.base.clear();
        self.base.resize(columns * nx, [0.0; LANES]);
        for i in 0..nx {
            self.base[i] = members.map(|member| member.initial[i]);
        }
        if let Some(stiff) = &mut self.stiff {
            stiff.forget();
        }
        let (mut before, mut after) = (vec![0.0; nx], vec![0.0; columns * nx]);
        let mut start = vec![[0.0; LANES]; nx];
        for sample in 0..count - 1 {
            for step in 0..substeps {
                let (x, s) = self.base.split_at_mut(nx);
                start.copy_from_slice(x);
                s.fill([0.0; LANES]);
                for diagonal in s.iter_mut().step_by(nx + 1).take(nx) {
                    *diagonal = [1.0; LANES];
                }
                let steps = members.map(|m| (m.span.0 + sample) * substeps + step);
                self.step(theta, &Eight { inputs, steps })?;
                for lane in 0..own.len() {
                    for (to, from) in before.iter_mut().zip(&start) {
                        *to = from[lane];
                    }
                    for (to, from) in after.iter_mut().zip(&self.base) {
                        *to = from[lane];
                    }
                    let place = (lane, steps[lane], step + 1 == substeps);
                    keep(place, (&before, &after));
                }
            }
            Diverged::check(self.base.as_flattened())?;
        }
        Ok(())
    }

    /// Up to eight windows of a stiff model, each with the single steps: as [`roll_all`](super::roll_all) with sensitivities.
    fn roll_step_by_step(
        &mut self,
        theta: &[f64],
        members: &[Member<'_>],
    ) -> Result<Vec<(Trajectory, Variation)>, Diverged> {
        let hybrid = self.hybrid;
        let columns = hybrid.nx() + self.free.len();
        let kept = |member: &Member| Kept::new(hybrid, member, columns);
        let mut kept: Vec<Kept> = members.iter().map(kept).collect();
        let mut memory = hybrid.memory(&[]);
        let mut middle = vec![0.0; hybrid.nx()];
        self.each_step(theta, members, |(lane, step, ends), (before, after)| {
            let (x, own) = after.split_at(middle.len());
            for ((m, x), before) in middle.iter_mut().zip(x).zip(before) {
                *m = 0.5 * (x + before);
            }
            kept[lane].step(own);
            let at = (theta, members[lane].inputs, step);
            kept[lane].middle(hybrid, at, &middle, &mut memory);
            if ends {
                kept[lane].sample(x);
            }
        })?;
        Ok(kept
            .into_iter()
            .map(|kept| (kept.out, kept.steps))
            .collect())
    }
}
