//! Closed loops: points of two links that coincide.

use super::Constraint;
use crate::Scalar;
use crate::expression::nearest;
use crate::mechanism::Tree;

/// A point of a link.
#[derive(Debug, Clone, PartialEq)]
pub struct LinkPoint {
    /// The link; the root link is the world.
    pub link: String,
    /// The point in the link's frame, m.
    pub point: [f64; 3],
}

/// A loop of a mechanism: the point `a` of one link and the point `b` of another are at one place,
///
/// φ = p_a(q) − p_b(q), m, in the world's axes.
///
/// λ is then the force on the first link at `a`, N, in the world's axes; −λ acts on the second.
#[derive(Debug, Clone, PartialEq)]
pub struct Loop {
    /// Name; the equations are `<name>.x`, `<name>.y`, `<name>.z`.
    pub name: String,
    /// The one point.
    pub a: LinkPoint,
    /// The other.
    pub b: LinkPoint,
    /// Which of the world's components x, y, z coincide: all three at a joint, two at a pin in a slot along the third.
    pub components: [bool; 3],
}

/// A part of a [`Loop`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum LoopField {
    /// The name.
    Name,
    /// The point a.
    A,
    /// The point b.
    B,
    /// The components.
    Components,
}

/// A fault of a [`Loop`].
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct LoopProblem {
    /// Which loop.
    pub index: usize,
    /// Which part of it.
    pub field: LoopField,
    /// What is wrong and how to mend it.
    pub message: String,
}

impl std::fmt::Display for LoopProblem {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "loop {}: {}", self.index, self.message)
    }
}

impl std::error::Error for LoopProblem {}

/// The loops of a tree, as a [`Constraint`].
///
/// ```
/// use lagrange::constraint::{Constrained, LinkPoint, Loop, Loops};
/// use lagrange::{Dynamics, Mechanics, urdf};
///
/// // A bar of 3 kg whose left end slides along x and whose right end is held at the height 0 of the world by the loop.
/// let text = r#"<robot name="ladder">
///   <link name="wall"/>
///   <link name="foot"/>
///   <joint name="slide" type="prismatic"><parent link="wall"/><child link="foot"/><axis xyz="1 0 0"/>
///     <limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
///   <link name="bar"><inertial><origin xyz="0.5 0 0"/><mass value="3"/>
///     <inertia ixx="0" ixy="0" ixz="0" iyy="0.25" iyz="0" izz="0.25"/></inertial></link>
///   <joint name="hinge" type="continuous"><parent link="foot"/><child link="bar"/><axis xyz="0 -1 0"/></joint>
/// </robot>"#;
/// let tree = urdf::read(text, &urdf::Options::default())?.tree;
/// let tip = Loop {
///     name: "tip".into(),
///     a: LinkPoint { link: "bar".into(), point: [1.0, 0.0, 0.0] },
///     b: LinkPoint { link: "wall".into(), point: [0.0, 0.0, 0.0] },
///     components: [false, false, true],
/// };
/// let loops = Loops::new(&tree, vec![tip]).map_err(|problems| problems[0].clone())?;
/// let coordinates = tree.coordinates().to_vec();
/// let ladder = Constrained::new(Dynamics::new(tree, coordinates)?, loops)?;
/// assert_eq!(ladder.names(), ["tip.z"]);
/// // Lying flat and at rest, each end carries half the weight.
/// let (a, force) = ladder.forward_dynamics_with_multipliers(&[0.2, 0.0], &[0.0, 0.0], &[0.0, 0.0])?;
/// assert!(a.amax() < 1e-12 && (force[0] - 0.5 * 3.0 * 9.81).abs() < 1e-12);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct Loops {
    loops: Vec<Loop>,
    tree: Tree,
    /// Links of both points of every loop.
    links: Vec<(usize, usize)>,
    /// Ways from the root to both points of every loop; none where one leads over a joint that floats.
    paths: Option<Vec<(Vec<usize>, Vec<usize>)>>,
    /// Loop and component of every equation.
    equations: Vec<(usize, usize)>,
}

