//! The laws of effects as roll-outs evaluate them: recorded once, and run as programs.
//!
//! Q_j and ḣ, row after row, are functions of (q_j, v_j, f, h …, p …), column after column, and of the smoothing. A law that decides by the value of a number
//! has no record, nor has one that is too long: it is evaluated on dual numbers, state by state.

use std::sync::{Arc, PoisonError, RwLock};

use lagrange::{LANES, Recorded, RecordedMemory};

use super::memory::MOST_STATES;
use super::{Action, JointForce, Kind, MemoryDerivatives, MemoryForce, Seen};

type Lane = [f64; LANES];

/// A force on a joint, with a memory or without.
pub(crate) struct Law {
    states: usize,
    written: Written,
    /// With its derivatives in all columns; none where it has no record.
    all: Option<Recorded>,
    /// With that in v_j alone.
    slope: Option<Recorded>,
}

/// The law as it is written.
enum Written {
    Joint(&'static dyn JointForce),
    Memory(&'static dyn MemoryForce),
}

/// In what a law is derived.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Column {
    Position,
    Velocity,
    /// The force of the inputs.
    Input,
    /// One of its states.
    State(usize),
    /// One of its parameters.
    Parameter(usize),
}

/// Where a law is evaluated.
#[derive(Clone, Copy)]
pub(crate) struct At<'a, T> {
    pub seen: Seen<'a, T>,
    pub p: &'a [f64],
    pub smoothing: f64,
}

/// Memory of one thread for any laws.
#[derive(Default)]
pub(crate) struct Room {
    recorded: RecordedMemory,
    by_p: [f64; super::joint_force::MOST_PARAMETERS],
    with_memory: Box<MemoryDerivatives>,
}

const VELOCITY: usize = 1;
const FIRST_STATE: usize = 3;

/// The laws that were recorded in this process.
static RECORDED: RwLock<Vec<(&Kind, Arc<Law>)>> = RwLock::new(Vec::new());

impl Law {
    /// The law of a kind, recorded when it is first asked for; none where the kind is no force on a joint.
    pub fn of(kind: &'static Kind) -> Option<Arc<Law>> {
        let written = match kind.action {
            Action::Joint(law) => Written::Joint(law),
            Action::Memory(law) | Action::Transmission(law) => Written::Memory(law),
            _ => return None,
        };
        let known = |all: &[(&Kind, Arc<Law>)]| {
            let own = all.iter().find(|(known, _)| std::ptr::eq(*known, kind));
            own.map(|(_, law)| law.clone())
        };
        if let Some(law) = known(&RECORDED.read().unwrap_or_else(PoisonError::into_inner)) {
            return Some(law);
        }
        let law = Arc::new(Law::recorded(written, kind));
        let mut all = RECORDED.write().unwrap_or_else(PoisonError::into_inner);
        // Another thread may have been faster.
        let law = known(&all).unwrap_or_else(|| {
            all.push((kind, law.clone()));
            law
        });
        Some(law)
    }

    fn recorded(written: Written, kind: &Kind) -> Law {
        let states = kind.states();
        let columns = FIRST_STATE + states + kind.parameters.len();
        let record = |wanted: std::ops::Range<usize>| {
            let recorded = Recorded::of(columns + 1, wanted, |arguments| match written {
                Written::Joint(law) => law.record(arguments),
                Written::Memory(law) => law.record(arguments),
            });
            // Another number of rows is no record of this law.
            recorded.filter(|recorded| recorded.outputs() == 1 + states)
        };
        let (all, slope) = (record(0..columns), record(VELOCITY..VELOCITY + 1));
        Law {
            states,
            written,
            all,
            slope,
        }
    }

    fn column(&self, column: usize) -> Column {
        match column {
            0 => Column::Position,
            VELOCITY => Column::Velocity,
            2 => Column::Input,
            k if k < FIRST_STATE + self.states => Column::State(k - FIRST_STATE),
            k => Column::Parameter(k - FIRST_STATE - self.states),
        }
    }

    /// Gives Q_j and ḣ, and those of their derivatives that are not zero by the shape of the law, to `each`: the row, the column or none for the quantity
    /// itself, and the number.
    pub fn parts(
        &self,
        at: &At<'_, f64>,
        room: &mut Room,
        mut each: impl FnMut(usize, Option<Column>, f64),
    ) {
        let Some(all) = &self.all else {
            return self.by_duals(at, room, each);
        };
        for (row, column, part) in all.parts(at.arguments(), &mut room.recorded) {
            each(row, column.map(|c| self.column(c)), part);
        }
    }

