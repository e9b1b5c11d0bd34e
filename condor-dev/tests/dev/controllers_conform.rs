//! The controllers of this crate pass the suite that one of one's own would run; for the PLIC see
//! `plic.rs`.
#![cfg(all(feature = "sim", feature = "conformance"))]

use condor_dev::conformance::interrupt_controller;
use condor_dev::sim::Controller;
use condor_dev::{InterruptController, InterruptLevel, InterruptVector};

#[test]
fn simulated() {
    let controller = Controller::new();
    let lines = [InterruptVector(64), InterruptVector(7)];
    let set = |vector, raised| controller.set(vector, raised);
    interrupt_controller(&controller, lines, InterruptVector(8), set).unwrap();
}

/// A controller with one fault.
struct Faulty<'c> {
    controller: &'c Controller,
    fault: Fault,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Fault {
    EnableIgnoresLevelZero,
    LevelsAreIgnored,
    DisableDoesNothing,
    CompleteDoesNothing,
    CompleteNeedsEnabled,
    UnknownCompletesAll,
}

impl InterruptController for Faulty<'_> {
    fn enable(&self, vector: InterruptVector, level: InterruptLevel) {
        let level = match self.fault {
            Fault::EnableIgnoresLevelZero => InterruptLevel(level.0.max(1)),
            Fault::LevelsAreIgnored => InterruptLevel(level.0.min(1)),
            _ => level,
        };
        self.controller.enable(vector, level);
    }

    fn disable(&self, vector: InterruptVector) {
        if self.fault != Fault::DisableDoesNothing {
            self.controller.disable(vector);
        }
    }

    fn claim(&self) -> Option<InterruptVector> {
        self.controller.claim()
    }

    fn complete(&self, vector: InterruptVector) {
        match self.fault {
            Fault::CompleteDoesNothing => {}
            Fault::CompleteNeedsEnabled if !self.controller.is_enabled(vector) => {}
            Fault::UnknownCompletesAll if vector == InterruptVector(8) => {
                self.controller.complete(InterruptVector(7));
                self.controller.complete(InterruptVector(64));
            }
            _ => self.controller.complete(vector),
        }
    }
}

#[test]
fn every_fault_is_found() {
    for fault in [
        Fault::EnableIgnoresLevelZero,
        Fault::LevelsAreIgnored,
        Fault::DisableDoesNothing,
        Fault::CompleteDoesNothing,
        Fault::CompleteNeedsEnabled,
        Fault::UnknownCompletesAll,
    ] {
        let controller = &Controller::new();
        let faulty = Faulty { controller, fault };
        let lines = [InterruptVector(64), InterruptVector(7)];
        let set = |vector, raised| controller.set(vector, raised);
        let verdict = interrupt_controller(&faulty, lines, InterruptVector(8), set);
        assert!(verdict.is_err(), "{fault:?}");
    }
}
