//! The gap in words, tables and a figure: by coordinate, by horizon, by region; and what the fits leave.

use plotly::common::{DashType, Line, Marker, Mode};
use plotly::layout::AxisType;
use plotly::{Plot, Scatter};

use super::figures::{AFTER, BEFORE, Figure, MEASURED, axis, drawn, layout};
use super::words::{number, percent, short, with_unit};
use crate::diagnose::verdict::{Diagnosis, Gap, RegionErrors};

/// One coordinate's gap.
pub struct GapRow {
    pub name: String,
    pub before: String,
    pub after: String,
    pub starts: String,
    pub noise: String,
    pub left: String,
    pub total: bool,
}

/// The gap over one horizon.
pub struct HorizonRow {
    pub horizon: String,
    pub runs: String,
    pub before: String,
    pub after: String,
    pub starts: String,
}

/// The errors inside and outside of a region.
pub struct RegionRow {
    pub coordinate: String,
    pub region: String,
    pub inside: String,
    pub outside: String,
}

/// What the fits leave of one channel.
pub struct ResidualRow {
    pub name: String,
    pub before: String,
    pub after: String,
}

/// What the table of the gap is about.
pub fn sentence(gap: &Gap) -> String {
    if gap.windows == 0 {
        return "No free run was possible on data held out.".to_owned();
    }
    format!(
        "Root-mean-square errors of {} free runs of {} s, each coordinate in units of its own sensor noise. Free runs start from an estimated state, whose error grows along them: so much the noise and the uncertain starts make by themselves, to first order.",
        gap.windows,
        short(gap.horizon_s)
    )
}

/// The gap by coordinate.
pub fn rows(gap: &Gap) -> Vec<GapRow> {
    let mut rows: Vec<GapRow> = gap
        .coordinates
        .iter()
        .map(|c| GapRow {
            name: c.name.strip_prefix("q.").unwrap_or(&c.name).to_owned(),
            before: number(c.before),
            after: number(c.after),
            starts: number(c.expected),
            noise: with_unit(number(c.noise), &c.unit),
            left: with_unit(number(c.after * c.noise), &c.unit),
            total: false,
        })
        .collect();
    if rows.len() > 1 {
        rows.push(GapRow {
            name: "all".to_owned(),
            before: number(gap.before),
            after: number(gap.after),
            starts: number(gap.expected),
            noise: String::new(),
            left: String::new(),
            total: true,
        });
    }
    rows
}

/// The gap by horizon.
pub fn horizons(gap: &Gap) -> Vec<HorizonRow> {
    let row = |h: &crate::diagnose::verdict::Horizon| HorizonRow {
        horizon: format!("{} s", short(h.horizon_s)),
        runs: match h.diverged {
            0 => h.windows.to_string(),
            n => format!("{} ({n} diverged)", h.windows),
        },
        before: number(h.before),
        after: number(h.after),
        starts: number(h.expected),
    };
    gap.horizons.iter().map(row).collect()
}

/// The gap by horizon, drawn; nothing to draw with fewer than two.
pub fn horizon_figure(gap: &Gap) -> Option<Figure> {
    let all = &gap.horizons;
    let drawable = |x: f64| x.is_finite() && x > 0.0;
    if all.len() < 2 || !all.iter().all(|h| drawable(h.before) && drawable(h.after)) {
        return None;
    }
    let at: Vec<String> = all
        .iter()
        .map(|h| format!("{} s", short(h.horizon_s)))
        .collect();
    let mut plot = Plot::new();
    let mut line = |name: &str, errors: Vec<f64>, color: &'static str, dash: DashType| {
        let line = Line::new().color(color).width(2.0).dash(dash);
        let trace = Scatter::new(at.clone(), errors).name(name).line(line);
        plot.add_trace(match color {
            MEASURED => trace.mode(Mode::Lines),
            _ => trace
                .mode(Mode::LinesMarkers)
                .marker(Marker::new().color(color).size(8)),
        });
    };
    let before = all.iter().map(|h| h.before).collect();
    line("model as given", before, BEFORE, DashType::Dash);
    let after = all.iter().map(|h| h.after).collect();
    line("new model", after, AFTER, DashType::Solid);
    if all.iter().all(|h| drawable(h.expected)) {
        let expected = all.iter().map(|h| h.expected).collect();
        line("noise and starts alone", expected, MEASURED, DashType::Dot);
    }
    let what = "error, times the sensor noise";
    let y = axis(what).type_(AxisType::Log).dtick(1.0);
    Some(Figure {
        title: "Error by length of the free run".to_owned(),
        html: drawn(
            plot,
            layout("length of the free run", what).y_axis(y),
            "horizons",
        ),
    })
}

/// The gap by region.
pub fn regions(gap: &Gap) -> Vec<RegionRow> {
    let errors = |e: &RegionErrors| format!("{} → {}", number(e.before), number(e.after));
    gap.regions
        .iter()
        .map(|r| {
            let ranges: Vec<String> = r
                .ranges
                .iter()
                .map(|[from, to]| format!("{} to {}", number(*from), number(*to)))
                .collect();
            RegionRow {
                coordinate: r.coordinate.clone(),
                region: format!(
                    "{} {}: {} of the squared force in {} of the time",
                    r.signal,
                    with_unit(ranges.join(" or "), &r.unit),
                    percent(r.force_share),
                    percent(r.time_share)
                ),
                inside: errors(&r.inside),
                outside: errors(&r.outside),
            }
        })
        .collect()
}

/// What the fits leave.
pub fn residuals(diagnosis: &Diagnosis) -> Vec<ResidualRow> {
    let said = |r: &crate::diagnose::verdict::Residual| ResidualRow {
        name: r.name.clone(),
        before: number(r.before),
        after: number(r.after),
    };
    diagnosis.residuals.iter().map(said).collect()
}
