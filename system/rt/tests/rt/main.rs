//! Programs in virtual time and as processes, and what they show of themselves.

mod environment;
mod hostile_words;
mod lines;
mod lines_linux;
mod linux_conforms;
mod linux_mail;
mod one_text;
mod serial;
mod setup;
mod shared_log;
mod sim;
mod sim_conforms;
mod sim_files;
#[cfg(feature = "sim")]
mod small;
mod stdio;
mod terminal;
