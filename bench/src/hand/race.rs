//! Turns of all contestants, in an order that changes, and the times of their calls.

use std::io::IsTerminal as _;
use std::time::Instant;

use crate::Result;
use crate::measure::{Estimate, quantile};
use crate::shuffle::Shuffle;

/// How long a turn is, ns: long beside the reading of the clock, short beside the time that a
/// scheduler gives to another program.
const TURN_NS: f64 = 200_000.0;

/// Turns of each contestant in a round, whose median is the time of the round.
const TURNS: usize = 9;

/// Makes so many calls and says how many nanoseconds they took.
type Turn = Box<dyn FnMut(usize) -> Result<f64>>;

/// All that take part.
#[derive(Default)]
pub(super) struct Race {
    turns: Vec<Turn>,
}

/// Who one of them is.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lane(usize);

/// The time of a call of each in every round, ns.
pub(super) struct Times {
    rounds: Vec<Vec<f64>>,
}

impl Race {
    /// Takes part with calls by their number, which are timed here.
    pub(super) fn enter(&mut self, mut call: impl FnMut(usize) + 'static) -> Lane {
        self.enter_timed(move |calls| {
            let began = Instant::now();
            for number in 0..calls {
                call(number);
            }
            Ok(began.elapsed().as_nanos() as f64)
        })
    }

    /// Takes part with turns that time themselves.
    pub(super) fn enter_timed(&mut self, turn: impl FnMut(usize) -> Result<f64> + 'static) -> Lane {
        self.turns.push(Box::new(turn));
        Lane(self.turns.len() - 1)
    }

    /// Plays so many rounds.
    ///
    /// # Errors
    /// That of a turn.
    pub(super) fn run(mut self, rounds: usize) -> Result<Times> {
        let calls = self
            .turns
            .iter_mut()
            .map(calls_of_a_turn)
            .collect::<Result<Vec<_>>>()?;
        let progress = std::io::stderr().is_terminal();
        let mut order = Shuffle(0);
        let mut lanes: Vec<usize> = (0..self.turns.len()).collect();
        let mut played = Vec::new();
        for number in 0..rounds {
            if progress {
                eprint!("\rround {} of {rounds} ", number + 1);
            }
            let mut times = vec![Vec::new(); self.turns.len()];
            for _ in 0..TURNS {
                order.shuffle(&mut lanes);
                for &lane in &lanes {
                    let ns = self.turns[lane](calls[lane])?;
                    times[lane].push(ns / calls[lane] as f64);
                }
            }
            played.push(times.iter_mut().map(|times| quantile(times, 0.5)).collect());
        }
        if progress {
            eprint!("\r{:24}\r", "");
        }
        Ok(Times { rounds: played })
    }
}

/// How many calls fill a turn, by the fastest of a few turns.
fn calls_of_a_turn(turn: &mut Turn) -> Result<usize> {
    let mut calls = 16;
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

impl Times {
    /// The time of a call, ns.
    pub(super) fn ns(&self, lane: Lane) -> Estimate {
        Estimate::of(self.column(&[lane]))
    }

    /// How many times as long the calls of the ones take together as those of the others.
    pub(super) fn ratio(&self, these: &[Lane], to: &[Lane]) -> Estimate {
        Estimate::ratio(self.column(these), self.column(to))
    }

    fn column(&self, lanes: &[Lane]) -> impl Iterator<Item = f64> {
        self.rounds
            .iter()
            .map(|round| lanes.iter().map(|lane| round[lane.0]).sum())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_those_of_a_call_and_ratios_of_one_round() {
        let mut race = Race::default();
        let slow = race.enter_timed(|calls| Ok(calls as f64 * 600.0));
        let fast = race.enter_timed(|calls| Ok(calls as f64 * 200.0));
        let times = race.run(7).unwrap();
        assert!((times.ns(slow).value - 600.0).abs() < 1e-9);
        assert!((times.ratio(&[slow], &[fast]).value - 3.0).abs() < 1e-9);
        assert!((times.ratio(&[slow, fast], &[fast]).value - 4.0).abs() < 1e-9);
    }
}
