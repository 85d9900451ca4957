//! Figures of panels with logarithmic axes, as SVG.

use std::error::Error;
use std::ops::Range;
use std::path::Path;

use plotters::prelude::*;

/// One curve: its name and its points.
pub struct Curve {
    /// What the legend says; the same name has the same colour in every panel.
    pub name: String,
    /// (x, y); what is not positive is left out.
    pub points: Vec<(f64, f64)>,
}

/// One pair of axes.
pub struct Panel {
    /// Above the axes.
    pub title: String,
    /// Below the axes.
    pub x: String,
    /// Beside the axes.
    pub y: String,
    /// In the order of the legend.
    pub curves: Vec<Curve>,
}

/// Colours that also the colour-blind tell apart (Okabe and Ito).
const COLOURS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(0, 0, 0),
];

const PANEL: (u32, u32) = (420, 330);
const LEGEND: u32 = 30;

/// Whole decades around the values.
fn decades(values: impl Iterator<Item = f64>) -> Range<f64> {
    let (mut least, mut largest) = (f64::INFINITY, 0.0_f64);
    for value in values.filter(|v| *v > 0.0 && v.is_finite()) {
        least = least.min(value);
        largest = largest.max(value);
    }
    let (low, high) = (least.log10().floor(), largest.log10().ceil());
    10_f64.powf(low)..10_f64.powf(high.max(low + 1.0))
}

fn power(value: &f64) -> String {
    format!("1e{}", value.log10().round() as i32)
}

/// Writes the panels, so many a row, with one legend for all.
pub fn write(path: &Path, panels: &[Panel], columns: usize) -> Result<(), Box<dyn Error>> {
    let mut names: Vec<&str> = Vec::new();
    for curve in panels.iter().flat_map(|panel| &panel.curves) {
        if !names.contains(&curve.name.as_str()) {
            names.push(&curve.name);
        }
    }
    let colour = |name: &str| {
        let place = names.iter().position(|known| *known == name);
        COLOURS[place.unwrap_or(0) % COLOURS.len()]
    };
    let rows = panels.len().div_ceil(columns);
    let size = (PANEL.0 * columns as u32, PANEL.1 * rows as u32 + LEGEND);
    let root = SVGBackend::new(path, size).into_drawing_area();
    root.fill(&WHITE)?;
    let (legend, body) = root.split_vertically(LEGEND);
    let width = size.0 as i32 / names.len().max(1) as i32;
    for (i, name) in names.iter().enumerate() {
        let left = 20 + i as i32 * width;
        let style = colour(name).stroke_width(2);
        legend.draw(&PathElement::new([(left, 18), (left + 24, 18)], style))?;
        legend.draw(&Text::new(*name, (left + 30, 11), ("sans-serif", 14)))?;
    }
    for (panel, area) in panels.iter().zip(body.split_evenly((rows, columns))) {
        let xs = panel
            .curves
            .iter()
            .flat_map(|c| c.points.iter().map(|p| p.0));
        let ys = panel
            .curves
            .iter()
            .flat_map(|c| c.points.iter().map(|p| p.1));
        let mut chart = ChartBuilder::on(&area)
            .caption(&panel.title, ("sans-serif", 15))
            .margin(8)
            .x_label_area_size(38)
            .y_label_area_size(54)
            .build_cartesian_2d(decades(xs).log_scale(), decades(ys).log_scale())?;
        chart
            .configure_mesh()
            .max_light_lines(0)
            .x_desc(&panel.x)
            .y_desc(&panel.y)
            .x_label_formatter(&power)
            .y_label_formatter(&power)
            .x_labels(6)
            .y_labels(7)
            .draw()?;
        for curve in &panel.curves {
            let points = curve
                .points
                .iter()
                .copied()
                .filter(|p| p.0 > 0.0 && p.1 > 0.0);
            let style = colour(&curve.name).stroke_width(2);
            chart.draw_series(LineSeries::new(points, style))?;
        }
    }
    root.present()?;
    drop(body);
    drop(legend);
    drop(root);
    // A blank line would end the picture in Markdown, and it shall not be wider than the page.
    let text = std::fs::read_to_string(path)?;
    let lines: Vec<&str> = text
        .lines()
        .filter(|line| !line.trim().is_empty())
        .collect();
    let text = lines.join("\n") + "\n";
    let style = "<svg style=\"max-width: 100%\" ";
    let text = text
        .replacen("<svg ", style, 1)
        .replace(" opacity=\"1\"", "");
    std::fs::write(path, text)?;
    Ok(())
}
