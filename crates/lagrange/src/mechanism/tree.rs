//! A kinematic tree and its energies.

use std::ops::Range;

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::joint::{Drive, JointSpec, coordinates, not_a_tree, plane_of, pose_of, z_to};
use super::node::{Freedom, Node, Rotation};
use super::shortcuts::Shortcuts;
use super::{Inertia, Inertial, Joint, JointKind};
use crate::{Coordinate, Parameter, Problem, Role};

/// A tree of rigid bodies on a fixed base, or on one that floats; immutable.
///
/// Links that fixed joints weld together are one body; what is welded to the world counts for nothing in T and V. The coordinates
/// stand in the order of the joints in the source, whatever the tree's topology.
///
/// The energies are sums over the bodies, with everything in the frame of the body i itself (angular velocity ω, velocity v of
/// the frame's origin, gravity g):
///
/// - T = Σ ½ m v·v + v·(ω × h) + ½ ω·I ω, with h = m c and I about the origin, from the base outward:
///   ω = Rᵀ ω_parent + z q̇ and v = Rᵀ (v_parent + ω_parent × p) for a rotation about z by q,
///   ω = Rᵀ ω_parent and v = Rᵀ (v_parent + ω_parent × p) + z q̇ for a translation along z,
///   ω = Rᵀ ω_parent + ω_joint and v = Rᵀ (v_parent + ω_parent × p) + v_joint for a floating joint;
/// - V = −Σ m g·p_com, zero at the origin of the world.
///
/// Every body's frame is turned once, at construction, so that its joint's axis is z. A planar joint is two translations and a
/// rotation, with nothing between them.
///
/// Where a joint floats, q is longer than v, and v is not q̇: q holds a quaternion, which is taken as it stands and has to be of
/// length 1, and v the velocities in the moved body's axes (see [`Coordinate::floating`]). Derivatives of the energies in q and v
/// do then not make the equations of motion in the way of Lagrange.
///
/// ```
/// # fn main() -> Result<(), lagrange::Problems> {
/// use lagrange::{Lagrangian, urdf};
///
/// let text = r#"<robot name="pendulum">
///   <link name="base"/>
///   <link name="bob"><inertial><origin xyz="0 0 -2"/><mass value="3"/>
///     <inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial></link>
///   <joint name="hinge" type="continuous"><parent link="base"/><child link="bob"/><axis xyz="0 1 0"/></joint>
/// </robot>"#;
/// let tree = urdf::read(text, &urdf::Options::default())?.tree;
/// assert_eq!(tree.coordinates()[0].name, "hinge");
/// assert_eq!(tree.kinetic(&[0.3], &[2.0]), 0.5 * 3.0 * (2.0_f64 * 2.0).powi(2));
/// assert!((tree.potential(&[0.3]) + 3.0 * 9.81 * 2.0 * 0.3_f64.cos()).abs() < 1e-12);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone)]
pub struct Tree {
    pub(super) coordinates: Vec<Coordinate>,
    pub(super) bodies: Vec<Body>,
    joints: Vec<Joint>,
    pub(super) links: Vec<Link>,
    pub(crate) parameters: Vec<Parameter>,
    pub(super) gravity: [f64; 3],
    /// Parents before children.
    pub(crate) nodes: Vec<Node>,
    /// Children of all nodes, one stretch after the other; those of the world first.
    pub(super) children: Vec<usize>,
    pub(super) base_children: Range<usize>,
}

/// A moving body: one or several links, welded together.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Body {
    /// The link that the body's joint moves; the others are welded to it.
    pub name: String,
    /// All its links, `name` first.
    pub links: Vec<String>,
    /// Index of the body that carries it; none when that is the world.
    pub parent: Option<usize>,
    /// Index of its joint; none for a base that floats.
    pub joint: Option<usize>,
    /// Mass, kg.
    pub mass: f64,
    /// Centre of mass in the frame of the link `name`, m.
    pub centre: Vector3<f64>,
    /// Rotational inertia about the centre of mass in the axes of the link `name`, kg·m².
    pub inertia: Matrix3<f64>,
    /// Index of its node; planar joints have two more.
    pub(crate) node: usize,
}

