//! The kinds there are. A new kind of this library is one file beside this one and one line here; one of another crate is
//! [`register`]ed.

use std::sync::{PoisonError, RwLock};

use super::Kind;
use super::joint_force::MOST_PARAMETERS;

/// All kinds of this library, in the order of contract and reports.
pub static ALL: &[&Kind] = &[
    &super::viscous_friction::KIND,
    &super::coulomb_friction::KIND,
    &super::asymmetric_coulomb_friction::KIND,
    &super::asymmetric_viscous_friction::KIND,
    &super::stribeck_friction::KIND,
    &super::quadratic_drag::KIND,
    &super::load_dependent_friction::KIND,
    &super::position_dependent_friction::KIND,
    &super::linear_spring::KIND,
    &super::cubic_spring::KIND,
    &super::constant_force::KIND,
    &super::gravity_tilt::KIND,
    &super::end_stop::KIND,
    &super::periodic_force::KIND,
    &super::input_gain_error::KIND,
    &super::input_offset::KIND,
    &super::input_delay::KIND,
    &super::actuator_lag::KIND,
    &super::input_dead_zone::KIND,
    &super::input_saturation::KIND,
    &super::backlash::KIND,
    &super::elastic_transmission::KIND,
    &super::added_mass::KIND,
    &super::payload::KIND,
    &super::centre_of_mass::KIND,
    &super::link_inertia::KIND,
    &super::reflected_inertia::KIND,
    &super::sensor_offset::KIND,
    &super::sensor_scale::KIND,
    &super::sensor_delay::KIND,
    &super::dahl_friction::KIND,
    &super::lugre_friction::KIND,
    &super::hysteresis::KIND,
];

/// Kinds of other crates, in the order in which they came.
static REGISTERED: RwLock<Vec<&'static Kind>> = RwLock::new(Vec::new());

/// A kind that cannot be registered.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum RegisterError {
    /// Another kind has its name.
    #[error("a kind of effect is called `{name}` already: give yours another name")]
    Taken {
        /// The name.
        name: &'static str,
    },
    /// Model files could not name it, or its parameters.
    #[error(
        "`{name}` cannot be written as a key of a model file: use small letters, digits and underscores, a letter first"
    )]
    Unwritable {
        /// The name of the kind or of a parameter.
        name: &'static str,
    },
    /// A law of a joint takes at most eight parameters.
    #[error(
        "the kind `{kind}` has {count} parameters, at most {MOST_PARAMETERS} are possible: fix some of them in the law"
    )]
    TooMany {
        /// The kind.
        kind: &'static str,
        /// How many it has.
        count: usize,
    },
    /// Two parameters, or a parameter and a key that every effect has, go by one name.
    #[error(
        "the kind `{kind}` has the parameter `{name}` twice, or it is a key that every effect has: rename it"
    )]
    Ambiguous {
        /// The kind.
        kind: &'static str,
        /// The parameter.
        name: &'static str,
    },
}

/// Makes a kind of another crate known to this process: model files may name it, and every diagnosis from here on tries it wherever it
/// makes sense. To be called before models are loaded; the order of calls is the order of the candidates, which a seed's result may
/// depend on.
///
/// ```
/// use pinode_nn::effect::registry::{self, RegisterError};
/// use pinode_nn::effect::{
///     Action, Family, ForceLaw, Kind, OnCoordinate, ParameterSpec, Probe, Quantity,
/// };
/// use lagrange::Scalar;
///
/// /// Q = −c v³: a damper that stiffens.
/// struct CubicDamper;
///
/// impl ForceLaw for CubicDamper {
///     fn force<D: Scalar>(&self, _q: D, v: D, p: &[D], _smoothing: D) -> D {
///         -p[0] * v * v * v
///     }
/// }
///
/// static KIND: Kind = Kind {
///     name: "cubic_damper",
///     family: Family::Friction,
///     summary: "force against the velocity, proportional to its cube",
///     parameters: &[ParameterSpec::new("coefficient", Quantity::Ratio, (0.0, f64::INFINITY), 0.0)],
///     action: Action::Joint(&OnCoordinate(CubicDamper)),
///     contains: &[],
///     probes: |scales, _| {
///         let perturbed = vec![scales.small_force() / scales.speed.powi(3)];
///         vec![Probe { neutral: vec![0.0], perturbed }]
///     },
/// };
///
/// registry::register(&KIND)?;
/// assert!(registry::find("cubic_damper").is_some());
/// assert_eq!(registry::register(&KIND), Err(RegisterError::Taken { name: "cubic_damper" }));
/// # Ok::<(), RegisterError>(())
/// ```
///
/// # Errors
/// [`RegisterError`] when the names of the kind or of its parameters cannot stand in a model file beside the others.
pub fn register(kind: &'static Kind) -> Result<(), RegisterError> {
    let names = || kind.parameters.iter().map(|p| p.name);
    for name in std::iter::once(kind.name).chain(names()) {
        if !is_key(name) {
            return Err(RegisterError::Unwritable { name });
        }
    }
    let count = kind.parameters.len();
    if count > MOST_PARAMETERS {
        let kind = kind.name;
        return Err(RegisterError::TooMany { kind, count });
    }
    for (k, name) in names().enumerate() {
        if KEYS.contains(&name) || names().take(k).any(|other| other == name) {
            let kind = kind.name;
            return Err(RegisterError::Ambiguous { kind, name });
        }
    }
    let mut registered = REGISTERED.write().unwrap_or_else(PoisonError::into_inner);
    let same = |other: &&Kind| other.name == kind.name;
    if ALL.iter().any(same) || registered.iter().any(same) {
        return Err(RegisterError::Taken { name: kind.name });
    }
    registered.push(kind);
    Ok(())
}

