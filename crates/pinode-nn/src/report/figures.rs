//! The figures: free runs, and the force that the model lacks.

use plotly::color::Rgba;
use plotly::common::{
    Anchor, DashType, ErrorData, ErrorType, Font, Line, Marker, Mode, Orientation,
};
use plotly::configuration::DisplayModeBar;
use plotly::layout::{Axis, HoverMode, Legend, Margin, Shape, ShapeLayer, ShapeLine, ShapeType};
use plotly::{Bar, Configuration, Layout, Plot, Scatter};

use crate::diagnose::curves::{Curves, FreeRun, ResidualForce};
use crate::diagnose::verdict::{Diagnosis, Disagreement, Unexplained};

/// More points of one curve are thinned out.
const MOST_POINTS: usize = 2000;
/// More signals are not shown in a bar chart.
const MOST_SIGNALS: usize = 8;

pub const MEASURED: &str = "#8a8f94";
pub const BEFORE: &str = "#d95f02";
pub const AFTER: &str = "#1b87c9";
/// Reads on white and on black.
pub const TEXT: &str = "#80868c";

/// A figure and what it shows.
#[derive(Debug, Clone)]
pub struct Figure {
    /// In words.
    pub title: String,
    /// A `div` and the script that draws in it.
    pub html: String,
}

/// plotly.js, in a `script` element. What else the crate brings is for formulas, of which there are none.
pub fn script() -> String {
    let all = Plot::offline_js_sources();
    let end = "</script>";
    match all.split_once(end) {
        Some((plotly, _)) => format!("{}{end}", plotly.trim_start()),
        None => all,
    }
}

/// A free run chosen to be shown: its figures, one a coordinate.
pub struct ShownRun {
    /// Which it is, and its errors.
    pub title: String,
    /// One a coordinate.
    pub figures: Vec<Figure>,
}

/// The free run in which the error fell by the median factor, and the one with the largest error left.
pub fn free_runs(diagnosis: &Diagnosis, curves: &Curves) -> Vec<ShownRun> {
    let gaps = &diagnosis.gap.coordinates;
    let noise: Vec<f64> = gaps.iter().map(|g| g.noise).collect();
    let mut runs: Vec<(&FreeRun, f64, f64)> = curves
        .free_runs
        .iter()
        .map(|run| {
            let before = error(run, &noise, |c| &c.before);
            (run, before, error(run, &noise, |c| &c.after))
        })
        .filter(|(_, before, after)| !before.is_nan() && !after.is_nan())
        .collect();
    runs.sort_by(|a, b| improvement(a.1, a.2).total_cmp(&improvement(b.1, b.2)));
    let median = runs.len() / 2;
    let worst = (0..runs.len()).max_by(|&a, &b| runs[a].2.total_cmp(&runs[b].2));
    let mut chosen = vec![("A typical one (median improvement)", median)];
    chosen.extend(
        worst
            .filter(|&w| w != median)
            .map(|w| ("The worst one (largest error left)", w)),
    );
    chosen
        .into_iter()
        .filter_map(|(which, k)| Some((which, k, runs.get(k)?)))
        .map(|(which, k, (run, before, after))| ShownRun {
            title: format!(
                "{which}: recording {}, from {} s; error {} before, {} after",
                run.run + 1,
                super::words::short(run.start),
                times_noise(*before),
                times_noise(*after)
            ),
            figures: run
                .coordinates
                .iter()
                .enumerate()
                .map(|(c, _)| {
                    let (name, unit) = gaps.get(c).map_or(("", ""), |g| {
                        (
                            g.name.strip_prefix("q.").unwrap_or(&g.name),
                            g.unit.as_str(),
                        )
                    });
                    Figure {
                        title: name.to_owned(),
                        html: free_run(run, c, &label(name, unit), &format!("free-run-{k}-{c}")),
                    }
                })
                .collect(),
        })
        .collect()
}

fn times_noise(error: f64) -> String {
    match error.is_infinite() {
        true => "diverges".to_owned(),
        false => super::words::number(error),
    }
}

/// Root mean square over the free part and the coordinates, in units of the noise; infinite where the curve diverged.
fn error(
    run: &FreeRun,
    noise: &[f64],
    curve: fn(&crate::diagnose::curves::FreeRunCoordinate) -> &Vec<f64>,
) -> f64 {
    let mut sum = 0.0;
    let mut count = 0usize;
    for (c, coordinate) in run.coordinates.iter().enumerate() {
        let noise = noise.get(c).copied().unwrap_or(1.0);
        if curve(coordinate).is_empty() {
            return f64::INFINITY;
        }
        let pairs = coordinate.measured.iter().zip(curve(coordinate));
        for ((y, s), counts) in pairs.zip(&coordinate.counts) {
            let square = ((y - s) / noise).powi(2);
            if *counts && square.is_finite() {
                sum += square;
                count += 1;
            }
        }
    }
    (sum / count as f64).sqrt() // no sample: NaN, and the run is not shown
}

