//! Terminals and who looks at them: what begins and what ends.

use checks::Checks;
use condor_mbox::{CriticalSection, MemoryWindow as _, Places};
use condor_tty::layout::{BLOCK_BYTES, host, policy, processor};
use condor_tty::{Fetched, Policy, Reader, ReaderError, Settings, TerminalError, Vectors};
use embedded_io::Write as _;

use crate::calls::System;
use crate::memory::HOST;
use crate::pair::{OTHERS, PATIENCE, Pair, RING, Tty};
use crate::trouble::Trouble;

/// Before a host has attached, and one that comes and goes.
#[inline(never)]
pub(crate) fn terminals(
    checks: &mut Checks<'_>,
    pair: &Pair<'_>,
    places: &mut Places,
) -> Result<(), Trouble> {
    checks.group("terminals");
    let (own, terminal) = (pair.own, pair.terminal);
    let mut made = |capacity| Tty::new(own, places, capacity, CriticalSection).err();
    checks.same(
        "a ring is a power of two",
        made(100),
        Some(TerminalError::Capacity { capacity: 100 }),
    );
    checks.that(
        "it needs room",
        matches!(made(4096), Some(TerminalError::Access(_))),
    );
    checks.same("nobody is attached", terminal.attached(), Ok(None));
    checks.same("lines are edited", terminal.settings(), Settings::COOKED);
    checks.same(
        "what finds no room is dropped",
        terminal.policy(),
        Policy::DropNew,
    );
    let mut console = terminal.console(pair.hand);
    checks.same("a line is written", console.write(b"hello\n"), Ok(6));
    checks.same("a newline takes two", terminal.unread(), Ok(7));
    checks.same(
        "more is written than has room",
        console.write_all(&[b'.'; 100]),
        Ok(()),
    );
    checks.same("and lost", console.write(b"xy"), Ok(2));
    checks.same("it is counted", terminal.lost(), 45);
    checks.same("nobody is waited for", console.flush(), Ok(()));

    let offset = terminal.offset();
    let elsewhere = Reader::attach(own, offset + BLOCK_BYTES, HOST).err();
    checks.that(
        "it is where it is",
        matches!(elsewhere, Some(ReaderError::NoTerminal { .. })),
    );
    let misplaced = Reader::attach(own, offset + 4, HOST).err();
    checks.that(
        "on a line",
        matches!(misplaced, Some(ReaderError::NoTerminal { .. })),
    );
    let mut reader = Reader::attach(own, offset, HOST)?;
    checks.same("a host attaches", terminal.attached(), Ok(Some(HOST)));
    checks.same(
        "it knows what to",
        (reader.offset(), reader.capacity()),
        (offset, RING),
    );
    let mut bytes = [0; 8];
    let fetched = reader.fetch(&mut bytes)?;
    checks.same("it fetches", fetched, Fetched { len: 8, skipped: 0 });
    checks.same("what was written", &bytes, b"hello\r\n.");
    checks.same("nobody waits for it", reader.acknowledge(7), Ok(false));
    checks.same(
        "what it has acknowledged is gone",
        terminal.unread(),
        Ok(RING - 7),
    );
    let status = reader.status()?;
    let counts = (
        status.lost,
        status.overwritten,
        status.unread,
        status.ignored,
    );
    checks.same("it is told what was lost", counts, (45, 0, RING - 7, 0));
    checks.same(
        "and how",
        own.word(offset + processor::POLICY),
        Ok(policy::DROP_NEW),
    );
    let modes = (status.cooked, status.stopped, status.full, status.interrupt);
    checks.same("and the mode", modes, (true, false, false, Some(3)));
    checks.same("it detaches", reader.detach(), Ok(()));
    checks.same("nobody is attached", terminal.attached(), Ok(None));
    pair.viewer.attach(own, offset, HOST, Vectors::DEFAULT)?;
    let shown = pair.viewer.look(pair.host);
    checks.same(
        "the next one goes on",
        shown.bytes().len(),
        RING as usize - 7,
    );
    Ok(())
}

/// New lives of terminals, new hosts, and words that nobody writes.
#[inline(never)]
pub(crate) fn lives(
    checks: &mut Checks<'_>,
    pair: &Pair<'_>,
    system: &System<'_>,
) -> Result<(), Trouble> {
    checks.group("lives");
    let (own, second) = (pair.own, pair.second);
    pair.viewer.attach(own, second.offset(), HOST, OTHERS)?;
    second.set_policy(Policy::Block { timeout: PATIENCE })?;
    let mut console = second.console(pair.hand);
    pair.files.fail(condor_fs::Errno::NOENT);
    if let Err(error) = system.status("gone") {
        checks.that(
            "an error is shown",
            writeln!(console, "gone: {error}").is_ok(),
        );
    }
    let shown = pair.viewer.look(pair.host);
    checks.same(
        "to a person",
        shown.bytes(),
        b"gone: No such file or directory (ENOENT)\r\n",
    );
    console.flush()?;

    let offset = second.offset();
    let other = Reader::attach(own, offset, HOST)?;
    pair.viewer.turn(pair.host);
    let displaced = pair.viewer.ended.take();
    checks.that(
        "the last one has it",
        matches!(displaced, Some(ReaderError::Displaced { .. })),
    );
    own.set_word(offset + host::TAIL, 0x5555)?;
    checks.same("a wild cursor is not believed", second.unread(), Ok(0));
    checks.same("and counted", second.ignored(), 1);
    checks.same("the host is told", other.status()?.ignored, 1);
    let mut bytes = [0; 8];
    let mut other = other;
    own.set_word(offset + processor::HEAD, 0xffff_0000)?;
    let broken = other.fetch(&mut bytes).err();
    checks.that(
        "nor is the other one",
        matches!(broken, Some(ReaderError::Broken { .. })),
    );
    let mut same = Places::new(own.size());
    same.bytes(offset as usize)?;
    let renewed = Tty::new(own, &mut same, RING, CriticalSection)?;
    checks.same(
        "a terminal begins anew",
        (renewed.offset(), renewed.attached()),
        (offset, Ok(None)),
    );
    let ended = other.fetch(&mut bytes).err();
    checks.that(
        "its host is told",
        matches!(ended, Some(ReaderError::Restarted { .. })),
    );
    own.set_word(offset + processor::LIFE, 0)?;
    let early = Reader::attach(own, offset, HOST).err();
    checks.same(
        "one that begins is not ready",
        early,
        Some(ReaderError::NotReady { offset }),
    );
    Ok(())
}
