//! Roll-outs of many windows with a network in Q, and the gradient of their loss, by reverse mode through classical Runge-Kutta.
//!
//! One step x⁺ = x + h/6 (k₁ + 2 k₂ + 2 k₃ + k₄), k_s = f(X_s), X_s = x + a_s h k_{s−1}, a = (0, ½, ½, 1), where f is
//! (v, M⁻¹[Q + Q_NN − C v − G], ḣ). With λ = ∂J/∂x⁺ the adjoints of the stages are
//!
//! k̄₄ = h/6 λ, k̄₃ = h/3 λ + h X̄₄, k̄₂ = h/3 λ + h/2 X̄₃, k̄₁ = h/6 λ + h/2 X̄₂, X̄_s = (∂f/∂x)ᵀ k̄_s, and ∂J/∂x = λ + Σ X̄_s.
//!
//! Through the mechanics goes what [`Hybrid`] linearises in lanes of eight states, through the network its batched reverse pass with the seeds
//! (∂v̇/∂Q)ᵀ k̄_v. Nothing is taped but the stages.

use lagrange::LANES;
use pulp::NullaryFnOnce;

use super::loss::{Loss, Measured, Target};
use super::tangents::Tangents;
use crate::effect::Grid;
use crate::hybrid::{DrivenInputs, Eight, EightMemory, Hybrid, Lane};
use crate::learnt::{Feature, Output, Seen, Sight, chain, see};
use crate::network::{Mlp, Real, Tape};
use crate::processor::Processor;

/// Windows that are rolled out together, on one thread. A batch is cut into such chunks whatever the number of threads.
pub(crate) const CHUNK: usize = 64;
/// A state beyond is no mechanism's.
const BEYOND: f64 = 1e6;
/// A network sees nothing beyond so many widths.
const FARTHEST: f64 = 1e4;
/// a_s.
pub(super) const NODES: [f64; 4] = [0.0, 0.5, 0.5, 1.0];

/// A network that is being trained: its numbers, what it sees and what it acts on.
#[derive(Debug, Clone)]
pub(crate) struct Learner<T: Real> {
    pub network: Mlp<T>,
    pub features: Vec<Feature>,
    pub outputs: Vec<Output>,
}

/// One window of a recording.
#[derive(Clone, Copy)]
pub(crate) struct Member<'a> {
    /// The inputs of the recording.
    pub inputs: &'a DrivenInputs,
    /// What was measured.
    pub target: &'a Target,
    /// The first sample.
    pub first: usize,
    /// The state (q, v, h) that the window starts from.
    pub start: &'a [f64],
}

/// What all chunks of a batch share.
#[derive(Clone, Copy)]
pub(crate) struct Setting<'a> {
    pub hybrid: &'a Hybrid,
    pub theta: &'a [f64],
    /// The entries of θ that a gradient is wanted in.
    pub free: &'a [usize],
    pub loss: &'a Loss,
    /// Sample intervals of a window.
    pub samples: usize,
}

/// The loss of a chunk: its sum over windows, and its gradients.
pub(crate) struct Chunk<T: Real> {
    pub(super) processor: Processor,
    pub(super) tape: Tape<T>,
    eights: EightMemory,
    /// Entries of a state.
    pub(super) nx: usize,
    /// Steps of a window.
    pub(super) steps: usize,
    /// Groups of eight states that there is room for.
    pub(super) groups: usize,
    /// x at the beginning of each step and at the end: `[step][group][nx]`.
    x: Vec<Lane>,
    /// X_s: `[4 step + s][group][nx]`.
    pub(super) stages: Vec<Lane>,
    /// ∂(v̇, ḣ)/∂(q, v, h, θ_free) at X_s: `[4 step + s][group][…]`.
    pub(super) linear: Vec<Lane>,
    /// ∂v̇/∂Q at X_s.
    pub(super) response: Vec<Lane>,
    /// k_s of the step under way: `[s][group][nx]`; on the way back λ, k̄ and X̄.
    slopes: Vec<Lane>,
    lambda: Vec<Lane>,
    weights: Vec<Lane>,
    before: Vec<Lane>,
    pub(super) z: Vec<Lane>,
    /// Which lanes have had a motion up to each step.
    alive: Vec<[bool; LANES]>,
    /// Which lanes are windows that have a motion to their end: the others count nothing, and may hold no numbers.
    live: Vec<[bool; LANES]>,
    /// What the sum of a window counts for in the loss, to first order.
    factors: Vec<Lane>,
    /// Σ of the windows' losses, without those that left the range of any mechanism.
    pub loss: f64,
    /// How many of these there were.
    pub diverged: usize,
    /// ∂/∂ parameters of the network.
    pub gradient: Vec<T>,
    /// ∂/∂θ_free.
    pub by_theta: Vec<f64>,
    /// ∂/∂ start, state after state.
    pub(super) by_start: Vec<f64>,
    /// Where starts are fitted.
    pub(super) tangents: Tangents,
}