/// By what factor an error fell.
fn improvement(before: f64, after: f64) -> f64 {
    match (before.is_infinite(), after.is_infinite()) {
        (true, true) => 1.0,
        (_, true) => 0.0,
        _ => before / after.max(f64::MIN_POSITIVE),
    }
}

fn free_run(run: &FreeRun, c: usize, label: &str, id: &str) -> String {
    let mut plot = Plot::new();
    if let Some(coordinate) = run.coordinates.get(c) {
        let dots = Marker::new().color(MEASURED).size(4);
        add(&mut plot, thinned(&run.t, &coordinate.measured), |s| {
            s.name("measured").mode(Mode::Markers).marker(dots)
        });
        let dashed = Line::new().color(BEFORE).width(2.0).dash(DashType::Dash);
        add(&mut plot, thinned(&run.t, &coordinate.before), |s| {
            s.name("model as given").mode(Mode::Lines).line(dashed)
        });
        let full = Line::new().color(AFTER).width(2.0);
        add(&mut plot, thinned(&run.t, &coordinate.after), |s| {
            s.name("new model").mode(Mode::Lines).line(full)
        });
    }
    let mut layout = layout("t, s", label);
    if let Some(&first) = run.t.first().filter(|t| **t < run.start) {
        layout.add_shape(band(first, run.start, Rgba::new(128, 128, 128, 0.15)));
    }
    drawn(plot, layout, id)
}

/// The missing force of one coordinate: what it follows, when it is large, which signals explain it.
pub fn residual(
    residual: &ResidualForce,
    disagreement: &Disagreement,
    number: usize,
) -> Vec<Figure> {
    let force = label("missing force", &residual.unit);
    let dots = |color| Marker::new().color(color).size(3);
    let mut figures = Vec::new();

    let (signal, unit, values) = &residual.best_signal;
    let points = thinned(values, &residual.force);
    if !points.0.is_empty() {
        let mut plot = Plot::new();
        add(&mut plot, points, |s| {
            s.mode(Mode::Markers).marker(dots(AFTER))
        });
        figures.push(Figure {
            title: format!("Missing force over {signal}"),
            html: drawn(
                plot,
                layout(&label(signal, unit), &force),
                &format!("over-signal-{number}"),
            ),
        });
    }

    let points = thinned(&residual.t, &residual.force);
    if !points.0.is_empty() {
        let mut plot = Plot::new();
        add(&mut plot, points, |s| {
            s.mode(Mode::Markers).marker(dots(AFTER))
        });
        let mut layout = layout("t, s", &force);
        for &[from, to] in &disagreement.when {
            if from.is_finite() && to.is_finite() {
                layout.add_shape(band(from, to, Rgba::new(217, 95, 2, 0.25)));
            }
        }
        figures.push(Figure {
            title: "Missing force over time; shaded where it is largest".to_owned(),
            html: drawn(plot, layout, &format!("over-time-{number}")),
        });
    }

    let mut shares: Vec<(String, f64)> = residual
        .explained_by
        .iter()
        .filter(|(_, share)| share.is_finite())
        .take(MOST_SIGNALS)
        .map(|(name, share)| (wrapped(name), 100.0 * share.max(0.0)))
        .collect();
    shares.reverse(); // plotly draws the first at the bottom
    if !shares.is_empty() {
        let (names, shares): (Vec<String>, Vec<f64>) = shares.into_iter().unzip();
        let mut plot = Plot::new();
        plot.add_trace(
            Bar::new(shares, names)
                .orientation(Orientation::Horizontal)
                .marker(Marker::new().color(AFTER)),
        );
        let layout = layout("variance explained, %", "")
            .hover_mode(HoverMode::Closest)
            .x_axis(axis("variance explained, %").range(vec![0.0, 100.0]));
        figures.push(Figure {
            title: "What the missing force depends on".to_owned(),
            html: drawn(plot, layout, &format!("shares-{number}")),
        });
    }
    figures.extend(super::profiles::profiles(residual, number));
    figures
}

