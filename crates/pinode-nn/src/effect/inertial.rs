//! Effects that change the mechanics themselves, and where they make sense.

use std::fmt;

use lagrange::Mechanics;
use lagrange::mechanism::{Body, Tree};
use nalgebra::{Cholesky, Matrix3, Vector3};

use crate::entries::starts;
use crate::motion::{NotFree, check_free};
use crate::typical::typical;

/// A horizontal part of an axis below this counts as none.
const VERTICAL: f64 = 1e-6;
/// Two directions of which the cosine is larger are one.
const PARALLEL: f64 = 0.99;
/// The share of an inertia by which a screen probes for more of it: what the free constants leave of a change that they imitate is far less
/// than what of it is not linear, unless it is small.
pub(super) const PROBE: f64 = 1e-4;

/// A payload, or a centre of mass, is so many times as far from the joint as the model's centre of mass at most: what is farther is a rotor.
pub(super) const FARTHEST: f64 = 10.0;
/// A centre of mass that is closer to the joint than this part of the body's radius of gyration is there.
const CENTRED: f64 = 1e-6;

/// What is taken from a mass leaves at least this share of it: nothing moves without mass.
const LEFT: f64 = 0.1;

/// An effect that adds to M, C and G, or takes from them.
///
/// With ID(q, v, v̇; g) = M v̇ + C v + G of the mechanism under gravity g, the motion obeys
///
/// ID + Σ I v̇_j e_j − Σ J v̇_j e_j + Σ m ID₁(q, v, v̇; g, s) + Σ (sin α G(q; |g| d) + (cos α − 1) G(q; g)) = Q
///
/// I of rotors, J of motors that moved with their joint and now move by themselves. ID₁ is that of the same joints with nothing but 1 kg on one body, s times as
/// far from its joint as its centre of mass (s = 1 of an added mass), and d is a horizontal direction ([`tilt_direction`]). A centre of mass that moves is a mass that is
/// taken from s = 1 and put elsewhere; inertia without a mass is ½ ∂²ID₁/∂s², of which ID₁ has no higher ones. What is tilted are the weights of all these too.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Inertial {
    /// Inertia on one coordinate that accelerates with it and with nothing else; its target is a joint.
    Rotor,
    /// Inertia that one coordinate has and that moves by itself; its target is an input on that coordinate.
    Motor,
    /// A point mass at the centre of mass of a body; its target is a link of the body.
    PointMass,
    /// A point mass anywhere on the line from a body's joint through its centre of mass; its target is a link of the body.
    Payload,
    /// The centre of mass elsewhere on that line, the mass and the inertia about it as they are; its target is a link of the body.
    Centre,
    /// Inertia about the axes normal to that line; its target is a link of the body.
    OfLink,
    /// The base stands at an angle; its target is the joint that says about which direction.
    Tilt,
}

/// 1/(M⁻¹)_jj of a coordinate of one number at the [typical] configuration, kg or kg·m².
pub(crate) fn moved(coordinate: usize, mechanics: &dyn Mechanics) -> Option<f64> {
    let at = starts(mechanics.coordinates()).get(coordinate)?.v;
    let inverse = Cholesky::new(typical(mechanics).1?)?.inverse();
    Some(1.0 / inverse.get((at, at))?)
}

impl fmt::Display for Inertial {
    /// The name of the kind.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Inertial::Rotor => "reflected_inertia",
            Inertial::Motor => "a motor whose inertia the mechanism has",
            Inertial::PointMass => "added_mass",
            Inertial::Payload => "payload",
            Inertial::Centre => "centre_of_mass",
            Inertial::OfLink => "link_inertia",
            Inertial::Tilt => "gravity_tilt",
        })
    }
}

