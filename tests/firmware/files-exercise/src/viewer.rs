//! [`Viewer`]: the host's end of a terminal, and who sits there.

use core::cell::{Cell, RefCell};
use core::time::Duration;

use condor_mbox::{Messenger as _, Processor, Region};
use condor_tty::layout::{input_data, reply};
use condor_tty::{TerminalReader, TerminalReaderError, TerminalVectors};

use crate::bell::{Mail, PATIENCE};
use crate::memory::{HAND, Window};
use crate::text::Text;

/// The bytes that are fetched in one turn: fewer than a ring has, so that writers do wait.
const FETCHED: usize = 24;

/// A viewer of terminals, which looks at most at one of them at a time.
pub(crate) struct Viewer {
    reader: Cell<Option<TerminalReader<Window>>>,
    vectors: Cell<TerminalVectors>,
    /// The output that has been shown since the last look.
    shown: RefCell<Text<256>>,
    pub(crate) skipped: Cell<u32>,
    /// The bytes that are yet to be typed.
    pub(crate) typing: Cell<&'static [u8]>,
    /// The error that ended the view.
    pub(crate) ended: Cell<Option<TerminalReaderError>>,
}

impl Viewer {
    pub(crate) const fn new() -> Self {
        Self {
            reader: Cell::new(None),
            vectors: Cell::new(TerminalVectors::DEFAULT),
            shown: RefCell::new(Text::new()),
            skipped: Cell::new(0),
            typing: Cell::new(b""),
            ended: Cell::new(None),
        }
    }

    /// Looks at the terminal at `offset` from now on.
    pub(crate) fn attach(
        &self,
        own: Region<Window>,
        offset: u32,
        me: Processor,
        vectors: TerminalVectors,
    ) -> Result<(), TerminalReaderError> {
        self.vectors.set(vectors);
        self.reader
            .set(Some(TerminalReader::attach(own, offset, me)?));
        Ok(())
    }

    /// Ends the view; returns its reader.
    pub(crate) fn take(&self) -> Option<TerminalReader<Window>> {
        self.reader.take()
    }

    /// Runs one turn of the host: serves, shows, and types.
    pub(crate) fn turn(&self, host: &Mail<'_>) {
        // Its own memory is there.
        let _ = host.serve(Duration::ZERO);
        let Some(mut reader) = self.reader.take() else {
            return;
        };
        match self.show(host, &mut reader) {
            Ok(()) => {
                self.type_one(host, &reader);
                self.reader.set(Some(reader));
            }
            Err(error) => self.ended.set(Some(error)),
        }
    }

    fn show(
        &self,
        host: &Mail<'_>,
        reader: &mut TerminalReader<Window>,
    ) -> Result<(), TerminalReaderError> {
        if reader.status()?.stopped {
            return Ok(());
        }
        let mut bytes = [0; FETCHED];
        let fetched = reader.fetch(&mut bytes)?;
        if let Ok(mut shown) = self.shown.try_borrow_mut() {
            shown.push(bytes.get(..fetched.len).unwrap_or_default());
        }
        self.skipped
            .set(self.skipped.get().wrapping_add(fetched.skipped));
        if reader.acknowledge(fetched.len)? && fetched.len > 0 {
            // A processor that waits looks by itself, too.
            let _ = host.send(
                HAND,
                self.vectors.get().room,
                reader.offset(),
                Duration::ZERO,
            );
        }
        Ok(())
    }

    fn type_one(&self, host: &Mail<'_>, reader: &TerminalReader<Window>) {
        let Some((character, rest)) = self.typing.get().split_first() else {
            return;
        };
        if reader.status().is_ok_and(|status| status.full) {
            return;
        }
        let input = input_data(reader.offset(), *character);
        match host.send_with_reply(HAND, self.vectors.get().input, input, PATIENCE) {
            Ok(reply::ACCEPTED) => self.typing.set(rest),
            Ok(reply::FULL) => {}
            // Nobody is there to type to.
            _ => self.typing.set(b""),
        }
    }

    /// Types all of `text`, and looks at what is shown meanwhile.
    pub(crate) fn type_all(&self, host: &Mail<'_>, text: &'static [u8]) {
        self.typing.set(text);
        for _ in 0..4 * text.len() {
            self.turn(host);
        }
    }

    /// Returns the output that has been shown since the last look, and that which can be shown now.
    pub(crate) fn look(&self, host: &Mail<'_>) -> Text<256> {
        for _ in 0..8 {
            self.turn(host);
        }
        let mut seen = Text::new();
        if let Ok(mut shown) = self.shown.try_borrow_mut() {
            seen.push(shown.bytes());
            shown.clear();
        }
        seen
    }
}
