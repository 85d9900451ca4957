//! Everything that sets a rig apart from its user's model: several effects at once, wrong masses, laws of another form than the
//! library's, and small disturbances of all sorts.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use serde::{Deserialize, Serialize};

use super::effects::{Effects, Power, Ripple};
use super::{CASES_ALL, Error, Hidden, Sampling, Target, draw_case, stream};
use crate::config::{Config, Known, Range};

/// What the rig is made of beside the model that its user has.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// The hidden effects, the main one first.
    pub hidden: Vec<Hidden>,
    /// How far the model's constants are off.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub base: Option<Base>,
    /// The hidden effects have these laws in place of the library's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub forms: Option<Forms>,
    /// Small disturbances.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dirt: Option<Dirt>,
    /// When rows are taken, if not evenly, and what is lost of them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sampling: Option<Sampling>,
}

/// Factors on what the user's model says.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Base {
    /// On mass and inertia of the cart, and of the pole with its tip.
    pub masses: [f64; 2],
    /// On the known Coulomb friction of the slider and the known viscous friction of the pole.
    pub friction: [f64; 2],
}

impl Base {
    /// Every factor 1 ± `share`, signs by a fair coin.
    pub fn draw(share: f64, seed: u64) -> Self {
        let mut rng = random(seed, 1);
        let mut factor = || match rng.random_bool(0.5) {
            true => 1.0 + share,
            false => 1.0 - share,
        };
        Base {
            masses: [factor(), factor()],
            friction: [factor(), factor()],
        }
    }
}

/// The cases of [`super::draw_of`] that have another form.
pub const FORM_CASES: [usize; 11] = [5, 6, 7, 8, 16, 18, 20, 21, 22, 23, 0];

/// Laws of another form than those of the library, each for the hidden effect of its kind.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Forms {
    /// n in exp(−(|v|/v_s)ⁿ) of Stribeck friction; the library has 2.
    pub stribeck_exponent: f64,
    /// n in |v|ⁿ of the drag; the library has 2. It is the hidden drag at 0.5 m/s and at 8 rad/s.
    pub drag_exponent: f64,
    /// Free play of a linear spring to each side, m.
    pub spring_play: f64,
    /// Share of the second harmonic of a periodic force.
    pub second_harmonic: f64,
    /// Way over which friction that grows along the rail stops growing, m.
    pub friction_reach: f64,
    /// Share of a lag that is a second lag in series; the rest is the first.
    pub second_lag: f64,
    /// Share of the input that a dead zone lets through.
    pub leak: f64,
    /// k₃/k of the string, 1/m².
    pub string_hardening: f64,
    /// Drag beside viscous friction, over its coefficient, s/m.
    pub drag_over_viscous: f64,
}

impl Forms {
    /// All of them drawn.
    pub fn draw(seed: u64) -> Self {
        let mut rng = random(seed, 2);
        let mut size = |[from, to]: Range| rng.random_range(from..=to);
        Forms {
            stribeck_exponent: size([0.7, 1.2]),
            drag_exponent: size([1.5, 1.75]),
            spring_play: size([0.01, 0.03]),
            second_harmonic: size([0.2, 0.5]),
            friction_reach: size([0.1, 0.2]),
            second_lag: size([0.3, 0.5]),
            leak: size([0.1, 0.3]),
            string_hardening: size([2e3, 2e4]),
            drag_over_viscous: size([0.4, 1.0]),
        }
    }

    fn shape(&self, hidden: &Hidden, effects: &mut Effects) {
        let pole = hidden.target() == Some(Target::Pole);
        let joint = &mut effects.joints[usize::from(pole)];
        match *hidden {
            Hidden::StribeckFriction { .. } => {
                joint.dry.stribeck_exponent = Some(self.stribeck_exponent);
            }
            Hidden::QuadraticDrag { .. } => {
                joint.power = Some(Power {
                    exponent: self.drag_exponent,
                    speed: if pole { 8.0 } else { 0.5 },
                });
            }
            Hidden::ViscousFriction { coefficient, .. } => {
                let per_speed = if pole { 0.5 / 8.0 } else { 1.0 };
                joint.quadratic += self.drag_over_viscous * coefficient * per_speed;
            }
            Hidden::LinearSpring { .. } => joint.free_play = self.spring_play,
            Hidden::PositionDependentFriction { .. } => {
                joint.dry.slope_reach = Some(self.friction_reach);
            }
            Hidden::PeriodicForce { .. } => {
                if let Some(ripple) = &mut joint.ripple {
                    ripple.second = self.second_harmonic;
                }
            }
            Hidden::ActuatorLag { time_constant, .. } => {
                effects.drive.lag = Some((1.0 - self.second_lag) * time_constant);
                effects.drive.second_lag = Some(self.second_lag * time_constant);
            }
            Hidden::InputDeadZone { .. } => effects.drive.leak = self.leak,
            Hidden::InputSaturation { .. } => effects.drive.soft = true,
            Hidden::ElasticTransmission { .. } => {
                if let Some(string) = &mut effects.string {
                    string.hardening = self.string_hardening * string.stiffness;
                }
            }
            _ => {}
        }
    }
}

/// Eleven small disturbances that no rig is without.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Dirt {
    /// Of the cart, as a factor on its mass.
    pub cart_mass: f64,
    /// Of the pole with its tip, as a factor on mass and inertia.
    pub pole_mass: f64,
    /// Of the encoder, rad.
    pub encoder_zero: f64,
    /// Force on the cart, N.
    pub bias: f64,
    /// Of the cart to the middle of its rail, N/m.
    pub spring: f64,
    /// Of the cart, N·s/m.
    pub viscous: f64,
    /// Of the input, as a share.
    pub gain: f64,
    /// Coulomb friction added one way and taken the other, N.
    pub asymmetry: f64,
    /// Amplitude of a force with the period of 4 cm, N.
    pub ripple: f64,
    /// Friction of rest above that of sliding, N.
    pub stribeck: f64,
    /// Of the input, s.
    pub delay: f64,
}