/// A link, and the body that it belongs to.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Link {
    /// Name.
    pub name: String,
    /// Its inertia as the source has it, where it has one.
    pub inertial: Option<Inertial>,
    /// Index of the body; none when it is welded to the world.
    pub body: Option<usize>,
    /// Pose of the link in the body's frame (the world's, where there is no body).
    pub(super) pose: Isometry3<f64>,
}

/// A link on the way into [`Tree::assemble`].
pub(crate) struct LinkSpec {
    pub name: String,
    pub inertial: Option<Inertial>,
}

impl LinkSpec {
    /// In the link's frame.
    fn inertia(&self) -> Inertia {
        self.inertial.map_or(Inertia::zero(), |i| i.in_link())
    }
}

/// The coordinate of a base that floats.
pub(crate) const BASE: &str = "base";

impl Tree {
    /// The tree of `links` and `joints`, in the order of the source. `floats`: the root link is free. `follow`: mimic joints take
    /// their leader's coordinate.
    pub(crate) fn assemble(
        links: &[LinkSpec],
        joints: &[JointSpec],
        gravity: [f64; 3],
        floats: bool,
        follow: bool,
    ) -> Result<Tree, Problem> {
        let base: Vec<Coordinate> = floats.then(|| pose_of(BASE)).into_iter().collect();
        let (coordinates, drives) = coordinates(base, joints, follow)?;

        // The joints that leave every link, and the one link that no joint moves.
        let mut leaving = vec![Vec::new(); links.len()];
        let mut moved = vec![false; links.len()];
        for (j, spec) in joints.iter().enumerate() {
            match (leaving.get_mut(spec.parent), moved.get_mut(spec.child)) {
                (Some(list), Some(moved)) if !*moved => {
                    list.push(j);
                    *moved = true;
                }
                _ => return Err(not_a_tree()),
            }
        }
        let root = moved.iter().position(|m| !m).ok_or_else(not_a_tree)?;

        // From the root outward: every link in the frame of its body, every body's inertia the sum over its links.
        let mut placed: Vec<Option<(Option<usize>, Isometry3<f64>)>> = vec![None; links.len()];
        let mut seeds: Vec<Seed> = Vec::new();
        let mut pending = vec![(root, None, None, Isometry3::identity())];
        while let Some((link, by, parent, frame)) = pending.pop() {
            let drive = match by {
                Some(j) => drives.get(j).copied().flatten(),
                None => floats.then(|| Drive::next(&[])),
            };
            let (body, pose) = match drive {
                // Welded to what carries it: `frame` is its pose there.
                None => (parent, frame),
                // Moved: a new body, whose frame has z along the axis.
                Some(drive) => {
                    let joint = by.map(|j: usize| &joints[j].joint);
                    let kind = joint.map_or(JointKind::Floating, |joint| joint.kind);
                    let axis = joint.map_or(Vector3::z(), |joint| joint.axis);
                    let (turn, rotation) = axes(kind, &frame.rotation, &axis);
                    seeds.push(Seed {
                        parent,
                        joint: by,
                        kind,
                        drive,
                        rotation,
                        translation: frame.translation.vector,
                        turn,
                        links: Vec::new(),
                        inertia: Inertia::zero(),
                    });
                    let to_link = UnitQuaternion::from_rotation_matrix(&turn.inverse());
                    let pose = Isometry3::from_parts(Translation3::identity(), to_link);
                    (Some(seeds.len() - 1), pose)
                }
            };
            placed[link] = Some((body, pose));
            if let Some(seed) = body.and_then(|b| seeds.get_mut(b)) {
                seed.links.push(link);
                seed.inertia = seed.inertia + links[link].inertia().in_frame(&pose);
            }
            // The first joint of the link is to be popped first.
            for &j in leaving[link].iter().rev() {
                pending.push((
                    joints[j].child,
                    Some(j),
                    body,
                    pose * joints[j].joint.origin.pose(),
                ));
            }
        }
        if placed.iter().any(Option::is_none) {
            return Err(not_a_tree());
        }

        let mut tree = Tree {
            coordinates,
            bodies: Vec::with_capacity(seeds.len()),
            joints: joints.iter().map(|spec| spec.joint.clone()).collect(),
            links: Vec::with_capacity(links.len()),
            parameters: Vec::new(),
            gravity,
            nodes: Vec::with_capacity(seeds.len()),
            children: Vec::with_capacity(seeds.len()),
            base_children: 0..0,
        };
        for (joint, drive) in tree.joints.iter_mut().zip(&drives) {
            joint.coordinate = drive.map(|d| d.coordinate);
            joint.follows = drive.is_some_and(|d| d.follows);
            (joint.ratio, joint.offset) = drive.map_or((1.0, 0.0), |d| (d.ratio, d.offset));
        }
        for (spec, place) in links.iter().zip(placed) {
            let (body, pose) = place.unwrap_or((None, Isometry3::identity()));
            tree.links.push(Link {
                name: spec.name.clone(),
                inertial: spec.inertial,
                body,
                pose,
            });
        }
        for seed in &seeds {
            tree.push_body(seed, links);
        }
        tree.order_children();
        Ok(tree)
    }

