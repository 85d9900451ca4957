//! Adaptive and stiff roll-outs: errors follow tolerances, the method follows the motion, inputs are held, and what cannot be rolled
//! out says why.

use std::convert::Infallible;
use std::sync::atomic::{AtomicUsize, Ordering};

use integrators::adaptive::{
    AdaptiveError, ArgumentError, Inputs, Method, Refusal, RollOut, Settings, roll_out,
};
use integrators::problems::{
    DrivenOscillator, HarmonicOscillator, HeavyTop, Kepler, Pendulum, Problem, RigidBody,
    Robertson, VanDerPol,
};
use integrators::{Differentiable, Flat, Gradient, Jacobian, Space, System};

const ALL: [Method; 5] = [
    Method::Tsit5,
    Method::TrBdf2,
    Method::Esdirk34,
    Method::Bdf,
    Method::Automatic,
];
const STIFF: [Method; 4] = [
    Method::TrBdf2,
    Method::Esdirk34,
    Method::Bdf,
    Method::Automatic,
];

fn roll<P: Problem>(problem: &P, settings: &Settings, times: &[f64]) -> RollOut {
    let inputs = Inputs::Constant(&());
    roll_out(problem, settings, times, inputs, &problem.initial()).unwrap()
}

/// The largest error at `time`, relative to |x| + size.
fn error<P: Problem>(problem: &P, settings: &Settings, time: f64, sizes: &[f64]) -> f64 {
    let rolled = roll(problem, settings, &[0.0, time]);
    difference(
        problem,
        &problem.solution(time).unwrap(),
        &rolled.states[1],
        sizes,
    )
}

fn difference<P: Problem>(problem: &P, exact: &[f64], found: &[f64], sizes: &[f64]) -> f64 {
    let n = problem.space().tangent_dim();
    let (mut off, mut scale) = (vec![0.0; n], vec![0.0; n]);
    problem.space().difference_into(exact, found, &mut off);
    problem.space().scale_into(exact, &mut scale);
    (0..n)
        .map(|i| off[i].abs() / (scale[i].abs() + sizes[i.min(sizes.len() - 1)]))
        .fold(0.0, f64::max)
}

/// Errors are below `factor` tol^e and fall at least as tol^(0.7 e), with e = p/(p + 1) for the order p: the
/// error of a step is tol ~ h^(p+1), and there are ~ 1/h steps. A control of tolerances, not of orders: those are measured below.
fn follows<P: Problem>(problem: &P, method: Method, time: f64, sizes: &[f64], factor: f64) {
    let order = match method {
        Method::Tsit5 => 4.0,
        Method::Esdirk34 => 3.0,
        // Backward differences begin with less, and reach more.
        _ => 2.0,
    };
    let exponent = order / (order + 1.0);
    let mut errors = Vec::new();
    for tolerance in [1e-4, 1e-6, 1e-8] {
        let absolute: Vec<f64> = sizes.iter().map(|s| s * tolerance).collect();
        let settings = Settings::new(method, tolerance, 1.0).with_absolute(&absolute);
        let error = error(problem, &settings, time, sizes);
        assert!(
            error <= factor * tolerance.powf(exponent),
            "{} {}: error {error:e} at tolerance {tolerance:e}",
            problem.name(),
            method.name()
        );
        errors.push(error);
    }
    let power = (errors[0] / errors[2]).log10() / 4.0;
    assert!(
        power > 0.7 * exponent,
        "{} {}: errors {errors:?} fall as the power {power}",
        problem.name(),
        method.name()
    );
}

/// A problem whose input is a number that it does not use: with another one in every interval, and tolerances so large that no step is
/// shortened by them, every interval is one step.
struct Stepped<P>(P);

impl<P: Problem> System for Stepped<P> {
    type Space = P::Space;
    type Input = usize;
    type Memory = ();
    type Error = Infallible;
    fn space(&self) -> &P::Space {
        self.0.space()
    }
    fn memory(&self) {}
    fn rate(
        &self,
        t: f64,
        x: &[f64],
        _u: &usize,
        m: &mut (),
        dx: &mut [f64],
    ) -> Result<(), Infallible> {
        self.0.rate(t, x, &(), m, dx)
    }
}

