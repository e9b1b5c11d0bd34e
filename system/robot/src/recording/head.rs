//! [`Head`]: what comes before the messages of a recording.

use core::fmt::Write as _;

use condor_mcap::{McapWriter, NamePairs};
use embedded_io::Write;

use super::{ServoRecordingError, channel};
use crate::{ACTUATORS, FINGERS, JOINTS};

/// The name of the metadata.
pub(super) const METADATA: &str = "condor-servo";
const VERSION: u32 = 7;

const NAMES: [&str; 6] = [
    "version",
    "processor",
    "rate_hz",
    "fingers",
    "joints",
    "actuators",
];

/// The metadata before the messages of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Head {
    pub(crate) processor: u32,
    pub(crate) rate_hz: u32,
}

impl Head {
    /// The numbers, in the order of [`NAMES`].
    const fn numbers(self) -> [u32; NAMES.len()] {
        let Self { processor, rate_hz } = self;
        let (fingers, joints, actuators) = (FINGERS as u32, JOINTS as u32, ACTUATORS as u32);
        [VERSION, processor, rate_hz, fingers, joints, actuators]
    }

    /// Begins a file.
    pub(super) fn write<W: Write>(self, to: W) -> Result<McapWriter<W>, W::Error> {
        let mut writer = McapWriter::new(to, "", concat!("condor ", env!("CARGO_PKG_VERSION")))?;
        let texts = self.numbers().map(|number| {
            let mut text = heapless::String::<10>::new();
            // There is room for any number.
            let _ = write!(text, "{number}");
            text
        });
        let mut pairs = [("", ""); NAMES.len()];
        for (pair, (name, text)) in pairs.iter_mut().zip(NAMES.into_iter().zip(&texts)) {
            *pair = (name, text);
        }
        writer.metadata(METADATA, &pairs)?;
        for (number, (topic, name, fields)) in (1..).zip(channel::ALL) {
            writer.schema(number, name, "ros2msg", fields.as_bytes())?;
            writer.channel(number, number, topic, "cdr", &[])?;
        }
        Ok(writer)
    }

    /// Reads the metadata of a file.
    ///
    /// # Errors
    /// [`ServoRecordingError::Head`] with the first number that is not that of this version.
    pub(super) fn read(pairs: Option<NamePairs<'_>>) -> Result<Self, ServoRecordingError> {
        let number = |name| pairs.and_then(|pairs| pairs.get(name)?.parse().ok());
        let found = NAMES.map(number);
        let [_, processor, rate_hz, ..] = found;
        let head = Self {
            processor: processor.unwrap_or(0),
            rate_hz: rate_hz.unwrap_or(0),
        };
        let all = NAMES.into_iter().zip(found).zip(head.numbers());
        let mut wrong = all.filter(|((_, found), wanted)| *found != Some(*wanted));
        match wrong.next() {
            Some(((name, found), wanted)) => Err(ServoRecordingError::Head {
                name,
                found,
                wanted,
            }),
            None => Ok(head),
        }
    }
}
