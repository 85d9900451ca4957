//! The true motion of a mechanism of joints: M v̇ + C v + G = Q_smooth + Q_dry, with dry friction that is set-valued and really sticks.
//!
//! The force of a lagging motor is one number more, which the same steps follow: it stands where velocities do, as that of a body of
//! mass 1 that nothing else feels.

use std::convert::Infallible;
use std::sync::Arc;

use integrators::Flat;
use integrators::event::{At, ContactSystem, Direction, EventKind, EventStepper, Friction, Law};
use lagrange::{Mechanics, Workspace};
use nalgebra::{DMatrix, DVector};

use super::Bench;
use crate::rig::Error;
use crate::rig::effects::{Drive, DryFriction, ElasticString, JointForces};

/// The dry friction of one joint.
struct OfJoint {
    joint: usize,
    dry: DryFriction,
}

impl Friction for OfJoint {
    fn sliding(&self, direction: Direction, speed: f64, at: At<'_>) -> f64 {
        self.dry.size_at(direction, speed, at.q[self.joint], 0.0)
    }
}

/// A motor whose force lags: its coordinate, its joint and its time constant, s.
#[derive(Debug, Clone, Copy)]
struct Lag {
    coordinate: usize,
    joint: usize,
    time_constant: f64,
}

/// A motor that pulls its joint by a string: its coordinate and its joint.
#[derive(Debug, Clone, Copy)]
struct Rotor {
    coordinate: usize,
    joint: usize,
    string: ElasticString,
}

/// The mechanism without its dry friction. The inputs are what arrives at each joint, N·m; at a lagging motor's, what arrives there.
struct Smooth {
    positions: Flat,
    mechanics: Arc<dyn Mechanics>,
    constants: Vec<f64>,
    joints: Vec<JointForces>,
    lag: Option<Lag>,
    rotor: Option<Rotor>,
}

/// Scratch memory of one thread.
struct Memory {
    work: Workspace,
    mass: DMatrix<f64>,
    bias: DVector<f64>,
}

impl ContactSystem for Smooth {
    type Positions = Flat;
    type Input = [f64];
    type Memory = Memory;
    type Error = Infallible;

    fn positions(&self) -> &Flat {
        &self.positions
    }

    fn memory(&self) -> Memory {
        let n = self.joints.len();
        Memory {
            work: self.mechanics.workspace(),
            mass: DMatrix::zeros(n, n),
            bias: DVector::zeros(n),
        }
    }

    fn mass_and_force(
        &self,
        _t: f64,
        (q, v): (&[f64], &[f64]),
        arriving: &[f64],
        memory: &mut Memory,
        mass: &mut DMatrix<f64>,
        total: &mut [f64],
    ) -> Result<(), Infallible> {
        let n = self.joints.len();
        let (p, work) = (&self.constants, &mut memory.work);
        let (q_all, q, v_joints) = (q, &q[..n], &v[..n]);
        self.mechanics
            .mass_matrix_into(q, p, work, &mut memory.mass);
        self.mechanics
            .bias_force_into(q, v_joints, p, work, &mut memory.bias);
        mass.fill(0.0);
        mass.view_mut((0, 0), (n, n)).copy_from(&memory.mass);
        for i in 0..n {
            total[i] = arriving[i] - memory.bias[i] + self.joints[i].smooth(q[i], v[i]);
        }
        if let Some(lag) = self.lag {
            let Lag {
                coordinate: c,
                joint,
                time_constant,
            } = lag;
            total[joint] += v[c] - arriving[joint];
            mass[(c, c)] = 1.0;
            total[c] = (arriving[joint] - v[c]) / time_constant;
        }
        if let Some(rotor) = self.rotor {
            let Rotor {
                coordinate: c,
                joint,
                string,
            } = rotor;
            let pull = string.pull(q_all[c] - q[joint], v[c] - v[joint]);
            total[joint] += pull - arriving[joint];
            mass[(c, c)] = string.motor_inertia;
            total[c] = arriving[joint] - pull;
        }
        Ok(())
    }
}

/// A moving mechanism.
pub(super) struct Motion {
    smooth: Smooth,
    stepper: EventStepper<Smooth>,
    /// The joint of each input.
    driven: Vec<usize>,
    time: f64,
    /// q, then v.
    x: Vec<f64>,
}

