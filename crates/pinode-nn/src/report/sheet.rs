//! A page of any experiment: sections with words, tables and figures, in one file that needs no network.
//!
//! ```no_run
//! use pinode_nn::report::sheet::{Curve, Section, Sheet, Style, curves};
//!
//! let t = [0.0, 0.1, 0.2];
//! let measured = Curve { name: "measured", style: Style::Measured, x: &t, y: &[0.0, 0.3, 0.5] };
//! let mut section = Section::new("A fall");
//! section.figures.push(curves("the angle", ["t, s", "q, rad"], &[measured], "fall"));
//! let sheet = Sheet { title: "an experiment".into(), heading: "It falls".into(), sections: vec![section] };
//! sheet.write("fall.html".as_ref())?;
//! # Ok::<(), pinode_nn::Error>(())
//! ```

use std::path::Path;

use askama::Template;
use plotly::common::{DashType, Line, Marker, Mode};
use plotly::layout::BarMode;
use plotly::{Bar, Plot, Scatter};

pub use super::figures::Figure;
use super::figures::{self, AFTER, BEFORE, MEASURED, axis, drawn, escaped, layout, thinned};
use crate::Error;

/// Bars of a histogram.
const BARS: usize = 40;
/// Colours beside those of the measured, the old and the new.
const OTHERS: [&str; 3] = ["#7570b3", "#66a61e", "#e7298a"];

/// A page.
#[derive(Debug, Clone)]
pub struct Sheet {
    /// What it is about, in small print and in the window's title.
    pub title: String,
    /// What came out, in a sentence.
    pub heading: String,
    /// The rest.
    pub sections: Vec<Section>,
}

/// A part of a page.
#[derive(Debug, Clone, Default)]
pub struct Section {
    /// What it shows.
    pub heading: String,
    /// Before tables and figures.
    pub paragraphs: Vec<String>,
    /// Tables.
    pub tables: Vec<Grid>,
    /// Figures.
    pub figures: Vec<Figure>,
}

impl Section {
    /// Without anything yet.
    pub fn new(heading: &str) -> Self {
        Section {
            heading: heading.to_owned(),
            ..Section::default()
        }
    }
}

/// A table.
#[derive(Debug, Clone, Default)]
pub struct Grid {
    /// Above it.
    pub heading: String,
    /// So many columns, from the left, are words; the others numbers.
    pub texts: usize,
    /// Their heads.
    pub columns: Vec<String>,
    /// As many cells each.
    pub rows: Vec<GridRow>,
}

/// A row of a [`Grid`].
#[derive(Debug, Clone)]
pub struct GridRow {
    /// One a column.
    pub cells: Vec<String>,
    /// Whether it stands out.
    pub chosen: bool,
}

#[derive(Template)]
#[template(path = "sheet.html")]
struct Page<'a> {
    script: String,
    title: &'a str,
    heading: &'a str,
    sections: &'a [Section],
}

impl Sheet {
    /// Writes the page, whole or not at all.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn write(&self, path: &Path) -> Result<(), Error> {
        let page = self.render().map_err(|e| Error::io(path, e))?;
        crate::disk::write_atomically(path, page.as_bytes())
    }

    pub(super) fn render(&self) -> Result<String, std::io::Error> {
        let page = Page {
            script: figures::script(),
            title: &self.title,
            heading: &self.heading,
            sections: &self.sections,
        };
        page.render().map_err(std::io::Error::other)
    }
}

/// How a curve or a histogram is drawn: the same thing has the same colour in all figures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Style {
    /// Grey dots.
    Measured,
    /// What was before: orange, dashed.
    Before,
    /// What is new: blue.
    After,
    /// Others, by number.
    Other(usize),
}

impl Style {
    fn color(self) -> &'static str {
        match self {
            Style::Measured => MEASURED,
            Style::Before => BEFORE,
            Style::After => AFTER,
            Style::Other(k) => OTHERS[k % OTHERS.len()],
        }
    }
}

/// Points of a curve; those that are no numbers are left out.
#[derive(Debug, Clone, Copy)]
pub struct Curve<'a> {
    /// What it is.
    pub name: &'a str,
    /// How it is drawn.
    pub style: Style,
    /// Across.
    pub x: &'a [f64],
    /// Upwards, as many.
    pub y: &'a [f64],
}