    fn push_body(&mut self, seed: &Seed, links: &[LinkSpec]) {
        let names: Vec<String> = seed.links.iter().map(|&l| links[l].name.clone()).collect();
        let name = names.first().cloned().unwrap_or_default();
        let parameter = (!seed.inertia.is_zero()).then(|| {
            self.parameters.push(Parameter {
                role: Role::MassScale,
                name: name.clone(),
                nominal: 1.0,
            });
            self.parameters.len() - 1
        });
        let (i, p) = (&seed.inertia.rotational, seed.translation);
        let mut node = Node {
            parent: seed.parent.and_then(|p| self.bodies.get(p)).map(|b| b.node),
            rotation: transposed_rows(&seed.rotation),
            translation: (p != Vector3::zeros()).then_some([p.x, p.y, p.z]),
            freedom: match seed.kind {
                JointKind::Floating => Freedom::Free,
                JointKind::Prismatic => Freedom::Slide,
                _ => Freedom::Turn,
            },
            q: seed.drive.q,
            v: seed.drive.v,
            follow: (seed.drive.follows).then_some((seed.drive.ratio, seed.drive.offset)),
            mass: seed.inertia.mass,
            moment: seed.inertia.moment.into(),
            inertia: [
                i[(0, 0)],
                i[(1, 1)],
                i[(2, 2)],
                i[(0, 1)],
                i[(0, 2)],
                i[(1, 2)],
            ],
            parameter,
            children: 0..0,
            short: Shortcuts::default(),
        };
        if seed.kind == JointKind::Planar {
            // Along x and along y first: every frame has the axes y, z, x of the one before, and three such turns undo each other.
            let (x, y, z) = (Vector3::x(), Vector3::y(), Vector3::z());
            let turn = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[y, z, x]));
            for rotation in [seed.rotation * turn, turn] {
                self.push_node(Node {
                    parent: node.parent,
                    rotation: transposed_rows(&rotation),
                    translation: node.translation.take(),
                    freedom: Freedom::Slide,
                    q: node.q,
                    v: node.v,
                    follow: None,
                    mass: 0.0,
                    moment: [0.0; 3],
                    inertia: [0.0; 6],
                    parameter: None,
                    children: 0..0,
                    short: Shortcuts::default(),
                });
                node.parent = Some(self.nodes.len() - 1);
                node.q += 1;
                node.v += 1;
            }
            node.rotation = transposed_rows(&turn);
        }
        self.push_node(node);
        let in_link = seed.inertia.rotated(seed.turn.matrix());
        self.bodies.push(Body {
            name,
            links: names,
            parent: seed.parent,
            joint: seed.joint,
            mass: in_link.mass,
            centre: in_link.centre(),
            inertia: in_link.rotational_about_centre(),
            node: self.nodes.len() - 1,
        });
    }

    fn push_node(&mut self, mut node: Node) {
        let parent = node.parent.and_then(|p| self.nodes.get(p));
        node.short = Shortcuts::new(&node, parent, self.gravity);
        self.nodes.push(node);
    }

    /// Lists the children of every body, the one with the largest subtree last: the recursions descend into that one without
    /// a call, so that their depth is at most log₂ of the number of bodies.
    fn order_children(&mut self) {
        let mut sizes = vec![1_usize; self.nodes.len()];
        let mut below = vec![Vec::new(); self.nodes.len()];
        let mut base = Vec::new();
        for (i, node) in self.nodes.iter().enumerate().rev() {
            match node.parent {
                Some(p) => {
                    sizes[p] += sizes[i];
                    below[p].push(i);
                }
                None => base.push(i),
            }
        }
        let mut append = |mut list: Vec<usize>| {
            list.sort_by_key(|&i| (sizes[i], i));
            let start = self.children.len();
            self.children.extend(list);
            start..self.children.len()
        };
        self.base_children = append(base);
        for (node, list) in self.nodes.iter_mut().zip(below) {
            node.children = append(list);
        }
    }

    /// The coordinates, in the order of q and v.
    pub fn coordinates(&self) -> &[Coordinate] {
        &self.coordinates
    }
    /// The moving bodies, parents before children.
    pub fn bodies(&self) -> &[Body] {
        &self.bodies
    }
    /// All joints, fixed ones too, in the order of the source.
    pub fn joints(&self) -> &[Joint] {
        &self.joints
    }
    /// All links, those welded to the world too, in the order of the source.
    pub fn links(&self) -> &[Link] {
        &self.links
    }
    /// Whether a joint, or the base, floats: q is then longer than v.
    pub fn is_floating(&self) -> bool {
        self.coordinates.iter().any(|c| c.floating)
    }
    /// Length of q.
    pub fn nq(&self) -> usize {
        self.coordinates.iter().map(Coordinate::nq).sum()
    }
    /// Length of v: the degrees of freedom.
    pub fn nv(&self) -> usize {
        self.coordinates.iter().map(Coordinate::nv).sum()
    }
    /// Acceleration of free fall in the world's frame, m/s².
    pub fn gravity(&self) -> [f64; 3] {
        self.gravity
    }
}

