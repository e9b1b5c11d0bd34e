//! What host and harts say to each other in the memory of a machine.

use condor_mbox::{MemoryWindow, Region, StaticMemory};
use proptest::prelude::*;
use qemu_virt_host::{
    ARGUMENT_BYTES, Control, ERROR_BYTES, HartFault, HartState, Map, MemoryMapError, StartOrder,
    map,
};

const MEMORY: u32 = 16 << 20;

fn memory() -> Region<impl MemoryWindow + Clone + std::fmt::Debug> {
    let words: &'static StaticMemory<{ MEMORY as usize / 4 }> = fresh();
    Region::whole(words.window())
}

/// Zeroed memory that lasts.
fn fresh() -> &'static StaticMemory<{ MEMORY as usize / 4 }> {
    static MEMORIES: [StaticMemory<{ MEMORY as usize / 4 }>; 8] =
        [const { StaticMemory::new() }; 8];
    static NEXT: std::sync::atomic::AtomicUsize = std::sync::atomic::AtomicUsize::new(0);
    &MEMORIES[NEXT.fetch_add(1, std::sync::atomic::Ordering::Relaxed)]
}

#[test]
fn what_the_host_lays_out_the_harts_find() {
    let memory = memory();
    let map = Map::new(MEMORY, &[1, 2, 3, 0], 65536, 16384, 8192).unwrap();
    assert!(matches!(
        Map::read(&memory),
        Err(MemoryMapError::NoMap { found: 0 })
    ));
    map.write(&memory).unwrap();
    assert_eq!(Map::read(&memory).unwrap(), map);
    assert_eq!(map.hart_of(3), Some(2));
    assert_eq!(map.hart_of(4), None);
    assert!(map.stack_end(3) <= MEMORY);
}

#[test]
fn nothing_overlaps() {
    let map = Map::new(MEMORY, &[0, 1, 2, 3], 65000, 100, 5000).unwrap();
    let mut ends = vec![(0, map::AT), (map::AT, map::PAGE)];
    ends.extend((0..4).map(|hart| (Map::control(hart), map::PAGE)));
    ends.extend((0..16).map(|number| (map.mail.at(number), Map::mail_bytes())));
    ends.extend((0..16).map(|number| (map.data.at(number), map.data_bytes)));
    ends.push((map.bus, map.bus_bytes));
    ends.push((map.shared, map.shared_bytes));
    ends.push((map.clock, map::CLOCK_BYTES));
    ends.extend((0..4).map(|hart| (map.programs.at(hart), map.programs.stride)));
    for pair in ends.windows(2) {
        assert!(pair[0].0 + pair[0].1 <= pair[1].0, "{pair:x?}");
    }
    let (last, bytes) = ends[ends.len() - 1];
    assert!(last + bytes <= MEMORY);
}

#[test]
fn what_cannot_be_laid_out_is_said() {
    assert_eq!(
        Map::new(MEMORY, &[], 65536, 0, 0),
        Err(MemoryMapError::Harts { found: 0 })
    );
    assert_eq!(
        Map::new(MEMORY, &[0; 13], 65536, 0, 0),
        Err(MemoryMapError::Harts { found: 13 })
    );
    assert_eq!(
        Map::new(MEMORY, &[0, 32], 65536, 0, 0),
        Err(MemoryMapError::Number {
            hart: 1,
            number: 32
        })
    );
    assert_eq!(
        Map::new(MEMORY, &[3, 3], 65536, 0, 0),
        Err(MemoryMapError::Number { hart: 1, number: 3 })
    );
    assert!(matches!(
        Map::new(MEMORY, &[0], 1 << 20, 0, 0),
        Err(MemoryMapError::TooSmall { found: MEMORY, needed }) if needed > u64::from(MEMORY)
    ));
    assert!(Map::new(u32::MAX, &[0], u32::MAX, u32::MAX, 0).is_err());
}