/// The force that no effect explains, over the signal that it follows best.
pub fn unexplained(unexplained: &Unexplained) -> Figure {
    let curve = &unexplained.curve;
    let mut plot = Plot::new();
    let doubled: Vec<f64> = curve.std.iter().map(|std| 2.0 * std).collect();
    add(&mut plot, (curve.at.clone(), curve.force.clone()), |s| {
        s.mode(Mode::LinesMarkers)
            .line(Line::new().color(AFTER).width(2.0))
            .marker(Marker::new().color(AFTER).size(5))
            .error_y(ErrorData::new(ErrorType::Data).array(doubled).color(TEXT))
    });
    let force = label("force left", &unexplained.unit);
    Figure {
        title: format!(
            "The force left on {} over {}: means of neighbouring samples, ± 2 standard errors",
            unexplained.coordinate, curve.signal
        ),
        html: drawn(
            plot,
            layout(&label(&curve.signal, &curve.unit), &force),
            "unexplained",
        ),
    }
}

/// Adds a curve, unless it is empty.
fn add(
    plot: &mut Plot,
    (x, y): (Vec<f64>, Vec<f64>),
    style: impl FnOnce(Box<Scatter<f64, f64>>) -> Box<Scatter<f64, f64>>,
) {
    if !x.is_empty() {
        plot.add_trace(style(Scatter::new(x, y)));
    }
}

/// Every n-th finite point, so that at most [`MOST_POINTS`] are left.
pub fn thinned(x: &[f64], y: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let finite = || {
        x.iter()
            .zip(y)
            .filter(|(x, y)| x.is_finite() && y.is_finite())
    };
    let stride = finite().count().div_ceil(MOST_POINTS).max(1);
    finite().step_by(stride).unzip()
}

/// `name, unit`, safe in plotly's own markup.
fn label(name: &str, unit: &str) -> String {
    match unit {
        "" | "1" => escaped(name),
        unit => escaped(&format!("{name}, {unit}")),
    }
}

/// Plotly reads some tags and entities in its texts.
pub fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
}

/// The same in lines of about 16 letters.
pub fn wrapped(text: &str) -> String {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split(' ') {
        match lines.last_mut().filter(|l| l.len() + word.len() < 18) {
            Some(line) => *line = format!("{line} {word}"),
            None => lines.push(word.to_owned()),
        }
    }
    let lines: Vec<String> = lines.iter().map(|line| escaped(line)).collect();
    lines.join("<br>")
}

fn band(from: f64, to: f64, color: Rgba) -> Shape {
    Shape::new()
        .shape_type(ShapeType::Rect)
        .layer(ShapeLayer::Below)
        .x_ref("x")
        .y_ref("paper")
        .x0(from)
        .x1(to)
        .y0(0.0)
        .y1(1.0)
        .fill_color(color)
        .line(ShapeLine::new().width(0.0))
}

/// A quiet axis.
pub fn axis(title: &str) -> Axis {
    let faint = Rgba::new(128, 128, 128, 0.25);
    let axis = Axis::new()
        .auto_margin(true)
        .grid_color(faint)
        .zero_line_color(Rgba::new(128, 128, 128, 0.5));
    match title {
        "" => axis,
        title => axis.title(title),
    }
}

/// The layout that all figures share.
pub fn layout(x: &str, y: &str) -> Layout {
    let clear = Rgba::new(0, 0, 0, 0.0);
    Layout::new()
        .paper_background_color(clear)
        .plot_background_color(clear)
        .font(Font::new().color(TEXT).size(12))
        .margin(Margin::new().left(56).right(12).top(28).bottom(44))
        .hover_mode(HoverMode::XUnified)
        .legend(
            Legend::new()
                .orientation(Orientation::Horizontal)
                .x(0.0)
                .y(1.02)
                .y_anchor(Anchor::Bottom),
        )
        .x_axis(axis(x))
        .y_axis(axis(y))
}

/// A `div` with the figure, and the script that draws in it.
pub fn drawn(mut plot: Plot, layout: Layout, id: &str) -> String {
    plot.set_layout(layout);
    plot.set_configuration(
        Configuration::new()
            .responsive(true)
            .display_logo(false)
            .display_mode_bar(DisplayModeBar::False)
            .typeset_math(false),
    );
    plot.to_inline_html(Some(id))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thinning_leaves_at_most_two_thousand_finite_points() {
        let mut y: Vec<f64> = (0..5001).map(f64::from).collect();
        y[7] = f64::NAN;
        let (x, y) = thinned(&y.clone(), &y);
        assert!(x.len() == y.len() && x.len() <= MOST_POINTS && x.len() > MOST_POINTS / 2);
        assert!(x.iter().chain(&y).all(|v| v.is_finite()));
    }

    #[test]
    fn the_script_is_plotly_alone() {
        let script = script();
        assert_eq!(script.matches("<script").count(), 1);
        assert!(script.contains("plotly.js v"));
        assert!((1_000_000..5_000_000).contains(&script.len())); // the formulas' library has 2 MB more
    }
}
