//! What is at rest, exactly.

use super::Law;

/// Takes what is rounding, or the root of an event, out of the velocities and of the gaps of laws at rest; with its memory.
#[derive(Debug, Clone, Default)]
pub(super) struct Rest {
    waiting: Vec<usize>,
    pinned: Vec<bool>,
}

impl Rest {
    /// w·v = 0 (the belt's speed) for each law of `at_rest`, and g = 0 for its stops. What one law has put right no other moves again: in
    /// a row of bodies that rest on each other the wall decides, or the first two. What would be left of halves of halves is no rounding
    /// of a velocity of 0, and had a sign and events of its own.
    pub fn apply(
        &mut self,
        laws: &[Law],
        at_rest: impl Iterator<Item = usize>,
        q: &mut [f64],
        v: &mut [f64],
    ) {
        let Rest { waiting, pinned } = self;
        waiting.clear();
        waiting.extend(at_rest);
        pinned.clear();
        pinned.resize(v.len(), false);
        waiting.iter().for_each(|&k| laws[k].close(q));
        loop {
            let moves = |&(_, &k): &(usize, &usize)| {
                let entries = laws[k].direction.iter().zip(pinned.iter());
                entries
                    .filter(|(w, pinned)| **w != 0.0 && !**pinned)
                    .count()
            };
            let Some((place, &k)) = waiting.iter().enumerate().min_by_key(moves) else {
                return;
            };
            waiting.remove(place);
            laws[k].stop_slip(v, pinned);
            for (pinned, w) in pinned.iter_mut().zip(&laws[k].direction) {
                *pinned |= *w != 0.0;
            }
        }
    }
}
