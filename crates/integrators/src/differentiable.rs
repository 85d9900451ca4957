//! Systems with derivatives.

use nalgebra::DMatrix;

use crate::{Space, System};

/// A [`System`] whose rate f(t, x, u; p) has derivatives in the state, in the numbers of the input and in constants p.
///
/// Derivatives in x are along the directions of motion, ∂f(t, x ⊕ ξ, u)/∂ξ at ξ = 0, nt × nt for nt directions. In a flat space that
/// is ∂f/∂x.
pub trait Differentiable: System {
    /// Numbers in an input that have derivatives, nu.
    fn input_count(&self) -> usize;

    /// Constants that have derivatives, np.
    fn parameter_count(&self) -> usize;

    /// Writes f at (t, x, u) = `at` to `dx` and its derivatives to `by`, every entry of both.
    ///
    /// # Errors
    /// As [`rate`](System::rate).
    fn linearize(
        &self,
        at: (f64, &[f64], &Self::Input),
        memory: &mut Self::Memory,
        dx: &mut [f64],
        by: &mut Jacobian,
    ) -> Result<(), Self::Error>;

    /// Writes f at (t, x, u) = `at` to `dx`, and *adds* wᵀ ∂f/∂x, wᵀ ∂f/∂u and wᵀ ∂f/∂p for the row w = `weight` to `by`.
    ///
    /// # Errors
    /// As [`rate`](System::rate).
    fn pull_back(
        &self,
        at: (f64, &[f64], &Self::Input),
        memory: &mut Self::Memory,
        weight: &[f64],
        dx: &mut [f64],
        by: &mut Gradient,
    ) -> Result<(), Self::Error>;
}

/// ∂f/∂x, ∂f/∂u and ∂f/∂p: nt rows each.
#[derive(Debug, Clone, PartialEq)]
pub struct Jacobian {
    /// nt × nt.
    pub state: DMatrix<f64>,
    /// nt × nu.
    pub input: DMatrix<f64>,
    /// nt × np.
    pub parameters: DMatrix<f64>,
}

impl Jacobian {
    /// Zeros of the right size for a system.
    pub fn zeros<S: Differentiable>(system: &S) -> Self {
        let nt = system.space().tangent_dim();
        Jacobian {
            state: DMatrix::zeros(nt, nt),
            input: DMatrix::zeros(nt, system.input_count()),
            parameters: DMatrix::zeros(nt, system.parameter_count()),
        }
    }
}

/// Derivatives of one number in a state, an input and the constants.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Gradient {
    /// Along the directions of motion, nt.
    pub state: Vec<f64>,
    /// nu.
    pub input: Vec<f64>,
    /// np.
    pub parameters: Vec<f64>,
}

impl Gradient {
    /// Zeros of the right size for a system.
    pub fn zeros<S: Differentiable>(system: &S) -> Self {
        Gradient {
            state: vec![0.0; system.space().tangent_dim()],
            input: vec![0.0; system.input_count()],
            parameters: vec![0.0; system.parameter_count()],
        }
    }
}
