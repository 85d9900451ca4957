use std::fmt;
use std::ops::Deref;

use integrators::{Differentiable, Gradient, Jacobian, Mechanical, PhaseSpace, System};
use lagrange::{Error, Mechanics, state};
use nalgebra::DMatrix;

use super::{Memory, Motion, Positions};

/// Configurations that are looked at for what holds everywhere.
const SAMPLES: usize = 5;

/// The [`Motion`] of a mechanism without constraints and with T = ½ vᵀ M(q) v: it has momenta, and methods that keep what they keep
/// ([`integrators::Variational`], [`integrators::StormerVerlet`]) step it.
#[derive(Clone)]
pub struct FreeMotion<M> {
    motion: Motion<M>,
    not_separable: Option<String>,
}

impl<M> fmt::Debug for FreeMotion<M> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("FreeMotion")
            .field("motion", &self.motion)
            .field("not_separable", &self.not_separable)
            .finish()
    }
}

/// Why a mechanism has no momenta that a [`FreeMotion`] could step.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum NotFree {
    /// Its coordinates obey equations.
    #[error(
        "the mechanism obeys {count} constraints (`{first}` …): symplectic and variational methods and steps with contacts are for free mechanisms only; take \
         an explicit method of Runge and Kutta, or coordinates that need no constraint"
    )]
    Constrained {
        /// How many are in force.
        count: usize,
        /// The first of them.
        first: String,
    },
    /// T is not ½ vᵀ M(q) v.
    #[error(
        "T is not quadratic in the velocities: at q = {q:?} twice the velocities give {twice:e} J, four times T is {four_times:e} J; \
         symplectic and variational methods and steps with contacts are for T = ½ vᵀ M(q) v; take an explicit method of Runge and Kutta"
    )]
    NotQuadratic {
        /// Where it was found.
        q: Vec<f64>,
        /// T(q, 2v), J.
        twice: f64,
        /// 4 T(q, v), J.
        four_times: f64,
    },
    /// Effects have states of their own, which the method does not follow.
    #[error("`{kind}` has states of its own, which this method does not follow: take rk4 or heun")]
    Memory {
        /// The kind of the first of them.
        kind: &'static str,
    },
}

/// Numbers in [0, 1), spread evenly.
fn spread() -> impl FnMut() -> f64 {
    let mut last = 0.5_f64;
    move || {
        last = (last + 0.618_033_988_749_894_9).fract();
        last
    }
}

/// That momenta M v are all there is to know.
pub(crate) fn check_free<M: Mechanics + ?Sized>(mechanics: &M, p: &[f64]) -> Result<(), NotFree> {
    if let Some(constraints) = mechanics.constraints() {
        let names = constraints.names();
        return Err(NotFree::Constrained {
            count: names.len(),
            first: names.first().cloned().unwrap_or_default(),
        });
    }
    let mut draw = spread();
    for _ in 0..SAMPLES {
        let q = state::random(mechanics.coordinates(), &mut draw);
        let v: Vec<f64> = (0..mechanics.nv()).map(|_| 2.0 * draw() - 1.0).collect();
        let double: Vec<f64> = v.iter().map(|v| 2.0 * v).collect();
        let twice = mechanics.kinetic_energy_with(&q, &double, p);
        let four_times = 4.0 * mechanics.kinetic_energy_with(&q, &v, p);
        // Where T is no number there, it says nothing.
        if (twice - four_times).abs() > 1e-10 * twice.abs().max(four_times.abs()) {
            return Err(NotFree::NotQuadratic {
                q,
                twice,
                four_times,
            });
        }
    }
    Ok(())
}

/// Why L is not T(v) − V(q), from M at a few configurations.
pub(crate) fn not_separable<M: Mechanics + ?Sized>(mechanics: &M, p: &[f64]) -> Option<String> {
    if let Some(pose) = mechanics.coordinates().iter().find(|c| c.floating) {
        return Some(format!(
            "`{}` floats, and the momenta of a turning body turn with it",
            pose.name
        ));
    }
    let n = mechanics.nv();
    let mut work = mechanics.workspace();
    let (mut first, mut mass) = (DMatrix::zeros(n, n), DMatrix::zeros(n, n));
    mechanics.mass_matrix_into(&mechanics.neutral(), p, &mut work, &mut first);
    let mut draw = spread();
    for _ in 0..SAMPLES {
        let q = state::random(mechanics.coordinates(), &mut draw);
        mechanics.mass_matrix_into(&q, p, &mut work, &mut mass);
        for j in 0..n {
            for i in j..n {
                let size = (first[(i, i)] * first[(j, j)]).sqrt();
                let apart = (mass[(i, j)] - first[(i, j)]).abs();
                if apart.is_nan() || apart > 1e-12 * size {
                    return Some(format!(
                        "M depends on q: its entry ({i}, {j}) is {} at 0 and {} at q = {q:?}",
                        first[(i, j)],
                        mass[(i, j)]
                    ));
                }
            }
        }
    }
    None
}

