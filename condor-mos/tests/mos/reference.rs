//! Random programs on the real scheduler and on a naive one: the same happens at the same ticks.
//!
//! Both write down every beginning and end of a loop and every action, with the counts of all loops
//! at that moment; nesting is strict, so the order of the entries tells who interrupted whom.

mod log;
mod machine;
mod model;
mod program;

use condor_mos::sim::SimPlatform;
use condor_mos::{ClockSpec, CounterReading, EventTable, Scan, Wrapping};
use proptest::prelude::*;

use machine::{Machine, Reading};
use model::{Kind, Model};
use program::{LOOPS, Program, program};

/// Room for the hyperperiods of all sets of rates, with what bridges them on 16 bits.
type Table = EventTable<LOOPS, 4096>;

fn check<I: Reading>(program: &Program) {
    let clock = ClockSpec::of::<I>(program.frequency);
    let known = |log| log::known(log, <I as CounterReading>::BITS, &program.overruns);
    let gap = u64::from(clock.longest_gap());
    let processor = || SimPlatform::new(program.frequency);
    let scan = Scan::<LOOPS>::try_new(&program.rates, clock).expect("slow rates");
    same(
        &known(Model::new(program, Kind::Scan, gap).run()),
        &known(Machine::<I, _>::run(program, processor(), scan)),
    );
    let table = Table::try_new(&program.rates, clock).expect("it fits");
    same(
        &known(Model::new(program, Kind::Table, gap).run()),
        &known(Machine::<I, _>::run(program, processor(), table)),
    );
}

/// Fails at the first entry that differs.
fn same(expected: &[log::Entry], found: &[log::Entry]) {
    for (at, (expected, found)) in expected.iter().zip(found).enumerate() {
        assert_eq!(expected, found, "entry {at}");
    }
    assert_eq!(expected.len(), found.len());
}

proptest! {
    #[test]
    fn a_counter_of_64_bits(program in program()) {
        check::<u64>(&program);
    }

    #[test]
    fn a_counter_of_32_bits(program in program()) {
        check::<Wrapping<32>>(&program);
    }

    #[test]
    fn a_counter_of_24_bits(program in program()) {
        check::<Wrapping<24>>(&program);
    }

    #[test]
    fn a_counter_of_16_bits(program in program()) {
        check::<Wrapping<16>>(&program);
    }
}
