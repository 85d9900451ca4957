//! Code compiled for several processors; which one is at hand is asked at run time.

/// Something to run with the instructions that the processor has.
pub(crate) trait Task {
    /// `FUSED`: whether a·b + c is one instruction.
    fn run<const FUSED: bool>(self);
}

/// The instructions of the processor at hand.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Processor {
    /// AVX-512; not in builds with debug assertions: it is the source of AVX2 compiled once more, a quarter of the time that this crate takes.
    #[cfg(all(target_arch = "x86_64", not(debug_assertions)))]
    V4(pulp::x86::V4),
    /// AVX2 and fused products.
    #[cfg(target_arch = "x86_64")]
    V3(pulp::x86::V3),
    /// What every processor of the target has.
    Plain,
}

/// AArch64 has fused products throughout.
pub(crate) const PLAIN_IS_FUSED: bool = cfg!(target_arch = "aarch64");

#[cfg(target_arch = "x86_64")]
struct Vectorized<T>(T);

#[cfg(target_arch = "x86_64")]
impl<T: Task> pulp::NullaryFnOnce for Vectorized<T> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        self.0.run::<true>();
    }
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

    pub fn run(self, task: impl Task) {
        match self {
            #[cfg(all(target_arch = "x86_64", not(debug_assertions)))]
            Processor::V4(v4) => v4.vectorize(Vectorized(task)),
            #[cfg(target_arch = "x86_64")]
            Processor::V3(v3) => v3.vectorize(Vectorized(task)),
            Processor::Plain => task.run::<PLAIN_IS_FUSED>(),
        }
    }
}
