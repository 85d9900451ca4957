//! Which instructions the kernels are run with.

use pulp::{Arch, Simd, WithSimd};

/// The instructions of the processor at hand.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Processor {
    /// AVX-512.
    #[cfg(target_arch = "x86_64")]
    V4(pulp::x86::V4),
    /// AVX2 and fused products; `Arch` knows it by another feature of `pulp` only.
    #[cfg(target_arch = "x86_64")]
    V3(pulp::x86::V3),
    /// What every processor of the target has.
    Plain(Arch),
}

impl Processor {
    /// Of the processor at hand.
    pub fn here() -> Self {
        #[cfg(target_arch = "x86_64")]
        {
            if let Some(v4) = pulp::x86::V4::try_new() {
                return Processor::V4(v4);
            }
            if let Some(v3) = pulp::x86::V3::try_new() {
                return Processor::V3(v3);
            }
        }
        Processor::Plain(Arch::new())
    }

    /// `task`, compiled for the processor.
    pub fn run<W: WithSimd>(self, task: W) -> W::Output {
        match self {
            #[cfg(target_arch = "x86_64")]
            Processor::V4(v4) => Simd::vectorize(v4, task),
            #[cfg(target_arch = "x86_64")]
            Processor::V3(v3) => Simd::vectorize(v3, task),
            Processor::Plain(arch) => arch.dispatch(task),
        }
    }
}
