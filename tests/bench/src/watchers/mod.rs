//! The costs of watchers to the loops of the hand: in each round the hand has a turn with nobody, one with nobody
//! again, and one with watchers.

pub(crate) mod page;
mod process;
pub(crate) mod remote;

use std::path::{Path, PathBuf};
use std::thread;
use std::time::{Duration, Instant};

use fastrand::Rng;

use process::System;

use crate::Result;
use crate::build::programs;
use crate::measure::{Estimate, Goal};
use crate::options::Options;
use crate::rounds;

/// The time for which everything runs before it is measured.
const WARM_UP: Duration = Duration::from_secs(1);

/// All that watches the hand in a turn.
trait Watchers: Sized {
    /// The figures of a turn.
    type Figures: Default;

    /// Begins to count, after the warm-up.
    fn count(&mut self) -> Result<()>;

    /// Returns the time on a core that the server and all its clients have had, in s.
    fn cpu(&self) -> Result<[f64; 2]>;

    /// Ends the watchers after so many seconds; returns what they got.
    fn end(self, seconds: f64) -> Result<Self::Figures>;
}

/// The watchers of a turn.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Way {
    Nobody,
    NobodyAgain,
    Watchers,
}

/// The results of a round.
#[derive(Default)]
struct Round<F> {
    /// Overruns of the turns in the order of [`Way`].
    overruns: [f64; 3],
    /// Percents of a core of the system's processes, in the same order.
    system: [f64; 3],
    /// Percents of a core: of the server, and of all its clients.
    cpu: [f64; 2],
    watchers: F,
}

impl<F: Default> Round<F> {
    fn play<W: Watchers<Figures = F>>(
        system: &System,
        seconds: u64,
        order: &mut Rng,
        start: impl Fn(&System) -> Result<W>,
    ) -> Result<Self> {
        let mut ways = [Way::Nobody, Way::NobodyAgain, Way::Watchers];
        order.shuffle(&mut ways);
        let mut round = Self::default();
        for way in ways {
            let mut watchers = (way == Way::Watchers).then(|| start(system)).transpose()?;
            let cpu = |watchers: &Option<W>| watchers.as_ref().map_or(Ok([0.0; 2]), W::cpu);
            thread::sleep(WARM_UP);
            if let Some(watchers) = &mut watchers {
                watchers.count()?;
            }
            let (begun, overruns) = (Instant::now(), system.overruns()?);
            let (of_system, before) = (system.cpu()?, cpu(&watchers)?);
            thread::sleep(Duration::from_secs(seconds));
            let (after, all) = (cpu(&watchers)?, system.cpu()? - of_system);
            round.overruns[way as usize] = system.overruns()? - overruns;
            let real = begun.elapsed().as_secs_f64();
            round.system[way as usize] = 100.0 * all / real;
            if let Some(watchers) = watchers {
                round.cpu = [0, 1].map(|place| 100.0 * (after[place] - before[place]) / real);
                round.watchers = watchers.end(real)?;
            }
        }
        Ok(round)
    }
}

/// Rounds of the hand on the real clock.
struct Played<F>(Vec<Round<F>>);

impl<F: Default> Played<F> {
    /// Plays the rounds.
    ///
    /// # Errors
    /// Returns an error if the hand does not build or come up, or that of the first turn that fails.
    fn new<W: Watchers<Figures = F>>(
        options: &Options,
        seconds: u64,
        start: impl Fn(&System) -> Result<W>,
    ) -> Result<Self> {
        let tree = tree();
        let program = programs(&tree, &["-p", "utah-mit-hand"])?.join("utah-mit-hand");
        let place = tempfile::tempdir()?;
        let description = tree.join("examples/utah-mit-hand/system.toml");
        let system = System::start(&program, &description, place.path())?;
        let mut order = Rng::with_seed(0);
        let round = |_| Round::play(&system, seconds, &mut order, &start);
        Ok(Self(rounds::play(options.rounds(7, 7), round)?))
    }

    /// Returns the estimate of one figure of each round.
    fn of(&self, figure: impl Fn(&Round<F>) -> f64) -> Estimate {
        Estimate::of(self.0.iter().map(figure))
    }

    /// Returns the overruns in a round that a way has more than nobody.
    fn more(&self, way: Way) -> Estimate {
        self.of(|it| it.overruns[way as usize] - it.overruns[Way::Nobody as usize])
    }

    /// Returns the lines about overruns; `watchers` is the name of the third turn.
    fn overruns(&self, watchers: &str) -> String {
        let sum = |way: Way| -> f64 { self.0.iter().map(|it| it.overruns[way as usize]).sum() };
        format!(
            "overruns of all loops: nobody {:.0}, nobody again {:.0}, {watchers} {:.0}\n\
             more than with nobody, in a round:    {}\n\
             nobody again, more than nobody:       {}\n",
            sum(Way::Nobody),
            sum(Way::NobodyAgain),
            sum(Way::Watchers),
            self.more(Way::Watchers),
            self.more(Way::NobodyAgain),
        )
    }

    /// Returns the goal that watchers cause no more overruns than chance does.
    fn goal(&self) -> Goal {
        let (more, control) = (self.more(Way::Watchers), self.more(Way::NobodyAgain));
        Goal::most(
            "more_overruns_than_control_has",
            more,
            control.high.max(0.0),
        )
    }
}

/// Returns the root of the source.
fn tree() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}
