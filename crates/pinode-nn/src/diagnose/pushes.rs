//! Pushes from outside: forces that nobody measured.
//!
//! Where they move a joint by more than its sensor sees, the residuals of a window hang together, and what is small is lost beside them. A push is
//! a force on a joint, constant over a window, that no window shares with another: a hidden state f ~ N(0, s²) at its start, ḟ = 0. It is
//! eliminated with the rest of the initial state, so that models are compared by what no such force explains. s is the one that explains the
//! windows of the model itself best: s² = mean of f̂² + var f̂ (expectation–maximisation).
//!
//! A push is no effect that could be found: it follows from nothing, and is in no model file.

use lagrange::Scalar;

use super::comparison::Comparison;
use super::refine::best;
use super::study::{Fitted, Study};
use crate::effect::{Action, Family, Kind, MemoryLaw, ParameterSpec, Quantity, Seen, WithMemory};
use crate::hybrid::{Hybrid, Placed};

/// Rounds of expectation and maximisation, each with so many iterations of the initial states.
const ROUNDS: usize = 3;
const STATES: usize = 2;
/// Iterations of the fit with all pushes in place.
const ITERATIONS: usize = 10;
/// Pushes are on at most so many joints.
const MOST: usize = 2;

/// Residuals up to so many times the noise leave nothing to explain.
const EXPLAINED: f64 = 1.1;

struct Push;

impl MemoryLaw for Push {
    fn states(&self) -> usize {
        1
    }
    fn force<D: Scalar>(&self, seen: &Seen<'_, D>, _p: &[D], _smoothing: D) -> D {
        seen.h[0]
    }
    fn rate<D: Scalar>(&self, _seen: &Seen<'_, D>, p: &[D], _smoothing: D, rate: &mut [D]) {
        rate[0] = p[0] * 0.0;
    }
    fn start(&self, _v: f64, _f: f64, _p: &[f64], h: &mut [f64]) {
        h[0] = 0.0;
    }
    fn spread(&self, _force: f64, _speed: f64, p: &[f64], spread: &mut [f64]) {
        spread[0] = p[0];
    }
    fn fastest(&self, _speed: f64, _mass: f64, _p: &[f64]) -> f64 {
        0.0
    }
}

/// What stands for a push among the effects of a model.
static KIND: Kind = Kind {
    // No kind that is registered may have spaces in its name.
    name: "push from outside",
    family: Family::Memory,
    summary: "a force that nobody measured",
    parameters: &[
        ParameterSpec::new("deviation", Quantity::Force, (0.0, f64::INFINITY), 0.0).held(),
    ],
    action: Action::Memory(&WithMemory(Push)),
    contains: &[],
    probes: |_, _| Vec::new(),
};

/// Whether an effect of a model is a push.
pub fn is_push(placed: &Placed) -> bool {
    placed.kind.name == KIND.name
}

/// `fitted` with pushes on the joints where they explain the windows, fitted again; `None` where none does, where nothing is left that they could
/// explain, and where the model has hidden states already.
pub fn with_pushes(study: &Study, fitted: &Fitted) -> Option<Fitted> {
    let excess = fitted.excess(&study.observations);
    if fitted.hybrid.nh() > 0 || excess.iter().all(|&excess| excess < EXPLAINED) {
        return None;
    }
    let mut pushed: Option<Fitted> = None;
    for _ in 0..MOST {
        let current = pushed.as_ref().unwrap_or(fitted);
        let there = |c: usize| {
            current
                .hybrid
                .effects()
                .iter()
                .any(|e| is_push(e) && e.target == c)
        };
        let joints = (0..current.hybrid.nv()).filter(|&c| !there(c));
        let tried = joints.filter_map(|c| with_push(study, current, c));
        match best(tried.collect()).filter(|best| Comparison::of(best, current).explains()) {
            Some(best) => pushed = Some(best),
            None => break,
        }
    }
    let pushed = pushed?;
    let start = pushed.start(pushed.inside.theta.clone());
    Some(study.fit(pushed.hybrid, start, 0, ITERATIONS))
}

/// `fitted` with a push on the `c`th coordinate, of the deviation that its windows show; `None` where they show none.
fn with_push(study: &Study, fitted: &Fitted, c: usize) -> Option<Fitted> {
    let mut deviation = study.scales[c].small_force();
    let mut pushed = fitted.clone();
    for round in 0..ROUNDS {
        let (hybrid, theta) = placed(fitted, c, deviation);
        let from = if round == 0 { fitted } else { &pushed };
        pushed = study.fit(hybrid, from.start(theta), STATES, 0);
        let states = &pushed.inside.states;
        let n = states.len().max(1) as f64;
        let before: f64 = fitted.inside.determined.iter().sum();
        let determined = (pushed.inside.determined.iter().sum::<f64>() - before) / n;
        let squares: f64 = states.iter().filter_map(|x| x.last()).map(|f| f * f).sum();
        let variance = squares / n + deviation.powi(2) * (1.0 - determined.clamp(0.0, 1.0));
        deviation = variance.sqrt();
    }
    (deviation > 0.0 && deviation.is_finite()).then_some(pushed)
}

/// A model, and θ, with a push on the `c`th coordinate.
fn placed(fitted: &Fitted, c: usize, deviation: f64) -> (Hybrid, Vec<f64>) {
    let mut hybrid = fitted.hybrid.clone();
    let placed = Placed {
        kind: &KIND,
        target: c,
        smoothing: hybrid.default_smoothing(c),
        fixed: true,
    };
    hybrid.add(placed, &[deviation]);
    let theta = [&fitted.inside.theta[..], &[deviation]].concat();
    (hybrid, theta)
}

