//! A/D boards that convert by their timers and share a vector.
#![cfg(feature = "sim")]

use condor_dev::sim::{Controller, SimBus};
use condor_dev::{InterruptVector, Location, OpenMode, Switch, device_switch};
use utah_mit_boards::sim::AdcModel;
use utah_mit_boards::{Adc16, ConversionTrigger};

const VECTOR: InterruptVector = InterruptVector(128);
const SECOND: usize = 0x100;

device_switch! {
    struct Boards {
        adc: Adc16 = [
            Location::at(0).interrupting(128, 2),
            Location::at(SECOND).interrupting(128, 2),
        ],
    }
}

#[test]
fn an_interrupt_takes_the_channels_and_a_scan_returns_the_latest() {
    let (bus, controller) = (SimBus::new(), Controller::new());
    let models = [0, SECOND].map(|base| bus.insert(base, AdcModel::default()));
    for model in &models {
        controller.connect(VECTOR, model.clone());
    }
    let convert = |board: usize, value: i16| {
        let mut model = models[board].lock().unwrap();
        model.channels = [value; Adc16::CHANNELS];
        model.tick();
    };
    let switch = Switch::<_, _, _, 2>::new(bus.clone(), controller, Boards::new());
    switch.start();
    let open = |board| {
        switch
            .open_typed(Boards::adc, board, OpenMode::READ)
            .unwrap()
    };
    let boards = [open(0), open(1)];
    let scan = |board: usize| {
        let mut values = [0; 3];
        let device = &boards[board];
        assert_eq!(device.scan(device.registers, &mut values).unwrap(), 3);
        assert_eq!(values, [values[0]; 3]);
        values[0]
    };
    for board in &boards {
        board.set_timer(board.registers, 400, 100).unwrap();
    }
    // Before the first conversion, the channels are those of the board.
    assert_eq!([scan(0), scan(1)], [0, 0]);

    convert(0, 10);
    convert(1, -11);
    switch.on_interrupt();
    assert_eq!([scan(0), scan(1)], [10, -11]);
    // Taken from memory: of the board, the scan reads the number of conversions alone.
    bus.fail_after(1);
    assert_eq!(scan(0), 10);
    // The next access is the one that fails.
    assert!(boards[0].is_ready(boards[0].registers).is_err());

    // A conversion whose interrupt has not come yet.
    convert(1, 12);
    assert_eq!([scan(0), scan(1)], [10, 12]);
    switch.on_interrupt();
    assert_eq!([scan(0), scan(1)], [10, 12]);
    for value in 0..5 {
        convert(0, value);
        switch.on_interrupt();
        assert_eq!(scan(0), value);
    }
    // Several conversions, one interrupt.
    for value in 20..23 {
        convert(0, value);
    }
    switch.on_interrupt();
    assert_eq!(scan(0), 22);
    let counts = switch.interrupt_counts();
    assert_eq!(
        (counts.unclaimed, counts.unhandled, counts.stuck),
        (0, 0, 0)
    );

    // Without the timer it does not interrupt.
    let served = counts.served;
    let device = &boards[0];
    device
        .set_trigger(device.registers, ConversionTrigger::Continuous)
        .unwrap();
    convert(0, 30);
    switch.on_interrupt();
    assert_eq!(switch.interrupt_counts().served, served);
    assert_eq!(scan(0), 30);
}
