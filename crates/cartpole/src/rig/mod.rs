//! The virtual test rig: logs of a cart-pole with a hidden effect.
//!
//! The rig is the truth against which the missing-physics workflow is judged. It has its own effects ([`Hidden`] lists them), with dry
//! friction that really sticks, its own sensors and a hand at the input. It shares M, C and G with the rest of the project, and the stepping from event to
//! event, half a millisecond at most at a time, of [`integrators::event`], which no fit uses.
//!
//! ```no_run
//! use cartpole::{config::Config, rig};
//!
//! let config = Config::read("models/cartpole/rig.toml".as_ref())?;
//! let hidden = rig::draw(&config, 1);
//! rig::run(&config, &hidden, 1)?.write_csv("log.csv".as_ref())?;
//! rig::known_model(&hidden, "models/cartpole".as_ref(), "user".as_ref())?;
//! rig::Key::new(&config, &hidden, 1).write_json("sealed/key.json".as_ref())?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
mod draw;
pub mod effects;
mod error;
mod hidden;
mod key;
mod known_model;
mod noise;
pub mod operator;
mod placing;
pub mod plant;
mod recording;
mod sampling;
mod scene;
pub mod sensors;
mod sizes;
pub mod truth;

use draw::draw_case;
pub use draw::{CASES, CASES_ALL, CHOICES, UNSEEN, draw, draw_any, draw_of};
pub use error::Error;
pub use hidden::{Hidden, Target};
pub use key::Key;
pub use known_model::{known_model, known_model_without};
pub use recording::Recording;
pub(crate) use recording::write_whole;
pub use sampling::Sampling;
pub use scene::{Base, Dirt, FORM_CASES, Forms, Scene, draw_several, draw_suspects};

use std::collections::VecDeque;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::config::{self, Config, Noise};
use effects::{Drive, Effects};
use noise::Coloured;
use operator::Operator;
use plant::Plant;
use sensors::{Sensors, backward_difference};
use truth::{State, Truth};

/// Random streams of one seed: what draws from one does not move the others.
pub(crate) mod stream {
    pub const DRAW: u64 = 0;
    pub const MOVES: u64 = 1;
    pub const TREMOR: u64 = 2;
    pub const CART_FORCE: u64 = 3;
    pub const SENSORS: u64 = 4;
    pub const SCENE: u64 = 5;
    pub const SWING: u64 = 6;
    pub const CLOCK: u64 = 7;
}

/// The disturbing force on the cart changes this often, s.
const DISTURBANCE_INTERVAL: f64 = 5e-3;

/// A recording of the rig with the hidden effect. Same arguments, same bits.
pub fn run(config: &Config, hidden: &Hidden, seed: u64) -> Result<Recording, Error> {
    run_scene(config, &Scene::of(hidden), seed)
}

/// A recording of the rig with everything that sets it apart from its model. Same arguments, same bits.
pub fn run_scene(config: &Config, scene: &Scene, seed: u64) -> Result<Recording, Error> {
    let plant = plant::read(&config.urdf)?;
    let plant = match scene.masses() {
        Some(masses) => plant.with_masses(&masses)?,
        None => plant,
    };
    let effects = scene.effects(&config.known)?;
    Ok(run_effects(plant, config, effects, scene.sampling, seed)?.0)
}

/// [`run`] on a given plant; returns also the true state at each row.
pub fn run_with<P: Plant>(
    plant: P,
    config: &Config,
    hidden: &Hidden,
    seed: u64,
) -> Result<(Recording, Vec<State>), Error> {
    run_effects(
        plant,
        config,
        Effects::of(&config.known, hidden)?,
        None,
        seed,
    )
}

fn run_effects<P: Plant>(
    plant: P,
    config: &Config,
    effects: Effects,
    sampling: Option<Sampling>,
    seed: u64,
) -> Result<(Recording, Vec<State>), Error> {
    // Hidden stops are nobody's to hear.
    let heard = effects.rail.is_none();
    let run = Run {
        effects: Effects {
            rail: effects.rail.or(Some(config.rail)),
            ..effects
        },
        noise: config.noise(),
        rate: config.rate,
        truth_step: config.truth_step,
        rows: (config.duration * config.rate).round().max(1.0) as usize,
        sampling,
        seed,
    };
    let mut operator = run.operator(config.operator);
    let mut states = Vec::with_capacity(run.rows);
    let mut recording = run.record(plant, |rig, _| {
        states.push(rig.state());
        operator.command(rig.state())
    })?;
    if !heard {
        recording.blows.clear();
    }
    Ok((recording, states))
}