impl Motion {
    /// At (q, v); the force of a lagging motor and the pull of a string, between the input with its index and its joint, are the weight that they
    /// hold there, and the motor of the string is as fast as its joint.
    pub fn new(
        bench: &Bench,
        joints: Vec<JointForces>,
        (drives, string): (&[Drive], Option<(usize, ElasticString)>),
        (start, rates): (&[f64], &[f64]),
    ) -> Result<Self, Error> {
        let n = joints.len();
        let lag = bench
            .inputs
            .iter()
            .zip(drives)
            .find_map(|(input, drive)| Some((input.joint, drive.lag?)))
            .map(|(joint, time_constant)| Lag {
                coordinate: n,
                joint,
                time_constant,
            });
        let rotor = string.and_then(|(input, string)| {
            Some(Rotor {
                coordinate: n + usize::from(lag.is_some()),
                joint: bench.inputs.get(input)?.joint,
                string,
            })
        });
        let coordinates = n + usize::from(lag.is_some()) + usize::from(rotor.is_some());
        let at_rest = |source| Error::Mechanics { time: 0.0, source };
        let weight = bench.mechanics.gravity_force(start).map_err(at_rest)?;
        let mut x = vec![0.0; 2 * coordinates];
        x[..n].copy_from_slice(start);
        x[coordinates..coordinates + n].copy_from_slice(rates);
        if let Some(lag) = lag {
            x[coordinates + lag.coordinate] = weight[lag.joint];
        }
        if let Some(rotor) = rotor {
            let stretch = weight[rotor.joint] / rotor.string.stiffness;
            x[rotor.coordinate] = start[rotor.joint] + stretch;
            x[coordinates + rotor.coordinate] = rates[rotor.joint];
        }
        let laws = joints
            .iter()
            .enumerate()
            .filter(|(_, forces)| !forces.dry.is_none())
            .map(|(joint, forces)| {
                let mut along = vec![0.0; coordinates];
                along[joint] = 1.0;
                let size = OfJoint {
                    joint,
                    dry: forces.dry,
                };
                Law::friction(&along, size)
            })
            .collect();
        let smooth = Smooth {
            positions: Flat::new(coordinates),
            constants: bench.mechanics.nominal(),
            mechanics: bench.mechanics.clone(),
            joints,
            lag,
            rotor,
        };
        let stepper = EventStepper::new(&smooth, laws).map_err(Error::Motion)?;
        Ok(Motion {
            smooth,
            stepper,
            driven: bench.inputs.iter().map(|i| i.joint).collect(),
            time: 0.0,
            x,
        })
    }

    /// q and v of the joints.
    pub fn state(&self) -> (&[f64], &[f64]) {
        let (q, v) = self.x.split_at(self.x.len() / 2);
        let n = self.smooth.joints.len();
        (&q[..n], &v[..n])
    }

    /// One interval of the log, of the inputs `u` so far, the last row for this interval; an input that is late switches within it.
    /// Before the first row every input was as in it.
    pub fn advance(
        &mut self,
        drives: &[Drive],
        u: &[Vec<f64>],
        interval: f64,
        step: f64,
    ) -> Result<(), Error> {
        let mut switches: Vec<f64> = drives
            .iter()
            .map(|drive| (drive.delay / interval).fract() * interval)
            .filter(|switch| *switch > 0.0)
            .collect();
        switches.sort_by(f64::total_cmp);
        switches.dedup();
        switches.push(interval);
        let mut from = 0.0;
        for until in switches {
            let mut arriving = vec![0.0; self.smooth.joints.len()];
            for (i, (drive, &joint)) in drives.iter().zip(&self.driven).enumerate() {
                // The row that arrives in the middle of this part.
                let back = (drive.delay - 0.5 * (from + until)) / interval;
                let rows = (back.ceil().max(0.0) as usize).min(u.len().saturating_sub(1));
                let row = u.get(u.len().saturating_sub(1 + rows));
                let asked = row.and_then(|row| row.get(i)).copied().unwrap_or(0.0);
                arriving[joint] += drive.force(asked);
            }
            self.hold(&arriving, until - from, step)?;
            from = until;
        }
        Ok(())
    }

