//! How the roll-outs of a chunk move with their starts, by forward tangents through classical Runge-Kutta, and Gauss and Newton's steps of the starts.
//!
//! S = ∂x/∂x₀ goes from step to step as x does: K_s = A_s (S + a_s h K_{s−1}), S⁺ = S + h/6 (K₁ + 2 K₂ + 2 K₃ + K₄), A_s = ∂f/∂X_s. What is
//! of the mechanics in A_s is there from the roll-out; what is of the network comes by its reverse pass, one output seeded at a time.

use std::cmp::Ordering;

use lagrange::LANES;
use nalgebra::DMatrix;
use pulp::NullaryFnOnce;

use super::adjoint::{Chunk, Learner, Member, NODES, Setting, Stand};
use super::adjoint::{add_scaled, measured, stands};
use crate::hybrid::Lane;
use crate::learnt::{Sight, chain};
use crate::network::Real;

/// A pivot below this share of its diagonal is none: the window says nothing of that direction, and the start does not move along it.
const NO_PIVOT: f64 = 1e-12;

/// Memory for the tangents of a chunk.
#[derive(Default)]
pub(super) struct Tangents {
    /// S at the beginning of a step: `[group][column][nx]`.
    s: Vec<Lane>,
    /// S⁺, as far as it is summed up.
    sum: Vec<Lane>,
    /// K of the last stage.
    k: Vec<Lane>,
    /// The lower rows of A, `[group][column][nx - nq]`.
    a: Vec<Lane>,
    /// Σ 2 λ s sᵀ: `[group][column][nx]`.
    curvature: Vec<Lane>,
    /// One column of a stage, and one of K.
    column: [Vec<Lane>; 2],
}

impl Tangents {
    fn begin(&mut self, groups: usize, nx: usize) {
        let zero = [0.0; LANES];
        for lanes in [
            &mut self.s,
            &mut self.sum,
            &mut self.k,
            &mut self.a,
            &mut self.curvature,
        ] {
            lanes.resize(groups * nx * nx, zero);
        }
        for column in &mut self.column {
            column.resize(nx, zero);
        }
        self.curvature.fill(zero);
        self.s.fill(zero);
        for s in self.s.chunks_exact_mut(nx * nx) {
            s.iter_mut().step_by(nx + 1).for_each(|x| *x = [1.0; LANES]);
        }
    }
}

