//! The fits that a diagnosis has finished, kept in a file so that an interrupted one goes on where it was.
//!
//! A fit is a function of the data, the model, its start and its options, bit for bit. Each finished one is appended to the file under the
//! SHA-256 of all that; the same diagnosis, begun again, does everything else afresh and takes its fits from there. What a process that
//! is killed has half written is not read: every record carries its length and checksum.
// Only the programs open such a file.
#![cfg_attr(not(feature = "cli"), allow(dead_code))]

use std::collections::HashMap;
use std::fs::{File, OpenOptions};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

use nalgebra::{DMatrix, DVector};
use sha2::{Digest, Sha256};

use super::score::window_scores;
use super::study::{Fitted, Start, Study};
use crate::Error;
use crate::hybrid::Hybrid;
use crate::shooting::{Fit, Window};

/// Name of the file in the folder of a diagnosis.
pub const FILE_NAME: &str = ".unfinished-diagnosis";

/// First bytes of the file; the form of what follows.
const MAGIC: &[u8; 16] = b"pinode fits  v1\n";

type Key = [u8; 32];

/// The finished fits of one diagnosis.
#[derive(Debug)]
pub struct Kept {
    path: PathBuf,
    inside: Mutex<Inside>,
}

#[derive(Debug)]
struct Inside {
    file: File,
    fits: HashMap<Key, Vec<u8>>,
}

/// What there was when a diagnosis began.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Before {
    /// No unfinished diagnosis.
    Nothing,
    /// This one, with so many fits finished.
    Same(usize),
    /// Another one: of other inputs, or by another version. It is gone.
    Other,
}

impl Kept {
    /// Opens the file in `folder` for the diagnosis with this fingerprint of its inputs. That of another diagnosis is emptied.
    ///
    /// # Errors
    /// [`Error::Io`] when the file cannot be read or written.
    pub fn open(folder: &Path, inputs: &Key) -> Result<(Self, Before), Error> {
        let path = folder.join(FILE_NAME);
        let io = |e| Error::io(&path, e);
        let mut file = OpenOptions::new()
            .read(true)
            .append(true)
            .create(true)
            .open(&path)
            .map_err(io)?;
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).map_err(io)?;
        let mut head = MAGIC.to_vec();
        head.extend_from_slice(inputs);
        let mut fits = HashMap::new();
        let before = match bytes.strip_prefix(head.as_slice()) {
            Some(mut records) => {
                while let Some((key, fit, rest)) = record(records) {
                    fits.insert(key, fit.to_vec());
                    records = rest;
                }
                // A record cut short by a kill would stand between the whole ones and those to come.
                let whole = bytes.len() - records.len();
                file.set_len(whole as u64).map_err(io)?;
                Before::Same(fits.len())
            }
            None => {
                file.set_len(0).map_err(io)?;
                file.write_all(&head).map_err(io)?;
                if bytes.is_empty() {
                    Before::Nothing
                } else {
                    Before::Other
                }
            }
        };
        let inside = Mutex::new(Inside { file, fits });
        Ok((Kept { path, inside }, before))
    }

    /// Its file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Keeps others from writing while the guard lives: what is in the file is whole.
    pub fn hold(&self) -> impl Sized + '_ {
        self.lock()
    }

    fn lock(&self) -> MutexGuard<'_, Inside> {
        self.inside.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The pair of fits, seen and held out, under `key`; else what `fit` gives, which is kept.
    fn or_fit(&self, key: Key, fit: impl FnOnce() -> (Fit, Fit)) -> (Fit, Fit) {
        let kept = self.lock().fits.get(&key).cloned();
        if let Some(pair) = kept.as_deref().and_then(decode) {
            return pair;
        }
        let pair = fit();
        let bytes = encode(&pair);
        let mut inside = self.lock();
        // A disk that is full costs the resumption, not the diagnosis.
        let _ = inside.file.write_all(&framed(&key, &bytes));
        inside.fits.insert(key, bytes);
        pair
    }
}

/// key, length of the body, body, first eight bytes of its checksum.
fn framed(key: &Key, body: &[u8]) -> Vec<u8> {
    let mut out = Vec::with_capacity(body.len() + 48);
    out.extend_from_slice(key);
    out.extend_from_slice(&(body.len() as u64).to_le_bytes());
    out.extend_from_slice(body);
    out.extend_from_slice(&Sha256::digest(body)[..8]);
    out
}

/// The first whole record and what follows it.
fn record(bytes: &[u8]) -> Option<(Key, &[u8], &[u8])> {
    let (key, rest) = bytes.split_first_chunk::<32>()?;
    let (length, rest) = rest.split_first_chunk::<8>()?;
    let (body, rest) = rest.split_at_checked(usize::try_from(u64::from_le_bytes(*length)).ok()?)?;
    let (sum, rest) = rest.split_first_chunk::<8>()?;
    (Sha256::digest(body)[..8] == sum[..]).then_some((*key, body, rest))
}

