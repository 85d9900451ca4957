//! How fast the motion in a log is, and with that how long windows, free runs and steps are.
//!
//! What takes a fraction of a second on a laboratory's cart-pole takes minutes on a ship and microseconds in a resonator. Times of this workflow are said for the
//! one and are as many times as long, or as short, for the others.

use super::idle;
use super::smooth::unwrapped;
use crate::shooting::{Observations, ObservedRun};

/// Length of a window at the usual pace, s.
pub const WINDOW_S: f64 = 0.6;
/// A window holds so many periods of the fastest motion at most, and where it is made longer, or shorter for there would be few of them, half a one.
const PERIODS: (f64, f64) = (0.5, 5.0);
/// … and so many of what is fastest in its velocities and inputs.
const OF_PUSHES: f64 = 1.5;
/// So many windows are many, so many are few, and with fewer than about the last there is no search.
const MANY: f64 = 90.0;
const FEW: f64 = 40.0;
const TOO_FEW: f64 = 18.0;
/// What is slow has windows of so many intervals between samples, and of a part of a recording.
const INTERVALS: f64 = 6.0;
const PART: f64 = 0.25;
/// Of a short recording, which has too few windows, they are halved so often at most, and have so many intervals between samples.
const HALVINGS: usize = 2;
const FEWEST_INTERVALS: f64 = 12.0;
/// Half width of what is smooth, s at the usual pace, and in periods at most.
const SMOOTH: (f64, f64) = (0.06, 0.15);
/// The integration step starts at or below this at the usual pace, s.
const COARSEST_STEP: f64 = 10e-3;
/// That of stiff models.
const STIFF_STEP: f64 = 2.5e-3;
/// Samples that are closer than this at the usual pace, s, say little more; longer ones take two steps at least, for what is late by a part of one …
const CLOSE_SAMPLES: f64 = 5e-3;
/// … and so many of a period of the motion are kept, at least.
const SAMPLES_PER_PERIOD: f64 = 24.0;
/// Readings that span less than so many times their noise are of what is at rest, and ways of so many times it show where it goes.
const MOVES: f64 = 10.0;
/// A signal has crossed its middle when it leaves that by this part of its standard deviation.
const CROSSED: f64 = 0.2;
/// … and by so many times its noise, a position and what it goes.
const NOISY: (f64, f64) = (5.0, 2.0);
/// Half of the samples go further.
const HALF: f64 = 0.5;
/// Fast are the samples beyond this share.
const FAST: f64 = 0.95;
/// Rare are those beyond this: an input that steps does not do so often.
const RARE: f64 = 0.995;
/// What means of an input may be off by, in units of the noise.
const OF_NOISE: f64 = 1.0 / 3.0;
/// No motion is slower, Hz.
const SLOWEST: f64 = 1e-9;

/// The pace of a motion.
#[derive(Debug, Clone, PartialEq)]
pub struct Pace {
    /// How many times as long as usual everything takes.
    times: f64,
    /// Of the fastest coordinate, Hz.
    frequency: f64,
    /// Speed of each coordinate that is exceeded in one sample of twenty; infinite where it is at rest.
    speeds: Vec<f64>,
    /// Means of inputs over so many seconds do what the inputs do, but for a part of the noise.
    means: f64,
    /// Whether nothing happens most of the time.
    rests: bool,
}

impl Pace {
    /// The pace of what was observed. Windows are of [`WINDOW_S`]; of five periods where the motion is faster, or less where that leaves few of them; and where
    /// nothing is as fast, neither a position nor a velocity nor an input, of up to half a period of the fastest position, as far as that leaves many. Where nothing
    /// happens most of the time, it is the pace of the rest of it.
    pub fn of(observations: &Observations) -> Self {
        let all = Self::over(observations, 1.0);
        match idle::busy_share(observations, all.window()) {
            None => all,
            Some(share) => Pace {
                rests: true,
                ..Self::over(observations, share)
            },
        }
    }

