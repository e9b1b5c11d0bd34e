//! [`Observer`]: a program that writes down the set-points of the clients' joints in every tick.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::Path;
use std::time::Duration;

use condor_rt::{Background, Machine, Program, ProgramError, Setup, users};

use super::log::{JOINTS, MASTER, PLACE};
use condor_robot::master::DesiredPositions;
use condor_robot::objects;

const LOG: &str = "observed";
/// The time between two looks, a fraction of a tick.
const LOOK: Duration = Duration::from_millis(2);

/// The line with which each incarnation of the program begins.
const BEGIN: &str = "begin";

/// The set-points of the clients' joints in a tick.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sample {
    /// Whether it is the first one in an incarnation of the program.
    pub(super) is_first: bool,
    /// Ticks since the start of the master's program.
    pub(super) ticks: u64,
    /// A bit for each finger that does not follow.
    pub(super) loose: u64,
    pub(super) position: [f64; 3],
    pub(super) velocity: [f64; 3],
}

impl Sample {
    fn of(wanted: &DesiredPositions) -> Self {
        let of = |all: &[[f64; 4]; 4]| JOINTS.map(|joint| all.as_flattened()[joint]);
        Self {
            is_first: false,
            ticks: wanted.ticks,
            loose: wanted.loose,
            position: of(&wanted.position),
            velocity: of(&wanted.velocity),
        }
    }

    fn read(line: &str) -> Option<Self> {
        let mut words = line.split(' ');
        let (ticks, loose) = (words.next()?.parse().ok()?, words.next()?.parse().ok()?);
        let numbers: Vec<f64> = words.filter_map(|word| word.parse().ok()).collect();
        let &[p0, p1, p2, v0, v1, v2] = numbers.as_slice() else {
            return None;
        };
        Some(Self {
            is_first: false,
            ticks,
            loose,
            position: [p0, p1, p2],
            velocity: [v0, v1, v2],
        })
    }
}

/// Reads the observed samples, in the order of time.
pub(super) fn read(place: &Path) -> Vec<Sample> {
    let text = std::fs::read_to_string(place.join(LOG)).unwrap_or_default();
    let mut is_first = false;
    let mut samples = Vec::new();
    for line in text.lines() {
        is_first |= line == BEGIN;
        if let Some(sample) = Sample::read(line) {
            samples.push(Sample { is_first, ..sample });
            is_first = false;
        }
    }
    samples
}

/// Returns true if, in the last observed tick, the finger of any client did not follow its set-points. `place` is the
/// directory with the log of the observer.
#[must_use]
pub fn is_loose(place: &Path) -> bool {
    let tail = || {
        let mut file = File::open(place.join(LOG)).ok()?;
        let len = file.seek(SeekFrom::End(0)).ok()?;
        file.seek(SeekFrom::Start(len.saturating_sub(400))).ok()?;
        let mut text = String::new();
        file.read_to_string(&mut text).ok()?;
        text.lines().rev().find_map(Sample::read)
    };
    tail().is_some_and(|last| last.loose & 0b111 != 0)
}

/// The program that writes the set-points of the clients' joints to a log, for each tick of the master that it sees.
pub struct Observer;

impl Program for Observer {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), ProgramError> {
        Setup::new(machine)?.background(|background| {
            watch(background).map_err(|error| ProgramError::program(&error))
        })
    }
}

fn watch<M: Machine>(background: &Background<'_, M>) -> Result<(), Box<dyn std::error::Error>> {
    let place = std::env::var_os(PLACE).ok_or("no place")?;
    let path = Path::new(&place).join(LOG);
    let mut log = File::options().create(true).append(true).open(path)?;
    log.write_all(format!("{BEGIN}\n").as_bytes())?;
    let mut former: Option<Sample> = None;
    let region = users(background.machine(), MASTER)?;
    while !background.is_stopping() {
        background.serve(LOOK)?;
        let Ok(Some(cell)) = objects::wanted(&region) else {
            continue;
        };
        let Ok(latest) = cell.subscriber(&region)?.read() else {
            continue;
        };
        let now = Sample::of(&latest.value);
        if former.is_none_or(|former| former.ticks != now.ticks) {
            let Sample {
                ticks,
                loose,
                position: [p0, p1, p2],
                velocity: [v0, v1, v2],
                ..
            } = now;
            // In one write: a line is there as a whole, or not.
            let line = format!("{ticks} {loose} {p0} {p1} {p2} {v0} {v1} {v2}\n");
            log.write_all(line.as_bytes())?;
            former = Some(now);
        }
    }
    Ok(())
}