impl<T: Real> Chunk<T> {
    /// Memory for so many windows, at most [`CHUNK`], of `steps` integration steps.
    pub fn new(setting: &Setting<'_>, learner: &Learner<T>, windows: usize, steps: usize) -> Self {
        let hybrid = setting.hybrid;
        let groups = windows.min(CHUNK).div_ceil(LANES);
        let (n, nx) = (hybrid.nv(), hybrid.nx());
        let below = nx - hybrid.nq();
        let columns = nx + setting.free.len();
        let zeros = |n: usize| vec![[0.0; LANES]; n];
        Chunk {
            processor: Processor::here(),
            tape: Tape::new(learner.network.shape(), LANES * groups, 4 * steps),
            eights: hybrid.memory_of_eight(setting.free),
            nx,
            steps,
            groups,
            x: zeros((steps + 1) * groups * nx),
            stages: zeros(4 * steps * groups * nx),
            linear: zeros(4 * steps * groups * below * columns),
            response: zeros(4 * steps * groups * n * n),
            slopes: zeros(4 * groups * nx),
            lambda: zeros(groups * nx),
            weights: zeros(groups * nx),
            before: zeros(groups * nx),
            z: zeros(learner.features.len()),
            alive: vec![[true; LANES]; groups * (steps + 1)],
            live: vec![[false; LANES]; groups],
            factors: zeros(groups),
            loss: 0.0,
            diverged: 0,
            gradient: vec![T::from_f64(0.0); learner.network.parameters().len()],
            by_theta: vec![0.0; setting.free.len()],
            by_start: vec![0.0; LANES * groups * nx],
            tangents: Tangents::default(),
        }
    }

