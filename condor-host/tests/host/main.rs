//! Descriptions, machines, harts, and programs in virtual time and as processes.

mod description;
#[cfg(feature = "harts")]
mod elf;
mod harts;
mod hostile_words;
mod linux_conforms;
mod machine;
mod one_text;
mod programs_of_harts;
mod sim;
mod sim_conforms;
mod sim_files;
#[cfg(feature = "sim")]
mod small;
