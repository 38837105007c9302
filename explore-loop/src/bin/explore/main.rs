//! The explore program.
fn main() {}
