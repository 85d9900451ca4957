//! What acts on the rig's joints beside M, C and G: the rig's own formulas, written for simulating the truth and for nothing else.

use std::f64::consts::TAU;

use integrators::event::Direction;

use crate::config::Rail;

/// The forces on one joint: smooth ones, and dry friction, which is set-valued at rest.
///
/// F, v, q in N, m/s, m or N·m, rad/s, rad.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct JointForces {
    /// c₊ in Q = −c₊ v for v > 0, c₋ in Q = −c₋ v for v < 0.
    pub viscous: [f64; 2],
    /// d in Q = −d |v| v.
    pub quadratic: f64,
    /// Another law of that drag.
    pub power: Option<Power>,
    /// k in Q = −k (q − rest).
    pub spring: f64,
    /// Where the spring pulls to.
    pub rest: f64,
    /// Within ± this of its rest the spring does not pull; its force begins at 0 there.
    pub free_play: f64,
    /// k₃ in Q = −k₃ q³.
    pub cubic: f64,
    /// F in Q = F.
    pub constant: f64,
    /// A force that repeats along the way.
    pub ripple: Option<Ripple>,
    /// Dry friction.
    pub dry: DryFriction,
}

impl JointForces {
    /// The smooth part of Q at (q, v).
    pub fn smooth(&self, q: f64, v: f64) -> f64 {
        let [forwards, backwards] = self.viscous;
        let viscous = if v > 0.0 { forwards } else { backwards };
        let mut stretch = q - self.rest;
        if self.free_play > 0.0 {
            stretch -= stretch.clamp(-self.free_play, self.free_play);
        }
        let drag = match self.power {
            None => self.quadratic * v.abs(),
            Some(power) => power.drag(self.quadratic, v.abs()),
        };
        let smooth =
            self.constant - self.spring * stretch - self.cubic * q.powi(3) - (viscous + drag) * v;
        match self.ripple {
            None => smooth,
            Some(ripple) => {
                let angle = TAU * q / ripple.period + ripple.phase;
                let first = smooth + ripple.amplitude * angle.sin();
                if ripple.second == 0.0 {
                    first
                } else {
                    first + ripple.second * ripple.amplitude * (2.0 * angle).sin()
                }
            }
        }
    }
}

/// Drag by a power of the speed: Q = −d v₀² (|v|/v₀)ⁿ sgn v, which is that of the square at the speed v₀.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Power {
    /// n, above 1.
    pub exponent: f64,
    /// v₀.
    pub speed: f64,
}

impl Power {
    /// The force over the velocity, d v₀ (|v|/v₀)ⁿ⁻¹.
    fn drag(self, coefficient: f64, speed: f64) -> f64 {
        coefficient * self.speed * (speed / self.speed).powf(self.exponent - 1.0)
    }
}

/// Q = A [sin θ + s sin 2θ], θ = 2π q/λ + φ; with s = 0 it has the potential A λ/2π cos(2π q/λ + φ).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ripple {
    /// A.
    pub amplitude: f64,
    /// λ.
    pub period: f64,
    /// φ, rad.
    pub phase: f64,
    /// s, the second harmonic's share.
    pub second: f64,
}

/// Dry friction: opposes motion with a force of its own size for each direction, raised at low speed; at rest it takes any value
/// between the two breakaway forces.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct DryFriction {
    /// Size of the force against v > 0.
    pub against_positive: f64,
    /// Size of the force against v < 0.
    pub against_negative: f64,
    /// What rest adds to either: F_s − F_c.
    pub stribeck: f64,
    /// v_s in exp(−(v/v_s)²); taken for ∞ where there is no Stribeck force.
    pub stribeck_velocity: f64,
    /// n in exp(−(|v|/v_s)ⁿ) where it is not 2.
    pub stribeck_exponent: Option<f64>,
    /// s: either force is larger by s q; where that makes it negative there is none.
    pub slope: f64,
    /// L in s L tanh(q/L) in place of s q.
    pub slope_reach: Option<f64>,
    /// μ: either force is larger by μ |f|, f the motor's force.
    pub load: f64,
}

impl DryFriction {
    /// Whether there is none.
    pub fn is_none(&self) -> bool {
        let Self {
            against_positive,
            against_negative,
            stribeck,
            slope,
            load,
            ..
        } = *self;
        [against_positive, against_negative, stribeck, slope, load] == [0.0; 5]
    }

