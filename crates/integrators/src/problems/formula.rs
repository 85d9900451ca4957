//! What the problems share.

use nalgebra::DMatrix;

/// ẋ = f(t, x; p) as formulas: `DIM` directions of motion, `CONSTANTS` constants.
pub(super) trait Formula<const DIM: usize, const CONSTANTS: usize> {
    /// f.
    fn rate(&self, t: f64, x: &[f64]) -> [f64; DIM];
    /// ∂f/∂x along the directions of motion, row by row.
    fn by_state(&self, t: f64, x: &[f64]) -> [[f64; DIM]; DIM];
    /// ∂f/∂p, row by row.
    fn by_constants(&self, t: f64, x: &[f64]) -> [[f64; CONSTANTS]; DIM];
}

/// Writes rows to a matrix.
pub(super) fn set<const N: usize>(matrix: &mut DMatrix<f64>, rows: &[[f64; N]]) {
    for (i, row) in rows.iter().enumerate() {
        for (j, &entry) in row.iter().enumerate() {
            matrix[(i, j)] = entry;
        }
    }
}

/// `System` and `Differentiable` of a problem that has a [`Formula`].
macro_rules! system_of_formula {
    ($problem:ty, $dim:literal, $constants:literal, $space:ty = $value:expr) => {
        impl $crate::System for $problem {
            type Space = $space;
            type Input = ();
            type Memory = ();
            type Error = std::convert::Infallible;

            fn space(&self) -> &$space {
                const SPACE: $space = $value;
                &SPACE
            }

            fn memory(&self) {}

            fn rate(
                &self,
                t: f64,
                x: &[f64],
                _u: &(),
                _memory: &mut (),
                dx: &mut [f64],
            ) -> Result<(), std::convert::Infallible> {
                dx.copy_from_slice(&Formula::<$dim, $constants>::rate(self, t, x));
                Ok(())
            }
        }

        impl $crate::Differentiable for $problem {
            fn input_count(&self) -> usize {
                0
            }

            fn parameter_count(&self) -> usize {
                $constants
            }

            fn linearize(
                &self,
                (t, x, _u): (f64, &[f64], &()),
                _memory: &mut (),
                dx: &mut [f64],
                by: &mut $crate::Jacobian,
            ) -> Result<(), std::convert::Infallible> {
                dx.copy_from_slice(&Formula::<$dim, $constants>::rate(self, t, x));
                $crate::problems::formula::set(
                    &mut by.state,
                    &Formula::<$dim, $constants>::by_state(self, t, x),
                );
                $crate::problems::formula::set(
                    &mut by.parameters,
                    &Formula::<$dim, $constants>::by_constants(self, t, x),
                );
                Ok(())
            }

            fn pull_back(
                &self,
                (t, x, _u): (f64, &[f64], &()),
                _memory: &mut (),
                weight: &[f64],
                dx: &mut [f64],
                by: &mut $crate::Gradient,
            ) -> Result<(), std::convert::Infallible> {
                dx.copy_from_slice(&Formula::<$dim, $constants>::rate(self, t, x));
                let state = Formula::<$dim, $constants>::by_state(self, t, x);
                let constants = Formula::<$dim, $constants>::by_constants(self, t, x);
                for (w, (by_state, by_constants)) in weight.iter().zip(state.iter().zip(&constants))
                {
                    for (sum, d) in by.state.iter_mut().zip(by_state) {
                        *sum += w * d;
                    }
                    for (sum, d) in by.parameters.iter_mut().zip(by_constants) {
                        *sum += w * d;
                    }
                }
                Ok(())
            }
        }
    };
}

/// `Mechanical` of a problem with M = 1 in ℝⁿ: the second half of its rate is −∂V/∂q.
macro_rules! mechanical_of_unit_mass {
    ($problem:ty, $dim:literal, $constants:literal) => {
        impl $crate::Mechanical for $problem {
            type Positions = $crate::Flat;

            fn positions(&self) -> &$crate::Flat {
                const POSITIONS: $crate::Flat = $crate::Flat::new($dim / 2);
                &POSITIONS
            }

            fn acceleration(
                &self,
                t: f64,
                state: (&[f64], &[f64]),
                u: &(),
                memory: &mut (),
                out: &mut [f64],
            ) -> Result<(), std::convert::Infallible> {
                self.position_force(t, state, u, memory, out)
            }

            fn momentum(
                &self,
                (_q, v): (&[f64], &[f64]),
                _memory: &mut (),
                out: &mut [f64],
            ) -> Result<(), std::convert::Infallible> {
                out.copy_from_slice(v);
                Ok(())
            }

            fn velocity(
                &self,
                _q: &[f64],
                _memory: &mut (),
                _out: &mut [f64],
            ) -> Result<(), std::convert::Infallible> {
                Ok(())
            }

            fn position_force(
                &self,
                _t: f64,
                (q, _v): (&[f64], &[f64]),
                _u: &(),
                _memory: &mut (),
                out: &mut [f64],
            ) -> Result<(), std::convert::Infallible> {
                out.copy_from_slice(&self.force(q));
                Ok(())
            }

            fn not_separable(&self) -> Option<String> {
                None
            }
        }
    };
}

/// `Mechanical` of a rigid body that turns about a fixed point under `self.torque(q)`, in the axes of its `moments`.
macro_rules! mechanical_of_turning_body {
    ($problem:ty) => {
        impl $crate::Mechanical for $problem {
            type Positions = $crate::Rotation;

            fn positions(&self) -> &$crate::Rotation {
                &$crate::Rotation
            }

            fn acceleration(
                &self,
                _t: f64,
                (q, v): (&[f64], &[f64]),
                _u: &(),
                _memory: &mut (),
                out: &mut [f64],
            ) -> Result<(), std::convert::Infallible> {
                out.copy_from_slice(&self.acceleration_of(q, v));
                Ok(())
            }

            fn momentum(
                &self,
                (_q, v): (&[f64], &[f64]),
                _memory: &mut (),
                out: &mut [f64],
            ) -> Result<(), std::convert::Infallible> {
                for ((out, i), v) in out.iter_mut().zip(self.moments).zip(v) {
                    *out = i * v;
                }
                Ok(())
            }

            fn velocity(
                &self,
                _q: &[f64],
                _memory: &mut (),
                out: &mut [f64],
            ) -> Result<(), std::convert::Infallible> {
                for (out, i) in out.iter_mut().zip(self.moments) {
                    *out /= i;
                }
                Ok(())
            }

            fn position_force(
                &self,
                _t: f64,
                (q, _v): (&[f64], &[f64]),
                _u: &(),
                _memory: &mut (),
                out: &mut [f64],
            ) -> Result<(), std::convert::Infallible> {
                out.copy_from_slice(&self.torque(q));
                Ok(())
            }

            fn not_separable(&self) -> Option<String> {
                Some("the positions turn, and v̇ depends on v by (I ω) × ω".into())
            }
        }
    };
}

pub(super) use {mechanical_of_turning_body, mechanical_of_unit_mass, system_of_formula};
