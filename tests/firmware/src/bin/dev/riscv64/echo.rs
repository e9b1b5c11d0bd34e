//! The echo of bytes that come, interrupt-driven.

use condor_dev::{BusAccessError, Fd, IoError, OpenMode};
use firmware::Checks;
use riscv::register::{mstatus, time};

use super::{Machine, System};

/// The number of bytes; [`INVITATION`] says the same number.
const BYTES: usize = 1 << 20;
/// Ticks of the machine's clock that the last bytes may take: 10 s.
const PATIENCE: usize = 100_000_000;
const INVITATION: &[u8] = b"echo 1048576\n";

/// Invites whoever is at the other end of the serial port to send, and echoes it. The driver's buffers
/// are filled and emptied by interrupts alone.
pub(crate) fn echo(checks: &mut Checks, system: &System) {
    let Ok(fd) = system.open(
        ":uart",
        0,
        OpenMode::READ | OpenMode::WRITE | OpenMode::EXCLUSIVE,
    ) else {
        return checks.that(false);
    };
    let invited = write_all(system, fd, INVITATION);
    let echoed = invited.and_then(|()| echo_bytes(system, fd));
    let flushed = flush(system, fd);
    checks.same(echoed, Ok(()));
    checks.same(flushed, Ok(true));
    if let Ok(uart) = system.device(Machine::uart, fd) {
        checks.same(uart.line_errors().overruns, 0);
    }
    let counts = system.interrupt_counts();
    // The board has a FIFO of 16 each way.
    checks.that(counts.served as usize >= BYTES / 64);
    // QEMU 7.2's PLIC also notes what a board asks while it is served, which is nobody's afterwards.
    checks.same(counts.spurious, 0);
    checks.same(counts.stuck, 0);
    checks.same(system.close(fd), Ok(()));
}

type Outcome = Result<(), IoError<BusAccessError>>;

fn echo_bytes(system: &System, fd: Fd) -> Outcome {
    let mut buffer = [0; 128];
    let mut left = BYTES;
    while left > 0 {
        let most = left.min(buffer.len());
        let (into, _) = buffer.split_at_mut(most);
        match system.read(fd, into) {
            Ok(count) => {
                write_all(system, fd, into.get(..count).unwrap_or_default())?;
                left = left.saturating_sub(count);
            }
            Err(IoError::WouldBlock) => sleep_until(|| system.read_ready(fd))?,
            Err(error) => return Err(error),
        }
    }
    Ok(())
}

fn write_all(system: &System, fd: Fd, mut from: &[u8]) -> Outcome {
    while !from.is_empty() {
        match system.write(fd, from) {
            Ok(count) => from = from.get(count..).unwrap_or_default(),
            Err(IoError::WouldBlock) => sleep_until(|| system.write_ready(fd))?,
            Err(error) => return Err(error),
        }
    }
    Ok(())
}

/// Waits until all is sent; returns false if that takes too long.
fn flush(system: &System, fd: Fd) -> Result<bool, IoError<BusAccessError>> {
    let begin = time::read();
    while !system.is_flushed(fd)? {
        if time::read().wrapping_sub(begin) > PATIENCE {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Sleeps until an interrupt has made something so. Who started the machine ends it if none comes.
fn sleep_until(ready: impl Fn() -> Result<bool, IoError<BusAccessError>>) -> Outcome {
    loop {
        // An interrupt after the question wakes up `wfi`, masked or not.
        // SAFETY: masking breaks nobody's section, and none is in progress here.
        unsafe { mstatus::clear_mie() };
        let answer = ready();
        if answer == Ok(false) {
            riscv::asm::wfi();
        }
        // SAFETY: as above.
        unsafe { mstatus::set_mie() };
        if answer? {
            return Ok(());
        }
    }
}