/// The keys of every `[[effect]]`.
const KEYS: [&str; 6] = ["kind", "joint", "input", "link", "fixed", "smoothing"];

fn is_key(name: &str) -> bool {
    name.starts_with(|c: char| c.is_ascii_lowercase())
        && name
            .chars()
            .all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_')
}

/// All kinds, those of this library first.
pub fn all() -> Vec<&'static Kind> {
    let registered = REGISTERED.read().unwrap_or_else(PoisonError::into_inner);
    ALL.iter().chain(registered.iter()).copied().collect()
}

/// The kind called `name`.
pub fn find(name: &str) -> Option<&'static Kind> {
    all().into_iter().find(|kind| kind.name == name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effect::Scales;

    #[test]
    fn parameters_make_a_kind_what_it_is_called() {
        let scales = Scales {
            centre: 0.1,
            reach: 0.3,
            speed: 1.0,
            force: 2.0,
            mass: 0.5,
            free_mass: 0.5,
            input: 2.0,
            largest_input: 5.0,
            struck: [None; 2],
            held: 0.0,
            pace: 1.0,
            noise: 1e-3,
        };
        let cases: [(&str, &[f64], bool); 21] = [
            // A blow of 7 ms, and one of 0.7 s.
            ("end_stop", &[-0.2, 0.2, 1e5, 100.0], true),
            ("end_stop", &[-0.2, 0.2, 10.0, 1.0], false),
            // It pulls from where the motion is, or from 4 m away.
            ("linear_spring", &[2.0, 0.03], true),
            ("linear_spring", &[0.02, -3.93], false),
            // Ten periods in the range of the motion, and less than one.
            ("periodic_force", &[0.1, 0.06, 0.0], true),
            ("periodic_force", &[0.1, 0.66, 0.0], false),
            // It slips after 3 mm, or never.
            ("hysteresis", &[30.0, 3e-3], true),
            ("hysteresis", &[0.01, 1e54], false),
            ("dahl_friction", &[50.0, 0.3], true),
            ("dahl_friction", &[0.5, 0.3], false),
            ("lugre_friction", &[100.0, 1.0, 0.2, 0.5, 0.05], true),
            ("lugre_friction", &[0.1, 1.0, 0.2, 0.5, 0.05], false),
            // Almost no force at rest; a hump at speeds that no one has seen.
            ("lugre_friction", &[100.0, 1.0, 0.2, 1e-6, 0.05], false),
            ("stribeck_friction", &[0.2, 0.5, 0.05], true),
            ("stribeck_friction", &[0.2, 15.0, 1e-4], false),
            ("stribeck_friction", &[0.2, 1e-6, 2.0], false),
            ("stribeck_friction", &[0.2, 0.15, 0.05], false),
            // A twentieth of the critical damping, and five times as much.
            (
                "elastic_transmission",
                &[75.0, 0.3, 0.035, 0.0, 0.0, 0.0],
                true,
            ),
            (
                "elastic_transmission",
                &[221.0, 16.9, 0.0162, 0.0, 0.0, 0.0],
                false,
            ),
            ("backlash", &[1e-4, 1e4, 10.0, 1e-2, 0.0], true),
            ("backlash", &[0.0, 1e4, 10.0, 1e-2, 0.0], false),
        ];
        for (name, p, expected) in cases {
            let itself = find(name).map(|kind| kind.is_itself(&scales, p));
            assert_eq!(itself, Some(expected), "{name} {p:?}");
        }
    }

    #[test]
    fn what_comes_late_or_has_a_memory_follows_from_what_was() {
        let remembers = |name: &str| find(name).map(super::super::Kind::remembers);
        let late = [
            "input_delay",
            "actuator_lag",
            "backlash",
            "elastic_transmission",
            "sensor_delay",
            "dahl_friction",
            "hysteresis",
        ];
        for name in late {
            assert_eq!(remembers(name), Some(true), "{name}");
        }
        for name in [
            "coulomb_friction",
            "input_gain_error",
            "input_dead_zone",
            "sensor_scale",
            "added_mass",
        ] {
            assert_eq!(remembers(name), Some(false), "{name}");
        }
    }
}
