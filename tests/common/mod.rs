//! What the tests of mechanisms share.

pub mod load;
pub mod motion;
pub mod oracle;
pub mod random_tree;
pub mod written;
