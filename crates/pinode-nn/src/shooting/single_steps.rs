//! Roll-outs taken apart into their steps.

use integrators::Method;
use lagrange::LANES;
use rayon::prelude::*;

use super::eight::{EightRoller, Member};
use super::{Diverged, Roller, Trajectory, Variation};
use crate::hybrid::{DrivenInputs, Eight, Hybrid, Memory};

impl Roller<'_> {
    /// As [`roll_with_sensitivities`](Self::roll_with_sensitivities), and keeps the single steps.
    pub fn roll_step_by_step(
        &mut self,
        theta: &[f64],
        inputs: &DrivenInputs,
        (first, count): (usize, usize),
        initial: &[f64],
        out: &mut Trajectory,
        steps: &mut Variation,
    ) -> Result<(), Diverged> {
        let nx = initial.len();
        let system = self.with_sensitivities(theta, inputs, initial);
        let substeps = inputs.grid.substeps;
        *steps = Variation {
            nx,
            nv: self.hybrid.nv(),
            first: first * substeps,
            ..Variation::default()
        };
        let unit = |to: &mut [f64]| {
            to.fill(0.0);
            (0..nx).for_each(|i| to[i * nx + i] = 1.0);
        };
        let mut total = vec![0.0; nx * self.columns()];
        unit(&mut total);
        let mut next = total.clone();
        let mut middle = vec![0.0; nx];
        out.states.clear();
        out.sensitivities.clear();
        out.states.extend_from_slice(initial);
        out.sensitivities.extend_from_slice(&total);
        for sample in first..first + count - 1 {
            for step in sample * substeps..(sample + 1) * substeps {
                let (a, b) = (inputs.grid.bounds[step], inputs.grid.bounds[step + 1]);
                middle.copy_from_slice(&self.state[..nx]);
                unit(&mut self.state[nx..]);
                let (state, memory) = (&mut self.state, &mut self.memory);
                Method::step(&mut self.rk4, &system, a, b - a, &step, memory, state)?;
                let (x, own) = self.state.split_at(nx);
                for (m, x) in middle.iter_mut().zip(x) {
                    *m = 0.5 * (*m + x);
                }
                // S_{i+1} = F S_i + ∂x_{i+1}/∂θ at fixed x_i.
                let (transition, by_theta) = own.split_at(nx * nx);
                multiply(transition, &total, &mut next);
                for (to, own) in next[nx * nx..].iter_mut().zip(by_theta) {
                    *to += own;
                }
                std::mem::swap(&mut total, &mut next);
                steps.transitions.extend_from_slice(transition);
                steps.keep_middle(self.hybrid, (theta, inputs, step), &middle, memory)?;
            }
            Diverged::check(&self.state[..nx])?;
            out.states.extend_from_slice(&self.state[..nx]);
            out.sensitivities.extend_from_slice(&total);
        }
        Ok(())
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
    let alike = |member: &Member| (member.span.1, member.inputs.grid.substeps);
    let most = if hybrid.is_stiff() { LANES } else { 1 };
    let groups: Vec<&[Member]> = members
        .chunk_by(|a, b| alike(a) == alike(b))
        .flat_map(|alike| alike.chunks(most))
        .collect();
    let of_group = |members: &[Member]| -> Vec<Option<(Trajectory, Variation)>> {
        let one = |member: &Member| {
            let (mut out, mut steps) = (Trajectory::default(), Variation::default());
            let Member {
                inputs,
                span,
                initial,
            } = *member;
            Roller::new(hybrid, free)
                .roll_step_by_step(theta, inputs, span, initial, &mut out, &mut steps)
                .ok()?;
            Some((out, steps))
        };
        let eight = || EightRoller::new(hybrid, free).roll_step_by_step(theta, members);
        match hybrid.is_stiff() {
            false => members.iter().map(one).collect(),
            true => match eight() {
                Ok(rolled) => rolled.into_iter().map(Some).collect(),
                Err(_) => {
                    let alone = |member: &Member| {
                        let rolled = EightRoller::new(hybrid, free)
                            .roll_step_by_step(theta, std::slice::from_ref(member));
                        rolled.ok()?.pop()
                    };
                    members.iter().map(alone).collect()
                }
            },
        }
    };
    groups.into_par_iter().flat_map_iter(of_group).collect()
}

