//! [`Script`]: a record of typed characters with their instants of simulated time; and [`ScriptWriter`], which
//! records it.

use core::cell::{Cell, RefCell};
use core::fmt::Write as _;
use std::collections::HashMap;
use std::fs::File;
use std::io::{self, Read as _, Write as _};
use std::path::{Path, PathBuf};

use condor_clock::NEVER;
use condor_platform::linux::read_text;

use crate::error::NamedFileError;
use crate::system::SystemDirectory;

/// The line with which a record of typing begins.
pub(super) const HEAD: &str = "condor typing 1";

/// A record of the characters that were typed in a system with a simulated clock. Typing them again repeats the run.
///
/// The record is a text. Its first line is `condor typing 1`. Each further line has four parts with a blank between
/// them: the instant in nanoseconds, the name of the processor, the number of characters that were typed at its
/// terminal before these, and the characters. Characters that are not printable ASCII are escaped as in Rust's byte
/// strings.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Script {
    text: String,
}

/// The mistakes for which a record of typed characters cannot be replayed. Each is a sentence that begins with the file
/// and the line.
#[derive(Debug, thiserror::Error)]
#[error("{}", .0.join("\n"))]
pub struct ScriptError(pub Vec<String>);

/// Characters that were typed at one instant, one after the other.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Piece {
    at: u64,
    name: String,
    /// The number of characters that were typed at this terminal before these.
    place: u64,
    characters: Vec<u8>,
}

impl Script {
    /// Reads and checks the record in the file `path`. `names` are the processors of the system: lines may name only
    /// these.
    ///
    /// # Errors
    /// [`ScriptError`] with every mistake, or if the file cannot be read.
    pub fn read(path: &Path, names: &[&str]) -> Result<Self, ScriptError> {
        let shown = path.display();
        let text = read_text(path)
            .map_err(|error| ScriptError(vec![format!("{shown}: cannot read it: {error}")]))?;
        let mut wrong = Vec::new();
        let mut before = 0;
        for (line, piece) in (1..).zip(pieces(&text)) {
            let problem = match piece {
                Err(problem) => problem,
                Ok(None) => continue,
                Ok(Some(Piece { at, .. })) if at < before => {
                    format!("the instant {at} is before that of the line above, {before}")
                }
                Ok(Some(Piece { name, .. })) if !names.contains(&name.as_str()) => {
                    let names = names.join(", ");
                    format!("there is no processor `{name}`; there are {names}")
                }
                Ok(Some(Piece { at, .. })) => {
                    before = at;
                    continue;
                }
            };
            wrong.push(format!("{shown}:{line}: {problem}"));
        }
        if wrong.is_empty() {
            Ok(Self { text })
        } else {
            Err(ScriptError(wrong))
        }
    }

    pub(super) fn text(&self) -> &str {
        &self.text
    }

    /// Returns the characters of each piece with the name of the processor.
    pub(super) fn typed(&self) -> impl Iterator<Item = (String, Vec<u8>)> {
        let pieces = pieces(&self.text).filter_map(|piece| piece.ok()?);
        pieces.map(|piece| (piece.name, piece.characters))
    }
}

/// Reads the piece of each line; the first line and empty ones have none.
fn pieces(text: &str) -> impl Iterator<Item = Result<Option<Piece>, String>> {
    // A blank at the end of a line may be a character.
    text.split('\n')
        .enumerate()
        .map(|(place, line)| match place {
            0 if line == HEAD => Ok(None),
            0 => Err(format!(
                "this is no record of typing: it does not begin with the line `{HEAD}`"
            )),
            _ if line.is_empty() => Ok(None),
            _ => piece(line).map(Some).ok_or_else(|| {
                "expected an instant in ns, a processor, a number of characters before these, and \
             characters, as in `1500000 master 12 run wave\\r`"
                    .into()
            }),
        })
}

fn piece(line: &str) -> Option<Piece> {
    let mut parts = line.splitn(4, ' ');
    let piece = Piece {
        at: parts.next()?.parse().ok()?,
        name: parts.next()?.into(),
        place: parts.next()?.parse().ok()?,
        characters: unescape(parts.next()?)?,
    };
    (!piece.characters.is_empty() && piece.at != NEVER).then_some(piece)
}

/// The inverse of [`u8::escape_ascii`].
fn unescape(text: &str) -> Option<Vec<u8>> {
    let mut bytes = text.bytes();
    let mut characters = Vec::new();
    while let Some(byte) = bytes.next() {
        characters.push(match byte {
            b'\\' => match bytes.next()? {
                b'n' => b'\n',
                b'r' => b'\r',
                b't' => b'\t',
                byte @ (b'\\' | b'\'' | b'"') => byte,
                b'x' => {
                    let mut digit = || char::from(bytes.next()?).to_digit(16);
                    u8::try_from(digit()? * 16 + digit()?).ok()?
                }
                _ => return None,
            },
            b' '..=b'~' => byte,
            _ => return None,
        });
    }
    Some(characters)
}

/// The characters that a terminal may send now.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Turn {
    /// Nothing: the service does not have the turn.
    None,
    /// One character that a former service has recorded, and perhaps not sent.
    Recorded,
    /// One character.
    Any,
}