    /// Of what happens in a share of the time.
    fn over(observations: &Observations, share: f64) -> Self {
        let runs = &observations.runs;
        let interval = observations.typical_interval();
        let mut durations: Vec<f64> = runs.iter().map(duration).collect();
        let time: f64 = share * durations.iter().sum::<f64>();
        durations.sort_by(f64::total_cmp);
        let typical = durations.get(durations.len() / 2).copied().unwrap_or(0.0);
        let rate = |signals: &[Vec<f64>], least: f64| 0.5 * crossings(signals, least) as f64 / time;
        // Of what happens.
        let of_all = |quantile: f64| 1.0 - (1.0 - quantile) * share;
        let (mut frequency, mut all, mut speeds) = (SLOWEST, SLOWEST, Vec::new());
        let mut jump = 0.0_f64;
        for i in 0..runs.first().map_or(0, |run| run.u.len()) {
            let input: Vec<Vec<f64>> = runs.iter().map(|run| run.u[i].clone()).collect();
            all = all.max(rate(&input, 0.0));
            jump = jump.max(jumps(&input, of_all(RARE)));
        }
        let mut means = f64::INFINITY;
        let positions = observations.channels.iter().enumerate();
        for (c, channel) in positions.filter(|(_, channel)| !channel.velocity) {
            let of = |run: &ObservedRun| match channel.wraps {
                true => unwrapped(&run.y[c]),
                false => run.y[c].clone(),
            };
            let y: Vec<Vec<f64>> = runs.iter().map(of).collect();
            let moves = time > 0.0 && spans(&y) > MOVES * channel.noise;
            speeds.push(f64::INFINITY);
            if moves {
                let (ways, span) = ways(&y, channel.noise, of_all(HALF));
                let over = span as f64 * interval;
                speeds[c] = usual_size(&ways, of_all(FAST)) / over;
                let bends: Vec<Vec<f64>> = ways.iter().map(|ways| after(ways, span)).collect();
                let acceleration = usual_size(&bends, of_all(FAST)) / over.powi(2);
                means = means.min((8.0 * OF_NOISE * channel.noise / (jump * acceleration)).sqrt());
                frequency = frequency.max(rate(&y, NOISY.0 * channel.noise));
                all = all.max(rate(&ways, NOISY.1 * channel.noise));
            }
        }
        let [half, longest] = [PERIODS.0, PERIODS.1].map(|periods| periods / frequency);
        let coarse = (INTERVALS * interval).min(longest);
        let short = |windows: f64| powers_of_two((time / windows).max(half).max(coarse));
        let window = if speeds.iter().all(|speed| speed.is_infinite()) {
            WINDOW_S
        } else if longest >= WINDOW_S {
            let slow = half.min(OF_PUSHES / all).min(time / MANY);
            let slow = powers_of_two(slow.max(coarse).min(PART * typical)).max(WINDOW_S);
            match time < TOO_FEW * slow {
                true => short(TOO_FEW).min(slow),
                false => slow,
            }
        } else if time < FEW * longest {
            short(MANY).min(longest)
        } else {
            longest
        };
        Pace {
            times: window / WINDOW_S,
            frequency,
            speeds,
            means,
            rests: false,
        }
    }

    /// Whether nothing happens most of the time.
    pub fn rests(&self) -> bool {
        self.rests
    }

    /// What takes so many seconds at the usual pace.
    pub fn long(&self, usual: f64) -> f64 {
        self.times * usual
    }

    /// How many times as long as usual everything takes.
    pub fn times(&self) -> f64 {
        self.times
    }

    /// Speed of each coordinate that is exceeded in one sample of twenty, m/s or rad/s; infinite where it is at rest.
    pub fn speeds(&self) -> &[f64] {
        &self.speeds
    }

    /// Length of a window, s.
    pub fn window(&self) -> f64 {
        self.long(WINDOW_S)
    }

    /// What is `cut` at this pace, and the pace: with windows half as long, or a quarter, and all that goes with them, where it is not `enough` and they have
    /// [`FEWEST_INTERVALS`] between samples `interval` s apart.
    pub fn shortened<T>(
        self,
        interval: f64,
        cut: impl Fn(&Pace) -> T,
        enough: impl Fn(&T) -> bool,
    ) -> (Self, T) {
        let (mut pace, mut pieces) = (self.clone(), cut(&self));
        for _ in 0..HALVINGS {
            let shorter = Pace {
                times: 0.5 * pace.times,
                ..pace.clone()
            };
            if enough(&pieces) || shorter.window() < FEWEST_INTERVALS * interval {
                break;
            }
            pieces = cut(&shorter);
            pace = shorter;
        }
        (pace, pieces)
    }

    /// Half width of the smoothing, s.
    pub fn half_width(&self) -> f64 {
        self.long(SMOOTH.0).min(SMOOTH.1 / self.frequency)
    }