    /// Rolls the windows out and sums up their losses; not more than there is room for.
    ///
    /// # Errors
    /// What the dynamics refuse at a state that is in the range of mechanisms.
    pub fn forward(
        &mut self,
        setting: &Setting<'_>,
        learner: &Learner<T>,
        members: &[Member<'_>],
    ) -> Result<(), lagrange::Error> {
        self.roll_out(setting, learner, members, true)
    }

    /// The same without what [`backward`](Self::backward) needs.
    ///
    /// # Errors
    /// As [`forward`](Self::forward).
    pub fn roll(
        &mut self,
        setting: &Setting<'_>,
        learner: &Learner<T>,
        members: &[Member<'_>],
    ) -> Result<(), lagrange::Error> {
        self.roll_out(setting, learner, members, false)
    }

    /// `keep`: whether every stage is kept, with its derivatives.
    fn roll_out(
        &mut self,
        setting: &Setting<'_>,
        learner: &Learner<T>,
        members: &[Member<'_>],
        keep: bool,
    ) -> Result<(), lagrange::Error> {
        let (nx, n) = (self.nx, setting.hybrid.nv());
        let nq = setting.hybrid.nq();
        let groups = members.len().div_ceil(LANES);
        self.alive.fill([true; LANES]);
        for group in 0..groups {
            for lane in 0..LANES {
                let start = lane_of(members, group, lane).start;
                for (i, &value) in start.iter().enumerate() {
                    self.x[group * nx + i][lane] = value;
                }
            }
        }
        for step in 0..self.steps {
            let stands = stands(members, step);
            let stands = &stands[..groups];
            let with = With {
                setting,
                learner,
                members,
                stands,
                step,
            };
            for stage in 0..4 {
                let slot = if keep { 4 * step + stage } else { 0 };
                self.pass(with, Part::Prepare(stage, slot));
                learner.network.forward(&mut self.tape, slot);
                for (group, stand) in stands.iter().enumerate() {
                    let place = slot * self.groups + group;
                    self.eights.added.fill([0.0; LANES]);
                    for (o, output) in learner.outputs.iter().enumerate() {
                        let v = setting.hybrid.start_of(output.coordinate).v;
                        let y = self.tape.output(slot, o, group);
                        self.eights.added[v] = y.map(|y| output.scale * y.to_f64());
                    }
                    let x = &self.stages[place * nx..][..nx];
                    let (hybrid, theta, at) = (setting.hybrid, setting.theta, &stand.at);
                    if keep {
                        hybrid.linearize_eight(x, theta, at, &mut self.eights)?;
                        let linear = &self.eights.linear;
                        self.linear[place * linear.len()..][..linear.len()].copy_from_slice(linear);
                        let response = self.eights.response();
                        self.response[place * n * n..][..n * n].copy_from_slice(response);
                    } else {
                        hybrid.accelerate_eight(x, theta, at, &mut self.eights, false)?;
                    }
                    let k = &mut self.slopes[(stage * self.groups + group) * nx..][..nx];
                    k[..nq].copy_from_slice(&x[nq..nq + n]);
                    k[nq..].copy_from_slice(&self.eights.rates);
                }
            }
            self.pass(with, Part::Advance);
        }
        let with = With {
            setting,
            learner,
            members,
            stands: &[],
            step: self.steps,
        };
        self.pass(with, Part::SumUp);
        Ok(())
    }

    /// A part of the work, compiled for the processor.
    fn pass(&mut self, with: With<'_, '_, T>, part: Part) {
        let processor = self.processor;
        processor.run(Pass {
            chunk: self,
            with,
            part,
        });
    }

    /// X_s of a stage, and what the network sees there.
    #[inline(always)]
    fn prepare(
        &mut self,
        setting: &Setting<'_>,
        learner: &Learner<T>,
        members: &[Member<'_>],
        stands: &[Stand<'_>],
        (step, stage, slot): (usize, usize, usize),
    ) {
        let nx = self.nx;
        for (group, stand) in stands.iter().enumerate() {
            let x = &self.x[(step * self.groups + group) * nx..][..nx];
            let to = &mut self.stages[(slot * self.groups + group) * nx..][..nx];
            to.copy_from_slice(x);
            if stage > 0 {
                let k = &self.slopes[((stage - 1) * self.groups + group) * nx..][..nx];
                for (to, k) in to.iter_mut().zip(k) {
                    add_scaled(to, &stand.h, NODES[stage], k);
                }
            }
            let alive = &mut self.alive[step * self.groups + group];
            keep_in_range(to, members, group, alive);
            let place = setting.hybrid.seen_of_eight(&stand.at);
            see(&learner.features, to, &place, &mut self.z);
            for (k, z) in self.z.iter().enumerate() {
                let to = self.tape.input_mut(slot, k, group);
                for (to, &z) in to.iter_mut().zip(z) {
                    *to = T::from_f64(seen(z));
                }
            }
        }
    }

    /// x⁺; a lane that leaves the range of mechanisms goes on from where its window began, and counts no more.
    #[inline(always)]
    fn advance(&mut self, members: &[Member<'_>], step: usize, stands: &[Stand<'_>]) {
        let nx = self.nx;
        for (group, Stand { h, .. }) in stands.iter().enumerate() {
            let (from, to) = self.x.split_at_mut((step + 1) * self.groups * nx);
            let from = &from[(step * self.groups + group) * nx..][..nx];
            let to = &mut to[group * nx..][..nx];
            to.copy_from_slice(from);
            for (stage, weight) in [1.0, 2.0, 2.0, 1.0].into_iter().enumerate() {
                let k = &self.slopes[(stage * self.groups + group) * nx..][..nx];
                for (to, k) in to.iter_mut().zip(k) {
                    add_scaled(to, h, weight / 6.0, k);
                }
            }
            let mut alive = self.alive[step * self.groups + group];
            keep_in_range(to, members, group, &mut alive);
            self.alive[(step + 1) * self.groups + group] = alive;
        }
    }

    #[inline(always)]
    fn sum_up(&mut self, setting: &Setting<'_>, members: &[Member<'_>], groups: usize) {
        let (nx, loss) = (self.nx, setting.loss);
        (self.loss, self.diverged) = (0.0, 0);
        let Some(first) = members.first() else {
            return;
        };
        let substeps = first.inputs.grid.substeps();
        let samples = (setting.samples + 1 - loss.first) as f64;
        for group in 0..groups {
            let mut sums = [0.0; LANES];
            for sample in loss.first..=setting.samples {
                let at = measured(members, group, sample);
                let x = &self.x[(sample * substeps * self.groups + group) * nx..][..nx];
                loss.add_eight(self.processor, &at, x, &mut sums);
            }
            let there = members.len() - group * LANES;
            for (lane, &sum) in sums.iter().enumerate() {
                let is_window = lane < there;
                let live = is_window && self.alive[self.steps * self.groups + group][lane];
                self.live[group][lane] = live;
                self.diverged += usize::from(is_window && !live);
                self.factors[group][lane] = 0.0;
                if live {
                    let (counted, slope) = loss.of_window(sum, samples);
                    self.loss += counted;
                    self.factors[group][lane] = slope;
                }
            }
        }
    }

    /// The gradients of the summed losses of the windows that [`forward`](Self::forward) has rolled out.
    pub fn backward(
        &mut self,
        setting: &Setting<'_>,
        learner: &Learner<T>,
        members: &[Member<'_>],
    ) {
        let nx = self.nx;
        let groups = members.len().div_ceil(LANES);
        self.by_theta.fill(0.0);
        self.lambda.fill([0.0; LANES]);
        self.forget_beyond(learner, groups);
        for step in (0..self.steps).rev() {
            let stands = stands(members, step);
            let with = With {
                setting,
                learner,
                members,
                stands: &stands[..groups],
                step,
            };
            self.pass(with, Part::AddLosses(step + 1));
            // `before` gathers ∂J/∂x at the beginning of the step.
            self.before.copy_from_slice(&self.lambda);
            for stage in (0..4).rev() {
                self.pass(with, Part::Seed(stage));
                learner.network.backward(&mut self.tape, 4 * step + stage);
                self.pass(with, Part::PullBack(stage));
            }
            self.lambda.copy_from_slice(&self.before);
        }
        let with = With {
            setting,
            learner,
            members,
            stands: &[],
            step: 0,
        };
        self.pass(with, Part::AddLosses(0));
        for group in 0..groups {
            for (i, lambda) in self.lambda[group * nx..][..nx].iter().enumerate() {
                for (lane, &part) in lambda.iter().enumerate() {
                    self.by_start[(group * LANES + lane) * nx + i] = part;
                }
            }
        }
        self.gradient.fill(T::from_f64(0.0));
        let slots = 0..4 * self.steps;
        learner
            .network
            .add_gradient(&self.tape, slots, &mut self.gradient);
        // Windows on the way out of the range of mechanisms may have a slope beyond all numbers.
        if !self.processor.run(AllFinite(&self.gradient)) {
            self.gradient.fill(T::from_f64(0.0));
            self.by_start.fill(0.0);
            self.by_theta.fill(0.0);
        }
    }

    /// The gradient is summed over all groups of the tape: those that the windows do not fill have none of the windows before.
    fn forget_beyond(&mut self, learner: &Learner<T>, groups: usize) {
        for group in groups..self.groups {
            for slot in 0..4 * self.steps {
                for o in 0..learner.outputs.len() {
                    *self.tape.seed_mut(slot, o, group) = [T::from_f64(0.0); LANES];
                }
            }
        }
    }

    /// The derivative of what one of the windows counts in its sum, see [`Loss::of_window`]; 0 where it has no motion to its end.
    pub fn factor(&self, window: usize) -> f64 {
        let (group, lane) = (window / LANES, window % LANES);
        match self.live[group][lane] {
            true => self.factors[group][lane],
            false => 0.0,
        }
    }

    /// Adds to λ what the loss at the sample that ends with step `step` − 1 says; nothing where a lane does not count.
    #[inline(always)]
    fn add_losses(
        &mut self,
        setting: &Setting<'_>,
        members: &[Member<'_>],
        step: usize,
        groups: usize,
    ) {
        let nx = self.nx;
        let substeps = members.first().map_or(1, |m| m.inputs.grid.substeps());
        let sample = step / substeps;
        if !step.is_multiple_of(substeps) || sample < setting.loss.first {
            return;
        }
        for group in 0..groups {
            let at = measured(members, group, sample);
            let x = &self.x[(step * self.groups + group) * nx..][..nx];
            let lambda = &mut self.lambda[group * nx..][..nx];
            let factors = &self.factors[group];
            setting
                .loss
                .add_gradient_of_eight(self.processor, &at, x, factors, lambda);
        }
    }

    /// ∂/∂ start of one of the windows.
    pub fn by_start_of(&self, window: usize) -> &[f64] {
        &self.by_start[window * self.nx..][..self.nx]
    }

    /// k̄ of a stage, into `weights`: h b_s λ + h a_{s+1} X̄_{s+1}, where X̄ of the stage after is in `slopes`.
    #[inline(always)]
    fn weigh(&mut self, h: &Lane, stage: usize, group: usize) {
        let nx = self.nx;
        let to = &mut self.weights[group * nx..][..nx];
        to.fill([0.0; LANES]);
        let part = [1.0, 2.0, 2.0, 1.0][stage] / 6.0;
        for (to, lambda) in to.iter_mut().zip(&self.lambda[group * nx..][..nx]) {
            add_scaled(to, h, part, lambda);
        }
        if stage < 3 {
            let after = &self.slopes[((stage + 1) * self.groups + group) * nx..][..nx];
            for (to, after) in to.iter_mut().zip(after) {
                add_scaled(to, h, NODES[stage + 1], after);
            }
        }
    }

    /// The adjoints of the network's outputs: s_j Σ_i ∂v̇_i/∂Q_j k̄_i.
    #[inline(always)]
    fn seed(&mut self, learner: &Learner<T>, hybrid: &Hybrid, slot: usize, group: usize) {
        let (n, nq, nx) = (hybrid.nv(), hybrid.nq(), self.nx);
        let response = &self.response[(slot * self.groups + group) * n * n..][..n * n];
        let weights = &self.weights[group * nx + nq..][..n];
        for (o, output) in learner.outputs.iter().enumerate() {
            let v = hybrid.start_of(output.coordinate).v;
            let mut sum = [0.0; LANES];
            for (response, weight) in response[v * n..][..n].iter().zip(weights) {
                for ((sum, r), w) in sum.iter_mut().zip(response).zip(weight) {
                    *sum += r * w;
                }
            }
            let sum = where_live(&sum, &self.live[group]);
            let seed = self.tape.seed_mut(slot, o, group);
            for (seed, sum) in seed.iter_mut().zip(sum) {
                *seed = T::from_f64(output.scale * sum);
            }
        }
    }

    /// X̄ = (∂f/∂x)ᵀ k̄ into `slopes`, and added to `before`; the parts in θ_free to `by_theta`.
    #[inline(always)]
    fn pull_back(
        &mut self,
        setting: &Setting<'_>,
        learner: &Learner<T>,
        at: &Eight<'_>,
        (stage, slot, group): (usize, usize, usize),
    ) {
        let hybrid = setting.hybrid;
        let (n, nq, nx) = (hybrid.nv(), hybrid.nq(), self.nx);
        let place = slot * self.groups + group;
        let below = nx - nq;
        let columns = nx + setting.free.len();
        let linear = &self.linear[place * below * columns..][..below * columns];
        let weights = &self.weights[group * nx..][..nx];
        let to = &mut self.slopes[(stage * self.groups + group) * nx..][..nx];
        let (by_theta, live) = (&mut self.by_theta, &self.live[group]);
        for (column, entries) in linear.chunks_exact(below).enumerate() {
            let mut sum = [0.0; LANES];
            for (entry, weight) in entries.iter().zip(&weights[nq..]) {
                for ((sum, e), w) in sum.iter_mut().zip(entry).zip(weight) {
                    *sum += e * w;
                }
            }
            let sum = where_live(&sum, live);
            match column.checked_sub(nx) {
                None => to[column] = sum,
                Some(k) => by_theta[k] += sum.iter().sum::<f64>(),
            }
        }
        for (to, weight) in to[nq..nq + n].iter_mut().zip(weights) {
            for (to, w) in to.iter_mut().zip(weight) {
                *to += w;
            }
        }
        for (k, z) in self.z.iter_mut().enumerate() {
            let from = self.tape.input_gradient(slot, k, group);
            for (z, from) in z.iter_mut().zip(from) {
                *z = from.to_f64();
            }
        }
        let place_of: Seen<'_> = hybrid.seen_of_eight(at);
        let x = &self.stages[place * nx..][..nx];
        chain(
            &learner.features,
            x,
            &place_of,
            &self.z,
            |by, part| match by {
                Sight::Position(i) => add_lane(&mut to[i], &part),
                Sight::Velocity(i) => add_lane(&mut to[nq + i], &part),
                Sight::Constant(index) => {
                    if let Ok(k) = setting.free.binary_search(&index) {
                        by_theta[k] += where_live(&part, live).iter().sum::<f64>();
                    }
                }
            },
        );
        to.iter_mut().for_each(|to| *to = where_live(to, live));
        for (before, to) in self.before[group * nx..][..nx].iter_mut().zip(to) {
            add_lane(before, to);
        }
    }
}

/// What the parts of the work on one step share.
struct With<'a, 'b, T: Real> {
    setting: &'a Setting<'b>,
    learner: &'a Learner<T>,
    members: &'a [Member<'b>],
    stands: &'a [Stand<'b>],
    step: usize,
}

impl<T: Real> Clone for With<'_, '_, T> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<T: Real> Copy for With<'_, '_, T> {}

/// A part of the work on all groups; stages and slots, but for the step of `AddLosses`.
enum Part {
    Prepare(usize, usize),
    Advance,
    SumUp,
    AddLosses(usize),
    Seed(usize),
    PullBack(usize),
}

struct Pass<'c, 'a, 'b, T: Real> {
    chunk: &'c mut Chunk<T>,
    with: With<'a, 'b, T>,
    part: Part,
}

impl<T: Real> NullaryFnOnce for Pass<'_, '_, '_, T> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Pass { chunk, with, part } = self;
        let With {
            setting,
            learner,
            members,
            stands,
            step,
        } = with;
        let groups = members.len().div_ceil(LANES);
        match part {
            Part::Prepare(stage, slot) => {
                chunk.prepare(setting, learner, members, stands, (step, stage, slot));
            }
            Part::Advance => chunk.advance(members, step, stands),
            Part::SumUp => chunk.sum_up(setting, members, groups),
            Part::AddLosses(step) => chunk.add_losses(setting, members, step, groups),
            Part::Seed(stage) => {
                for (group, Stand { h, .. }) in stands.iter().enumerate() {
                    chunk.weigh(h, stage, group);
                    chunk.seed(learner, setting.hybrid, 4 * step + stage, group);
                }
            }
            Part::PullBack(stage) => {
                for (group, Stand { at, .. }) in stands.iter().enumerate() {
                    chunk.pull_back(setting, learner, at, (stage, 4 * step + stage, group));
                }
            }
        }
    }
}

/// Whether all are numbers.
struct AllFinite<'a, T>(&'a [T]);

