//! The mechanism of a URDF.

use lagrange::Dynamics;
use lagrange::mechanism::Tree;
use lagrange::urdf::{self, Options};

/// The equations of motion of a URDF that must be good.
pub fn tree(text: &str, options: &Options) -> Dynamics<Tree> {
    let tree = urdf::read(text, options)
        .unwrap_or_else(|problems| panic!("{problems}\n{text}"))
        .tree;
    let coordinates = tree.coordinates().to_vec();
    Dynamics::new(tree, coordinates).unwrap()
}
