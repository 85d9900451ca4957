//! The mechanism drawn, with what was found written where it sits.

use plotly::common::{Font, HoverInfo, Line, Marker, MarkerSymbol, Mode, Position};
use plotly::layout::HoverMode;
use plotly::{Plot, Scatter};

use super::figures::{AFTER, BEFORE, Figure, MEASURED, TEXT, axis, drawn, escaped, layout};
use super::words::{plain, short};
use crate::diagnose::sketch::{Point, Sketch};
use crate::diagnose::verdict::Diagnosis;

/// Joints closer than this part of the picture share one label.
const CLOSE: f64 = 0.05;
/// Room around the picture for the labels, as a part of its size.
const MARGIN: f64 = 0.2;

/// The picture and what it shows.
pub struct SketchText {
    pub caption: String,
    pub figures: Vec<Figure>,
}

/// The picture.
pub fn text(sketch: &Sketch, diagnosis: &Diagnosis) -> SketchText {
    SketchText {
        caption: format!(
            "From the model's own bodies and joints, {}, at t = {} s of recording {}: a typical moment. Circles: joints that turn; squares on \
             a rail: joints that slide, over the range of the log; dots: centres of mass; thin: where the last one goes.",
            sketch.view,
            short(sketch.moment.1),
            sketch.moment.0 + 1
        ),
        figures: vec![Figure {
            title: "The mechanism".to_owned(),
            html: figure(sketch, diagnosis),
        }],
    }
}

fn figure(sketch: &Sketch, diagnosis: &Diagnosis) -> String {
    let mut plot = Plot::new();
    let mut line = |points: &[Point], color: &'static str, width: f64| {
        let (x, y): (Vec<f64>, Vec<f64>) = points.iter().map(|p| (p[0], p[1])).unzip();
        plot.add_trace(
            Scatter::new(x, y)
                .mode(Mode::Lines)
                .line(Line::new().color(color).width(width))
                .hover_info(HoverInfo::Skip)
                .show_legend(false),
        );
    };
    for path in &sketch.paths {
        line(path, "rgba(128,128,128,0.35)", 1.0);
    }
    for rail in sketch.joints.iter().filter_map(|j| j.rail.as_ref()) {
        line(rail, MEASURED, 2.0);
    }
    for link in &sketch.links {
        line(link, TEXT, 6.0);
    }
    let heaviest = sketch.masses.iter().map(|m| m.2).fold(0.0, f64::max);
    for (at, name, mass) in &sketch.masses {
        let size = 6.0
            + 12.0
                * (mass / heaviest.max(f64::MIN_POSITIVE))
                    .clamp(0.0, 1.0)
                    .sqrt();
        plot.add_trace(
            Scatter::new(vec![at[0]], vec![at[1]])
                .mode(Mode::Markers)
                .marker(Marker::new().color(AFTER).size(size as usize).opacity(0.8))
                .name(escaped(&format!("{name}, {} kg", short(*mass))))
                .show_legend(false),
        );
    }
    for joint in &sketch.joints {
        let symbol = match joint.rail {
            Some(_) => MarkerSymbol::SquareOpen,
            None => MarkerSymbol::CircleOpen,
        };
        plot.add_trace(
            Scatter::new(vec![joint.at[0]], vec![joint.at[1]])
                .mode(Mode::Markers)
                .marker(Marker::new().color(BEFORE).size(12).symbol(symbol))
                .name(escaped(&joint.name))
                .show_legend(false),
        );
    }
    let [x, y] = ranges(sketch);
    for (at, label) in labels(sketch, diagnosis, f64::max(x[1] - x[0], y[1] - y[0])) {
        let position = match at[0] > 0.5 * (x[0] + x[1]) {
            true => Position::TopLeft,
            false => Position::TopRight,
        };
        plot.add_trace(
            Scatter::new(vec![at[0]], vec![at[1]])
                .mode(Mode::Text)
                .text_array(vec![label])
                .text_position(position)
                .text_font(Font::new().color(TEXT).size(13))
                .hover_info(HoverInfo::Skip)
                .show_legend(false),
        );
    }
    let layout = layout("m", "m")
        .hover_mode(HoverMode::Closest)
        .x_axis(axis("m").range(x.to_vec()))
        .y_axis(axis("m").range(y.to_vec()).scale_anchor("x"));
    drawn(plot, layout, "mechanism")
}

/// What stands at each joint: its coordinate, and the effects that were found on it. Joints in one place share a label.
fn labels(sketch: &Sketch, diagnosis: &Diagnosis, size: f64) -> Vec<(Point, String)> {
    let mut labels: Vec<(Point, String)> = Vec::new();
    let found = |target: &str| -> Vec<String> {
        let on = diagnosis.effects.iter().filter(|e| e.target == target);
        on.map(|e| escaped(&plain(&e.kind))).collect()
    };
    let joints = sketch.joints.iter().map(|j| (j.at, &j.coordinate, true));
    let bodies = sketch.masses.iter().map(|(at, name, _)| (*at, name, false));
    for (at, name, always) in joints.chain(bodies) {
        // A body of its joint's name would say the same twice.
        let twice = !always && sketch.joints.iter().any(|j| j.coordinate == *name);
        let effects = if twice { Vec::new() } else { found(name) };
        if !always && effects.is_empty() {
            continue;
        }
        let said = match effects.is_empty() {
            true => escaped(name),
            false => format!("{}: <b>{}</b>", escaped(name), effects.join(", ")),
        };
        let near = |l: &&mut (Point, String)| (l.0[0] - at[0]).hypot(l.0[1] - at[1]) < CLOSE * size;
        match labels.iter_mut().find(near) {
            Some(label) => label.1 = format!("{}<br>{said}", label.1),
            None => labels.push((at, said)),
        }
    }
    labels
}

/// The ranges of both axes that hold everything.
fn ranges(sketch: &Sketch) -> [[f64; 2]; 2] {
    let points = || {
        let ends = sketch.links.iter().flatten();
        let rails = sketch
            .joints
            .iter()
            .filter_map(|j| j.rail.as_ref())
            .flatten();
        let joints = sketch.joints.iter().map(|j| &j.at);
        let masses = sketch.masses.iter().map(|m| &m.0);
        let paths = sketch.paths.iter().flatten();
        ends.chain(rails).chain(joints).chain(masses).chain(paths)
    };
    let range = |axis: usize| {
        let least = points().map(|p| p[axis]).fold(f64::INFINITY, f64::min);
        let largest = points().map(|p| p[axis]).fold(f64::NEG_INFINITY, f64::max);
        [least, largest]
    };
    let all = [range(0), range(1)];
    let size = all.iter().map(|r| r[1] - r[0]).fold(1e-3, f64::max);
    all.map(|[least, largest]| [least - MARGIN * size, largest + MARGIN * size])
}