impl<T: Real> NullaryFnOnce for AllFinite<'_, T> {
    type Output = bool;

    #[inline(always)]
    fn call(self) -> bool {
        self.0
            .iter()
            .fold(true, |all, x| all & x.to_f64().is_finite())
    }
}

/// Puts lanes that have left the range of mechanisms to where their windows began: they are alive no more.
#[inline(always)]
fn keep_in_range(x: &mut [Lane], members: &[Member<'_>], group: usize, alive: &mut [bool; LANES]) {
    // No number is not inside.
    let all_inside = x
        .iter()
        .flatten()
        .fold(true, |all, x| all & (x.abs() <= BEYOND));
    if !all_inside {
        put_back(x, members, group, alive);
    }
}

#[cold]
fn put_back(x: &mut [Lane], members: &[Member<'_>], group: usize, alive: &mut [bool; LANES]) {
    let outside = |x: &[Lane], lane: usize| !x.iter().all(|x| x[lane].abs() <= BEYOND);
    for lane in 0..LANES {
        if !outside(x, lane) {
            continue;
        }
        alive[lane] = false;
        for (x, &start) in x.iter_mut().zip(lane_of(members, group, lane).start) {
            x[lane] = if start.abs() <= BEYOND { start } else { 0.0 };
        }
    }
}

/// The numbers of the lanes that count, 0 in the others.
#[inline(always)]
fn where_live(x: &Lane, live: &[bool; LANES]) -> Lane {
    std::array::from_fn(|lane| if live[lane] { x[lane] } else { 0.0 })
}

/// What a network is shown: nothing beyond what any state in the range of mechanisms should be.
#[inline(always)]
fn seen(z: f64) -> f64 {
    match z.is_nan() {
        true => 0.0,
        false => z.clamp(-FARTHEST, FARTHEST),
    }
}

/// The window in a lane; the first one where there are not so many.
fn lane_of<'a, 'b>(members: &'b [Member<'a>], group: usize, lane: usize) -> &'b Member<'a> {
    members.get(group * LANES + lane).unwrap_or(&members[0])
}

/// Where eight windows stand at an integration step, and its lengths, s.
#[derive(Clone, Copy)]
pub(super) struct Stand<'a> {
    pub at: Eight<'a>,
    pub h: Lane,
}

