//! Names, boards and descriptors, on simulated boards.

use condor_dev::sim::{Controller, SimBus};
use condor_dev::{
    Driver, FdError, InterruptCounts, InterruptVector, IoError, Location, Mmio, NoInterrupts,
    OpenError, OpenMode, Presence, Registers, Switch, device_switch,
};
use utah_mit_boards::Adc16;
use utah_mit_boards::sim::AdcModel;

device_switch! {
    /// Two boards of which one is there.
    struct Boards {
        adc: Adc16 = [
            Location::at(0x1000).interrupting(64, 3),
            Location::at(0x2000).interrupting(64, 3),
        ],
    }
}

fn started() -> (SimBus, Controller, Switch<SimBus, Controller, Boards, 2>) {
    let (bus, controller) = (SimBus::new(), Controller::new());
    let mut model = AdcModel::default();
    model.channels[2] = -77;
    let board = bus.insert(0x1000, model);
    controller.connect(InterruptVector(64), board);
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
         adc          0       0x1000     64     3  present\n\
         adc          1       0x2000     64     3  absent\n"
    );
    assert!(controller.is_enabled(InterruptVector(64)));
    let absent = OpenError::NotPresent {
        name: "adc",
        board: 1,
        presence: Presence::Absent,
    };
    assert_eq!(switch.open("adc", 1, OpenMode::READ), Err(absent));
}

#[test]
fn a_board_is_read_by_descriptor_and_by_its_own_calls() {
    let (_, _, switch) = started();
    let fd = switch.open(":adc", 0, OpenMode::READ).unwrap();
    let mut bytes = [0; 6];
    assert_eq!(switch.read(fd, &mut bytes), Ok(6));
    assert_eq!(i16::from_ne_bytes([bytes[4], bytes[5]]), -77);
    let adc = switch.device(Boards::adc, fd).unwrap();
    let mut channels = [0; 16];
    assert_eq!(adc.scan(adc.registers, &mut channels), Ok(16));
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
        open("dac", 0, OpenMode::READ),
        Err(OpenError::NoSuchDevice {
            name: "dac",
            devices: &[("adc", 2)]
        })
    );
    assert_eq!(
        open("adc", 2, OpenMode::READ),
        Err(OpenError::NoSuchBoard {
            name: "adc",
            board: 2,
            boards: 2
        })
    );
    assert_eq!(
        open("adc", 0, OpenMode::WRITE),
        Err(OpenError::Direction {
            name: "adc",
            mode: OpenMode::WRITE
        })
    );
    let shared = open("adc", 0, OpenMode::READ).unwrap();
    let busy = OpenError::Busy {
        name: "adc",
        board: 0,
    };
    assert_eq!(
        open("adc", 0, OpenMode::READ | OpenMode::EXCLUSIVE),
        Err(busy)
    );
    open("adc", 0, OpenMode::READ).unwrap();
    assert_eq!(
        open("adc", 0, OpenMode::READ),
        Err(OpenError::TooMany { count: 2 })
    );
    switch.close(shared).unwrap();
}

#[test]
fn a_vector_that_nobody_claims_is_disabled() {
    let (_, controller, switch) = started();
    switch.on_interrupt();
    controller.set(InterruptVector(64), true);
    switch.on_interrupt();
    assert!(!controller.is_enabled(InterruptVector(64)));
    let expected = InterruptCounts {
        spurious: 1,
        unclaimed: 16,
        stuck: 1,
        ..InterruptCounts::default()
    };
    assert_eq!(switch.interrupt_counts(), expected);
}

device_switch! {
    /// Two devices of one driver.
    struct Twins {
        left: Adc16 = [Location::at(0x1000)],
        right: Adc16 = [Location::at(0x2000)],
    }
}

#[test]
fn a_device_is_opened_by_the_name_of_its_field() {
    let bus = SimBus::new();
    for (base, value) in [(0x1000, 1), (0x2000, 2)] {
        let mut model = AdcModel::default();
        model.channels[0] = value;
        bus.insert(base, model);
    }
    let switch = Switch::<_, _, _, 3>::new(bus, Controller::new(), Twins::new());
    switch.start();
    let mut bytes = [0; 2];
    for (name, value) in [("left", 1_i16), (":right", 2)] {
        let fd = switch.open(name, 0, OpenMode::READ).unwrap();
        assert_eq!(switch.read(fd, &mut bytes), Ok(2));
        assert_eq!(bytes, value.to_ne_bytes());
        switch.close(fd).unwrap();
    }
    let right = switch.open_typed(Twins::right, 0, OpenMode::READ).unwrap();
    let mut channels = [0; 1];
    right.scan(right.registers, &mut channels).unwrap();
    assert_eq!(channels, [2]);
    let fd = right.fd();
    let wrong = switch.device(Twins::left, fd).map(drop);
    let wanted = "left";
    assert_eq!(wrong, Err(FdError::WrongType { fd, wanted }));
    let again = switch.device(Twins::right, fd).unwrap();
    assert_eq!(again.close(), Err(IoError::Fd(FdError::InUse { fd })));
    assert_eq!(right.close(), Ok(()));
    assert_eq!(
        switch
            .open("middle", 0, OpenMode::READ)
            .unwrap_err()
            .to_string(),
        "there is no device middle; the devices are: left, right"
    );
}

/// A board that is looked at by another context while it is opened and closed.
struct Watched;

device_switch! {
    struct WatchedBoards { watched: Watched = [Location::at(0)] }
}

static WATCHED: Switch<Mmio, NoInterrupts, WatchedBoards, 2> = Switch::new(
    // SAFETY: a range without addresses.
    unsafe { Mmio::new(0, 0) },
    NoInterrupts,
    WatchedBoards::new(),
);

impl Watched {
    /// Another thread, which would wait for the end of a critical section, finds the board in use.
    fn look() {
        let look = || WATCHED.open("watched", 0, OpenMode::READ).map(drop);
        let busy = OpenError::Busy {
            name: "watched",
            board: 0,
        };
        assert_eq!(std::thread::spawn(look).join().unwrap(), Err(busy));
    }
}

impl Driver for Watched {
    const NEW: Self = Self;

    fn probe<B: condor_dev::Bus>(_: Registers<'_, B>) -> bool {
        true
    }

    fn open<B: condor_dev::Bus>(&self, _: Registers<'_, B>) -> Result<(), B::Error> {
        Self::look();
        Ok(())
    }

    fn close<B: condor_dev::Bus>(&self, _: Registers<'_, B>) -> Result<(), B::Error> {
        Self::look();
        Ok(())
    }
}

#[test]
fn nothing_is_masked_while_a_board_is_opened_or_closed() {
    WATCHED.start();
    for _ in 0..2 {
        let fd = WATCHED.open("watched", 0, OpenMode::READ).unwrap();
        let shared = WATCHED.open("watched", 0, OpenMode::WRITE).unwrap();
        WATCHED.close(fd).unwrap();
        WATCHED.close(shared).unwrap();
    }
}
