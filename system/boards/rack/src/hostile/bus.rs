//! [`HostileBus`] and [`HostileController`]: a machine whose faults come from bytes.

use std::cell::{Cell, RefCell};
use std::rc::Rc;

use condor_dev::BusAccessError;
use condor_dev::sim::{self};
use condor_dev::{Bus, BusErrorKind, InterruptController, InterruptLevel, InterruptVector, Width};

use super::boards::{ADCS, MPPS, UARTS};
use super::journal::Journal;

/// The greatest number of claims in one entry.
const CLAIMS: u32 = 40;

/// The bytes that are left, and a record of the events that the used ones caused.
pub(super) struct Script {
    bytes: RefCell<Vec<u8>>,
    /// True if registers return false values.
    pub(super) lies: Cell<bool>,
    /// True while the bus and the controller are hostile.
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

    /// Returns the next byte; `None` at the end.
    pub(super) fn next(&self) -> Option<u8> {
        self.bytes.borrow_mut().pop()
    }

    /// Returns the next byte; 0, which causes no fault, at the end.
    pub(super) fn byte(&self) -> u8 {
        self.next().unwrap_or_default()
    }
}

/// The simulated bus, with errors and false values in between.
pub(super) struct HostileBus {
    pub(super) inside: sim::SimBus,
    pub(super) script: Rc<Script>,
}

impl HostileBus {
    /// Decides the outcome of an access: an error, true for a true value, or false for a false one.
    fn fate(&self, address: usize) -> Result<bool, BusAccessError> {
        let script = &self.script;
        script.accesses.set(script.accesses.get() + 1);
        if !script.awake.get() {
            return Ok(true);
        }
        // Once the bytes have ended, accesses no longer fail; registers that return false values go on with
        // that.
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

/// The simulated controller, with claims that no board has requested.
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
            0x60..0xb0 => UARTS,
            0xb0..0xc0 => ADCS,
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