impl<P: Problem> Differentiable for Stepped<P> {
    fn input_count(&self) -> usize {
        0
    }
    fn parameter_count(&self) -> usize {
        self.0.parameter_count()
    }
    fn linearize(
        &self,
        (t, x, _u): (f64, &[f64], &usize),
        m: &mut (),
        dx: &mut [f64],
        by: &mut Jacobian,
    ) -> Result<(), Infallible> {
        self.0.linearize((t, x, &()), m, dx, by)
    }
    fn pull_back(
        &self,
        (t, x, _u): (f64, &[f64], &usize),
        m: &mut (),
        weight: &[f64],
        dx: &mut [f64],
        by: &mut Gradient,
    ) -> Result<(), Infallible> {
        self.0.pull_back((t, x, &()), m, weight, dx, by)
    }
}

/// The slope of a straight line through points.
fn slope(points: &[(f64, f64)]) -> f64 {
    let count = points.len() as f64;
    let (x, y) = points.iter().fold((0.0, 0.0), |sum, p| {
        (sum.0 + p.0 / count, sum.1 + p.1 / count)
    });
    let (up, along) = points.iter().fold((0.0, 0.0), |sum, p| {
        (sum.0 + (p.0 - x) * (p.1 - y), sum.1 + (p.0 - x).powi(2))
    });
    up / along
}

/// The order of a one-step method in equal steps from 0 to `end`.
fn order_of_equal_steps<P: Problem>(problem: P, method: Method, end: f64, steps: &[usize]) -> f64 {
    let problem = Stepped(problem);
    let points: Vec<(f64, f64)> = steps
        .iter()
        .map(|&count| {
            let times: Vec<f64> = (0..=count).map(|k| end * k as f64 / count as f64).collect();
            let inputs: Vec<usize> = (0..count).collect();
            let settings = Settings::new(method, 0.5, 100.0);
            let inputs = Inputs::Held(&inputs);
            let rolled =
                roll_out(&problem, &settings, &times, inputs, &problem.0.initial()).unwrap();
            assert_eq!(rolled.statistics.steps, count, "{}", method.name());
            let exact = problem.0.solution(end).unwrap();
            let error = difference(&problem.0, &exact, &rolled.states[count], &[1.0]);
            ((count as f64).ln(), -error.ln())
        })
        .collect();
    slope(&points)
}

#[test]
fn tsit5_has_order_5_in_equal_steps() {
    let oscillator = DrivenOscillator {
        frequency: 2.0,
        damping: 0.3,
        drive: 1.5,
        drive_frequency: 3.1,
    };
    let pendulum = Pendulum {
        frequency: 3.0,
        amplitude: 1.5,
    };
    // The terms of h⁶ show beside those of h⁵, more so in coarser steps.
    let steps = [120, 240, 480];
    for found in [
        order_of_equal_steps(oscillator, Method::Tsit5, 3.0, &steps),
        order_of_equal_steps(pendulum, Method::Tsit5, 3.0, &steps),
    ] {
        eprintln!("Tsit5: order {found:.3} in equal steps");
        assert!((4.6..5.7).contains(&found), "order {found}");
    }
}

/// How the error at the end falls with the number of accepted steps over tolerances from 10^-`from` to 10^-`to`, in half powers.
fn order_of_chosen_steps<P: Problem>(problem: &P, method: Method, from: i32, to: i32) -> f64 {
    let points: Vec<(f64, f64)> = (2 * from..=2 * to)
        .map(|half| {
            let tolerance = 10_f64.powf(-0.5 * f64::from(half));
            let settings = Settings::new(method, tolerance, tolerance);
            let rolled = roll(problem, &settings, &[0.0, problem.span()]);
            let exact = problem.solution(problem.span()).unwrap();
            let error = difference(problem, &exact, &rolled.states[1], &[1.0]);
            ((rolled.statistics.steps as f64).ln(), -error.ln())
        })
        .collect();
    slope(&points)
}

