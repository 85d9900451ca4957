//! Roll-outs of eight windows at once, with exact sensitivities.

use std::ops::Range;

use lagrange::LANES;
use pulp::NullaryFnOnce;
use rayon::prelude::*;

use super::stiff::{HALVINGS, On, Stiff};
use super::{Diverged, Trajectory};
use crate::hybrid::{DrivenInputs, Eight, EightMemory, Hybrid, Lane};
use crate::processor::Processor;

/// One window to be rolled out.
#[derive(Clone, Copy)]
pub(crate) struct Member<'a> {
    /// The inputs of its recording.
    pub inputs: &'a DrivenInputs,
    /// Its first sample and their number.
    pub span: (usize, usize),
    /// Its initial state.
    pub initial: &'a [f64],
}

/// Rolls out eight windows at once on one thread: as [`Roller::roll_with_sensitivities`](super::Roller::roll_with_sensitivities), in lanes.
pub(crate) struct EightRoller<'a> {
    pub(super) hybrid: &'a Hybrid,
    pub(super) free: &'a [usize],
    memory: EightMemory,
    processor: Processor,
    /// (x, S) at the beginning of the step.
    pub(super) base: Vec<Lane>,
    /// (x, S) at a stage of it.
    pub(super) point: Vec<Lane>,
    /// k₁ + 2 k₂ + 2 k₃ + k₄.
    pub(super) sum: Vec<Lane>,
    /// One column of a slope.
    slope: Vec<Lane>,
    /// Of a model that needs it.
    pub(super) stiff: Option<Box<Stiff>>,
}

impl<'a> EightRoller<'a> {
    /// For the model with these free entries of θ.
    pub fn new(hybrid: &'a Hybrid, free: &'a [usize]) -> Self {
        let nx = hybrid.nx();
        let zeros = |n: usize| vec![[0.0; LANES]; n];
        EightRoller {
            hybrid,
            free,
            memory: hybrid.memory_of_eight(free),
            processor: Processor::here(),
            base: Vec::new(),
            point: Vec::new(),
            sum: Vec::new(),
            slope: zeros(nx),
            stiff: hybrid.is_stiff().then(Box::default),
        }
    }

