//! The page: what the template `templates/report.html` shows, in words.
//!
//! The template escapes every value but the figures, which `figures` makes safe, and plotly.js.

use askama::Template;

use super::figures::{self, Figure, ShownRun};
use super::gaps::{self, GapRow, HorizonRow, RegionRow, ResidualRow};
use super::ruled_out::{self, RuledOut};
use super::sketch::{self, SketchText};
use super::words::{
    capital, interval, is_flag, number, percent, plain, quantity, short, uncertain, verdict,
    with_unit,
};
use crate::diagnose::curves::Curves;
use crate::diagnose::verdict::{
    Diagnosis, Evidence, Name, NamedEffect, Provenance, SearchStep, Verdict,
};

/// Intervals of a data fault that are listed.
const MOST_INTERVALS: usize = 6;
/// Coordinates with a smaller share of the disagreement, but for the first, are described and not drawn.
const DRAWN_SHARE: f64 = 0.05;

/// The page.
#[derive(Template)]
#[template(path = "report.html")]
pub struct Page<'a> {
    script: String,
    verdict: String,
    model: &'a str,
    sketch: Option<SketchText>,
    gap_sentence: String,
    gap: Vec<GapRow>,
    horizons: Vec<HorizonRow>,
    horizon_figure: Vec<Figure>,
    regions: Vec<RegionRow>,
    residuals: Vec<ResidualRow>,
    runs: Vec<ShownRun>,
    effects: Vec<EffectText>,
    advice: &'a [String],
    shows: &'a [String],
    unexplained: &'a [String],
    unexplained_figures: Vec<Figure>,
    places: Vec<Place>,
    constants: Vec<ConstantRow>,
    steps: Vec<Vec<CandidateRow>>,
    ruled_out: Vec<RuledOut>,
    alike: Vec<String>,
    /// Whether a found effect has names that these data cannot tell from it.
    tied: bool,
    faults: Vec<FaultRow<'a>>,
    /// Whether the faults of the data are the verdict.
    data_first: bool,
    command: &'a str,
    provenance: &'a Provenance,
    windows: String,
    model_toml: &'a str,
}

struct EffectText {
    title: String,
    parameters: Vec<(String, String, String)>,
    evidence: String,
    alternatives: String,
    ties: String,
}

struct Place {
    sentence: String,
    figures: Vec<Figure>,
}

struct ConstantRow {
    name: String,
    given: String,
    fitted: String,
    change: String,
    tolerance: String,
    tolerances: String,
}

struct CandidateRow {
    name: String,
    screen_gain: String,
    t2: String,
    z_fit: String,
    z_held_out: String,
    gain_fit: String,
    gain_held_out: String,
    wins: String,
    result: String,
    accepted: bool,
}

struct FaultRow<'a> {
    kind: String,
    column: &'a str,
    when: String,
    detail: &'a str,
}

impl<'a> Page<'a> {
    /// The page of a diagnosis.
    pub fn new(
        diagnosis: &'a Diagnosis,
        curves: &Curves,
        model_toml: &'a str,
        command: &'a str,
    ) -> Self {
        let provenance = &diagnosis.provenance;
        Page {
            script: figures::script(),
            verdict: verdict(diagnosis),
            model: &provenance.model,
            sketch: curves.sketch.as_ref().map(|s| sketch::text(s, diagnosis)),
            gap_sentence: gaps::sentence(&diagnosis.gap),
            gap: gaps::rows(&diagnosis.gap),
            horizons: gaps::horizons(&diagnosis.gap),
            horizon_figure: gaps::horizon_figure(&diagnosis.gap).into_iter().collect(),
            regions: gaps::regions(&diagnosis.gap),
            residuals: gaps::residuals(diagnosis),
            runs: figures::free_runs(diagnosis, curves),
            effects: diagnosis.effects.iter().map(effect).collect(),
            advice: &diagnosis.advice,
            shows: &diagnosis.excitation.sentences,
            unexplained: diagnosis
                .unexplained
                .as_ref()
                .map_or(&[], |u| u.sentences.as_slice()),
            unexplained_figures: diagnosis
                .unexplained
                .iter()
                .map(figures::unexplained)
                .collect(),
            places: places(diagnosis, curves),
            constants: constants(diagnosis),
            steps: diagnosis.search.iter().map(candidates).collect(),
            ruled_out: ruled_out::ruled_out(diagnosis),
            alike: ruled_out::alike(diagnosis),
            tied: diagnosis
                .effects
                .iter()
                .any(|e| !e.indistinguishable_from.is_empty()),
            faults: faults(diagnosis),
            data_first: diagnosis.verdict == Verdict::DataFault,
            command,
            provenance,
            windows: format!(
                "{} to fit, {} held out, {} s each",
                provenance.windows[0],
                provenance.windows[1],
                short(provenance.window_s)
            ),
            model_toml,
        }
    }
}