impl Loops {
    /// The loops of `tree`.
    ///
    /// # Errors
    /// All that is wrong with them: unknown links, points that are not finite, points of one body, no component, names given twice.
    pub fn new(tree: &Tree, loops: Vec<Loop>) -> Result<Self, Vec<LoopProblem>> {
        let mut problems = Vec::new();
        let mut links = Vec::new();
        for (index, l) in loops.iter().enumerate() {
            let mut refuse = |field, message| {
                problems.push(LoopProblem {
                    index,
                    field,
                    message,
                });
            };
            if loops.iter().take(index).any(|other| other.name == l.name) {
                refuse(
                    LoopField::Name,
                    format!(
                        "two loops are called `{}`: give one of them another `name`",
                        l.name
                    ),
                );
            }
            if l.components == [false; 3] {
                refuse(
                    LoopField::Components,
                    format!(
                        "loop `{}` closes no component: name some of x, y, z",
                        l.name
                    ),
                );
            }
            let mut place = |field, of: &LinkPoint| {
                find(tree, of)
                    .map_err(|message| refuse(field, message))
                    .ok()
            };
            let (a, b) = (place(LoopField::A, &l.a), place(LoopField::B, &l.b));
            let (Some(a), Some(b)) = (a, b) else {
                continue;
            };
            let body = |link: usize| tree.links().get(link).and_then(|link| link.body);
            if body(a) == body(b) {
                refuse(
                    LoopField::B,
                    format!(
                        "`{}` and `{}` cannot move against each other: a loop joins points of two bodies",
                        l.a.link, l.b.link
                    ),
                );
            }
            links.push((a, b));
        }
        if !problems.is_empty() {
            return Err(problems);
        }
        let equations = loops.iter().enumerate().flat_map(|(i, l)| {
            let in_force = move |c: &usize| l.components[*c];
            (0..3).filter(in_force).map(move |c| (i, c))
        });
        Ok(Loops {
            equations: equations.collect(),
            paths: (links.iter())
                .map(|&(a, b)| Some((tree.path(a)?, tree.path(b)?)))
                .collect(),
            links,
            tree: tree.clone(),
            loops,
        })
    }

    /// The loops as they were given.
    pub fn loops(&self) -> &[Loop] {
        &self.loops
    }

    /// Which loop an equation belongs to, and which component of the world's (0: x, 1: y, 2: z) it is.
    pub fn equation(&self, equation: usize) -> Option<(usize, usize)> {
        self.equations.get(equation).copied()
    }
}

/// Index of the link, if the point is good.
fn find(tree: &Tree, of: &LinkPoint) -> Result<usize, String> {
    if let Some(x) = of.point.iter().find(|x| !x.is_finite()) {
        return Err(format!(
            "the point of `{}` has the entry {x}: all must be finite",
            of.link
        ));
    }
    let links = tree.links().iter().map(|l| l.name.as_str());
    if let Some(index) = links.clone().position(|name| name == of.link) {
        return Ok(index);
    }
    let cure = match nearest(&of.link, links.clone()) {
        Some(near) => format!("did you mean `{near}`?"),
        None => {
            let some: Vec<&str> = links.take(20).collect();
            format!("links are {}", some.join(", "))
        }
    };
    Err(format!("unknown link `{}`; {cure}", of.link.escape_debug()))
}

impl Constraint for Loops {
    fn len(&self) -> usize {
        self.equations.len()
    }

    fn name(&self, equation: usize) -> String {
        let Some(&(of, component)) = self.equations.get(equation) else {
            return String::new();
        };
        let name = self.loops.get(of).map_or("", |l| l.name.as_str());
        format!("{name}.{}", ["x", "y", "z"][component])
    }

    fn residual<D: Scalar>(&self, q: &[D], out: &mut [D]) {
        let mut equations = self.equations.iter().zip(out).peekable();
        for (i, (l, &(a, b))) in self.loops.iter().zip(&self.links).enumerate() {
            let a = self.tree.point_position(q, a, l.a.point);
            let b = self.tree.point_position(q, b, l.b.point);
            while let Some(((_, component), out)) = equations.next_if(|((of, _), _)| *of == i) {
                *out = a[*component] - b[*component];
            }
        }
    }

    fn uses_constant(&self, _index: usize) -> bool {
        false
    }

    /// The forces λ at a and −λ at b.
    fn add_force_with<D: Scalar>(
        &self,
        q: &[D],
        _p: &[D],
        multipliers: &[f64],
        out: &mut [D],
    ) -> bool {
        let Some(paths) = &self.paths else {
            return false;
        };
        let mut equations = self.equations.iter().zip(multipliers).peekable();
        for (i, (l, on)) in self.loops.iter().zip(paths).enumerate() {
            let mut force = [0.0; 3];
            while let Some(((_, component), x)) = equations.next_if(|((of, _), _)| *of == i) {
                force[*component] = *x;
            }
            let &(a, b) = &self.links[i];
            self.tree
                .add_point_force(q, (a, &on.0), l.a.point, force, out);
            let opposite = force.map(|x| -x);
            self.tree
                .add_point_force(q, (b, &on.1), l.b.point, opposite, out);
        }
        true
    }
}