    /// The size of Q at the place q under the motor's force f; see [`size`](Self::size).
    pub fn size_at(&self, direction: Direction, speed: f64, q: f64, f: f64) -> f64 {
        let size = self.size(direction, speed);
        if self.slope == 0.0 && self.load == 0.0 {
            return size;
        }
        let q = self
            .slope_reach
            .map_or(q, |reach| reach * (q / reach).tanh());
        (size + self.slope * q).max(0.0) + self.load * f.abs()
    }

    /// The size of Q on a body that slides in the given direction with the speed |v|, in the middle of its way and without load; at
    /// speed 0, what rest holds.
    pub fn size(&self, direction: Direction, speed: f64) -> f64 {
        let hump = if self.stribeck == 0.0 {
            0.0
        } else {
            let ratio = speed / self.stribeck_velocity;
            let power = match self.stribeck_exponent {
                None => ratio.powi(2),
                // A trial step past rest asks below 0.
                Some(exponent) => ratio.max(0.0).powf(exponent),
            };
            self.stribeck * (-power).exp()
        };
        match direction {
            Direction::Positive => self.against_positive + hump,
            Direction::Negative => self.against_negative + hump,
        }
    }
}

/// Bristles between cart and rail, which bend before they slip: Q = −(σ₀ z + σ₁ ż), ż = v − σ₀ z |v|/g(v), g the size of the friction
/// when they slip steadily. With σ₁ = 0 and g constant it is Dahl's friction, else that of Canudas de Wit et al. (LuGre).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bristles {
    /// σ₀, N/m.
    pub stiffness: f64,
    /// σ₁, N·s/m.
    pub damping: f64,
    /// g, the same in both directions; above 0.
    pub slip: DryFriction,
}

impl Bristles {
    /// ż and Q at the deflection z.
    pub fn bend(&self, z: f64, v: f64) -> (f64, f64) {
        let slip = self.slip.size(Direction::Positive, v.abs());
        let rate = v - self.stiffness * z * v.abs() / slip;
        (rate, -(self.stiffness * z + self.damping * rate))
    }
}

/// A spring between the cart and a block on the rail that holds up to k w and slides under that: Q = −k e with the stretch e = x − y
/// within ± w, y the place of the block, which has no mass.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SlippingSpring {
    /// k, N/m.
    pub stiffness: f64,
    /// w, m.
    pub width: f64,
}

impl SlippingSpring {
    /// Q with the cart at x that has come from where the block was at y, without turning around while the block slid.
    pub fn force(&self, x: f64, y: f64) -> f64 {
        -self.stiffness * (x - y).clamp(-self.width, self.width)
    }

    /// Where the block is then.
    pub fn drag(&self, x: f64, y: f64) -> f64 {
        y.clamp(x - self.width, x + self.width)
    }
}

/// The way of the input to the motor: what is asked for at t − delay, times 1 + gain, without its dead zone, clipped, offset, and
/// then late by a lag.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Drive {
    /// Relative error of the gain.
    pub gain: f64,
    /// Delay, s, at least 0.
    pub delay: f64,
    /// Half width of the dead zone, N.
    pub dead_zone: f64,
    /// Share of the input that comes through within the dead zone.
    pub leak: f64,
    /// Largest force, N.
    pub limit: Option<f64>,
    /// Whether the force bends towards the limit, L tanh(u/L), in place of being clipped at it.
    pub soft: bool,
    /// N.
    pub offset: f64,
    /// T in T ḟ = (what arrives) − f, s; f = 0 at the start.
    pub lag: Option<f64>,
    /// T₂ in T₂ ġ = f − g, s, of a second lag behind the first; then g is the force. Only with a first one.
    pub second_lag: Option<f64>,
}

impl Drive {
    /// The force that arrives, N, but for delay and lag, where u is asked for.
    pub fn force(&self, u: f64) -> f64 {
        let mut force = (1.0 + self.gain) * u;
        if self.dead_zone > 0.0 {
            force -= (1.0 - self.leak) * force.clamp(-self.dead_zone, self.dead_zone);
        }
        if let Some(limit) = self.limit {
            force = if self.soft {
                limit * (force / limit).tanh()
            } else {
                force.clamp(-limit, limit)
            };
        }
        if self.offset == 0.0 {
            force
        } else {
            force + self.offset
        }
    }
}