/// Curves over the same axes, which have these titles; `id` is unique on the page.
pub fn curves(title: &str, [x, y]: [&str; 2], curves: &[Curve<'_>], id: &str) -> Figure {
    let mut plot = Plot::new();
    for curve in curves {
        let (at, value) = thinned(curve.x, curve.y);
        let color = curve.style.color();
        let trace = Scatter::new(at, value).name(escaped(curve.name));
        plot.add_trace(match curve.style {
            Style::Measured => trace
                .mode(Mode::Markers)
                .marker(Marker::new().color(color).size(4)),
            style => {
                let dash = match style {
                    Style::Before => DashType::Dash,
                    Style::Other(_) => DashType::Dot,
                    _ => DashType::Solid,
                };
                let line = Line::new().color(color).width(2.0).dash(dash);
                trace.mode(Mode::Lines).line(line)
            }
        });
    }
    Figure {
        title: title.to_owned(),
        html: drawn(plot, layout(&escaped(x), &escaped(y)), id),
    }
}

/// Histograms of lists of numbers in the same bins, which reach to the 99th hundredth of all; the last one holds what is beyond, too.
pub fn histograms(title: &str, x: &str, lists: &[(&str, Style, &[f64])], id: &str) -> Figure {
    let mut all: Vec<f64> = lists
        .iter()
        .flat_map(|(_, _, list)| list.iter().copied())
        .filter(|x| x.is_finite())
        .collect();
    all.sort_by(f64::total_cmp);
    let least = all.first().copied().unwrap_or(0.0);
    let most = all.get(all.len() * 99 / 100).copied().unwrap_or(1.0);
    let width = ((most - least) / BARS as f64).max(f64::MIN_POSITIVE);
    let centres: Vec<f64> = (0..BARS)
        .map(|k| least + (k as f64 + 0.5) * width)
        .collect();
    let mut plot = Plot::new();
    for (name, style, list) in lists {
        let mut bars = vec![0.0; BARS];
        for x in list.iter().filter(|x| x.is_finite()) {
            bars[(((x - least) / width) as usize).min(BARS - 1)] += 100.0 / list.len() as f64;
        }
        let bars = Bar::new(centres.clone(), bars)
            .name(escaped(name))
            .opacity(0.55)
            .marker(Marker::new().color(style.color()));
        plot.add_trace(bars);
    }
    let share = "share, %";
    let layout = layout(&escaped(x), share)
        .bar_mode(BarMode::Overlay)
        .bar_gap(0.0)
        .y_axis(axis(share));
    Figure {
        title: title.to_owned(),
        html: drawn(plot, layout, id),
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[test]
    fn a_sheet_has_its_words_escaped_its_numbers_in_columns_and_its_figures_drawn() {
        let t = [0.0, 1.0, f64::NAN];
        let y = [2.0, f64::INFINITY, 1.0];
        let mut section = Section::new("a < b");
        section.tables.push(Grid {
            heading: "errors".to_owned(),
            texts: 1,
            columns: vec!["model".to_owned(), "x, m".to_owned()],
            rows: vec![GridRow {
                cells: vec!["<ours>".to_owned(), "0.5".to_owned()],
                chosen: true,
            }],
        });
        let curve = Curve {
            name: "a & b",
            style: Style::After,
            x: &t,
            y: &y,
        };
        section.figures = vec![
            curves("one", ["t", "y"], &[curve], "first"),
            histograms(
                "two",
                "x",
                &[("all", Style::Before, &y), ("none", Style::After, &[])],
                "second",
            ),
        ];
        let sheet = Sheet {
            title: "t".to_owned(),
            heading: "h".to_owned(),
            sections: vec![section],
        };
        let page = sheet.render().unwrap();
        for part in [
            "a &#60; b",
            "&#60;ours&#62;",
            "<td class=\"n\">0.5</td>",
            "id=\"first\"",
            "id=\"second\"",
            "amp; b",
        ] {
            assert!(page.contains(part), "{part}");
        }
        assert!(!page.contains("<ours>"));
        assert_eq!(page.matches("class=\"plot\"").count(), 2);
    }
}
