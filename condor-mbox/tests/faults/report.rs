//! The table at the end.

use std::time::Duration;

use super::board::{Aim, Board, Victim};
use super::director::Scene;
use super::everyone::Everyone;
use super::record::{Count, Record, Series};
use super::talk::SURVIVORS;
use super::truncation::Truncation;

/// The goal for the 99th percentile of a waiting survivor's detection, in nanoseconds.
const GOAL_NS: u32 = 1_000_000;

/// What all processes counted.
pub(crate) struct Report {
    counts: Vec<(Count, &'static str, u32)>,
    series: Vec<(Series, &'static str, Vec<u32>)>,
    /// How long the kernel took to end each victim.
    ends: Vec<u32>,
    kills: [u32; Aim::ALL.len()],
    stops: [u32; Aim::ALL.len()],
    refused: u32,
    faults: u32,
    pub(crate) everyone: Everyone,
    pub(crate) truncation: Truncation,
}

impl Report {
    pub(crate) fn new(board: &Board, mut scene: Scene<'_>) -> Self {
        scene.ends.sort_unstable();
        let records = SURVIVORS.map(|survivor| Record::new(board, survivor.index()));
        let counts = Count::ALL.map(|(count, name)| {
            let each = records.iter().map(|record| record.count(count));
            let sum = match count {
                Count::Overdue => each.max().unwrap_or(0),
                _ => each.sum(),
            };
            (count, name, sum)
        });
        let series = Series::ALL.map(|(series, name)| {
            let mut all: Vec<u32> = records
                .iter()
                .flat_map(|record| record.samples(series))
                .collect();
            all.sort_unstable();
            (series, name, all)
        });
        let seen: u32 = records.iter().map(Record::faults).sum();
        Self {
            counts: counts.into(),
            series: series.into(),
            ends: scene.ends,
            kills: scene.kills,
            stops: scene.stops,
            refused: scene.refused,
            faults: scene.faults + seen + board.victim(Victim::Faults),
            everyone: Everyone::default(),
            truncation: Truncation::default(),
        }
    }

    /// Something kept the experiment from going on.
    pub(crate) fn broken(&mut self, what: &str) {
        eprintln!("WRONG: {what}");
        self.faults += 1;
    }

    pub(crate) fn faults(&self) -> u32 {
        self.faults + self.everyone.faults + self.truncation.faults
    }

    pub(crate) fn print(&self, lasted: Duration) {
        println!("\n{:<34} {:>9} {:>9}", "victim was", "killed", "stopped");
        for (index, aim) in Aim::ALL.iter().enumerate() {
            let (kills, stops) = (self.kills[index], self.stops[index]);
            println!("  {:<32} {kills:>9} {stops:>9}", aim.name());
        }
        let sum = |all: &[u32]| all.iter().sum::<u32>();
        let (kills, stops) = (sum(&self.kills), sum(&self.stops));
        println!("  {:<32} {kills:>9} {stops:>9}", "in all");
        println!("claims of a stopped number refused {:>9}", self.refused);

        println!("\n{:<34} {:>9}", "seen by the two survivors", "count");
        for (_, name, count) in self.counts.iter().filter(|(_, _, count)| *count > 0) {
            println!("  {name:<32} {count:>9}");
        }

        println!(
            "\n{:<34} {:>9} {:>9} {:>9} {:>9}",
            "times in µs", "samples", "p50", "p99", "max"
        );
        for (series, name, all) in &self.series {
            let goal = match series {
                Series::Waiting if percentile(all, 99) <= GOAL_NS => "  p99 ≤ 1 ms: met",
                Series::Waiting => "  p99 ≤ 1 ms: MISSED",
                _ => "",
            };
            println!("{}{goal}", line(name, all));
        }
        println!("{}", line("kill to end of process (kernel)", &self.ends));

        let Everyone { rounds, killed, .. } = self.everyone;
        println!("\nall processes of a named system killed: {rounds} rounds, {killed} processes");
        let Truncation { others, .. } = self.truncation;
        println!("memory truncated during a call: Lost; good replies of others after it: {others}");
        println!("wrong or lost: {}   ({lasted:.1?})", self.faults());
    }
}

fn line(name: &str, sorted: &[u32]) -> String {
    let at = |hundredths| f64::from(percentile(sorted, hundredths)) / 1000.0;
    let (count, p50, p99, max) = (sorted.len(), at(50), at(99), at(100));
    format!("  {name:<32} {count:>9} {p50:>9.0} {p99:>9.0} {max:>9.0}")
}

/// The least value that is not below `hundredths` of all; 0 if there is none.
fn percentile(sorted: &[u32], hundredths: usize) -> u32 {
    let rank = (sorted.len() * hundredths).div_ceil(100).max(1);
    sorted.get(rank - 1).copied().unwrap_or(0)
}
