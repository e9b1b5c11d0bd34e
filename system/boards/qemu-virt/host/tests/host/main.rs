//! What lies in the memory of the machine, the machine as an extension, and images of programs.

mod debugged;
mod description;
mod elf;
mod harts;
mod machine;
mod programs_of_harts;
