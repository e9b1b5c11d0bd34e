//! `page`: what the server of the page takes while the hand moves, and what it costs the hand's loops.

use serde_json::Value;

use super::process::{Running, System};
use super::{Played, WARM_UP, Watchers};
use crate::Result;
use crate::measure::{Goal, Report};
use crate::options::Options;

/// The page's wish: 30 samples a second of each channel.
const QUERY: &str = "?hz=30";

/// The live server, with a client that takes what the page takes.
struct Page(Running);

/// Runs the sub-command.
pub(crate) fn run(options: &Options) -> Result<Report> {
    let seconds = if options.quick { 1 } else { 10 };
    let start = |system: &System| Ok(Page(system.server(QUERY, is_shown)?));
    let played = Played::new(options, seconds, start)?;
    let cpu = played.of(|it| it.cpu[0]);
    let text = format!(
        "{} rounds of three turns of {seconds} s, in an order that changes: the Utah/MIT hand on the real\n\
         clock, with nobody, with nobody again, and with the live server and a client that takes what the\n\
         page takes, at most 30 times a second each.\n\n\
         {}\
         messages a second:                    {:.0}\n\
         live server, percent of a core:       {cpu}\n",
        played.0.len(),
        played.overruns("the page"),
        played.of(|it| it.watchers),
    );
    let goals = vec![
        played.goal(),
        Goal::most("server_percent_of_a_core", cpu, 10.0),
    ];
    Ok(Report { text, goals })
}

/// Returns true if the page takes a channel.
fn is_shown(channel: &Value) -> bool {
    let text = |key: &str| channel[key].as_str().unwrap_or_default();
    text("schemaName").starts_with("condor_rows/")
        || ["/scene", "/parameters", "/events"].contains(&text("topic"))
}

impl Watchers for Page {
    /// Messages a second that the page got.
    type Figures = f64;

    /// Does nothing: the client counts from the beginning.
    fn count(&mut self) -> Result<()> {
        Ok(())
    }

    fn cpu(&self) -> Result<[f64; 2]> {
        Ok([self.0.cpu()?, 0.0])
    }

    fn end(self, seconds: f64) -> Result<f64> {
        Ok(self.0.end()? / (seconds + WARM_UP.as_secs_f64()))
    }
}
