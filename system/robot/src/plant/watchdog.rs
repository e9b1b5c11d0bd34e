//! [`Watchdog`]: the outputs of a board that no program refreshes.

use condor_hand::math::min;

/// The watchdog of a board with `L` outputs.
#[derive(Clone, Copy, Debug)]
pub(super) struct Watchdog<const L: usize> {
    /// The outputs at rest.
    least: [f64; L],
    /// The outputs that were requested last.
    values: [f64; L],
    /// The outputs when the board began to rest.
    from: [f64; L],
    patience: u32,
    ramp: u32,
    /// Ticks since something was asked for; at rest, since the rest began.
    ticks: u32,
    state: WatchState,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum WatchState {
    /// Nothing has been asked for yet.
    New,
    Refreshed,
    Rests,
}

/// The input of a board in a tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum BoardInput<const L: usize> {
    /// Outputs are requested.
    Values([f64; L]),
    /// The board is not strobed.
    Nothing,
    /// No program has the board open.
    Closed,
}

impl<const L: usize> Watchdog<L> {
    /// A board at rest, which rests again after `patience` ticks, within `ramp` ticks.
    pub(super) const fn new(least: [f64; L], patience: u32, ramp: u32) -> Self {
        Self {
            least,
            values: least,
            from: least,
            patience,
            ramp,
            ticks: 0,
            state: WatchState::New,
        }
    }

    /// Returns the outputs in this tick.
    pub(super) fn update(&mut self, input: BoardInput<L>) -> [f64; L] {
        self.ticks = self.ticks.saturating_add(1);
        match input {
            BoardInput::Values(values) => {
                self.values = values;
                self.ticks = 0;
                self.state = WatchState::Refreshed;
            }
            BoardInput::Closed if self.state == WatchState::Refreshed => self.rest(),
            BoardInput::Nothing
                if self.state == WatchState::Refreshed && self.ticks >= self.patience =>
            {
                self.rest();
            }
            BoardInput::Closed | BoardInput::Nothing => {}
        }
        match self.state {
            WatchState::New => self.least,
            WatchState::Refreshed => self.values,
            WatchState::Rests => self.on_the_way(),
        }
    }

    /// Returns true if the board rests because it is not refreshed any more.
    pub(super) fn is_tripped(&self) -> bool {
        self.state == WatchState::Rests
    }

    /// Returns true if the outputs are those of the watchdog.
    pub(super) fn is_resting(&self) -> bool {
        self.state != WatchState::Refreshed
    }

    fn rest(&mut self) {
        self.from = self.values;
        self.ticks = 0;
        self.state = WatchState::Rests;
    }

    fn on_the_way(&self) -> [f64; L] {
        let part = min(f64::from(self.ticks) / f64::from(self.ramp.max(1)), 1.0);
        let mut outputs = self.from;
        for (output, least) in outputs.iter_mut().zip(self.least) {
            *output += (least - *output) * part;
        }
        outputs
    }
}

#[cfg(test)]
#[allow(clippy::float_cmp, reason = "all of these numbers are exact")]
mod tests {
    use super::*;

    #[test]
    fn a_board_that_is_not_refreshed_goes_to_its_least_outputs_and_on_again() {
        let mut board = Watchdog::new([4.0, 0.0], 3, 4);
        assert_eq!(board.update(BoardInput::Nothing), [4.0, 0.0]);
        assert!(!board.is_tripped() && board.is_resting());
        assert_eq!(board.update(BoardInput::Values([12.0, -8.0])), [12.0, -8.0]);
        assert!(!board.is_resting());
        for expected in [12.0, 12.0] {
            assert_eq!(board.update(BoardInput::Nothing)[0], expected);
        }
        let down: [[f64; 2]; 6] = core::array::from_fn(|_| board.update(BoardInput::Nothing));
        assert_eq!(
            down.map(|outputs| outputs[0]),
            [12.0, 10.0, 8.0, 6.0, 4.0, 4.0]
        );
        assert_eq!(
            down.map(|outputs| outputs[1]),
            [-8.0, -6.0, -4.0, -2.0, 0.0, 0.0]
        );
        assert!(board.is_tripped());
        assert_eq!(board.update(BoardInput::Values([7.0, 1.0])), [7.0, 1.0]);
        assert!(!board.is_tripped());
        // Closed, it does not wait.
        assert_eq!(board.update(BoardInput::Closed), [7.0, 1.0]);
        assert!(board.is_tripped());
        assert_eq!(board.update(BoardInput::Closed), [6.25, 0.75]);
    }
}
