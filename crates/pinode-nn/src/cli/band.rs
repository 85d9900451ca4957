//! The band about a simulation of an ensemble: its members, each rolled out from the same state.

use std::fmt::Write;
use std::path::PathBuf;

use serde_json::{Value, json};

use super::csv_line::csv_line;
use super::output::Output;
use super::stepping::{Effort, Stepping};
use crate::Error;
use crate::band::{Band as Calibrated, COVERAGE, Width};
use crate::disk::Staged;
use crate::entries::{q_names, starts, v_names};
use crate::log::Run;
use crate::model::Model;
use crate::report::words::{number, with_unit};
use crate::spread::{Squares, spread};

/// What a file of half-widths calls that of a signal.
const HALF: &str = "half.";

/// What is known of a calibrated band of a model, for programs.
pub(super) fn calibrated(band: &Calibrated, model: &Model) -> Value {
    let columns = columns(model);
    let signals = band.signals.iter().map(|width| {
        json!({
            "name": place(width, model).and_then(|place| columns.get(place)).map(|(name, _)| name),
            "spread": width.spread,
            "floor": width.floor,
            "growth": width.growth,
        })
    });
    json!({
        "coverage": COVERAGE,
        "horizon_s": band.horizon,
        "windows": band.windows,
        "signals": signals.collect::<Vec<_>>(),
    })
}

/// The same for people.
pub(super) fn calibrated_words(band: &Calibrated, model: &Model) -> String {
    let mut out = format!(
        "{:.0} % of what is measured is within √((k s)² + f² + (g t)²) of a roll-out, s the members' standard deviation (tried for {}, on {} windows that \
         share no sample):\n",
        100.0 * COVERAGE,
        with_unit(number(band.horizon), "s"),
        band.windows,
    );
    let columns = columns(model);
    for width in &band.signals {
        let Some((name, unit)) = place(width, model).and_then(|place| columns.get(place)) else {
            continue;
        };
        // Writing to a String cannot fail.
        let _ = writeln!(
            out,
            "  {name}: k {}, f {}, g {}",
            number(width.spread),
            with_unit(number(width.floor), unit),
            with_unit(number(width.growth), &a_second(unit)),
        );
    }
    out
}

/// That unit a second.
fn a_second(unit: &str) -> String {
    match unit.strip_suffix("/s") {
        Some(unit) => format!("{unit}/s²"),
        None => format!("{unit}/s"),
    }
}

/// The place of a signal in the state.
fn place(width: &Width, model: &Model) -> Option<usize> {
    let starts = starts(model.mechanics.coordinates());
    let at = starts.get(width.coordinate)?;
    Some(match width.velocity {
        false => at.q,
        true => model.mechanics.nq() + at.v,
    })
}

/// Names and units of q and v.
fn columns(model: &Model) -> Vec<(String, String)> {
    let coordinates = model.mechanics.coordinates();
    let units = |count: fn(&lagrange::Coordinate) -> usize, per: &'static str| {
        let each = coordinates.iter();
        each.flat_map(move |c| vec![format!("{}{per}", c.unit()); count(c)])
    };
    let names = q_names(coordinates).into_iter().chain(v_names(coordinates));
    let units = units(|c| c.nq(), "").chain(units(|c| c.nv(), "/s"));
    names.zip(units).collect()
}

/// Members of an ensemble beside the roll-out of their mean force.
pub(super) struct Band {
    members: Vec<Model>,
    /// Where the deviations go, and their rows so far.
    file: Option<(PathBuf, String)>,
    /// Names and units of q and v.
    columns: Vec<(String, String)>,
    squares: Squares,
    largest: Vec<f64>,
    /// The half-widths of the calibrated band, by their places in the state, and the largest of each.
    widths: Vec<(usize, Width, f64)>,
    /// How far that was tried, and the longest run, s.
    horizon: f64,
    longest: f64,
    diverged: usize,
}

impl Band {
    /// Of the members of `model`; none where it has no ensemble.
    ///
    /// # Errors
    /// [`Error::NoEnsemble`] when a file is asked for and there is no ensemble.
    pub fn of(
        model: &Model,
        file: Option<&PathBuf>,
        with_run: bool,
    ) -> Result<Option<Self>, Error> {
        if !model.has_ensemble() {
            return match file {
                None => Ok(None),
                Some(_) => Err(Error::NoEnsemble {
                    path: model.path.clone(),
                }),
            };
        }
        let columns = columns(model);
        let calibrated = model.band.as_ref();
        let widths = calibrated.map_or(&[][..], |band| &band.signals).iter();
        let mut widths: Vec<_> = widths
            .filter_map(|w| Some((place(w, model)?, *w, 0.0)))
            .collect();
        widths.sort_by_key(|(place, ..)| *place);
        let name = |place: usize| columns.get(place).map_or("", |(name, _)| name.as_str());
        let names = columns.iter().map(|(name, _)| name.clone());
        let halves = widths
            .iter()
            .map(|(place, ..)| format!("{HALF}{}", name(*place)));
        let names = std::iter::once("t".to_owned()).chain(names).chain(halves);
        let names: Vec<String> = names.chain(with_run.then(|| "run".to_owned())).collect();
        let header = String::from_utf8_lossy(&csv_line(&names)).into_owned();
        Ok(Some(Band {
            members: model.members(),
            file: file.map(|path| (path.clone(), header)),
            squares: Squares::default(),
            largest: vec![0.0; columns.len()],
            columns,
            widths,
            horizon: calibrated.map_or(f64::INFINITY, |band| band.horizon),
            longest: 0.0,
            diverged: 0,
        }))
    }

