//! Where along every signal the missing force lies.

use plotly::HeatMap;
use plotly::Plot;
use plotly::common::{ColorScale, ColorScaleElement, HoverInfo};
use plotly::layout::HoverMode;

use super::figures::{AFTER, BEFORE, Figure, axis, drawn, escaped, layout, wrapped};
use super::words::{number, with_unit};
use crate::diagnose::curves::{Profile, ResidualForce};

/// A row a signal, a column for every twelfth of the samples in the order of the signal: the mean force.
pub fn profiles(residual: &ResidualForce, number_of: usize) -> Option<Figure> {
    let whole = |p: &&Profile| !p.force.is_empty() && p.force.iter().all(|f| f.is_finite());
    let mut rows: Vec<&Profile> = residual.profiles.iter().filter(whole).collect();
    rows.reverse(); // plotly draws the first at the bottom
    let most = rows
        .iter()
        .flat_map(|p| &p.force)
        .fold(0.0_f64, |m, f| m.max(f.abs()));
    if rows.is_empty() || most == 0.0 {
        return None;
    }
    let columns = rows.iter().map(|p| p.force.len()).max().unwrap_or(0);
    let said = |p: &Profile| -> Vec<String> {
        let cell = |(range, force): (&[f64; 2], &f64)| {
            let [from, to] = range.map(number);
            let at = with_unit(format!("{from} to {to}"), &p.unit);
            let force = with_unit(number(*force), &residual.unit);
            escaped(&format!("{} {at}: {force}", p.signal))
        };
        p.ranges.iter().zip(&p.force).map(cell).collect()
    };
    let text: Vec<Vec<String>> = rows.iter().map(|p| said(p)).collect();
    let colours = [(0.0, BEFORE), (0.5, "rgba(128,128,128,0.12)"), (1.0, AFTER)];
    let colours = colours.map(|(at, c)| ColorScaleElement(at, c.to_owned()));
    let map = HeatMap::new(
        (1..=columns).collect::<Vec<usize>>(),
        rows.iter()
            .map(|p| wrapped(&p.signal))
            .collect::<Vec<String>>(),
        rows.iter()
            .map(|p| p.force.clone())
            .collect::<Vec<Vec<f64>>>(),
    )
    .color_scale(ColorScale::Vector(colours.to_vec()))
    .zmin(-most)
    .zmax(most)
    .show_scale(false)
    .text_matrix(text)
    .hover_info(HoverInfo::Text);
    let mut plot = Plot::new();
    plot.add_trace(map);
    let ticks = axis("low to high, as many samples in each field").show_tick_labels(false);
    let layout = layout("", "").hover_mode(HoverMode::Closest).x_axis(ticks);
    Some(Figure {
        title: format!(
            "Mean missing force along each signal: blue up to {}, orange down to {}",
            with_unit(number(most), &residual.unit),
            with_unit(number(-most), &residual.unit)
        ),
        html: drawn(plot, layout, &format!("profiles-{number_of}")),
    })
}