    /// Rolls out up to eight windows with the same number of samples: as
    /// [`Roller::roll`](super::Roller::roll) each. An error is that of any of them.
    pub fn roll(
        &mut self,
        theta: &[f64],
        members: &[Member<'_>],
        out: &mut [Trajectory],
    ) -> Result<(), Diverged> {
        self.roll_columns(1, theta, members, out)
    }

    /// The same with sensitivities in the initial state and θ_free.
    pub fn roll_with_sensitivities(
        &mut self,
        theta: &[f64],
        members: &[Member<'_>],
        out: &mut [Trajectory],
    ) -> Result<(), Diverged> {
        let columns = 1 + self.hybrid.nx() + self.free.len();
        self.roll_columns(columns, theta, members, out)
    }

    /// `columns`: how many of (x, S).
    fn roll_columns(
        &mut self,
        columns: usize,
        theta: &[f64],
        members: &[Member<'_>],
        out: &mut [Trajectory],
    ) -> Result<(), Diverged> {
        let Some(last) = members.last() else {
            return Ok(());
        };
        // Lanes that are left over repeat the last window.
        let members: [&Member; LANES] = std::array::from_fn(|k| members.get(k).unwrap_or(last));
        let lanes = Lanes::new(&members);
        let (count, nx) = (last.span.1, self.hybrid.nx());
        for lanes in [&mut self.base, &mut self.point, &mut self.sum] {
            lanes.resize(columns * nx, [0.0; LANES]);
        }
        self.base.fill([0.0; LANES]);
        for i in 0..nx {
            self.base[i] = members.map(|member| member.initial[i]);
        }
        for diagonal in self.base[nx..].iter_mut().step_by(nx + 1).take(nx) {
            *diagonal = [1.0; LANES];
        }
        for out in out.iter_mut() {
            out.states.clear();
            out.sensitivities.clear();
            out.states.reserve_exact(count * nx);
            out.sensitivities.reserve_exact(count * (columns - 1) * nx);
        }
        if let Some(stiff) = &mut self.stiff {
            stiff.forget();
        }
        self.keep(out, [true; LANES]);
        for step in 0..lanes.longest() {
            let at = lanes.at(step);
            self.step(theta, &at, lanes.lengths(&at, step))?;
            let ends = lanes.ends(&at, step);
            if ends.contains(&true) {
                Diverged::check(self.base.as_flattened())?;
                self.keep(out, ends);
            }
        }
        Ok(())
    }

    /// Appends the present (x, S) to those of the windows that are at a sample.
    fn keep(&self, out: &mut [Trajectory], there: [bool; LANES]) {
        let (x, s) = self.base.split_at(self.hybrid.nx());
        for (lane, out) in out.iter_mut().enumerate().filter(|(lane, _)| there[*lane]) {
            out.states.extend(x.iter().map(|x| x[lane]));
            out.sensitivities.extend(s.iter().map(|s| s[lane]));
        }
    }

    /// One step of the length `h` for (x, S), Ṡ = (∂f/∂x) S + ∂f/∂θ: of the classical Runge-Kutta method unless the model is [stiff](Stiff).
    pub(super) fn step(&mut self, theta: &[f64], at: &Eight<'_>, h: Lane) -> Result<(), Diverged> {
        if let Some(stiff) = &mut self.stiff {
            let (hybrid, processor) = (self.hybrid, self.processor);
            let on = On {
                hybrid,
                theta,
                at,
                processor,
            };
            return stiff.step(on, h, &mut self.memory, &mut self.base, HALVINGS);
        }
        self.point.copy_from_slice(&self.base);
        self.stage::<0>(theta, at, h)?;
        self.stage::<1>(theta, at, h)?;
        self.stage::<2>(theta, at, h)?;
        self.stage::<3>(theta, at, h)
    }

    fn stage<const STAGE: usize>(
        &mut self,
        theta: &[f64],
        at: &Eight<'_>,
        h: Lane,
    ) -> Result<(), Diverged> {
        let (n, nx) = (self.hybrid.nv(), self.hybrid.nx());
        let (memory, x) = (&mut self.memory, &self.point[..nx]);
        let found = match self.point.len() > nx {
            true => self.hybrid.linearize_eight(x, theta, at, memory),
            false => self.hybrid.accelerate_eight(x, theta, at, memory, false),
        };
        found.map_err(Diverged::Dynamics)?;
        self.processor.run(Stage::<STAGE> {
            sizes: (n, nx),
            rates: &memory.rates,
            linear: &memory.linear,
            h,
            slope: &mut self.slope,
            at: (&mut self.base, &mut self.point, &mut self.sum),
        });
        Ok(())
    }
}

/// What follows the evaluation of f and its derivatives at one of the four stages.
struct Stage<'a, const STAGE: usize> {
    /// n = nv and nx.
    sizes: (usize, usize),
    rates: &'a [Lane],
    linear: &'a [Lane],
    h: Lane,
    slope: &'a mut [Lane],
    /// Base, point and sum.
    at: (&'a mut [Lane], &'a mut [Lane], &'a mut [Lane]),
}

impl<const STAGE: usize> NullaryFnOnce for Stage<'_, STAGE> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        // Sizes that are known are unrolled.
        match self.sizes {
            (2, 4) => self.columns(2, 4),
            (n, nx) => self.columns(n, nx),
        }
    }
}

impl<const STAGE: usize> Stage<'_, STAGE> {
    #[inline(always)]
    fn columns(self, n: usize, nx: usize) {
        let below = nx - n;
        let (base, point, sum) = self.at;
        let slope = &mut self.slope[..nx];
        let columns = base.chunks_exact_mut(nx).zip(point.chunks_exact_mut(nx));
        for (column, ((base, point), sum)) in columns.zip(sum.chunks_exact_mut(nx)).enumerate() {
            slope[..n].copy_from_slice(&point[n..2 * n]);
            for i in 0..below {
                // The first column is x, then nx of them are ∂x/∂x₀, then those in θ.
                let mut rate = match column {
                    0 => self.rates[i],
                    _ if column <= nx => [0.0; LANES],
                    _ => self.linear[(column - 1) * below + i],
                };
                if column > 0 {
                    for (j, s) in point.iter().enumerate().take(nx) {
                        let by = &self.linear[j * below + i];
                        for ((rate, by), s) in rate.iter_mut().zip(by).zip(s) {
                            *rate += by * s;
                        }
                    }
                }
                slope[n + i] = rate;
            }
            for i in 0..nx {
                for lane in 0..LANES {
                    let (h, k) = (self.h[lane], slope[i][lane]);
                    match STAGE {
                        0 => sum[i][lane] = k,
                        1 | 2 => sum[i][lane] += 2.0 * k,
                        _ => base[i][lane] += h / 6.0 * (sum[i][lane] + k),
                    }
                    point[i][lane] = match STAGE {
                        0 | 1 => base[i][lane] + h / 2.0 * k,
                        2 => base[i][lane] + h * k,
                        _ => base[i][lane],
                    };
                }
            }
        }
    }
}

