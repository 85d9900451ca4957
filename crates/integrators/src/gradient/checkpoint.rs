//! Which states are kept.
//!
//! The steps are cut into segments. All stages of one segment at a time are recorded; for the others the states where some of them
//! begin are kept, and segments are run again from there. With s kept states (the initial one among them) and every segment run again
//! at most r times, β(s, r) = (s + r)!/(s! r!) segments can be reversed, by keeping states at the places that [`split`] says (Griewank
//! and Walther, "Algorithm 799: revolve", ACM Trans. Math. Software 26, 2000).

/// How the memory is divided.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Plan {
    /// Steps in a segment; the last one may be shorter.
    pub segment: usize,
    /// States that can be kept beside the initial one.
    pub kept: usize,
}

impl Plan {
    /// For `steps` steps, `record` numbers for the stages of one step, `state` numbers for a state and a budget of `numbers`.
    ///
    /// The segment is as long as it can be while no step is run more than twice: the last segment is not run again at all. If the budget
    /// is too small for that, half of it goes to each.
    pub fn new(steps: usize, record: usize, state: usize, numbers: usize) -> Self {
        let (record, state) = (record.max(1), state.max(1));
        let segment = |kept: usize| numbers.saturating_sub(kept * state) / record;
        let mut kept = 0;
        // β(s, 1) = s + 1 segments with s = kept + 1.
        while segment(kept) > 0 && 2 * kept * state <= numbers {
            if steps.div_ceil(segment(kept)) <= kept + 2 {
                return Plan {
                    segment: segment(kept).min(steps.max(1)),
                    kept: if steps <= segment(kept) { 0 } else { kept },
                };
            }
            kept += 1;
        }
        let kept = (numbers / 2 / state).max(1);
        Plan {
            segment: segment(kept).max(1),
            kept,
        }
    }
}

/// β(s, r) = (s + r)!/(s! r!), at most `usize::MAX`.
fn most(s: usize, r: usize) -> usize {
    let mut product: u128 = 1;
    for i in 1..=s.min(r) as u128 {
        // Each quotient is a binomial coefficient, so that nothing is cut off.
        product = product * (s.max(r) as u128 + i) / i;
        if product > usize::MAX as u128 {
            return usize::MAX;
        }
    }
    product as usize
}

/// The least number of segments run again to reverse `segments` with `kept` states, the one where they begin among them:
/// r l − β(s + 1, r − 1) with the least r for which β(s, r) ≥ l.
fn repeats(segments: usize, kept: usize) -> usize {
    if segments <= 1 {
        return 0;
    }
    if kept == 0 {
        return usize::MAX;
    }
    let mut r = 1;
    while most(kept, r) < segments {
        r += 1;
    }
    (r * segments).saturating_sub(most(kept + 1, r - 1))
}

/// After how many of `segments` ≥ 2 the next state is kept, with `kept` ≥ 2 states, the one where they begin among them.
pub(crate) fn split(segments: usize, kept: usize) -> usize {
    let mut r = 1;
    while most(kept, r) < segments {
        r += 1;
    }
    let candidates = [
        most(kept, r - 1),
        if r > 1 { most(kept, r - 2) } else { 1 },
        segments.saturating_sub(most(kept - 1, r)),
        segments.saturating_sub(most(kept - 1, r - 1)),
    ];
    let cost = |&at: &usize| {
        at.saturating_add(repeats(segments - at, kept - 1))
            .saturating_add(repeats(at, kept))
    };
    candidates
        .map(|at| at.clamp(1, segments - 1))
        .into_iter()
        .min_by_key(cost)
        .unwrap_or(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By trying all places.
    fn least(segments: usize, kept: usize, known: &mut [Vec<usize>]) -> usize {
        if segments <= 1 {
            return 0;
        }
        if kept == 1 {
            return segments * (segments - 1) / 2;
        }
        if known[segments][kept] == 0 {
            known[segments][kept] = (1..segments)
                .map(|at| at + least(segments - at, kept - 1, known) + least(at, kept, known))
                .min()
                .unwrap();
        }
        known[segments][kept]
    }

    /// By the places of `split`.
    fn taken(segments: usize, kept: usize) -> usize {
        if segments <= 1 {
            return 0;
        }
        if kept == 1 {
            return segments * (segments - 1) / 2;
        }
        let at = split(segments, kept);
        at + taken(segments - at, kept - 1) + taken(at, kept)
    }

    #[test]
    fn segments_are_run_again_as_seldom_as_can_be() {
        let mut known = vec![vec![0; 9]; 81];
        for kept in 1..9 {
            for segments in 1..81 {
                let best = least(segments, kept, &mut known);
                assert_eq!(repeats(segments, kept), best, "{segments} with {kept}");
                assert_eq!(taken(segments, kept), best, "{segments} with {kept}");
            }
        }
    }

    #[test]
    fn the_budget_holds_the_plan() {
        for numbers in [200, 1000, 10_000, 500_000] {
            for steps in [1, 7, 100, 10_000, 1_000_000] {
                for (record, state) in [(8, 2), (28, 7), (100, 13)] {
                    let plan = Plan::new(steps, record, state, numbers);
                    assert!(plan.segment * record + plan.kept * state <= numbers);
                    assert!(plan.segment >= 1);
                }
            }
        }
        // All in one segment, and the least that there is.
        assert_eq!(
            Plan::new(100, 8, 2, 800),
            Plan {
                segment: 100,
                kept: 0
            }
        );
        assert_eq!(
            Plan::new(100, 8, 2, 0),
            Plan {
                segment: 1,
                kept: 1
            }
        );
        // 10 000 steps of 8 numbers in memory for 5000 of them: two segments, no state kept but the initial one.
        assert_eq!(
            Plan::new(10_000, 8, 2, 40_000),
            Plan {
                segment: 5000,
                kept: 0
            }
        );
    }
}
