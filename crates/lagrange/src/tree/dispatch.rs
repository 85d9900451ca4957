//! One algorithm, compiled for several processors and for one state or eight at once; the processor is asked when memory is made.

use super::articulated::Articulated;
use super::common::{Axis, Moved, Sums};
use super::gradient::Weighed;
use super::inverse_dynamics::Link;
use super::plan::Plan;
use super::sink::Sides;
use super::state::State;
use super::vector::Spatial;
use crate::Scalar;
use crate::lanes::{LANES, Lanes, Single};
use crate::processor::{PLAIN_IS_FUSED, Processor};

/// Up to this many degrees of freedom forward dynamics by the factor of M is faster than by articulated bodies.
pub const FEW: usize = 8;

/// All that the algorithms write, on one scalar.
#[derive(Debug, Clone)]
pub struct TreeMemory<D> {
    pub state: State<D>,
    pub links: Vec<Link<D>>,
    pub moved: Vec<Moved<D>>,
    pub axes: Vec<Axis<D>>,
    pub sums: Vec<Sums<D>>,
    pub articulated: Vec<Articulated<D>>,
    pub weighed: Vec<Weighed<D>>,
    pub momenta: Vec<Spatial<D>>,
    /// Q, and in its place v̇.
    pub force: Vec<D>,
    /// M in the order of the degrees of freedom, row after row; then its factor.
    pub mass: Vec<D>,
    /// Right-hand sides, row after row.
    pub rows: Vec<D>,
}

impl<D: Scalar> TreeMemory<D> {
    /// `mass`: whether M is wanted whatever its size, for the derivatives of the forward dynamics.
    pub fn new(plan: &Plan, mass: bool) -> Self {
        let n = plan.dofs.len();
        let matrices = if mass || n <= FEW { n * n } else { 0 };
        TreeMemory {
            state: State::new(plan),
            links: Link::memory(plan),
            moved: Moved::memory(plan),
            axes: Axis::memory(plan),
            sums: Sums::memory(plan),
            articulated: Articulated::memory(plan),
            weighed: Weighed::memory(plan),
            momenta: vec![Spatial::zero(); plan.bodies.len()],
            force: vec![D::zero(); plan.nv],
            mass: vec![D::zero(); matrices],
            rows: vec![D::zero(); 4 * n + plan.np],
        }
    }
}

/// One state, and eight.
#[derive(Debug, Clone)]
pub struct Memory<const FUSED: bool> {
    pub one: TreeMemory<Single<FUSED>>,
    pub eight: TreeMemory<Lanes<FUSED>>,
    /// −∂Q/∂q, −∂Q/∂v and 1 side by side, row after row: the right-hand sides of one state's derivatives.
    pub sides: Vec<Lanes<FUSED>>,
    /// The same of eight states; room for it is made when it is first asked for.
    pub wide: Vec<Lanes<FUSED>>,
}

impl<const FUSED: bool> Memory<FUSED> {
    fn new(plan: &Plan) -> Self {
        Memory {
            one: TreeMemory::new(plan, true),
            eight: TreeMemory::new(plan, false),
            sides: vec![Lanes::constant(0.0); plan.dofs.len() * Sides::<FUSED>::width(plan)],
            wide: Vec::new(),
        }
    }

    fn grow(&mut self, plan: &Plan) {
        let n = plan.dofs.len();
        self.eight.mass.resize(n * n, Lanes::constant(0.0));
        self.wide.resize(3 * n * n, Lanes::constant(0.0));
    }
}

/// What a number is outside of the algorithms: of one state, or of eight.
pub trait Width: nalgebra::Scalar + Copy + Default + Send + Sync {
    type Number<const FUSED: bool>: Scalar;
    const IS_EIGHT: bool;
    fn memory<const FUSED: bool>(
        memory: &mut Memory<FUSED>,
    ) -> &mut TreeMemory<Self::Number<FUSED>>;
    fn lift<const FUSED: bool>(self) -> Self::Number<FUSED>;
    fn drop<const FUSED: bool>(x: Self::Number<FUSED>) -> Self;
    fn negated(self) -> Self;
}

