//! The mechanisms, their joints, sensors and controllers.

use std::f64::consts::TAU;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use lagrange::{Dynamics, Mechanics, urdf};
use nalgebra::DVector;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use super::motion::Motion;
use super::{Fault, Recording};
use crate::config::{NoiseLevel, Range};
use crate::rig::Error;
use crate::rig::effects::{Drive, DryFriction, JointForces};

/// Rows a second; the inputs are held in between.
const RATE: f64 = 50.0;
/// s.
pub(crate) const INTERVAL: f64 = 1.0 / RATE;
/// Longest step of the integrator, s.
const STEP: f64 = 1e-3;
/// Time in which the controller takes up its motion, s.
const RAMP: f64 = 2.0;
/// Speed over which the controller's idea of dry friction changes its sign, rad/s.
const SLOW: f64 = 0.05;
/// Sines a joint.
const SINES: usize = 5;

/// One joint of a mechanism, rad.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Joint {
    pub name: String,
    /// Known viscous friction, N·m·s/rad, and Coulomb friction, N·m: those of the URDF.
    pub viscous: f64,
    pub coulomb: f64,
    /// A force that matters on it, N·m.
    pub force: f64,
    /// A usual speed, rad/s.
    pub speed: f64,
    /// Middle of its motion and how far it goes to each side.
    pub centre: f64,
    pub range: f64,
}

impl Joint {
    /// What viscous friction may be, N·m·s/rad.
    pub fn viscous_size(&self) -> f64 {
        self.viscous.max(0.5 * self.force / self.speed)
    }
}

/// A motor.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Input {
    pub name: String,
    pub joint: usize,
}

/// Sensors: white noise, then the nearest count.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sensors {
    /// rad.
    pub noise: f64,
    /// Counts a turn.
    pub counts: f64,
}

/// A mechanism that is driven along sums of sines.
#[derive(Clone)]
pub struct Bench {
    pub(super) mechanics: Arc<dyn Mechanics>,
    pub(super) joints: Vec<Joint>,
    pub(super) inputs: Vec<Input>,
    sensors: [Sensors; 3],
    /// Of the controller's sines, Hz.
    frequencies: Range,
    /// Of the controller, 1/s.
    bandwidth: f64,
    /// Step of its torques, N·m.
    digit: f64,
    /// The model file; the URDF lies beside it.
    pub(super) model: PathBuf,
    pub(super) urdf: PathBuf,
}

impl std::fmt::Debug for Bench {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Bench")
            .field("model", &self.model)
            .field("joints", &self.joints)
            .field("inputs", &self.inputs)
            .finish_non_exhaustive()
    }
}

impl Bench {
    /// Furuta's pendulum: a motor turns the arm, the pendulum at its end swings freely about hanging. `models` has the folder
    /// `furuta_pendulum`.
    ///
    /// # Errors
    /// Where the URDF cannot be read or is another mechanism.
    pub fn furuta(models: &Path) -> Result<Self, Error> {
        let joint = |name: &str, viscous, force, speed, range| Joint {
            name: name.into(),
            viscous,
            coulomb: 0.0,
            force,
            speed,
            centre: 0.0,
            range,
        };
        Bench {
            mechanics: mechanics(&models.join("furuta_pendulum/furuta_pendulum.urdf"))?,
            joints: vec![
                joint("arm", 4e-4, 4e-3, 2.0, 0.8),
                joint("pendulum", 5e-5, 1.2e-3, 4.0, 0.8),
            ],
            inputs: vec![Input {
                name: "motor".into(),
                joint: 0,
            }],
            sensors: [(1e-4, 20_000.0), (3e-4, 8192.0), (1e-3, 2048.0)]
                .map(|(noise, counts)| Sensors { noise, counts }),
            frequencies: [0.2, 0.75],
            bandwidth: 8.0,
            digit: 1e-6,
            model: models.join("furuta_pendulum/furuta_pendulum.toml"),
            urdf: models.join("furuta_pendulum/furuta_pendulum.urdf"),
        }
        .checked()
    }

