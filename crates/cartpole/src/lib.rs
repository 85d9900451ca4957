//! The paper's rig.