/// An elastic string between the motor and the cart: J z̈ = f − T, and the same T = k e + k₃ e³ + c (ż − ẋ) on the cart, with the
/// stretch e = z − x beyond the free play; within it the string is slack, T = 0. J is not a part of the mass that slides.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ElasticString {
    /// k, N/m.
    pub stiffness: f64,
    /// c, N·s/m.
    pub damping: f64,
    /// J, kg.
    pub motor_inertia: f64,
    /// k₃, N/m³.
    pub hardening: f64,
    /// Way of the motor in which the string is slack, m.
    pub free_play: f64,
}

impl ElasticString {
    /// T at z − x and ż − ẋ.
    pub fn pull(&self, apart: f64, rate: f64) -> f64 {
        let half = 0.5 * self.free_play;
        let stretch = if half > 0.0 {
            apart - apart.clamp(-half, half)
        } else {
            apart
        };
        if half > 0.0 && stretch == 0.0 {
            return 0.0;
        }
        let pull = self.stiffness * stretch + self.damping * rate;
        if self.hardening == 0.0 {
            pull
        } else {
            pull + self.hardening * stretch.powi(3)
        }
    }
}

/// g, m/s².
const GRAVITY: f64 = 9.81;

/// What is there beside the masses of M, C and G.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Mechanics {
    /// Point mass on the cart, kg.
    pub on_cart: f64,
    /// Point mass on the pole, kg.
    pub on_pole: f64,
    /// Where that is, m from the pivot.
    pub arm: f64,
    /// Beside the inertia of each coordinate, kg and kg·m².
    pub inertia: [f64; 2],
    /// α, by which the rail rises towards +x, rad.
    pub tilt: f64,
}

impl Mechanics {
    /// Changes M and b = C v + G at (φ, φ̇); `moment` is the first moment of the pole about its pivot, kg·m.
    ///
    /// A mass m at the distance l from the pivot adds m, m l cos φ and m l² to M, −m l sin φ φ̇² to the cart's b and −m g l sin φ to the
    /// pole's. On a slope gravity pulls along the rail with g sin α, across it with g cos α.
    pub fn change(
        &self,
        (phi, rate): (f64, f64),
        moment: f64,
        mass: &mut [[f64; 2]; 2],
        bias: &mut [f64; 2],
    ) {
        let (sin, cos) = phi.sin_cos();
        let first = self.on_pole * self.arm;
        mass[0][0] += self.on_cart + self.on_pole;
        mass[0][1] += first * cos;
        mass[1][0] += first * cos;
        mass[1][1] += first * self.arm;
        bias[0] -= first * sin * rate * rate;
        bias[1] -= first * GRAVITY * sin;
        let (along, across) = self.tilt.sin_cos();
        let moment = moment + first;
        bias[0] += GRAVITY * along * mass[0][0];
        bias[1] += GRAVITY * moment * (along * cos + (1.0 - across) * sin);
        for (i, inertia) in self.inertia.iter().enumerate() {
            mass[i][i] += inertia;
        }
    }
}

/// What is wrong with the two position sensors, beside noise: at t they read (1 + scale) q(t − delay) + offset.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SensorFaults {
    /// m, rad.
    pub offset: [f64; 2],
    /// Share of the reading.
    pub scale: [f64; 2],
    /// s, at least 0.
    pub delay: [f64; 2],
}

impl SensorFaults {
    /// The readings, without noise, where q(t − delay) is given.
    pub fn read(&self, q: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|i| (1.0 + self.scale[i]) * q[i] + self.offset[i])
    }
}

/// A gap between the motor and the cart: |z − x| ≤ gap/2 for the motor's place z and the cart's x, m. The motor's inertia is a part
/// of the mass that slides in the model, so that with a gap of 0 the rig is that of the model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Backlash {
    /// m.
    pub gap: f64,
    /// e of the blows on the flanks.
    pub restitution: f64,
    /// kg.
    pub motor_inertia: f64,
}

/// Everything that acts on the rig.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Effects {
    /// On `slider` and `pole`.
    pub joints: [JointForces; 2],
    /// From the logged input to the cart.
    pub drive: Drive,
    /// Between the motor, on which the input then acts, and the cart.
    pub backlash: Option<Backlash>,
    /// Between the motor, on which the input then acts, and the cart.
    pub string: Option<ElasticString>,
    /// Between cart and rail.
    pub bristles: Option<Bristles>,
    /// Between cart and rail.
    pub slipping_spring: Option<SlippingSpring>,
    /// What the masses are not.
    pub mechanics: Mechanics,
    /// Of the position sensors.
    pub sensors: SensorFaults,
    /// The ends of the rail, where it has some.
    pub rail: Option<Rail>,
}