impl<M: Deref<Target: Mechanics> + Send + Sync> Motion<M> {
    /// The same as a mechanical system with momenta.
    ///
    /// That T is quadratic in v, and whether M depends on q, is looked up at a few configurations.
    ///
    /// # Errors
    /// [`NotFree`]: under constraints, and for T that is not quadratic in v.
    pub fn free(self) -> Result<FreeMotion<M>, NotFree> {
        check_free(self.mechanics(), self.constants())?;
        Ok(FreeMotion {
            not_separable: not_separable(self.mechanics(), self.constants()),
            motion: self,
        })
    }
}

impl<M> FreeMotion<M> {
    /// The motion without what momenta need.
    pub fn motion(&self) -> &Motion<M> {
        &self.motion
    }
}

impl<M: Deref<Target: Mechanics> + Send + Sync> System for FreeMotion<M> {
    type Space = PhaseSpace<Positions>;
    type Input = Vec<f64>;
    type Memory = Memory;
    type Error = Error;

    fn space(&self) -> &Self::Space {
        self.motion.space()
    }

    fn memory(&self) -> Memory {
        self.motion.memory()
    }

    fn rate(
        &self,
        t: f64,
        x: &[f64],
        u: &Vec<f64>,
        memory: &mut Memory,
        dx: &mut [f64],
    ) -> Result<(), Error> {
        self.motion.rate(t, x, u, memory, dx)
    }
}

impl<M: Deref<Target: Mechanics> + Send + Sync> Mechanical for FreeMotion<M> {
    type Positions = Positions;

    fn positions(&self) -> &Positions {
        &self.space().positions
    }

    fn acceleration(
        &self,
        _t: f64,
        (q, v): (&[f64], &[f64]),
        u: &Vec<f64>,
        memory: &mut Memory,
        out: &mut [f64],
    ) -> Result<(), Error> {
        self.motion.accelerate((q, v), u, memory, out)
    }

    fn momentum(
        &self,
        state: (&[f64], &[f64]),
        memory: &mut Memory,
        out: &mut [f64],
    ) -> Result<(), Error> {
        let (mechanics, p) = (self.motion.mechanics(), self.motion.constants());
        let Memory { momenta, work, .. } = memory;
        momenta.momentum(mechanics, state, p, work, out);
        Ok(())
    }

    fn velocity(&self, q: &[f64], memory: &mut Memory, out: &mut [f64]) -> Result<(), Error> {
        let (mechanics, p) = (self.motion.mechanics(), self.motion.constants());
        let Memory { momenta, work, .. } = memory;
        momenta.velocity(mechanics, q, p, work, out)
    }

    fn position_force(
        &self,
        _t: f64,
        state: (&[f64], &[f64]),
        u: &Vec<f64>,
        memory: &mut Memory,
        out: &mut [f64],
    ) -> Result<(), Error> {
        self.motion.check_force(u)?;
        let (mechanics, p) = (self.motion.mechanics(), self.motion.constants());
        let Memory { momenta, work, .. } = memory;
        out.copy_from_slice(u);
        momenta.position_force(mechanics, self.positions(), state, p, work, out);
        Ok(())
    }

    fn not_separable(&self) -> Option<String> {
        self.not_separable.clone()
    }
}

impl<M: Deref<Target: Mechanics> + Send + Sync> Differentiable for FreeMotion<M> {
    fn input_count(&self) -> usize {
        self.motion.input_count()
    }

    fn parameter_count(&self) -> usize {
        self.motion.parameter_count()
    }

    fn linearize(
        &self,
        at: (f64, &[f64], &Vec<f64>),
        memory: &mut Memory,
        dx: &mut [f64],
        by: &mut Jacobian,
    ) -> Result<(), Error> {
        self.motion.linearize(at, memory, dx, by)
    }

    fn pull_back(
        &self,
        at: (f64, &[f64], &Vec<f64>),
        memory: &mut Memory,
        weight: &[f64],
        dx: &mut [f64],
        by: &mut Gradient,
    ) -> Result<(), Error> {
        self.motion.pull_back(at, memory, weight, dx, by)
    }
}
