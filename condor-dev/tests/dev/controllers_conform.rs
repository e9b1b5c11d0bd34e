//! The controllers of this crate pass the suite that one of one's own would run; for the PLIC see
//! `plic.rs`.
#![cfg(all(feature = "sim", feature = "conformance"))]

use condor_dev::conformance::interrupt_controller;
use condor_dev::sim::Controller;
use condor_dev::{InterruptController, Level, Vector};

#[test]
fn simulated() {
    let controller = Controller::new();
    let lines = [Vector(64), Vector(7)];
    let set = |vector, raised| controller.set(vector, raised);
    interrupt_controller(&controller, lines, Vector(8), set).unwrap();
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
    fn enable(&self, vector: Vector, level: Level) {
        let level = match self.fault {
            Fault::EnableIgnoresLevelZero => Level(level.0.max(1)),
            Fault::LevelsAreIgnored => Level(level.0.min(1)),
            _ => level,
        };
        self.controller.enable(vector, level);
    }

    fn disable(&self, vector: Vector) {
        if self.fault != Fault::DisableDoesNothing {
            self.controller.disable(vector);
        }
    }

    fn claim(&self) -> Option<Vector> {
        self.controller.claim()
    }

    fn complete(&self, vector: Vector) {
        match self.fault {
            Fault::CompleteDoesNothing => {}
            Fault::CompleteNeedsEnabled if !self.controller.is_enabled(vector) => {}
            Fault::UnknownCompletesAll if vector == Vector(8) => {
                self.controller.complete(Vector(7));
                self.controller.complete(Vector(64));
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
        let lines = [Vector(64), Vector(7)];
        let set = |vector, raised| controller.set(vector, raised);
        let verdict = interrupt_controller(&faulty, lines, Vector(8), set);
        assert!(verdict.is_err(), "{fault:?}");
    }
}