#[test]
fn errors_fall_with_the_number_of_chosen_steps_as_the_order_says() {
    let orbit = Kepler { eccentricity: 0.5 };
    let top = HeavyTop::default();
    let mut wrong = Vec::new();
    for (method, (from, to), order) in [
        (Method::Tsit5, (8, 11), 4.6..5.7),
        (Method::TrBdf2, (6, 9), 1.6..2.4),
        (Method::Esdirk34, (7, 10), 2.6..3.4),
        (Method::Automatic, (8, 11), 4.6..5.7),
        // Its order varies between 1 and 5; where tolerances are this fine it is mostly 5.
        (Method::Bdf, (8, 11), 4.1..6.5),
    ] {
        for (name, found) in [
            ("orbit", order_of_chosen_steps(&orbit, method, from, to)),
            ("top", order_of_chosen_steps(&top, method, from, to)),
        ] {
            let line = format!("{} {name}: order {found:.3}", method.name());
            eprintln!("{line} in chosen steps");
            if !order.contains(&found) {
                wrong.push(line);
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:?}");
}

#[test]
fn errors_follow_the_tolerance_on_a_pendulum_and_on_an_orbit() {
    let pendulum = Pendulum {
        frequency: 3.0,
        amplitude: 2.6,
    };
    let orbit = Kepler { eccentricity: 0.5 };
    for method in ALL {
        follows(&pendulum, method, pendulum.span(), &[1.0; 2], 100.0);
        follows(&orbit, method, orbit.span(), &[1.0; 4], 100.0);
    }
}

#[test]
fn errors_follow_the_tolerance_on_robertsons_reaction() {
    for method in STIFF {
        follows(
            &Robertson::default(),
            method,
            40.0,
            &[1.0, 1e-4, 1.0],
            100.0,
        );
    }
}

#[test]
fn errors_follow_the_tolerance_on_van_der_pols_jumps() {
    for method in STIFF {
        follows(&VanDerPol::default(), method, 2.0, &[1.0; 2], 100.0);
    }
}

#[test]
fn robertsons_reaction_goes_on_to_its_published_end() {
    for method in [Method::Bdf, Method::Esdirk34, Method::Automatic] {
        let settings = Settings::new(method, 1e-7, 1.0).with_absolute(&[1e-14, 1e-18, 1e-7]);
        let times: Vec<f64> = Robertson::known_times().collect();
        let problem = Robertson::default();
        let rolled = roll(&problem, &settings, &times);
        for (time, state) in times.iter().zip(&rolled.states) {
            let exact = problem.solution(*time).unwrap();
            let error = difference(&problem, &exact, state, &[1e-7, 1e-11, 1.0]);
            assert!(error < 1e-4, "{} at {time:e} s: {error:e}", method.name());
        }
        assert!(rolled.statistics.steps < 5000, "{:?}", rolled.statistics);
    }
}

#[test]
fn the_method_changes_both_ways_on_relaxation_oscillations() {
    for epsilon in [1e-3, 1e-4, 1e-6] {
        let problem = VanDerPol { epsilon };
        let settings = Settings::new(Method::Automatic, 1e-6, 1e-6);
        let rolled = roll(&problem, &settings, &[0.0, 2.0]);
        let switches = &rolled.statistics.switches;
        let to_explicit = switches[1..]
            .iter()
            .filter(|s| s.to == Method::Tsit5)
            .count();
        let to_implicit = switches.iter().filter(|s| s.to == Method::Bdf).count();
        assert_eq!(switches[0].to, Method::Tsit5);
        assert!(
            to_implicit >= 2 && to_explicit >= 1,
            "ε = {epsilon:e}: {switches:?}"
        );
        // No more than a few for each of the jumps.
        assert!(
            switches.len() < 40,
            "ε = {epsilon:e}: {} changes",
            switches.len()
        );
        assert!(rolled.statistics.explicit_steps > 0);
    }
}

#[test]
fn the_method_stays_explicit_on_an_orbit_and_leaves_it_on_a_fast_decay() {
    let orbit = roll(
        &Kepler { eccentricity: 0.5 },
        &Settings::new(Method::Automatic, 1e-8, 1e-8),
        &[0.0, 30.0],
    );
    assert_eq!(orbit.statistics.jacobians, 0);
    assert_eq!(orbit.statistics.steps, orbit.statistics.explicit_steps);
    let reaction = roll(
        &Robertson::default(),
        &Settings::new(Method::Automatic, 1e-6, 1e-8),
        &[0.0, 400.0],
    );
    assert!(
        reaction.statistics.explicit_steps < 60,
        "{:?}",
        reaction.statistics
    );
}

#[test]
fn samples_between_steps_come_from_the_interpolant() {
    let pendulum = Pendulum {
        frequency: 3.0,
        amplitude: 2.0,
    };
    let times: Vec<f64> = (0..=500).map(|k| 0.01 * f64::from(k)).collect();
    for method in ALL {
        let settings = Settings::new(method, 1e-6, 1e-6);
        let rolled = roll(&pendulum, &settings, &times);
        let alone = roll(&pendulum, &settings, &[0.0, 5.0]);
        assert_eq!(rolled.statistics, alone.statistics);
        assert_eq!(rolled.states.len(), times.len());
        for (time, state) in times.iter().zip(&rolled.states) {
            let exact = pendulum.solution(*time).unwrap();
            let error = difference(&pendulum, &exact, state, &[1.0]);
            assert!(error < 2e-3, "{} at {time} s: {error:e}", method.name());
        }
    }
    // The interpolant of Tsit5 is as exact as its steps.
    let settings = Settings::new(Method::Tsit5, 1e-9, 1e-9);
    for (time, state) in times.iter().zip(&roll(&pendulum, &settings, &times).states) {
        let exact = pendulum.solution(*time).unwrap();
        assert!(difference(&pendulum, &exact, state, &[1.0]) < 1e-6);
    }
}

/// ẋ = −λ (x − u) with the interval in which u is held as part of it; counts evaluations outside of it.
struct Lag {
    space: Flat,
    rate: f64,
    outside: AtomicUsize,
}

#[derive(Debug, Clone, PartialEq)]
struct Held {
    value: f64,
    from: f64,
    to: f64,
}

impl Lag {
    fn new(rate: f64) -> Self {
        Lag {
            space: Flat::new(1),
            rate,
            outside: AtomicUsize::new(0),
        }
    }
}

impl System for Lag {
    type Space = Flat;
    type Input = Held;
    type Memory = ();
    type Error = Infallible;
    fn space(&self) -> &Flat {
        &self.space
    }
    fn memory(&self) {}
    fn rate(
        &self,
        t: f64,
        x: &[f64],
        u: &Held,
        _m: &mut (),
        dx: &mut [f64],
    ) -> Result<(), Infallible> {
        let slack = 1e-12 * (1.0 + t.abs());
        if t < u.from - slack || t > u.to + slack {
            self.outside.fetch_add(1, Ordering::Relaxed);
        }
        dx[0] = -self.rate * (x[0] - u.value);
        Ok(())
    }
}

impl Differentiable for Lag {
    fn input_count(&self) -> usize {
        1
    }
    fn parameter_count(&self) -> usize {
        0
    }
    fn linearize(
        &self,
        (t, x, u): (f64, &[f64], &Held),
        m: &mut (),
        dx: &mut [f64],
        by: &mut Jacobian,
    ) -> Result<(), Infallible> {
        by.state[(0, 0)] = -self.rate;
        by.input[(0, 0)] = self.rate;
        self.rate(t, x, u, m, dx)
    }
    fn pull_back(
        &self,
        (t, x, u): (f64, &[f64], &Held),
        m: &mut (),
        weight: &[f64],
        dx: &mut [f64],
        by: &mut Gradient,
    ) -> Result<(), Infallible> {
        by.state[0] -= self.rate * weight[0];
        by.input[0] += self.rate * weight[0];
        self.rate(t, x, u, m, dx)
    }
}

#[test]
fn an_input_that_jumps_at_samples_is_followed_to_its_closed_form() {
    for rate in [3.0, 3000.0] {
        for method in ALL {
            let lag = Lag::new(rate);
            let times: Vec<f64> = (0..=20).map(|k| 0.05 * f64::from(k)).collect();
            let inputs: Vec<Held> = (0..20)
                .map(|k| Held {
                    value: f64::from((k * 7919) % 13) - 6.0,
                    from: times[k as usize],
                    to: times[k as usize + 1],
                })
                .collect();
            let settings = Settings::new(method, 1e-8, 1e-8);
            let rolled = roll_out(&lag, &settings, &times, Inputs::Held(&inputs), &[2.0]).unwrap();
            let mut exact = 2.0;
            for (k, input) in inputs.iter().enumerate() {
                exact = input.value + (exact - input.value) * (-rate * 0.05_f64).exp();
                let found = rolled.states[k + 1][0];
                assert!(
                    (found - exact).abs() < 3e-6,
                    "{} rate {rate}: {found} for {exact} after sample {k}",
                    method.name()
                );
            }
            assert_eq!(lag.outside.load(Ordering::Relaxed), 0, "{}", method.name());
        }
    }
}

#[test]
fn an_input_that_stays_does_not_restart_the_method() {
    let lag = Lag::new(5.0);
    let times: Vec<f64> = (0..=40).map(|k| 0.1 * f64::from(k)).collect();
    let held = |half: i32| Held {
        value: f64::from(half),
        from: 2.0 * f64::from(half),
        to: 2.0 + 2.0 * f64::from(half),
    };
    let inputs: Vec<Held> = (0..40).map(|k| held(k / 20)).collect();
    for method in [Method::Tsit5, Method::Esdirk34, Method::Bdf] {
        let settings = Settings::new(method, 1e-6, 1e-6);
        let rolled = roll_out(&lag, &settings, &times, Inputs::Held(&inputs), &[2.0]).unwrap();
        assert_eq!(rolled.statistics.starts, 2, "{}", method.name());
    }
}

#[test]
fn a_free_rigid_body_keeps_its_quaternion_and_reaches_its_reference() {
    let body = RigidBody {
        moments: [1.0, 2.0, 3.0],
        across: 1.0,
        along: 1.2,
    };
    for method in ALL {
        follows(&body, method, 5.0, &[1.0; 6], 100.0);
        let times: Vec<f64> = (0..=60).map(|k| 0.5 * f64::from(k)).collect();
        let settings = Settings::new(method, 1e-7, 1e-7);
        for state in roll(&body, &settings, &times).states {
            let size = state[..4].iter().map(|q| q * q).sum::<f64>().sqrt();
            assert!((size - 1.0).abs() < 1e-14, "{}: {size}", method.name());
        }
    }
}

#[test]
fn a_heavy_top_reaches_its_reference() {
    for method in ALL {
        follows(&HeavyTop::default(), method, 2.0, &[1.0; 6], 100.0);
    }
}

/// Two oscillators that know nothing of each other, the second one fast and small.
struct Two;

const FAST: f64 = 60.0;

impl System for Two {
    type Space = Flat;
    type Input = ();
    type Memory = ();
    type Error = Infallible;
    fn space(&self) -> &Flat {
        const SPACE: Flat = Flat::new(4);
        &SPACE
    }
    fn memory(&self) {}
    fn rate(
        &self,
        _t: f64,
        x: &[f64],
        _u: &(),
        _m: &mut (),
        dx: &mut [f64],
    ) -> Result<(), Infallible> {
        dx.copy_from_slice(&[x[1], -x[0], FAST * x[3], -FAST * x[2]]);
        Ok(())
    }
}

impl Differentiable for Two {
    fn input_count(&self) -> usize {
        0
    }
    fn parameter_count(&self) -> usize {
        0
    }
    fn linearize(
        &self,
        (t, x, u): (f64, &[f64], &()),
        m: &mut (),
        dx: &mut [f64],
        by: &mut Jacobian,
    ) -> Result<(), Infallible> {
        by.state.fill(0.0);
        by.state[(0, 1)] = 1.0;
        by.state[(1, 0)] = -1.0;
        by.state[(2, 3)] = FAST;
        by.state[(3, 2)] = -FAST;
        self.rate(t, x, u, m, dx)
    }
    fn pull_back(
        &self,
        (t, x, u): (f64, &[f64], &()),
        m: &mut (),
        _w: &[f64],
        dx: &mut [f64],
        _by: &mut Gradient,
    ) -> Result<(), Infallible> {
        self.rate(t, x, u, m, dx)
    }
}

#[test]
fn each_coordinate_has_its_tolerance() {
    let end = 3.0;
    let small = 1e-3;
    let run = |fast: f64| {
        let settings =
            Settings::new(Method::Tsit5, 0.0, 1.0).with_absolute(&[1e-6, 1e-6, fast, fast]);
        let inputs = Inputs::Constant(&());
        let rolled = roll_out(
            &Two,
            &settings,
            &[0.0, end],
            inputs,
            &[1.0, 0.0, small, 0.0],
        )
        .unwrap();
        let x = &rolled.states[1];
        let slow = (x[0] - end.cos()).abs().max((x[1] + end.sin()).abs());
        let fast = (x[2] - small * (FAST * end).cos()).abs();
        (slow, fast, rolled.statistics.steps)
    };
    let (slow_of_fine, fast_of_fine, steps_of_fine) = run(1e-9);
    let (slow_of_coarse, fast_of_coarse, steps_of_coarse) = run(1.0);
    assert!(slow_of_fine < 1e-4 && slow_of_coarse < 1e-4);
    assert!(fast_of_fine < 1e-6, "{fast_of_fine:e}");
    assert!(fast_of_coarse > 1e-5, "{fast_of_coarse:e}");
    assert!(
        steps_of_fine > 3 * steps_of_coarse,
        "{steps_of_fine} {steps_of_coarse}"
    );
}

/// ẋ = f(x) of one number, its derivative by a difference; `None` is a failure.
struct Scalar<F>(F, Flat);

impl<F: Fn(f64) -> Option<f64> + Sync> System for Scalar<F> {
    type Space = Flat;
    type Input = ();
    type Memory = ();
    type Error = String;
    fn space(&self) -> &Flat {
        &self.1
    }
    fn memory(&self) {}
    fn rate(&self, _t: f64, x: &[f64], _u: &(), _m: &mut (), dx: &mut [f64]) -> Result<(), String> {
        dx[0] = (self.0)(x[0]).ok_or_else(|| format!("no force at {:.3}", x[0]))?;
        Ok(())
    }
}

impl<F: Fn(f64) -> Option<f64> + Sync> Differentiable for Scalar<F> {
    fn input_count(&self) -> usize {
        0
    }
    fn parameter_count(&self) -> usize {
        0
    }
    fn linearize(
        &self,
        (t, x, u): (f64, &[f64], &()),
        m: &mut (),
        dx: &mut [f64],
        by: &mut Jacobian,
    ) -> Result<(), String> {
        self.rate(t, &[x[0] - 1e-6], u, m, dx)?;
        let below = dx[0];
        self.rate(t, x, u, m, dx)?;
        by.state[(0, 0)] = (dx[0] - below) / 1e-6;
        Ok(())
    }
    fn pull_back(
        &self,
        (t, x, u): (f64, &[f64], &()),
        m: &mut (),
        _w: &[f64],
        dx: &mut [f64],
        _by: &mut Gradient,
    ) -> Result<(), String> {
        self.rate(t, x, u, m, dx)
    }
}

fn scalar<F: Fn(f64) -> Option<f64> + Sync>(
    f: F,
    method: Method,
    start: f64,
    end: f64,
) -> Result<f64, AdaptiveError<String>> {
    let settings = Settings::new(method, 1e-6, 1e-9).with_max_steps(20_000);
    let inputs = Inputs::Constant(&());
    roll_out(
        &Scalar(f, Flat::new(1)),
        &settings,
        &[0.0, end],
        inputs,
        &[start],
    )
    .map(|rolled| rolled.states[1][0])
}

#[test]
fn a_rate_that_is_no_number_or_fails_stops_with_time_and_reason() {
    for method in ALL {
        // ẋ = 1 reaches 2 at t = 2, where there is no force any more.
        let error = scalar(|x| (x < 2.0).then_some(1.0), method, 0.0, 5.0).unwrap_err();
        match error {
            AdaptiveError::RightHandSide {
                time,
                source: Refusal::System(message),
            } => {
                assert!((time - 2.0).abs() < 0.1, "{}: {time}", method.name());
                assert!(message.starts_with("no force at 2."), "{message}");
            }
            other => panic!("{}: {other}", method.name()),
        }
        let error = scalar(
            |x| Some(if x < 2.0 { 1.0 } else { f64::NAN }),
            method,
            0.0,
            5.0,
        )
        .unwrap_err();
        match error {
            AdaptiveError::RightHandSide {
                time,
                source:
                    Refusal::Rate {
                        component: 0,
                        value,
                    },
            } => assert!(
                (time - 2.0).abs() < 0.1 && value.is_nan(),
                "{}",
                method.name()
            ),
            other => panic!("{}: {other}", method.name()),
        }
        let error = scalar(|_| None, method, 0.0, 5.0).unwrap_err();
        assert!(
            matches!(error, AdaptiveError::RightHandSide { time: 0.0, .. }),
            "{error}"
        );
    }
}

#[test]
fn a_step_that_only_tries_a_place_without_force_is_made_shorter() {
    for method in ALL {
        // ẋ = −√x from 1: x = (1 − t/2)², and there is no root below 0.
        let end = scalar(|x| (x >= 0.0).then(|| -x.sqrt()), method, 1.0, 1.9).unwrap();
        assert!((end - 0.0025).abs() < 1e-4, "{}: {end}", method.name());
    }
}

#[test]
fn a_finite_escape_ends_with_an_error() {
    for method in ALL {
        // ẋ = x² from 1 escapes at t = 1.
        let error = scalar(|x| Some(x * x), method, 1.0, 2.0).unwrap_err();
        let time = match error {
            AdaptiveError::StepSize { time, .. }
            | AdaptiveError::NotFinite { time, .. }
            | AdaptiveError::RightHandSide { time, .. } => time,
            other => panic!("{}: {other}", method.name()),
        };
        assert!((time - 1.0).abs() < 1e-2, "{}: {time}", method.name());
    }
}

#[test]
fn a_stiff_problem_in_explicit_steps_runs_out_of_them() {
    let settings = Settings::new(Method::Tsit5, 1e-6, 1e-6).with_max_steps(500);
    let problem = VanDerPol::default();
    let inputs = Inputs::Constant(&());
    let error = roll_out(&problem, &settings, &[0.0, 2.0], inputs, &problem.initial()).unwrap_err();
    match error {
        AdaptiveError::Steps {
            steps: 500, time, ..
        } => assert!(time < 1e-2),
        other => panic!("{other}"),
    }
    assert!(error.to_string().contains("Method::Automatic"));
}

#[test]
fn everything_wrong_with_the_arguments_is_reported() {
    let problem = HarmonicOscillator {
        frequency: 1.0,
        amplitude: 1.0,
    };
    let settings = Settings::new(Method::Bdf, f64::NAN, 1.0)
        .with_absolute(&[0.0, f64::INFINITY, 1e-6])
        .with_max_steps(0);
    let error = roll_out(
        &problem,
        &settings,
        &[0.0, 0.0],
        Inputs::Held(&[]),
        &[f64::NAN],
    )
    .unwrap_err();
    let AdaptiveError::Arguments(found) = &error else {
        panic!("{error}");
    };
    let has =
        |wanted: &dyn Fn(&ArgumentError) -> bool| assert!(found.iter().any(wanted), "{error}");
    has(&|e| matches!(e, ArgumentError::Relative { value } if value.is_nan()));
    has(&|e| {
        matches!(
            e,
            ArgumentError::AbsoluteCount {
                found: 3,
                directions: 2
            }
        )
    });
    has(&|e| matches!(e, ArgumentError::Absolute { index: 0, .. }));
    has(&|e| matches!(e, ArgumentError::Absolute { index: 1, .. }));
    has(&|e| matches!(e, ArgumentError::MaxSteps));
    has(&|e| matches!(e, ArgumentError::Times { index: 1, .. }));
    has(&|e| {
        matches!(
            e,
            ArgumentError::Inputs {
                found: 0,
                needed: 1
            }
        )
    });
    has(&|e| {
        matches!(
            e,
            ArgumentError::InitialLength {
                found: 1,
                expected: 2
            }
        )
    });
    has(&|e| matches!(e, ArgumentError::Initial { component: 0, .. }));
    assert_eq!(found.len(), 9);
}

#[test]
fn no_sample_and_one_sample_need_no_step() {
    let problem = HarmonicOscillator {
        frequency: 1.0,
        amplitude: 1.0,
    };
    let settings = Settings::new(Method::Automatic, 1e-6, 1e-6);
    let none = roll_out(&problem, &settings, &[], Inputs::Held(&[]), &[1.0, 0.0]).unwrap();
    assert!(none.states.is_empty());
    let one = roll_out(&problem, &settings, &[3.0], Inputs::Held(&[]), &[1.0, 0.0]).unwrap();
    assert_eq!(one.states, [[1.0, 0.0]]);
}
