//! `page`: what the server of the page takes while the hand moves, and what it costs the hand's loops.

use std::path::Path;
use std::thread;
use std::time::{Duration, Instant};

use serde_json::Value;

use super::WARM_UP;
use super::process::{Running, System, build};
use crate::Result;
use crate::measure::{Estimate, Goal, Report};
use crate::options::Options;
use crate::rounds;
use crate::shuffle::Shuffle;

/// The page's wish: 30 samples a second of each channel.
const QUERY: &str = "?hz=30";

/// The watcher of the hand in a turn.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Way {
    Nobody,
    NobodyAgain,
    Page,
}

/// The results of a round.
#[derive(Clone, Copy, Default)]
struct Round {
    /// Overruns of the turns in the order of [`Way`].
    overruns: [f64; 3],
    /// Percents of a core that the server takes.
    cpu: f64,
    /// Messages a second that the page got.
    messages: f64,
}

/// Runs the sub-command.
pub(crate) fn run(options: &Options) -> Result<Report> {
    let rounds = options.rounds(7, 7);
    let seconds = if options.quick { 1 } else { 10 };
    let tree = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let program = build(&tree, "utah-mit-hand")?;
    let place = tempfile::tempdir()?;
    let description = tree.join("examples/utah-mit-hand/system.toml");
    let system = System::start(&program, &description, place.path())?;
    let mut order = Shuffle(0);
    let played = rounds::play(rounds, |_| round(&system, seconds, &mut order))?;
    Ok(report(&played, seconds))
}

/// Returns true if the page takes a channel.
fn is_shown(channel: &Value) -> bool {
    let text = |key: &str| channel[key].as_str().unwrap_or_default();
    text("schemaName").starts_with("condor_rows/")
        || ["/scene", "/parameters", "/events"].contains(&text("topic"))
}

fn round(system: &System, seconds: u64, order: &mut Shuffle) -> Result<Round> {
    let mut ways = [Way::Nobody, Way::NobodyAgain, Way::Page];
    order.shuffle(&mut ways);
    let mut round = Round::default();
    for way in ways {
        let server = (way == Way::Page).then(|| system.server(&[], QUERY, is_shown));
        let server = server.transpose()?;
        let cpu = || server.as_ref().map_or(Ok(0.0), Running::cpu);
        thread::sleep(WARM_UP);
        let (begun, overruns, before) = (Instant::now(), system.overruns()?, cpu()?);
        thread::sleep(Duration::from_secs(seconds));
        round.overruns[way as usize] = system.overruns()? - overruns;
        let (after, real) = (cpu()?, begun.elapsed().as_secs_f64());
        if let Some(server) = server {
            round.cpu = 100.0 * (after - before) / real;
            let all = begun.elapsed() + WARM_UP;
            round.messages = server.end()? / all.as_secs_f64();
        }
    }
    Ok(round)
}

fn report(played: &[Round], seconds: u64) -> Report {
    let of = |figure: &dyn Fn(&Round) -> f64| Estimate::of(played.iter().map(figure));
    let overruns = |way: Way| move |it: &Round| it.overruns[way as usize];
    let sum = |way: Way| played.iter().map(overruns(way)).sum::<f64>();
    let more = |way: Way| of(&move |it| overruns(way)(it) - overruns(Way::Nobody)(it));
    let (page, control) = (more(Way::Page), more(Way::NobodyAgain));
    let cpu = of(&|it| it.cpu);
    let text = format!(
        "{} rounds of three turns of {seconds} s, in an order that changes: the Utah/MIT hand on the real\n\
         clock, with nobody, with nobody again, and with the live server and a client that takes what the\n\
         page takes, at most 30 times a second each.\n\n\
         overruns of all loops: nobody {:.0}, nobody again {:.0}, the page {:.0}\n\
         more than with nobody, in a round:    {page}\n\
         nobody again, more than nobody:       {control}\n\
         messages a second:                    {:.0}\n\
         live server, percent of a core:       {cpu}\n",
        played.len(),
        sum(Way::Nobody),
        sum(Way::NobodyAgain),
        sum(Way::Page),
        of(&|it| it.messages),
    );
    let goals = vec![
        Goal::most(
            "more_overruns_than_control_has",
            page,
            control.high.max(0.0),
        ),
        Goal::most("server_percent_of_a_core", cpu, 10.0),
    ];
    Report { text, goals }
}
