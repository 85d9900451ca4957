//! Explicit symplectic methods, for L = T(v) − V(q).

use super::{Method, StepError};
use crate::{Mechanical, Space};

/// The method needs L = T(v) − V(q) with forces that do not depend on v.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "{reason}: explicit symplectic methods need L = T(v) − V(q) and forces that do not depend on v; take `Variational`, which does not"
)]
pub struct NotSeparable {
    /// What stands against it.
    pub reason: String,
}

fn refuse<S: Mechanical>(system: &S) -> Result<(), NotSeparable> {
    match system.not_separable() {
        None => Ok(()),
        Some(reason) => Err(NotSeparable { reason }),
    }
}

/// q, v̇ and the next q of one step.
#[derive(Debug, Clone)]
struct Room {
    moved: Vec<f64>,
    acceleration: Vec<f64>,
    motion: Vec<f64>,
    velocity: Vec<f64>,
}

impl Room {
    fn of<S: Mechanical>(system: &S) -> Self {
        let (nq, nv) = (system.positions().dim(), system.positions().tangent_dim());
        Room {
            moved: vec![0.0; nq],
            acceleration: vec![0.0; nv],
            motion: vec![0.0; nv],
            velocity: vec![0.0; nv],
        }
    }

    /// velocity += factor · acceleration.
    fn kick(&mut self, factor: f64) {
        for (v, a) in self.velocity.iter_mut().zip(&self.acceleration) {
            *v += factor * a;
        }
    }

    /// moved = q ⊕ h · velocity.
    fn drift<S: Mechanical>(&mut self, system: &S, q: &[f64], h: f64) {
        for (d, v) in self.motion.iter_mut().zip(&self.velocity) {
            *d = h * v;
        }
        system
            .positions()
            .move_into(q, &self.motion, &mut self.moved);
    }
}

/// The symplectic Euler method, of order 1: v_{k+1} = v_k + h v̇(q_k), q_{k+1} = q_k ⊕ h v_{k+1}.
#[derive(Debug, Clone)]
pub struct SymplecticEuler {
    room: Room,
}

impl SymplecticEuler {
    /// For a separable system.
    ///
    /// # Errors
    /// [`NotSeparable`] with the reason.
    pub fn new<S: Mechanical>(system: &S) -> Result<Self, NotSeparable> {
        refuse(system)?;
        Ok(SymplecticEuler {
            room: Room::of(system),
        })
    }
}

impl<S: Mechanical> Method<S> for SymplecticEuler {
    fn step(
        &mut self,
        system: &S,
        t: f64,
        h: f64,
        u: &S::Input,
        memory: &mut S::Memory,
        x: &mut [f64],
    ) -> Result<(), StepError<S::Error>> {
        let room = &mut self.room;
        let (q, v) = x.split_at_mut(system.positions().dim());
        system
            .acceleration(t, (q, v), u, memory, &mut room.acceleration)
            .map_err(StepError::RightHandSide)?;
        room.velocity.copy_from_slice(v);
        room.kick(h);
        room.drift(system, q, h);
        q.copy_from_slice(&room.moved);
        v.copy_from_slice(&room.velocity);
        Ok(())
    }
}

/// The method of Störmer and Verlet, of order 2 and time-symmetric:
///
/// - v_{k+½} = v_k + h/2 v̇(t_k, q_k)
/// - q_{k+1} = q_k ⊕ h v_{k+½}
/// - v_{k+1} = v_{k+½} + h/2 v̇(t_{k+1}, q_{k+1})
///
/// (Hairer, Lubich, Wanner, "Geometric Numerical Integration", I.1.4.)
#[derive(Debug, Clone)]
pub struct StormerVerlet {
    room: Room,
}

impl StormerVerlet {
    /// For a separable system.
    ///
    /// # Errors
    /// [`NotSeparable`] with the reason.
    pub fn new<S: Mechanical>(system: &S) -> Result<Self, NotSeparable> {
        refuse(system)?;
        Ok(StormerVerlet {
            room: Room::of(system),
        })
    }
}

impl<S: Mechanical> Method<S> for StormerVerlet {
    fn step(
        &mut self,
        system: &S,
        t: f64,
        h: f64,
        u: &S::Input,
        memory: &mut S::Memory,
        x: &mut [f64],
    ) -> Result<(), StepError<S::Error>> {
        let room = &mut self.room;
        let (q, v) = x.split_at_mut(system.positions().dim());
        system
            .acceleration(t, (q, v), u, memory, &mut room.acceleration)
            .map_err(StepError::RightHandSide)?;
        room.velocity.copy_from_slice(v);
        room.kick(0.5 * h);
        room.drift(system, q, h);
        let at = (room.moved.as_slice(), room.velocity.as_slice());
        system
            .acceleration(t + h, at, u, memory, &mut room.acceleration)
            .map_err(StepError::RightHandSide)?;
        room.kick(0.5 * h);
        q.copy_from_slice(&room.moved);
        v.copy_from_slice(&room.velocity);
        Ok(())
    }
}
