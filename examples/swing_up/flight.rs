//! One run of the rig: the filter reads the sensors, the pilot commands, until the episode is over.

use std::error::Error;
use std::f64::consts::TAU;
use std::fmt;

use cartpole::paper::RigEnvironment;
use pinode_nn::environment::{Environment, Task};
use pinode_nn::model::Model;

use super::filter::Filter;
use super::pilot::Pilot;
use super::plant::Plant;

/// From hanging on, so many samples.
pub const STEPS: usize = 750;
/// The pole has to stay up for so long, s.
const HOLD: f64 = 5.0;
/// Up is closer than this to upright, rad.
const UP: f64 = 0.2;

/// What a run on the rig came to.
pub struct Flown {
    /// When the pole came up to stay, s.
    pub up: Option<f64>,
    /// How long it stayed up, to the end, s.
    pub held: f64,
    /// Largest distance of the cart from the middle of its rail, m, in all and while it is held.
    pub largest: [f64; 2],
    /// Root mean square of the angle while it is held, rad.
    pub rms: f64,
    /// Blows on the ends of the rail.
    pub blows: usize,
}

impl Flown {
    /// Whether the pole was held long enough, without a blow.
    pub fn is_held(&self) -> bool {
        self.held >= HOLD && self.blows == 0
    }
}

impl fmt::Display for Flown {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Flown {
            up,
            held,
            largest,
            rms,
            blows,
        } = self;
        match up {
            None => write!(f, "not held, ")?,
            Some(up) => write!(
                f,
                "up after {up:.2} s, held for {held:.2} s with an angle of {rms:.4} rad (rms) and |x| < {:.3} m, ",
                largest[1]
            )?,
        }
        write!(
            f,
            "largest |x| {:.3} m from the middle, {blows} blows",
            largest[0]
        )
    }
}

/// One run of the rig from hanging at rest.
pub fn fly<T: Task>(
    rig: &mut RigEnvironment<T>,
    model: &Model,
    plant: &mut Plant,
    pilot: &mut Pilot<'_>,
    seed: u64,
) -> Result<Flown, Box<dyn Error>> {
    let interval = rig.interval();
    let mut observation = rig.reset(Some(seed))?;
    let mut filter = Filter::new(model, &observation)?;
    pilot.begin();
    let mut track = Vec::with_capacity(STEPS);
    loop {
        filter.read(&observation)?;
        let past = pilot.past.clone();
        let force = pilot.command(plant, &filter.state())?;
        filter.advance(plant, &past, force)?;
        let step = rig.step(&[force])?;
        observation = step.observation;
        let truth = rig.truth().ok_or("the rig has no state")?;
        let phi = truth.q[1];
        track.push([truth.q[0] - pilot.centre(), phi - TAU * (phi / TAU).round()]);
        if step.terminated || step.truncated {
            break;
        }
    }
    let first = track
        .iter()
        .rposition(|[_, phi]| phi.abs() >= UP)
        .map_or(0, |k| k + 1);
    let held = &track[first..];
    let largest = |track: &[[f64; 2]]| track.iter().map(|[x, _]| x.abs()).fold(0.0, f64::max);
    let squares: f64 = held.iter().map(|[_, phi]| phi * phi).sum();
    Ok(Flown {
        up: (!held.is_empty()).then_some((first + 1) as f64 * interval),
        held: held.len() as f64 * interval,
        largest: [largest(&track), largest(held)],
        rms: (squares / held.len().max(1) as f64).sqrt(),
        blows: rig.blows().len(),
    })
}