    fn hold(&mut self, arriving: &[f64], duration: f64, step: f64) -> Result<(), Error> {
        // The small excess keeps 20 ms / 1 ms from becoming 21 steps.
        let steps = (duration / step * (1.0 - 1e-9)).ceil().max(1.0) as usize;
        self.stepper.clear_events();
        self.stepper
            .advance(
                &self.smooth,
                (self.time, duration, steps),
                arriving,
                &mut self.x,
            )
            .map_err(Error::Motion)?;
        let held = |kind: &EventKind| matches!(kind, EventKind::Held);
        if let Some(event) = self.stepper.events().iter().find(|e| held(&e.kind)) {
            return Err(Error::Chatter { time: event.time });
        }
        self.time += duration;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn furuta() -> Bench {
        let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models");
        Bench::furuta(&models).unwrap()
    }

    fn motion(bench: &Bench, drive: Drive) -> Motion {
        let free = vec![JointForces::default(); 2];
        Motion::new(bench, free, (&[drive], None), (&[0.0; 2], &[0.0; 2])).unwrap()
    }

    #[test]
    fn a_late_torque_moves_the_arm_as_an_early_one_after_the_delay() {
        let bench = furuta();
        let late = Drive {
            delay: 0.03,
            ..Drive::default()
        };
        // Nothing in the first row, 10 mN·m from the second one on: felt from 0.05 s on.
        let (mut delayed, mut rows) = (motion(&bench, late), Vec::new());
        for torque in [0.0, 0.01, 0.01, 0.01] {
            rows.push(vec![torque]);
            delayed.advance(&[late], &rows, 0.02, 1e-3).unwrap();
        }
        let mut early = motion(&bench, Drive::default());
        early
            .advance(&[Drive::default()], &[vec![0.01]], 0.03, 1e-3)
            .unwrap();
        let ((q, v), (q_early, v_early)) = (delayed.state(), early.state());
        assert!(q[0] > 1e-4);
        for (late, early) in q.iter().chain(v).zip(q_early.iter().chain(v_early)) {
            approx::assert_abs_diff_eq!(late, early, epsilon = 1e-12);
        }
    }

    #[test]
    fn a_lagging_motor_gives_the_arm_the_impulse_of_its_step_response() {
        let bench = furuta();
        let (lag, torque, t) = (0.02, 1e-4, 0.01_f64);
        let drive = Drive {
            lag: Some(lag),
            ..Drive::default()
        };
        let mut motion = motion(&bench, drive);
        motion.advance(&[drive], &[vec![torque]], t, 1e-4).unwrap();
        // The momentum of the arm's coordinate, as long as nothing has moved: M v = τ [t − T (1 − e^(−t/T))].
        let (q, v) = motion.state();
        let momentum = bench.mechanics.momentum(q, v).unwrap();
        let impulse = torque * (t - lag * (1.0 - (-t / lag).exp()));
        approx::assert_relative_eq!(momentum[0], impulse, max_relative = 1e-6);
    }

    #[test]
    fn a_motor_on_a_string_swings_against_the_arm_and_keeps_the_momentum() {
        let bench = furuta();
        let inertia = 5e-4;
        let string = ElasticString {
            stiffness: 2.0,
            damping: 0.0,
            motor_inertia: inertia,
            hardening: 0.0,
            free_play: 0.0,
        };
        let free = vec![JointForces::default(); 2];
        let drive = Drive::default();
        let start = (&[0.0; 2][..], &[0.0; 2][..]);
        let mut motion = Motion::new(&bench, free, (&[drive], Some((0, string))), start).unwrap();
        // A torque so small that the pendulum stays where it hangs: all of it is momentum about the vertical.
        let (torque, t) = (1e-6, 0.2);
        for _ in 0..10 {
            motion
                .advance(&[drive], &[vec![torque]], 0.02, 1e-4)
                .unwrap();
        }
        let (q, v) = motion.state();
        let (rotor, rate) = (motion.x[2], motion.x[5]);
        let momentum = bench.mechanics.momentum(q, v).unwrap()[0] + inertia * rate;
        approx::assert_relative_eq!(momentum, torque * t, max_relative = 1e-6);
        assert!((rotor - q[0]).abs() > 1e-8, "the string is stretched");
    }
}
