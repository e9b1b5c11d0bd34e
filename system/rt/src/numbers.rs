//! The numbers of the processors, services and visitors of a system that `condor` brings up, and
//! the vectors that Condor uses.

use core::ops::RangeInclusive;

use condor_mbox::{Processor, Vector};
use condor_tty::TerminalVectors;

/// The number of processor numbers in a system: programs, services and visitors together.
pub const PROCESSORS: usize = 32;

/// The numbers that a system description may give to processors.
pub const PROGRAMS: RangeInclusive<u8> = 0..=11;
/// The numbers of services of the host.
pub const SERVICES: RangeInclusive<u8> = 12..=19;
/// The number of the supervisor, which starts, watches and stops all programs and services.
pub const SUPERVISOR: Processor = Processor(12);
/// The number of the file service.
pub const FILES: Processor = Processor(13);
/// The number of the terminal service.
pub const TERMINALS: Processor = Processor(14);
/// The numbers of services that an application adds, in the order in which it adds them.
pub const EXTENSIONS: RangeInclusive<u8> = 15..=*SERVICES.end();
/// The numbers of visitors: user interfaces, commands and other programs that come and go.
pub const VISITORS: RangeInclusive<u8> = 20..=31;

/// The exit status of a program that would fail again in the same way: its arguments or its
/// description must be mended first. It is that of wrong arguments elsewhere, too. A supervisor does not
/// start such a program again by itself.
pub const MISTAKE: u8 = 2;

/// The vectors that a program may use for its own messages. Libraries for robots use those from 32
/// on.
pub const OWN_VECTORS: RangeInclusive<u8> = 0..=39;
/// The vector of [requests to the supervisor](crate::supervisor).
pub const REQUESTS: Vector = Vector(43);
/// All vectors that Condor uses, each with its purpose.
pub const VECTORS: [(Vector, &str); 7] = [
    (condor_fs::wire::FILES, "requests to the file service"),
    (
        condor_fs::wire::OPEN_FILES,
        "the files that a client has open",
    ),
    (condor_vars::VARS, "variables and parameters"),
    (REQUESTS, "requests to the supervisor"),
    (TerminalVectors::DEFAULT.output, "output of terminals"),
    (TerminalVectors::DEFAULT.input, "input of terminals"),
    (
        TerminalVectors::DEFAULT.room,
        "room for the output of terminals",
    ),
];

const _: () = {
    let mut used = 0_u64;
    let mut rest: &[(Vector, &str)] = &VECTORS;
    while let [(vector, _), others @ ..] = rest {
        assert!(vector.0 > *OWN_VECTORS.end(), "a vector of programs");
        assert!(used & 1 << vector.0 == 0, "a vector for two protocols");
        used |= 1 << vector.0;
        rest = others;
    }
};

/// Returns what Condor uses a vector for; `None` if programs may use it.
pub(crate) fn reserved(vector: Vector) -> Option<&'static str> {
    if OWN_VECTORS.contains(&vector.0) {
        return None;
    }
    let mut known = VECTORS.iter();
    let known = known.find(|(it, _)| *it == vector);
    Some(known.map_or("protocols of later versions", |(_, what)| what))
}
