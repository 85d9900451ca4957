//! What small forces along a roll-out do to it, to first order.

use lagrange::LANES;
use pulp::NullaryFnOnce;

use crate::hybrid::{DrivenInputs, Hybrid, Lane, Memory};
use crate::processor::Processor;

/// A roll-out taken apart into its integration steps, so that the effect of any small force along it takes one pass:
///
/// δx_{i+1} = F_i (δx_i + ½ b_i) + ½ b_i,  b_i = h_i (0, M⁻¹ δQ_i, δḣ_i),
///
/// F_i is the derivative of step i in the state that it starts from, δQ_i the force in the middle of the step. Second order in the step.
///
/// Of a [stiff](Hybrid::is_stiff) model δx_{i+1} = F_i δx_i + R_i (δQ_i, δḣ_i), R_i the derivative of the step in forces that are held along it: what
/// pushes a joint that sticks does not move it by h M⁻¹ δQ.
#[derive(Debug, Clone, Default)]
pub struct Variation {
    /// Number of states, and of velocities.
    pub(super) nx: usize,
    pub(super) nv: usize,
    /// First step of the roll-out on the grid of the inputs.
    pub(super) first: usize,
    /// How many steps there are up to each sample after the first.
    pub(super) ends: Vec<usize>,
    /// F of every step, nx × nx, column after column.
    pub(super) transitions: Vec<f64>,
    /// State in the middle of every step, nx numbers.
    pub(super) middles: Vec<f64>,
    /// (Q, ḣ) there.
    pub(super) forces: Vec<f64>,
    /// v̇ of every step, Δv/h, and what the model's effects add to M v̇ + C v + G there, nv numbers each.
    pub(super) accelerations: Vec<f64>,
    pub(super) added: Vec<f64>,
    /// M⁻¹ there, nv × nv, column after column.
    pub(super) responses: Vec<f64>,
    /// R of every step of a stiff model, nx × (nx − nv), column after column; empty for others.
    pub(super) reactions: Vec<f64>,
}

