//! The clock of a recording: gaps and jitter.

use super::super::verdict::DataFault;
use super::masked::Masked;
use super::noise::median;
use crate::log::Run;

/// An interval so many times the usual one is a gap.
const GAP: f64 = 1.5;
/// A clock whose intervals scatter by more than this part of the usual one jitters.
const JITTER: f64 = 0.05;
/// Gaps over which the input jumps are cut out of the windows as long as they are at most this share of all intervals: a log that loses
/// more would lose most of its windows.
const MOST_GAPS: f64 = 0.01;
/// A jump of the input over a gap counts when it is larger than this part of the input's range.
const JUMP: f64 = 0.05;
/// So many intervals of a fault are listed.
const MOST_LISTED: usize = 100;

/// Gaps and jitter of all recordings. Where the input jumps over a gap, nothing says when it did: no window crosses it.
pub fn clock_faults(runs: &[&Run], masked: &mut Masked) -> Vec<DataFault> {
    let mut faults = Vec::new();
    for (r, run) in runs.iter().enumerate() {
        faults.extend(gaps(r, run, masked));
        faults.extend(jitter(&run.t));
    }
    faults
}

fn intervals(t: &[f64]) -> Vec<f64> {
    t.windows(2).map(|p| p[1] - p[0]).collect()
}

fn gaps(r: usize, run: &Run, masked: &mut Masked) -> Option<DataFault> {
    let t = &run.t;
    let typical = median(&mut intervals(t));
    let gaps: Vec<usize> = (1..t.len())
        .filter(|&k| t[k] - t[k - 1] > GAP * typical)
        .collect();
    if gaps.is_empty() {
        return None;
    }
    let unknown: Vec<usize> = gaps
        .iter()
        .copied()
        .filter(|&k| run.u.iter().any(|u| jumps(u, k)))
        .collect();
    let cut = !unknown.is_empty() && unknown.len() as f64 <= MOST_GAPS * t.len() as f64;
    if cut {
        for &k in &unknown {
            masked.add(r, [t[k - 1], t[k]]);
        }
    }
    let done = match cut {
        true => format!(
            "the input is taken as held over them; over {} of them it jumps, and no window crosses those",
            unknown.len()
        ),
        false => "the input is taken as held over them".to_owned(),
    };
    Some(DataFault {
        kind: "gap".into(),
        column: "t".into(),
        detail: format!(
            "{} intervals are longer than {GAP} times the usual {typical:.4} s; {done}",
            gaps.len()
        ),
        when: gaps
            .iter()
            .take(MOST_LISTED)
            .map(|&k| [t[k - 1], t[k]])
            .collect(),
    })
}

/// Whether an input changes by much between samples `k` − 1 and `k`.
fn jumps(u: &[f64], k: usize) -> bool {
    let low = u.iter().copied().fold(f64::INFINITY, f64::min);
    let high = u.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    (u[k] - u[k - 1]).abs() > JUMP * (high - low)
}

/// 1.4826 · median |Δt − median Δt|, and no more than a tenth of the intervals counted as gaps.
fn jitter(t: &[f64]) -> Option<DataFault> {
    let all = intervals(t);
    let typical = median(&mut all.clone());
    let mut away: Vec<f64> = all.iter().map(|d| (d - typical).abs()).collect();
    let scatter = 1.4826 * median(&mut away);
    (scatter > JITTER * typical).then(|| DataFault {
        kind: "jitter".into(),
        column: "t".into(),
        when: match (t.first(), t.last()) {
            (Some(&first), Some(&last)) => vec![[first, last]],
            _ => Vec::new(),
        },
        detail: format!(
            "the intervals between samples scatter by {scatter:.2e} s around {typical:.4} s ({:.0} %); the stamps are believed, and an \
             error of theirs looks like sensor noise that grows with the speed",
            100.0 * scatter / typical
        ),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(t: Vec<f64>, u: Vec<f64>) -> Run {
        Run {
            id: "0".into(),
            q: Vec::new(),
            v: Vec::new(),
            u: vec![u],
            t,
        }
    }

    #[test]
    fn rows_lost_while_the_input_jumps_are_cut_out_and_rows_lost_under_a_held_input_are_not() {
        let keep = |k: &usize| !(300..304).contains(k) && !(610..612).contains(k);
        let rows: Vec<usize> = (0..1000).filter(keep).collect();
        let t = rows.iter().map(|&k| 0.02 * k as f64).collect();
        // Steps at 302 and every 100 from there: 610 to 612 lie within a step.
        let u = rows
            .iter()
            .map(|&k| if ((k + 98) / 100) % 2 == 0 { 1.0 } else { -1.0 })
            .collect();
        let recorded = run(t, u);
        let mut masked = Masked::none(1);
        let faults = clock_faults(&[&recorded], &mut masked);
        assert_eq!(faults.len(), 1);
        assert_eq!((faults[0].kind.as_str(), faults[0].when.len()), ("gap", 2));
        assert!(masked.touches(0, 5.0, 6.5), "the step at 6.04 s is lost");
        assert!(!masked.touches(0, 12.0, 12.5), "the input is held there");
    }

    #[test]
    fn a_clock_that_wanders_jitters_and_one_that_is_read_to_a_microsecond_does_not() {
        let clock = |size: f64| -> Vec<f64> {
            (0..500)
                .map(|k| 0.02 * k as f64 + size * (k as f64 * 1.9).sin())
                .collect()
        };
        assert!(jitter(&clock(1e-6)).is_none());
        let fault = jitter(&clock(2e-3));
        assert_eq!(fault.map(|f| f.kind), Some("jitter".to_owned()));
    }
}