impl Dirt {
    /// Normal deviates, those that have a sign of their own by size.
    pub fn draw(seed: u64) -> Self {
        let mut rng = random(seed, 3);
        let mut normal = || rng.sample::<f64, _>(StandardNormal);
        Dirt {
            cart_mass: 1.0 + 0.007 / 0.466 * normal(),
            // 0.6 g at the tip, by the first moment about the pivot.
            pole_mass: 1.0 + 0.014 * normal(),
            encoder_zero: 3e-3 * normal(),
            bias: 8e-3 * normal(),
            spring: 0.05 * normal().abs(),
            viscous: 0.015 * normal().abs(),
            gain: 8e-3 * normal(),
            asymmetry: 6e-3 * normal(),
            ripple: 6e-3 * normal().abs(),
            stribeck: 15e-3 * normal().abs(),
            delay: 1.5e-3 * normal().abs(),
        }
    }

    fn spill(&self, effects: &mut Effects) {
        let slider = &mut effects.joints[0];
        slider.constant += self.bias;
        // Two springs in parallel pull to their common rest.
        let both = slider.spring + self.spring;
        if both > 0.0 {
            slider.rest *= slider.spring / both;
        }
        slider.spring = both;
        slider.viscous = slider.viscous.map(|c| c + self.viscous);
        if slider.ripple.is_none() {
            slider.ripple = Some(Ripple {
                amplitude: self.ripple,
                period: 0.04,
                phase: 0.0,
                second: 0.0,
            });
        }
        // Bristles stand in place of the dry friction: their slip takes the disturbance.
        match &mut effects.bristles {
            Some(bristles) => bristles.slip.against_positive += self.asymmetry.abs(),
            None => {
                let dry = &mut slider.dry;
                dry.against_positive = (dry.against_positive + self.asymmetry).max(0.0);
                dry.against_negative = (dry.against_negative - self.asymmetry).max(0.0);
                dry.stribeck += self.stribeck;
                if dry.stribeck_velocity == 0.0 {
                    dry.stribeck_velocity = 0.05;
                }
            }
        }
        effects.drive.gain += self.gain;
        effects.drive.delay += self.delay;
        effects.sensors.offset[1] += self.encoder_zero;
    }
}

impl Scene {
    /// One hidden effect, or none.
    pub fn of(hidden: &Hidden) -> Self {
        Scene {
            hidden: match hidden {
                Hidden::Nothing => Vec::new(),
                one => vec![*one],
            },
            ..Scene::default()
        }
    }

    /// What acts on the rig.
    ///
    /// # Errors
    /// [`Error::Effect`] for an effect that no rig has, [`Error::SamePlace`] for two that are one thing of the rig.
    pub fn effects(&self, known: &Known) -> Result<Effects, Error> {
        let mut known = *known;
        if let Some(base) = self.base {
            known.slider_coulomb_friction *= base.friction[0];
            known.pole_viscous_friction *= base.friction[1];
        }
        let mut effects = Effects::known(&known);
        for (k, hidden) in self.hidden.iter().enumerate() {
            for before in self.hidden.iter().take(k) {
                if hidden.excludes(before) {
                    return Err(Error::SamePlace {
                        first: before.in_short(),
                        second: hidden.in_short(),
                    });
                }
            }
            effects.add(hidden)?;
        }
        if let Some(forms) = self.forms {
            for hidden in &self.hidden {
                forms.shape(hidden, &mut effects);
            }
        }
        if let Some(dirt) = self.dirt {
            dirt.spill(&mut effects);
        }
        Ok(effects)
    }

    /// Factors on the masses of cart and pole, where they are not those of the model.
    pub fn masses(&self) -> Option<Vec<f64>> {
        if self.base.is_none() && self.dirt.is_none() {
            return None;
        }
        let mut masses = self.base.map_or([1.0; 2], |base| base.masses);
        if let Some(dirt) = self.dirt {
            masses[0] *= dirt.cart_mass;
            masses[1] *= dirt.pole_mass;
        }
        Some(masses.to_vec())
    }
}

/// Draws `count` different effects that can be on the rig at once and be told apart, the first as [`super::draw_any`] does.
pub fn draw_several(config: &Config, count: usize, seed: u64) -> Vec<Hidden> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(stream::DRAW);
    let mut drawn: Vec<Hidden> = Vec::new();
    while drawn.len() < count.min(4) {
        let case = rng.random_range(0..CASES_ALL);
        let next = draw_case(config, case, &mut rng);
        if !drawn
            .iter()
            .any(|d| d.excludes(&next) || d.is_twin_of(&next))
        {
            drawn.push(next);
        }
    }
    drawn
}

/// What Roehrl et al. suspect on their rig (section 5), at once: friction that depends on the direction, an elastic string, an elastic
/// guide (a spring that slips) and a late input. The clearance that they suspect too is in [`Hidden::Backlash`], for which an elastic
/// string leaves no place.
pub fn draw_suspects(config: &Config, seed: u64) -> Vec<Hidden> {
    let mut rng = random(seed, 4);
    // The cases of `draw_of`: asymmetric Coulomb friction, elastic transmission, hysteresis, input delay.
    [4, 23, 30, 12]
        .map(|case| draw_case(config, case, &mut rng))
        .to_vec()
}

/// The `part`th generator of what is drawn around the hidden effects.
pub(super) fn random(seed: u64, part: u64) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(stream::SCENE + 16 * part);
    rng
}
