//! The costs of watchers to the loops of the hand: in each round the hand has a turn with nobody, one with nobody
//! again, and one with watchers.

pub(crate) mod page;
pub(crate) mod remote;

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::thread;
use std::time::{Duration, Instant};

use fastrand::Rng;
use serde_json::Value;

use crate::Result;
use crate::build::programs;
use crate::measure::{Estimate, Goal};
use crate::options::Options;
use crate::process::{Running, cpu_of};
use crate::rounds;

/// The time for which everything runs before it is measured.
const WARM_UP: Duration = Duration::from_secs(1);
/// The time that the system may take to come up, and that between two looks whether it has.
const PATIENCE: Duration = Duration::from_secs(30);
const LOOK: Duration = Duration::from_millis(20);

/// All that watches the hand in a turn.
trait Watchers {
    /// Begins to count, after the warm-up.
    fn count(&mut self) -> Result<()>;

    /// Returns the time on a core that the server and all its clients have had, in s.
    fn cpu(&self) -> Result<[f64; 2]>;

    /// Ends the watchers after so many seconds; returns what they got.
    fn end(self: Box<Self>, seconds: f64) -> Result<Figures>;
}

/// The figures of watchers in a turn.
#[derive(Default)]
struct Figures {
    /// Rows or messages a second that a client gets, and those that were lost of all.
    got: f64,
    lost: f64,
    /// Ages of rows at the clients, ms.
    median: f64,
    p99: f64,
}

/// A system on the real clock.
struct System {
    program: PathBuf,
    /// The directory of its socket and of the recordings.
    place: PathBuf,
    up: Running,
}

impl System {
    fn start(program: &Path, description: &Path, place: &Path) -> Result<Self> {
        let log = File::create(place.join("log"))?;
        let mut command = Command::new(program);
        command.env("XDG_RUNTIME_DIR", place).arg("up");
        command
            .arg(description)
            .args(["--headless", "--clock", "real"]);
        command.stdout(log.try_clone()?).stderr(log);
        let system = Self {
            program: program.into(),
            place: place.into(),
            up: Running::of(&mut command)?,
        };
        let begun = Instant::now();
        while system.overruns().is_err() {
            if begun.elapsed() > PATIENCE {
                let told = fs::read_to_string(place.join("log"))?;
                return Err(format!("the system does not come up: {told}").into());
            }
            thread::sleep(LOOK);
        }
        Ok(system)
    }

    /// Returns a command for another program, which finds the system.
    fn other(&self, program: &Path) -> Command {
        let mut command = Command::new(program);
        command.env("XDG_RUNTIME_DIR", &self.place);
        command
    }

    /// Returns the objects in a list of the answer to a command.
    fn ask(&self, arguments: &[&str], list: &str) -> Result<Vec<Value>> {
        let output = self.other(&self.program).args(arguments).output()?;
        let mut answer: Value = serde_json::from_slice(&output.stdout)?;
        match answer[list].take() {
            Value::Array(objects) if !objects.is_empty() => Ok(objects),
            _ => Err(format!("no {list}: {answer}").into()),
        }
    }

    /// Returns the time on a core that the supervisor and the processors have had, in s.
    fn cpu(&self) -> Result<f64> {
        let processors = self.ask(&["ps", "--json"], "processors")?;
        let pids = processors.iter().filter_map(|it| it["pid"].as_u64());
        let processors = pids.map(cpu_of).sum::<Result<f64>>()?;
        Ok(processors + self.up.cpu()?)
    }

    /// Returns the overruns of all loops since they began.
    fn overruns(&self) -> Result<f64> {
        let loops = self.ask(&["top", "--once", "--json"], "loops")?;
        let overruns = loops.iter().map(|it| it["overruns"].as_f64());
        Ok(overruns
            .sum::<Option<f64>>()
            .ok_or("a loop without overruns")?)
    }
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
struct Round {
    /// Overruns of the turns in the order of [`Way`].
    overruns: [f64; 3],
    /// Percents of a core of the system's processes, in the same order.
    system: [f64; 3],
    /// Percents of a core: of the server, and of all its clients.
    cpu: [f64; 2],
    watchers: Figures,
}

impl Round {
    fn play(
        system: &System,
        seconds: u64,
        order: &mut Rng,
        start: impl Fn(&System) -> Result<Box<dyn Watchers>>,
    ) -> Result<Self> {
        let mut ways = [Way::Nobody, Way::NobodyAgain, Way::Watchers];
        order.shuffle(&mut ways);
        let mut round = Self::default();
        for way in ways {
            let mut watchers = (way == Way::Watchers).then(|| start(system)).transpose()?;
            let cpu = |watchers: &Option<Box<dyn Watchers>>| {
                watchers.as_ref().map_or(Ok([0.0; 2]), |it| it.cpu())
            };
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
struct Played(Vec<Round>);

impl Played {
    /// Plays the rounds.
    ///
    /// # Errors
    /// Returns an error if the hand does not build or come up, or that of the first turn that fails.
    fn new(
        options: &Options,
        seconds: u64,
        start: impl Fn(&System) -> Result<Box<dyn Watchers>>,
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
    fn of(&self, figure: impl Fn(&Round) -> f64) -> Estimate {
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
        let chance = self.more(Way::NobodyAgain).high.max(0.0);
        let more = self.more(Way::Watchers);
        Goal::most("more_overruns_than_control_has", more, chance)
    }
}

/// Returns the root of the source.
fn tree() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}