impl Variation {
    /// The states at the samples under each of up to eight forces: `states` of the roll-out plus what the force would change, into `out`,
    /// one a force.
    pub fn under(
        &self,
        states: &[f64],
        forces: &[SmallForce<'_>],
        memory: &mut Memory,
        out: &mut [Vec<f64>],
    ) {
        let mut halves = vec![[0.0; LANES]; self.middles.len()];
        for (lane, force) in forces.iter().enumerate() {
            self.push(force, memory, |entry, part| halves[entry][lane] += part);
        }
        self.carry(states, halves, out);
    }

    /// [`under`](Self::under) forces that are given, each held between two samples: its coordinate, and its value from each sample of the
    /// roll-out to the next.
    pub fn under_given(
        &self,
        states: &[f64],
        inputs: &DrivenInputs,
        forces: &[(usize, Vec<f64>)],
        out: &mut [Vec<f64>],
    ) {
        let mut halves = vec![[0.0; LANES]; self.middles.len()];
        for (lane, (j, force)) in forces.iter().enumerate() {
            let mut from = 0;
            for (&end, &force) in self.ends.iter().zip(force) {
                for i in from..end {
                    let halves = &mut halves[i * self.nx..][..self.nx];
                    self.act((inputs, i), *j, force, |entry, part| {
                        halves[entry][lane] = part;
                    });
                }
                from = end;
            }
        }
        self.carry(states, halves, out);
    }

    fn is_stiff(&self) -> bool {
        !self.reactions.is_empty()
    }

    /// Gives `add` what a force along step `i` adds to its ½ b_i, or to R_i (δQ_i, δḣ_i) of a stiff model, entry after entry: the force `force` in entry `j`
    /// of (Q, ḣ).
    fn act(
        &self,
        (inputs, i): (&DrivenInputs, usize),
        j: usize,
        force: f64,
        mut add: impl FnMut(usize, f64),
    ) {
        let (nv, nx) = (self.nv, self.nx);
        if self.is_stiff() {
            let reaction = &self.reactions[(i * (nx - nv) + j) * nx..][..nx];
            for (entry, by_force) in reaction.iter().enumerate() {
                add(entry, force * by_force);
            }
            return;
        }
        let push = self.half_step(inputs, i) * force;
        match j.checked_sub(nv) {
            Some(k) => add(2 * nv + k, push),
            None => {
                for (k, response) in self.response(i, j).iter().enumerate() {
                    add(nv + k, push * response);
                }
            }
        }
    }

    /// `states` plus what the pushes `halves`, ½ b of every step, change of them.
    fn carry(&self, states: &[f64], mut halves: Vec<Lane>, out: &mut [Vec<f64>]) {
        let mut changes = vec![[0.0; LANES]; self.nx * (1 + self.ends.len())];
        Processor::here().run(Carried {
            nx: self.nx,
            ends: &self.ends,
            whole: self.is_stiff(),
            transitions: &self.transitions,
            halves: &mut halves,
            changes: &mut changes,
        });
        for (lane, out) in out.iter_mut().enumerate() {
            out.clear();
            out.extend(states.iter().zip(&changes).map(|(x, d)| x + d[lane]));
        }
    }

    /// Half of the length of step `i`, s.
    fn half_step(&self, inputs: &DrivenInputs, i: usize) -> f64 {
        let bounds = &inputs.grid.bounds[self.first + i..];
        0.5 * (bounds[1] - bounds[0])
    }

    /// How a force on coordinate `j` accelerates all in the middle of step `i`: that column of M⁻¹.
    fn response(&self, i: usize, j: usize) -> &[f64] {
        &self.responses[(i * self.nv + j) * self.nv..][..self.nv]
    }

    /// Gives `add` what a force [adds](Self::act) to every step, by the entries of all steps.
    fn push(
        &self,
        &SmallForce {
            with,
            theta,
            inputs,
            by,
        }: &SmallForce<'_>,
        memory: &mut Memory,
        mut add: impl FnMut(usize, f64),
    ) {
        let (nv, nx) = (self.nv, self.nx);
        let mut act = |i: usize, j: usize, force: f64| {
            self.act((inputs, i), j, force, |entry, part| {
                add(i * nx + entry, part)
            });
        };
        let alone = match by {
            By::Law(effect) => with.joint_forces(effect, &self.middles, theta),
            _ => None,
        };
        if let Some((j, forces)) = alone {
            for (i, force) in forces.into_iter().enumerate() {
                act(i, j, force);
            }
            return;
        }
        let middles = self.middles.chunks_exact(nx);
        if by == By::Inertia {
            let mut memory = with.memory(&[]);
            let own = self.accelerations.chunks_exact(nv);
            let own = middles.zip(own.zip(self.added.chunks_exact(nv)));
            for (i, (middle, (a, before))) in own.enumerate() {
                let now = with.added_inverse_dynamics(with.parts(middle), a, theta, &mut memory);
                for (j, (now, before)) in now.iter().zip(before).enumerate() {
                    act(i, j, before - now);
                }
            }
            return;
        }
        let own = middles.zip(self.forces.chunks_exact(nx - nv));
        for (i, (middle, before)) in own.enumerate() {
            let step = self.first + i;
            let state = with.parts(middle);
            let (force, rates) = with.forces(state, theta, inputs, step, memory);
            for (j, (now, before)) in force.iter().chain(rates).zip(before).enumerate() {
                act(i, j, now - before);
            }
        }
    }
}

/// A small force along a roll-out: the model that has it. Its states are those of the roll-out's own model.
#[derive(Clone, Copy)]
pub struct SmallForce<'a> {
    /// The model.
    pub with: &'a Hybrid,
    /// Its θ.
    pub theta: &'a [f64],
    /// Its inputs.
    pub inputs: &'a DrivenInputs,
    /// By what it differs from the roll-out's own model.
    pub by: By,
}

/// By what a model differs from another one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum By {
    /// By any forces.
    Forces,
    /// By this effect of its own alone, a force on a joint.
    Law(usize),
    /// By what its effects add to M, C and G: to first order the force −ΔID(q, v, v̇) along the roll-out.
    Inertia,
}

