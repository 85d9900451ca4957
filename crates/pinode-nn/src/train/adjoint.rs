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

use super::loss::{Loss, Target};
use crate::effect::Grid;
use crate::hybrid::{DrivenInputs, Eight, EightMemory, Hybrid, Lane};
use crate::learnt::{Feature, Output, Seen, Sight, chain, see};
use crate::network::{Mlp, Real, Tape};

/// Windows that are rolled out together, on one thread. A batch is cut into such chunks whatever the number of threads.
pub(crate) const CHUNK: usize = 64;
/// A state beyond is no mechanism's.
const BEYOND: f64 = 1e6;
/// A network sees nothing beyond so many widths.
const FARTHEST: f64 = 1e4;
/// a_s.
const NODES: [f64; 4] = [0.0, 0.5, 0.5, 1.0];

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
    tape: Tape<T>,
    eights: EightMemory,
    /// Entries of a state.
    nx: usize,
    /// Steps of a window.
    steps: usize,
    /// Groups of eight states that there is room for.
    groups: usize,
    /// x at the beginning of each step and at the end: `[step][group][nx]`.
    x: Vec<Lane>,
    /// X_s: `[4 step + s][group][nx]`.
    stages: Vec<Lane>,
    /// ∂(v̇, ḣ)/∂(q, v, h, θ_free) at X_s: `[4 step + s][group][…]`.
    linear: Vec<Lane>,
    /// ∂v̇/∂Q at X_s.
    response: Vec<Lane>,
    /// k_s of the step under way: `[s][group][nx]`; on the way back λ, k̄ and X̄.
    slopes: Vec<Lane>,
    lambda: Vec<Lane>,
    weights: Vec<Lane>,
    before: Vec<Lane>,
    z: Vec<Lane>,
    /// Which lanes have had a motion up to each step.
    alive: Vec<[bool; LANES]>,
    /// Which lanes are windows that have a motion to their end: the others count nothing, and may hold no numbers.
    live: Vec<[bool; LANES]>,
    /// Σ of the windows' losses, without those that left the range of any mechanism.
    pub loss: f64,
    /// How many of these there were.
    pub diverged: usize,
    /// ∂/∂ parameters of the network.
    pub gradient: Vec<T>,
    /// ∂/∂θ_free.
    pub by_theta: Vec<f64>,
    /// ∂/∂ start, state after state.
    by_start: Vec<f64>,
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
            loss: 0.0,
            diverged: 0,
            gradient: vec![T::from_f64(0.0); learner.network.parameters().len()],
            by_theta: vec![0.0; setting.free.len()],
            by_start: vec![0.0; LANES * groups * nx],
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
            for (stage, node) in NODES.into_iter().enumerate() {
                let slot = 4 * step + stage;
                for group in 0..groups {
                    let at = eight_at(members, group, step);
                    let h = step_of(&at);
                    let x = &self.x[(step * self.groups + group) * nx..][..nx];
                    let to = &mut self.stages[(slot * self.groups + group) * nx..][..nx];
                    to.copy_from_slice(x);
                    if stage > 0 {
                        let k = &self.slopes[((stage - 1) * self.groups + group) * nx..][..nx];
                        for (to, k) in to.iter_mut().zip(k) {
                            add_scaled(to, &h, node, k);
                        }
                    }
                    let alive = &mut self.alive[step * self.groups + group];
                    keep_in_range(to, members, group, alive);
                    see(
                        &learner.features,
                        to,
                        &setting.hybrid.seen_of_eight(&at),
                        &mut self.z,
                    );
                    for (k, z) in self.z.iter().enumerate() {
                        *self.tape.input_mut(slot, k, group) = z.map(|z| T::from_f64(seen(z)));
                    }
                }
                learner.network.forward(&mut self.tape, slot);
                for group in 0..groups {
                    let place = slot * self.groups + group;
                    self.eights.added.fill([0.0; LANES]);
                    for (o, output) in learner.outputs.iter().enumerate() {
                        let v = setting.hybrid.start_of(output.coordinate).v;
                        let y = self.tape.output(slot, o, group);
                        self.eights.added[v] = y.map(|y| output.scale * y.to_f64());
                    }
                    let at = eight_at(members, group, step);
                    let x = &self.stages[place * nx..][..nx];
                    setting
                        .hybrid
                        .linearize_eight(x, setting.theta, &at, &mut self.eights)?;
                    let linear = &self.eights.linear;
                    self.linear[place * linear.len()..][..linear.len()].copy_from_slice(linear);
                    self.response[place * n * n..][..n * n].copy_from_slice(self.eights.response());
                    let k = &mut self.slopes[(stage * self.groups + group) * nx..][..nx];
                    k[..nq].copy_from_slice(&x[nq..nq + n]);
                    k[nq..].copy_from_slice(&self.eights.rates);
                }
            }
            self.advance(members, step, groups);
        }
        self.sum_up(setting, members, groups);
        Ok(())
    }

    /// x⁺; a lane that leaves the range of mechanisms goes on from where its window began, and counts no more.
    fn advance(&mut self, members: &[Member<'_>], step: usize, groups: usize) {
        let nx = self.nx;
        for group in 0..groups {
            let h = step_of(&eight_at(members, group, step));
            let (from, to) = self.x.split_at_mut((step + 1) * self.groups * nx);
            let from = &from[(step * self.groups + group) * nx..][..nx];
            let to = &mut to[group * nx..][..nx];
            to.copy_from_slice(from);
            for (stage, weight) in [1.0, 2.0, 2.0, 1.0].into_iter().enumerate() {
                let k = &self.slopes[(stage * self.groups + group) * nx..][..nx];
                for (to, k) in to.iter_mut().zip(k) {
                    add_scaled(to, &h, weight / 6.0, k);
                }
            }
            let mut alive = self.alive[step * self.groups + group];
            keep_in_range(to, members, group, &mut alive);
            self.alive[(step + 1) * self.groups + group] = alive;
        }
    }

    fn sum_up(&mut self, setting: &Setting<'_>, members: &[Member<'_>], groups: usize) {
        let nx = self.nx;
        (self.loss, self.diverged) = (0.0, 0);
        for group in 0..groups {
            for lane in 0..LANES {
                let is_window = group * LANES + lane < members.len();
                let live = is_window && self.alive[self.steps * self.groups + group][lane];
                self.live[group][lane] = live;
                self.diverged += usize::from(is_window && !live);
                if !live {
                    continue;
                }
                let member = lane_of(members, group, lane);
                for sample in setting.loss.first..=setting.samples {
                    let step = sample * member.inputs.grid.substeps;
                    let x = &self.x[(step * self.groups + group) * nx..][..nx];
                    let state = |i: usize| x[i][lane];
                    self.loss += setting.loss.at(member.target, member.first + sample, state);
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
        let (nx, hybrid) = (self.nx, setting.hybrid);
        let groups = members.len().div_ceil(LANES);
        self.by_theta.fill(0.0);
        self.lambda.fill([0.0; LANES]);
        for step in (0..self.steps).rev() {
            self.add_losses(setting, members, step + 1, groups);
            // `before` gathers ∂J/∂x at the beginning of the step.
            self.before.copy_from_slice(&self.lambda);
            for stage in (0..4).rev() {
                let slot = 4 * step + stage;
                for group in 0..groups {
                    self.weigh(hybrid, members, (step, stage, group));
                    self.seed(learner, hybrid, slot, group);
                }
                learner.network.backward(&mut self.tape, slot);
                for group in 0..groups {
                    self.pull_back(setting, learner, members, (step, stage, group));
                }
            }
            self.lambda.copy_from_slice(&self.before);
        }
        self.add_losses(setting, members, 0, groups);
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
    }

    /// ∂/∂ start of one of the windows.
    pub fn by_start_of(&self, window: usize) -> &[f64] {
        &self.by_start[window * self.nx..][..self.nx]
    }

    /// Adds to λ what the loss at the sample that ends with step `step` − 1 says; nothing where a lane does not count.
    fn add_losses(
        &mut self,
        setting: &Setting<'_>,
        members: &[Member<'_>],
        step: usize,
        groups: usize,
    ) {
        let nx = self.nx;
        for group in 0..groups {
            for lane in 0..LANES {
                let member = lane_of(members, group, lane);
                let substeps = member.inputs.grid.substeps;
                let sample = step / substeps;
                if !step.is_multiple_of(substeps)
                    || sample < setting.loss.first
                    || !self.live[group][lane]
                {
                    continue;
                }
                let x = &self.x[(step * self.groups + group) * nx..][..nx];
                let lambda = &mut self.lambda[group * nx..][..nx];
                let state = |i: usize| x[i][lane];
                setting
                    .loss
                    .gradient(member.target, member.first + sample, state, |i, part| {
                        lambda[i][lane] += part;
                    });
            }
        }
    }

    /// k̄ of a stage, into `weights`: h b_s λ + h a_{s+1} X̄_{s+1}, where X̄ of the stage after is in `slopes`.
    fn weigh(
        &mut self,
        hybrid: &Hybrid,
        members: &[Member<'_>],
        (step, stage, group): (usize, usize, usize),
    ) {
        debug_assert_eq!(hybrid.nx(), self.nx);
        let nx = self.nx;
        let h = step_of(&eight_at(members, group, step));
        let to = &mut self.weights[group * nx..][..nx];
        to.fill([0.0; LANES]);
        let part = [1.0, 2.0, 2.0, 1.0][stage] / 6.0;
        for (to, lambda) in to.iter_mut().zip(&self.lambda[group * nx..][..nx]) {
            add_scaled(to, &h, part, lambda);
        }
        if stage < 3 {
            let after = &self.slopes[((stage + 1) * self.groups + group) * nx..][..nx];
            for (to, after) in to.iter_mut().zip(after) {
                add_scaled(to, &h, NODES[stage + 1], after);
            }
        }
    }

    /// The adjoints of the network's outputs: s_j Σ_i ∂v̇_i/∂Q_j k̄_i.
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
            *self.tape.seed_mut(slot, o, group) = sum.map(|s| T::from_f64(output.scale * s));
        }
    }

    /// X̄ = (∂f/∂x)ᵀ k̄ into `slopes`, and added to `before`; the parts in θ_free to `by_theta`.
    fn pull_back(
        &mut self,
        setting: &Setting<'_>,
        learner: &Learner<T>,
        members: &[Member<'_>],
        (step, stage, group): (usize, usize, usize),
    ) {
        let hybrid = setting.hybrid;
        let (n, nq, nx) = (hybrid.nv(), hybrid.nq(), self.nx);
        let slot = 4 * step + stage;
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
            *z = self.tape.input_gradient(slot, k, group).map(T::to_f64);
        }
        let at = eight_at(members, group, step);
        let place_of: Seen<'_> = hybrid.seen_of_eight(&at);
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

/// Puts lanes that have left the range of mechanisms to where their windows began: they are alive no more.
fn keep_in_range(x: &mut [Lane], members: &[Member<'_>], group: usize, alive: &mut [bool; LANES]) {
    let mut inside = [true; LANES];
    for x in x.iter() {
        for (inside, x) in inside.iter_mut().zip(x) {
            *inside &= x.abs() <= BEYOND;
        }
    }
    if inside == [true; LANES] {
        return;
    }
    for lane in (0..LANES).filter(|&lane| !inside[lane]) {
        alive[lane] = false;
        for (x, &start) in x.iter_mut().zip(lane_of(members, group, lane).start) {
            x[lane] = if start.abs() <= BEYOND { start } else { 0.0 };
        }
    }
}

/// The numbers of the lanes that count, 0 in the others.
fn where_live(x: &Lane, live: &[bool; LANES]) -> Lane {
    std::array::from_fn(|lane| if live[lane] { x[lane] } else { 0.0 })
}

/// What a network is shown: nothing beyond what any state in the range of mechanisms should be.
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

/// Where eight windows stand at an integration step.
fn eight_at<'a>(members: &[Member<'a>], group: usize, step: usize) -> Eight<'a> {
    let of = |lane: usize| lane_of(members, group, lane);
    Eight {
        inputs: std::array::from_fn(|lane| of(lane).inputs),
        steps: std::array::from_fn(|lane| {
            let member = of(lane);
            member.first * member.inputs.grid.substeps + step
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
fn add_scaled(to: &mut Lane, h: &Lane, factor: f64, k: &Lane) {
    for ((to, h), k) in to.iter_mut().zip(h).zip(k) {
        *to += factor * h * k;
    }
}

fn add_lane(to: &mut Lane, from: &Lane) {
    for (to, from) in to.iter_mut().zip(from) {
        *to += from;
    }
}