impl<T: Real> Chunk<T> {
    /// H = Σ 2 λ s sᵀ of every window that [`forward`](Self::forward) has rolled out, s the derivatives of the compared numbers in its start:
    /// [`move_start`](Self::move_start) needs it. Comes before [`backward`](Self::backward), whose seeds it overwrites.
    pub fn curve(&mut self, setting: &Setting<'_>, learner: &Learner<T>, members: &[Member<'_>]) {
        let groups = members.len().div_ceil(LANES);
        self.tangents.begin(self.groups, self.nx);
        let processor = self.processor;
        for step in 0..self.steps {
            let stands = stands(members, step);
            for stage in 0..4 {
                let slot = 4 * step + stage;
                self.mechanics_of_tangents(setting, slot, groups);
                for o in 0..learner.outputs.len() {
                    for group in 0..groups {
                        for (other, output) in learner.outputs.iter().enumerate() {
                            let seed = if other == o { output.scale } else { 0.0 };
                            *self.tape.seed_mut(slot, other, group) = [T::from_f64(seed); LANES];
                        }
                    }
                    learner.network.backward(&mut self.tape, slot);
                    self.network_of_tangents(setting, learner, (slot, o), &stands[..groups]);
                }
                processor.run(Carry {
                    chunk: self,
                    setting,
                    members,
                    stands: &stands[..groups],
                    step,
                    stage,
                });
            }
        }
    }

    /// A of all groups at a stage, without the network.
    fn mechanics_of_tangents(&mut self, setting: &Setting<'_>, slot: usize, groups: usize) {
        let (nx, below) = (self.nx, self.nx - setting.hybrid.nq());
        let kept = below * (nx + setting.free.len());
        for group in 0..groups {
            let from = &self.linear[(slot * self.groups + group) * kept..][..below * nx];
            self.tangents.a[group * nx * nx..][..below * nx].copy_from_slice(from);
        }
    }

    /// Adds what goes through one output of the network: ∂v̇/∂Q ∂Q_NN/∂x.
    fn network_of_tangents(
        &mut self,
        setting: &Setting<'_>,
        learner: &Learner<T>,
        (slot, output): (usize, usize),
        stands: &[Stand<'_>],
    ) {
        let hybrid = setting.hybrid;
        let (n, nq, nx) = (hybrid.nv(), hybrid.nq(), self.nx);
        let below = nx - nq;
        let v = hybrid.start_of(learner.outputs[output].coordinate).v;
        for (group, stand) in stands.iter().enumerate() {
            let place = slot * self.groups + group;
            for (k, z) in self.z.iter_mut().enumerate() {
                *z = self.tape.input_gradient(slot, k, group).map(T::to_f64);
            }
            let response = &self.response[place * n * n + v * n..][..n];
            let a = &mut self.tangents.a[group * nx * nx..][..below * nx];
            let x = &self.stages[place * nx..][..nx];
            let seen = hybrid.seen_of_eight(&stand.at);
            chain(&learner.features, x, &seen, &self.z, |by, part| {
                let column = match by {
                    Sight::Position(i) => i,
                    Sight::Velocity(i) => nq + i,
                    Sight::Constant(_) => return,
                };
                for (a, response) in a[column * below..].iter_mut().zip(response) {
                    add_scaled(a, &part, 1.0, response);
                }
            });
        }
    }

    /// K_s of a stage of one group, added to S⁺.
    #[inline(always)]
    fn carry(&mut self, nq: usize, h: &Lane, stage: usize, group: usize) {
        let nx = self.nx;
        let below = nx - nq;
        let Tangents {
            s,
            sum,
            k,
            a,
            column,
            ..
        } = &mut self.tangents;
        let a = &a[group * nx * nx..][..below * nx];
        let [point, slope] = column;
        for c in 0..nx {
            let at = (group * nx + c) * nx;
            point.copy_from_slice(&s[at..at + nx]);
            let k = &mut k[at..at + nx];
            if stage > 0 {
                for (point, k) in point.iter_mut().zip(&*k) {
                    add_scaled(point, h, NODES[stage], k);
                }
            }
            slope[..nq].copy_from_slice(&point[nq..2 * nq]);
            slope[nq..].fill([0.0; LANES]);
            for (entries, x) in a.chunks_exact(below).zip(&*point) {
                for (slope, entry) in slope[nq..].iter_mut().zip(entries) {
                    add_scaled(slope, entry, 1.0, x);
                }
            }
            k.copy_from_slice(slope);
            let weight = [1.0, 2.0, 2.0, 1.0][stage] / 6.0;
            for (sum, k) in sum[at..at + nx].iter_mut().zip(k) {
                add_scaled(sum, h, weight, k);
            }
        }
    }

    /// Adds what a sample of all groups says to H.
    #[inline(always)]
    fn add_curvature(&mut self, setting: &Setting<'_>, members: &[Member<'_>], sample: usize) {
        let nx = self.nx;
        let Tangents { s, curvature, .. } = &mut self.tangents;
        let groups = members.len().div_ceil(LANES);
        for group in 0..groups {
            let at = measured(members, group, sample);
            let s = &s[group * nx * nx..][..nx * nx];
            let curvature = &mut curvature[group * nx * nx..][..nx * nx];
            setting.loss.weights_of_eight(&at, |entry, weights| {
                for i in 0..nx {
                    let mut scaled = s[i * nx + entry];
                    for (scaled, weight) in scaled.iter_mut().zip(weights) {
                        *scaled *= 2.0 * weight;
                    }
                    for j in 0..=i {
                        add_scaled(&mut curvature[j * nx + i], &scaled, 1.0, &s[j * nx + entry]);
                    }
                }
            });
        }
    }

    /// Levenberg and Marquardt's step of the start of one of the windows, −(H + μ diag H)⁻¹ ∂S/∂x₀, S its sum and μ its `damping`, added to `start`;
    /// after [`curve`](Self::curve) and [`backward`](Self::backward). H is used up. A window without a motion to its end stays, and so do entries of the
    /// state beyond those of `start`.
    pub fn move_start(&mut self, window: usize, damping: f64, start: &mut [f64]) {
        let (nx, group, lane) = (self.nx, window / LANES, window % LANES);
        let factor = self.factor(window);
        if factor == 0.0 {
            return;
        }
        let n = start.len();
        self.factorise(window, damping, n);
        let h = &self.tangents.curvature[group * nx * nx..][..nx * nx];
        let step = &mut self.by_start[window * nx..][..n];
        step.iter_mut().for_each(|step| *step /= -factor);
        for i in 0..n {
            let known: f64 = (0..i).map(|k| h[k * nx + i][lane] * step[k]).sum();
            step[i] = (step[i] - known) / h[i * nx + i][lane];
        }
        for i in (0..n).rev() {
            let known: f64 = (i + 1..n).map(|k| h[i * nx + k][lane] * step[k]).sum();
            step[i] = (step[i] - known) / h[i * nx + i][lane];
        }
        if step.iter().all(|step| step.is_finite()) {
            for (start, step) in start.iter_mut().zip(step) {
                *start += *step;
            }
        }
    }

    /// H + μ diag H = L Lᵀ for the first `n` entries of the start of a window, L below the diagonal in the place of H; what no measurement says
    /// anything about has an infinite pivot.
    fn factorise(&mut self, window: usize, damping: f64, n: usize) {
        let (nx, group, lane) = (self.nx, window / LANES, window % LANES);
        let h = &mut self.tangents.curvature[group * nx * nx..][..nx * nx];
        for j in 0..n {
            let diagonal = h[j * nx + j][lane];
            let mut pivot = diagonal * (1.0 + damping);
            for k in 0..j {
                pivot -= h[k * nx + j][lane].powi(2);
            }
            let none = !(pivot > NO_PIVOT * diagonal && pivot.is_finite());
            let root = if none { f64::INFINITY } else { pivot.sqrt() };
            h[j * nx + j][lane] = root;
            for i in j + 1..n {
                let mut entry = h[j * nx + i][lane];
                for k in 0..j {
                    entry -= h[k * nx + i][lane] * h[k * nx + j][lane];
                }
                h[j * nx + i][lane] = entry / root;
            }
        }
    }

    /// L of the first `n` entries of the start of a window, L Lᵀ = H + μ diag H the curvature of what it counts; after [`curve`](Self::curve). H is used
    /// up. Pivots are infinite where nothing is known, and in a window without a motion to its end.
    pub fn factor_of_curvature(&mut self, window: usize, damping: f64, n: usize) -> DMatrix<f64> {
        let root = self.factor(window).sqrt();
        self.factorise(window, damping, n);
        let (nx, group, lane) = (self.nx, window / LANES, window % LANES);
        let l = &self.tangents.curvature[group * nx * nx..][..nx * nx];
        DMatrix::from_fn(n, n, |i, j| match (root == 0.0, i.cmp(&j)) {
            (true, Ordering::Equal) => f64::INFINITY,
            (false, Ordering::Equal | Ordering::Greater) => root * l[j * nx + i][lane],
            _ => 0.0,
        })
    }
}

