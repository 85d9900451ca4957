//! What a sensor makes of the position it measures.
//!
//! y(t) = offset + factor q(t − delay), with offset = zero + Σ offsets, factor = Π (1 + scale), delay = Σ delays.

/// The one parameter of a kind of sensor effect.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Distortion {
    /// Adds to the reading, m or rad.
    Offset,
    /// The reading is (1 + scale) times the position.
    Scale,
    /// The reading is that of so much earlier, s.
    Delay,
}