    /// The same by dual numbers.
    fn by_duals(
        &self,
        &At { seen, p, smoothing }: &At<'_, f64>,
        room: &mut Room,
        mut each: impl FnMut(usize, Option<Column>, f64),
    ) {
        match self.written {
            Written::Joint(law) => {
                let by_p = &mut room.by_p[..p.len()];
                let at = law.derivatives(seen.q, seen.v, p, smoothing, by_p);
                each(0, None, at.force);
                each(0, Some(Column::Position), at.by_q);
                each(0, Some(Column::Velocity), at.by_v);
                for (k, by) in by_p.iter().enumerate() {
                    each(0, Some(Column::Parameter(k)), *by);
                }
            }
            Written::Memory(law) => {
                let found = &mut *room.with_memory;
                law.derivatives(&seen, p, smoothing, found);
                for row in 0..=self.states {
                    each(row, None, found.value(row));
                    let columns = FIRST_STATE + self.states + p.len();
                    for (column, by) in found.by(row).iter().take(columns).enumerate() {
                        each(row, Some(self.column(column)), *by);
                    }
                }
            }
        }
    }

    /// [`parts`](Self::parts) of eight states; a part may come in several pieces.
    pub fn parts_of_eight(
        &self,
        at: &At<'_, Lane>,
        room: &mut Room,
        mut each: impl FnMut(usize, Option<Column>, &Lane),
    ) {
        let Some(all) = &self.all else {
            return at.one_by_one(|lane, at| {
                self.by_duals(at, room, |row, column, part| {
                    each(row, column, &alone(lane, part));
                });
            });
        };
        for (row, column, part) in all.parts_lanes(at.arguments_of_eight(), &mut room.recorded) {
            each(row, column.map(|c| self.column(c)), &part);
        }
    }

    /// Q_j and ḣ, row after row, of eight states; a row may come in several pieces.
    pub fn values_of_eight(
        &self,
        at: &At<'_, Lane>,
        room: &mut Room,
        mut each: impl FnMut(usize, &Lane),
    ) {
        let Some(all) = &self.all else {
            return at.one_by_one(|lane, at| {
                let mut rate = [0.0; MOST_STATES];
                let rate = &mut rate[..self.states];
                each(0, &alone(lane, self.value(at, rate)));
                for (k, rate) in rate.iter().enumerate() {
                    each(1 + k, &alone(lane, *rate));
                }
            });
        };
        let values = all.values_lanes(at.arguments_of_eight(), &mut room.recorded);
        for (row, value) in values.enumerate() {
            each(row, &value);
        }
    }

    /// Q_j, and ḣ into `rate`.
    fn value(&self, &At { seen, p, smoothing }: &At<'_, f64>, rate: &mut [f64]) -> f64 {
        match self.written {
            Written::Joint(law) => law.force(seen.q, seen.v, p, smoothing),
            Written::Memory(law) => law.evaluate(&seen, p, smoothing, rate),
        }
    }

    /// Q_j and ∂Q_j/∂v_j of eight states.
    pub fn slopes_of_eight(&self, at: &At<'_, Lane>, room: &mut Room) -> [Lane; 2] {
        let mut found = [[0.0; LANES]; 2];
        let mut take = |row: usize, column: Option<Column>, part: &Lane| {
            let place = match column {
                None => 0,
                Some(Column::Velocity) => 1,
                Some(_) => return,
            };
            if row == 0 {
                for (to, from) in found[place].iter_mut().zip(part) {
                    *to += from;
                }
            }
        };
        match &self.slope {
            Some(slope) => {
                let parts = slope.parts_lanes(at.arguments_of_eight(), &mut room.recorded);
                for (row, column, part) in parts {
                    take(row, column.map(|c| self.column(c)), &part);
                }
            }
            None => self.parts_of_eight(at, room, take),
        }
        found
    }
}

/// A number of one state, beside zeros.
fn alone(lane: usize, x: f64) -> Lane {
    let mut lanes = [0.0; LANES];
    lanes[lane] = x;
    lanes
}