impl Study {
    /// Fits a model, or takes the fit from where it is kept.
    pub fn fit(
        &self,
        hybrid: Hybrid,
        start: Start,
        state_iterations: usize,
        iterations: usize,
    ) -> Fitted {
        let start = Start {
            theta: hybrid.settled(start.theta),
            ..start
        };
        let substeps = self.substeps_for(&hybrid, &start.theta);
        self.count(&hybrid, substeps, state_iterations + iterations);
        let (inside, outside) = match &self.kept {
            Some(kept) => {
                let key = key(self, &hybrid, &start, [state_iterations, iterations]);
                kept.or_fit(key, || {
                    self.fit_anew(&hybrid, start, state_iterations, iterations)
                })
            }
            None => self.fit_anew(&hybrid, start, state_iterations, iterations),
        };
        let channels = &self.observations.channels;
        Fitted {
            inside_scores: window_scores(&inside, channels),
            outside_scores: window_scores(&outside, channels),
            hybrid,
            inside,
            outside,
            substeps,
            left: OnceLock::new(),
            errors: OnceLock::new(),
        }
    }
}

/// Fingerprint of a fit: of all that it depends on but the mechanism, which the file's own fingerprint holds.
fn key(study: &Study, hybrid: &Hybrid, start: &Start, iterations: [usize; 2]) -> Key {
    let mut out = Writer(Vec::new());
    for run in &study.observations.runs {
        out.floats(&run.t);
        run.u
            .iter()
            .chain(&run.y)
            .for_each(|column| out.floats(column));
        for valid in &run.valid {
            out.0.extend(valid.iter().map(|&v| u8::from(v)));
        }
    }
    for channel in &study.observations.channels {
        out.count(2 * channel.coordinate + usize::from(channel.velocity));
        out.float(channel.noise);
    }
    for windows in [&study.windows.fit, &study.windows.held_out] {
        out.count(windows.len());
        for &Window { run, first, count } in windows {
            [run, first, count].iter().for_each(|&n| out.count(n));
        }
    }
    for smoothed in study.smoothed.iter() {
        let columns = smoothed.q.iter().chain(&smoothed.v).chain(&smoothed.a);
        columns.for_each(|column| out.floats(column));
    }
    out.float(study.interval);
    let stiff = usize::from(hybrid.is_stiff());
    let counts = [
        study.steps.substeps,
        study.steps.about_rests,
        study.steps_of_blows(hybrid),
        study.finer,
        stiff,
        iterations[0],
        iterations[1],
    ];
    counts.iter().for_each(|&n| out.count(n));
    for placed in hybrid.effects() {
        out.text(placed.kind.name);
        out.count(placed.target);
        out.float(placed.smoothing);
    }
    for constant in hybrid.constants() {
        out.text(&format!("{:?}", constant.id));
        out.floats(&[
            constant.value,
            constant.tolerance,
            constant.lower,
            constant.upper,
        ]);
    }
    out.floats(&start.theta);
    for placed in &start.hidden {
        out.text(placed.kind.name);
        out.count(placed.target);
    }
    out.nested(&start.inside);
    out.nested(&start.outside);
    out.floats(&start.sigma);
    Sha256::digest(&out.0).into()
}

fn encode((inside, outside): &(Fit, Fit)) -> Vec<u8> {
    let mut out = Writer(Vec::new());
    out.fit(inside);
    out.fit(outside);
    out.0
}

fn decode(bytes: &[u8]) -> Option<(Fit, Fit)> {
    let mut from = Reader(bytes);
    let pair = (from.fit()?, from.fit()?);
    from.0.is_empty().then_some(pair)
}

/// Little-endian; every list begins with its length.
struct Writer(Vec<u8>);

impl Writer {
    fn count(&mut self, n: usize) {
        self.0.extend_from_slice(&(n as u64).to_le_bytes());
    }
    fn float(&mut self, x: f64) {
        self.0.extend_from_slice(&x.to_le_bytes());
    }
    fn floats(&mut self, list: &[f64]) {
        self.count(list.len());
        list.iter().for_each(|&x| self.float(x));
    }
    fn nested(&mut self, lists: &[Vec<f64>]) {
        self.count(lists.len());
        lists.iter().for_each(|list| self.floats(list));
    }
    fn text(&mut self, text: &str) {
        self.count(text.len());
        self.0.extend_from_slice(text.as_bytes());
    }
    fn fit(&mut self, fit: &Fit) {
        let Fit {
            theta,
            free,
            states,
            sigma,
            squares,
            information,
            gradients,
            loss,
            stretch,
            determined,
            converged,
            gained,
        } = fit;
        self.floats(theta);
        self.count(free.len());
        free.iter().for_each(|&i| self.count(i));
        self.nested(states);
        self.floats(sigma);
        self.count(squares.len());
        for window in squares {
            self.count(window.len());
            for &(sum, n) in window {
                self.float(sum);
                self.count(n);
            }
        }
        self.count(information.nrows());
        self.floats(information.as_slice());
        self.count(gradients.len());
        for gradient in gradients {
            self.count(usize::from(gradient.is_some()));
            self.floats(gradient.as_ref().map_or(&[], |g| g.as_slice()));
        }
        self.floats(&[*loss, *stretch]);
        self.floats(determined);
        self.count(usize::from(*converged));
        self.float(*gained);
    }
}

