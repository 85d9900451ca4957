//! A diagnosis in a few lines.

use std::fmt::Write;

use crate::diagnose::verdict::{Diagnosis, Gap, Name, NamedEffect};
use crate::report::verdict_in_words;
use crate::report::words::{is_flag, number, percent, quantity, with_unit};

/// Less probable alternatives are left to the document.
const LEAST_ALTERNATIVE: f64 = 0.005;

/// The verdict, the effects, the gap, faults and advice, as text for a terminal.
pub fn summary(diagnosis: &Diagnosis) -> String {
    let mut out = format!("{}\n", verdict_in_words(diagnosis));
    if !diagnosis.effects.is_empty() {
        out.push_str("\neffects added:\n");
    }
    for effect in &diagnosis.effects {
        write_effect(&mut out, effect);
    }
    if let Some(unexplained) = &diagnosis.unexplained {
        out.push_str("\nwhat no effect explains:\n");
        for sentence in &unexplained.sentences {
            let _ = writeln!(out, "  {sentence}");
        }
    }
    write_gap(&mut out, &diagnosis.gap);
    // Writing to a String cannot fail.
    if !diagnosis.data_faults.is_empty() {
        out.push_str("\nfaults of the data:\n");
    }
    for fault in &diagnosis.data_faults {
        let _ = writeln!(
            out,
            "  {} in {}: {}",
            fault.kind, fault.column, fault.detail
        );
    }
    if !diagnosis.excitation.sentences.is_empty() {
        out.push_str("\nwhat these data can show:\n");
    }
    for sentence in &diagnosis.excitation.sentences {
        let _ = writeln!(out, "  {sentence}");
    }
    if !diagnosis.advice.is_empty() {
        out.push_str("\nadvice:\n");
    }
    for advice in &diagnosis.advice {
        let _ = writeln!(out, "  {advice}");
    }
    out
}

fn write_effect(out: &mut String, effect: &NamedEffect) {
    let _ = writeln!(
        out,
        "  {} on {}, confidence {}",
        effect.kind,
        effect.target,
        percent(effect.confidence)
    );
    for (name, value) in &effect.parameters {
        let value = match is_flag(effect, name) {
            true => "yes".to_owned(),
            false => quantity(value),
        };
        let _ = writeln!(out, "    {name} = {value}");
    }
    let others: Vec<String> = effect
        .alternatives
        .iter()
        .filter(|a| a.confidence >= LEAST_ALTERNATIVE)
        .map(|a| format!("{} on {} ({})", a.kind, a.target, percent(a.confidence)))
        .collect();
    if !others.is_empty() {
        let _ = writeln!(out, "    else: {}", others.join(", "));
    }
    let name = |n: &Name| format!("{} on {}", n.kind, n.target);
    let ties: Vec<String> = effect.indistinguishable_from.iter().map(name).collect();
    if !ties.is_empty() {
        let _ = writeln!(
            out,
            "    these data cannot tell it from: {}",
            ties.join(", ")
        );
    }
}

fn write_gap(out: &mut String, gap: &Gap) {
    if gap.windows == 0 {
        return;
    }
    let _ = writeln!(
        out,
        "\nfree runs of {} s over {} windows that no fit has seen, error in units of the sensor noise, and what the noise and the uncertain starts make of it by themselves:",
        number(gap.horizon_s),
        gap.windows
    );
    let mut rows =
        vec![["coordinate", "before", "after", "starts", "noise", "left"].map(str::to_owned)];
    for c in &gap.coordinates {
        let [noise, left] = [c.noise, c.after * c.noise].map(|x| with_unit(number(x), &c.unit));
        rows.push([
            c.name.clone(),
            number(c.before),
            number(c.after),
            number(c.expected),
            noise,
            left,
        ]);
    }
    if gap.coordinates.len() > 1 {
        let [before, after, starts] = [gap.before, gap.after, gap.expected].map(number);
        let none = String::new;
        rows.push(["all".into(), before, after, starts, none(), none()]);
    }
    let width = rows.iter().map(|r| r[0].chars().count()).max().unwrap_or(0);
    for [name, before, after, starts, noise, left] in &rows {
        let line = format!(
            "  {name:width$}  {before:>9}  {after:>9}  {starts:>9}  {noise:>14}  {left:>14}"
        );
        let _ = writeln!(out, "{}", line.trim_end());
    }
}
