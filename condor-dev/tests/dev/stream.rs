//! Descriptors with the traits of `embedded-io`.

use std::cell::Cell;

use condor_dev::sim::SimBus;
use condor_dev::stream::{Descriptors, DeviceStream, DeviceStreamError, looks, timeout};
use condor_dev::{Fd, FdError, IoError, Location, NoInterrupts, OpenMode, Switch, device_switch};
use embedded_io::{Error as _, ErrorKind, Read, ReadReady, Write, WriteReady};
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

    fn look(&self) -> Result<usize, IoError<std::convert::Infallible>> {
        self.looks.set(self.looks.get() + 1);
        if self.looks.get() < self.ready {
            Err(IoError::WouldBlock)
        } else {
            Ok(self.moves)
        }
    }
}

impl Descriptors for Slow {
    type Error = std::convert::Infallible;

    fn read(&self, _: Fd, _: &mut [u8]) -> Result<usize, IoError<Self::Error>> {
        self.look()
    }

    fn write(&self, _: Fd, _: &[u8]) -> Result<usize, IoError<Self::Error>> {
        self.look()
    }

    fn read_ready(&self, _: Fd) -> Result<bool, IoError<Self::Error>> {
        Ok(self.looks.get() + 1 >= self.ready)
    }

    fn write_ready(&self, fd: Fd) -> Result<bool, IoError<Self::Error>> {
        self.read_ready(fd)
    }

    fn is_flushed(&self, _: Fd) -> Result<bool, IoError<Self::Error>> {
        self.look().map(|moved| moved > 0).or(Ok(false))
    }
}

#[test]
fn a_board_is_read_as_a_stream() {
    let (_, switch, fd) = started();
    let mut stream = DeviceStream::new(&switch, fd, looks(1));
    let mut bytes = [0; 4];
    stream.read_exact(&mut bytes).unwrap();
    assert_eq!(bytes, [0x1234_u16.to_ne_bytes(); 2].concat()[..]);
    assert!(stream.read_ready().unwrap());
    assert_eq!(stream.read(&mut []), Ok(0));
    // The same by a reference that does not name the switch's type.
    let any: &dyn Descriptors<Error = _> = &switch;
    assert_eq!(DeviceStream::new(any, fd, looks(1)).read(&mut bytes), Ok(4));
}

#[test]
fn every_misuse_has_its_kind() {
    let (bus, switch, fd) = started();
    let mut stream = DeviceStream::new(&switch, fd, looks(1));
    let kind = |result: Result<usize, DeviceStreamError<_>>| result.unwrap_err().kind();
    assert_eq!(kind(stream.write(&[1])), ErrorKind::PermissionDenied);
    assert_eq!(kind(stream.read(&mut [0])), ErrorKind::InvalidInput);
    bus.remove(0x1000);
    assert_eq!(kind(stream.read(&mut [0; 2])), ErrorKind::NotConnected);
    let read_by_one_that_is_dropped = {
        let mut other = stream.clone();
        other.read_ready()
    };
    assert_eq!(read_by_one_that_is_dropped, Ok(true));
    assert_eq!(stream.read_ready(), Ok(true));
    switch.close(fd).unwrap();
    let closed = DeviceStreamError::Io(IoError::Fd(FdError::Closed { fd }));
    assert_eq!(stream.read(&mut [0; 2]), Err(closed));
    assert_eq!(closed.kind(), ErrorKind::NotConnected);
    assert_eq!(stream.flush(), Err(closed));
}

#[test]
fn looks_are_counted() {
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
    assert_eq!(
        DeviceStreamError::<std::convert::Infallible>::TimedOut.kind(),
        ErrorKind::TimedOut
    );
}

#[test]
fn a_timeout_is_of_each_call_even_as_the_clock_wraps() {
    let (_, _, fd) = started();
    let now = Cell::new(u32::MAX - 1);
    let clock = || {
        let tick = now.get();
        now.set(tick.wrapping_add(1));
        tick
    };
    let slow = Slow::new(5, 1);
    let mut stream = DeviceStream::new(&slow, fd, timeout(clock, 3));
    // The first look begins the wait; the fourth is three ticks later.
    assert_eq!(stream.read(&mut [0]), Err(DeviceStreamError::TimedOut));
    assert_eq!(slow.looks.get(), 4);
    assert_eq!(stream.read(&mut [0]), Ok(1));
}

#[test]
fn a_device_that_takes_nothing_is_not_ready() {
    let (_, _, fd) = started();
    let slow = Slow::new(1, 0);
    let mut stream = DeviceStream::new(&slow, fd, |looks| looks < 3);
    assert_eq!(stream.write(&[1]), Err(DeviceStreamError::TimedOut));
    assert_eq!(slow.looks.get(), 3);
    assert_eq!(stream.write(&[]), Ok(0));
    assert!(stream.write_ready().unwrap());
}

/// A file of two bytes.
struct File(Cell<usize>);

impl Descriptors for File {
    type Error = std::convert::Infallible;

    fn read(&self, _: Fd, into: &mut [u8]) -> Result<usize, IoError<Self::Error>> {
        let read = into.len().min(self.0.get());
        self.0.set(self.0.get() - read);
        if read == 0 {
            return Err(IoError::End);
        }
        Ok(read)
    }

    fn write(&self, _: Fd, _: &[u8]) -> Result<usize, IoError<Self::Error>> {
        Err(IoError::End)
    }

    fn read_ready(&self, _: Fd) -> Result<bool, IoError<Self::Error>> {
        Ok(true)
    }

    fn write_ready(&self, _: Fd) -> Result<bool, IoError<Self::Error>> {
        Ok(false)
    }

    fn is_flushed(&self, _: Fd) -> Result<bool, IoError<Self::Error>> {
        Ok(true)
    }
}

#[test]
fn an_end_reads_as_no_bytes_and_is_not_waited_for() {
    let file = File(Cell::new(2));
    let never = |_| panic!("there is nothing to wait for");
    let mut stream = DeviceStream::new(&file, Fd::new(7, 1), never);
    let mut bytes = [0; 4];
    assert_eq!(stream.read(&mut bytes), Ok(2));
    assert_eq!(stream.read(&mut bytes), Ok(0));
    assert_eq!(
        stream.write(&bytes),
        Err(DeviceStreamError::Io(IoError::End))
    );
    assert_eq!(stream.fd().number(), 7);
}
