//! Terminals and who looks at them: what begins and what ends.

use checks::Checks;
use condor_mbox::{Allocator, CriticalSection, MemoryWindow as _};
use condor_tty::layout::{BLOCK_BYTES, host, policy, processor};
use condor_tty::{
    FetchedOutput, Policy, TerminalError, TerminalReader, TerminalReaderError, TerminalSettings,
    TerminalVectors,
};
use embedded_io::Write as _;

use crate::bell::PATIENCE;
use crate::calls::System;
use crate::memory::HOST;
use crate::pair::{OTHERS, Pair, RING, Tty};
use crate::trouble::Trouble;

/// Checks terminals before a host has attached, and with one that comes and goes.
#[inline(never)]
pub(crate) fn terminals(
    checks: &mut Checks<'_>,
    pair: &Pair<'_>,
    allocator: &mut Allocator,
) -> Result<(), Trouble> {
    checks.group("terminals");
    let (own, terminal) = (pair.own, pair.terminal);
    let mut made = |capacity| Tty::new(own, allocator, capacity, CriticalSection).err();
    checks.same(made(100), Some(TerminalError::Capacity { capacity: 100 }));
    checks.that(matches!(made(4096), Some(TerminalError::Access(_))));
    checks.same(terminal.attached(), Ok(None));
    checks.same(terminal.settings(), TerminalSettings::COOKED);
    checks.same(terminal.policy(), Policy::DropNew);
    let mut console = terminal.console(pair.hand);
    checks.same(console.write(b"hello\n"), Ok(6));
    checks.same(terminal.unread(), Ok(7));
    checks.same(console.write_all(&[b'.'; 100]), Ok(()));
    checks.same(console.write(b"xy"), Ok(2));
    checks.same(terminal.lost(), 45);
    checks.same(console.flush(), Ok(()));

    let offset = terminal.offset();
    let elsewhere = TerminalReader::attach(own, offset + BLOCK_BYTES, HOST).err();
    checks.that(matches!(
        elsewhere,
        Some(TerminalReaderError::NoTerminal { .. })
    ));
    let misplaced = TerminalReader::attach(own, offset + 4, HOST).err();
    checks.that(matches!(
        misplaced,
        Some(TerminalReaderError::NoTerminal { .. })
    ));
    let mut reader = TerminalReader::attach(own, offset, HOST)?;
    checks.same(terminal.attached(), Ok(Some(HOST)));
    checks.same((reader.offset(), reader.capacity()), (offset, RING));
    let mut bytes = [0; 8];
    checks.same(
        reader.fetch(&mut bytes)?,
        FetchedOutput { len: 8, skipped: 0 },
    );
    checks.same(&bytes, b"hello\r\n.");
    checks.same(reader.acknowledge(7), Ok(false));
    checks.same(terminal.unread(), Ok(RING - 7));
    let status = reader.status()?;
    let counts = (
        status.lost,
        status.overwritten,
        status.unread,
        status.ignored,
    );
    checks.same(counts, (45, 0, RING - 7, 0));
    let how = own.word(offset + processor::POLICY);
    checks.same(how, Ok(policy::DROP_NEW));
    let modes = (status.cooked, status.stopped, status.full, status.interrupt);
    checks.same(modes, (true, false, false, Some(3)));
    checks.same(reader.detach(), Ok(()));
    checks.same(terminal.attached(), Ok(None));
    pair.viewer
        .attach(own, offset, HOST, TerminalVectors::DEFAULT)?;
    let shown = pair.viewer.look(pair.host);
    checks.same(shown.bytes().len(), RING as usize - 7);
    Ok(())
}

/// Checks new incarnations of terminals, new hosts, and words that nobody writes.
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
        checks.that(writeln!(console, "gone: {error}").is_ok());
    }
    let shown = pair.viewer.look(pair.host);
    checks.same(
        shown.bytes(),
        b"gone: No such file or directory (ENOENT)\r\n",
    );
    console.flush()?;

    let offset = second.offset();
    let other = TerminalReader::attach(own, offset, HOST)?;
    pair.viewer.turn(pair.host);
    let displaced = pair.viewer.ended.take();
    checks.that(matches!(
        displaced,
        Some(TerminalReaderError::Displaced { .. })
    ));
    own.set_word(offset + host::TAIL, 0x5555)?;
    checks.same(second.unread(), Ok(0));
    checks.same(second.ignored(), 1);
    checks.same(other.status()?.ignored, 1);
    let mut bytes = [0; 8];
    let mut other = other;
    own.set_word(offset + processor::HEAD, 0xffff_0000)?;
    let broken = other.fetch(&mut bytes).err();
    checks.that(matches!(broken, Some(TerminalReaderError::Broken { .. })));
    let mut same = Allocator::new(own.size());
    same.bytes(offset as usize)?;
    let renewed = Tty::new(own, &mut same, RING, CriticalSection)?;
    checks.same((renewed.offset(), renewed.attached()), (offset, Ok(None)));
    let ended = other.fetch(&mut bytes).err();
    checks.that(matches!(ended, Some(TerminalReaderError::Restarted { .. })));
    own.set_word(offset + processor::INCARNATION, 0)?;
    let early = TerminalReader::attach(own, offset, HOST).err();
    checks.same(early, Some(TerminalReaderError::NotReady { offset }));
    Ok(())
}