    /// The arm with seven joints, each with a motor. `models` has the folder `arm7`.
    ///
    /// # Errors
    /// Where the URDF cannot be read or is another mechanism.
    pub fn arm(models: &Path) -> Result<Self, Error> {
        // Viscous and Coulomb friction of the URDF, and the middle of the motion.
        let table = [
            (0.9, 1.1, 0.0),
            (0.9, 1.1, 0.6),
            (0.6, 0.7, 0.3),
            (0.6, 0.7, 1.2),
            (0.3, 0.4, 0.2),
            (0.3, 0.4, -0.5),
            (0.15, 0.2, 0.3),
        ];
        let joints = table
            .iter()
            .zip(1..)
            .map(|(&(viscous, coulomb, centre), k)| Joint {
                name: format!("j{k}"),
                viscous,
                coulomb,
                force: coulomb,
                speed: 0.8,
                centre,
                range: 0.4,
            })
            .collect();
        let inputs = (0..7)
            .map(|joint| Input {
                name: format!("motor{}", joint + 1),
                joint,
            })
            .collect();
        Bench {
            mechanics: mechanics(&models.join("arm7/arm7.urdf"))?,
            joints,
            inputs,
            sensors: [(2e-5, 1e6), (1e-4, 1e5), (5e-4, 2e4)]
                .map(|(noise, counts)| Sensors { noise, counts }),
            frequencies: [0.1, 0.8],
            bandwidth: 8.0,
            digit: 1e-4,
            model: models.join("arm7/arm7.toml"),
            urdf: models.join("arm7/arm7.urdf"),
        }
        .checked()
    }

    fn checked(self) -> Result<Self, Error> {
        let found: Vec<String> = self
            .mechanics
            .coordinates()
            .iter()
            .map(|c| c.name.clone())
            .collect();
        let expected: Vec<String> = self.joints.iter().map(|j| j.name.clone()).collect();
        if found == expected {
            return Ok(self);
        }
        Err(Error::OtherJoints {
            path: self.urdf,
            found,
            expected,
        })
    }

    /// Where the motion starts and about where it goes on, rad.
    pub fn centres(&self) -> Vec<f64> {
        self.joints.iter().map(|j| j.centre).collect()
    }

    /// An effect to hide: the kind by its index in [`super::KINDS`], taken modulo; target and sizes by the seed.
    ///
    /// # Errors
    /// Where the rig without a fault cannot run: its torques tell where a motor may saturate.
    pub fn draw(&self, kind: usize, seed: u64) -> Result<Fault, Error> {
        Fault::draw(self, kind, seed)
    }

    /// The inertia of a joint in the middle of the motion, the others held, kg·m².
    pub(super) fn inertia(&self, joint: usize) -> Result<f64, Error> {
        let at_rest = |source| Error::Mechanics { time: 0.0, source };
        let mass = self.mechanics.mass_matrix(&self.centres());
        Ok(mass.map_err(at_rest)?[(joint, joint)])
    }

    /// The torque of an input that it exceeds in a twentieth of a recording with this seed and without a fault, N·m.
    pub(super) fn large_input(&self, input: usize, seed: u64) -> Result<f64, Error> {
        let log = self.run(&[], NoiseLevel::Low, 20.0, seed)?;
        let mut sizes: Vec<f64> = log
            .u
            .iter()
            .filter_map(|row| row.get(input))
            .map(|u| u.abs())
            .collect();
        sizes.sort_by(f64::total_cmp);
        let index = sizes.len() * 19 / 20;
        Ok(sizes.get(index).copied().unwrap_or_default())
    }

