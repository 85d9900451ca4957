//! Steps of eight windows at once that are not bound by the fastest rate of the model.

mod equations;

use lagrange::LANES;

use super::Diverged;
use crate::hybrid::{Eight, EightMemory, Hybrid, Lane};
use crate::processor::Processor;

use equations::{Change, Columns};

/// γ of the two stages, 1 − 1/√2.
const GAMMA: f64 = 1.0 - std::f64::consts::FRAC_1_SQRT_2;
/// The second stage starts so many times as far from the beginning of the step as the first stage ends, (1 − γ)/γ.
const FURTHER: f64 = 1.0 + std::f64::consts::SQRT_2;
/// A stage is solved once an iteration changes its velocities by less than this, m/s or rad/s, and this part of their size; states with a memory by
/// this part of theirs, or by next to nothing.
const SOLVED: f64 = 1e-7;
const NEXT_TO_NOTHING: f64 = 1e-12;
const MOST_ITERATIONS: usize = 20;
/// A step that is not solved is made of two halves, and those again, so many times.
pub(super) const HALVINGS: usize = 6;
/// A stage that takes more iterations than this is linearised anew.
const STALE: usize = 4;

/// The diagonally implicit Runge–Kutta method of two stages and order 2 that is L-stable and stiffly accurate (Alexander, SIAM J. Numer.
/// Anal. 14, 1977), for x = (q, y) with q̇ = v, ẏ = f(q, y), y = (v, h):
///
/// y₁ = y + γh f(q₁, y₁), q₁ = q + γh v₁; then the same from x + (1 + √2)(x₁ − x).
///
/// Dry friction on what is light stops it within less than a step: the end of the step is at rest as well.
///
/// A stage is solved by Newton's iteration, W δ = y − y_b − γh f with W = I − γh ∂f/∂y − (γh)² ∂f/∂q (∂v/∂y). In W the slopes of the forces on
/// the joints are those of the iterate, the rest is that of the last linearisation. The derivatives of the solution in anything, S, are exact:
/// W S_y = S_yb + γh (∂f/∂q S_qb + ∂f/∂θ).
#[derive(Default)]
pub(super) struct Stiff {
    /// Whether there is a linearisation to go by.
    known: bool,
    /// The stage that is solved: its x, and how its y changes.
    point: Vec<Lane>,
    change: Vec<Lane>,
    /// What the last stage added to its y: γh f.
    added: Vec<Lane>,
    /// What the stages start from, and end at, all columns.
    from: Vec<Lane>,
    to: Vec<Lane>,
    /// W, row after row, then its factors L (below the diagonal, which is 1) and U.
    matrix: Vec<Lane>,
    /// ∂f/∂(q, y) of the last linearisation, ∂v̇/∂Q and ∂Q/∂v there.
    linear: Vec<Lane>,
    response: Vec<Lane>,
    slopes: Vec<Lane>,
}

/// What a step is taken on: the model at θ, the steps of the grids, the processor.
#[derive(Clone, Copy)]
pub(super) struct On<'a> {
    pub hybrid: &'a Hybrid,
    pub theta: &'a [f64],
    pub at: &'a Eight<'a>,
    pub processor: Processor,
}

impl Stiff {
    /// A new roll-out: nothing is known of it.
    pub fn forget(&mut self) {
        self.known = false;
        self.added.clear();
    }

    /// One step of length `h` of the columns (x, S) in `base`: x alone, or with S = ∂x/∂(x₀, θ_free) and, where there are more, the derivatives in
    /// (Q, ḣ), held along the step. Where friction that falls with the speed leaves it no solution, or several, it is made of two halves, and these
    /// again, at most `halvings` times.
    pub fn step(
        &mut self,
        on: On<'_>,
        h: Lane,
        memory: &mut EightMemory,
        base: &mut [Lane],
        halvings: usize,
    ) -> Result<(), Diverged> {
        match self.whole(on, h, memory, base) {
            Err(Diverged::NoConvergence { .. }) if halvings > 0 => {
                let half = h.map(|h| 0.5 * h);
                for _ in 0..2 {
                    self.forget();
                    self.step(on, half, memory, base, halvings - 1)?;
                }
                Ok(())
            }
            done => done,
        }
    }

