//! A terminal of the processor, at which the host looks and types.

use core::time::Duration;

use condor_tty::{ConsoleError, FetchedOutput, TerminalReader};
use embedded_io::{Read as _, Write as _};
use firmware::Checks;

use crate::ends::Ends;
use crate::{HOST, PATIENCE, Told, host};

/// Writes a line that the host reads, and reads one that it types.
#[inline(never)]
pub(crate) fn terminals(checks: &mut Checks, ends: &Ends) -> Result<(), Told> {
    checks.group("terminals");
    let terminal = &ends.terminal;
    let console = |timeout| terminal.console(&ends.hand).with_read_timeout(timeout);
    let mut reader = TerminalReader::attach(ends.own, terminal.offset(), HOST)?;
    checks.same(console(PATIENCE).write(b"hello\n"), Ok(6));
    let mut bytes = [0; 16];
    let FetchedOutput { len, .. } = reader.fetch(&mut bytes)?;
    checks.same(bytes.get(..len), Some(&b"hello\r\n"[..]));
    reader.acknowledge(len)?;

    let late = console(Duration::from_millis(20)).read(&mut [0; 8]);
    checks.same(late, Err(ConsoleError::TimedOut { lost: 0 }));
    host::types(b"hellp\x7fo\n");
    let mut line = [0; 8];
    let read = console(PATIENCE).read(&mut line);
    checks.same((read, &line), (Ok(6), b"hello\n\0\0"));
    let FetchedOutput { len, .. } = reader.fetch(&mut bytes)?;
    checks.same(bytes.get(..len), Some(&b"hellp\x08 \x08o\r\n"[..]));
    reader.acknowledge(len)?;
    reader.detach()?;
    Ok(())
}