    /// Rolls the members out over a recording; those that do not get to its end are left out, and that is said.
    pub fn roll(
        &mut self,
        method: Stepping,
        (run, with_run): (&Run, bool),
        initial: &[f64],
        fineness: (f64, f64),
        output: &Output,
    ) {
        let mut rolled = Vec::new();
        for (k, member) in self.members.iter().enumerate() {
            match method.simulate(member, run, initial, fineness, &mut Effort::default()) {
                Ok(mut states) => {
                    let visible = member.mechanics.nq() + member.mechanics.nv();
                    let all = states.iter_mut();
                    all.for_each(|state| state.truncate(visible));
                    rolled.push(states);
                }
                Err(error) => {
                    self.diverged += 1;
                    output.note(&format!(
                        "warning: member {} of the ensemble is left out of the band: {error}",
                        k + 1
                    ));
                }
            }
        }
        for (deviations, t) in spread(&rolled).iter().zip(&run.t) {
            self.squares.take(deviations);
            for (largest, x) in self.largest.iter_mut().zip(deviations) {
                *largest = largest.max(*x);
            }
            let since = t - run.t[0];
            let half = |place: usize, width: &Width| width.half(deviations[place], since);
            self.longest = self.longest.max(since);
            for (place, width, largest) in &mut self.widths {
                *largest = largest.max(half(*place, width));
            }
            if let Some((_, text)) = &mut self.file {
                // Writing to a String cannot fail.
                let _ = write!(text, "{t}");
                for x in deviations {
                    let _ = write!(text, ",{x}");
                }
                for (place, width, _) in &self.widths {
                    let _ = write!(text, ",{}", half(*place, width));
                }
                if with_run {
                    let _ = write!(text, ",{}", run.id);
                }
                text.push('\n');
            }
        }
    }

    /// Writes the file beside its place, where one is asked for.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn stage(&self) -> Result<Option<Staged>, Error> {
        let staged = self.file.as_ref();
        staged
            .map(|(path, text)| Staged::write(path, text.as_bytes()))
            .transpose()
    }

    /// What was asked for beyond what the band was tried for.
    pub fn warning(&self) -> Option<String> {
        (self.longest > self.horizon * (1.0 + 1e-9)).then(|| {
            format!(
                "the band was tried for {} from the beginning of a roll-out, and this one takes {}: beyond that it is carried on as it was",
                with_unit(number(self.horizon), "s"),
                with_unit(number(self.longest), "s"),
            )
        })
    }

    /// (name, unit, root mean square, largest, largest half-width) of every column; none where fewer than two members got to the end.
    fn sizes(&self) -> impl Iterator<Item = (&str, &str, f64, f64, Option<f64>)> {
        let columns = self.columns.iter().zip(&self.largest).enumerate();
        columns.filter_map(|(k, ((name, unit), largest))| {
            let rms = self.squares.root_mean(k)?;
            let width = self.widths.iter().find(|(place, ..)| *place == k);
            let half = width.map(|(.., half)| *half);
            Some((name.as_str(), unit.as_str(), rms, *largest, half))
        })
    }

    /// For programs.
    pub fn document(&self) -> Value {
        let sizes = self.sizes().map(|(name, unit, rms, largest, half)| {
            let mut size = json!({ "name": name, "unit": unit, "rms": rms, "largest": largest });
            if let Some(half) = half {
                size["largest_half_width"] = json!(half);
            }
            size
        });
        json!({
            "members": self.members.len(),
            "left_out": self.diverged,
            "coverage": (!self.widths.is_empty()).then_some(COVERAGE),
            "standard_deviations": sizes.collect::<Vec<_>>(),
            "file": self.file.as_ref().map(|(path, _)| path.display().to_string()),
        })
    }

    /// For people.
    pub fn words(&self) -> String {
        let banded = match self.widths.is_empty() {
            true => String::new(),
            false => format!(
                "; then the largest half-width of the band that holds {:.0} % of what is measured",
                100.0 * COVERAGE
            ),
        };
        let mut out = format!(
            "standard deviations over the {} members of the ensemble, root mean square and largest{banded}:\n",
            self.members.len()
        );
        for (name, unit, rms, largest, half) in self.sizes() {
            let sizes = [Some(rms), Some(largest), half];
            let sizes = sizes.into_iter().flatten();
            let sizes: Vec<String> = sizes.map(|x| with_unit(number(x), unit)).collect();
            let _ = writeln!(out, "  {name}: {}", sizes.join(", "));
        }
        if let Some((path, _)) = &self.file {
            let _ = writeln!(out, "written to {}", path.display());
        }
        out
    }
}