    /// One step; `base` is left as it was where it fails.
    fn whole(
        &mut self,
        on: On<'_>,
        h: Lane,
        memory: &mut EightMemory,
        base: &mut [Lane],
    ) -> Result<(), Diverged> {
        let nx = on.hybrid.nx();
        let g = h.map(|h| GAMMA * h);
        self.from.clear();
        self.from.extend_from_slice(base);
        self.to.resize(base.len(), [0.0; LANES]);
        self.point.clear();
        self.point.extend_from_slice(&base[..nx]);
        self.stage(on, g, memory)?;
        for ((from, to), base) in self.from.iter_mut().zip(&self.to).zip(&*base) {
            for ((from, to), base) in from.iter_mut().zip(to).zip(base) {
                *from = base + FURTHER * (to - base);
            }
        }
        self.stage(on, g, memory)?;
        base.copy_from_slice(&self.to);
        Ok(())
    }

    /// From `from` to `to`; the iteration starts at y of `point`.
    fn stage(&mut self, on: On<'_>, g: Lane, memory: &mut EightMemory) -> Result<(), Diverged> {
        let On {
            hybrid,
            theta,
            at,
            processor,
        } = on;
        let (n, nx) = (hybrid.nv(), hybrid.nx());
        let sizes = (n, nx);
        if !self.known {
            self.linearize(on, memory)?;
        }
        // The last stage goes on.
        self.added.resize(nx - n, [0.0; LANES]);
        let guesses = self.point[n..].iter_mut().zip(&self.from[n..]);
        for ((y, from), added) in guesses.zip(&self.added) {
            for (lane, y) in y.iter_mut().enumerate() {
                *y = from[lane] + added[lane];
            }
        }
        let mut iterations = 0;
        loop {
            self.place(n, g);
            if iterations > 0 && iterations % STALE == 0 {
                self.linearize(on, memory)?;
            }
            hybrid
                .accelerate_eight(&self.point, theta, at, memory, true)
                .map_err(Diverged::Dynamics)?;
            self.change.clear();
            self.change.extend_from_slice(&memory.rates);
            let below = nx - n;
            self.matrix.resize(below * below, [0.0; LANES]);
            processor.run(Change {
                sizes,
                g,
                from: &self.from[n..nx],
                y: &self.point[n..nx],
                linear: &self.linear,
                response: &self.response,
                slopes: (&self.slopes, &memory.slopes),
                matrix: &mut self.matrix,
                change: &mut self.change,
            });
            iterations += 1;
            if self.move_by_change(hybrid) {
                break;
            }
            if iterations == MOST_ITERATIONS {
                Diverged::check(self.point.as_flattened())?;
                return Err(Diverged::NoConvergence {
                    iterations,
                    change: self.largest_change(n),
                });
            }
        }
        self.place(n, g);
        if self.from.len() > nx {
            self.linearize(on, memory)?;
            processor.run(Columns {
                sizes,
                g,
                linear: &memory.linear,
                response: &self.response,
                matrix: &mut self.matrix,
                from: &self.from,
                to: &mut self.to,
            });
        } else if iterations > STALE {
            self.known = false;
        }
        self.to[..nx].copy_from_slice(&self.point);
        for (k, added) in self.added.iter_mut().enumerate() {
            *added = std::array::from_fn(|lane| self.to[n + k][lane] - self.from[n + k][lane]);
        }
        Ok(())
    }

    /// q of the point where it has the velocity v at the end of the stage.
    fn place(&mut self, n: usize, g: Lane) {
        let (q, v) = self.point.split_at_mut(n);
        for ((q, v), from) in q.iter_mut().zip(v).zip(&self.from) {
            for (lane, q) in q.iter_mut().enumerate() {
                *q = from[lane] + g[lane] * v[lane];
            }
        }
    }

    fn linearize(&mut self, on: On<'_>, memory: &mut EightMemory) -> Result<(), Diverged> {
        let On {
            hybrid, theta, at, ..
        } = on;
        hybrid
            .linearize_eight(&self.point, theta, at, memory)
            .map_err(Diverged::Dynamics)?;
        let (n, nx) = (hybrid.nv(), hybrid.nx());
        self.linear.clear();
        self.linear
            .extend_from_slice(&memory.linear[..nx * (nx - n)]);
        self.response.clear();
        self.response.extend_from_slice(memory.response());
        self.slopes.clear();
        self.slopes.extend_from_slice(&memory.slopes);
        self.known = true;
        Ok(())
    }

