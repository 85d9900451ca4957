//! Equations of motion from energies, by dual numbers.
//!
//! A mechanism is its kinetic energy T(q, v) and its potential energy V(q). From these, evaluated on numbers that carry exact
//! derivatives, follow with L = T − V and d/dt ∂L/∂v − ∂L/∂q = Q its equations of motion
//!
//! **M(q) v̇ + C(q, v) v + G(q) = Q**
//!
//! | symbol | what | call of [`Mechanics`] |
//! |---|---|---|
//! | M | mass matrix, symmetric and positive definite: T = ½ vᵀ M v | [`mass_matrix`](Mechanics::mass_matrix) |
//! | C | Christoffel's matrix, for which Ṁ − 2C is skew | [`coriolis_matrix`](Mechanics::coriolis_matrix) |
//! | G | +∂V/∂q, on the left-hand side: the force that holds the mechanism still | [`gravity_force`](Mechanics::gravity_force) |
//! | C v + G | bias force, on the left-hand side | [`bias_force`](Mechanics::bias_force) |
//! | Q | generalized force, on the right-hand side: all that T and V do not contain | [`inverse_dynamics`](Mechanics::inverse_dynamics) |
//! | v̇ | acceleration, M⁻¹ (Q − C v − G) | [`forward_dynamics`](Mechanics::forward_dynamics) |
//!
//! Units are SI: m, rad, kg, s, N, N·m, J. v is dq/dt, one velocity a coordinate; only where a joint floats, q holds a pose and v the
//! velocities in the moved body's axes ([`state`] is the arithmetic for it). The energy T + V changes at the rate Q · v (where T is
//! quadratic in v, as it is for bodies that nothing drives).
//!
//! # From a URDF
//!
//! Standard gravity points along −z of the root link; [`urdf::Options`] changes that. Friction and damping of `<dynamics>` are no
//! energies: they are listed in [`urdf::Urdf::joint_dynamics`].
//!
//! ```
//! use lagrange::{Dynamics, Mechanics, urdf};
//!
//! let text = r#"<robot name="crane">
//!   <link name="rail"/>
//!   <link name="trolley"><inertial><mass value="2"/>
//!     <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
//!   <joint name="slide" type="prismatic"><parent link="rail"/><child link="trolley"/><axis xyz="1 0 0"/>
//!     <limit lower="-1" upper="1" effort="10" velocity="1"/></joint>
//!   <link name="load"><inertial><origin xyz="0 0 -1.5"/><mass value="4"/>
//!     <inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial></link>
//!   <joint name="rope" type="continuous"><parent link="trolley"/><child link="load"/><axis xyz="0 1 0"/></joint>
//! </robot>"#;
//! let urdf = urdf::read(text, &urdf::Options::default())?;
//! let coordinates = urdf.tree.coordinates().to_vec();
//! let crane = Dynamics::new(urdf.tree, coordinates)?;
//! assert_eq!(crane.coordinates()[1].name, "rope");
//!
//! let q = [0.0, 0.0];
//! assert_eq!(crane.mass_matrix(&q)?, nalgebra::dmatrix![6.0, -6.0; -6.0, 9.0]);
//! // The trolley is pushed with 2 N: it starts with 1 m/s², and the load stays behind.
//! let a = crane.forward_dynamics(&q, &[0.0, 0.0], &[2.0, 0.0])?;
//! assert!((a[0] - 1.0).abs() < 1e-12 && (a[0] - 1.5 * a[1]).abs() < 1e-12);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # From energies as text
//!
//! ```
//! use lagrange::{Dynamics, Mechanics, TextLagrangian, TextSource};
//!
//! let bead = TextLagrangian::new(&TextSource {
//!     coordinates: vec!["s".into()],
//!     kinetic: "0.5*m*s_dot^2*(1 + (2*c*s)^2)".into(), // on the wire z = c s²
//!     potential: "m*g*c*s^2".into(),
//!     parameters: [("m", 0.1), ("c", 2.0), ("g", 9.81)].map(|(name, x)| (name.into(), x)).to_vec(),
//!     ..TextSource::default()
//! })
//! .map_err(|problems| problems[0].clone())?;
//! let coordinates = bead.coordinates().to_vec();
//! let bead = Dynamics::new(bead, coordinates)?;
//! // C v = 4 m c² s ṡ²
//! let coriolis = bead.coriolis_matrix(&[0.3], &[2.0])?[(0, 0)] * 2.0;
//! assert!((coriolis - 4.0 * 0.1 * 4.0 * 0.3 * 4.0).abs() < 1e-14);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # From energies in Rust
//!
//! Generic over [`Scalar`], so that the same lines are evaluated on `f64` and on dual numbers.
//!
//! ```
//! use lagrange::{Dynamics, Lagrangian, Mechanics, Scalar};
//!
//! /// A mass of 0.5 kg on a spring of 40 N/m and 0.3 m that swings: q = (length, angle from hanging).
//! struct SwingingSpring;
//!
//! impl Lagrangian for SwingingSpring {
//!     fn dof(&self) -> usize { 2 }
//!     fn kinetic<D: Scalar>(&self, q: &[D], v: &[D]) -> D {
//!         (v[0] * v[0] + q[0] * q[0] * v[1] * v[1]) * (0.5 * 0.5)
//!     }
//!     fn potential<D: Scalar>(&self, q: &[D]) -> D {
//!         let stretch = q[0] - 0.3;
//!         stretch * stretch * (0.5 * 40.0) - q[0] * q[1].cos() * (0.5 * 9.81)
//!     }
//! }
//!
//! let spring = Dynamics::of(SwingingSpring);
//! // Hanging at rest, the spring is stretched by m g / k.
//! let rest = [0.3 + 0.5 * 9.81 / 40.0, 0.0];
//! assert!(spring.gravity_force(&rest)?.amax() < 1e-14);
//! # Ok::<(), lagrange::Error>(())
//! ```
//!
//! # Under constraints
//!
//! Loops of a tree, formulas φ(q) = 0 beside a text, or a [`Constraint`](constraint::Constraint) in Rust make a mechanism a
//! [`Constrained`](constraint::Constrained), which obeys M v̇ + C v + G = Q + Jᵀ λ: see [`constraint`].
//!
//! # Derivatives, parameters, many states
//!
//! | what | call |
//! |---|---|
//! | ∂v̇/∂q, ∂v̇/∂v, ∂v̇/∂Q = M⁻¹, ∂v̇/∂p, and the same of Q | [`forward_dynamics_derivatives`](Mechanics::forward_dynamics_derivatives), [`inverse_dynamics_derivatives`](Mechanics::inverse_dynamics_derivatives) |
//! | wᵀ ∂v̇/∂x, for reverse-mode differentiation | [`forward_dynamics_gradient_into`](Mechanics::forward_dynamics_gradient_into) |
//! | ẋ = A x + B Q around a state | [`linearize`](Mechanics::linearize) |
//! | ∂T/∂v; where the work of Q goes | [`momentum`](Mechanics::momentum), [`power_balance`](Mechanics::power_balance) |
//! | Q = Y π, and derivatives in mass, centre and inertia of a link | [`regressor`](Dynamics::regressor), [`forward_dynamics_by_inertia`](Dynamics::forward_dynamics_by_inertia) |
//! | poses and Jacobians of links, centre of mass | [`mechanism::Tree`] |
//! | eight states at once: M, C, G, bias, both dynamics, their derivatives and gradients | [`forward_dynamics_lanes_into`](Mechanics::forward_dynamics_lanes_into) and its like |
//! | M, C and G as formulas or as code | [`Formulas`] |
//! | a function of your own, such as a force law, as a program with its derivatives | [`Recorded`] |
//!
//! A URDF's equations are found joint by joint, at a cost that grows with the number of joints (forces, accelerations) or with it times
//! their depth (matrices), with the instructions of the processor at hand. Energies in text or in Rust are traced to programs where
//! that is possible, else evaluated on dual numbers. [`Dynamics::by_duals`] is the second route to the same numbers,
//! [`equations::reference`] and [`equations::adjoint`] are the third.
//!
//! # In hot loops
//!
//! What is computed at a state has a twin that allocates nothing after its first use and takes the constants
//! ([`Mechanics::parameters`]: mass scales of a URDF's bodies, parameters of a text) as an argument. Its name ends in `_into`, or in
//! `_with` where it returns a number: energies and power balance. [`Workspace`] is the memory, one a thread. On a tree the regressor
//! and the derivatives in the inertia of a link use the memory of the other algorithms.
//!
//! A `_lanes_into` call takes eight states, entry by entry side by side: `q[i][k]` is entry i of state k. For trees, also where a joint
//! follows another, and for energies that are compiled to programs they are computed together in the processor's vectors; on dual
//! numbers, and the forward dynamics of constrained mechanisms, one after the other. Energies, momentum, power balance, linearisation
//! and the regressor have no such call.
pub mod constraint;
mod dynamics;
mod elementary;
pub mod equations;
mod error;
mod expression;
mod lagrangian;
mod lanes;
mod mechanics;
pub mod mechanism;
mod processor;
mod scalar;
pub mod state;
mod text;
mod trace;
mod tree;
pub mod urdf;

pub use dynamics::Dynamics;
pub use equations::derivatives::{ForwardDynamicsDerivatives, InverseDynamicsDerivatives};
pub use equations::eight::LaneFactor;
pub use equations::gradient::{ForwardDynamicsGradient, InverseDynamicsGradient};
pub use equations::{Linear, PowerBalance, Workspace};
pub use error::{Error, Position, Problem, Problems};
pub use expression::{Expression, ExpressionError, caret};
pub use lagrangian::{Coordinate, Lagrangian, Parameter, Role};
pub use lanes::{LANES, Lanes};
pub use mechanics::Mechanics;
pub use scalar::Scalar;
pub use text::{Field, TextLagrangian, TextProblem, TextSource};
pub use trace::{Formulas, FormulasError, Recorded, RecordedMemory, Style, Traced, Written};
pub use tree::INERTIAL_PARAMETERS;
