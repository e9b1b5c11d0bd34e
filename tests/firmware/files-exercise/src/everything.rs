//! [`everything`]: all checks, with the two ends that they share.

use checks::Checks;
use condor_mbox::{Allocator, Instant};

use crate::memory::Memory;
use crate::pair::{Pair, with_pair};
use crate::trouble::Trouble;
use crate::{boards, calls, descriptors, errors, terminals, typing, writing};

/// Makes every call, and checks what comes of it; once in a program.
pub fn everything(checks: &mut Checks<'_>, now: fn() -> Instant) {
    static MEMORY: Memory = Memory::new();
    errors::errors(checks);
    let exercised = with_pair(&MEMORY, now, |pair, allocator| {
        exercise(checks, pair, allocator)
    });
    checks.same(exercised, Ok(()));
}

fn exercise(
    checks: &mut Checks<'_>,
    pair: &Pair<'_>,
    allocator: &mut Allocator,
) -> Result<(), Trouble> {
    let system = calls::connect(checks, pair)?;
    calls::files(checks, pair, &system)?;
    calls::names(checks, pair, &system)?;
    calls::buffers(checks, pair, &system, allocator)?;
    calls::buffered(checks, pair, &system)?;
    calls::tickets(checks, pair, &system)?;
    terminals::terminals(checks, pair, allocator)?;
    writing::writing(checks, pair)?;
    typing::typing(checks, pair)?;
    terminals::lives(checks, pair, &system)?;
    let devices = boards::boards(checks, pair, allocator)?;
    descriptors::descriptors(checks, pair, &devices, system)
}
