//! Steps that end at events.

use super::error::ContactError;
use super::friction::At;
use super::impact::Impact;
use super::law::Kind;
use super::mode::Mode;
use super::motion::{Contact, Work, levels};
use super::rest::Rest;
use super::root::last_bracket;
use super::{ContactSystem, Event, EventKind, Law};
use crate::fixed::OFF_SPACE;
use crate::{Rk4, Space};

/// Where impacts end and when contacts are held.
///
/// A body that bounces with e < 1 strikes infinitely often in a finite time. An impact whose rebound w·v⁺ would be slower than
/// [`least_rebound`](Self::least_rebound) has none: the contact closes. That is off by less than 2 least_rebound/ẅ in time where ẅ
/// is the acceleration that presses the contact together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// In the unit of w·v; by default 1e-9.
    pub least_rebound: f64,
    /// After this many impacts of one law within one step it does not rebound until the step ends, and after this many blows within one
    /// instant nothing does; by default 100.
    pub most_impacts: usize,
    /// A friction that has changed between sliding and rest this often within one step is held at rest until the step ends; by
    /// default 16.
    pub most_changes: usize,
    /// This many events within one step are an error; by default 1000.
    pub most_events: usize,
    /// A motion that starts behind a stop by no more than this starts on it, one that starts further behind is refused; in the unit
    /// of the gap, by default 1e-12.
    pub least_depth: f64,
}

impl Default for Limits {
    fn default() -> Self {
        Limits {
            least_rebound: 1e-9,
            most_impacts: 100,
            most_changes: 16,
            most_events: 1000,
            least_depth: 1e-12,
        }
    }
}

/// Roots are found to this part of a step.
const RESOLUTION: f64 = 1e-15;

/// Steps a [`ContactSystem`] with its laws by the classical Runge-Kutta method, from event to event.
///
/// A step in which a contact changes ends there: each trial of the search for the instant is a step of its own from the state where
/// the step began, so the state there and the instant have the error of a step, order 4 over a whole motion. What begins and ends
/// within one step is not seen: a velocity that touches 0 in between, a gap that closes and opens again.
///
/// A state x = (q, v) has all that the motion needs; calls may follow each other with any states and inputs.
#[derive(Debug)]
pub struct EventStepper<S: ContactSystem> {
    laws: Vec<Law>,
    limits: Limits,
    mode: Mode,
    work: Work<S::Memory>,
    impact: Impact,
    rest: Rest,
    rk4: Rk4<f64>,
    trial: Vec<f64>,
    /// Where the last call ended.
    last: Vec<f64>,
    margin: Vec<f64>,
    still: Vec<bool>,
    let_go: Vec<bool>,
    before: Vec<Contact>,
    changes: Vec<usize>,
    count: usize,
    started: bool,
    events: Vec<Event>,
}

impl<S: ContactSystem> EventStepper<S> {
    /// A stepper of `system` with `laws`, which events name by their place in the list.
    ///
    /// # Errors
    /// [`ContactError::Law`] for the first law that does not fit.
    pub fn new(system: &S, laws: Vec<Law>) -> Result<Self, ContactError<S::Error>> {
        let (nq, nv) = (system.positions().dim(), system.positions().tangent_dim());
        for (law, fault) in laws.iter().enumerate() {
            if let Err(fault) = fault.check(nq, nv) {
                return Err(ContactError::Law { law, fault });
            }
        }
        let n = laws.len();
        Ok(EventStepper {
            limits: Limits::default(),
            mode: Mode::new(n),
            work: Work::new(nv, n, system.memory()),
            impact: Impact::default(),
            rest: Rest::default(),
            rk4: Rk4::new(nq + nv),
            trial: vec![0.0; nq + nv],
            last: vec![0.0; nq + nv],
            margin: vec![0.0; n],
            still: vec![false; n],
            let_go: vec![false; n],
            before: vec![Contact::Open; n],
            changes: vec![0; n],
            count: 0,
            started: false,
            events: Vec::with_capacity(64),
            laws,
        })
    }

    /// With other limits.
    #[must_use]
    pub fn with_limits(mut self, limits: Limits) -> Self {
        self.limits = limits;
        self
    }

    /// The events since they were last [cleared](Self::clear_events), in the order of time. The list grows; nothing else does
    /// after the first steps.
    pub fn events(&self) -> &[Event] {
        &self.events
    }

    /// Forgets the events.
    pub fn clear_events(&mut self) {
        self.events.clear();
    }

