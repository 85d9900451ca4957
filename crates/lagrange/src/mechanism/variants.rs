//! The same joints with other masses, or under another gravity.

use super::Tree;
use super::shortcuts::Shortcuts;
use crate::{Parameter, Role};

impl Tree {
    /// The same tree where the acceleration of free fall in the world's frame is `gravity`, m/s²: as if the base were tilted.
    ///
    /// ```
    /// # fn main() -> Result<(), lagrange::Problems> {
    /// use lagrange::{Lagrangian, urdf};
    ///
    /// let text = r#"<robot name="r"><link name="rail"/>
    ///   <link name="cart"><inertial><mass value="2"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
    ///   <joint name="slider" type="prismatic"><parent link="rail"/><child link="cart"/><axis xyz="1 0 0"/>
    ///     <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
    /// </robot>"#;
    /// let level = urdf::read(text, &urdf::Options::default())?.tree;
    /// assert_eq!(level.potential(&[0.5]), 0.0);
    /// // The positive end is raised: the cart has a potential of m g sin(α) x.
    /// let (sin, cos) = 0.1_f64.sin_cos();
    /// let tilted = level.with_gravity([-9.81 * sin, 0.0, -9.81 * cos]);
    /// assert!((tilted.potential(&[0.5]) - 2.0 * 9.81 * sin * 0.5).abs() < 1e-12);
    /// # Ok(())
    /// # }
    /// ```
    #[must_use]
    pub fn with_gravity(&self, gravity: [f64; 3]) -> Tree {
        let mut tree = self.clone();
        tree.gravity = gravity;
        let mut nodes = Vec::with_capacity(tree.nodes.len());
        // Parents come first: what is known of them counts for their children.
        for mut node in std::mem::take(&mut tree.nodes) {
            node.short = Shortcuts::default();
            let parent = node.parent.and_then(|p| nodes.get(p));
            node.short = Shortcuts::new(&node, parent, gravity);
            nodes.push(node);
        }
        tree.nodes = nodes;
        tree
    }

    /// The same joints with nothing on them but one point mass in each body, at the body's centre of mass (the origin of its frame for
    /// a body without mass). [`Parameter`]s are the point masses, kg, in the order of [`bodies`](Self::bodies); nominally 1 kg each.
    ///
    /// T, V and the equations of motion are linear in them, so that those of this tree add to those of the first one where its bodies
    /// are heavier by these masses.
    ///
    /// ```
    /// # fn main() -> Result<(), lagrange::Problems> {
    /// use lagrange::{Lagrangian, urdf};
    ///
    /// let text = r#"<robot name="r"><link name="base"/>
    ///   <link name="arm"><inertial><origin xyz="0.5 0 0"/><mass value="2"/>
    ///     <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
    ///   <joint name="hinge" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/></joint>
    /// </robot>"#;
    /// let points = urdf::read(text, &urdf::Options::default())?.tree.with_point_masses();
    /// let kinetic = points.kinetic_with(&[0.3], &[4.0], &[0.2]);
    /// assert!((kinetic - 0.5 * 0.2 * (0.5_f64 * 4.0).powi(2)).abs() < 1e-15);
    /// # Ok(())
    /// # }
    /// ```
    #[must_use]
    pub fn with_point_masses(&self) -> Tree {
        self.with_point_masses_at(1.0)
    }

    /// The same with each point mass so many `times` as far from the origin of its body's frame, where its joint is, as the body's centre of mass, on the
    /// line through both. T, V and the equations of motion are quadratic in that.
    ///
    /// ```
    /// # fn main() -> Result<(), lagrange::Problems> {
    /// use lagrange::{Lagrangian, urdf};
    ///
    /// let text = r#"<robot name="r"><link name="base"/>
    ///   <link name="arm"><inertial><origin xyz="0.5 0 0"/><mass value="2"/>
    ///     <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
    ///   <joint name="hinge" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/></joint>
    /// </robot>"#;
    /// // What it holds at its end, 1.2 m from the hinge.
    /// let points = urdf::read(text, &urdf::Options::default())?.tree.with_point_masses_at(2.4);
    /// let kinetic = points.kinetic_with(&[0.3], &[4.0], &[0.2]);
    /// assert!((kinetic - 0.5 * 0.2 * (1.2_f64 * 4.0).powi(2)).abs() < 1e-14);
    /// # Ok(())
    /// # }
    /// ```
    #[must_use]
    pub fn with_point_masses_at(&self, times: f64) -> Tree {
        let mut tree = self.clone();
        for node in &mut tree.nodes {
            node.parameter = None;
        }
        tree.parameters.clear();
        for (index, body) in tree.bodies.iter_mut().enumerate() {
            tree.parameters.push(Parameter {
                role: Role::MassScale,
                name: body.name.clone(),
                nominal: 1.0,
            });
            body.mass = 1.0;
            body.centre *= times;
            body.inertia.fill(0.0);
            let Some(node) = tree.nodes.get_mut(body.node) else {
                continue;
            };
            let per_mass = if node.mass > 0.0 {
                times / node.mass
            } else {
                0.0
            };
            let [x, y, z] = node.moment.map(|h| h * per_mass);
            node.mass = 1.0;
            node.moment = [x, y, z];
            // c·c 1 − c cᵀ.
            node.inertia = [
                y * y + z * z,
                x * x + z * z,
                x * x + y * y,
                -x * y,
                -x * z,
                -y * z,
            ];
            node.parameter = Some(index);
        }
        for link in &mut tree.links {
            link.inertial = None;
        }
        tree
    }
}
