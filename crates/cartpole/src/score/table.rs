//! The tables of many lines, as Markdown.

use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};
use std::fmt::Write;

use super::line::{Line, Named, Truth};
use super::statistics::{quantile, wilson};
use super::{Rig, Set};
use crate::config::NoiseLevel;

/// Upper ends of the bins of confidence.
const BINS: [f64; 7] = [0.5, 0.6, 0.7, 0.8, 0.9, 0.99, 1.0];
/// Parameters that have no size of their own: an error relative to them says nothing.
const WITHOUT_SIZE: [&str; 2] = ["rest", "phase"];

/// All tables: rates by set, each kind with what it was called, calibration, parameters, free runs.
///
/// A name counts as right when it is that of a hidden effect, or when the diagnosis says that the data cannot tell it from one.
pub fn tables(lines: &[Line]) -> String {
    let parts = [
        rates(lines),
        kinds(lines),
        calibration(lines),
        parameters(lines),
        free_runs(lines),
        failures(lines),
    ];
    let parts: Vec<String> = parts.into_iter().filter(|part| !part.is_empty()).collect();
    parts.join("\n")
}

fn noise_name(noise: NoiseLevel) -> &'static str {
    match noise {
        NoiseLevel::Low => "low",
        NoiseLevel::Realistic => "realistic",
        NoiseLevel::High => "high",
    }
}

/// `low`, or `low, 1000 Hz` where the rate is not the usual one.
fn conditions(line: &Line) -> String {
    let noise = noise_name(line.noise);
    line.rate
        .map_or_else(|| noise.to_owned(), |rate| format!("{noise}, {rate} Hz"))
}

/// `0.95 (0.90–0.98)`, the share with its 95 % interval; `–` of none.
fn share(hits: usize, of: usize) -> String {
    if of == 0 {
        return "–".into();
    }
    let (low, high) = wilson(hits, of);
    format!("{:.3} ({low:.2}–{high:.2})", hits as f64 / of as f64)
}

/// Lines of one rig, set, noise and rate together; the key keeps the order of the sets.
fn groups(lines: &[Line]) -> BTreeMap<(Rig, Set, usize, Option<u32>), Vec<&Line>> {
    let mut groups: BTreeMap<_, Vec<&Line>> = BTreeMap::new();
    for line in lines {
        let key = (line.rig, line.set, line.noise as usize, line.rate);
        groups.entry(key).or_default().push(line);
    }
    groups
}

fn count(lines: &[&Line], holds: impl Fn(&Line) -> bool) -> usize {
    lines.iter().filter(|line| holds(line)).count()
}

fn rates(lines: &[Line]) -> String {
    let mut text = String::from(
        "## Rates\n\n\
         | rig | set | noise, rate | logs | first name right | exact set | named nothing | names where nothing is hidden | wrong with > 0.9 | something left unexplained | s a log: median, p90 | MB |\n\
         |---|---|---|---|---|---|---|---|---|---|---|---|\n",
    );
    for group in groups(lines).values() {
        let Some(first) = group.first() else { continue };
        let n = group.len();
        let empty = count(group, |l| l.hidden.is_empty());
        let hidden = n - empty;
        let seconds: Vec<f64> = group.iter().map(|l| l.seconds).collect();
        let most = group.iter().filter_map(|l| l.peak_mb).fold(0.0, f64::max);
        let _ = writeln!(
            text,
            "| {} | {} | {} | {n} | {} | {} | {} | {} | {} | {} | {:.2}, {:.2} | {} |",
            first.rig.name(),
            first.set.name(),
            conditions(first),
            share(count(group, Line::first_is_right), hidden),
            share(
                count(group, |l| !l.hidden.is_empty() && l.is_exact()),
                hidden
            ),
            share(
                count(group, |l| !l.hidden.is_empty() && l.named.is_empty()),
                hidden
            ),
            share(
                count(group, |l| l.hidden.is_empty() && !l.named.is_empty()),
                empty
            ),
            count(group, Line::is_confidently_wrong),
            share(count(group, |l| l.unexplained), n),
            quantile(&seconds, 0.5),
            quantile(&seconds, 0.9),
            if most > 0.0 {
                format!("{most:.0}")
            } else {
                "–".into()
            },
        );
    }
    text
}

