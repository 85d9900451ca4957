//! Whether the times of a log are in seconds.
//!
//! Clocks count in ms, µs or ns as well. What is read as seconds and is none makes a motion a thousand to a thousand million times too slow: all else about the log
//! looks right.

use lagrange::Problem;

use super::{Mapping, Run, typical};
use crate::digits::number;
use crate::naming::quoted;

/// Samples this far apart, s, are of no mechanism's motion.
const NO_MOTION: f64 = 1e3;
/// Samples this far apart, s, are suspicious.
const SLOW: f64 = 1.0;
/// A time that is further from 0, s, is no time of a clock in seconds, whatever it counts from: 3000 years.
const NO_TIME: f64 = 1e11;
/// A time that is further from 0, s, counts from a day long ago, as 1970.
pub(super) const LONG_AGO: f64 = 1e8;

/// Samples that are more counts apart than this are few in ms, 20 a second, or many in µs, 20 000 a second: either may be meant.
const MOST_MS: f64 = 50.0;

/// Steps in ns are longer than this, and those in µs shorter: 0.2 ms, or 0.2 s.
const LEAST_NS: f64 = 2e5;

/// What a clock may count.
struct Unit {
    name: &'static str,
    /// s
    size: f64,
}

/// s
pub const MILLISECOND: f64 = 1e-3;
pub const MICROSECOND: f64 = 1e-6;

const MS: Unit = Unit {
    name: "ms",
    size: MILLISECOND,
};
const US: Unit = Unit {
    name: "µs",
    size: MICROSECOND,
};
const NS: Unit = Unit {
    name: "ns",
    size: 1e-9,
};

/// What samples so far apart may be apart if they are not seconds: sizes of one, s.
pub fn sizes_of_a_count(step: f64) -> Vec<f64> {
    match step {
        step if step > MOST_MS => vec![MILLISECOND, MICROSECOND],
        step if step >= SLOW => vec![MILLISECOND],
        _ => Vec::new(),
    }
}

/// Times that cannot be in seconds, as what they seem to be in: an error. Those that could be, of a slow motion: a warning. `first` is the first time, as it
/// is in the file; `mapping` is that of `t`.
pub(super) fn check(
    runs: &[Run],
    first: f64,
    mapping: &Mapping,
) -> Result<Option<Problem>, Problem> {
    let steps = runs
        .iter()
        .flat_map(|run| run.t.windows(2).map(|p| p[1] - p[0]));
    let Some(step) = typical(steps.collect()) else {
        return Ok(None);
    };
    let cure = |unit: &Unit| {
        format!(
            "for {} write `t = {{ column = \"{}\", scale = {:e} }}` into [log.columns] of the model",
            unit.name,
            mapping.column,
            unit.size * mapping.scale
        )
    };
    let column = quoted(&mapping.column);
    if first.abs() >= NO_TIME {
        // Since 1970, as clocks of computers count.
        let unit = match first.abs() {
            x if x < 1e14 => MS,
            x if x < 1e17 => US,
            _ => NS,
        };
        return Err(Problem::general(format!(
            "{column} begins at {first}, which no clock shows in seconds; it seems to count {} since 1970: {}",
            unit.name,
            cure(&unit)
        )));
    }
    if step >= NO_MOTION {
        let unit = if step < LEAST_NS { US } else { NS };
        let or = match unit.size == US.size {
            true => format!(
                "; where samples are {} s apart, it counts ms: {}",
                number(MILLISECOND * step),
                cure(&MS)
            ),
            false => String::new(),
        };
        return Err(Problem::general(format!(
            "{column} goes {} from sample to sample, at the median, and no motion is seen in samples so many seconds apart; it seems to count {}: {}{or}",
            number(step),
            unit.name,
            cure(&unit)
        )));
    }
    Ok((step >= SLOW).then(|| {
        let or = match step > MOST_MS {
            true => format!("; {}", cure(&US)),
            false => String::new(),
        };
        Problem::general(format!(
            "{column} is read as seconds: a sample every {step} s, at the median, is few for a motion; {}{or}",
            cure(&MS)
        ))
    }))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    /// What is said of a recording with samples so far apart, from `first` on.
    fn said(first: f64, step: f64) -> Result<Option<String>, String> {
        let run = Run {
            id: "0".into(),
            t: (0..20).map(|k| first + step * f64::from(k)).collect(),
            q: Vec::new(),
            v: Vec::new(),
            u: Vec::new(),
        };
        let mapping = Mapping::new("t", "stamp");
        let found = check(&[run], first, &mapping);
        found
            .map(|warning| warning.map(|w| w.message))
            .map_err(|problem| problem.message)
    }

    #[test]
    fn what_a_clock_counts_is_told_by_its_steps_and_by_where_it_begins() {
        for (first, step, unit, scale) in [
            (0.0, 2e4, "µs", "1e-6"),
            (0.0, 1e3, "µs", "1e-6"),
            (0.0, 2e7, "ns", "1e-9"),
            (1.7e12, 20.0, "ms", "1e-3"),
            (1.7e15, 2e4, "µs", "1e-6"),
            (1.7e18, 2e7, "ns", "1e-9"),
        ] {
            let told = said(first, step).unwrap_err();
            assert!(told.contains(&format!("seems to count {unit}")), "{told}");
            assert!(
                told.contains(&format!("`t = {{ column = \"stamp\", scale = {scale} }}`")),
                "{told}"
            );
            // Ten seconds between samples are possible.
            let or = "samples are 20.0 s apart, it counts ms: for ms write `t = { column = \"stamp\", scale = 1e-3 }`";
            assert_eq!(told.contains(or), (first, step) == (0.0, 2e4), "{told}");
        }
    }

    #[test]
    fn seconds_are_read_as_such_with_a_warning_where_they_are_many() {
        for (first, step) in [(0.0, 0.02), (1.7e9, 1e-3), (-3.0, 0.5)] {
            assert_eq!(said(first, step), Ok(None));
        }
        let told = said(0.0, 20.0).unwrap().unwrap();
        assert!(
            told.contains("a sample every 20 s") && told.contains("for ms write"),
            "{told}"
        );
        assert!(!told.contains("for µs write"), "50 kHz is no log: {told}");
        // 5 kHz, if it counts µs.
        let told = said(0.0, 200.0).unwrap().unwrap();
        assert!(
            told.contains("for ms write") && told.contains("for µs write"),
            "{told}"
        );
    }
}
