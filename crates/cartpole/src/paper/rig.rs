//! The paper's rig.

use std::path::Path;

use integrators::event::Direction;

use super::operator::Hand;
use super::{Error, Recording, Truth};
use crate::config::{Ends, PaperConfig, Rail, RigFriction};
use crate::rig::effects::{Drive, DryFriction, Effects, ElasticString, JointForces};
use crate::rig::plant::{self, Mechanism, Plant};
use crate::rig::truth::{self, State};
use crate::rig::{Run, arriving, stream};

/// Which friction the rig has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Friction {
    /// That of Table 2, a little larger one way than the other.
    #[default]
    Mild,
    /// Strong drag with the square of the speed, and Coulomb friction that is much larger one way than the other.
    Strong,
}

/// The virtual rig of the paper's experiment.
///
/// Every part of it is in its settings and can be changed: `delay = 0.0`, `string = None`, `rail = None`, the noise of the sensors.
///
/// ```no_run
/// use cartpole::paper::{Friction, PaperRig};
///
/// let mut rig = PaperRig::read("models/cartpole/paper.toml".as_ref())?.with_friction(Friction::Strong);
/// rig.settings.string = None;
/// let recording = rig.record(1000, 1)?;
/// assert_eq!(recording.log.len(), 1000);
/// # Ok::<(), cartpole::paper::Error>(())
/// ```
#[derive(Clone)]
pub struct PaperRig {
    /// Everything that it is made of.
    pub settings: PaperConfig,
    /// Which of the two frictions it has.
    pub friction: Friction,
    pub(super) plant: Mechanism,
}

/// Where a motion begins.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Start {
    /// x, m, and φ, rad; ẋ, m/s, and φ̇, rad/s.
    pub state: State,
    /// The motor's place, m, and speed, m/s, on a rig with a string. Without them it moves with the cart, as fast and accelerated alike.
    pub motor: Option<(f64, f64)>,
}

impl PaperRig {
    /// The rig with mild friction of a settings file.
    ///
    /// # Errors
    /// [`Error::Config`] for faulty settings, [`Error::Rig`] for a mechanism that is no cart-pole.
    pub fn read(path: &Path) -> Result<Self, Error> {
        Self::new(PaperConfig::read(path)?)
    }

    /// The rig with mild friction.
    ///
    /// # Errors
    /// [`Error::Rig`] for a mechanism that is no cart-pole.
    pub fn new(settings: PaperConfig) -> Result<Self, Error> {
        Ok(PaperRig {
            plant: plant::read(&settings.urdf)?,
            settings,
            friction: Friction::Mild,
        })
    }

    /// With the other friction.
    #[must_use]
    pub fn with_friction(mut self, friction: Friction) -> Self {
        self.friction = friction;
        self
    }

    /// The step of the log and of the held input, s.
    pub fn interval(&self) -> f64 {
        1.0 / self.settings.rate
    }

    /// How many inputs before the present one still matter: those of the last delay.
    pub fn past(&self) -> usize {
        (self.settings.delay * self.settings.rate * (1.0 - 1e-9)).ceil() as usize
    }

    /// A recording of `samples` rows, from the pole hanging at rest on. The same seed gives the same bits.
    ///
    /// # Errors
    /// [`Error::Setting`] for settings that have been changed to what no rig has, [`Error::Rig`] where the motion has no solution.
    pub fn record(&self, samples: usize, seed: u64) -> Result<Recording, Error> {
        let effects = self.effects()?;
        let run = Run {
            effects,
            noise: &self.settings.sensors,
            rate: self.settings.rate,
            truth_step: self.settings.truth_step,
            // The mean force in the last row needs the state after it.
            rows: samples + 1,
            sampling: None,
            seed,
        };
        let mut operator = self.settings.operator;
        operator.centre -= self.middle();
        let mut hand = Hand::new(
            run.operator(operator),
            self.settings.swing,
            operator.mass,
            run.random(stream::SWING),
        );
        let mut truth = Truth::default();
        let mut moves = 0;
        let mut log = run.record(self.plant.clone(), |rig, _| {
            let (state, (motor, speed)) = (rig.state(), rig.motor());
            truth.states.push(self.shifted(state, self.middle()));
            truth.motor.push((motor + self.middle(), speed));
            moves = hand.moves();
            hand.command(state, self.felt_friction(state.v[0]))
        })?;
        let mut plant = self.plant.clone();
        for k in 0..samples {
            let force = self.arriving(&log.u[..=k]).0;
            let (state, motor) = (truth.states[k], truth.motor[k]);
            truth
                .force
                .push(force_on_cart(&mut plant, &effects, state, motor, force));
            let next = momentum(&mut plant, truth.states[k + 1]);
            let gained = next - momentum(&mut plant, state);
            truth.mean_force.push(gained * self.settings.rate);
        }
        let [x, phi] = &mut log.q;
        let [x_dot, phi_dot] = &mut log.v;
        for column in [&mut log.t, x, phi, x_dot, phi_dot, &mut log.u] {
            column.truncate(samples);
        }
        log.blows.retain(|t| *t <= samples as f64 * self.interval());
        truth.states.truncate(samples);
        truth.motor.truncate(samples);
        Ok(Recording { log, truth, moves })
    }

