//! Descriptors with the traits of `embedded-io`.

use std::cell::Cell;

use condor_dev::sim::SimBus;
use condor_dev::stream::{Descriptors, DeviceStream, DeviceStreamError};
use condor_dev::{
    BusErrorKind, Fd, FdError, IoError, Location, NoInterrupts, OpenMode, Switch, device_switch,
};
use embedded_io::{Error as _, ErrorKind, Read, Write};
use utah_mit_boards::Adc16;
use utah_mit_boards::sim::AdcModel;

device_switch! {
    struct Boards {
        adc: Adc16 = [Location::at(0x1000)],
    }
}

type TestSwitch = Switch<SimBus, NoInterrupts, Boards, 2>;

fn started() -> (SimBus, TestSwitch, Fd) {
    let bus = SimBus::new();
    let mut adc = AdcModel::default();
    adc.channels = [0x1234; 16];
    bus.insert(0x1000, adc);
    let switch = Switch::new(bus.clone(), NoInterrupts, Boards::new());
    switch.start();
    let fd = switch.open("adc", 0, OpenMode::READ).unwrap();
    (bus, switch, fd)
}

/// A device that is ready at its `ready`th look, and takes and gives what it is told.
struct Slow {
    looks: Cell<u32>,
    ready: u32,
    moves: usize,
}

impl Slow {
    fn new(ready: u32, moves: usize) -> Self {
        Self {
            looks: Cell::new(0),
            ready,
            moves,
        }
    }

    fn look(&self) -> Result<usize, IoError<BusErrorKind>> {
        self.looks.set(self.looks.get() + 1);
        if self.looks.get() < self.ready {
            Err(IoError::WouldBlock)
        } else {
            Ok(self.moves)
        }
    }
}

impl Descriptors for Slow {
    fn read(&self, _: Fd, _: &mut [u8]) -> Result<usize, IoError<BusErrorKind>> {
        self.look()
    }

    fn write(&self, _: Fd, _: &[u8]) -> Result<usize, IoError<BusErrorKind>> {
        self.look()
    }

    fn is_flushed(&self, _: Fd) -> Result<bool, IoError<BusErrorKind>> {
        self.look().map(|moved| moved > 0).or(Ok(false))
    }

    fn close(&self, _: Fd) -> Result<(), IoError<BusErrorKind>> {
        Ok(())
    }
}

/// A wait that ends after so many looks.
fn looks(count: u32) -> impl FnMut() -> bool {
    let mut looks = 0;
    move || {
        looks += 1;
        looks < count
    }
}

#[test]
fn a_board_is_read_as_a_stream() {
    let (_, switch, fd) = started();
    let mut stream = DeviceStream::new(&switch, fd, looks(1));
    let mut bytes = [0; 4];
    stream.read_exact(&mut bytes).unwrap();
    assert_eq!(bytes, [0x1234_u16.to_ne_bytes(); 2].concat()[..]);
    assert_eq!(stream.read(&mut []), Ok(0));
}

#[test]
fn every_misuse_has_its_kind() {
    let (bus, switch, fd) = started();
    let mut stream = DeviceStream::new(&switch, fd, looks(1));
    let kind = |result: Result<usize, DeviceStreamError>| result.unwrap_err().kind();
    assert_eq!(kind(stream.write(&[1])), ErrorKind::PermissionDenied);
    assert_eq!(kind(stream.read(&mut [0])), ErrorKind::InvalidInput);
    bus.remove(0x1000);
    assert_eq!(kind(stream.read(&mut [0; 2])), ErrorKind::NotConnected);
    Descriptors::close(&switch, fd).unwrap();
    let closed = DeviceStreamError::Io(IoError::Fd(FdError::Closed { fd }));
    assert_eq!(stream.read(&mut [0; 2]), Err(closed));
    assert_eq!(closed.kind(), ErrorKind::NotConnected);
    assert_eq!(stream.flush(), Err(closed));
}

#[test]
fn a_wait_ends_when_it_is_told_to() {
    let (_, _, fd) = started();
    for (ready, count, expected) in [
        (1, 0, Ok(2)),
        (2, 0, Err(DeviceStreamError::TimedOut)),
        (2, 1, Err(DeviceStreamError::TimedOut)),
        (2, 2, Ok(2)),
        (7, 6, Err(DeviceStreamError::TimedOut)),
        (7, 7, Ok(2)),
    ] {
        let slow = Slow::new(ready, 2);
        assert_eq!(
            DeviceStream::new(&slow, fd, looks(count)).write(&[1, 2]),
            expected
        );
        assert_eq!(slow.looks.get(), ready.min(count.max(1)));
        let slow = Slow::new(ready, 2);
        let flushed = DeviceStream::new(&slow, fd, looks(count)).flush();
        assert_eq!(flushed, expected.map(|_| ()));
    }
    assert_eq!(DeviceStreamError::TimedOut.kind(), ErrorKind::TimedOut);
}

#[test]
fn a_device_that_takes_nothing_is_not_ready() {
    let (_, _, fd) = started();
    let slow = Slow::new(1, 0);
    let mut stream = DeviceStream::new(&slow, fd, looks(3));
    assert_eq!(stream.write(&[1]), Err(DeviceStreamError::TimedOut));
    assert_eq!(slow.looks.get(), 3);
    assert_eq!(stream.write(&[]), Ok(0));
}