/// Records each character before it is sent. There is one pen for all terminals, so that the order of
/// the lines is that in which characters are sent.
#[derive(Debug)]
pub(super) struct ScriptWriter {
    file: RefCell<File>,
    /// The piece to which the next character may belong: its instant, its name, and the place of
    /// that character.
    last: RefCell<(u64, String, u64)>,
    /// The number of typed characters of each terminal that have been recorded.
    recorded: RefCell<HashMap<String, u64>>,
    /// The characters of the script, the next one last.
    script: RefCell<Vec<(u64, String)>>,
    turn: Cell<Turn>,
    /// The present instant, if the service has the turn.
    now: Cell<u64>,
}

impl ScriptWriter {
    /// Opens the record in the directory of a system, where a former service ended.
    pub(super) fn open(directory: &SystemDirectory) -> Result<Self, NamedFileError> {
        let path = directory.typing();
        let opened = open_record(&path).map_err(NamedFileError::at("open", &path));
        let (file, text) = opened?;
        let (mut recorded, mut count) = (HashMap::new(), 0);
        for piece in pieces(&text).filter_map(|piece| piece.ok()?) {
            count += piece.characters.len();
            recorded.insert(piece.name, piece.place + piece.characters.len() as u64);
        }
        let path = directory.replay();
        let script = match std::fs::read_to_string(&path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(String::new()),
            other => other.map_err(NamedFileError::at("read", &path)),
        };
        let script = script?;
        let script = pieces(&script).filter_map(|piece| piece.ok()?);
        let script = script.flat_map(
            |Piece {
                 at,
                 name,
                 characters,
                 ..
             }| { characters.into_iter().map(move |_| (at, name.clone())) },
        );
        // All that was recorded in this run was typed as the script says.
        let mut script: Vec<_> = script.skip(count).collect();
        script.reverse();
        Ok(Self {
            file: RefCell::new(file),
            last: RefCell::default(),
            recorded: RefCell::new(recorded),
            script: RefCell::new(script),
            turn: Cell::new(Turn::None),
            now: Cell::new(0),
        })
    }

    /// The next terminal may type this.
    pub(super) fn begin(&self, turn: Turn, now: u64) {
        self.turn.set(turn);
        self.now.set(now);
    }

    /// The instant of the next character of the script.
    pub(super) fn next_instant(&self) -> Option<u64> {
        self.script.borrow().last().map(|(at, _)| *at)
    }

    /// Returns how many of the `count` characters from `place` on, of those that are typed at a terminal, may
    /// be read.
    pub(super) fn readable(&self, name: &str, place: u64, count: usize) -> usize {
        let recorded = self.recorded_of(name).saturating_sub(place);
        let Some((at, next)) = self.script.borrow().last().cloned() else {
            return count;
        };
        let is_due = self.turn.get() == Turn::Any && at <= self.now.get() && next == name;
        let most = recorded.max(u64::from(is_due));
        count.min(usize::try_from(most).unwrap_or(usize::MAX))
    }

    /// Records the character at `place` of those that are typed at a terminal, unless it has been
    /// recorded; returns true if it may be sent.
    pub(super) fn sends(&self, name: &str, place: u64, character: u8) -> io::Result<bool> {
        let is_recorded = place < self.recorded_of(name);
        match self.turn.get() {
            Turn::Any => {}
            Turn::Recorded if is_recorded => {}
            _ => return Ok(false),
        }
        if !is_recorded {
            self.write(name, place, character)?;
        }
        Ok(true)
    }

    fn recorded_of(&self, name: &str) -> u64 {
        self.recorded.borrow().get(name).copied().unwrap_or(0)
    }

    fn write(&self, name: &str, place: u64, character: u8) -> io::Result<()> {
        let (at, escaped) = (self.now.get(), [character].escape_ascii().to_string());
        let mut last = self.last.borrow_mut();
        let mut text = String::new();
        if *last != (at, name.into(), place) {
            // A string takes everything.
            let _ = write!(text, "\n{at} {name} {place} ");
        }
        text.push_str(&escaped);
        self.file.borrow_mut().write_all(text.as_bytes())?;
        self.recorded.borrow_mut().insert(name.into(), place + 1);
        let is_end = matches!(character, b'\r' | b'\n');
        *last = if is_end {
            Default::default()
        } else {
            (at, name.into(), place + 1)
        };
        let mut script = self.script.borrow_mut();
        if script.last().is_some_and(|(_, next)| next == name) {
            script.pop();
        }
        Ok(())
    }
}

/// Opens a record to write on, without what a service could not write to its end.
fn open_record(path: &PathBuf) -> io::Result<(File, String)> {
    let mut options = File::options();
    let mut file = options.read(true).append(true).open(path)?;
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes)?;
    let mut text = String::from_utf8_lossy(&bytes).into_owned();
    let whole = text.len();
    while text.len() > HEAD.len() && pieces(&text).last().is_some_and(|piece| piece.is_err()) {
        text.pop();
    }
    if text.len() < whole {
        file.set_len(text.len() as u64)?;
    }
    Ok((file, text))
}

#[cfg(test)]
mod tests;
