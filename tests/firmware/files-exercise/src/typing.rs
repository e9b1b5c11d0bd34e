//! Input that is typed at a terminal.

use core::sync::atomic::Ordering::Relaxed;

use checks::Checks;
use condor_mbox::{CriticalSection, Messenger as _, StaticWindow};
use condor_tty::layout::{input_data, reply};
use condor_tty::{
    Characters, Console, ConsoleError, InputResult, TerminalSettings, TerminalVectors,
};
use embedded_io::{BufRead as _, Read as _, ReadExactError, ReadReady as _, Write as _};

use crate::bell::{Mail, PATIENCE, SHORT};
use crate::memory::{HAND, HOST};
use crate::pair::{AHEAD, OTHERS, Pair};
use crate::text::Text;
use crate::trouble::Trouble;

type Reading<'t, 'p> = Console<'t, StaticWindow<'static>, CriticalSection, Mail<'p>, AHEAD>;

/// Checks lines, keys that do something, and raw characters.
#[inline(never)]
pub(crate) fn typing(checks: &mut Checks<'_>, pair: &Pair<'_>) -> Result<(), Trouble> {
    let mut console = pair.terminal.console(pair.hand).with_read_timeout(PATIENCE);
    lines(checks, pair, &mut console)?;
    keys(checks, pair, &mut console)?;
    raw(checks, pair, &mut console)?;
    second(checks, pair)
}

fn lines(
    checks: &mut Checks<'_>,
    pair: &Pair<'_>,
    console: &mut Reading<'_, '_>,
) -> Result<(), Trouble> {
    checks.group("lines");
    let mut impatient = pair.terminal.console(pair.hand).with_read_timeout(SHORT);
    let before = pair.hand.now();
    let late = impatient.read(&mut [0; 8]);
    checks.same(late, Err(ConsoleError::TimedOut { lost: 0 }));
    let waited = pair.hand.now().ns_since(before);
    checks.that(u128::from(waited) >= SHORT.as_nanos());
    checks.same(console.read_ready(), Ok(false));
    types(checks, pair, console, b"hellp\x7fo\n", b"hello\n")?;
    let shown = pair.viewer.look(pair.host);
    checks.same(shown.bytes(), b"hellp\x08 \x08o\r\n");
    pair.viewer.type_all(pair.host, b"two\nlines\n");
    checks.same(console.read_ready(), Ok(true));
    checks.same(console.fill_buf(), Ok(&b"two\n"[..]));
    console.consume(2);
    checks.same(reads(console)?.bytes(), b"o\n");
    checks.same(console.fill_buf(), Ok(&b"lines\n"[..]));
    console.consume(6);
    pair.viewer.type_all(pair.host, b"four\n\x04");
    let mut four = [0; 4];
    let exact = console.read_exact(&mut four);
    checks.same((exact, &four), (Ok(()), b"four"));
    let exact = console.read_exact(&mut four);
    checks.same(exact, Err(ReadExactError::UnexpectedEof));
    checks.same(console.read_ready(), Ok(false));
    pair.hand.serve(SHORT)?;
    Ok(())
}

fn keys(
    checks: &mut Checks<'_>,
    pair: &Pair<'_>,
    console: &mut Reading<'_, '_>,
) -> Result<(), Trouble> {
    checks.group("keys");
    types(checks, pair, console, b"one two\x17three\n", b"one three\n")?;
    types(checks, pair, console, b"junk\x15good\n", b"good\n")?;
    types(checks, pair, console, b"now\x04", b"now")?;
    types(checks, pair, console, b"\x04", b"")?;
    let before = pair.interrupts.load(Relaxed);
    pair.viewer.typing.set(b"abc\x03");
    checks.same(console.read(&mut [0; 8]), Err(ConsoleError::Interrupted));
    checks.same(pair.interrupts.load(Relaxed).wrapping_sub(before), 1);
    pair.viewer.type_all(pair.host, b"\x03");
    let asked = [
        pair.terminal.take_interrupt(),
        pair.terminal.take_interrupt(),
    ];
    checks.same(asked, [true, false]);
    pair.viewer.look(pair.host);
    pair.viewer.type_all(pair.host, b"\x13");
    console.write_all(b"held")?;
    checks.same(pair.viewer.look(pair.host).bytes(), b"");
    pair.viewer.type_all(pair.host, b"\x11");
    checks.same(pair.viewer.look(pair.host).bytes(), b"held");
    checks.same(pair.terminal.overlong(), 0);
    Ok(())
}

fn raw(
    checks: &mut Checks<'_>,
    pair: &Pair<'_>,
    console: &mut Reading<'_, '_>,
) -> Result<(), Trouble> {
    checks.group("settings");
    pair.viewer.look(pair.host);
    pair.terminal.configure(&TerminalSettings::RAW)?;
    checks.same(pair.terminal.settings(), TerminalSettings::RAW);
    types(checks, pair, console, b"\x03", b"\x03")?;
    console.write_all(b"a\nb")?;
    checks.same(pair.viewer.look(pair.host).bytes(), b"a\nb");
    let characters = Characters {
        end_of_file: b'.',
        interrupt: 0,
        ..Characters::UNIX
    };
    let own = TerminalSettings {
        characters,
        ..TerminalSettings::COOKED
    };
    pair.terminal.configure(&own)?;
    types(checks, pair, console, b"end.", b"end")?;
    pair.terminal.configure(&TerminalSettings::COOKED)?;
    let outcomes = [b'z', 0x03].map(|character| pair.terminal.accept(character));
    checks.same(
        outcomes,
        [Ok(InputResult::Taken), Ok(InputResult::Interrupts)],
    );
    checks.that(pair.terminal.take_interrupt());
    checks.same(pair.viewer.look(pair.host).bytes(), b"endz^C\r\n");
    Ok(())
}

fn second(checks: &mut Checks<'_>, pair: &Pair<'_>) -> Result<(), Trouble> {
    checks.group("a second terminal");
    let send = |vector, data| pair.host.send_with_reply(HAND, vector, data, PATIENCE);
    let input = input_data(pair.second.offset(), b'?');
    checks.same(
        send(TerminalVectors::DEFAULT.input, input),
        Ok(reply::NO_TERMINAL),
    );
    checks.same(send(OTHERS.room, 0), Ok(reply::ACCEPTED));
    if let Some(reader) = pair.viewer.take() {
        reader.detach()?;
    }
    pair.viewer
        .attach(pair.own, pair.second.offset(), HOST, OTHERS)?;
    let mut console = pair.second.console(pair.hand).with_read_timeout(PATIENCE);
    types(checks, pair, &mut console, b"hi\n", b"hi\n")?;
    checks.same(pair.viewer.look(pair.host).bytes(), b"hi\r\n");
    Ok(())
}

/// Types a line while the program waits in a read, and checks the line that it reads.
#[track_caller]
fn types(
    checks: &mut Checks<'_>,
    pair: &Pair<'_>,
    console: &mut Reading<'_, '_>,
    typed: &'static [u8],
    expected: &'static [u8],
) -> Result<(), Trouble> {
    pair.viewer.typing.set(typed);
    let line = reads(console)?;
    checks.same(line.bytes(), expected);
    Ok(())
}

fn reads(console: &mut Reading<'_, '_>) -> Result<Text<32>, ConsoleError> {
    let mut line = [0; 32];
    let count = console.read(&mut line)?;
    let mut text = Text::new();
    text.push(line.get(..count).unwrap_or_default());
    Ok(text)
}