/// Each hidden kind of the sets with one effect: how often its name was the first at each noise, and what else it was called.
fn kinds(lines: &[Line]) -> String {
    let mut rows: BTreeMap<(Rig, Set, String), Row> = BTreeMap::new();
    for line in lines.iter().filter(|l| l.error.is_none()) {
        let [truth] = line.hidden.as_slice() else {
            continue;
        };
        let key = (
            line.rig,
            line.set,
            format!("{} on {}", truth.kind, truth.target),
        );
        let row = rows.entry(key).or_default();
        let seen = &mut row.seen[line.noise as usize];
        seen.0 += 1;
        seen.1 += usize::from(line.first_is_right());
        row.exact += usize::from(line.is_exact());
        let called = match line.named.first() {
            Some(first) if first.is_exactly(truth) => continue,
            Some(first) => format!("{} on {}", first.kind, first.target),
            None => line.verdict.clone(),
        };
        *row.called.entry(called).or_default() += 1;
    }
    if rows.is_empty() {
        return String::new();
    }
    let mut text = String::from(
        "## First names by hidden kind\n\n\
         | rig | set | hidden | low | realistic | high | exact | called otherwise |\n|---|---|---|---|---|---|---|---|\n",
    );
    for ((rig, set, hidden), row) in &rows {
        let of = |k: usize| {
            let (n, right) = row.seen[k];
            if n == 0 {
                "–".into()
            } else {
                format!("{right}/{n}")
            }
        };
        let n: usize = row.seen.iter().map(|s| s.0).sum();
        let called: Vec<String> = row
            .called
            .iter()
            .map(|(name, n)| format!("{name} ×{n}"))
            .collect();
        let _ = writeln!(
            text,
            "| {} | {} | {hidden} | {} | {} | {} | {}/{n} | {} |",
            rig.name(),
            set.name(),
            of(0),
            of(1),
            of(2),
            row.exact,
            called.join(", ")
        );
    }
    text
}

#[derive(Default)]
struct Row {
    /// Logs, and right first names, by noise level.
    seen: [(usize, usize); 3],
    exact: usize,
    called: BTreeMap<String, usize>,
}

/// What an effect that is in no library is called cannot be right: such logs, and those with disturbances that are there but not listed,
/// tell nothing of calibration.
fn tells_of_calibration(line: &Line) -> bool {
    !matches!(line.set, Set::Removed | Set::Dirty | Set::Forms)
}

fn calibration(lines: &[Line]) -> String {
    let judged: Vec<(f64, bool)> = lines
        .iter()
        .filter(|l| tells_of_calibration(l))
        .flat_map(|l| l.judged().map(|(named, right)| (named.confidence, right)))
        .collect();
    if judged.is_empty() {
        return String::new();
    }
    let mut text = String::from(
        "## Calibration\n\nEvery name given, without the sets `removed`, `forms` and `dirty`.\n\n\
         | confidence | names | mean confidence | right |\n|---|---|---|---|\n",
    );
    let (mut low, mut error) = (0.0, 0.0);
    for high in BINS {
        let last = high == 1.0;
        let bin: Vec<&(f64, bool)> = judged
            .iter()
            .filter(|(c, _)| *c >= low && (*c < high || last))
            .collect();
        if !bin.is_empty() {
            let n = bin.len();
            let mean = bin.iter().map(|(c, _)| c).sum::<f64>() / n as f64;
            let right = bin.iter().filter(|(_, right)| *right).count();
            error += (right as f64 - mean * n as f64).abs();
            let _ = writeln!(
                text,
                "| {low}–{high} | {n} | {mean:.3} | {} |",
                share(right, n)
            );
        }
        low = high;
    }
    let _ = writeln!(
        text,
        "\nExpected calibration error {:.4} over {} names.",
        error / judged.len() as f64,
        judged.len()
    );
    text
}

