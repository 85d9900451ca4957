//! The virtual test rig: logs of a cart-pole with a hidden effect.
//!
//! The rig is the truth against which the missing-physics workflow is judged. It has its own effects, with dry friction that really
//! sticks, its own sensors and a hand at the input. It shares M, C and G with the rest of the project, and the stepping from event to
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
pub mod effects;
mod error;
mod hidden;
mod key;
mod known_model;
mod noise;
pub mod operator;
pub mod plant;
mod recording;
pub mod sensors;
pub mod truth;

pub use error::Error;
pub use hidden::{CASES, CHOICES, Hidden, Target, draw, draw_of};
pub use key::Key;
pub use known_model::known_model;
pub use recording::Recording;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::config::Config;
use effects::{Drive, Effects};
use noise::Coloured;
use operator::Operator;
use plant::Plant;
use sensors::{Sensors, backward_difference};
use truth::{State, Truth};

/// Random streams of one seed: what draws from one does not move the others.
mod stream {
    pub const DRAW: u64 = 0;
    pub const MOVES: u64 = 1;
    pub const TREMOR: u64 = 2;
    pub const CART_FORCE: u64 = 3;
    pub const SENSORS: u64 = 4;
}

/// The disturbing force on the cart changes this often, s.
const DISTURBANCE_INTERVAL: f64 = 5e-3;

/// A recording of the rig with the hidden effect. Same arguments, same bits.
pub fn run(config: &Config, hidden: &Hidden, seed: u64) -> Result<Recording, Error> {
    let (recording, _) = run_with(plant::read(&config.urdf)?, config, hidden, seed)?;
    Ok(recording)
}

/// [`run`] on a given plant; returns also the true state at each row.
pub fn run_with<P: Plant>(
    plant: P,
    config: &Config,
    hidden: &Hidden,
    seed: u64,
) -> Result<(Recording, Vec<State>), Error> {
    let random = |stream| {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(stream);
        rng
    };
    let effects = Effects {
        rail: Some(config.rail),
        ..Effects::of(&config.known, hidden)?
    };
    let noise = config.noise();
    let interval = 1.0 / config.rate;
    let mut operator = Operator::new(
        config.operator,
        interval,
        random(stream::MOVES),
        random(stream::TREMOR),
    );
    let pieces = (interval / DISTURBANCE_INTERVAL * (1.0 - 1e-9))
        .ceil()
        .max(1.0);
    let mut disturbance = Coloured::new(
        random(stream::CART_FORCE),
        noise.cart_force,
        noise.cart_force_time,
        interval / pieces,
    );
    let mut sensors = Sensors::new(*noise, random(stream::SENSORS));
    let mut rig = Truth::new(plant, effects, config.truth_step, State::HANGING);

    let rows = (config.duration * config.rate).round().max(1.0) as usize;
    let mut recording = Recording::default();
    let mut states = Vec::with_capacity(rows);
    // It was at rest before the first row.
    let mut before = sensors.measure(rig.state().q);
    for k in 0..rows {
        let state = rig.state();
        let time = k as f64 / config.rate;
        let measured = sensors.measure(state.q);
        let velocity = backward_difference(before, measured, interval);
        before = measured;
        states.push(state);
        recording.t.push(time);
        for joint in 0..2 {
            recording.q[joint].push(measured[joint]);
            recording.v[joint].push(velocity[joint]);
        }
        recording.u.push(operator.command(state));
        let arriving = arriving(&effects.drive, &recording.u, interval);
        advance(
            &mut rig,
            arriving,
            interval,
            pieces as usize,
            &mut disturbance,
        )?;
    }
    recording.blows = rig.blows().to_vec();
    Ok((recording, states))
}

/// What arrives at the cart in the interval that has just begun, of the inputs `u` so far, the last of them for this interval:
/// the force until the switch, N, the time of the switch, s, and the force after it.
fn arriving(drive: &Drive, u: &[f64], interval: f64) -> (f64, f64, f64) {
    let late = drive.delay / interval;
    let whole = late.floor();
    let input = |back: usize| {
        let index = u.len().checked_sub(1 + back);
        (1.0 + drive.gain) * index.and_then(|i| u.get(i)).copied().unwrap_or(0.0)
    };
    let whole_steps = whole as usize;
    (
        input(whole_steps.saturating_add(1)),
        (late - whole) * interval,
        input(whole_steps),
    )
}

/// One interval of the log: the disturbance is held over each of its pieces, the input switches once.
fn advance<P: Plant>(
    rig: &mut Truth<P>,
    (early, switch, late): (f64, f64, f64),
    interval: f64,
    pieces: usize,
    disturbance: &mut Coloured,
) -> Result<(), Error> {
    let piece = interval / pieces as f64;
    for i in 0..pieces {
        let force = disturbance.next();
        let before_switch = (switch - i as f64 * piece).clamp(0.0, piece);
        rig.advance_under([early, force], before_switch)?;
        rig.advance_under([late, force], piece - before_switch)?;
    }
    Ok(())
}