/// What a recording is made of beside the plant and the hand.
pub(crate) struct Run<'a> {
    /// What acts on the rig.
    pub effects: Effects,
    /// Sensors and disturbances.
    pub noise: &'a Noise,
    /// Rows a second, Hz.
    pub rate: f64,
    /// Longest step of the integrator, s.
    pub truth_step: f64,
    /// Length of the recording, with the rows that are lost.
    pub rows: usize,
    /// When rows are taken, if not evenly, and what is lost of them.
    pub sampling: Option<Sampling>,
    /// Of everything random.
    pub seed: u64,
}

impl Run<'_> {
    /// A random stream of the seed.
    pub fn random(&self, stream: u64) -> ChaCha8Rng {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        rng.set_stream(stream);
        rng
    }

    /// The hand that makes random moves.
    pub fn operator(&self, settings: config::Operator) -> Operator {
        Operator::new(
            settings,
            1.0 / self.rate,
            self.random(stream::MOVES),
            self.random(stream::TREMOR),
        )
    }

    /// The rig in a state in which it was all the time before, without inputs.
    pub fn start<P: Plant>(&self, plant: P, state: State) -> Bench<P> {
        let interval = self.tick();
        let pieces = (interval / DISTURBANCE_INTERVAL * (1.0 - 1e-9))
            .ceil()
            .max(1.0);
        let disturbance = Coloured::new(
            self.random(stream::CART_FORCE),
            self.noise.cart_force,
            self.noise.cart_force_time,
            interval / pieces,
        );
        let mut sensors = Sensors::new(*self.noise, self.random(stream::SENSORS));
        let faults = self.effects.sensors;
        let before = sensors.measure(faults.read(state.q));
        Bench {
            rig: Truth::new(plant, self.effects, self.truth_step, state),
            effects: self.effects,
            interval,
            pieces: pieces as usize,
            disturbance,
            sensors,
            late: [0, 1].map(|joint| Late::new(faults.delay[joint], interval, state.q[joint])),
            before,
            since: 1,
            recent: VecDeque::new(),
        }
    }

    /// The rig from rest under the force, N, that `hand` asks for at the beginning of each row, where it sees the rig and the
    /// inputs before, N.
    pub fn record<P: Plant>(
        &self,
        plant: P,
        mut hand: impl FnMut(&Truth<P>, &[f64]) -> f64,
    ) -> Result<Recording, Error> {
        let mut bench = self.start(plant, State::HANGING);
        let mut recording = Recording::default();
        for row in self.clock() {
            let [measured, velocity] = bench.measure();
            let command = hand(bench.truth(), &recording.u);
            if row.written {
                recording.t.push(row.time);
                for joint in 0..2 {
                    recording.q[joint].push(measured[joint]);
                    recording.v[joint].push(velocity[joint]);
                }
                recording.u.push(command);
            }
            for _ in 0..row.ticks {
                bench.hold(command)?;
            }
        }
        if let Some(sampling) = self.sampling {
            sampling.round(&mut recording);
        }
        recording.blows = bench.truth().blows().to_vec();
        Ok(recording)
    }
}

/// A rig at work: it is measured and acted upon in turn.
pub(crate) struct Bench<P: Plant> {
    rig: Truth<P>,
    effects: Effects,
    /// Between two rows, s.
    interval: f64,
    /// Of an interval, over which the disturbance is held.
    pieces: usize,
    disturbance: Coloured,
    sensors: Sensors,
    late: [Late; 2],
    /// What was measured last.
    before: [f64; 2],
    /// Intervals since then.
    since: u32,
    /// The inputs that have not all arrived, N, the last one last.
    recent: VecDeque<f64>,
}

impl<P: Plant> Bench<P> {
    /// x, m, and φ, rad, as the sensors read them at the beginning of this interval, and their differences to the reading before, m/s
    /// and rad/s. Once an interval at most.
    pub fn measure(&mut self) -> [[f64; 2]; 2] {
        let mut seen = self.rig.state().q;
        for (seen, late) in seen.iter_mut().zip(&mut self.late) {
            for _ in 0..self.since {
                *seen = late.next().unwrap_or(*seen);
            }
        }
        let measured = self.sensors.measure(self.effects.sensors.read(seen));
        let passed = f64::from(self.since) * self.interval;
        let velocity = backward_difference(self.before, measured, passed);
        self.before = measured;
        self.since = 0;
        [measured, velocity]
    }

