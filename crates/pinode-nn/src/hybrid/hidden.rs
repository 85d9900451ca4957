//! Where a recorded motion takes the states of the effects with a memory.

use nalgebra::DVector;

use super::{DrivenInputs, Hybrid, State};
use crate::effect::{Kind, MOST_STATES, MemoryForce, Scales, Seen};

/// Longest step of a pass, in units of the fastest rate.
const RESOLVED: f64 = 0.5;
/// At most so many steps of a pass in one integration step of the model; a single state that is faster follows the motion.
const MOST_STEPS: usize = 16;

/// h along a recording.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct HiddenPath {
    nh: usize,
    values: Vec<f64>,
}

impl HiddenPath {
    /// h at sample `k`, nh numbers.
    pub fn at(&self, k: usize) -> &[f64] {
        &self.values[self.nh * k..self.nh * (k + 1)]
    }
}

impl Hybrid {
    /// The states that the effects with a memory start with at the velocities v under the inputs of integration step `step`, where nothing of
    /// before is known.
    pub fn hidden_start(
        &self,
        v: &[f64],
        theta: &[f64],
        inputs: &DrivenInputs,
        step: usize,
    ) -> Vec<f64> {
        let mut h = vec![0.0; self.nh()];
        if h.is_empty() || step >= inputs.grid.steps() {
            return h;
        }
        let mut driven = DVector::zeros(self.nv());
        self.drive_directly(inputs, step, &mut driven);
        for (index, effect) in self.effects.iter().enumerate() {
            if let Some(law) = effect.kind.memory() {
                let (at, f) = self.force_seen(index, inputs, step, &driven);
                let p = &theta[self.ranges[index].clone()];
                law.start(v[at.v], f, p, &mut h[self.state_ranges[index].clone()]);
            }
        }
        h
    }

    /// A state (q, v, h) at the first sample of `inputs`, of which `initial` has all or q and v alone.
    pub(crate) fn whole_start(
        &self,
        initial: &[f64],
        theta: &[f64],
        inputs: &DrivenInputs,
    ) -> Vec<f64> {
        let mut start = initial.to_vec();
        if start.len() < self.nx() {
            let (_, v) = initial.split_at(self.nq().min(initial.len()));
            start.extend(self.hidden_start(v, theta, inputs, 0));
        }
        start
    }