/// A body under construction: its frame has z along the axis, in which all of this is given.
struct Seed {
    parent: Option<usize>,
    joint: Option<usize>,
    kind: JointKind,
    drive: Drive,
    /// Pose at joint position 0, in the parent body's frame.
    rotation: Rotation3<f64>,
    translation: Vector3<f64>,
    /// From this frame to the first link's.
    turn: Rotation3<f64>,
    links: Vec<usize>,
    inertia: Inertia,
}

/// The rotations of a body's frame with z along `axis`, in its link's frame and in the frame that carries it, in which the link is
/// turned by `link`. For a joint of one coordinate, an axis parallel to z there (to rounding) leaves the frame as it is; the body of
/// a floating joint keeps its link's frame.
fn axes(
    kind: JointKind,
    link: &UnitQuaternion<f64>,
    axis: &Vector3<f64>,
) -> (Rotation3<f64>, Rotation3<f64>) {
    let link = link.to_rotation_matrix();
    let carried = link * axis;
    let turn = match kind {
        JointKind::Floating => Rotation3::identity(),
        JointKind::Planar => plane_of(axis),
        _ if carried.z > 0.0 && carried.x.abs() <= 1e-15 && carried.y.abs() <= 1e-15 => {
            return (link.inverse(), Rotation3::identity());
        }
        _ => z_to(axis),
    };
    (turn, link * turn)
}

fn transposed_rows(rotation: &Rotation3<f64>) -> Rotation {
    let m = rotation.matrix();
    (*m != Matrix3::identity())
        .then(|| [0, 1, 2].map(|column| [m[(0, column)], m[(1, column)], m[(2, column)]]))
}