/// A fit without its pushes: θ, its errors and the states of all else stay.
pub fn stripped(fitted: &Fitted) -> Fitted {
    let mut plain = fitted.clone();
    while let Some(index) = plain.hybrid.effects().iter().position(is_push) {
        let own = plain.hybrid.range(index);
        let visible = plain.hybrid.nx() - plain.hybrid.nh();
        let states = plain.hybrid.state_range(index);
        for fit in [&mut plain.inside, &mut plain.outside] {
            fit.theta.drain(own.clone());
            for state in &mut fit.states {
                state.drain(visible + states.start..visible + states.end);
            }
            for free in &mut fit.free {
                *free -= if *free >= own.end { own.len() } else { 0 };
            }
        }
        plain.hybrid = plain.hybrid.without(index);
    }
    plain
}

#[cfg(test)]
pub(super) mod tests {
    #![allow(clippy::unwrap_used)]

    use std::fmt::Write as _;

    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::StandardNormal;

    use super::super::setup::{Prepared, prepare};
    use super::super::{Means, audit};
    use super::*;
    use crate::log::Log;
    use crate::model::Model;

    const MASS: f64 = 2.0;
    const NOISE: f64 = 2e-4;
    /// Interval of the log, and how long a push lasts, s.
    const DT: f64 = 0.02;
    const PUSH: f64 = 0.6;

    /// A sledge without friction: x(t) under a known force and pushes of this deviation, each held as long as a window, both exact.
    pub fn prepared(deviation: f64) -> (tempfile::TempDir, Prepared) {
        prepared_with(deviation, 0.0)
    }

    /// The same with viscous friction, N·s/m, that the model lacks; exact as well.
    pub fn prepared_with(deviation: f64, damping: f64) -> (tempfile::TempDir, Prepared) {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let mut normal = || -> f64 { rng.sample(StandardNormal) };
        let (mut x, mut v, mut push) = (0.0, 0.0, 0.0);
        let mut log = "t,q.x,u.push\n".to_owned();
        for k in 0..3000 {
            let t = DT * f64::from(k);
            if k % (PUSH / DT).round() as i32 == 0 {
                push = deviation * normal();
            }
            // Pulled back, or the sledge would be off and away.
            let u = 4.0 * (3.0 * t).sin() + 2.0 * (7.1 * t).cos() - 1.5 * x - 2.0 * v;
            writeln!(log, "{t},{},{u}", x + NOISE * normal()).unwrap();
            let force = u + push;
            if damping == 0.0 {
                x += v * DT + 0.5 * force / MASS * DT * DT;
                v += force / MASS * DT;
            } else {
                let (last, rate) = (force / damping, damping / MASS);
                let kept = (-rate * DT).exp();
                x += last * DT + (v - last) * (1.0 - kept) / rate;
                v = last + (v - last) * kept;
            }
        }
        let dir = tempfile::tempdir().unwrap();
        let (model, data) = (dir.path().join("sledge.toml"), dir.path().join("log.csv"));
        let text = format!(
            "name = \"sledge\"\n[lagrangian]\ncoordinates = [\"x\"]\nkinetic = \"0.5*m*x_dot^2\"\npotential = \"0\"\nparameters = {{ m = {MASS} }}\n\
             [[input]]\nname = \"push\"\njoint = \"x\"\n[sensor.x]\nposition_noise = {NOISE}\nvelocity = \"none\"\n[tolerance]\ngain = 0.0\n\
             parameters = {{ m = 1e-3 }}\n"
        );
        std::fs::write(&model, text).unwrap();
        std::fs::write(&data, log).unwrap();
        let model = Model::load(&model).unwrap();
        let log = Log::read(&data, &model).unwrap();
        let audited = audit::audit(&model, &[log], &[]);
        let prepared = prepare(
            &model,
            audited.observations,
            1,
            &audited.masked,
            &Means::default(),
        );
        (dir, prepared.unwrap())
    }

    #[test]
    fn pushes_are_as_strong_as_they_were() {
        let (_dir, Prepared { study, null, .. }) = prepared(0.3);
        assert!(null.excess(&study.observations)[0] > 1.5, "they are seen");
        let pushed = with_pushes(&study, &null).unwrap();
        let [push] = pushed.hybrid.effects() else {
            panic!("{:?}", pushed.hybrid.effects())
        };
        assert!(is_push(push));
        let deviation = pushed.inside.theta[pushed.hybrid.range(0).start];
        assert!((deviation / 0.3 - 1.0).abs() < 0.2, "{deviation}");
        // Of the residuals the noise is left.
        let excess = pushed.excess(&study.observations)[0];
        assert!(excess < 1.2, "{excess}");
    }

    #[test]
    fn there_are_none_where_nobody_pushed() {
        let (_dir, Prepared { study, null, .. }) = prepared(0.0);
        assert!(with_pushes(&study, &null).is_none());
    }

    #[test]
    fn without_them_the_model_is_the_one_it_was() {
        let (_dir, Prepared { study, null, .. }) = prepared(0.3);
        let plain = stripped(&with_pushes(&study, &null).unwrap());
        assert!(plain.hybrid.effects().is_empty());
        assert_eq!(plain.inside.theta.len(), null.inside.theta.len());
        assert_eq!(plain.inside.free, null.inside.free);
        assert!(plain.inside.states.iter().all(|x| x.len() == 2));
    }
}