    /// The longest integration step to begin with, s.
    pub fn coarsest_step(&self, stiff: bool) -> f64 {
        let usual = if stiff { STIFF_STEP } else { COARSEST_STEP };
        self.times.max(1.0) * usual
    }

    /// Integration steps of a sample to begin with.
    pub fn first_steps(&self, interval: f64, stiff: bool) -> usize {
        let least = if interval <= self.close() { 1 } else { 2 };
        let steps = (interval / self.coarsest_step(stiff)).ceil() as usize;
        steps.max(least)
    }

    /// Samples that are closer than this are close, s.
    fn close(&self) -> f64 {
        self.times.max(1.0) * CLOSE_SAMPLES
    }

    /// Samples that are closer than this, s, cost time and say little more. Those that are kept have the mean of the input between them, held: where it jumps by Δu
    /// within the time h, that is off by up to Δa h²/8.
    pub fn closest_samples(&self) -> f64 {
        let enough = 1.0 / (SAMPLES_PER_PERIOD * self.frequency);
        self.close().min(enough).min(self.means)
    }
}

/// The length of a window nearest to `window`, s, and not above it, that is a power of two times the usual one: a few crossings more or less are no other pace.
fn powers_of_two(window: f64) -> f64 {
    WINDOW_S * (window / WINDOW_S).log2().floor().exp2()
}

/// The range of a signal.
fn spans(signal: &[Vec<f64>]) -> f64 {
    let all = || signal.iter().flatten().copied();
    all().fold(f64::NEG_INFINITY, f64::max) - all().fold(f64::INFINITY, f64::min)
}

fn duration(run: &ObservedRun) -> f64 {
    match run.t[..] {
        [first, .., last] => last - first,
        _ => 0.0,
    }
}

/// The jumps of an input from sample to sample that this share does not exceed, in parts of its standard deviation; 1 at most.
fn jumps(input: &[Vec<f64>], share: f64) -> f64 {
    let all = || input.iter().flatten();
    let count = all().count().max(1) as f64;
    let mean = all().sum::<f64>() / count;
    let deviation = (all().map(|u| (u - mean).powi(2)).sum::<f64>() / count).sqrt();
    let jumps: Vec<Vec<f64>> = input.iter().map(|of_run| after(of_run, 1)).collect();
    (usual_size(&jumps, share) / deviation.max(f64::MIN_POSITIVE)).min(1.0)
}

/// By how much a signal is another one so many samples later.
fn after(signal: &[f64], span: usize) -> Vec<f64> {
    let pairs = signal.iter().zip(signal.iter().skip(span));
    pairs.map(|(a, b)| b - a).collect()
}

/// The size that this share of a signal does not exceed.
fn usual_size(signal: &[Vec<f64>], share: f64) -> f64 {
    let mut sizes: Vec<f64> = signal.iter().flatten().map(|x| x.abs()).collect();
    sizes.sort_by(f64::total_cmp);
    let place = (share * sizes.len() as f64) as usize;
    sizes.get(place).copied().unwrap_or(0.0)
}

/// How far positions go over as few samples as make that more than their noise in all but this share, and how many those are.
fn ways(y: &[Vec<f64>], noise: f64, share: f64) -> (Vec<Vec<f64>>, usize) {
    let longest = y.iter().map(Vec::len).max().unwrap_or(0) / 8;
    let mut span = 1;
    loop {
        let ways: Vec<Vec<f64>> = y.iter().map(|y| after(y, span)).collect();
        if usual_size(&ways, share) > MOVES * noise || 2 * span > longest {
            return (ways, span);
        }
        span *= 2;
    }
}

/// How often a signal crosses its middle, by `least` or more.
fn crossings(signal: &[Vec<f64>], least: f64) -> usize {
    let mut crossings = 0;
    for y in signal {
        let n = y.len().max(1) as f64;
        let mean = y.iter().sum::<f64>() / n;
        let deviation = (y.iter().map(|y| (y - mean).powi(2)).sum::<f64>() / n).sqrt();
        let mut side = 0.0;
        for y in y {
            let now = y - mean;
            if now.abs() > least.max(CROSSED * deviation) {
                if side * now < 0.0 {
                    crossings += 1;
                }
                side = now;
            }
        }
    }
    crossings
}

