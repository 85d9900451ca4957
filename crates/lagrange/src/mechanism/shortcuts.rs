//! What is constant or zero in the recursions by the tree's shape alone.

use super::node::{Freedom, Motion, Node, dot, unrotate};

/// What the tree's shape says of a body's motion and of gravity in its frame.
#[derive(Debug, Clone, Default)]
pub(super) struct Shortcuts {
    /// The angular velocity that the parent brings, in this body's frame.
    pub carried: Spin,
    /// This body's angular velocity.
    pub spin: Spin,
    /// For a body on one that is on the base, neither of them free: ω and v at the joint, in this frame, per unit of the parent's joint rate.
    pub by_rate: Option<Motion<f64>>,
    /// Gravity at the joint, in this frame at joint position 0, where nothing below turns it.
    pub gravity: Option<[f64; 3]>,
    /// g·p from the parent's origin to this frame's at joint position 0, where gravity is constant, m²/s².
    pub drop: f64,
}

/// Which components of an angular velocity can be other than 0.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) enum Spin {
    None,
    /// Along z.
    Axial,
    #[default]
    Full,
}

impl Spin {
    pub fn of(w: &[f64; 3]) -> Spin {
        match *w {
            [0.0, 0.0, 0.0] => Spin::None,
            [0.0, 0.0, _] => Spin::Axial,
            _ => Spin::Full,
        }
    }
}

impl Shortcuts {
    /// For `node` (with its own shortcuts still at their default, which holds for any motion) on `parent`, or on the world with its gravity.
    pub fn new(node: &Node, parent: Option<&Node>, world_gravity: [f64; 3]) -> Self {
        let by_rate = parent.and_then(|parent| {
            let free = [parent.freedom, node.freedom].contains(&Freedom::Free);
            let single = parent.parent.is_none() && !free;
            single.then(|| {
                let (w, v) = parent.at_joint_of(node, &parent.joint_motion(1.0));
                Motion { w, v }
            })
        });
        let carried = match (parent, &by_rate) {
            (None, _) => Spin::None,
            (_, Some(motion)) => Spin::of(&motion.w),
            (Some(parent), None) => match parent.short.spin {
                Spin::Axial if node.rotation.is_some() => Spin::Full,
                spin => spin,
            },
        };
        let below = match parent {
            None => Some(world_gravity),
            Some(parent) => parent.constant_gravity(),
        };
        Shortcuts {
            carried,
            spin: match (node.freedom, carried) {
                (Freedom::Free, _) => Spin::Full,
                (Freedom::Turn, Spin::None) => Spin::Axial,
                (_, spin) => spin,
            },
            by_rate,
            gravity: below.map(|g| unrotate(&node.rotation, &g)),
            drop: match (&below, &node.translation) {
                (Some(g), Some(p)) => dot(g, p),
                _ => 0.0,
            },
        }
    }
}
