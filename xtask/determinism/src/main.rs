//! Prints the report.

fn main() {
    print!("{}", gsvx_determinism::report());
}