/// Eight windows that are stepped beside each other, each along its own grid. One that has fewer steps than another waits at its end.
pub(super) struct Lanes<'a> {
    inputs: [&'a DrivenInputs; LANES],
    steps: [Range<usize>; LANES],
}

impl<'a> Lanes<'a> {
    pub fn new(members: &[&Member<'a>; LANES]) -> Self {
        let inputs = members.map(|member| member.inputs);
        let steps = members.map(|member| {
            let (grid, (first, count)) = (&member.inputs.grid, member.span);
            debug_assert!(first + count <= grid.samples(), "beyond the last sample");
            grid.steps_over(member.span)
        });
        Lanes { inputs, steps }
    }

    /// Steps of the one that has the most.
    pub fn longest(&self) -> usize {
        self.steps.iter().map(Range::len).max().unwrap_or(0)
    }

    /// Where they are at the beginning of the `k`th step.
    pub fn at(&self, k: usize) -> Eight<'a> {
        let of = |lane: usize| {
            let own = &self.steps[lane];
            (own.start + k).min(own.end.saturating_sub(1))
        };
        Eight {
            inputs: self.inputs,
            steps: std::array::from_fn(of),
        }
    }

    /// Whether a window has a `k`th step.
    pub fn goes(&self, lane: usize, k: usize) -> bool {
        k < self.steps[lane].len()
    }

    /// The lengths of the `k`th steps, s; 0 of those that wait.
    pub fn lengths(&self, at: &Eight<'_>, k: usize) -> Lane {
        let length = |lane: usize| {
            let (bounds, step) = (&self.inputs[lane].grid.bounds, at.steps[lane]);
            bounds[step + 1] - bounds[step]
        };
        std::array::from_fn(|lane| match self.goes(lane, k) {
            true => length(lane),
            false => 0.0,
        })
    }

    /// Which of the `k`th steps end at a sample.
    pub fn ends(&self, at: &Eight<'_>, k: usize) -> [bool; LANES] {
        std::array::from_fn(|lane| {
            self.goes(lane, k) && self.inputs[lane].grid.ends_at_sample(at.steps[lane])
        })
    }
}