/// Why an effect that changes the mechanics cannot sit where it should.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Misplaced {
    /// The coordinates obey equations.
    #[error(
        "{change} is for mechanisms without constraints, and this one obeys {count} (`{first}` …): change the masses of the mechanism itself"
    )]
    Constrained {
        /// The effect.
        change: Inertial,
        /// How many are in force.
        count: usize,
        /// The first of them.
        first: String,
    },
    /// T is not ½ vᵀ M(q) v.
    #[error(
        "{change} changes M(q), and T is not quadratic in the velocities, so that M is not all of it: write the inertia into `kinetic`"
    )]
    NotQuadratic {
        /// The effect.
        change: Inertial,
    },
    /// The mechanism is energies, without bodies.
    #[error(
        "{change} needs the bodies of a URDF, and [lagrangian] has energies only: write it into `kinetic` and `potential`"
    )]
    NoBodies {
        /// The effect.
        change: Inertial,
    },
    /// The link does not move.
    #[error(
        "{change} sits on `{link}`, which is welded to the world and moves no mass: name a link that moves"
    )]
    Welded {
        /// The effect.
        change: Inertial,
        /// The link.
        link: String,
    },
    /// The centre of mass is where the joint is.
    #[error(
        "{change} sits on `{link}`, whose centre of mass is where its joint is: no line leads from one through the other; use added_mass or reflected_inertia there, or say where the centre of mass is"
    )]
    Centred {
        /// The effect.
        change: Inertial,
        /// The link.
        link: String,
    },
    /// A turn about a vertical axis, or a vertical rail, does not change how gravity acts.
    #[error(
        "gravity_tilt sits on `{coordinate}`, whose axis is vertical: no direction of the tilt is told by it; name a joint with a horizontal axis"
    )]
    Vertical {
        /// The coordinate.
        coordinate: String,
    },
    /// There is no gravity.
    #[error("gravity_tilt tilts gravity, and `gravity` is 0: leave it out")]
    Weightless,
    /// There is no such joint or link.
    #[error(
        "{change} sits on number {index}, counted from 0, and there are {count}: name one of them"
    )]
    NoSuchTarget {
        /// The effect.
        change: Inertial,
        /// The index.
        index: usize,
        /// How many there are.
        count: usize,
    },
}

/// The least inertia of a body about an axis through its centre of mass that is normal to the line there from its joint, kg·m².
fn across(body: &Body) -> f64 {
    let Some(line) = body.centre.try_normalize(0.0) else {
        return 0.0;
    };
    let across = Matrix3::identity() - line * line.transpose();
    let mut moments = (across * body.inertia * across).symmetric_eigenvalues();
    moments.as_mut_slice().sort_by(f64::total_cmp);
    // The least of the three is that about the line, which is projected away.
    moments[1].max(0.0)
}

/// The inertia of a body about an axis through its joint, normal to the line from there to its centre of mass, kg·m².
pub(crate) fn about_joint(body: &Body) -> f64 {
    across(body) + body.mass * body.centre.norm_squared()
}

/// Whether the centre of mass of a body is where its joint is.
fn is_centred(body: &Body) -> bool {
    let gyration = (body.inertia.trace() / body.mass.max(f64::MIN_POSITIVE)).sqrt();
    body.centre.norm() <= CENTRED * gyration
}

impl Inertial {
    /// Whether its parameters make it what it is called.
    pub(super) fn is_itself(self, p: &[f64]) -> bool {
        self != Inertial::Payload || (p[0] > 0.0 && p[1] > 0.0 && p[1] < FARTHEST)
    }

    /// Whether its target is a link.
    pub fn is_on_link(self) -> bool {
        matches!(
            self,
            Inertial::PointMass | Inertial::Payload | Inertial::Centre | Inertial::OfLink
        )
    }

    /// How much it may take from the mechanism on `target`, a coordinate or a link, kg or kg·m²: nine tenths of the mass of the link's body, of its inertia, or of what
    /// the coordinate moves where all else gives way, 1/(M⁻¹)_jj at the neutral configuration.
    pub(crate) fn may_take(
        self,
        target: usize,
        mechanics: &dyn Mechanics,
        tree: Option<&Tree>,
    ) -> f64 {
        let body = || {
            let tree = tree?;
            tree.bodies().get(tree.links().get(target)?.body?)
        };
        let there = match self {
            Inertial::PointMass => body().map(|body| body.mass),
            Inertial::OfLink => body().map(across),
            Inertial::Rotor => moved(target, mechanics),
            Inertial::Motor | Inertial::Payload | Inertial::Centre | Inertial::Tilt => None,
        };
        (1.0 - LEFT) * there.unwrap_or(0.0)
    }

