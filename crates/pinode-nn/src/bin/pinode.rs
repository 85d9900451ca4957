//! The program `pinode`.
fn main() {}