/// Places of windows with the same number of samples and about as many steps, at most eight together; in their order where all have as many.
pub(super) fn alike(members: &[Member<'_>]) -> Vec<Vec<usize>> {
    let size = |&k: &usize| {
        let Member { inputs, span, .. } = members[k];
        (span.1, inputs.grid.steps_over(span).len())
    };
    let mut places: Vec<usize> = (0..members.len()).collect();
    places.sort_by_key(size);
    let as_long = places.chunk_by(|a, b| size(a).0 == size(b).0);
    as_long
        .flat_map(|run| run.chunks(LANES))
        .map(<[usize]>::to_vec)
        .collect()
}

/// What `of_group` makes of each window, eight at once and in threads, in the windows' order.
pub(super) fn by_groups<R, T: Send>(
    members: &[Member<'_>],
    roller: impl Fn() -> R + Sync + Send,
    of_group: impl Fn(&mut R, &[Member<'_>]) -> Vec<Option<T>> + Sync + Send,
) -> Vec<Option<T>> {
    let groups = alike(members);
    let done: Vec<Vec<Option<T>>> = groups
        .par_iter()
        .map_init(roller, |roller, places| {
            let own: Vec<Member> = places.iter().map(|&k| members[k]).collect();
            of_group(roller, &own)
        })
        .collect();
    let mut all: Vec<Option<T>> = members.iter().map(|_| None).collect();
    for (place, own) in groups.into_iter().flatten().zip(done.into_iter().flatten()) {
        all[place] = own;
    }
    all
}

impl EightRoller<'_> {
    /// Which of the eight had left the range of any mechanism when the last roll-out ended.
    fn lost(&self) -> [bool; LANES] {
        let all = || self.base.iter().chain(&self.point);
        std::array::from_fn(|lane| all().any(|x| Diverged::check(&[x[lane]]).is_err()))
    }

    /// What `at_once` makes of up to eight windows; none where they diverge. Those that are lost on the way are left out, and the others done without
    /// them; where it does not show which of them it is, one after the other.
    pub(super) fn each<T>(
        &mut self,
        members: &[Member<'_>],
        at_once: impl Fn(&mut Self, &[Member<'_>]) -> Result<Vec<T>, Diverged>,
    ) -> Vec<Option<T>> {
        let mut done: Vec<Option<T>> = members.iter().map(|_| None).collect();
        let mut left: Vec<usize> = (0..members.len()).collect();
        while !left.is_empty() {
            let some: Vec<Member> = left.iter().map(|&k| members[k]).collect();
            if let Ok(all) = at_once(self, &some) {
                for (k, own) in left.drain(..).zip(all) {
                    done[k] = Some(own);
                }
                break;
            }
            let (lost, mut lane) = (self.lost(), 0..);
            left.retain(|_| lane.next().is_none_or(|lane: usize| !lost[lane]));
            if left.len() == some.len() {
                for k in left.drain(..).filter(|_| some.len() > 1) {
                    let alone = at_once(self, &members[k..=k]);
                    done[k] = alone.ok().and_then(|mut own| own.pop());
                }
            }
        }
        done
    }
}

/// The roll-outs of windows, in their order, eight at once and in threads; none where they diverge. Results depend on the groups by rounding, those of
/// stiff models by what their stages are solved to, on the number of threads not at all.
pub(crate) fn roll_all(
    (hybrid, theta, free): (&Hybrid, &[f64], &[usize]),
    members: &[Member<'_>],
    derivatives: bool,
) -> Vec<Option<Trajectory>> {
    let roll = |eight: &mut EightRoller<'_>, members: &[Member<'_>]| {
        let mut rolled = vec![Trajectory::default(); members.len()];
        match derivatives {
            true => eight.roll_with_sensitivities(theta, members, &mut rolled)?,
            false => eight.roll(theta, members, &mut rolled)?,
        }
        Ok(rolled)
    };
    let roller = || EightRoller::new(hybrid, free);
    by_groups(members, roller, |eight, members| eight.each(members, roll))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use std::path::Path;
    use std::sync::Arc;

    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::super::Roller;
    use super::*;
    use crate::effect::{Grid, registry};
    use crate::hybrid::Placed;
    use crate::learnt::{Feature, LearntForce, Output, Quantity};
    use crate::model::Model;
    use crate::network::{Activation, Mlp, Shape};

    /// The cart-pole with its known friction and more effects: kind, target and parameters of each.
    fn cart_pole_with(effects: &[(&str, usize, &[f64])]) -> Hybrid {
        model_with("cartpole", effects)
    }

    fn model_with(name: &str, effects: &[(&str, usize, &[f64])]) -> Hybrid {
        let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models");
        let model = Model::load(&models.join(format!("{name}/{name}.toml"))).unwrap();
        let mut hybrid = Hybrid::of(&model);
        for &(kind, target, values) in effects {
            let placed = Placed {
                kind: registry::find(kind).unwrap(),
                target,
                smoothing: 0.01,
                fixed: false,
            };
            hybrid.add(placed, values);
        }
        // And a network that is open to the fit.
        let feature = |quantity| Feature {
            quantity,
            offset: 0.1,
            width: 2.0,
            range: [-1.0, 1.0],
        };
        let features = vec![
            feature(Quantity::Velocity(0)),
            feature(Quantity::Sine(1)),
            feature(Quantity::Input { input: 0, back: 0 }),
        ];
        let shape = Shape::new(&[3, 4, 1], Activation::Tanh, Activation::Identity).unwrap();
        let network = Mlp::xavier(shape, &mut ChaCha8Rng::seed_from_u64(1));
        let output = Output {
            coordinate: 0,
            scale: 0.5,
        };
        let force = LearntForce::new(network, features, vec![output], false).unwrap();
        hybrid.add_open_network(Arc::new(force), 1.0);
        hybrid
    }

    /// The distance of eight (or fewer) windows of two recordings from the same windows one by one, relative to their size.
    fn distance(hybrid: &Hybrid, windows: usize) -> f64 {
        let (theta, free) = (hybrid.theta(), hybrid.free());
        let drive = |interval: f64, times: &[usize]| {
            let t: Vec<f64> = (0..61).map(|k| k as f64 * interval).collect();
            let u = |i: usize| {
                let of = |t: &f64| 2.0 * (9.0 * t + 0.5 * i as f64).sin();
                t.iter().map(of).collect()
            };
            let u: Vec<Vec<f64>> = (0..hybrid.inputs()).map(u).collect();
            let grid = Grid::finer(&t, 4, times);
            hybrid.drive_on(grid, &u, &theta, &free)
        };
        // A lane of one that takes more steps about some samples waits for none of the other, and the other for it.
        let times: Vec<usize> = (0..60).map(|k| 1 + k % 3).collect();
        let inputs = [drive(0.02, &[]), drive(0.015, &times)];
        let starts: Vec<Vec<f64>> = (0..windows)
            .map(|k| {
                let k = k as f64;
                let mut start = vec![0.1, 2.5 - 0.3 * k, 0.2 * k - 0.2, 1.5 - 0.4 * k];
                start.resize(hybrid.nq() + hybrid.nv(), 0.3 * k + 0.1);
                start.resize(hybrid.nx(), 1e-3 * k);
                start
            })
            .collect();
        let members: Vec<Member> = starts
            .iter()
            .enumerate()
            .map(|(k, initial)| Member {
                inputs: &inputs[k % 2],
                span: (3 * k, 21),
                initial,
            })
            .collect();
        let mut at_once = vec![Trajectory::default(); windows];
        let mut without = at_once.clone();
        let mut eight = EightRoller::new(hybrid, &free);
        eight
            .roll_with_sensitivities(&theta, &members, &mut at_once)
            .unwrap();
        eight.roll(&theta, &members, &mut without).unwrap();
        let mut worst = 0.0_f64;
        let mut compare = |a: &[f64], b: &[f64]| {
            assert_eq!(a.len(), b.len());
            let size = a.iter().fold(0.0_f64, |size, a| size.max(a.abs()));
            for (a, b) in a.iter().zip(b) {
                worst = worst.max((a - b).abs() / size);
            }
        };
        for ((member, at_once), without) in members.iter().zip(&at_once).zip(&without) {
            let mut alone = Trajectory::default();
            Roller::new(hybrid, &free)
                .roll_with_sensitivities(
                    &theta,
                    member.inputs,
                    member.span,
                    member.initial,
                    &mut alone,
                )
                .unwrap();
            compare(&alone.states, &at_once.states);
            compare(&alone.states, &without.states);
            compare(&alone.sensitivities, &at_once.sensitivities);
            assert!(without.sensitivities.is_empty());
        }
        worst
    }

    #[test]
    fn eight_windows_at_once_are_the_same_windows_one_by_one() {
        let link = |name: &str| {
            let hybrid = cart_pole_with(&[]);
            let links = hybrid.links().iter();
            let index = links.clone().position(|link| link.name == name);
            index.unwrap_or_else(|| panic!("{name} is none of {:?}", hybrid.links()))
        };
        let pole = link("pole");
        let coulomb = ("coulomb_friction", 1, &[0.01][..]);
        let gain = ("input_gain_error", 0, &[0.9][..]);
        let lugre = ("lugre_friction", 1, &[0.01, 0.02, 0.1, 5.0, 0.01][..]);
        let dahl = ("dahl_friction", 1, &[0.2, 0.02][..]);
        let hysteresis = ("hysteresis", 0, &[3.0, 0.05][..]);
        let load = ("load_dependent_friction", 0, &[0.1][..]);
        let cart_mass = ("added_mass", link("cart"), &[0.05][..]);
        let pole_mass = ("added_mass", pole, &[0.02][..]);
        let rotor = ("reflected_inertia", 1, &[0.002][..]);
        let tilt = ("gravity_tilt", 0, &[0.03][..]);
        let elastic = (
            "elastic_transmission",
            0,
            &[800.0, 1.0, 0.1, 0.4, 1.0, 1.0][..],
        );
        let backlash = ("backlash", 0, &[0.004, 800.0, 2.0, 0.1, 0.0][..]);
        let sets: [&[(&str, usize, &[f64])]; 16] = [
            &[coulomb],
            &[gain],
            &[lugre],
            &[dahl],
            &[hysteresis],
            &[load],
            &[cart_mass],
            &[pole_mass],
            &[rotor],
            &[tilt],
            &[elastic],
            &[backlash],
            &[pole_mass, tilt],
            &[rotor, hysteresis],
            &[backlash, pole_mass],
            &[gain, load, dahl],
        ];
        let cart_poles = sets.map(|effects| (effects, cart_pole_with(effects)));
        // Its fans turn with it.
        let late: &[(&str, usize, &[f64])] = &[("input_delay", 1, &[0.013]), gain];
        let hovercraft = (late, model_with("hovercraft", late));
        for (effects, hybrid) in cart_poles.into_iter().chain([hovercraft]) {
            for windows in [8, 3] {
                let distance = distance(&hybrid, windows);
                assert!(distance < 1e-9, "{effects:?}, {windows}: {distance:e}");
            }
        }
    }

    #[test]
    fn eight_states_without_an_acceleration_are_an_error() {
        // No inertia is left of the cart's once its motor takes more than there is.
        let hybrid = cart_pole_with(&[("backlash", 0, &[0.004, 800.0, 2.0, 100.0, 0.0])]);
        let (theta, free) = (hybrid.theta(), hybrid.free());
        let t: Vec<f64> = (0..4).map(|k| f64::from(k) * 0.02).collect();
        let inputs = hybrid.drive(&t, &[vec![1.0; 4]], 4, &theta, &free);
        let members = [Member {
            inputs: &inputs,
            span: (0, 4),
            initial: &[0.1, 2.5, 0.0, 1.0, 0.0, 0.0],
        }; 8];
        let mut out = vec![Trajectory::default(); 8];
        let mut eight = EightRoller::new(&hybrid, &free);
        let found = eight.roll(&theta, &members, &mut out);
        let with = eight.roll_with_sensitivities(&theta, &members, &mut out);
        for found in [found, with] {
            let singular = matches!(
                found,
                Err(Diverged::Dynamics(lagrange::Error::SingularMassMatrix {
                    pivot: 0,
                    ..
                }))
            );
            assert!(singular, "{found:?}");
        }
    }

    #[test]
    fn one_of_eight_that_diverges_is_an_error() {
        let hybrid = cart_pole_with(&[("coulomb_friction", 1, &[0.01])]);
        let theta = hybrid.theta();
        let t: Vec<f64> = (0..31).map(|k| f64::from(k) * 0.02).collect();
        let inputs = hybrid.drive(&t, &[vec![0.0; 31]], 4, &theta, &[]);
        let (calm, wild) = ([0.1, 2.5, 0.0, 1.0], [0.1, 2.5, 0.0, 1e13]);
        let member = |initial| Member {
            inputs: &inputs,
            span: (0, 31),
            initial,
        };
        let mut members = [member(&calm[..]); 8];
        let mut out = vec![Trajectory::default(); 8];
        let mut eight = EightRoller::new(&hybrid, &[]);
        eight.roll(&theta, &members, &mut out).unwrap();
        let undisturbed = out[0].states.clone();
        members[5] = member(&wild[..]);
        assert!(eight.roll(&theta, &members, &mut out).is_err());
        // The others are what they are without it, with derivatives and without.
        let lost: Vec<usize> = (0..8).filter(|&lane| eight.lost()[lane]).collect();
        assert_eq!(lost, [5]);
        for derivatives in [false, true] {
            let rolled = roll_all((&hybrid, &theta, &[]), &members, derivatives);
            for (lane, rolled) in rolled.iter().enumerate() {
                let Some(rolled) = rolled else {
                    assert_eq!(lane, 5);
                    continue;
                };
                let both = rolled.states.iter().zip(&undisturbed);
                assert!(
                    both.into_iter().all(|(a, b)| (a - b).abs() < 1e-12),
                    "{lane}"
                );
            }
        }
    }
}
