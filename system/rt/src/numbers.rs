//! The numbers of the processors, services and visitors of a system that `condor` brings up, and
//! the vectors that Condor uses.

use core::ops::RangeInclusive;

use condor_mbox::{Processor, Vector};
use condor_tty::TerminalVectors;

/// The number of processor numbers that a system has. Programs, services of the host and visitors
/// each take one of them.
pub const PROCESSORS: usize = 32;

/// The processor numbers that a system description may assign to programs. The description is the file
/// that lists the processors of a system.
pub const PROGRAMS: RangeInclusive<u8> = 0..=11;
/// The processor numbers of services of the host, such as the file service.
pub const SERVICES: RangeInclusive<u8> = 12..=19;
/// The processor number of the supervisor, the service that starts, watches and stops all programs
/// and services.
pub const SUPERVISOR: Processor = Processor(12);
/// The processor number of the file service, through which programs open files of the host.
pub const FILES: Processor = Processor(13);
/// The processor number of the terminal service, which shows the terminals of programs on the host.
pub const TERMINALS: Processor = Processor(14);
/// The processor numbers of services that an application adds. The service that is added first has
/// the first of these numbers, and so on.
pub const EXTENSIONS: RangeInclusive<u8> = 15..=*SERVICES.end();
/// The processor numbers of visitors: user interfaces, commands and other programs that come and go
/// while the system runs.
pub const VISITORS: RangeInclusive<u8> = 20..=31;

/// The exit status of a program that would fail again in the same way after a restart, because its arguments or its
/// description are wrong. A supervisor does not restart such a program by itself. Many command-line programs end with
/// this status, too, if their arguments are wrong.
pub const MISTAKE: u8 = 2;

/// The vectors that a program may use for its own messages. Those from 32 on are used by libraries
/// for robots, such as condor-hand.
pub const OWN_VECTORS: RangeInclusive<u8> = 0..=39;
/// The vector of messages with which programs send [requests to the supervisor](crate::supervisor).
pub const REQUESTS: Vector = Vector(43);
/// All vectors that Condor itself uses, each with a short text for people that says what it is used
/// for.
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