    /// The largest change of a velocity by the last iteration, relative to its size.
    fn largest_change(&self, n: usize) -> f64 {
        let velocities = self.point[n..2 * n].as_flattened().iter();
        let changes = self.change.as_flattened().iter().zip(velocities);
        changes.fold(0.0, |most, (change, v)| {
            most.max(change.abs() / v.abs().max(SOLVED))
        })
    }

    /// Takes the change of y; whether there was next to none. What dry friction acts on does not pass rest in one iteration: there friction that is
    /// the same both ways is steepest, and from there Newton's iteration does not overshoot.
    fn move_by_change(&mut self, hybrid: &Hybrid) -> bool {
        let n = hybrid.nv();
        let mut solved = true;
        let rates = self.point[n..].iter_mut().zip(&self.change);
        for (k, (y, change)) in rates.enumerate() {
            let least = if k < n { SOLVED } else { NEXT_TO_NOTHING };
            for (y, change) in y.iter_mut().zip(change) {
                solved &= change.abs() <= SOLVED * y.abs() + least;
                *y -= change;
            }
        }
        for (v, smoothing) in hybrid.dry_velocities() {
            for (y, change) in self.point[n + v].iter_mut().zip(&self.change[v]) {
                let passes = *y * (*y + change) < 0.0;
                if passes && change.abs() > smoothing {
                    *y = 0.0;
                }
            }
        }
        solved
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use std::path::Path;

    use crate::effect::registry;
    use crate::hybrid::{DrivenInputs, Hybrid, Placed};
    use crate::model::Model;
    use crate::shooting::{Roller, Trajectory};

    const SPAN: (usize, usize) = (0, 31);

    /// A pole whose bearing sticks: 0.05 N·m, at a rate of 10⁴ 1/s about rest. And a bristle on the cart.
    fn sticking(stiff: bool) -> Hybrid {
        let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models");
        let mut hybrid = Hybrid::of(&Model::load(&models.join("cartpole/cartpole.toml")).unwrap());
        assert!(!hybrid.is_stiff());
        for (kind, target, smoothing, values) in [
            ("coulomb_friction", 1, 1e-3, &[0.05][..]),
            ("hysteresis", 0, 0.01, &[3.0, 0.05][..]),
        ] {
            let kind = registry::find(kind).unwrap();
            let placed = Placed {
                kind,
                target,
                smoothing,
                fixed: false,
            };
            hybrid.add(placed, values);
        }
        hybrid.stepped_implicitly(stiff)
    }

    /// 20 ms a sample. The pole swings up to where it sticks, and the cart pulls it away again.
    fn pushes(hybrid: &Hybrid, theta: &[f64], substeps: usize) -> DrivenInputs {
        let t: Vec<f64> = (0..31).map(|k| f64::from(k) * 0.02).collect();
        let u: Vec<f64> = t.iter().map(|t| 2.0 * (9.0 * t).sin()).collect();
        hybrid.drive(&t, &[u], substeps, theta, &hybrid.free())
    }

    const START: [f64; 5] = [0.1, 3.0, -0.2, 0.4, 1e-3];

    fn rolled(hybrid: &Hybrid, theta: &[f64], start: &[f64], substeps: usize) -> Trajectory {
        let mut out = Trajectory::default();
        let inputs = pushes(hybrid, theta, substeps);
        Roller::new(hybrid, &[])
            .roll(theta, &inputs, SPAN, start, &mut out)
            .unwrap();
        out
    }

    fn largest(a: &[f64], b: &[f64]) -> f64 {
        let distances = a.iter().zip(b).map(|(a, b)| (a - b).abs());
        distances.fold(0.0, f64::max)
    }

    /// The wrist of the arm, 0.6 g·m² under 0.2 N·m of dry friction, and nothing on the carts and pendulums.
    #[test]
    fn what_friction_stops_within_a_millisecond_is_stepped_implicitly() {
        let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models");
        for (model, stiff) in [
            ("arm7/arm7.toml", true),
            ("cartpole/cartpole.toml", false),
            ("furuta_pendulum/furuta_pendulum.toml", false),
            ("quanser_cartpole/quanser_cartpole.toml", false),
        ] {
            let model = Model::load(&models.join(model)).unwrap();
            let hybrid = Hybrid::of(&model);
            assert_eq!(hybrid.is_stiff(), stiff, "{}", model.name);
            let smoothing = hybrid.default_smoothing(1);
            assert_eq!(smoothing, if stiff { 1e-3 } else { 1e-2 });
            let mut friction = hybrid.effects().iter().filter(|e| e.kind.dry().is_some());
            assert!(!stiff || friction.all(|e| e.smoothing == smoothing));
            let explicit = Hybrid::explicit(&model);
            assert!(!explicit.is_stiff() && explicit.default_smoothing(1) == 1e-2);
        }
    }

    /// Where friction falls with the speed faster than the mass can follow in a step, a stage has no solution, or several: its step is made of halves.
    #[test]
    fn friction_that_falls_with_the_speed_is_stepped_through() {
        let hybrid = sticking(true);
        let last = hybrid.effects().len() - 1;
        let mut stribeck = hybrid.without(last).without(last - 1);
        let placed = Placed {
            kind: registry::find("stribeck_friction").unwrap(),
            target: 1,
            smoothing: 1e-3,
            fixed: false,
        };
        stribeck.add(placed, &[0.05, 0.2, 0.004]);
        let stribeck = stribeck.stepped_implicitly(true);
        let (theta, start) = (stribeck.theta(), &START[..4]);
        let exact = rolled(&stribeck, &theta, start, 512);
        let error = |substeps| {
            let own = rolled(&stribeck, &theta, start, substeps);
            largest(&own.states, &exact.states)
        };
        let (coarse, fine) = (error(8), error(64));
        assert!(fine < coarse && fine < 2e-2, "{coarse:e} {fine:e}");
    }

    /// Steps 200 times longer than explicit ones that resolve it agree with those; explicit ones of the same length are lost.
    #[test]
    fn a_joint_that_sticks_takes_steps_that_are_longer_than_its_friction_is_fast() {
        let (implicit, explicit) = (sticking(true), sticking(false));
        let theta = implicit.theta();
        let exact = rolled(&explicit, &theta, &START, 1600);
        let sticks = exact.states.chunks(5).filter(|x| x[3].abs() < 1e-3).count();
        assert!((3..28).contains(&sticks), "{sticks}");
        let error = |substeps| {
            let own = rolled(&implicit, &theta, &START, substeps);
            largest(&own.states, &exact.states)
        };
        let (coarse, fine) = (error(8), error(64));
        assert!(coarse < 1e-2 && fine < 1e-3, "{coarse:e}, {fine:e}");
        let lost = rolled(&explicit, &theta, &START, 8);
        let lost = largest(&lost.states, &exact.states);
        assert!(lost > 10.0 * coarse, "{lost:e} {coarse:e}");
    }

    /// The derivatives are those of the steps themselves: central differences, in the initial state and in every free constant.
    #[test]
    fn sensitivities_of_implicit_steps_are_exact() {
        let hybrid = sticking(true);
        let (theta, free) = (hybrid.theta(), hybrid.free());
        let mut out = Trajectory::default();
        Roller::new(&hybrid, &free)
            .roll_with_sensitivities(&theta, &pushes(&hybrid, &theta, 8), SPAN, &START, &mut out)
            .unwrap();
        let nx = START.len();
        let columns = nx + free.len();
        let at = |column: usize, step: f64| {
            let (mut theta, mut start) = (theta.clone(), START);
            match column.checked_sub(nx) {
                None => start[column] += step,
                Some(k) => theta[free[k]] += step,
            }
            rolled(&hybrid, &theta, &start, 8).states
        };
        for column in 0..columns {
            let step = 1e-6;
            let (up, down) = (at(column, step), at(column, -step));
            let (mut worst, mut size) = (0.0_f64, 0.0_f64);
            for (sample, (up, down)) in up.chunks(nx).zip(down.chunks(nx)).enumerate() {
                let own = &out.sensitivities[(sample * columns + column) * nx..][..nx];
                for ((up, down), own) in up.iter().zip(down).zip(own) {
                    let difference = (up - down) / (2.0 * step);
                    worst = worst.max((own - difference).abs());
                    size = size.max(difference.abs());
                }
            }
            assert!(
                worst < 1e-3 * size.max(1e-3),
                "{column}: {worst:e} of {size:e}"
            );
        }
    }
}
