//! [`HostileBus`] and [`HostileController`]: what the bytes make of a machine.

use std::cell::{Cell, RefCell};
use std::rc::Rc;

use condor_dev::BusAccessError;
use condor_dev::sim::{self};
use condor_dev::{Bus, BusErrorKind, InterruptController, InterruptLevel, InterruptVector, Width};

use super::boards::{MPPS, UARTS};
use super::journal::Journal;

/// Claims of one entry.
const CLAIMS: u32 = 40;

/// The bytes that are left, and what became of those that were used.
pub(super) struct Script {
    bytes: RefCell<Vec<u8>>,
    /// Whether registers lie.
    pub(super) lies: Cell<bool>,
    /// Whether anything is hostile at all, at the moment.
    pub(super) awake: Cell<bool>,
    pub(super) accesses: Cell<u64>,
    pub(super) hostile: Cell<u64>,
    pub(super) journal: RefCell<Journal>,
    claims: Cell<u32>,
}

impl Script {
    pub(super) fn new(bytes: &[u8]) -> Rc<Self> {
        Rc::new(Self {
            bytes: RefCell::new(bytes.iter().rev().copied().collect()),
            lies: Cell::new(false),
            awake: Cell::new(false),
            accesses: Cell::new(0),
            hostile: Cell::new(0),
            journal: RefCell::default(),
            claims: Cell::new(0),
        })
    }

    /// The next byte; `None` at the end.
    pub(super) fn next(&self) -> Option<u8> {
        self.bytes.borrow_mut().pop()
    }

    /// The next byte, or one that says nothing.
    pub(super) fn byte(&self) -> u8 {
        self.next().unwrap_or_default()
    }
}

/// The simulated bus, with errors and lies in between.
pub(super) struct HostileBus {
    pub(super) inside: sim::SimBus,
    pub(super) script: Rc<Script>,
}

impl HostileBus {
    /// What becomes of an access: an error, or whether it is true.
    fn fate(&self, address: usize) -> Result<bool, BusAccessError> {
        let script = &self.script;
        script.accesses.set(script.accesses.get() + 1);
        if !script.awake.get() {
            return Ok(true);
        }
        // Once the bytes have ended, all is as it should be with true registers, and what lies goes on.
        let fails = script.byte() >= 0xf0;
        if fails || script.lies.get() {
            script.hostile.set(script.hostile.get() + 1);
        }
        if fails {
            return Err(BusAccessError {
                address,
                kind: BusErrorKind::NoAnswer,
            });
        }
        Ok(!script.lies.get())
    }
}

impl Bus for HostileBus {
    type Error = BusAccessError;

    fn read(&self, address: usize, width: Width) -> Result<u32, BusAccessError> {
        let is_true = self.fate(address)?;
        let mut value = self.inside.read(address, width)?;
        if !is_true {
            let lie = self.script.next().map(|byte| u32::from_ne_bytes([byte; 4]));
            value = lie.unwrap_or(u32::MAX) & width.mask();
        }
        self.script.journal.borrow_mut().was_read(address, value);
        Ok(value)
    }

    fn write(&self, address: usize, width: Width, value: u32) -> Result<(), BusAccessError> {
        self.fate(address)?;
        self.inside.write(address, width, value)?;
        self.script.journal.borrow_mut().was_written(address, value);
        Ok(())
    }
}

/// The simulated controller, or claims that nobody asked for.
pub(super) struct HostileController {
    pub(super) inside: sim::Controller,
    pub(super) script: Rc<Script>,
}

impl InterruptController for HostileController {
    fn enable(&self, vector: InterruptVector, level: InterruptLevel) {
        self.inside.enable(vector, level);
    }

    fn disable(&self, vector: InterruptVector) {
        self.inside.disable(vector);
    }

    fn claim(&self) -> Option<InterruptVector> {
        if !self.script.lies.get() || !self.script.awake.get() {
            return self.inside.claim();
        }
        let claims = &self.script.claims;
        let vector = match self.script.next()? {
            0..0x60 => MPPS,
            0x60..0xc0 => UARTS,
            0xc0..0xd0 => InterruptVector(7),
            _ => return None,
        };
        claims.set(claims.get() + 1);
        (!claims.get().is_multiple_of(CLAIMS)).then_some(vector)
    }

    fn complete(&self, vector: InterruptVector) {
        self.inside.complete(vector);
    }
}