#[test]
fn a_program_is_started_asked_and_abandoned() {
    let memory = memory();
    let (host, hart) = (
        Control::new(&memory, 1).unwrap(),
        Control::new(&memory, 1).unwrap(),
    );
    assert_eq!(host.state(), Ok(HartState::Off));
    hart.wait().unwrap();
    assert_eq!(host.state(), Ok(HartState::Waits));
    assert_eq!(hart.wanted(), Ok(None));
    let order = StartOrder {
        entry: 0x20_0000,
        arguments: b"servo\0a\0",
        simulated: Some([u64::MAX, 1, 2, 3, 4, 5, 6, 7]),
        float_exceptions: true,
    };
    assert_eq!(host.order(order), Ok(1));
    assert_eq!(hart.wanted(), Ok(Some((1, 0x20_0000))));
    hart.begin(1).unwrap();
    assert_eq!(hart.wanted(), Ok(None));
    let mut arguments = [0; ARGUMENT_BYTES];
    let len = hart.arguments(&mut arguments).unwrap();
    assert_eq!(&arguments[..len], b"servo\0a\0");
    assert_eq!(hart.simulated(), Ok(order.simulated));
    assert_eq!(host.state(), Ok(HartState::Runs { start: 1 }));
    assert_eq!(hart.is_asked_to_end(), Ok(false));
    host.ask_to_end(1).unwrap();
    assert_eq!(hart.is_asked_to_end(), Ok(true));
    hart.set_error("no servo").unwrap();
    hart.end(7).unwrap();
    let ended = HartState::Ended {
        start: 1,
        status: 7,
    };
    assert_eq!(host.state(), Ok(ended));
    hart.wait().unwrap();
    assert_eq!(host.state(), Ok(ended), "how it ended stays");
    let mut error = [0; ERROR_BYTES];
    let len = host.error(&mut error).unwrap();
    assert_eq!(&error[..len], b"no servo");
    assert_eq!(host.order(order), Ok(2));
    hart.begin(2).unwrap();
    assert_eq!(hart.is_asked_to_end(), Ok(false), "the former one was");
    assert_eq!(host.error(&mut error), Ok(0), "that of the former one");
    assert_eq!(hart.is_abandoned(), Ok(false));
    host.abandon(2).unwrap();
    assert_eq!(hart.is_abandoned(), Ok(true));
    hart.leave().unwrap();
    assert_eq!(host.state(), Ok(HartState::Abandoned { start: 2 }));
    let mut fault = HartFault {
        cause: 2,
        pc: 0x8000_1234_5678_9abc,
        value: u64::MAX,
        status: 1 << 63,
        registers: [0; 31],
    };
    fault.registers[30] = 31;
    hart.set_fault(&fault).unwrap();
    hart.fail().unwrap();
    assert_eq!(host.state(), Ok(HartState::Faulted { start: 2 }));
    assert_eq!(host.fault(), Ok(fault));
}

#[test]
fn texts_that_are_too_long_are_cut_off() {
    let memory = memory();
    let control = Control::new(&memory, 0).unwrap();
    let order = StartOrder {
        entry: 0,
        arguments: &[b'a'; ARGUMENT_BYTES + 3],
        simulated: None,
        float_exceptions: false,
    };
    control.order(order).unwrap();
    let mut arguments = [0; ARGUMENT_BYTES];
    assert_eq!(control.arguments(&mut arguments), Ok(ARGUMENT_BYTES));
    assert_eq!(control.simulated(), Ok(None));
    control.set_error(&"a".repeat(ERROR_BYTES + 3)).unwrap();
    let mut error = [0; ERROR_BYTES];
    assert_eq!(control.error(&mut error), Ok(ERROR_BYTES));
    assert_eq!(error, [b'a'; ERROR_BYTES]);
    assert_eq!(
        control.fault(),
        Ok(HartFault::default()),
        "nothing else is hurt"
    );
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    /// Whatever lies there: no panic, and what is believed is inside.
    #[test]
    fn a_map_of_noise_leads_nowhere(words in prop::collection::vec(0u32..0x200_0000, 21), right in 0usize..21) {
        thread_local! {
            static NOISE: &'static StaticMemory<{ MEMORY as usize / 4 }> = fresh();
        }
        let memory = Region::whole(NOISE.with(|memory| memory.window()));
        Map::new(MEMORY, &[1, 2, 3, 0], 65536, 16384, 0).unwrap().write(&memory).unwrap();
        for (at, word) in (0u32..).zip(words).skip(2 + right) {
            memory.set_word(map::AT + 4 * at, word).unwrap();
        }
        if let Ok(map) = Map::read(&memory) {
            prop_assert!(map.stack_end(map.harts() - 1) <= map.memory_bytes);
            prop_assert!(map.data.at(15) + map.data_bytes <= map.memory_bytes);
        }
    }
}