    /// Replaces x at `start` by x at `start + duration`, in `steps` equal steps, with `u` held.
    ///
    /// # Errors
    /// See [`ContactError`]; x is then the state at the last event, or at the end of the last step, before.
    pub fn advance(
        &mut self,
        system: &S,
        (start, duration, steps): (f64, f64, usize),
        u: &S::Input,
        x: &mut [f64],
    ) -> Result<(), ContactError<S::Error>> {
        check_length(system, x)?;
        if !(duration >= 0.0 && (start + duration).is_finite()) || steps == 0 {
            return Err(ContactError::Duration { duration, steps });
        }
        check_finite(start, x)?;
        if self.started && self.last == x {
            self.note_rest();
        } else {
            self.start(system, start, x)?;
            self.still.fill(false);
            self.started = false;
        }
        self.changes.fill(0);
        self.let_go.fill(false);
        self.count = 0;
        self.settle(system, start, u, x)?;
        let h = duration / steps as f64;
        for i in 0..steps {
            self.step(system, (start + i as f64 * h, h), u, x)?;
        }
        self.last.copy_from_slice(x);
        Ok(())
    }

    /// Refuses a state of the wrong length, one that is no number, and one behind a stop; what is behind a stop by rounding is put
    /// on it.
    pub(super) fn start(
        &self,
        system: &S,
        time: f64,
        x: &mut [f64],
    ) -> Result<(), ContactError<S::Error>> {
        check_length(system, x)?;
        check_finite(time, x)?;
        let (q, _) = x.split_at_mut(system.positions().dim());
        let distance = system.positions().distance(q);
        if distance > OFF_SPACE {
            return Err(ContactError::OffSpace { time, distance });
        }
        for (law, stop) in self.laws.iter().enumerate() {
            let (gap, rounding) = stop.gap(q);
            if gap < -rounding.max(self.limits.least_depth) {
                return Err(ContactError::Penetration { law, time, gap });
            }
            if gap < -rounding {
                stop.close(q);
            }
        }
        Ok(())
    }

    /// What is at rest now is so beyond the digits of v.
    fn note_rest(&mut self) {
        for (still, contact) in self.still.iter_mut().zip(&self.mode.contacts) {
            *still = contact.at_rest();
        }
    }

    /// One step from t to t + h, in as many parts as there are events in it.
    fn step(
        &mut self,
        system: &S,
        (t, h): (f64, f64),
        u: &S::Input,
        x: &mut [f64],
    ) -> Result<(), ContactError<S::Error>> {
        self.changes.fill(0);
        self.count = 0;
        if self.mode.held.contains(&true) {
            self.mode.held.fill(false);
            self.let_go.fill(false);
            self.note_rest();
            self.settle(system, t, u, x)?;
        }
        let mut done = 0.0;
        loop {
            let left = h - done;
            if left <= RESOLUTION * h {
                return Ok(());
            }
            let time = t + done;
            let at_end = self.try_step(system, (time, left), u, x)?;
            if at_end >= 0.0 {
                self.accept(system, x);
                return Ok(());
            }
            let at_start = self.mode.motion(system, &self.laws).margins(
                time,
                x,
                u,
                &self.mode.held,
                &mut self.work,
                &mut self.margin,
            )?;
            let part = last_bracket(
                |part| self.try_step(system, (time, part), u, x),
                (at_start, left, at_end),
                RESOLUTION * h,
            )?;
            self.accept(system, x);
            done += part;
            self.at_event(system, t + done, u, x)?;
        }
    }

    /// A step from x into `trial`; the least margin there.
    fn try_step(
        &mut self,
        system: &S,
        (time, h): (f64, f64),
        u: &S::Input,
        x: &[f64],
    ) -> Result<f64, ContactError<S::Error>> {
        self.trial.copy_from_slice(x);
        let motion = self.mode.motion(system, &self.laws);
        self.rk4
            .step_in_space(&motion, (time, h), u, &mut self.work, &mut self.trial)?;
        check_finite(time + h, &self.trial)?;
        motion.margins(
            time + h,
            &self.trial,
            u,
            &self.mode.held,
            &mut self.work,
            &mut self.margin,
        )
    }

    /// Makes the trial the state.
    fn accept(&mut self, system: &S, x: &mut [f64]) {
        x.copy_from_slice(&self.trial);
        let (q, v) = x.split_at_mut(system.positions().dim());
        let at_rest = self.mode.at_rest.iter().copied();
        self.rest.apply(&self.laws, at_rest, q, v);
    }