/// Estimate and truth of the parameters of the names that are exactly right.
#[derive(Default)]
struct Estimates {
    relative: Vec<f64>,
    /// With a standard error, and those of them whose 95 % interval has the truth.
    with_error: usize,
    covered: usize,
}

impl Estimates {
    fn note(&mut self, named: &Named, truth: &Truth, name: &str) {
        let (Some(&(value, std)), Some(&true_value)) =
            (named.parameters.get(name), truth.parameters.get(name))
        else {
            return;
        };
        let mut value = value;
        if named.kind == "periodic_force" {
            // −A sin θ is A sin (θ + π).
            let negative = named
                .parameters
                .get("amplitude")
                .is_some_and(|(a, _)| *a < 0.0);
            match name {
                "amplitude" => value = value.abs(),
                "phase" => {
                    let turned = if negative { value + PI } else { value };
                    let off = turned - true_value;
                    value = true_value + off - TAU * (off / TAU).round();
                }
                _ => {}
            }
        }
        let off = (value - true_value).abs();
        if !WITHOUT_SIZE.contains(&name) && true_value != 0.0 {
            self.relative.push(off / true_value.abs());
        }
        if let Some(std) = std {
            self.with_error += 1;
            self.covered += usize::from(off <= 1.96 * std);
        }
    }

    fn row(&self, name: &str) -> String {
        let percent = |q: f64| match self.relative.is_empty() {
            true => "–".to_owned(),
            false => format!("{:.2} %", 100.0 * quantile(&self.relative, q)),
        };
        format!(
            "| {name} | {} | {} | {} | {} |\n",
            self.with_error.max(self.relative.len()),
            percent(0.5),
            percent(0.9),
            share(self.covered, self.with_error)
        )
    }
}

fn parameters(lines: &[Line]) -> String {
    let mut by_parameter: BTreeMap<String, Estimates> = BTreeMap::new();
    let mut by_noise: BTreeMap<usize, (NoiseLevel, Estimates)> = BTreeMap::new();
    let mut all = Estimates::default();
    // Where masses are wrong or laws have another form, there is no true value to be found.
    let counts = |l: &&Line| matches!(l.set, Set::One | Set::Pairs | Set::Triples);
    for line in lines.iter().filter(counts) {
        for truth in &line.hidden {
            let Some(named) = line.named.iter().find(|n| n.is_exactly(truth)) else {
                continue;
            };
            for name in truth.parameters.keys() {
                let key = format!("{} {}.{name}", line.rig.name(), truth.kind);
                by_parameter
                    .entry(key)
                    .or_default()
                    .note(named, truth, name);
                let of_noise = by_noise
                    .entry(line.noise as usize)
                    .or_insert_with(|| (line.noise, Estimates::default()));
                of_noise.1.note(named, truth, name);
                all.note(named, truth, name);
            }
        }
    }
    by_parameter.retain(|_, e| e.with_error + e.relative.len() > 0);
    if by_parameter.is_empty() {
        return String::new();
    }
    let mut text = String::from(
        "## Parameters\n\nOf the names that are right, in the sets `one`, `pairs` and `triples`.\n\n\
         | parameter | n | relative error: median | p90 | truth within ± 1.96 std |\n|---|---|---|---|---|\n",
    );
    text += &all.row("**all**");
    for (noise, estimates) in by_noise.values() {
        text += &estimates.row(&format!("**noise {}**", noise_name(*noise)));
    }
    for (name, estimates) in &by_parameter {
        text += &estimates.row(name);
    }
    text
}

