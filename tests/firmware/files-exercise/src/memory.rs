//! [`Memory`]: what the two processors share.

use condor_mbox::{Processor, StaticMemory, StaticWindow, Windows, layout};

/// The processors of the system.
pub(crate) const PROCESSORS: usize = 2;
/// The processor that has the files, and looks at the terminals.
pub(crate) const HOST: Processor = Processor(0);
/// The processor that opens files, and has terminals.
pub(crate) const HAND: Processor = Processor(1);

/// The memory of a processor.
pub(crate) type Window = StaticWindow<'static>;

const MAIL_WORDS: usize = layout::mail_bytes(PROCESSORS as u32) as usize / 4;
const DATA_WORDS: usize = 3072 / 4;
/// The host's users have nothing in its `data`.
const HOST_DATA_WORDS: usize = layout::BELL_BYTES as usize / 4 + 16;

/// The windows of the two processors.
pub(crate) struct Memory {
    mail: [StaticMemory<MAIL_WORDS>; PROCESSORS],
    host: StaticMemory<HOST_DATA_WORDS>,
    hand: StaticMemory<DATA_WORDS>,
}

impl Memory {
    pub(crate) const fn new() -> Self {
        Self {
            mail: [const { StaticMemory::new() }; PROCESSORS],
            host: StaticMemory::new(),
            hand: StaticMemory::new(),
        }
    }

    pub(crate) fn windows(&self) -> [Windows<StaticWindow<'_>>; PROCESSORS] {
        let [host, hand] = &self.mail;
        [
            Windows {
                mail: host.window(),
                data: self.host.window(),
            },
            Windows {
                mail: hand.window(),
                data: self.hand.window(),
            },
        ]
    }
}
