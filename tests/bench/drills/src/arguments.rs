//! Arguments of the form `name=value`.

use condor_mbox::Processor;
use condor_rt::{Machine, PROCESSORS, ProgramError};

/// Returns the value of an argument, if it is there.
fn value<'m, M: Machine>(machine: &'m M, name: &str) -> Option<&'m str> {
    (0..)
        .map_while(|index| machine.argument(index))
        .find_map(|argument| argument.strip_prefix(name)?.strip_prefix('='))
}

/// Returns true if an argument is there, without a value.
pub(crate) fn is_there<M: Machine>(machine: &M, name: &str) -> bool {
    (0..)
        .map_while(|index| machine.argument(index))
        .any(|argument| argument == name)
}

/// Returns the number that follows `name` in the arguments, or `usual` if there is none.
pub(crate) fn number<M: Machine>(machine: &M, name: &str, usual: u32) -> Result<u32, ProgramError> {
    let number = |text: &str| text.parse().map_err(|_| wrong("NAME=NUMBER"));
    value(machine, name).map_or(Ok(usual), number)
}

fn wrong(expected: &str) -> ProgramError {
    ProgramError::program(&format_args!("an argument is missing or wrong: {expected}"))
}

/// Processors, as in `name=0,1,5`, none of which is this one, in a set of bits.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Peers(u32);

impl Peers {
    pub(crate) fn of<M: Machine>(machine: &M, name: &str) -> Result<Self, ProgramError> {
        let wrong = || wrong("NAME=PROCESSOR,PROCESSOR,…");
        let mut bits = 0;
        // By bytes: the search for a character in a text keeps a path that panics.
        let words = value(machine, name).unwrap_or("").as_bytes();
        for word in words.split(|&byte| byte == b',') {
            if word.is_empty() {
                continue;
            }
            let number = str::from_utf8(word).ok().and_then(|word| word.parse().ok());
            let number = number.filter(|&number: &usize| number < PROCESSORS);
            bits |= 1 << number.ok_or_else(wrong)?;
        }
        Ok(Self(bits & !(1 << machine.number().0)))
    }

    pub(crate) fn iter(self) -> impl Iterator<Item = Processor> + Clone {
        (0..PROCESSORS as u8)
            .filter(move |number| self.0 & 1 << number != 0)
            .map(Processor)
    }

    pub(crate) fn nth(self, turn: u32) -> Option<Processor> {
        let count = self.0.count_ones();
        self.iter().nth(turn.checked_rem(count)? as usize)
    }
}
