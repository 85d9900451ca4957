//! The program `cartpole`.
fn main() {}
