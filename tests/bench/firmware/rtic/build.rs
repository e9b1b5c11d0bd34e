//! Links as cortex-m-rt wants it, with the memory of `board`.

fn main() {
    link::firmware();
}