    /// The name of what the fault sits on.
    pub fn target_name(&self, fault: &Fault) -> &str {
        match fault.is_of_the_drive() {
            true => self
                .inputs
                .get(fault.target)
                .map_or("", |i| i.name.as_str()),
            false => self
                .joints
                .get(fault.target)
                .map_or("", |j| j.name.as_str()),
        }
    }

    /// A recording of `duration` seconds with these faults. Same arguments, same bits.
    ///
    /// # Errors
    /// Where the equations of motion have no solution.
    pub fn run(
        &self,
        faults: &[Fault],
        noise: NoiseLevel,
        duration: f64,
        seed: u64,
    ) -> Result<Recording, Error> {
        let random = |stream| {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            rng.set_stream(stream);
            rng
        };
        let sensors = self.sensors[noise as usize];
        let controller = Controller::new(self, &mut random(1));
        let centres = self.centres();
        let still = vec![0.0; centres.len()];
        let (mut motion, drives) = self.motion(faults, (&centres, &still))?;
        let mut noise = random(2);
        let rows = (duration * RATE).round().max(1.0) as usize;
        let mut log = Recording::new(
            self.joints.iter().map(|j| j.name.clone()).collect(),
            self.inputs.iter().map(|i| i.name.clone()).collect(),
        );
        for k in 0..rows {
            let t = k as f64 * INTERVAL;
            let (q, v) = motion.state();
            let measured: Vec<f64> = q
                .iter()
                .map(|q| {
                    let noisy = q + sensors.noise * noise.sample::<f64, _>(StandardNormal);
                    (noisy / TAU * sensors.counts).round() * TAU / sensors.counts
                })
                .collect();
            let at = |source| Error::Mechanics { time: t, source };
            let u = controller.command(self, t, q, v).map_err(at)?;
            log.push(t, measured, (q, v), u);
            motion.advance(&drives, &log.u, INTERVAL, STEP)?;
        }
        Ok(log)
    }

    /// The true positions with these faults at the ends of the intervals over which the inputs were held, from the state (q, v) on. The inputs of
    /// the intervals before are `past`, the last one last; before them all were as in the first row. Motors move with their joints at the start.
    ///
    /// # Errors
    /// As [`run`](Self::run).
    pub fn true_run(
        &self,
        faults: &[Fault],
        start: (&[f64], &[f64]),
        past: &[Vec<f64>],
        inputs: &[Vec<f64>],
    ) -> Result<Vec<Vec<f64>>, Error> {
        let (mut motion, drives) = self.motion(faults, start)?;
        let mut u = past.to_vec();
        let mut places = Vec::with_capacity(inputs.len());
        for row in inputs {
            u.push(row.clone());
            motion.advance(&drives, &u, INTERVAL, STEP)?;
            places.push(motion.state().0.to_vec());
        }
        Ok(places)
    }

    /// The mechanism with these faults at (q, v), and its drives.
    fn motion(
        &self,
        faults: &[Fault],
        start: (&[f64], &[f64]),
    ) -> Result<(Motion, Vec<Drive>), Error> {
        let mut forces: Vec<JointForces> = self.joints.iter().map(known).collect();
        let mut drives = vec![Drive::default(); self.inputs.len()];
        for fault in faults {
            if fault.is_of_the_drive() {
                if let Some(drive) = drives.get_mut(fault.target) {
                    fault.on_drive(drive);
                }
            } else if let Some(joint) = forces.get_mut(fault.target) {
                fault.on_joint(joint);
            }
        }
        let mut strings = faults.iter();
        let string = strings.find_map(|fault| Some((fault.target, fault.string()?)));
        let motion = Motion::new(self, forces, (&drives, string), start)?;
        Ok((motion, drives))
    }
}

/// The known friction of a joint.
fn known(joint: &Joint) -> JointForces {
    JointForces {
        viscous: [joint.viscous; 2],
        dry: DryFriction {
            against_positive: joint.coulomb,
            against_negative: joint.coulomb,
            ..DryFriction::default()
        },
        ..JointForces::default()
    }
}

