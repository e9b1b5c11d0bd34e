//! The PLIC backend, on a model of the registers that its specification describes.
#![cfg(all(feature = "riscv", feature = "sim", feature = "conformance"))]

use std::sync::{Arc, Mutex};

use condor_dev::riscv::{Context, Plic};
use condor_dev::sim::{Model, SimBus};
use condor_dev::{InterruptController, InterruptLevel, InterruptVector, Width, conformance};

const BASE: usize = 0x0c00_0000;
const SOURCES: usize = 53;
const CONTEXTS: usize = 2;
const PRIORITY_MASK: u32 = 7;

/// Gateways, pending bits and contexts.
struct PlicModel {
    raised: [bool; SOURCES + 1],
    pending: [bool; SOURCES + 1],
    /// Between claim and completion a gateway forwards nothing.
    in_service: [bool; SOURCES + 1],
    priority: [u32; SOURCES + 1],
    enabled: [[u32; 32]; CONTEXTS],
    threshold: [u32; CONTEXTS],
}

impl PlicModel {
    fn new() -> Self {
        Self {
            raised: [false; SOURCES + 1],
            pending: [false; SOURCES + 1],
            in_service: [false; SOURCES + 1],
            priority: [0; SOURCES + 1],
            // What they hold before anybody has written them is not specified.
            enabled: [[u32::MAX; 32]; CONTEXTS],
            threshold: [PRIORITY_MASK; CONTEXTS],
        }
    }

    fn forward(&mut self) {
        for source in 1..=SOURCES {
            self.pending[source] |= self.raised[source] && !self.in_service[source];
        }
    }

    fn is_enabled(&self, context: usize, source: usize) -> bool {
        self.enabled[context][source / 32] >> (source % 32) & 1 == 1
    }

    fn claim(&mut self, context: usize) -> u32 {
        self.forward();
        let best = (1..=SOURCES)
            .filter(|&source| {
                self.pending[source]
                    && self.is_enabled(context, source)
                    && self.priority[source] > 0
            })
            .max_by_key(|&source| (self.priority[source], core::cmp::Reverse(source)));
        let Some(source) = best else { return 0 };
        self.pending[source] = false;
        self.in_service[source] = true;
        source as u32
    }

    /// "If the completion ID does not match an interrupt source that is currently enabled for the
    /// target, the completion is silently ignored."
    fn complete(&mut self, context: usize, source: usize) {
        if source <= SOURCES && self.is_enabled(context, source) {
            self.in_service[source] = false;
        }
    }

    fn notifies(&mut self, context: usize) -> bool {
        self.forward();
        (1..=SOURCES).any(|source| {
            self.pending[source]
                && self.is_enabled(context, source)
                && self.priority[source] > self.threshold[context]
        })
    }
}

impl Model for PlicModel {
    fn size(&self) -> usize {
        0x400_0000
    }

    fn read(&mut self, offset: usize, width: Width) -> Option<u32> {
        if width != Width::Bits32 {
            return None;
        }
        match offset {
            0..0x1000 => Some(*self.priority.get(offset / 4).unwrap_or(&0)),
            0x2000..0x20_0000 => {
                let context = self.enabled.get((offset - 0x2000) / 0x80);
                Some(context.map_or(0, |words| words[offset % 0x80 / 4]))
            }
            0x20_0000.. => {
                let context = (offset - 0x20_0000) / 0x1000;
                match (context < CONTEXTS, offset % 0x1000) {
                    (true, 0) => Some(self.threshold[context]),
                    (true, 4) => Some(self.claim(context)),
                    _ => Some(0),
                }
            }
            _ => Some(0),
        }
    }

    fn write(&mut self, offset: usize, width: Width, value: u32) -> Option<()> {
        if width != Width::Bits32 {
            return None;
        }
        match offset {
            4..0x1000 => {
                if let Some(priority) = self.priority.get_mut(offset / 4) {
                    *priority = value & PRIORITY_MASK;
                }
            }
            0x2000..0x20_0000 => {
                if let Some(words) = self.enabled.get_mut((offset - 0x2000) / 0x80) {
                    words[offset % 0x80 / 4] = value;
                }
            }
            0x20_0000.. => {
                let context = (offset - 0x20_0000) / 0x1000;
                match (context < CONTEXTS, offset % 0x1000) {
                    (true, 0) => self.threshold[context] = value & PRIORITY_MASK,
                    (true, 4) => self.complete(context, value as usize),
                    _ => {}
                }
            }
            _ => {}
        }
        Some(())
    }
}

