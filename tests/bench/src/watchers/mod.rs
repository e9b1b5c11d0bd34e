//! `watchers`: what a recorder, plots and the live server take, and what their work costs a loop.

pub(crate) mod page;
mod process;
pub(crate) mod remote;

use std::array;
use std::path::Path;
use std::thread;
use std::time::{Duration, Instant};

use process::{Ended, Recorder, Running, System, build};

use crate::Result;
use crate::measure::{Estimate, Goal, Report};
use crate::options::Options;
use crate::rounds;
use crate::shuffle::Shuffle;

/// The patterns of the variables that are drawn and served: a hundred.
const SHOWN: [&str; 2] = ["a.?", "a.??"];

/// The time for which everything runs before it is measured.
const WARM_UP: Duration = Duration::from_secs(1);

/// The watchers of the loop's variables in a turn.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Way {
    Nobody,
    NobodyAgain,
    All,
}

/// The results of a round.
#[derive(Clone, Copy, Default)]
struct Round {
    /// Overruns of the turns in the order of [`Way`].
    overruns: [f64; 3],
    /// Percents of a core: of the recorder, of the plots, and of the live server.
    cpu: [f64; 3],
    ended: Ended,
}

/// Runs the sub-command.
pub(crate) fn run(options: &Options) -> Result<Report> {
    let rounds = options.rounds(7, 7);
    let seconds = if options.quick { 1 } else { 10 };
    let tree = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let program = build(&tree, "drills")?;
    let place = tempfile::tempdir()?;
    let system = System::start(
        &program,
        &tree.join("tests/bench/drills/variables.toml"),
        place.path(),
    )?;
    let mut order = Shuffle(0);
    let played = rounds::play(rounds, |_| round(&system, seconds, &mut order))?;
    Ok(report(&played, seconds))
}

fn round(system: &System, seconds: u64, order: &mut Shuffle) -> Result<Round> {
    let mut ways = [Way::Nobody, Way::NobodyAgain, Way::All];
    order.shuffle(&mut ways);
    let mut round = Round::default();
    for way in ways {
        let watchers = (way == Way::All).then(|| Watchers::start(system));
        let watchers = watchers.transpose()?;
        let cpu = || watchers.as_ref().map_or(Ok([0.0; 3]), Watchers::cpu);
        thread::sleep(WARM_UP);
        let (begun, overruns, before) = (Instant::now(), system.overruns()?, cpu()?);
        thread::sleep(Duration::from_secs(seconds));
        round.overruns[way as usize] = system.overruns()? - overruns;
        let (after, real) = (cpu()?, begun.elapsed().as_secs_f64());
        if let Some(watchers) = watchers {
            round.cpu = array::from_fn(|place| 100.0 * (after[place] - before[place]) / real);
            round.ended = watchers.end()?;
        }
    }
    Ok(round)
}

/// All that looks at the loop.
struct Watchers<'s> {
    recorder: Recorder<'s>,
    plots: Running,
    server: Running,
}

impl<'s> Watchers<'s> {
    fn start(system: &'s System) -> Result<Self> {
        Ok(Self {
            recorder: Recorder::start(system)?,
            plots: system.plots(&SHOWN)?,
            server: system.server(&SHOWN, "", |it| it["topic"] == "/a/servo")?,
        })
    }

    /// Returns the time on a core that each watcher has had, in s.
    fn cpu(&self) -> Result<[f64; 3]> {
        Ok([self.recorder.cpu()?, self.plots.cpu()?, self.server.cpu()?])
    }

    fn end(self) -> Result<Ended> {
        let ended = self.recorder.end()?;
        self.plots.end()?;
        Ok(Ended {
            samples: self.server.end()?,
            ..ended
        })
    }
}

fn report(played: &[Round], seconds: u64) -> Report {
    let of = |figure: &dyn Fn(&Round) -> f64| Estimate::of(played.iter().map(figure));
    let more = of(&|it| it.overruns[Way::All as usize] - it.overruns[Way::Nobody as usize]);
    let control =
        of(&|it| it.overruns[Way::NobodyAgain as usize] - it.overruns[Way::Nobody as usize]);
    let [recorder, plots, server] = [0, 1, 2].map(|place| of(&move |it: &Round| it.cpu[place]));
    let (rows, lost) = (of(&|it| it.ended.rows), of(&|it| it.ended.lost));
    let sum = |way: Way| {
        played
            .iter()
            .map(|it| it.overruns[way as usize])
            .sum::<f64>()
    };
    let text = format!(
        "{} rounds of three turns of {seconds} s, in an order that changes: a loop of 1 kHz that shows 2 500\n\
         variables of 64 bits, with nobody, with nobody again, and with a recorder of all, plots of 100 at\n\
         200 x 50, and the live server with a client that takes the same 100.\n\n\
         overruns in all: nobody {:.0}, nobody again {:.0}, all {:.0}\n\
         more than with nobody, in a round:    {more}\n\
         nobody again, more than nobody:       {control}\n\
         rows of 2 500 in a recording:         {rows:.0}, lost {lost:.0}\n\
         samples of 100 that the client got:   {:.0}\n\
         recorder, percent of a core:          {recorder}\n\
         plots, percent of a core:             {plots}\n\
         live server, percent of a core:       {server}\n",
        played.len(),
        sum(Way::Nobody),
        sum(Way::NobodyAgain),
        sum(Way::All),
        of(&|it| it.ended.samples),
    );
    let goals = vec![
        Goal::most(
            "more_overruns_than_control_has",
            more,
            control.high.max(0.0),
        ),
        Goal::most("rows_lost", lost, 0.0),
        Goal::most("plots_percent_of_a_core", plots, 5.0),
    ];
    Report { text, goals }
}