/// M, C and G of a URDF; friction in it is left out.
fn mechanics(path: &Path) -> Result<Arc<dyn Mechanics>, Error> {
    let text = std::fs::read_to_string(path).map_err(Error::io(path))?;
    let options = urdf::Options {
        source: path.display().to_string(),
        ..Default::default()
    };
    let tree = urdf::read(&text, &options).map_err(Error::Urdf)?.tree;
    let coordinates = tree.coordinates().to_vec();
    let at_rest = |source| Error::Mechanics { time: 0.0, source };
    Ok(Arc::new(Dynamics::new(tree, coordinates).map_err(at_rest)?))
}

/// u = M [q̈_ref + ω² (q_ref − q) + 2 ω (q̇_ref − q̇)] + C v + G + the known friction at q̇_ref, on the driven joints at the true state, q_ref a
/// sum of sines about the middle of the motion; the other joints hang as they like.
struct Controller {
    /// Amplitude (rad), rate (rad/s) and phase of each sine, by input.
    sines: Vec<[(f64, f64, f64); SINES]>,
    bandwidth: f64,
}

impl Controller {
    fn new(bench: &Bench, rng: &mut ChaCha8Rng) -> Self {
        let sines = bench.inputs.iter().map(|input| {
            let range = bench.joints.get(input.joint).map_or(0.0, |j| j.range);
            let [from, to] = bench.frequencies;
            let mut shares = [0.0; SINES].map(|_: f64| rng.random_range(0.4..=1.0));
            let sum: f64 = shares.iter().sum();
            shares.iter_mut().for_each(|s| *s *= 1.6 * range / sum);
            shares.map(|amplitude| {
                let rate = TAU * rng.random_range(from..=to);
                (amplitude, rate, rng.random_range(0.0..=TAU))
            })
        });
        Controller {
            sines: sines.collect(),
            bandwidth: bench.bandwidth,
        }
    }

    /// q_ref, q̇_ref and q̈_ref of an input's joint at time t, about 0; taken up slowly, as if the ramp stood still.
    fn reference(sines: &[(f64, f64, f64)], t: f64) -> [f64; 3] {
        let ramp = (t / RAMP).min(1.0);
        let ramp = ramp * ramp * (3.0 - 2.0 * ramp);
        let mut sum = [0.0; 3];
        for (amplitude, rate, phase) in sines {
            let (sin, cos) = (rate * t + phase).sin_cos();
            let a = ramp * amplitude;
            sum[0] += a * sin;
            sum[1] += a * rate * cos;
            sum[2] -= a * rate * rate * sin;
        }
        sum
    }

    /// The torques for the next interval, N·m, in steps.
    fn command(
        &self,
        bench: &Bench,
        t: f64,
        q: &[f64],
        v: &[f64],
    ) -> Result<Vec<f64>, lagrange::Error> {
        let mass = bench.mechanics.mass_matrix(q)?;
        let bias = bench.mechanics.bias_force(q, v)?;
        let w = self.bandwidth;
        let mut acceleration = DVector::zeros(q.len());
        let mut friction = vec![0.0; bench.inputs.len()];
        for ((input, sines), friction) in bench.inputs.iter().zip(&self.sines).zip(&mut friction) {
            let i = input.joint;
            let Some(joint) = bench.joints.get(i) else {
                continue;
            };
            let [place, rate, change] = Self::reference(sines, t);
            acceleration[i] =
                change + w * w * (joint.centre + place - q[i]) + 2.0 * w * (rate - v[i]);
            *friction = joint.viscous * rate + joint.coulomb * (rate / SLOW).tanh();
        }
        let torques = mass * acceleration + bias;
        let commands = bench.inputs.iter().zip(friction).map(|(input, friction)| {
            let steps = (torques[input.joint] + friction) / bench.digit;
            steps.round() * bench.digit
        });
        Ok(commands.collect())
    }
}