/// Those of all groups; the first one again for groups that there are not.
pub(super) fn stands<'a>(members: &[Member<'a>], step: usize) -> [Stand<'a>; CHUNK / LANES] {
    let stand = |group: usize| {
        let at = eight_at(members, group, step);
        let h = step_of(&at);
        Stand { at, h }
    };
    let mut all = [stand(0); CHUNK / LANES];
    for (group, to) in all.iter_mut().enumerate().skip(1) {
        if group * LANES < members.len() {
            *to = stand(group);
        }
    }
    all
}

/// What was measured of eight windows at their sample `sample`.
#[inline(always)]
pub(super) fn measured<'a>(members: &[Member<'a>], group: usize, sample: usize) -> Measured<'a> {
    Measured {
        targets: std::array::from_fn(|lane| lane_of(members, group, lane).target),
        samples: std::array::from_fn(|lane| lane_of(members, group, lane).first + sample),
    }
}

/// Where eight windows stand at an integration step.
fn eight_at<'a>(members: &[Member<'a>], group: usize, step: usize) -> Eight<'a> {
    let of = |lane: usize| lane_of(members, group, lane);
    Eight {
        inputs: std::array::from_fn(|lane| of(lane).inputs),
        steps: std::array::from_fn(|lane| {
            let member = of(lane);
            member.first * member.inputs.grid.substeps() + step
        }),
    }
}

/// The lengths of the steps, s.
fn step_of(at: &Eight<'_>) -> Lane {
    std::array::from_fn(|lane| {
        let Grid { bounds, .. } = &at.inputs[lane].grid;
        bounds[at.steps[lane] + 1] - bounds[at.steps[lane]]
    })
}

/// to += h factor k.
#[inline(always)]
pub(super) fn add_scaled(to: &mut Lane, h: &Lane, factor: f64, k: &Lane) {
    for ((to, h), k) in to.iter_mut().zip(h).zip(k) {
        *to += factor * h * k;
    }
}

#[inline(always)]
fn add_lane(to: &mut Lane, from: &Lane) {
    for (to, from) in to.iter_mut().zip(from) {
        *to += from;
    }
}
