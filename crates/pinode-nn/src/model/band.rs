//! How far what is measured may be from a roll-out of an ensemble: `[band]`.

use lagrange::Coordinate;
use toml_edit::{DocumentMut, InlineTable, Item, Table, Value};

use super::document::{Faults, Section};
use super::mechanism::{Mechanism, find_coordinate};
use super::write::number;
use crate::band::{Band, Width};

/// The key of the table, and those of positions and velocities in it.
const KEY: &str = "band";
const SIGNALS: [&str; 2] = ["q", "v"];

/// The `[band]` table.
pub(super) fn read(
    root: &Section,
    mechanism: Option<&Mechanism>,
    has_ensemble: bool,
    faults: &mut Faults,
) -> Option<Band> {
    let section = root.section(KEY, "[band]", faults)?;
    section.check_keys(&["horizon", "windows", "q", "v"], faults);
    let mut needed = |key: &str, condition: &str, holds: fn(f64) -> bool| {
        if section.get(key).is_none() {
            faults.at(section.offset, format!("[band] has no `{key}`, a number"));
        }
        section.number_that(key, condition, holds, faults)
    };
    let horizon = needed("horizon", "positive", |x| x > 0.0);
    let windows = needed("windows", "a whole number, 1 or more", |x| {
        x >= 1.0 && x <= f64::from(u32::MAX) && x.fract() == 0.0
    });
    if !has_ensemble {
        faults.at(
            section.offset,
            "a [band] is about the members of an ensemble, and this model has none: leave it out, or give `weights` as a list",
        );
    }
    let mut signals = Vec::new();
    for key in SIGNALS {
        let Some(own) = section.section(key, &format!("[band.{key}]"), faults) else {
            continue;
        };
        for (name, width) in own.named_sections(&format!("band.{key}"), faults) {
            width.check_keys(&["spread", "floor", "growth"], faults);
            let mut part = |key| {
                let number = width.number_that(key, "0 or positive", |x| x >= 0.0, faults);
                number.unwrap_or(0.0)
            };
            let [spread, floor, growth] = ["spread", "floor", "growth"].map(&mut part);
            let coordinate =
                mechanism.and_then(|m| find_coordinate(m, name.value, name.offset(), faults));
            signals.extend(coordinate.map(|coordinate| Width {
                coordinate,
                velocity: key == SIGNALS[1],
                spread,
                floor,
                growth,
            }));
        }
    }
    Some(Band {
        horizon: horizon?,
        windows: windows? as usize,
        signals,
    })
}

/// Writes the table, or takes it away.
pub(super) fn write(document: &mut DocumentMut, band: Option<&Band>, coordinates: &[Coordinate]) {
    let Some(band) = band else {
        document.remove(KEY);
        return;
    };
    let mut table = Table::new();
    table.decor_mut().set_prefix(
        "\n# 95 % of what is measured is within √((spread · s)² + floor² + (growth · t)²) of a roll-out,\n\
         # s the standard deviation over the members, t the time since it began, tried as far as `horizon` (s).\n",
    );
    table.insert("horizon", Item::Value(number(band.horizon)));
    table.insert("windows", Item::Value(Value::from(band.windows as i64)));
    for (key, velocity) in SIGNALS.into_iter().zip([false, true]) {
        let mut own = Table::new();
        for width in band.signals.iter().filter(|w| w.velocity == velocity) {
            let mut parts = InlineTable::new();
            parts.insert("spread", number(width.spread));
            parts.insert("floor", number(width.floor));
            parts.insert("growth", number(width.growth));
            if let Some(coordinate) = coordinates.get(width.coordinate) {
                own.insert(&coordinate.name, Item::Value(Value::InlineTable(parts)));
            }
        }
        if !own.is_empty() {
            table.insert(key, Item::Table(own));
        }
    }
    document.insert(KEY, Item::Table(table));
}
