//! Windows that are stuck: those that leave much get a second look, from where the window before ends.
//!
//! A window's initial state is found by Gauss–Newton steps from where the smoothed measurements begin. Dry friction, flanks that touch and
//! a pole that nearly stands make its loss one of several valleys; in the wrong one the window stays, whatever θ does, and what it leaves looks
//! like a push. (Of 75 windows of a cart with a play in its drive two were stuck, worth 265 of 3044 nats; both begin with the cart nearly at
//! rest.) Where the window before ends is another beginning, which knows how the joint got there.

use super::problem::{Problem, Rolled};
use super::{Member, Window, roll_all};

/// Windows get a second look that leave so many times what the middle one leaves.
const LOUD: f64 = 1.25;
/// Steps of their initial states from there.
const STEPS: usize = 2;
/// They are taken from there where that leaves so many nats less.
const WORTH: f64 = 0.5;

impl Problem<'_> {
    /// Takes windows from where the ones before end where that explains them better; says by how many nats, all together. The states that
    /// are taken are rolled out without derivatives.
    pub fn unstick(&self, theta: &[f64], present: &mut [Rolled], sigma: &[f64]) -> f64 {
        let losses: Vec<f64> = present.iter().map(|rolled| rolled.loss(sigma)).collect();
        let mut sorted = losses.clone();
        sorted.sort_by(f64::total_cmp);
        let Some(middle) = sorted.get(sorted.len() / 2) else {
            return 0.0;
        };
        let goes_on = |index: usize| {
            let before = self.windows.get(index.checked_sub(1)?)?;
            let own = self.windows.get(index)?;
            let follows = before.run == own.run && before.first + before.count == own.first;
            follows.then_some(index)
        };
        let loud: Vec<usize> = (0..present.len())
            .filter(|&index| losses[index] > LOUD * middle)
            .filter_map(goes_on)
            .collect();
        let ends = self.ends_before(theta, present, &loud);
        let ends = loud.into_iter().zip(ends);
        let (again, states): (Vec<usize>, Vec<Vec<f64>>) =
            ends.filter_map(|(index, end)| Some((index, end?))).unzip();
        if again.is_empty() {
            return 0.0;
        }
        let windows: Vec<Window> = again.iter().map(|&index| self.windows[index]).collect();
        let hidden = self.hidden.some(&again);
        let few = Problem {
            windows: &windows,
            free: &[],
            hidden: &hidden,
            ..*self
        };
        let mut other = few.rolled(theta, states);
        for _ in 0..STEPS {
            let reduced = few.reduced(theta, &mut other, sigma);
            other = few.stepped_alone(theta, &other, reduced, sigma);
        }
        let mut gained = 0.0;
        for (index, other) in again.into_iter().zip(other) {
            let gain = losses[index] - other.loss(sigma);
            if gain > WORTH {
                gained += gain;
                present[index] = Rolled {
                    trajectory: None,
                    ..other
                };
            }
        }
        gained
    }

    /// Where the windows before these end, a sample after their last one.
    fn ends_before(
        &self,
        theta: &[f64],
        present: &[Rolled],
        of: &[usize],
    ) -> Vec<Option<Vec<f64>>> {
        let inputs = self.drive(theta);
        let member = |&index: &usize| {
            let Window { run, first, count } = self.windows[index - 1];
            Member {
                inputs: &inputs[run],
                span: (first, count + 1),
                initial: &present[index - 1].state,
            }
        };
        let members: Vec<Member> = of.iter().map(member).collect();
        let rolled = roll_all((self.hybrid, theta, self.free), &members, false);
        let nx = self.hybrid.nx();
        let last = |states: Vec<f64>| states.chunks_exact(nx).last().map(<[f64]>::to_vec);
        let ends = rolled.into_iter();
        ends.map(|trajectory| last(trajectory?.states)).collect()
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use std::f64::consts::PI;
    use std::path::Path;

    use crate::hybrid::Hybrid;
    use crate::model::Model;
    use crate::shooting::problem::Problem;
    use crate::shooting::{
        Channel, Finer, FitOptions, HiddenPrior, Observations, ObservedRun, consecutive, fit,
    };

    const NOISE: f64 = 1e-3;

    /// A ball of 1 kg that rolls about in one of many hollows, V = −10 cos(4 x): x for 6 s, each 20 ms.
    fn rolled() -> (Hybrid, Vec<f64>, Vec<f64>) {
        let text = "name = \"ball\"\n\
            lagrangian = { coordinates = [\"x\"], kinetic = \"0.5*x_dot^2\", potential = \"-10*cos(4*x)\" }\n\
            [sensor.x]\nposition_noise = 1e-3\nvelocity = \"none\"\n";
        let model = Model::parse(Path::new("ball.toml"), text.to_owned()).unwrap();
        let t: Vec<f64> = (0..300).map(|k| 0.02 * f64::from(k)).collect();
        let (mut x, mut v) = (0.15 * PI, 0.3);
        let mut path = Vec::new();
        for _ in &t {
            path.push(x);
            // Steps of 10 µs by the leapfrog method: the truth is not from what is tested.
            for _ in 0..2_000 {
                let half = 5e-6;
                v -= half * 40.0 * (4.0 * x).sin();
                x += 2.0 * half * v;
                v -= half * 40.0 * (4.0 * x).sin();
            }
        }
        (Hybrid::of(&model), t, path)
    }

    #[test]
    fn a_window_that_began_in_the_wrong_hollow_goes_on_from_the_one_before() {
        let (hybrid, t, x) = rolled();
        let windows = consecutive(0, &t, 0.6);
        let observations = Observations {
            channels: vec![Channel {
                coordinate: 0,
                velocity: false,
                wraps: false,
                noise: NOISE,
            }],
            runs: vec![ObservedRun {
                finer: Finer::default(),
                valid: vec![vec![true; t.len()]],
                u: Vec::new(),
                y: vec![x.clone()],
                t,
            }],
        };
        let right: Vec<Vec<f64>> = windows
            .iter()
            .map(|w| vec![x[w.first], (x[w.first + 1] - x[w.first]) / 0.02])
            .collect();
        let mut wrong = right.clone();
        wrong[4] = vec![0.5 * PI, 0.0];
        let of = |states: Vec<Vec<f64>>| {
            let options = FitOptions {
                substeps: 4,
                iterations: 6,
                state_iterations: 2,
            };
            fit(
                &hybrid,
                &observations,
                &windows,
                &[],
                hybrid.theta(),
                states,
                vec![NOISE],
                &HiddenPrior::none(windows.len()),
                &options,
            )
        };
        let none = HiddenPrior::none(windows.len());
        let problem = Problem::new(&hybrid, &observations, &windows, &[], &none, 4);
        let mut alone = problem.rolled(&hybrid.theta(), wrong.clone());
        for _ in 0..8 {
            let reduced = problem.reduced(&hybrid.theta(), &mut alone, &[NOISE]);
            alone = problem.stepped_alone(&hybrid.theta(), &alone, reduced, &[NOISE]);
        }
        let stuck = alone[4].loss(&[NOISE]);
        assert!(stuck > 100.0, "it finds the way by itself: {stuck}");
        let (straight, led_astray) = (of(right), of(wrong));
        assert!(straight.loss < 1e-3, "{}", straight.loss);
        assert!(
            (led_astray.loss - straight.loss).abs() < 1e-3,
            "{}",
            led_astray.loss
        );
        for (a, b) in straight.states.iter().zip(&led_astray.states) {
            assert!((a[0] - b[0]).abs() < 1e-4 && (a[1] - b[1]).abs() < 1e-3);
        }
    }
}
