//! Code compiled for several processors; which one is at hand is asked at run time.

use pulp::WithSimd;

/// The instructions of the processor at hand. ([`pulp::Arch`] is the same, but knows of AVX2 by a feature of `pulp` that other crates may or may not have on,
/// and compiles for AVX-512 always.)
#[derive(Debug, Clone, Copy)]
pub(crate) enum Processor {
    /// AVX-512; not in builds with debug assertions: it is the source of AVX2 compiled once more, a fourteenth of what the optimiser makes of this crate.
    #[cfg(all(target_arch = "x86_64", not(debug_assertions)))]
    V4(pulp::x86::V4),
    /// AVX2 and fused products.
    #[cfg(target_arch = "x86_64")]
    V3(pulp::x86::V3),
    /// What every processor of the target has.
    Plain,
}

impl Processor {
    /// Of the processor at hand.
    pub fn here() -> Self {
        #[cfg(target_arch = "x86_64")]
        {
            #[cfg(not(debug_assertions))]
            if let Some(v4) = pulp::x86::V4::try_new() {
                return Processor::V4(v4);
            }
            if let Some(v3) = pulp::x86::V3::try_new() {
                return Processor::V3(v3);
            }
        }
        Processor::Plain
    }

    /// `task`, compiled for the processor.
    pub fn run<W: WithSimd>(self, task: W) -> W::Output {
        match self {
            #[cfg(all(target_arch = "x86_64", not(debug_assertions)))]
            Processor::V4(v4) => pulp::Simd::vectorize(v4, task),
            #[cfg(target_arch = "x86_64")]
            Processor::V3(v3) => pulp::Simd::vectorize(v3, task),
            Processor::Plain => plain(task),
        }
    }
}

#[cfg(target_arch = "x86_64")]
fn plain<W: WithSimd>(task: W) -> W::Output {
    pulp::Simd::vectorize(pulp::Scalar::new(), task)
}

/// Others have vectors that need not be asked for.
#[cfg(not(target_arch = "x86_64"))]
fn plain<W: WithSimd>(task: W) -> W::Output {
    pulp::Arch::new().dispatch(task)
}
