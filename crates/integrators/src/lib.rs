//! Roll-outs of ordinary differential equations.
