//! [`Program`]: what the background and the loops do, on the real scheduler and on the reference.

use proptest::collection::vec;
use proptest::prelude::*;

use condor_mos::{Overrun, Rate};

pub(crate) const LOOPS: usize = 4;

/// Runs of all loops together after which they return at once: those that take all the time there
/// is would keep the background from ever ending.
pub(crate) const BUSY_RUNS: u32 = 300;

/// Something that the background or a loop asks for.
#[derive(Clone, Debug)]
pub(crate) enum Action {
    Nothing,
    Enable(usize),
    Disable(usize),
    SetRate(usize, Rate),
    Stop,
    Start,
    /// An interrupt without cause.
    Interrupt,
    /// Interrupts come late.
    Hold(u64),
    /// Use of a lock for so many ticks; a bit for each user.
    Lock(u32, u64),
}

/// Ticks of work, an action, and ticks of work again.
#[derive(Clone, Debug)]
pub(crate) struct Piece {
    pub(crate) before: u64,
    pub(crate) action: Action,
    pub(crate) after: u64,
}

#[derive(Clone, Debug)]
pub(crate) struct Program {
    pub(crate) frequency: Rate,
    pub(crate) rates: [Rate; LOOPS],
    pub(crate) overruns: [Overrun; LOOPS],
    /// What each loop does in its runs, again and again.
    pub(crate) bodies: [Vec<Piece>; LOOPS],
    pub(crate) background: Vec<Piece>,
}

/// Sizes for a frequency of the timer.
#[derive(Clone, Copy, Debug)]
struct Scale {
    frequency: Rate,
    /// The fastest rate.
    fastest: u32,
    /// Ticks of a short run, and of a long wait.
    short: u64,
    long: u64,
    /// The longest that interrupts are held back: less than half of any counter's range.
    hold: u64,
}

/// Coarse ticks, in which much coincides; ticks that no rate divides; and counters that begin anew
/// several times between two events.
const SCALES: [Scale; 4] = [
    Scale {
        frequency: Rate::hz(120),
        fastest: 12,
        short: 12,
        long: 200,
        hold: 50,
    },
    Scale {
        frequency: Rate::fraction(32_768, 7),
        fastest: 20,
        short: 300,
        long: 8_000,
        hold: 2_000,
    },
    Scale {
        frequency: Rate::hz(1_000_000),
        fastest: 9,
        short: 60_000,
        long: 900_000,
        hold: 30_000,
    },
    Scale {
        frequency: Rate::hz(16_000_000),
        fastest: 5,
        short: 1_000_000,
        long: 3_000_000,
        hold: 30_000,
    },
];

fn rate(fastest: u32) -> impl Strategy<Value = Rate> {
    prop_oneof![
        3 => (1..=fastest).prop_map(Rate::hz),
        1 => (1..=fastest, 1..=3_u32).prop_map(|(n, d)| Rate::fraction(n, d)),
    ]
}

fn action(scale: Scale, loops: bool) -> impl Strategy<Value = Action> {
    let rare = if loops { 1 } else { 4 };
    prop_oneof![
        20 => Just(Action::Nothing),
        rare => (0..LOOPS).prop_map(Action::Disable),
        2 * rare => (0..LOOPS).prop_map(Action::Enable),
        rare => (0..LOOPS, rate(scale.fastest)).prop_map(|(n, rate)| Action::SetRate(n, rate)),
        1 => Just(Action::Stop),
        3 => Just(Action::Start),
        2 => Just(Action::Interrupt),
        2 => (0..scale.hold).prop_map(Action::Hold),
        2 => (0..1_u32 << LOOPS, 0..scale.short).prop_map(|(users, ticks)| Action::Lock(users, ticks)),
    ]
}

fn pieces(scale: Scale, loops: bool) -> impl Strategy<Value = Vec<Piece>> {
    let ticks = if loops { scale.short } else { scale.long };
    let piece = (0..ticks, action(scale, loops), 0..ticks / 2);
    let piece = piece.prop_map(|(before, action, after)| Piece {
        before,
        action,
        after,
    });
    vec(piece, if loops { 1..4 } else { 1..24 })
}

fn overrun() -> impl Strategy<Value = Overrun> {
    prop_oneof![
        Just(Overrun::Skip),
        (0..4_u8).prop_map(Overrun::CatchUp),
        Just(Overrun::Fault),
    ]
}

pub(crate) fn program() -> impl Strategy<Value = Program> {
    prop::sample::select(SCALES.to_vec()).prop_flat_map(|scale| {
        (
            prop::array::uniform4(rate(scale.fastest)),
            prop::array::uniform4(overrun()),
            prop::array::uniform4(pieces(scale, true)),
            pieces(scale, false),
        )
            .prop_map(move |(rates, overruns, bodies, background)| Program {
                frequency: scale.frequency,
                rates,
                overruns,
                bodies,
                background,
            })
    })
}
