//! Plots of variables over time, and the robot as lines, on a terminal.
//!
//! A [`Plot`] is what is seen: `draw` reads it, and `press` changes it. Whoever shows one fetches
//! what its `wish` names, and hands over what comes. The modules from low to high: `scale`,
//! `history` and `trigger` know numbers alone; `curve` has names; `figure` draws the robot; `model`
//! puts them together; `prompt`, `kept`, `draw` and `keys` are for the person. `feed` fetches from a running
//! system, and `file` from a recording, what `choice` finds; `numbers` are expressions of a debugger.

#![expect(
    clippy::cast_precision_loss,
    clippy::cast_sign_loss,
    reason = "screens have few dots, and a place on them is not below 0"
)]

mod choice;
mod curve;
mod draw;
mod feed;
mod feed_event;
mod figure;
mod file;
mod history;
mod kept;
mod keys;
mod model;
mod numbers;
mod prompt;
pub(crate) mod scale;
mod trigger;

pub(crate) use draw::draw;
pub(crate) use feed::PlotFeed;
pub(crate) use feed_event::FeedEvent;
pub(crate) use figure::Figure;
pub(crate) use kept::PlotChoices;
pub(crate) use keys::{PlotRequest, insert, paste, press};
pub(crate) use model::{Plot, Prompt};
pub(crate) use trigger::Condition;