fn plic(bus: &SimBus, context: usize) -> Plic<SimBus> {
    let context = Context::new(context as u16).unwrap();
    let plic = Plic::new(
        bus.clone(),
        BASE,
        context,
        SOURCES as u16,
        InterruptLevel(7),
    );
    plic.reset().unwrap();
    plic
}

fn machine() -> (SimBus, Arc<Mutex<PlicModel>>) {
    let bus = SimBus::new();
    let model = bus.insert(BASE, PlicModel::new());
    (bus, model)
}

#[test]
fn conforms_in_every_context() {
    let (bus, model) = machine();
    for plic in [plic(&bus, 0), plic(&bus, 1)] {
        let set = |InterruptVector(source), raised| {
            model.lock().unwrap().raised[usize::from(source)] = raised;
        };
        // The first and the last source, the words' borders, and what is no source.
        for lines in [[1, 53], [31, 32], [33, 2]] {
            for nobody in [0, 54, 1023, u16::MAX] {
                let lines = lines.map(InterruptVector);
                conformance::interrupt_controller(&plic, lines, InterruptVector(nobody), set)
                    .unwrap();
            }
        }
    }
}

#[test]
fn contexts_do_not_disturb_each_other() {
    let (bus, model) = machine();
    let (first, second) = (plic(&bus, 0), plic(&bus, 1));
    first.enable(InterruptVector(10), InterruptLevel(1));
    first.enable(InterruptVector(11), InterruptLevel(1));
    second.enable(InterruptVector(11), InterruptLevel(1));
    model.lock().unwrap().raised[10] = true;
    model.lock().unwrap().raised[11] = true;
    assert_eq!(second.claim(), Some(InterruptVector(11)));
    assert_eq!(second.claim(), None, "source 10 is not its own");
    assert_eq!(
        first.claim(),
        Some(InterruptVector(10)),
        "source 11 is taken"
    );
    assert_eq!(first.claim(), None);
    second.reset().unwrap();
    first.complete(InterruptVector(10));
    assert_eq!(first.claim(), Some(InterruptVector(10)));
}

#[test]
fn levels_are_priorities_as_far_as_there_are() {
    let (bus, model) = machine();
    let plic = plic(&bus, 0);
    plic.enable(InterruptVector(3), InterruptLevel(200));
    model.lock().unwrap().raised[3] = true;
    assert_eq!(model.lock().unwrap().priority[3], 7);
    assert!(model.lock().unwrap().notifies(0));
    plic.set_threshold(InterruptLevel(6)).unwrap();
    assert!(model.lock().unwrap().notifies(0));
    plic.set_threshold(InterruptLevel(200)).unwrap();
    assert!(!model.lock().unwrap().notifies(0));
}

#[test]
fn one_that_does_not_answer_has_no_interrupts() {
    let context = Context::new(0).unwrap();
    let plic = Plic::new(SimBus::new(), BASE, context, 53, InterruptLevel(7));
    assert!(plic.reset().is_err());
    plic.enable(InterruptVector(1), InterruptLevel(1));
    assert_eq!(plic.claim(), None);
    plic.complete(InterruptVector(1));
}

#[test]
fn what_the_specification_does_not_know_is_refused() {
    assert!(Context::new(15_871).is_some());
    assert_eq!(Context::new(15_872), None);
    let (bus, model) = machine();
    let plic = Plic::new(
        bus,
        BASE,
        Context::new(0).unwrap(),
        u16::MAX,
        InterruptLevel(7),
    );
    plic.reset().unwrap();
    model.lock().unwrap().enabled[1] = [0; 32];
    plic.enable(InterruptVector(1023), InterruptLevel(1));
    plic.enable(InterruptVector(1024), InterruptLevel(1));
    let enabled = model.lock().unwrap().enabled;
    let mut expected = [[0; 32]; CONTEXTS];
    expected[0][31] = 1 << 31;
    assert_eq!(enabled, expected);
}
