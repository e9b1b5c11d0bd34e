//! Turns of all contestants, in an order that changes, and the times of their calls.

use std::time::Instant;

use fastrand::Rng;

use crate::Result;
use crate::measure::quantile;
use crate::rounds::{self, Column, Tables};

/// The length of a turn, ns: long beside the reading of the clock, short beside the time slice that a
/// scheduler grants to another program.
const TURN_NS: f64 = 200_000.0;

/// Turns of each contestant in a round, whose median is the time of the round.
const TURNS: usize = 9;

const COLUMNS: &[Column] = &[Column {
    head: "ns",
    digits: 2,
}];

/// Makes so many calls and says how many nanoseconds they took.
type Turn<'r> = Box<dyn FnMut(usize) -> Result<f64> + 'r>;

/// All that take part, by task; ours is the first of each.
pub(crate) struct Race<'r> {
    tables: Tables,
    turns: Vec<Turn<'r>>,
}

impl<'r> Race<'r> {
    pub(crate) fn new() -> Self {
        Self {
            tables: Tables::new(COLUMNS),
            turns: Vec::new(),
        }
    }

    /// Takes part with calls by their number.
    pub(crate) fn enter(
        &mut self,
        task: &str,
        name: &'static str,
        mut call: impl FnMut(usize) + 'r,
    ) {
        self.enter_failing(task, name, move |number| {
            call(number);
            Ok(())
        });
    }

    /// Takes part with calls that can fail.
    pub(crate) fn enter_failing(
        &mut self,
        task: &str,
        name: &'static str,
        mut call: impl FnMut(usize) -> Result<()> + 'r,
    ) {
        self.enter_timed(task, name, move |calls| {
            let began = Instant::now();
            for number in 0..calls {
                call(number)?;
            }
            Ok(began.elapsed().as_nanos() as f64)
        });
    }

    /// Takes part with turns that time themselves.
    pub(crate) fn enter_timed(
        &mut self,
        task: &str,
        name: &'static str,
        turn: impl FnMut(usize) -> Result<f64> + 'r,
    ) {
        self.tables.row(task, name);
        self.turns.push(Box::new(turn));
    }

    /// Plays so many rounds.
    ///
    /// # Errors
    /// Returns the error of the first turn that fails.
    pub(crate) fn run(mut self, rounds: usize) -> Result<Tables> {
        let calls = self.calls()?;
        let mut order = Rng::with_seed(0);
        let played = rounds::play(rounds, |_| self.round(&calls, &mut order))?;
        self.tables.fill(played);
        Ok(self.tables)
    }

    /// Plays a round alone; returns the nanoseconds of a call of each contestant.
    ///
    /// # Errors
    /// Returns the error of the first turn that fails.
    pub(crate) fn once(mut self, seed: u64) -> Result<Vec<f64>> {
        let calls = self.calls()?;
        self.round(&calls, &mut Rng::with_seed(seed))
    }

    /// Returns the number of calls that fill a turn of each contestant.
    fn calls(&mut self) -> Result<Vec<usize>> {
        self.turns.iter_mut().map(calls_of_a_turn).collect()
    }

    fn round(&mut self, calls: &[usize], order: &mut Rng) -> Result<Vec<f64>> {
        let mut lanes: Vec<usize> = (0..self.turns.len()).collect();
        let mut times = vec![Vec::new(); lanes.len()];
        for _ in 0..TURNS {
            order.shuffle(&mut lanes);
            for &lane in &lanes {
                let ns = self.turns[lane](calls[lane])?;
                times[lane].push(ns / calls[lane] as f64);
            }
        }
        Ok(times.iter_mut().map(|times| quantile(times, 0.5)).collect())
    }
}

/// Returns the number of calls that fill a turn, by the fastest of a few turns.
fn calls_of_a_turn(turn: &mut Turn<'_>) -> Result<usize> {
    let mut calls = 1;
    loop {
        let mut fastest = f64::INFINITY;
        for _ in 0..3 {
            fastest = turn(calls)?.min(fastest);
        }
        if fastest > TURN_NS / 4.0 {
            // Positive, and far below 2^32: a call takes part of a nanosecond at least.
            #[allow(clippy::cast_sign_loss)]
            let filled = (calls as f64 * TURN_NS / fastest) as usize;
            return Ok(filled.max(1));
        }
        calls *= 2;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_those_of_a_call() {
        let mut race = Race::new();
        race.enter_timed("task", "slow", |calls| Ok(calls as f64 * 600.0));
        let tables = race.run(7).unwrap();
        let ns = tables.values(&[("task", "slow", 0)]).unwrap();
        assert!(ns.iter().all(|ns| (ns - 600.0).abs() < 1e-9));
    }
}