    /// h along a recording under `inputs`, when q and v go as `motion` has them, (q, v) a sample, linear in between. Each effect is
    /// taken by itself, from its [`hidden_start`](Self::hidden_start).
    pub fn hidden_path(
        &self,
        theta: &[f64],
        inputs: &DrivenInputs,
        motion: &dyn Fn(usize) -> Vec<f64>,
    ) -> HiddenPath {
        let nh = self.nh();
        let samples = inputs.grid.samples();
        let mut path = HiddenPath {
            nh,
            values: vec![0.0; nh * samples],
        };
        if nh == 0 || samples == 0 {
            return path;
        }
        let states: Vec<Vec<f64>> = (0..samples).map(motion).collect();
        let first = self.parts_without_memory(&states[0]);
        let start = self.hidden_start(first.v, theta, inputs, 0);
        path.values[..nh].copy_from_slice(&start);
        let mut driven = DVector::zeros(self.nv());
        for (index, effect) in self.effects.iter().enumerate() {
            let Some(law) = effect.kind.memory() else {
                continue;
            };
            let own = self.state_range(index);
            let p = &theta[self.range(index)];
            let smoothing = effect.smoothing;
            let mut h = [0.0; MOST_STATES];
            let h = &mut h[..own.len()];
            h.copy_from_slice(&start[own.clone()]);
            // Of a motor that is read T = f − J v̇_m is known.
            if let Some(motor) = self.motor_read(index, theta) {
                let last = samples.saturating_sub(2);
                for (sample, state) in states.iter().enumerate() {
                    let before = sample.min(last);
                    let steps = inputs.grid.steps_from(before);
                    let (Some(next), false) = (states.get(before + 1), steps.is_empty()) else {
                        break;
                    };
                    self.drive_directly(inputs, steps.start, &mut driven);
                    let (at, f) = self.force_seen(index, inputs, steps.start, &driven);
                    let v = |state| self.parts_without_memory(state).v[at.v];
                    let time = inputs.grid.bounds[steps.end] - inputs.grid.bounds[steps.start];
                    let inertia = p[motor.inertia] * (v(next) - v(&states[before])) / time;
                    law.start(v(state), f - inertia, p, h);
                    let to = nh * sample + own.start;
                    path.values[to..to + own.len()].copy_from_slice(h);
                }
                continue;
            }
            for sample in 0..samples - 1 {
                let (a, b) = (&states[sample], &states[sample + 1]);
                let steps = inputs.grid.steps_from(sample);
                let substeps = steps.len();
                for (sub, step) in steps.enumerate() {
                    let from = sub as f64 / substeps as f64;
                    let width = 1.0 / substeps as f64;
                    let duration = inputs.grid.bounds[step + 1] - inputs.grid.bounds[step];
                    let (here, there) =
                        (self.parts_without_memory(a), self.parts_without_memory(b));
                    self.drive_directly(inputs, step, &mut driven);
                    let (at, f) = self.force_seen(index, inputs, step, &driven);
                    let ends = |s: f64| {
                        let mix = |x: &[f64], y: &[f64], i: usize| x[i] + s * (y[i] - x[i]);
                        Seen {
                            q: mix(here.q, there.q, at.q),
                            v: mix(here.v, there.v, at.v),
                            f,
                            h: &[],
                        }
                    };
                    let speed = ends(from).v.abs().max(ends(from + width).v.abs());
                    let rate = law.fastest(speed, f64::INFINITY, p);
                    // Of no rate at all, infinitely many: it follows.
                    let needed = (duration * rate / RESOLVED).ceil().max(1.0);
                    let steps = needed.min(MOST_STEPS as f64) as usize;
                    let follows = needed > steps as f64 && own.len() == 1;
                    for k in 0..steps {
                        let s = |x: f64| from + width * (k as f64 + x) / steps as f64;
                        let dt = duration / steps as f64;
                        match follows {
                            true => follow(law, ends(s(0.5)), p, smoothing, dt, &mut h[0]),
                            false => advance(law, &|x| ends(s(x)), p, smoothing, dt, h),
                        }
                    }
                }
                let to = nh * (sample + 1) + own.start;
                path.values[to..to + own.len()].copy_from_slice(h);
            }
        }
        path
    }

    /// Standard deviations of h at the start of a window about a [path](Self::hidden_path): one a state. Once the parameters are `fitted`,
    /// states that forget their beginning may [stray](crate::effect::MemoryLaw::stray) from that path no further than their sensor's noise.
    pub fn hidden_spread(&self, theta: &[f64], scales: &[Scales], fitted: bool) -> Vec<f64> {
        let mut spread = vec![0.0; self.nh()];
        for (index, effect) in self.effects.iter().enumerate() {
            if let Some(law) = effect.kind.memory() {
                let scale = &scales[self.coordinate_of(effect.kind, effect.target)];
                let p = &theta[self.range(index)];
                let own = &mut spread[self.state_range(index)];
                law.spread(scale.force, scale.speed, p, own);
                if fitted {
                    law.stray(scale.noise, p, own);
                }
            }
        }
        spread
    }

    /// The fastest rate of the effects with a memory, 1/s.
    pub fn fastest_memory(&self, theta: &[f64], scales: &[Scales]) -> f64 {
        self.fastest(theta, scales, |kind, scale, p| {
            Some(kind.memory()?.fastest(scale.speed, scale.free_mass, p))
        })
    }

    /// Whether an effect is a stop.
    pub fn has_stops(&self) -> bool {
        self.effects.iter().any(|e| e.kind.stop().is_some())
    }

    /// The fastest rate of the blows on stops, 1/s.
    pub fn fastest_blow(&self, theta: &[f64], scales: &[Scales]) -> f64 {
        self.fastest(theta, scales, |kind, scale, p| {
            Some(kind.stop()?.rate(scale.mass, p))
        })
    }

    /// The largest of the rates `of` effects with these parameters, on targets of these scales; 0 without one.
    fn fastest(
        &self,
        theta: &[f64],
        scales: &[Scales],
        of: impl Fn(&Kind, &Scales, &[f64]) -> Option<f64>,
    ) -> f64 {
        let effects = self.effects.iter().enumerate();
        effects
            .filter_map(|(index, effect)| {
                let scale = &scales[self.coordinate_of(effect.kind, effect.target)];
                of(effect.kind, scale, &theta[self.range(index)])
            })
            .fold(0.0, f64::max)
    }

