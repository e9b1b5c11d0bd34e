//! [`run`]: the system at work for a time, and what is missing afterwards.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use condor_host::control::MemberState;

use crate::killer::{Killer, Kills, Screen};
use crate::system::{Counts, DEADLINE, LOOK, MASTER, Outcome, TELLERS, Up};
use crate::teller::Tally;

const MOTIONS: [&str; 4] = ["wave", "counting", "fist", "open"];
/// The time between two lines that are typed at a teller.
const TYPED: Duration = Duration::from_millis(50);
/// The longest time that a command of the master may take, restarts of the file service included.
const PATIENCE: Duration = Duration::from_secs(40);

/// The results of a run.
#[derive(Default)]
pub(crate) struct Seen {
    pub(crate) kills: Kills,
    pub(crate) counts: Vec<(String, Counts)>,
    /// Bytes that the user interface has drawn.
    pub(crate) drawn: u64,
    pub(crate) typed: u32,
    pub(crate) lines: u32,
    pub(crate) messages: u32,
    pub(crate) appended: u32,
    pub(crate) replaced: u32,
    pub(crate) saved: u32,
    pub(crate) motions: u32,
    /// The number of times that a finger had a fault, as the master said.
    pub(crate) faults: u32,
    /// All that is not as it should be.
    pub(crate) wrong: Vec<String>,
}

/// Runs the system for a time; with `random`, where a random sequence begins,
/// something is killed again and again.
pub(crate) fn run(length: Duration, random: Option<u64>) -> Outcome<Seen> {
    let up = Up::start()?;
    let mut screen = Screen::start(&up)?;
    let mut master = Master::begin(&up)?;
    let mut seen = Seen::default();
    let before = up.status()?;
    let mut killer = random.map(Killer::new);
    let end = Instant::now() + length;
    let mut typed_at = Instant::now();
    while Instant::now() < end {
        if let Some(killer) = &mut killer {
            killer.look(&up, &mut screen)?;
        }
        if typed_at.elapsed() >= TYPED {
            typed_at = Instant::now();
            for (name, _) in TELLERS {
                up.type_line(name, &format!("line {}", seen.typed))?;
            }
            seen.typed += 1;
        }
        master.look(&up, &mut seen, true)?;
        std::thread::sleep(LOOK);
    }
    up.wait_for_services()?;
    while !master.rests() {
        master.look(&up, &mut seen, false)?;
        std::thread::sleep(LOOK);
    }
    check_tellers(&up, &mut seen)?;
    master.check(&up, &mut seen)?;
    let after = up.status()?;
    for (before, after) in before.processors.iter().zip(&after.processors) {
        let same = before.pid == after.pid && after.restarts == 0;
        if !same || after.state != MemberState::Running {
            let text = format!("{} did not live on: {before:?}, then {after:?}", after.name);
            seen.wrong.push(text);
        }
    }
    seen.counts = up.counts()?;
    seen.drawn = screen.drawn();
    if seen.drawn == 0 {
        seen.wrong
            .push("the user interface has drawn nothing".into());
    }
    seen.kills = killer.map(|killer| killer.kills).unwrap_or_default();
    if !seen.wrong.is_empty() {
        seen.wrong
            .push(format!("the supervisor said:\n{}", up.told()));
    }
    drop(screen);
    up.end()?;
    Ok(seen)
}

/// The step of the master that is awaited.
enum Stage {
    /// The sequence of this number is recorded until then.
    Recording {
        until: Instant,
    },
    /// The answer to `save`.
    Saving {
        since: Instant,
    },
    /// The end of a motion.
    Moving {
        name: &'static str,
        since: Instant,
    },
    /// Fingers that had a fault are enabled again.
    Enabling {
        until: Instant,
    },
    Resting,
}

/// The part of the driver that types commands at the master.
struct Master {
    stage: Stage,
    /// Bytes of its log that have been looked at.
    looked: usize,
    turn: usize,
    /// The number of times that each motion should have been done.
    done: BTreeMap<&'static str, usize>,
}

impl Master {
    fn begin(up: &Up) -> Outcome<Self> {
        up.type_line(MASTER, "enable")?;
        Ok(Self {
            stage: Stage::Enabling {
                until: Instant::now() + Duration::from_secs(3),
            },
            looked: 0,
            turn: 0,
            done: BTreeMap::new(),
        })
    }

    fn rests(&self) -> bool {
        matches!(self.stage, Stage::Resting)
    }

    /// Types the next command if the last one has been done, and `more` are to come.
    fn look(&mut self, up: &Up, seen: &mut Seen, more: bool) -> Outcome<()> {
        let text = up.shown(MASTER, self.looked)?;
        let (name, since) = match self.stage {
            Stage::Resting => ("", Instant::now()),
            Stage::Recording { until } | Stage::Enabling { until } if Instant::now() < until => {
                return Ok(());
            }
            Stage::Recording { .. } => {
                up.type_line(MASTER, "save")?;
                self.stage = Stage::Saving {
                    since: Instant::now(),
                };
                return Ok(());
            }
            Stage::Enabling { .. } => return self.record(up, seen, more),
            Stage::Saving { since } => ("save", since),
            Stage::Moving { name, since } => (name, since),
        };
        let done = match self.stage {
            Stage::Saving { .. } => saved(&text) > 0,
            _ => text.contains(&format!("{name} is done")),
        };
        if done {
            self.looked += text.len();
            if let Stage::Moving { name, .. } = self.stage {
                seen.motions += 1;
                *self.done.entry(name).or_default() += 1;
                self.turn += 1;
                return self.record(up, seen, more);
            }
            seen.saved += 1;
            return self.go(up, more);
        }
        if text.contains("has a fault") || text.contains("not enabled") {
            // Deadlines that a busy machine misses are a fault of the hand, and the master says so.
            self.looked += text.len();
            seen.faults += u32::from(text.contains("has a fault"));
            up.type_line(MASTER, "clear")?;
            up.type_line(MASTER, "enable")?;
            self.stage = Stage::Enabling {
                until: Instant::now() + Duration::from_secs(3),
            };
            return Ok(());
        }
        if !self.rests() && since.elapsed() > PATIENCE {
            return Err(format!("no end of `{name}` within {PATIENCE:?}:\n{text}").into());
        }
        Ok(())
    }