impl EightRoller<'_> {
    /// Steps up to eight windows of a stiff model; after each step `keep` sees of every window whether it ends at a sample, x before the step, and
    /// (x, S) after it: S from a unit at its beginning, in the state, θ_free and the forces (Q, ḣ) along the step.
    fn each_step(
        &mut self,
        theta: &[f64],
        members: &[Member<'_>],
        mut keep: impl FnMut(usize, bool, (&[f64], &[f64])),
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
                    keep(lane, step + 1 == substeps, (&before, &after));
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
        let (nv, nx) = (hybrid.nv(), hybrid.nx());
        let columns = nx + self.free.len();
        let mut memory = hybrid.memory(&[]);
        let mut rolled = Vec::with_capacity(members.len());
        for member in members {
            let mut out = Trajectory::default();
            let mut unit = vec![0.0; nx * columns];
            (0..nx).for_each(|i| unit[i * nx + i] = 1.0);
            out.states.extend_from_slice(member.initial);
            out.sensitivities.extend_from_slice(&unit);
            let steps = Variation {
                nx,
                nv,
                first: member.span.0 * member.inputs.grid.substeps,
                ..Variation::default()
            };
            rolled.push((out, steps, unit));
        }
        let mut next = vec![0.0; nx * columns];
        let mut middle = vec![0.0; nx];
        self.each_step(theta, members, |lane, ends, (before, after)| {
            let (out, steps, total) = &mut rolled[lane];
            let (x, own) = after.split_at(nx);
            for ((m, x), before) in middle.iter_mut().zip(x).zip(before) {
                *m = 0.5 * (x + before);
            }
            // S_{i+1} = F S_i + ∂x_{i+1}/∂θ at fixed x_i.
            let (transition, by_theta) = own.split_at(nx * nx);
            let (by_theta, reaction) = by_theta.split_at(nx * (columns - nx));
            multiply(transition, total, &mut next);
            for (to, own) in next[nx * nx..].iter_mut().zip(by_theta) {
                *to += own;
            }
            std::mem::swap(total, &mut next);
            steps.transitions.extend_from_slice(transition);
            steps.reactions.extend_from_slice(reaction);
            let inputs = members[lane].inputs;
            let step = steps.first + steps.middles.len() / nx;
            let state = hybrid.parts(&middle);
            let (force, rates) = hybrid.forces(state, theta, inputs, step, &mut memory);
            steps.forces.extend_from_slice(force);
            steps.forces.extend_from_slice(rates);
            steps.middles.extend_from_slice(&middle);
            if ends {
                out.states.extend_from_slice(x);
                out.sensitivities.extend_from_slice(total);
            }
        })?;
        Ok(rolled
            .into_iter()
            .map(|(out, steps, _)| (out, steps))
            .collect())
    }
}

impl Variation {
    /// Forces and M⁻¹ in the middle of a step.
    fn keep_middle(
        &mut self,
        hybrid: &Hybrid,
        (theta, inputs, step): (&[f64], &DrivenInputs, usize),
        middle: &[f64],
        memory: &mut Memory,
    ) -> Result<(), Diverged> {
        let state = hybrid.parts(middle);
        let (force, rates) = hybrid.forces(state, theta, inputs, step, memory);
        self.forces.extend_from_slice(force);
        self.forces.extend_from_slice(rates);
        hybrid
            .linearize(state, theta, &[], inputs, step, memory)
            .map_err(Diverged::Dynamics)?;
        self.responses.extend_from_slice(memory.response());
        self.middles.extend_from_slice(middle);
        Ok(())
    }
}