/// The part of [`Chunk::curve`] in lanes, compiled for the processor: a stage of all groups.
struct Carry<'c, 'a, 'b, T: Real> {
    chunk: &'c mut Chunk<T>,
    setting: &'a Setting<'b>,
    members: &'a [Member<'b>],
    stands: &'a [Stand<'b>],
    step: usize,
    stage: usize,
}

impl<T: Real> NullaryFnOnce for Carry<'_, '_, '_, T> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Carry {
            chunk,
            setting,
            members,
            stands,
            step,
            stage,
        } = self;
        let substeps = members.first().map_or(1, |m| m.inputs.grid.substeps());
        if stage == 0 {
            if step == 0 && setting.loss.first == 0 {
                chunk.add_curvature(setting, members, 0);
            }
            let Tangents { s, sum, .. } = &mut chunk.tangents;
            sum.copy_from_slice(s);
        }
        for (group, stand) in stands.iter().enumerate() {
            chunk.carry(setting.hybrid.nq(), &stand.h, stage, group);
        }
        if stage == 3 {
            let Tangents { s, sum, .. } = &mut chunk.tangents;
            s.copy_from_slice(sum);
            if (step + 1).is_multiple_of(substeps) {
                chunk.add_curvature(setting, members, (step + 1) / substeps);
            }
        }
    }
}