#[cfg(test)]
mod tests {
    use super::idle::tests::of_one_position;
    use super::*;

    /// A position that swings at `frequency`, Hz, under an input that does, over `duration` s.
    fn swing(frequency: f64, interval: f64, duration: f64) -> Observations {
        let t: Vec<f64> = (0..(duration / interval) as usize)
            .map(|k| k as f64 * interval)
            .collect();
        let wave = |phase: f64| -> Vec<f64> {
            let angle = |t: &f64| std::f64::consts::TAU * (frequency * t) + phase;
            t.iter().map(|t| angle(t).sin()).collect()
        };
        let (y, u) = (wave(0.0), wave(1.0));
        of_one_position(t, y, u)
    }

    #[test]
    fn the_pace_of_a_motion_that_is_twice_as_slow_over_twice_the_time_is_half() {
        for slower in [16.0, 256.0, 4096.0] {
            let slow = |more: f64| {
                let s = slower * more;
                Pace::of(&swing(0.9 / s, 0.02 * s, 60.0 * s)).times()
            };
            assert_eq!(slow(2.0), 2.0 * slow(1.0));
            let off = slow(1.0) / slower;
            assert!((0.5..=2.0).contains(&off), "{slower} times as slow: {off}");
        }
    }

    #[test]
    fn a_cart_poles_windows_are_the_usual_ones_and_a_resonators_are_of_five_periods() {
        for (frequency, duration) in [(0.5, 60.0), (0.9, 60.0), (0.9, 600.0), (3.0, 12.0)] {
            let window = Pace::of(&swing(frequency, 0.02, duration)).window();
            assert_eq!(window, WINDOW_S, "{frequency} Hz over {duration} s");
        }
        let window = Pace::of(&swing(60.0, 1e-3, 20.0)).window();
        assert!((window - 5.0 / 60.0).abs() < 1e-3, "{window}");
    }

    #[test]
    fn a_sample_takes_steps_of_ten_milliseconds_and_two_of_them_unless_it_is_close() {
        let pace = Pace::of(&swing(0.9, 0.02, 60.0));
        assert_eq!(pace.times(), 1.0);
        for (interval, steps, of_stiff) in [
            (0.002, 1, 1),
            (0.005, 1, 2),
            (0.0051, 2, 3),
            (0.02, 2, 8),
            (0.1, 10, 40),
        ] {
            let found = [false, true].map(|stiff| pace.first_steps(interval, stiff));
            assert_eq!(found, [steps, of_stiff], "{interval}");
        }
    }

    #[test]
    fn few_windows_are_shorter() {
        let window = Pace::of(&swing(60.0, 1e-3, 1.0)).window();
        assert!((0.5 / 60.0..1.0 / 40.0).contains(&window), "{window}");
        for (frequency, interval, duration) in [(8.0, 2.5e-3, 5.0), (0.9, 0.02, 6.0)] {
            let window = Pace::of(&swing(frequency, interval, duration)).window();
            let windows = duration / window;
            assert!((18.0..80.0).contains(&windows), "{frequency}: {windows}");
        }
    }

    /// Swings of 1.5 s, begun every 60 s, have the pace of one that goes on and on.
    #[test]
    fn what_rests_between_pushes_has_the_pace_of_its_motion() {
        let swings = swing(1.2, 0.01, 600.0);
        let mut rests = swings.clone();
        let run = &mut rests.runs[0];
        for k in 0..run.t.len() {
            let moves = f64::from(u8::from(k % 6000 < 150));
            // A fiftieth of the swing is noise.
            run.y[0][k] = moves * run.y[0][k] + 0.02 * crate::bins::pseudo(k, 0.3);
            run.u[0][k] *= moves;
        }
        rests.channels[0].noise = 0.02;
        let (swings, rests) = (Pace::of(&swings), Pace::of(&rests));
        assert!(rests.rests() && !swings.rests());
        assert_eq!(rests.window(), swings.window());
    }

    /// One of a thousand times the time, but its input changes as fast as ever.
    #[test]
    fn what_is_pushed_fast_is_hardly_slow() {
        let mut observations = swing(1e-3, 0.02, 1000.0);
        let fast = swing(0.9, 0.02, 1000.0).runs.remove(0).u;
        assert!(Pace::of(&observations).times() > 8.0);
        observations.runs[0].u = fast;
        assert!(Pace::of(&observations).times() <= 2.0);
    }
}
