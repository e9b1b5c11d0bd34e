//! Descriptions, machines of harts, and their programs.

mod description;
#[cfg(feature = "harts")]
mod elf;
mod harts;
mod machine;
mod programs_of_harts;