impl At<'_, f64> {
    fn arguments(&self) -> impl Iterator<Item = f64> {
        let Seen { q, v, f, h } = self.seen;
        let own = h
            .iter()
            .chain(self.p)
            .chain(std::iter::once(&self.smoothing));
        [q, v, f].into_iter().chain(own.copied())
    }
}

impl At<'_, Lane> {
    fn arguments_of_eight(&self) -> impl Iterator<Item = Lane> {
        let Seen { q, v, f, h } = self.seen;
        let constants = self.p.iter().chain(std::iter::once(&self.smoothing));
        let own = h.iter().copied().chain(constants.map(|x| [*x; LANES]));
        [q, v, f].into_iter().chain(own)
    }

    /// Each of the eight states.
    fn one_by_one(&self, mut each: impl FnMut(usize, &At<'_, f64>)) {
        let Seen { q, v, f, h } = self.seen;
        for lane in 0..LANES {
            let mut own = [0.0; MOST_STATES];
            for (to, from) in own.iter_mut().zip(h) {
                *to = from[lane];
            }
            let seen = Seen {
                q: q[lane],
                v: v[lane],
                f: f[lane],
                h: &own[..h.len()],
            };
            let At { p, smoothing, .. } = *self;
            each(lane, &At { seen, p, smoothing });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effect::{Family, MemoryLaw, ParameterSpec, Quantity, WithMemory, registry};
    use lagrange::Scalar;

    /// A law that decides by a number.
    struct Branching;

    impl MemoryLaw for Branching {
        fn states(&self) -> usize {
            1
        }
        fn force<D: Scalar>(&self, seen: &Seen<'_, D>, p: &[D], _: D) -> D {
            match seen.v.re() > 0.0 {
                true => p[0] * seen.h[0],
                false => p[1] * seen.v * seen.q,
            }
        }
        fn rate<D: Scalar>(&self, seen: &Seen<'_, D>, p: &[D], _: D, rate: &mut [D]) {
            rate[0] = seen.f * p[0] - seen.h[0];
        }
        fn start(&self, _: f64, _: f64, _: &[f64], _: &mut [f64]) {}
        fn spread(&self, _: f64, _: f64, _: &[f64], _: &mut [f64]) {}
        fn fastest(&self, _: f64, _: f64, _: &[f64]) -> f64 {
            0.0
        }
    }

    const SIZE: ParameterSpec = ParameterSpec::new("a", Quantity::Ratio, (0.0, 1.0), 0.0);

    static BRANCHING: Kind = Kind {
        name: "branching",
        family: Family::Memory,
        summary: "decides by a number",
        parameters: &[SIZE, ParameterSpec { name: "b", ..SIZE }],
        action: Action::Memory(&WithMemory(Branching)),
        contains: &[],
        probes: |_, _| Vec::new(),
    };

    /// Rows and columns of one state.
    fn table(parts: impl FnOnce(&mut dyn FnMut(usize, Option<Column>, f64))) -> Vec<(String, f64)> {
        let mut all: Vec<(String, f64)> = Vec::new();
        parts(&mut |row, column, part| {
            let name = format!("{row} {column:?}");
            match all.iter_mut().find(|(known, _)| *known == name) {
                Some((_, sum)) => *sum += part,
                None => all.push((name, part)),
            }
        });
        all.retain(|(_, part)| *part != 0.0);
        all.sort_by(|a, b| a.0.cmp(&b.0));
        all
    }

    fn are_the_same(kind: &str, a: &[(String, f64)], b: &[(String, f64)]) {
        assert_eq!(a.len(), b.len(), "{kind}: {a:?} {b:?}");
        for ((name, a), (other, b)) in a.iter().zip(b) {
            let error = (a - b).abs() / (1.0 + b.abs());
            assert!(
                name == other && error < 1e-12,
                "{kind}: {name} {a} {other} {b}"
            );
        }
    }

    /// Programs and dual numbers, one state and eight.
    #[test]
    fn laws_at_eight_states_are_those_at_each_by_dual_numbers() {
        let mut seen = 0;
        let kinds = registry::all().into_iter().chain([&BRANCHING]);
        for (kind, law) in kinds.filter_map(|kind| Some((kind, Law::of(kind)?))) {
            seen += 1;
            let decides = kind.name == "branching";
            assert_eq!(law.all.is_none(), decides, "{}", kind.name);
            let of = |phase: f64| std::array::from_fn(|lane| (phase + 2.3 * lane as f64).sin());
            let h: Vec<Lane> = (0..kind.states()).map(|i| of(5.0 + i as f64)).collect();
            let [q, v, f] = [0.1, 0.9, 2.0].map(of);
            let p: Vec<f64> = (0..kind.parameters.len())
                .map(|k| 0.7 + 0.4 * k as f64)
                .collect();
            let smoothing = 0.3;
            let seen = Seen { q, v, f, h: &h };
            let eight = At {
                seen,
                p: &p,
                smoothing,
            };
            let (mut room, mut another) = (Room::default(), Room::default());
            let slopes = law.slopes_of_eight(&eight, &mut room);
            eight.one_by_one(|lane, at| {
                let exact = table(|each| law.by_duals(at, &mut room, each));
                let recorded = table(|each| law.parts(at, &mut room, each));
                are_the_same(kind.name, &recorded, &exact);
                let own = table(|each| {
                    law.parts_of_eight(&eight, &mut room, |row, column, part| {
                        each(row, column, part[lane]);
                    });
                });
                are_the_same(kind.name, &own, &exact);
                let values = table(|each| {
                    law.values_of_eight(&eight, &mut another, |row, part| {
                        each(row, None, part[lane]);
                    });
                });
                let of_values = exact.iter().filter(|(name, _)| name.ends_with("None"));
                are_the_same(kind.name, &values, &of_values.cloned().collect::<Vec<_>>());
                let slope = exact.iter().find(|(name, _)| name == "0 Some(Velocity)");
                let slope = slope.map_or(0.0, |(_, slope)| *slope);
                assert!((slopes[1][lane] - slope).abs() < 1e-12 * (1.0 + slope.abs()));
            });
        }
        assert!(seen >= 18, "{seen}");
    }

    /// At rest, without states, at the places of stops and at parameters that do nothing, infinite ones among them: what is a number by dual numbers is
    /// the same by the program.
    #[test]
    fn laws_at_corners_are_those_by_dual_numbers() {
        let kinds = registry::all().into_iter();
        for (kind, law) in kinds.filter_map(|kind| Some((kind, Law::of(kind)?))) {
            let usual: Vec<f64> = (0..kind.parameters.len())
                .map(|k| 0.7 + 0.4 * k as f64)
                .collect();
            let mut sets = vec![usual.clone()];
            for (k, spec) in kind.parameters.iter().enumerate() {
                for value in [spec.neutral, spec.lower, spec.upper] {
                    let mut p = usual.clone();
                    p[k] = value;
                    sets.push(p);
                }
            }
            let h = vec![0.0; kind.states()];
            let mut room = Room::default();
            for p in &sets {
                let places = [0.0, -0.0, p.first().copied().unwrap_or(0.3), 1.1, 9.0];
                for (q, v) in places
                    .iter()
                    .flat_map(|q| [0.0, -0.0, 0.4, -0.4].map(|v| (*q, v)))
                {
                    let seen = Seen {
                        q,
                        v,
                        f: 0.0,
                        h: &h,
                    };
                    let at = At {
                        seen,
                        p,
                        smoothing: 0.3,
                    };
                    let exact = table(|each| law.by_duals(&at, &mut room, each));
                    let found = table(|each| law.parts(&at, &mut room, each));
                    let of = |all: &[(String, f64)], name: &str| {
                        let own = all.iter().find(|(known, _)| known == name);
                        own.map_or(0.0, |(_, x)| *x)
                    };
                    for (name, _) in exact.iter().chain(&found) {
                        let (a, b) = (of(&found, name), of(&exact, name));
                        let same = !b.is_finite() || (a - b).abs() <= 1e-12 * (1.0 + b.abs());
                        assert!(same, "{}: {name} {a} {b} at {q}, {v}, {p:?}", kind.name);
                    }
                }
            }
        }
    }

    #[test]
    fn a_law_is_recorded_once() {
        let [first, second] = [(), ()].map(|()| Law::of(&BRANCHING));
        let same = first.zip(second).map(|(a, b)| Arc::ptr_eq(&a, &b));
        assert_eq!(same, Some(true));
        let gain = registry::find("input_gain_error");
        assert!(gain.and_then(Law::of).is_none());
    }
}
