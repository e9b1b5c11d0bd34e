//! Whole systems: brought up, asked, killed in parts and as a whole, taken down.

mod asker;
mod asking;
mod boards;
mod bounds;
mod clock;
mod commands;
mod diary;
mod disk;
mod errors;
mod extensions;
mod family;
mod hearing;
mod held;
mod joint;
mod late;
mod live;
mod plots;
mod printing;
mod programs;
mod recording;
mod running;
mod streams;
mod supervisor;
mod tuned;
mod typing;
mod writer;
