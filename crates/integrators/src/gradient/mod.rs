//! Derivatives of roll-outs in the initial state, the constants of the system and the inputs that are held.
//!
//! All are exact derivatives of what is computed, the discrete map x_k ↦ x_{k+1} of the method with its step, and not approximations of
//! derivatives of the differential equation. Backwards by [`Adjoint`], for one loss and any number of unknowns; forwards by
//! [`Sensitivity`], for any number of results and the unknowns of interest ([`Column`]).
//!
//! # Equations
//! A step of an [`Explicit`] method from x_k at t with the input u is, with k₀ = 0 and f = f(t, x, u; p),
//!
//! - Xᵢ = x_k + aᵢ h kᵢ₋₁, kᵢ = f(t + aᵢ h, Xᵢ, u) for i = 1 … s
//! - x_{k+1} = x_k + h Σ bᵢ kᵢ
//!
//! **Forwards**, for a displacement η_k of x_k, and δu, δp:
//!
//! - δXᵢ = η_k + aᵢ h δkᵢ₋₁, δkᵢ = ∂f/∂x δXᵢ + ∂f/∂u δu + ∂f/∂p δp, the derivatives at stage i
//! - η_{k+1} = η_k + h Σ bᵢ δkᵢ
//!
//! **Backwards**, for the covector λ_{k+1} = ∂loss/∂x_{k+1} (Hairer, Nørsett and Wanner, "Solving Ordinary Differential Equations I",
//! II.15 and references there; Griewank and Walther, "Evaluating Derivatives", 2008), from i = s to 1 with a_{s+1} = 0:
//!
//! - wᵢ = h bᵢ λ_{k+1} + h aᵢ₊₁ gᵢ₊₁, gᵢ = (∂f/∂x)ᵀ wᵢ at stage i
//! - λ_k = λ_{k+1} + Σ gᵢ + ∂ℓ_k/∂x_k, where ℓ_k is the loss of a sample at x_k, if there is one
//! - ∂loss/∂p += Σ (∂f/∂p)ᵀ wᵢ, and ∂loss/∂u += Σ (∂f/∂u)ᵀ wᵢ for the input held
//!
//! # Where space is not flat
//! The step is taken in the chart Xᵢ = x_k ∘ exp ξᵢ, where ξᵢ = aᵢ h kᵢ₋₁, kᵢ = R(ad_ξᵢ) f(Xᵢ) and x_{k+1} = x_k ∘ exp ξ, ξ = h Σ bᵢ kᵢ;
//! R is the polynomial that [`Rk4`](crate::Rk4) has for z/(1 − e^{−z}). Displacements are in the moved axes of what is displaced, as
//! everywhere in this crate. With φ(z) = (1 − e^{−z})/z (dexp; Iserles, Munthe-Kaas, Nørsett and Zanna, "Lie-group methods", Acta
//! Numerica 2000, with the sides exchanged), forwards:
//!
//! - δXᵢ = e^{−ad ξᵢ} η_k + φ(ad ξᵢ) δξᵢ, δξᵢ = aᵢ h δkᵢ₋₁
//! - δkᵢ = R(ad ξᵢ) δfᵢ + Σ rₙ Σ ad_ξᵐ [δξᵢ, ad_ξʲ fᵢ] over n ≥ 1 and m + j = n − 1
//! - η_{k+1} = e^{−ad ξ} η_k + φ(ad ξ) h Σ bᵢ δkᵢ
//!
//! and backwards the transposes of these, from the last to the first. φ is summed to rounding for turns of up to 1 rad a step.
mod adjoint;
mod checkpoint;
mod column;
mod dual;
mod error;
mod explicit;
mod record;
mod reverse;
mod schedule;
mod sensitivity;

pub use adjoint::{Adjoint, RollOutGradient};
pub use column::Column;
pub use dual::{DualMemory, DualOde, DualRate};
pub use error::GradientError;
pub use explicit::Explicit;
pub use schedule::Schedule;
pub use sensitivity::Sensitivity;