    /// The true motion from `start` on under the held `inputs`, N: the state at the start and at the end of each interval.
    ///
    /// Everything that makes a recording but sensors and disturbance is in it. `past` are the inputs of the intervals before, the last one last; of them
    /// the last [`past`](Self::past) matter, and those that are not given are taken for 0. A cart beyond an end of its rail starts at
    /// that end, with its motor.
    ///
    /// # Errors
    /// As [`record`](Self::record).
    pub fn true_run(
        &self,
        start: &Start,
        past: &[f64],
        inputs: &[f64],
    ) -> Result<Vec<State>, Error> {
        let effects = self.effects()?;
        let mut u = past[past.len().saturating_sub(self.past())..].to_vec();
        let mut state = self.shifted(start.state, -self.middle());
        let mut motor = start
            .motor
            .map(|(place, speed)| (place - self.middle(), speed));
        if let Some(rail) = effects.rail {
            let inside = state.q[0].clamp(-rail.limit, rail.limit);
            if let Some((place, _)) = &mut motor {
                *place += inside - state.q[0];
            }
            state.q[0] = inside;
        }
        let mut states = vec![self.shifted(state, self.middle())];
        let mut rig: Option<truth::Truth<Mechanism>> = None;
        for &input in inputs {
            u.push(input);
            let (early, switch, after) = self.arriving(&u);
            let rig = rig.get_or_insert_with(|| {
                let mut plant = self.plant.clone();
                let (place, speed) =
                    motor.unwrap_or_else(|| in_step(&mut plant, &effects, state, early));
                truth::Truth::new(plant, effects, self.settings.truth_step, state)
                    .with_motor(place, speed)
            });
            rig.advance(early, switch)?;
            rig.advance(after, self.interval() - switch)?;
            states.push(self.shifted(rig.state(), self.middle()));
        }
        Ok(states)
    }

    /// See [`arriving`]; where nothing is held back over the begin of the interval the first force is that of the interval.
    fn arriving(&self, u: &[f64]) -> (f64, f64, f64) {
        let drive = self.drive();
        let (early, switch, after) = arriving(&drive, u, self.interval());
        let first = if switch > 0.0 { early } else { after };
        (first, switch, after)
    }

    /// The middle of the rail, m: the place of the rig's 0.
    pub(super) fn middle(&self) -> f64 {
        self.settings
            .rail
            .map_or(0.0, |Ends { left, right, .. }| 0.5 * (left + right))
    }

    pub(super) fn shifted(&self, mut state: State, by: f64) -> State {
        state.q[0] += by;
        state
    }

    fn drive(&self) -> Drive {
        Drive {
            delay: self.settings.delay,
            ..Drive::default()
        }
    }

    fn law(&self) -> &RigFriction {
        match self.friction {
            Friction::Mild => &self.settings.friction.mild,
            Friction::Strong => &self.settings.friction.strong,
        }
    }