/// δx_{i+1} = F_i (δx_i + ½ b_i) + ½ b_i of eight forces at once.
struct Carried<'a> {
    nx: usize,
    /// How many steps there are up to each sample after the first.
    ends: &'a [usize],
    /// Whether the pushes are R (δQ, δḣ), to be added after the step alone.
    whole: bool,
    transitions: &'a [f64],
    /// ½ b_i of every step; δx after it in its place.
    halves: &'a mut [Lane],
    /// δx at the samples, zero at the first.
    changes: &'a mut [Lane],
}

impl NullaryFnOnce for Carried<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let nx = self.nx;
        let mut steps = self
            .transitions
            .chunks_exact(nx * nx)
            .zip(self.halves.chunks_exact_mut(nx));
        let mut from = 0;
        for (sample, &end) in self.ends.iter().enumerate() {
            // What is carried moves on in the place of the next sample.
            let (before, after) = self.changes[sample * nx..].split_at_mut(nx);
            let after = &mut after[..nx];
            after.copy_from_slice(before);
            for (transition, halves) in steps.by_ref().take(end - from) {
                if !self.whole {
                    for (x, half) in after.iter_mut().zip(&*halves) {
                        for (x, half) in x.iter_mut().zip(half) {
                            *x += half;
                        }
                    }
                }
                for (column, x) in transition.chunks_exact(nx).zip(&*after) {
                    for (moved, f) in halves.iter_mut().zip(column) {
                        for (moved, x) in moved.iter_mut().zip(x) {
                            *moved += f * x;
                        }
                    }
                }
                after.copy_from_slice(halves);
            }
            from = end;
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::panic)]

    use std::path::Path;

    use super::*;
    use crate::effect::{Action, Grid, registry};
    use crate::hybrid::Placed;
    use crate::model::Model;
    use crate::shooting::{Member, Roller, Trajectory, roll_steps};

    fn pendulum_on_a_cart() -> Hybrid {
        let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models");
        let hybrid = Hybrid::of(&Model::load(&models.join("cartpole/cartpole.toml")).unwrap());
        // Without its dry friction: steps of 5 ms do not resolve the sign change of that.
        hybrid.without(0)
    }

    /// A motor that pushes to and fro, 20 ms a sample; from some samples in more steps than from others.
    fn pushes(hybrid: &Hybrid, theta: &[f64], substeps: usize) -> DrivenInputs {
        let t: Vec<f64> = (0..31).map(|k| k as f64 * 0.02).collect();
        let u: Vec<f64> = t.iter().map(|t| 2.0 * (9.0 * t).sin()).collect();
        let times: Vec<usize> = (0..30).map(|k| [1, 1, 2, 1, 4][k % 5]).collect();
        hybrid.drive_on(Grid::finer(&t, substeps, &times), &[u], theta, &[])
    }

    const START: [f64; 4] = [0.1, 2.5, -0.2, 1.5];
    const SPAN: (usize, usize) = (0, 31);

    fn step_by_step(
        model: (&Hybrid, &[f64], &[usize]),
        inputs: &DrivenInputs,
    ) -> (Trajectory, Variation) {
        let member = Member {
            inputs,
            span: SPAN,
            initial: &START,
        };
        roll_steps(model, &[member]).remove(0).unwrap()
    }

    fn distance(a: &[f64], b: &[f64]) -> f64 {
        let squares = a.iter().zip(b).map(|(a, b)| (a - b).powi(2));
        squares.sum::<f64>().sqrt()
    }

    /// The error at 4 steps a sample, relative to what is meant, is small, and falls at least fourfold with half the step.
    fn falls_as_a_square(error: impl Fn(usize) -> f64) {
        let (coarse, fine) = (error(4), error(8));
        let order = (coarse / fine).log2();
        assert!(coarse < 5e-3 && order > 1.8, "{coarse:e}, order {order}");
    }

    #[test]
    fn steps_chained_are_the_sensitivities_of_the_roll_out() {
        let hybrid = pendulum_on_a_cart();
        let (theta, free) = (hybrid.theta(), hybrid.free());
        let inputs = pushes(&hybrid, &theta, 4);
        let mut roller = Roller::new(&hybrid, &free);
        let mut exact = Trajectory::default();
        roller
            .roll_with_sensitivities(&theta, &inputs, SPAN, &START, &mut exact)
            .unwrap();
        let (found, _) = step_by_step((&hybrid, &theta, &free), &inputs);
        assert!(distance(&exact.states, &found.states) < 1e-12);
        let (exact, found) = (exact.sensitivities, found.sensitivities);
        let size = distance(&exact, &vec![0.0; exact.len()]);
        assert!(distance(&exact, &found) < 1e-12 * size);
    }

    fn placed(kind: &str, target: usize) -> Placed {
        Placed {
            kind: registry::find(kind).unwrap(),
            target,
            smoothing: 0.05,
            fixed: false,
        }
    }

    /// The states of the roll-out of a model; what they are by another that differs from it by each of these, to first order; and those of the other's own roll-out.
    fn changed(
        (before, with): (&Hybrid, &Hybrid),
        substeps: usize,
        by: &[By],
    ) -> (Vec<f64>, Vec<Vec<f64>>, Vec<f64>) {
        let theta = before.theta();
        let inputs = pushes(before, &theta, substeps);
        let (null, steps) = step_by_step((before, &theta, &[]), &inputs);
        let theta = with.theta();
        let inputs = pushes(with, &theta, substeps);
        let force = |by: &By| SmallForce {
            with,
            theta: &theta,
            inputs: &inputs,
            by: *by,
        };
        let forces: Vec<SmallForce> = by.iter().map(force).collect();
        let mut found = vec![Vec::new(); forces.len()];
        steps.under(&null.states, &forces, &mut with.memory(&[]), &mut found);
        let mut exact = Trajectory::default();
        Roller::new(with, &[])
            .roll(&theta, &inputs, SPAN, &START, &mut exact)
            .unwrap();
        (null.states, found, exact.states)
    }

    #[test]
    fn a_small_force_moves_the_roll_out_as_its_own_roll_out_says() {
        let hybrid = pendulum_on_a_cart();
        for (kind, target, values) in [
            ("viscous_friction", 0, vec![1e-7]),
            ("linear_spring", 1, vec![1e-7, 0.3]),
            ("quadratic_drag", 1, vec![1e-7]),
            ("input_gain_error", 0, vec![1e-7]),
        ] {
            let mut with = hybrid.clone();
            let effect = placed(kind, target);
            with.add(effect, &values);
            let alone = match effect.kind.action {
                Action::Joint(_) => By::Law(with.effects().len() - 1),
                _ => By::Forces,
            };
            falls_as_a_square(|substeps| {
                let (null, found, exact) =
                    changed((&hybrid, &with), substeps, &[By::Forces, alone]);
                // The difference of two forces has lost as many digits as it is smaller than they are.
                assert!(distance(&found[0], &found[1]) < 1e-6 * distance(&found[0], &null));
                distance(&exact, &found[0]) / distance(&exact, &null)
            });
        }
    }

    #[test]
    fn a_small_inertia_moves_the_roll_out_as_its_own_roll_out_says() {
        let hybrid = pendulum_on_a_cart();
        let mut links = hybrid.links().iter();
        let pole = links.position(|link| link.name == "pole").unwrap();
        // Beside an inertia that is there already, and more of that.
        let rotor = |inertia: f64| {
            let mut with = hybrid.clone();
            with.add(placed("reflected_inertia", 0), &[inertia]);
            with
        };
        let before = rotor(0.1);
        let beside = |(kind, target, values): (&str, usize, &[f64])| {
            let mut with = before.clone();
            with.add(placed(kind, target), values);
            with
        };
        let others = [
            ("reflected_inertia", 1, &[1e-9][..]),
            ("added_mass", pole, &[1e-7]),
            ("payload", pole, &[1e-7, 1.7]),
            ("centre_of_mass", pole, &[1.0 + 1e-7]),
            ("link_inertia", pole, &[1e-9]),
            ("gravity_tilt", 1, &[1e-6]),
        ];
        for with in others.map(beside).iter().chain([&rotor(0.1 + 1e-7)]) {
            falls_as_a_square(|substeps| {
                let (null, found, exact) = changed((&before, with), substeps, &[By::Inertia]);
                distance(&exact, &found[0]) / distance(&exact, &null)
            });
        }
    }

    /// The same of a stiff model, one whose pole sticks, and whose motor drives the cart by a spring.
    #[test]
    fn a_small_force_moves_what_sticks_as_its_own_roll_out_says() {
        let mut hybrid = pendulum_on_a_cart();
        let sharp = |kind, target| Placed {
            smoothing: 1e-3,
            ..placed(kind, target)
        };
        hybrid.add(sharp("coulomb_friction", 1), &[0.05]);
        hybrid.add(
            sharp("elastic_transmission", 0),
            &[75.0, 0.3, 0.035, 0.0, 0.0, 0.0],
        );
        let hybrid = hybrid.stepped_implicitly(true);
        let (theta, free) = (hybrid.theta(), hybrid.free());
        let start = [0.1, 3.0, -0.2, 0.4, 0.0, 0.0];
        let inputs = pushes(&hybrid, &theta, 8);
        let member = Member {
            inputs: &inputs,
            span: SPAN,
            initial: &start,
        };
        let rolled = roll_steps((&hybrid, &theta, &free), &[member; 3]);
        let [Some((null, steps)), _, Some(other)] = &rolled[..] else {
            panic!("three windows")
        };
        assert_eq!(null.states, other.0.states);
        let mut exact = Trajectory::default();
        Roller::new(&hybrid, &free)
            .roll_with_sensitivities(&theta, &inputs, SPAN, &start, &mut exact)
            .unwrap();
        let size = distance(&exact.sensitivities, &vec![0.0; exact.sensitivities.len()]);
        assert!(distance(&exact.sensitivities, &null.sensitivities) < 1e-9 * size);
        for (kind, target, values) in [
            ("viscous_friction", 0, vec![1e-5]),
            ("linear_spring", 1, vec![1e-5, 0.3]),
            ("constant_force", 1, vec![1e-5]),
            ("input_gain_error", 0, vec![1e-5]),
            ("reflected_inertia", 0, vec![1e-6]),
            ("reflected_inertia", 1, vec![1e-8]),
            ("gravity_tilt", 0, vec![1e-5]),
        ] {
            let effect = placed(kind, target);
            let by = match effect.kind.inertial() {
                Some(_) => By::Inertia,
                None => By::Forces,
            };
            let mut with = hybrid.clone();
            with.add(effect, &values);
            let theta = with.theta();
            let inputs = pushes(&with, &theta, 8);
            let force = SmallForce {
                with: &with,
                theta: &theta,
                inputs: &inputs,
                by,
            };
            let mut found = [Vec::new()];
            steps.under(&null.states, &[force], &mut with.memory(&[]), &mut found);
            let mut moved = Trajectory::default();
            Roller::new(&with, &[])
                .roll(&theta, &inputs, SPAN, &start, &mut moved)
                .unwrap();
            let change = distance(&moved.states, &null.states);
            let error = distance(&moved.states, &found[0]) / change;
            assert!(error < 0.05, "{kind}: {error:e} of {change:e}");
        }
    }

    /// A push that is given is that of a constant force in the model, on either coordinate.
    #[test]
    fn a_given_force_moves_the_roll_out_as_the_same_force_of_the_model() {
        let hybrid = pendulum_on_a_cart();
        let theta = hybrid.theta();
        let inputs = pushes(&hybrid, &theta, 4);
        let (null, steps) = step_by_step((&hybrid, &theta, &[]), &inputs);
        for target in [0, 1] {
            let mut with = hybrid.clone();
            with.add(placed("constant_force", target), &[1e-3]);
            let theta = with.theta();
            let force = SmallForce {
                with: &with,
                theta: &theta,
                inputs: &inputs,
                by: By::Law(with.effects().len() - 1),
            };
            let mut modelled = [Vec::new()];
            steps.under(&null.states, &[force], &mut with.memory(&[]), &mut modelled);
            let mut given = [Vec::new()];
            let held = (target, vec![1e-3; SPAN.1 - 1]);
            steps.under_given(&null.states, &inputs, &[held], &mut given);
            let moved = distance(&given[0], &null.states);
            assert!(moved > 1e-4, "{moved}");
            assert!(distance(&given[0], &modelled[0]) < 1e-9 * moved);
        }
    }
}