    /// Begins a sequence of one motion of a joint, under a number of its own.
    fn record(&mut self, up: &Up, seen: &Seen, more: bool) -> Outcome<()> {
        if !more {
            self.stage = Stage::Resting;
            return Ok(());
        }
        up.type_line(MASTER, &format!("record kept{}", seen.saved))?;
        up.type_line(MASTER, "to thumb.middle 0.9 0.4")?;
        self.stage = Stage::Recording {
            until: Instant::now() + Duration::from_millis(700),
        };
        Ok(())
    }

    fn go(&mut self, up: &Up, more: bool) -> Outcome<()> {
        if !more {
            self.stage = Stage::Resting;
            return Ok(());
        }
        let name = MOTIONS[self.turn % MOTIONS.len()];
        up.type_line(MASTER, &format!("run {name}"))?;
        self.stage = Stage::Moving {
            name,
            since: Instant::now(),
        };
        Ok(())
    }
    /// Compares what the master has said and saved with what was asked of it.
    fn check(&self, up: &Up, seen: &mut Seen) -> Outcome<()> {
        let text = up.shown(MASTER, 0)?;
        for name in MOTIONS {
            let (said, due) = (
                text.matches(&format!("{name} is done")).count(),
                self.done.get(name).copied().unwrap_or(0),
            );
            if said != due {
                let text = format!("{name} was done {said} times, and not {due}");
                seen.wrong.push(text);
            }
        }
        let said = saved(&text);
        if said != seen.saved as usize {
            let text = format!("{said} sequences were saved, and not {}", seen.saved);
            seen.wrong.push(text);
        }
        let mut first = None;
        for number in 0..seen.saved {
            let path = up.files().join(format!("motions/kept{number}.motion"));
            let len = std::fs::metadata(&path)?.len();
            if len == 0 || *first.get_or_insert(len) != len {
                let text = format!("{} has {len} bytes, others {first:?}", path.display());
                seen.wrong.push(text);
            }
        }
        Ok(())
    }
}

/// Ends the tellers, and compares what they have done with what they and their partners say.
fn check_tellers(up: &Up, seen: &mut Seen) -> Outcome<()> {
    // Nobody asks for a total before both have ended.
    for (word, answer) in [
        ("end", None),
        ("ended", Some("typed ended\r\n")),
        ("total", None),
    ] {
        for (name, _) in TELLERS {
            up.type_line(name, word)?;
        }
        for (name, _) in TELLERS.into_iter().filter(|_| answer.is_some()) {
            up.wait_for(name, 0, DEADLINE, |text| {
                answer.and_then(|answer| text.contains(answer).then_some(()))
            })?;
        }
    }
    let mut said = Vec::new();
    for (name, number) in TELLERS {
        let total = up.wait_for(name, 0, DEADLINE, |text| text.lines().find_map(Tally::read))?;
        let text = up.shown(name, 0)?;
        check_lines(name, &text, &total, seen);
        let wrong = total.check_files(&up.files(), number);
        seen.wrong.extend(wrong);
        seen.lines += total.said;
        seen.messages += total.asked + total.told;
        seen.appended += total.appended;
        seen.replaced += total.replaced;
        said.push((name, total));
    }
    if let [(first, a), (second, b)] = said.as_slice() {
        for (name, sent, took) in [(second, a, b), (first, b, a)] {
            let right = (sent.asked, sent.told, 0) == (took.heard, took.others, took.wrong);
            if !right {
                seen.wrong.push(format!(
                    "of {} and {} messages {name} has had {} and {}, {} out of order",
                    sent.asked, sent.told, took.heard, took.others, took.wrong
                ));
            }
        }
    }
    Ok(())
}

/// Each line of a teller, and each that was typed, must be there once and in order.
fn check_lines(name: &str, text: &str, total: &Tally, seen: &mut Seen) {
    let (mut said, mut typed, mut lives) = (0, 0, 0);
    for line in text.lines().filter(|line| !line.is_empty()) {
        if line == format!("said {said}") {
            said += 1;
        } else if line == format!("typed line {typed}") {
            typed += 1;
        } else if line.starts_with("[began at ") {
            lives += 1;
        } else if line != "typed ended" && Tally::read(line).is_none() {
            seen.wrong.push(format!(
                "{name} shows {line:?} after {said} lines of its own and {typed} that were typed"
            ));
            return;
        }
    }
    if (said, typed, lives) != (total.said, seen.typed, 1) {
        seen.wrong.push(format!(
            "{name} shows {said} of {} lines of its own, {typed} of {} that were typed, in {lives} lives",
            total.said, seen.typed
        ));
    }
}

/// How often a text says that a sequence was saved.
fn saved(text: &str) -> usize {
    text.matches(" motion saved").count() + text.matches(" motions saved").count()
}