    /// What acts on the rig, places from the middle of its rail.
    pub(super) fn effects(&self) -> Result<Effects, Error> {
        if let Some((key, message)) = self.settings.faults().into_iter().next() {
            return Err(Error::Setting { key, message });
        }
        let law = self.law();
        let [against_positive, against_negative] = law.coulomb;
        let slider = JointForces {
            quadratic: law.quadratic,
            dry: DryFriction {
                against_positive,
                against_negative,
                ..DryFriction::default()
            },
            ..JointForces::default()
        };
        let pole = JointForces {
            viscous: [law.pole_viscous; 2],
            ..JointForces::default()
        };
        let mut effects = Effects {
            joints: [slider, pole],
            drive: self.drive(),
            string: self.settings.string.map(|string| ElasticString {
                stiffness: string.stiffness,
                damping: string.damping,
                motor_inertia: string.motor_inertia,
                hardening: 0.0,
                free_play: 0.0,
            }),
            rail: self.settings.rail.map(|ends| Rail {
                limit: 0.5 * (ends.right - ends.left),
                restitution: ends.restitution,
            }),
            ..Effects::default()
        };
        effects.sensors.offset[0] = self.middle();
        Ok(effects)
    }

    /// The friction of the cart that the hand feels at its speed, N.
    fn felt_friction(&self, speed: f64) -> f64 {
        let law = self.law();
        let direction = (speed / self.settings.swing.feel_speed).tanh();
        let coulomb = law.coulomb[usize::from(speed < 0.0)];
        -coulomb * direction - law.quadratic * speed.abs() * speed
    }
}

/// p = (M v)₁, kg·m/s.
fn momentum(plant: &mut Mechanism, State { q, v }: State) -> f64 {
    let ([[cart, coupling], _], _) = plant.mass_and_bias(q, v);
    cart * v[0] + coupling * v[1]
}

/// Q₁ under the motor's force, N. Where the cart is at rest friction takes what holds it, as far as it goes: then ẍ = 0 and
/// φ̈ = (Q₂ − b₂)/M₂₂ with b = C v + G, so that Q₁ = M₁₂ φ̈ + b₁.
fn force_on_cart(
    plant: &mut Mechanism,
    effects: &Effects,
    state: State,
    (motor, speed): (f64, f64),
    arriving: f64,
) -> f64 {
    let State { q, v } = state;
    let [slider, pole] = &effects.joints;
    let pull = match effects.string {
        Some(string) => string.pull(motor - q[0], speed - v[0]),
        None => arriving,
    };
    let without_dry = pull + slider.smooth(q[0], v[0]);
    let dry = |direction| slider.dry.size(direction, v[0].abs());
    let (forwards, backwards) = (dry(Direction::Positive), dry(Direction::Negative));
    if v[0] > 0.0 {
        return without_dry - forwards;
    }
    if v[0] < 0.0 {
        return without_dry + backwards;
    }
    let ([[_, coupling], [_, inertia]], [b_cart, b_pole]) = plant.mass_and_bias(q, v);
    let pole_force = pole.smooth(q[1], v[1]);
    let holding = coupling * (pole_force - b_pole) / inertia + b_cart;
    holding.clamp(without_dry - forwards, without_dry + backwards)
}

/// Where the motor is that moves with the cart, as fast and accelerated alike: with e = z − x, J a = f − k e and a = a₀ + m k e, where
/// a₀ is the cart's acceleration without the string's pull and m that by a pull of 1 N, e = (f − J a₀)/(k (1 + J m)).
fn in_step(plant: &mut Mechanism, effects: &Effects, state: State, arriving: f64) -> (f64, f64) {
    let State { q, v } = state;
    let Some(string) = effects.string.filter(|string| string.stiffness > 0.0) else {
        return (q[0], v[0]);
    };
    let (mass, bias) = plant.mass_and_bias(q, v);
    let determinant = mass[0][0] * mass[1][1] - mass[0][1] * mass[1][0];
    let at_cart = (q[0], v[0]);
    let force = [
        force_on_cart(plant, effects, state, at_cart, arriving) - bias[0],
        effects.joints[1].smooth(q[1], v[1]) - bias[1],
    ];
    let without = (mass[1][1] * force[0] - mass[0][1] * force[1]) / determinant;
    let by_pull = mass[1][1] / determinant;
    let inertia = string.motor_inertia;
    let stretch = (arriving - inertia * without) / (string.stiffness * (1.0 + inertia * by_pull));
    (q[0] + stretch, v[0])
}