impl Width for f64 {
    type Number<const FUSED: bool> = Single<FUSED>;
    const IS_EIGHT: bool = false;
    fn negated(self) -> Self {
        -self
    }
    #[inline(always)]
    fn memory<const FUSED: bool>(
        memory: &mut Memory<FUSED>,
    ) -> &mut TreeMemory<Self::Number<FUSED>> {
        &mut memory.one
    }
    #[inline(always)]
    fn lift<const FUSED: bool>(self) -> Self::Number<FUSED> {
        Single(self)
    }
    #[inline(always)]
    fn drop<const FUSED: bool>(x: Self::Number<FUSED>) -> Self {
        x.0
    }
}

impl Width for [f64; LANES] {
    type Number<const FUSED: bool> = Lanes<FUSED>;
    const IS_EIGHT: bool = true;
    fn negated(self) -> Self {
        self.map(|x| -x)
    }
    #[inline(always)]
    fn memory<const FUSED: bool>(
        memory: &mut Memory<FUSED>,
    ) -> &mut TreeMemory<Self::Number<FUSED>> {
        &mut memory.eight
    }
    #[inline(always)]
    fn lift<const FUSED: bool>(self) -> Self::Number<FUSED> {
        Lanes(self)
    }
    #[inline(always)]
    fn drop<const FUSED: bool>(x: Self::Number<FUSED>) -> Self {
        x.0
    }
}

/// An algorithm with its arguments.
pub trait Kernel {
    fn run<const FUSED: bool>(self, plan: &Plan, memory: &mut Memory<FUSED>);
}

/// Memory for one thread, and with it the instructions that its algorithms use.
#[derive(Debug, Clone)]
pub enum Machine {
    /// AVX-512; see [`Processor`].
    #[cfg(all(target_arch = "x86_64", not(debug_assertions)))]
    V4(pulp::x86::V4, Box<Memory<true>>),
    /// AVX2 and fused products.
    #[cfg(target_arch = "x86_64")]
    V3(pulp::x86::V3, Box<Memory<true>>),
    /// What every processor of the target has.
    Plain(Box<Memory<PLAIN_IS_FUSED>>),
}

#[cfg(target_arch = "x86_64")]
struct Vectorized<'a, K> {
    kernel: K,
    plan: &'a Plan,
    memory: &'a mut Memory<true>,
}

#[cfg(target_arch = "x86_64")]
impl<K: Kernel> pulp::NullaryFnOnce for Vectorized<'_, K> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        self.kernel.run(self.plan, self.memory);
    }
}

impl Machine {
    pub fn new(plan: &Plan) -> Self {
        match Processor::here() {
            #[cfg(all(target_arch = "x86_64", not(debug_assertions)))]
            Processor::V4(v4) => Machine::V4(v4, Box::new(Memory::new(plan))),
            #[cfg(target_arch = "x86_64")]
            Processor::V3(v3) => Machine::V3(v3, Box::new(Memory::new(plan))),
            Processor::Plain => Machine::plain(plan),
        }
    }

    /// Room for what only the derivatives of eight states need: the factor of M, and their right-hand sides.
    pub fn grow(&mut self, plan: &Plan) {
        match self {
            #[cfg(all(target_arch = "x86_64", not(debug_assertions)))]
            Machine::V4(_, memory) => memory.grow(plan),
            #[cfg(target_arch = "x86_64")]
            Machine::V3(_, memory) => memory.grow(plan),
            Machine::Plain(memory) => memory.grow(plan),
        }
    }

    /// Without the instructions that only some processors have.
    pub fn plain(plan: &Plan) -> Self {
        Machine::Plain(Box::new(Memory::new(plan)))
    }

    pub fn run(&mut self, plan: &Plan, kernel: impl Kernel) {
        match self {
            #[cfg(all(target_arch = "x86_64", not(debug_assertions)))]
            Machine::V4(v4, memory) => v4.vectorize(Vectorized {
                kernel,
                plan,
                memory,
            }),
            #[cfg(target_arch = "x86_64")]
            Machine::V3(v3, memory) => v3.vectorize(Vectorized {
                kernel,
                plan,
                memory,
            }),
            Machine::Plain(memory) => kernel.run(plan, memory),
        }
    }
}
