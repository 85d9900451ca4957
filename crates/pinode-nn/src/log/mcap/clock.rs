//! When a message was: at the stamp in its header, else when it was logged.

use super::value::Value;

/// Stamps and times of logging this far apart are of clocks that were set differently, s.
const APART: f64 = 0.5;

/// The times of a topic's messages, ns.
#[derive(Default)]
pub(super) struct Times {
    pub logged: Vec<i64>,
    stamps: Vec<Option<i64>>,
}

impl Times {
    pub(super) fn push(&mut self, logged: i64, message: &Value) {
        self.logged.push(logged);
        self.stamps.push(stamp(message));
    }

    /// How much later messages were logged than stamped, at the median, s; none where they have no stamps, or only empty ones.
    fn delay(&self) -> Option<f64> {
        let mut delays = Vec::with_capacity(self.stamps.len());
        for (stamp, logged) in self.stamps.iter().zip(&self.logged) {
            delays.push(logged.saturating_sub((*stamp)?));
        }
        if self.stamps.iter().all(|stamp| *stamp == Some(0)) {
            return None;
        }
        delays.sort_unstable();
        let median = delays.get(delays.len() / 2)?;
        Some(*median as f64 * 1e-9)
    }
}

fn stamp(message: &Value) -> Option<i64> {
    let stamp = message.field("header")?.field("stamp")?;
    let (s, ns) = (
        stamp.field("sec")?.number()?,
        stamp.field("nanosec")?.number()?,
    );
    (s as i64)
        .checked_mul(1_000_000_000)?
        .checked_add(ns as i64)
}

/// The times of all topics.
pub(super) struct Chosen {
    /// For each topic, of its messages.
    pub times: Vec<Vec<i64>>,
    /// False where times of logging were taken though there are stamps, since the clocks differ.
    pub agree: bool,
    /// Topics whose stamps begin anew, and when that was logged.
    pub begun_anew: Vec<(usize, i64)>,
    /// Topics that have times of logging beside others that have stamps.
    pub unstamped: Vec<usize>,
}

/// Chooses stamps or times of logging.
pub(super) fn choose(topics: Vec<Times>) -> Chosen {
    let delays: Vec<Option<f64>> = topics.iter().map(Times::delay).collect();
    let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
    for (times, delay) in topics.iter().zip(&delays) {
        if !times.logged.is_empty() {
            least = least.min(delay.unwrap_or(0.0));
            most = most.max(delay.unwrap_or(0.0));
        }
    }
    let mut chosen = Chosen {
        times: Vec::with_capacity(topics.len()),
        agree: most - least <= APART,
        begun_anew: Vec::new(),
        unstamped: Vec::new(),
    };
    let mixed = chosen.agree && delays.iter().any(Option::is_some);
    for (topic, (times, delay)) in topics.into_iter().zip(delays).enumerate() {
        chosen.times.push(if chosen.agree && delay.is_some() {
            let stamps: Vec<i64> = times.stamps.into_iter().flatten().collect();
            let logged = begins_anew(&stamps, &times.logged);
            chosen
                .begun_anew
                .extend(logged.map(|logged| (topic, logged)));
            stamps
        } else {
            if mixed && !times.logged.is_empty() {
                chosen.unstamped.push(topic);
            }
            times.logged
        });
    }
    chosen
}

/// When a message was logged whose stamp is far before that of one logged earlier: a simulation that was started again.
fn begins_anew(stamps: &[i64], logged: &[i64]) -> Option<i64> {
    let mut both: Vec<(i64, i64)> = logged.iter().copied().zip(stamps.iter().copied()).collect();
    both.sort_by_key(|(logged, _)| *logged);
    let mut latest = i64::MIN;
    both.into_iter().find_map(|(logged, stamp)| {
        latest = latest.max(stamp);
        (latest.saturating_sub(stamp) as f64 * 1e-9 > APART).then_some(logged)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: i64 = 1_000_000_000;

    fn times(stamps: &[Option<i64>], logged: &[i64]) -> Times {
        Times {
            logged: logged.to_vec(),
            stamps: stamps.to_vec(),
        }
    }

    #[test]
    fn stamps_are_taken_where_there_are_some_and_the_clocks_agree() {
        let stamped = || times(&[Some(10 * S), Some(11 * S)], &[10 * S + 5, 11 * S + 5]);
        let bare = || times(&[None, None], &[10 * S, 11 * S]);
        let chosen = choose(vec![stamped(), bare(), times(&[], &[])]);
        assert!(chosen.agree && chosen.begun_anew.is_empty());
        assert_eq!(chosen.unstamped, [1]);
        assert_eq!(
            chosen.times,
            [vec![10 * S, 11 * S], vec![10 * S, 11 * S], vec![]]
        );

        // The stamps of a simulation that starts at 0, beside times of the wall.
        let simulated = times(&[Some(S), Some(2 * S)], &[10 * S, 11 * S]);
        let chosen = choose(vec![simulated, bare()]);
        assert!(!chosen.agree && chosen.unstamped.is_empty());
        assert_eq!(chosen.times, [vec![10 * S, 11 * S], vec![10 * S, 11 * S]]);
    }

    #[test]
    fn stamps_that_nobody_filled_in_are_none() {
        let empty = times(&[Some(0), Some(0)], &[10 * S, 11 * S]);
        let chosen = choose(vec![empty]);
        assert!(chosen.agree);
        assert_eq!(chosen.times, [vec![10 * S, 11 * S]]);
    }

    #[test]
    fn stamps_that_begin_anew_are_told_and_those_that_overtake_are_not() {
        let logged = [10 * S, 11 * S, 12 * S, 13 * S];
        let begun_anew = |stamps: [i64; 4]| {
            let stamps = stamps.map(|ms| Some(S + ms * 1_000_000));
            choose(vec![times(&stamps, &logged)]).begun_anew
        };
        assert_eq!(begun_anew([3000, 4000, 0, 1000]), [(0, 12 * S)]);
        assert_eq!(begun_anew([3000, 4000, 3990, 5000]), []);
    }
}
