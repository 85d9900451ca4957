use super::Direction;

/// What happened to a contact, and when.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Event {
    /// s.
    pub time: f64,
    /// The law's place in the list.
    pub law: usize,
    /// What.
    pub kind: EventKind,
}

/// What happens to contacts.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum EventKind {
    /// A friction begins to slide, from rest or from the other direction.
    Slides(Direction),
    /// A friction comes to rest.
    Sticks,
    /// A stop is struck, or passes a blow on.
    Impact {
        /// w·v⁻, below 0 where something strikes.
        before: f64,
        /// w·v⁺.
        after: f64,
    },
    /// A stop stays closed and carries.
    Rests,
    /// A stop that carried does so no more.
    LetsGo,
    /// A friction that changed too often within one step is held at rest until the step ends, whatever it takes: the motion is not
    /// that of the laws from here on.
    Held,
}