fn effect(effect: &NamedEffect) -> EffectText {
    let listed = |all: Vec<String>| all.join(", or ");
    EffectText {
        title: format!(
            "{} on {} ({})",
            capital(&plain(&effect.kind)),
            effect.target,
            percent(effect.confidence)
        ),
        parameters: effect
            .parameters
            .iter()
            .map(|(name, value)| {
                if is_flag(effect, name) {
                    return (plain(name), "yes".to_owned(), String::new());
                }
                let interval = match value.half_interval() {
                    Some(half) => with_unit(
                        interval([value.value - half, value.value + half], half),
                        &value.unit,
                    ),
                    None => "not determined by these data".to_owned(),
                };
                (plain(name), quantity(value), interval)
            })
            .collect(),
        evidence: format!(
            "With it the windows gain {} nats per sample, {} standard errors above 0; windows held out gain {}, {} standard errors.",
            number(effect.evidence.gain_fit),
            number(effect.evidence.z_fit),
            number(effect.evidence.gain_held_out),
            number(effect.evidence.z_held_out)
        ),
        alternatives: listed(
            effect
                .alternatives
                .iter()
                .map(|a| {
                    let (kind, share) = (plain(&a.kind), percent(a.confidence));
                    format!("{kind} on {} ({share})", a.target)
                })
                .collect(),
        ),
        ties: listed(effect.indistinguishable_from.iter().map(name).collect()),
    }
}

pub fn name(name: &Name) -> String {
    format!("{} on {}", plain(&name.kind), name.target)
}

fn places(diagnosis: &Diagnosis, curves: &Curves) -> Vec<Place> {
    diagnosis
        .disagreement
        .iter()
        .enumerate()
        .map(|(k, d)| Place {
            sentence: format!(
                "{}: {} of the disagreement. The model lacks {} (root mean square); {}.",
                d.coordinate,
                percent(d.share),
                with_unit(number(d.rms), &d.unit),
                d.r#where
            ),
            figures: curves
                .residuals
                .iter()
                .find(|r| r.coordinate == d.coordinate && (k == 0 || d.share >= DRAWN_SHARE))
                .map_or(Vec::new(), |r| figures::residual(r, d, k)),
        })
        .collect()
}

fn constants(diagnosis: &Diagnosis) -> Vec<ConstantRow> {
    diagnosis
        .constants
        .iter()
        .map(|c| {
            let change = 100.0 * (c.fitted - c.given) / c.given.abs();
            ConstantRow {
                name: plain(&c.name),
                given: short(c.given),
                fitted: uncertain(c.fitted, c.std),
                change: match change.is_finite() {
                    true => format!("{change:+.1} %"),
                    false => String::new(),
                },
                tolerance: number(c.tolerance),
                tolerances: match c.tolerance.is_finite() && c.tolerance > 0.0 {
                    true => format!("{:+.1}", c.tolerances()),
                    false => String::new(),
                },
            }
        })
        .collect()
}

/// The refined candidates, then what the screen saw and nobody refined.
fn candidates(step: &SearchStep) -> Vec<CandidateRow> {
    let screen = |kind: &str, target: &str| {
        let seen = |s: &&_| matches(s, kind, target);
        step.screened.iter().find(seen).map(|s| (s.gain, s.t2))
    };
    let refined = step.refined.iter().enumerate().map(|(k, r)| {
        let names: Vec<String> = r.names.iter().map(name).collect();
        let single = match r.names.as_slice() {
            [one] => screen(&one.kind, &one.target),
            _ => None, // a pair is screened as a pair
        };
        let result = match r.accepted {
            true => "added".to_owned(),
            false => format!("not added: {}", ruled_out::reason(step, k)),
        };
        row(
            names.join(" and "),
            single,
            Some((r.evidence, r.wins)),
            result,
            r.accepted,
        )
    });
    let others = step.screened.iter().filter(|s| {
        let same = |n: &Name| n.kind == s.kind && n.target == s.target;
        let refined = |names: &[Name]| names.len() == 1 && names.iter().any(same);
        !step.refined.iter().any(|r| refined(&r.names))
    });
    let others = others.map(|s| {
        row(
            format!("{} on {}", plain(&s.kind), s.target),
            Some((s.gain, s.t2)),
            None,
            "not refined".to_owned(),
            false,
        )
    });
    refined.chain(others).collect()
}

fn matches(s: &crate::diagnose::verdict::ScreenedName, kind: &str, target: &str) -> bool {
    s.kind == kind && s.target == target
}

fn row(
    name: String,
    screen: Option<(f64, f64)>,
    refined: Option<(Evidence, f64)>,
    result: String,
    accepted: bool,
) -> CandidateRow {
    let or_dash = |x: Option<f64>| number(x.unwrap_or(f64::NAN));
    let evidence = refined.map(|r| r.0);
    CandidateRow {
        name,
        screen_gain: or_dash(screen.map(|s| s.0)),
        t2: or_dash(screen.map(|s| s.1)),
        z_fit: or_dash(evidence.map(|e| e.z_fit)),
        z_held_out: or_dash(evidence.map(|e| e.z_held_out)),
        gain_fit: or_dash(evidence.map(|e| e.gain_fit)),
        gain_held_out: or_dash(evidence.map(|e| e.gain_held_out)),
        wins: percent(refined.map_or(f64::NAN, |r| r.1)),
        result,
        accepted,
    }
}

fn faults(diagnosis: &Diagnosis) -> Vec<FaultRow<'_>> {
    diagnosis
        .data_faults
        .iter()
        .map(|fault| {
            let mut when: Vec<String> = fault
                .when
                .iter()
                .take(MOST_INTERVALS)
                .map(|&[from, to]| match from == to {
                    true => format!("{from:.2}"),
                    false => format!("{from:.2} to {to:.2}"),
                })
                .collect();
            if fault.when.len() > MOST_INTERVALS {
                when.push(format!("and {} more", fault.when.len() - MOST_INTERVALS));
            }
            FaultRow {
                kind: plain(&fault.kind),
                column: &fault.column,
                when: when.join(", "),
                detail: &fault.detail,
            }
        })
        .collect()
}