/// Reads what a [`Writer`] wrote; `None` where it is something else.
struct Reader<'a>(&'a [u8]);

impl Reader<'_> {
    fn word(&mut self) -> Option<[u8; 8]> {
        let (word, rest) = self.0.split_first_chunk::<8>()?;
        self.0 = rest;
        Some(*word)
    }
    fn count(&mut self) -> Option<usize> {
        usize::try_from(u64::from_le_bytes(self.word()?)).ok()
    }
    fn float(&mut self) -> Option<f64> {
        self.word().map(f64::from_le_bytes)
    }
    fn list<T>(&mut self, mut next: impl FnMut(&mut Self) -> Option<T>) -> Option<Vec<T>> {
        let n = self.count()?;
        (0..n).map(|_| next(self)).collect()
    }
    fn floats(&mut self) -> Option<Vec<f64>> {
        self.list(Self::float)
    }
    fn fit(&mut self) -> Option<Fit> {
        Some(Fit {
            theta: self.floats()?,
            free: self.list(Self::count)?,
            states: self.list(Self::floats)?,
            sigma: self.floats()?,
            squares: self.list(|from| from.list(|from| Some((from.float()?, from.count()?))))?,
            information: {
                let rows = self.count()?;
                let entries = self.floats()?;
                let columns = entries.len().checked_div(rows).unwrap_or(0);
                (rows * columns == entries.len())
                    .then(|| DMatrix::from_column_slice(rows, columns, &entries))?
            },
            gradients: self.list(|from| {
                let is_there = from.count()? == 1;
                let entries = from.floats()?;
                Some(is_there.then(|| DVector::from_vec(entries)))
            })?,
            loss: {
                let 2 = self.count()? else { return None };
                self.float()?
            },
            stretch: self.float()?,
            determined: self.floats()?,
            converged: self.count()? == 1,
            gained: self.float()?,
        })
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    fn fit(x: f64) -> Fit {
        Fit {
            theta: vec![x, -0.0, f64::INFINITY],
            free: vec![0, 2],
            states: vec![vec![1.0, x], vec![]],
            sigma: vec![1e-3],
            squares: vec![vec![(f64::INFINITY, 0)], vec![(x * x, 30)]],
            information: DMatrix::from_row_slice(2, 2, &[1.0, 2.0, 2.0, 5.0]),
            gradients: vec![None, Some(DVector::from_vec(vec![0.1, x]))],
            loss: 1.0 / 3.0,
            stretch: x,
            determined: vec![0.5],
            converged: true,
            gained: 0.25,
        }
    }

    /// Bit for bit: debug text of an f64 names it.
    fn text(pair: &(Fit, Fit)) -> String {
        format!("{pair:?}")
    }

    #[test]
    fn a_kept_fit_comes_back_bit_for_bit_and_a_record_cut_short_is_dropped() {
        let dir = tempfile::tempdir().unwrap();
        let inputs = [7; 32];
        let (kept, before) = Kept::open(dir.path(), &inputs).unwrap();
        assert_eq!(before, Before::Nothing);
        let pair = (fit(std::f64::consts::PI), fit(2.0));
        kept.or_fit([1; 32], || pair.clone());
        kept.or_fit([2; 32], || (fit(3.0), fit(4.0)));
        let path = kept.path().to_owned();
        drop(kept);

        let whole = std::fs::read(&path).unwrap();
        std::fs::write(&path, &whole[..whole.len() - 5]).unwrap();
        let (kept, before) = Kept::open(dir.path(), &inputs).unwrap();
        assert_eq!(before, Before::Same(1));
        let again = kept.or_fit([1; 32], || unreachable!("it is kept"));
        assert_eq!(text(&again), text(&pair));
        let mut asked = false;
        kept.or_fit([2; 32], || {
            asked = true;
            (fit(3.0), fit(4.0))
        });
        assert!(asked, "the second record was cut short");
        drop(kept);
        assert_eq!(std::fs::read(&path).unwrap(), whole);

        let (_, before) = Kept::open(dir.path(), &[8; 32]).unwrap();
        assert_eq!(before, Before::Other);
    }
}
