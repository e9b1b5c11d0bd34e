//! Output that finds no room.

use core::fmt;
use core::sync::atomic::Ordering::Relaxed;

use checks::Checks;
use condor_mbox::Messenger;
use condor_tty::{ConsoleError, Policy};
use embedded_io::{Write as _, WriteReady as _};

use crate::bell::{PATIENCE, SHORT};
use crate::pair::{Pair, RING};
use crate::trouble::Trouble;

const LONG: &[u8; 100] = b"\
    A finger has three joints, and four tendons that pull them: what one lets go of, the others take up.";
const LATE: ConsoleError = ConsoleError::TimedOut { lost: 0 };

/// Checks each policy, with a host that looks and with one that does not.
#[inline(never)]
pub(crate) fn writing(checks: &mut Checks<'_>, pair: &Pair<'_>) -> Result<(), Trouble> {
    let (terminal, viewer) = (pair.terminal, pair.viewer);
    let mut console = terminal.console(pair.hand);
    let ring = RING as usize;
    let rest = LONG.len() - ring;
    // The ring is empty, and so is what was lost.
    let lost = |since: u32| terminal.lost().wrapping_sub(since);

    checks.group("a policy that blocks");
    terminal.set_policy(Policy::Block { timeout: PATIENCE })?;
    let (before, told) = (terminal.lost(), pair.told.load(Relaxed));
    checks.same(console.write_all(LONG), Ok(()));
    checks.same(console.flush(), Ok(()));
    checks.same(viewer.look(pair.host).bytes(), &LONG[..]);
    checks.that(pair.told.load(Relaxed) != told);
    checks.same(console.write_ready(), Ok(true));
    pair.attentive.set(false);
    terminal.set_policy(Policy::Block { timeout: SHORT })?;
    let late = ConsoleError::TimedOut { lost: rest };
    checks.same(console.write_all(LONG), Err(late));
    checks.same(console.write(b"x"), Err(LATE));
    checks.same(console.flush(), Err(LATE));
    checks.same(console.write_ready(), Ok(false));
    checks.that(fmt::Write::write_fmt(&mut console, format_args!("{ring}")).is_ok());
    checks.same(lost(before), rest as u32 + 2);
    pair.attentive.set(true);
    let shown = viewer.look(pair.host);
    checks.same(Some(shown.bytes()), LONG.get(..ring));

    checks.group("a poster");
    let messenger: &dyn Messenger = pair.hand;
    let mut poster = terminal.poster(messenger);
    let before = terminal.lost();
    checks.same(poster.post(LONG), Ok(ring));
    checks.same(embedded_io::Write::write(&mut poster, LONG), Ok(LONG.len()));
    checks.same(embedded_io::Write::write_all(&mut poster, b"end"), Ok(()));
    checks.same(poster.flush(), Ok(()));
    checks.that(fmt::Write::write_fmt(&mut poster, format_args!("{ring}")).is_ok());
    let formatted = embedded_io::Write::write_fmt(&mut poster, format_args!("!"));
    checks.that(formatted.is_ok());
    checks.same(lost(before), (rest + LONG.len() + 3 + 2 + 1) as u32);
    let shown = viewer.look(pair.host);
    checks.same(Some(shown.bytes()), LONG.get(..ring));

    checks.group("a policy that overwrites");
    terminal.set_policy(Policy::DropOld)?;
    checks.same(terminal.policy(), Policy::DropOld);
    let before = terminal.lost();
    checks.same(console.write_all(LONG), Ok(()));
    checks.same(lost(before), 0);
    let shown = viewer.look(pair.host);
    checks.same(Some(shown.bytes()), LONG.get(rest..));
    checks.same(viewer.skipped.get(), rest as u32);
    terminal.set_policy(Policy::Block { timeout: PATIENCE })?;
    Ok(())
}