    /// (q, v) of a state that may lack its h.
    fn parts_without_memory<'a>(&self, x: &'a [f64]) -> State<'a> {
        let (q, rest) = x.split_at(self.nq());
        State {
            q,
            v: &rest[..self.nv()],
            h: &[],
        }
    }
}

/// One step of the exponential Euler method of one state h, ḣ = r(h): h + r (e^{λ dt} − 1)/λ with λ = dr/dh, exact where r is linear in h. `seen`
/// is the middle of the step.
fn follow(
    law: &dyn MemoryForce,
    seen: Seen<'_, f64>,
    p: &[f64],
    smoothing: f64,
    dt: f64,
    h: &mut f64,
) {
    let rate = |h: f64| {
        let mut rate = [0.0];
        law.evaluate(&Seen { h: &[h], ..seen }, p, smoothing, &mut rate);
        rate[0]
    };
    let there = rate(*h);
    let nudge = 1e-6 * (h.abs() + there.abs() * dt);
    let by_h = if nudge > 0.0 {
        (rate(*h + nudge) - there) / nudge
    } else {
        0.0
    };
    *h += match by_h < 0.0 {
        true => there * (by_h * dt).exp_m1() / by_h,
        false => there * dt,
    };
}

/// One step of classical Runge-Kutta of h; `seen` gives q, v and f at a fraction of the step.
fn advance<'a>(
    law: &dyn MemoryForce,
    seen: &dyn Fn(f64) -> Seen<'a, f64>,
    p: &[f64],
    smoothing: f64,
    dt: f64,
    h: &mut [f64],
) {
    let n = h.len();
    let mut sum = [0.0; MOST_STATES];
    let mut rate = [0.0; MOST_STATES];
    for (fraction, weight) in [(0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (1.0, 1.0)] {
        let mut at = [0.0; MOST_STATES];
        for i in 0..n {
            at[i] = h[i] + fraction * dt * rate[i];
        }
        let now = Seen {
            h: &at[..n],
            ..seen(fraction)
        };
        law.evaluate(&now, p, smoothing, &mut rate[..n]);
        for i in 0..n {
            sum[i] += weight * rate[i];
        }
    }
    for i in 0..n {
        h[i] += dt / 6.0 * sum[i];
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use std::path::Path;

    use super::*;
    use crate::effect::registry;
    use crate::hybrid::Placed;
    use crate::model::Model;

    /// Bristles that settle in a hundredth of an integration step stand where ż = 0: z = g(v) sgn(v)/σ₀.
    #[test]
    fn stiff_bristles_follow_the_motion() {
        let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models");
        let mut hybrid = Hybrid::of(&Model::load(&models.join("cartpole/cartpole.toml")).unwrap());
        let placed = Placed {
            kind: registry::find("lugre_friction").unwrap(),
            target: 0,
            smoothing: 0.01,
            fixed: false,
        };
        let (stiffness, coulomb, statics, slow) = (2e6, 0.3, 0.5, 0.1);
        hybrid.add(placed, &[stiffness, 0.0, coulomb, statics, slow]);
        let theta = hybrid.theta();
        let t: Vec<f64> = (0..200).map(|k| 0.02 * f64::from(k)).collect();
        let inputs = hybrid.drive(&t, &[vec![0.0; 200]], 4, &theta, &[]);
        let v = |k: usize| 0.4 * (3.0 * t[k]).sin();
        let path = hybrid.hidden_path(&theta, &inputs, &|k| vec![0.0, 0.0, v(k), 0.0]);
        let mut moving = 0;
        for k in (1..200).filter(|&k| v(k).abs() > 0.1) {
            // The last step saw the velocity of its middle, at most an integration step before.
            let middle = |v: f64| coulomb + (statics - coulomb) * (-(v / slow).powi(2)).exp();
            let expected = v(k).signum() / stiffness * middle(v(k) - 1e-3 * (v(k) - v(k - 1)));
            let found = path.at(k)[0];
            assert!(
                (found / expected - 1.0).abs() < 0.03,
                "{k}: {found:e} for {expected:e}"
            );
            moving += 1;
        }
        assert!(moving > 100);
    }
}
