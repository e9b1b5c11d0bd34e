//! [`Station`]: a terminal's processor and its host, both in this thread.

use std::time::Duration;

use condor_mbox::linux::{Claim, LinuxMailbox, LinuxSystem, LinuxWindow};
use condor_mbox::{Messenger, Processor, Region, SingleContext};
use condor_tty::linux::{Sink, TerminalHost};
use condor_tty::{Policy, Terminal, TerminalSettings, TerminalVectors};

use crate::Result;

const HOST: Processor = Processor(0);
const HAND: Processor = Processor(1);

/// Bytes of a ring.
pub(super) const RING: u32 = 256 << 10;

/// The longest wait for the host; after it the processor fails.
const PATIENCE: Duration = Duration::from_secs(1);

type Mail = LinuxMailbox<'static, 2, SingleContext>;
type Tty = Terminal<LinuxWindow, SingleContext, 64>;

/// A processor with a terminal, and a host that has it.
pub(super) struct Station<S> {
    processor: Mail,
    terminal: Tty,
    mailbox: Mail,
    host: TerminalHost<LinuxWindow>,
    pub(super) sink: S,
}

impl<S: Sink> Station<S> {
    /// Makes a terminal whose output, as it is, goes to `sink`.
    pub(super) fn new(sink: S) -> Result<Self> {
        let system = LinuxSystem::<2>::family(RING + 4096)?;
        let join = |claim: Claim<2>| -> Result<(Mail, Region<LinuxWindow>)> {
            let ram = Region::users(claim.windows()[HAND.index()].data.clone())?;
            let mut mailbox = claim.mailbox_with(SingleContext::new())?;
            if mailbox.number() == HOST {
                mailbox.set_vector(TerminalVectors::DEFAULT.output, &|_| 0, "terminal output")?;
            }
            mailbox.join()?;
            Ok((mailbox, ram))
        };
        let (mailbox, seen) = join(system.claim(HOST)?)?;
        let mut claim = system.claim(HAND)?;
        let mut places = claim.places()?;
        let (processor, ram) = join(claim)?;
        let terminal = Tty::new(ram, &mut places, RING, SingleContext::new())?;
        terminal.configure(&TerminalSettings::RAW)?;
        terminal.set_policy(Policy::Block { timeout: PATIENCE })?;
        let host = TerminalHost::attach(seen, terminal.offset(), HAND, HOST)?;
        Ok(Self {
            processor,
            terminal,
            mailbox,
            host,
            sink,
        })
    }

    /// Has the processor write a block: into the ring, and a message to the host.
    #[inline]
    pub(super) fn write(&self, block: &[u8]) -> Result<()> {
        let written = self.terminal.poster(&self.processor).post(block)?;
        if written == block.len() {
            Ok(())
        } else {
            Err(format!("{written} bytes of {} were written", block.len()).into())
        }
    }

    /// Has the host take the message, and move all bytes that it can; returns their number.
    #[inline]
    pub(super) fn serve(&mut self) -> Result<usize> {
        self.mailbox.serve(Duration::ZERO)?;
        Ok(self.host.serve(&self.mailbox, &mut self.sink)?.output)
    }
}
