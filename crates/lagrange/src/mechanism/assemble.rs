//! From links and joints to a tree: links that are welded together become one body, joints become nodes.

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::angles::{PoseForm, next_axes};
use super::joint::{Drive, JointSpec, coordinates, not_a_tree, plane_of, z_to};
use super::node::{Freedom, Node, Rotation};
use super::shortcuts::Shortcuts;
use super::{Body, Inertia, Inertial, JointKind, Link, Tree};
use crate::{Parameter, Problem, Role};

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
    /// their leader's coordinate. `form`: how poses are written.
    pub(crate) fn assemble(
        links: &[LinkSpec],
        joints: &[JointSpec],
        gravity: [f64; 3],
        floats: bool,
        (follow, form): (bool, PoseForm),
    ) -> Result<Tree, Problem> {
        let base = match floats {
            true => form.coordinates(BASE),
            false => Vec::new(),
        };
        let (coordinates, drives) = coordinates(base, joints, (follow, form))?;

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
                    let (turn, rotation) = axes((kind, form), &frame.rotation, &axis);
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
            tree.push_body(seed, links, form);
        }
        tree.order_children();
        Ok(tree)
    }

    fn push_body(&mut self, seed: &Seed, links: &[LinkSpec], form: PoseForm) {
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
            freedom: match (seed.kind, form) {
                (JointKind::Floating, PoseForm::Quaternion) => Freedom::Free,
                (JointKind::Prismatic, _) => Freedom::Slide,
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
        // Motions one after the other, each along or about the z of a frame of its own, between which the axes are permuted: (y, z, x) of the frame before,
        // three of which undo each other.
        let turn = next_axes();
        let back = turn.inverse();
        let (slide, about) = (Freedom::Slide, Freedom::Turn);
        let before = match (seed.kind, form) {
            (JointKind::Planar, _) => vec![(seed.rotation * turn, slide), (turn, slide)],
            (JointKind::Floating, PoseForm::Angles(_)) => vec![
                (seed.rotation * turn, slide),
                (turn, slide),
                (turn, slide),
                (Rotation3::identity(), about),
                (back, about),
            ],
            _ => Vec::new(),
        };
        if !before.is_empty() {
            node.rotation = transposed_rows(match seed.kind {
                JointKind::Planar => &turn,
                _ => &back,
            });
        }
        for (rotation, freedom) in before {
            self.push_node(Node {
                parent: node.parent,
                rotation: transposed_rows(&rotation),
                translation: node.translation.take(),
                freedom,
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
        node.drop_rounding();
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
/// a floating joint keeps its link's frame, and has its roll axis along z where the pose is written by angles.
fn axes(
    (kind, form): (JointKind, PoseForm),
    link: &UnitQuaternion<f64>,
    axis: &Vector3<f64>,
) -> (Rotation3<f64>, Rotation3<f64>) {
    let link = link.to_rotation_matrix();
    let carried = link * axis;
    let turn = match kind {
        JointKind::Floating => match form {
            PoseForm::Quaternion => Rotation3::identity(),
            // The motions before the last one start in the joint's own frame.
            PoseForm::Angles(angles) => return (angles.last_frame(), link),
        },
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
