//! Who has which number in a system that `condor` brings up.

use core::ops::RangeInclusive;

use condor_mbox::Processor;

/// How many numbers a system has.
pub const PROCESSORS: usize = 16;

/// The numbers that a system description gives to its processors.
pub const PROGRAMS: RangeInclusive<u8> = 0..=7;
/// The file service.
pub const FILES: Processor = Processor(8);
/// The terminals.
pub const TERMINALS: Processor = Processor(9);
/// Who starts, watches and stops all others.
pub const SUPERVISOR: Processor = Processor(10);
/// Who serves a machine of harts; a visitor's number where there is none.
pub const MACHINE: Processor = Processor(15);
/// User interfaces, commands and other programs that come and go.
pub const VISITORS: RangeInclusive<u8> = 11..=15;
