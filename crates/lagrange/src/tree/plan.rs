//! A tree laid out for the algorithms: bodies and degrees of freedom, parents first.

pub(crate) use crate::mechanism::Freedom;
use crate::mechanism::Tree;

#[derive(Debug, Clone)]
pub struct Body {
    pub parent: Option<usize>,
    /// Axes of this frame at joint position 0, in the parent's: columns.
    pub rotation: [[f64; 3]; 3],
    /// Its origin there, m.
    pub translation: [f64; 3],
    pub freedom: Freedom,
    /// First index in q.
    pub q: usize,
    /// First index in v.
    pub v: usize,
    /// Joint position = ratio · q + offset.
    pub ratio: f64,
    pub offset: f64,
    pub mass: f64,
    /// m c, kg·m.
    pub moment: [f64; 3],
    /// xx, yy, zz, xy, xz, yz about the origin, kg·m².
    pub inertia: [f64; 6],
    /// ∫ r rᵀ dm = ½ tr(I) 1 − I in the same order, kg·m².
    pub spread: [f64; 6],
    /// Index of the factor on mass and inertia; none where there is no mass.
    pub parameter: Option<usize>,
    /// Its degrees of freedom: `first .. first + freedom.dof()` of [`Plan::dofs`].
    pub first: usize,
}

/// One degree of freedom of one joint.
#[derive(Debug, Clone, Copy)]
pub struct Dof {
    pub body: usize,
    /// The one before it on the way to the base.
    pub above: Option<usize>,
    /// Those that it carries end before this one.
    pub end: usize,
    /// Index in v.
    pub v: usize,
    /// d(joint velocity)/dv.
    pub ratio: f64,
}

/// The tree; immutable.
#[derive(Debug, Clone)]
pub struct Plan {
    pub bodies: Vec<Body>,
    /// In the order of the bodies.
    pub dofs: Vec<Dof>,
    pub gravity: [f64; 3],
    pub nq: usize,
    pub nv: usize,
    /// Number of factors on masses.
    pub np: usize,
    /// Whether every degree of freedom has a velocity of its own: no joint follows another.
    pub independent: bool,
    /// Whether the one body on the base floats: all is then expressed in its frame.
    pub floating: bool,
}

impl Plan {
    pub fn of(tree: &Tree) -> Self {
        let mut plan = Plan {
            bodies: Vec::with_capacity(tree.nodes.len()),
            dofs: Vec::new(),
            gravity: tree.gravity(),
            nq: tree.coordinates().iter().map(|c| c.nq()).sum(),
            nv: tree.coordinates().iter().map(|c| c.nv()).sum(),
            np: tree.parameters.len(),
            independent: true,
            floating: false,
        };
        for node in &tree.nodes {
            let freedom = node.freedom;
            let (ratio, offset) = node.follow.unwrap_or((1.0, 0.0));
            plan.independent &= node.follow.is_none();
            let [xx, yy, zz, xy, xz, yz] = node.inertia;
            let half = 0.5 * (xx + yy + zz);
            let first = plan.dofs.len();
            let mut above = node.parent.map(|p| {
                let parent = &plan.bodies[p];
                parent.first + parent.freedom.dof() - 1
            });
            for k in 0..freedom.dof() {
                plan.dofs.push(Dof {
                    body: plan.bodies.len(),
                    above,
                    end: 0,
                    v: node.v + k,
                    ratio,
                });
                above = Some(first + k);
            }
            plan.bodies.push(Body {
                parent: node.parent,
                rotation: node.rotation.unwrap_or([
                    [1.0, 0.0, 0.0],
                    [0.0, 1.0, 0.0],
                    [0.0, 0.0, 1.0],
                ]),
                translation: node.translation.unwrap_or_default(),
                freedom,
                q: node.q,
                v: node.v,
                ratio,
                offset,
                mass: node.mass,
                moment: node.moment,
                inertia: node.inertia,
                spread: [half - xx, half - yy, half - zz, -xy, -xz, -yz],
                parameter: node.parameter,
                first,
            });
        }
        for k in (0..plan.dofs.len()).rev() {
            let end = plan.dofs[k].end.max(k + 1);
            plan.dofs[k].end = end;
            if let Some(above) = plan.dofs[k].above {
                plan.dofs[above].end = plan.dofs[above].end.max(end);
            }
        }
        debug_assert!(plan.is_gapless());
        let mut on_base = plan.bodies.iter().filter(|body| body.parent.is_none());
        plan.floating = match (on_base.next(), on_base.next()) {
            (Some(body), None) => body.freedom == Freedom::Free,
            _ => false,
        };
        plan
    }

    /// Whether every degree of freedom is followed by those that it carries, and by no other before they end.
    fn is_gapless(&self) -> bool {
        self.dofs.iter().enumerate().all(|(k, dof)| {
            let mut carried = (k + 1..dof.end).map(|j| self.dofs[j].above);
            carried.all(|above| above.is_some_and(|above| above >= k))
        })
    }
}
