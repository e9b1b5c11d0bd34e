//! Names, boards and descriptors, on simulated boards.

use condor_dev::drivers::Adc16;
use condor_dev::sim::{AdcModel, Bus, Controller};
use condor_dev::{
    FdError, InterruptCounts, IoError, Mode, OpenError, Place, Presence, Switch, Vector,
    device_switch,
};

device_switch! {
    /// Two boards of which one is there.
    struct Boards {
        adc: Adc16 = [
            Place::at(0x1000).interrupting(64, 3),
            Place::at(0x2000).interrupting(64, 3),
        ],
    }
}

fn started() -> (Bus, Controller, Switch<Bus, Controller, Boards, 2>) {
    let (bus, controller) = (Bus::new(), Controller::new());
    let mut model = AdcModel::default();
    model.channels[2] = -77;
    let board = bus.insert(0x1000, model);
    controller.connect(Vector(64), board);
    let switch = Switch::new(bus.clone(), controller.clone(), Boards::new());
    switch.start();
    (bus, controller, switch)
}

#[test]
fn start_up_finds_the_boards_that_are_there() {
    let (_, controller, switch) = started();
    assert_eq!(
        switch.inventory().to_string(),
        "device   board      address vector level  found\n\
         adc          0       0x1000     64     3  Present\n\
         adc          1       0x2000     64     3  Absent\n"
    );
    assert!(controller.is_enabled(Vector(64)));
    let absent = OpenError::NotPresent {
        name: "adc",
        board: 1,
        presence: Presence::Absent,
    };
    assert_eq!(switch.open("adc", 1, Mode::READ), Err(absent));
}

#[test]
fn a_board_is_read_by_descriptor_and_by_its_own_calls() {
    let (_, _, switch) = started();
    let fd = switch.open(":adc", 0, Mode::READ).unwrap();
    let mut bytes = [0; 6];
    assert_eq!(switch.read(fd, &mut bytes), Ok(6));
    assert_eq!(i16::from_ne_bytes([bytes[4], bytes[5]]), -77);
    let adc = switch.device::<Adc16>(fd).unwrap();
    let mut channels = [0; 16];
    assert_eq!(adc.scan(&mut channels), Ok(16));
    assert_eq!(channels[2], -77);
    assert_eq!(switch.close(fd), Err(IoError::Fd(FdError::InUse { fd })));
    drop(adc);
    assert_eq!(switch.close(fd), Ok(()));
    let closed = IoError::Fd(FdError::Closed { fd });
    assert_eq!(switch.read(fd, &mut bytes), Err(closed));
}

#[test]
fn what_cannot_be_opened_says_why() {
    let (_, _, switch) = started();
    let open = |name, board, mode| switch.open(name, board, mode);
    assert_eq!(
        open("dac", 0, Mode::READ),
        Err(OpenError::NoSuchDevice { name: "dac" })
    );
    assert_eq!(
        open("adc", 2, Mode::READ),
        Err(OpenError::NoSuchBoard {
            name: "adc",
            board: 2,
            boards: 2
        })
    );
    assert_eq!(
        open("adc", 0, Mode::WRITE),
        Err(OpenError::Direction {
            name: "adc",
            mode: Mode::WRITE
        })
    );
    let shared = open("adc", 0, Mode::READ).unwrap();
    let busy = OpenError::Busy {
        name: "adc",
        board: 0,
    };
    assert_eq!(open("adc", 0, Mode::READ | Mode::EXCLUSIVE), Err(busy));
    open("adc", 0, Mode::READ).unwrap();
    assert_eq!(
        open("adc", 0, Mode::READ),
        Err(OpenError::TooMany { count: 2 })
    );
    switch.close(shared).unwrap();
}

#[test]
fn a_vector_that_nobody_claims_is_disabled() {
    let (_, controller, switch) = started();
    switch.on_interrupt();
    controller.set(Vector(64), true);
    switch.on_interrupt();
    assert!(!controller.is_enabled(Vector(64)));
    let expected = InterruptCounts {
        spurious: 1,
        unclaimed: 16,
        stuck: 1,
        ..InterruptCounts::default()
    };
    assert_eq!(switch.interrupt_counts(), expected);
}