    /// Lets one interval pass under the input `command`, N.
    pub fn hold(&mut self, command: f64) -> Result<(), Error> {
        self.since = self.since.saturating_add(1);
        self.recent.push_back(command);
        let arriving = arriving(
            &self.effects.drive,
            self.recent.make_contiguous(),
            self.interval,
        );
        let matter = (self.effects.drive.delay / self.interval).floor() as usize;
        while self.recent.len() > matter.saturating_add(1) {
            self.recent.pop_front();
        }
        advance(
            &mut self.rig,
            arriving,
            self.interval,
            self.pieces,
            &mut self.disturbance,
            &mut self.late,
        )
    }

    /// What is.
    pub fn truth(&self) -> &Truth<P> {
        &self.rig
    }
}

/// What arrives at the cart in the interval that has just begun, of the inputs `u` so far, the last of them for this interval:
/// the force until the switch, N, the time of the switch, s, and the force after it.
pub(crate) fn arriving(drive: &Drive, u: &[f64], interval: f64) -> (f64, f64, f64) {
    let late = drive.delay / interval;
    let whole = late.floor();
    let input = |back: usize| {
        let index = u.len().checked_sub(1 + back);
        drive.force(index.and_then(|i| u.get(i)).copied().unwrap_or(0.0))
    };
    let whole_steps = whole as usize;
    (
        input(whole_steps.saturating_add(1)),
        (late - whole) * interval,
        input(whole_steps),
    )
}

/// A joint's sensor that reads what was: at row k the position at t_k − delay.
struct Late {
    /// When in an interval the joint is where a later row will say, s after the interval's begin; none without a delay.
    instant: Option<f64>,
    /// What the next rows will say.
    readings: VecDeque<f64>,
}

impl Late {
    /// Of a joint that has been at `start` all the time.
    fn new(delay: f64, interval: f64, start: f64) -> Self {
        if delay == 0.0 {
            return Late {
                instant: None,
                readings: VecDeque::new(),
            };
        }
        // The small excess keeps a delay of whole intervals from becoming one more.
        let whole = (delay / interval * (1.0 - 1e-9)).ceil();
        Late {
            instant: Some((whole * interval - delay).max(0.0)),
            readings: std::iter::repeat_n(start, whole as usize).collect(),
        }
    }

    /// The position that the row's reading is of; none without a delay.
    fn next(&mut self) -> Option<f64> {
        self.readings.pop_front()
    }
}

/// One interval of the log: the disturbance is held over each of its pieces, the input switches once, late sensors take note.
fn advance<P: Plant>(
    rig: &mut Truth<P>,
    (early, switch, after): (f64, f64, f64),
    interval: f64,
    pieces: usize,
    disturbance: &mut Coloured,
    late: &mut [Late; 2],
) -> Result<(), Error> {
    let piece = interval / pieces as f64;
    for i in 0..pieces {
        let force = disturbance.next();
        let start = i as f64 * piece;
        let before_switch = (switch - start).clamp(0.0, piece);
        let mut at = 0.0;
        let mut go_on = |rig: &mut Truth<P>, until: f64| {
            for (end, arriving) in [(before_switch.min(until), early), (until, after)] {
                rig.advance_under([arriving, force], end - at)?;
                at = at.max(end);
            }
            Ok(())
        };
        let instant = |late: &Late| {
            let here = |t: &f64| (*t / piece) as usize == i || (i + 1 == pieces && *t >= start);
            late.instant
                .filter(here)
                .map(|t| (t - start).clamp(0.0, piece))
        };
        let mut notes = [0, 1].map(|joint| (joint, instant(&late[joint])));
        notes.sort_by(|(_, a), (_, b)| a.partial_cmp(b).unwrap_or(std::cmp::Ordering::Equal));
        for (joint, instant) in notes {
            if let Some(instant) = instant {
                go_on(rig, instant)?;
                late[joint].readings.push_back(rig.state().q[joint]);
            }
        }
        go_on(rig, piece)?;
    }
    Ok(())
}