fn free_runs(lines: &[Line]) -> String {
    let mut text = String::from(
        "## Free runs of 0.6 s\n\nOn a recording that the diagnosis has not had, in units of the sensors' noise; the last columns over the error of the true model.\n\n\
         | rig | set | noise | logs | before | after | true model | after/true: median | p90 |\n|---|---|---|---|---|---|---|---|---|\n",
    );
    let mut any = false;
    for group in groups(lines).values() {
        let Some(first) = group.first() else { continue };
        let runs: Vec<_> = group.iter().filter_map(|l| l.free_run).collect();
        if runs.is_empty() {
            continue;
        }
        any = true;
        let before: Vec<f64> = runs.iter().map(|r| r.before).collect();
        let after: Vec<f64> = runs.iter().map(|r| r.after).collect();
        let truth: Vec<f64> = runs.iter().filter_map(|r| r.truth).collect();
        let ratio: Vec<f64> = runs
            .iter()
            .filter_map(|r| Some(r.after / r.truth?))
            .collect();
        let number = |values: &[f64], q: f64| match values.is_empty() {
            true => "–".to_owned(),
            false => format!("{:.3}", quantile(values, q)),
        };
        let _ = writeln!(
            text,
            "| {} | {} | {} | {} | {} | {} | {} | {} | {} |",
            first.rig.name(),
            first.set.name(),
            conditions(first),
            runs.len(),
            number(&before, 0.5),
            number(&after, 0.5),
            number(&truth, 0.5),
            number(&ratio, 0.5),
            number(&ratio, 0.9),
        );
    }
    if any { text } else { String::new() }
}

fn failures(lines: &[Line]) -> String {
    let mut text = String::new();
    for line in lines {
        if let Some(error) = &line.error {
            let _ = writeln!(text, "- {}: {error}", line.id);
        }
    }
    if text.is_empty() {
        return text;
    }
    format!("## Diagnoses that failed\n\n{text}")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(seed: u64, named: Option<(&str, f64)>) -> Line {
        let truth = Truth {
            kind: "viscous_friction".into(),
            target: "slider".into(),
            parameters: BTreeMap::from([("coefficient".to_owned(), 0.5)]),
        };
        Line {
            id: format!("cartpole/one/low/{seed}"),
            rig: Rig::Cartpole,
            set: Set::One,
            noise: NoiseLevel::Low,
            seed,
            duration: 60.0,
            rate: None,
            hidden: vec![truth],
            size: 1.0,
            verdict: "effects_found".into(),
            unexplained: false,
            named: named
                .into_iter()
                .map(|(kind, confidence)| Named {
                    kind: kind.into(),
                    target: "slider".into(),
                    confidence,
                    parameters: BTreeMap::from([("coefficient".to_owned(), (0.51, Some(0.004)))]),
                    alternatives: vec![],
                    indistinguishable_from: vec![],
                })
                .collect(),
            data_faults: vec![],
            gap: Some([3.0, 1.2]),
            residual: Some([2.0, 1.1]),
            free_run: None,
            seconds: 1.0,
            threads: 1,
            peak_mb: None,
            error: None,
        }
    }

    #[test]
    fn rates_calibration_and_coverage_are_those_counted_by_hand() {
        let lines = [
            line(1, Some(("viscous_friction", 0.95))),
            line(2, Some(("quadratic_drag", 0.95))),
            line(3, None),
            line(4, Some(("viscous_friction", 0.55))),
        ];
        let text = tables(&lines);
        // Two of four first names; one wrong above 0.9.
        assert!(
            text.contains("| cartpole | one | low | 4 | 0.500 ("),
            "{text}"
        );
        assert!(
            text.contains("| 1 | 0.000"),
            "one confidently wrong: {text}"
        );
        assert!(
            text.contains("quadratic_drag on slider ×1") && text.contains("effects_found ×1"),
            "{text}"
        );
        // |1 − 2·0.95| + |1 − 0.55| over three names.
        assert!(text.contains("error 0.4500 over 3"), "{text}");
        // 0.51 ± 0.008 has not 0.5.
        assert!(
            text.contains("| cartpole viscous_friction.coefficient | 2 | 2.00 % | 2.00 % | 0.000"),
            "{text}"
        );
    }

    #[test]
    fn a_name_said_to_be_indistinguishable_from_the_truth_is_right() {
        let mut tied = line(1, Some(("quadratic_drag", 0.9)));
        assert!(!tied.first_is_right());
        let name = super::super::line::Name {
            kind: "viscous_friction".into(),
            target: "slider".into(),
        };
        tied.named[0].indistinguishable_from.push(name);
        assert!(tied.first_is_right() && tied.is_exact());
        // Two names for one hidden effect are one too many.
        tied.named.push(tied.named[0].clone());
        assert!(!tied.is_exact());
    }
}
