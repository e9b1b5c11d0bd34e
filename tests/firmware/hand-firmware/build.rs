//! Links as riscv-rt and cortex-m-rt want it.

fn main() {
    link::firmware();
}
