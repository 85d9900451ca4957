//! Roll-outs taken apart into their steps.

use lagrange::LANES;

use super::eight::{EightRoller, Lanes, Member, by_groups};
use super::{Diverged, Trajectory, Variation};
use crate::hybrid::{DrivenInputs, EightMemory, Hybrid, Lane, Memory};

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
                first: member.inputs.grid.steps_from(member.span.0).start,
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

    /// The state in the middle of a step that ends at `after`, and the forces there.
    fn middle(
        &mut self,
        hybrid: &Hybrid,
        (theta, inputs, step): (&[f64], &DrivenInputs, usize),
        (middle, after): (&[f64], &[f64]),
        memory: &mut Memory,
    ) {
        let state = hybrid.parts(middle);
        let (force, rates) = hybrid.forces(state, theta, inputs, step, memory);
        let steps = &mut self.steps;
        steps.forces.extend_from_slice(force);
        steps.forces.extend_from_slice(rates);
        steps.middles.extend_from_slice(middle);
        let bounds = &inputs.grid.bounds[step..];
        let half = 0.5 * (bounds[1] - bounds[0]);
        let from = steps.accelerations.len();
        let velocities = state.v.iter().zip(hybrid.parts(after).v);
        let accelerations = velocities.map(|(middle, after)| (after - middle) / half);
        steps.accelerations.extend(accelerations);
        let a = &steps.accelerations[from..];
        let added = hybrid.added_inverse_dynamics(state, a, theta, memory);
        steps.added.extend_from_slice(added);
    }

    /// A sample at x.
    fn sample(&mut self, x: &[f64]) {
        self.out.states.extend_from_slice(x);
        self.out.sensitivities.extend_from_slice(&self.total);
        self.steps
            .ends
            .push(self.steps.middles.len() / self.steps.nx);
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

/// The roll-outs of windows, eight at once; none where they diverge.
pub(crate) fn roll_steps(
    (hybrid, theta, free): (&Hybrid, &[f64], &[usize]),
    members: &[Member<'_>],
) -> Vec<Option<(Trajectory, Variation)>> {
    let roller = || EightRoller::new(hybrid, free);
    by_groups(members, roller, |roller, members| {
        roller.each(members, |roller, some| {
            roller.roll_step_by_step(theta, some)
        })
    })
}

/// One step of eight windows.
struct OneStep<'a> {
    /// The step on the grid of each; whether it goes on, and whether that ends at a sample.
    steps: [usize; LANES],
    goes: [bool; LANES],
    ends: [bool; LANES],
    /// The state in the middle of the step.
    middle: &'a [Lane],
    /// M⁻¹ there, column after column; empty of a stiff model.
    response: &'a [Lane],
    /// (x, S) after the step, S from a unit at its beginning: in the state, θ_free and, of a stiff model, the forces (Q, ḣ) along the step.
    after: &'a [Lane],
}

impl EightRoller<'_> {
    /// Steps up to eight windows, step by step.
    fn each_step(
        &mut self,
        theta: &[f64],
        members: &[Member<'_>],
        mut keep: impl FnMut(&OneStep<'_>),
    ) -> Result<(), Diverged> {
        let Some(last) = members.last() else {
            return Ok(());
        };
        let members: [&Member; LANES] = std::array::from_fn(|k| members.get(k).unwrap_or(last));
        let lanes = Lanes::new(&members);
        let (nx, nv) = (self.hybrid.nx(), self.hybrid.nv());
        let forces = if self.stiff.is_some() { nx - nv } else { 0 };
        let columns = 1 + nx + self.free.len() + forces;
        for room in [&mut self.base, &mut self.point, &mut self.sum] {
            room.clear();
            room.resize(columns * nx, [0.0; LANES]);
        }
        for i in 0..nx {
            self.base[i] = members.map(|member| member.initial[i]);
        }
        // What is pushed in the middle of a step moves on from there; what sticks does not, and has reactions of its own.
        let mut response: Option<EightMemory> = None;
        match &mut self.stiff {
            Some(stiff) => stiff.forget(),
            None => response = Some(self.hybrid.memory_of_eight(&[])),
        }
        let mut middle = vec![[0.0; LANES]; nx];
        for step in 0..lanes.longest() {
            let (x, s) = self.base.split_at_mut(nx);
            middle.copy_from_slice(x);
            s.fill([0.0; LANES]);
            for diagonal in s.iter_mut().step_by(nx + 1).take(nx) {
                *diagonal = [1.0; LANES];
            }
            let at = lanes.at(step);
            self.step(theta, &at, lanes.lengths(&at, step))?;
            for (m, x) in middle.iter_mut().zip(&self.base) {
                m.iter_mut().zip(x).for_each(|(m, x)| *m = 0.5 * (*m + x));
            }
            if let Some(memory) = &mut response {
                let found = self.hybrid.linearize_eight(&middle, theta, &at, memory);
                found.map_err(Diverged::Dynamics)?;
            }
            let ends = lanes.ends(&at, step);
            if ends.contains(&true) {
                Diverged::check(self.base.as_flattened())?;
            }
            keep(&OneStep {
                steps: at.steps,
                goes: std::array::from_fn(|lane| lanes.goes(lane, step)),
                ends,
                middle: &middle,
                response: response.as_ref().map_or(&[], EightMemory::response),
                after: &self.base,
            });
        }
        Ok(())
    }

    /// Up to eight windows, each with the single steps: as [`roll_all`](super::roll_all) with sensitivities.
    fn roll_step_by_step(
        &mut self,
        theta: &[f64],
        members: &[Member<'_>],
    ) -> Result<Vec<(Trajectory, Variation)>, Diverged> {
        let hybrid = self.hybrid;
        let nx = hybrid.nx();
        let columns = nx + self.free.len();
        let kept = |member: &Member| Kept::new(hybrid, member, columns);
        let mut kept: Vec<Kept> = members.iter().map(kept).collect();
        let mut memory = hybrid.memory(&[]);
        let (mut middle, mut after) = (Vec::new(), Vec::new());
        self.each_step(theta, members, |one| {
            let windows = kept.iter_mut().zip(members).enumerate();
            for (lane, (kept, member)) in windows.filter(|(lane, _)| one.goes[*lane]) {
                let own = |lanes: &[Lane], to: &mut Vec<f64>| {
                    to.clear();
                    to.extend(lanes.iter().map(|x| x[lane]));
                };
                own(one.middle, &mut middle);
                own(one.after, &mut after);
                let (x, derivatives) = after.split_at(nx);
                kept.step(derivatives);
                let at = (theta, member.inputs, one.steps[lane]);
                kept.middle(hybrid, at, (&middle, x), &mut memory);
                let response = one.response.iter().map(|x| x[lane]);
                kept.steps.responses.extend(response);
                if one.ends[lane] {
                    kept.sample(x);
                }
            }
        })?;
        Ok(kept
            .into_iter()
            .map(|kept| (kept.out, kept.steps))
            .collect())
    }
}