    /// Whether it can sit on `target`, a coordinate (of an input, its own) or a link of the mechanism with the constants `p`, whose bodies
    /// are `tree`.
    ///
    /// # Errors
    /// [`Misplaced`].
    pub fn check(
        self,
        target: usize,
        mechanics: &dyn Mechanics,
        p: &[f64],
        tree: Option<&Tree>,
    ) -> Result<(), Misplaced> {
        if let Some(constraints) = mechanics.constraints() {
            let names = constraints.names();
            return Err(Misplaced::Constrained {
                change: self,
                count: names.len(),
                first: names.first().cloned().unwrap_or_default(),
            });
        }
        // For rigid bodies it always is.
        if tree.is_none()
            && let Err(NotFree::NotQuadratic { .. }) = check_free(mechanics, p)
        {
            return Err(Misplaced::NotQuadratic { change: self });
        }
        let on_joint = |index: usize| match mechanics.coordinates().get(index) {
            Some(coordinate) if !coordinate.floating => Ok(coordinate),
            _ => Err(Misplaced::NoSuchTarget {
                change: self,
                index,
                count: mechanics.coordinates().len(),
            }),
        };
        match self {
            Inertial::Rotor | Inertial::Motor => on_joint(target).map(|_| ()),
            Inertial::PointMass | Inertial::Payload | Inertial::Centre | Inertial::OfLink => {
                let tree = tree.ok_or(Misplaced::NoBodies { change: self })?;
                let link = tree.links().get(target).ok_or(Misplaced::NoSuchTarget {
                    change: self,
                    index: target,
                    count: tree.links().len(),
                })?;
                let name = || link.name.clone();
                let body = link.body.and_then(|body| tree.bodies().get(body));
                match body {
                    None => Err(Misplaced::Welded {
                        change: self,
                        link: name(),
                    }),
                    Some(body) if self != Inertial::PointMass && is_centred(body) => {
                        Err(Misplaced::Centred {
                            change: self,
                            link: name(),
                        })
                    }
                    Some(_) => Ok(()),
                }
            }
            Inertial::Tilt => {
                let coordinate = on_joint(target)?;
                let tree = tree.ok_or(Misplaced::NoBodies { change: self })?;
                if tree.gravity() == [0.0; 3] {
                    return Err(Misplaced::Weightless);
                }
                match tilt_direction(tree, target) {
                    Some(_) => Ok(()),
                    None => Err(Misplaced::Vertical {
                        coordinate: coordinate.name.clone(),
                    }),
                }
            }
        }
    }
}

/// The coordinates about which a base may be found to be tilted: those of joints on the base whose axes are not vertical; of an arm that turns about a vertical axis there,
/// the first joint of each horizontal direction.
pub(crate) fn tilts(tree: &Tree) -> Vec<usize> {
    let joint_of = |body: &Body| tree.joints().get(body.joint?);
    let coordinate = |body: &Body| {
        let joint = joint_of(body).filter(|joint| joint.is_independent())?;
        let c = joint.coordinate?;
        Some((c, Vector3::from(tilt_direction(tree, c)?)))
    };
    let bodies = tree.bodies().iter();
    let on_base = bodies.clone().filter(|body| body.parent.is_none());
    let on_base: Vec<usize> = on_base.filter_map(coordinate).map(|(c, _)| c).collect();
    if !on_base.is_empty() {
        return on_base;
    }
    let mut told: Vec<(usize, Vector3<f64>)> = Vec::new();
    for (c, direction) in bodies.filter_map(coordinate) {
        let is_new = |(_, other): &(usize, Vector3<f64>)| other.dot(&direction).abs() < PARALLEL;
        if told.iter().all(is_new) {
            told.push((c, direction));
        }
    }
    told.into_iter().map(|(c, _)| c).collect()
}

/// The horizontal unit direction d towards which gravity moves where the base is tilted about coordinate `c`, in the world's axes; `None`
/// for a vertical axis, and where nothing has weight.
///
/// For a coordinate that slides, against the horizontal part of its axis: a positive angle raises the positive end. For one that turns,
/// −axis × g: a positive angle turns the base about the joint's axis. The axes are those of the neutral configuration.
pub fn tilt_direction(tree: &Tree, c: usize) -> Option<[f64; 3]> {
    let g = Vector3::from(tree.gravity());
    let down = g.try_normalize(0.0)?;
    let joint = tree.joints().iter().find(|joint| {
        let first = joint.coordinate.unwrap_or(usize::MAX);
        // A planar joint has three coordinates.
        joint.is_independent() && (first..first.saturating_add(3)).contains(&c) && {
            tree.coordinates()
                .get(c)
                .is_some_and(|own| own.joint == joint.name)
        }
    })?;
    let link = tree
        .links()
        .iter()
        .position(|link| link.name == joint.child)?;
    let start = starts(tree.coordinates()).get(c)?.v;
    let neutral = lagrange::state::neutral(tree.coordinates());
    let jacobian = tree.link_jacobian(&neutral, link, [0.0; 3]).ok()?;
    let column = jacobian.column(start);
    let slide: Vector3<f64> = column.fixed_rows::<3>(0).into_owned();
    let turn: Vector3<f64> = column.fixed_rows::<3>(3).into_owned();
    let horizontal = match turn.try_normalize(VERTICAL) {
        Some(axis) => -axis.cross(&down),
        None => {
            let axis = slide.try_normalize(VERTICAL)?;
            down * axis.dot(&down) - axis
        }
    };
    Some(horizontal.try_normalize(VERTICAL)?.into())
}