    /// The contacts after the events that the margins tell of.
    fn at_event(
        &mut self,
        system: &S,
        time: f64,
        u: &S::Input,
        x: &mut [f64],
    ) -> Result<(), ContactError<S::Error>> {
        self.note_rest();
        let (q, v) = x.split_at_mut(system.positions().dim());
        for (k, law) in self.laws.iter().enumerate() {
            let happens = self.margin[k] < 0.0;
            let contact = self.mode.contacts[k];
            self.let_go[k] = happens && contact.holds();
            if !happens {
                continue;
            }
            // What holds nothing at rest turns as often as it likes.
            let at = At { time, q, v };
            let holds = match &law.kind {
                Kind::Friction { size, .. } => levels(k, size.as_ref(), at)? != (0.0, 0.0),
                Kind::Stop { .. } => true,
            };
            self.changes[k] += usize::from(holds);
            self.count += 1;
            if self.count >= self.limits.most_events {
                return Err(ContactError::TooManyEvents {
                    time,
                    events: self.count,
                    law: k,
                });
            }
            if matches!(contact, Contact::Slides(_)) {
                self.still[k] = true;
            }
            if matches!(contact, Contact::Slides(_) | Contact::Sticks)
                && self.changes[k] > self.limits.most_changes
            {
                self.mode.held[k] = true;
                self.events.push(Event {
                    time,
                    law: k,
                    kind: EventKind::Held,
                });
            }
        }
        let still = (0..self.laws.len()).filter(|&k| self.still[k]);
        self.rest.apply(&self.laws, still, q, v);
        self.settle(system, time, u, x)
    }

    /// Impacts, then the contacts that are consistent; both go into the list of events.
    fn settle(
        &mut self,
        system: &S,
        time: f64,
        u: &S::Input,
        x: &mut [f64],
    ) -> Result<(), ContactError<S::Error>> {
        self.before.copy_from_slice(&self.mode.contacts);
        let Limits {
            least_rebound,
            most_impacts,
            ..
        } = self.limits;
        let mut problem = std::mem::take(&mut self.mode.problem);
        // A blow may make bodies approach that parted: then it is their turn.
        let mut blows = 0;
        let resolved = loop {
            let (changes, last) = (&self.changes, blows == most_impacts);
            let restitution = |law: usize, e: f64, speed: f64| {
                let many = changes.get(law).is_some_and(|n| n + blows > most_impacts);
                if last || many || e * speed < least_rebound {
                    0.0
                } else {
                    e
                }
            };
            let struck = self.impact.strike(
                (&self.mode.motion(system, &self.laws), last),
                (time, &mut *x, u),
                restitution,
                (&mut problem, &mut self.rest, &mut self.work),
                &mut self.still,
                &mut self.events,
            );
            match struck {
                Ok(true) if !last => blows += 1,
                ended => break ended,
            }
        };
        self.mode.problem = problem;
        resolved?;
        self.mode.find(
            (system, &self.laws),
            (time, x, u),
            (&self.still, &self.let_go),
            &mut self.work,
        )?;
        let (q, v) = x.split_at_mut(system.positions().dim());
        let at_rest = self.mode.at_rest.iter().copied();
        self.rest.apply(&self.laws, at_rest, q, v);
        if self.started {
            for (law, (before, now)) in self.before.iter().zip(&self.mode.contacts).enumerate() {
                if let Some(kind) = change(*before, *now, self.laws[law].slip(v).0) {
                    self.events.push(Event { time, law, kind });
                }
            }
        }
        self.started = true;
        Ok(())
    }
}

/// What the list of events says of a change.
fn change(before: Contact, now: Contact, slip: f64) -> Option<EventKind> {
    match (before, now) {
        (before, now) if before == now => None,
        (_, Contact::Slides(direction)) => Some(EventKind::Slides(direction)),
        (Contact::Sticks | Contact::Idles(_), Contact::Sticks | Contact::Idles(_)) => None,
        (_, Contact::Sticks | Contact::Idles(_)) => Some(EventKind::Sticks),
        (_, Contact::Rests) => Some(EventKind::Rests),
        // After an impact the list has that.
        (Contact::Rests, Contact::Open) if slip <= 0.0 => Some(EventKind::LetsGo),
        _ => None,
    }
}

fn check_length<S: ContactSystem>(system: &S, x: &[f64]) -> Result<(), ContactError<S::Error>> {
    let (found, expected) = (
        x.len(),
        system.positions().dim() + system.positions().tangent_dim(),
    );
    if found == expected {
        Ok(())
    } else {
        Err(ContactError::State { found, expected })
    }
}

fn check_finite<E>(time: f64, x: &[f64]) -> Result<(), ContactError<E>> {
    match x.iter().enumerate().find(|(_, x)| !x.is_finite()) {
        Some((component, &value)) => Err(ContactError::NotFinite {
            time,
            component,
            value,
        }),
        None => Ok(()),
    }
}
