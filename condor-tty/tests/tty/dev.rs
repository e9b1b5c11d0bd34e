//! Terminals opened by name through a device switch, and its buffered standard output and input
//! over them.

use std::cell::RefCell;
use std::sync::OnceLock;
use std::time::Duration;

use condor_dev::sim::SimBus;
use condor_dev::stdio::{self, BufferedInput, BufferedOutput, Buffering};
use condor_dev::stream::{DeviceStream, DeviceStreamError, looks};
use condor_dev::{
    FdError, IoError, Location, NoInterrupts, OpenError, OpenMode, Switch, device_switch,
};
use condor_mbox::sim::{SimMailbox, SimSystem, SimWindow};
use condor_mbox::{Allocator, CriticalSection, LoadOrder, MemoryWindow, Processor, Region};
use condor_tty::dev::{
    AnyTerminal, END_OF_FILE, INTERRUPTED, TerminalBoard, TerminalTable, Tty, UNREACHABLE,
};
use condor_tty::layout::processor::WAITING;
use condor_tty::{Policy, Terminal, TerminalReader, TerminalSettings};
use embedded_io::{ReadReady, Write, WriteReady};

const HOST: Processor = Processor(0);
const HAND: Processor = Processor(1);
const CAPACITY: u32 = 64;
const BLOCK: Policy = Policy::Block {
    timeout: Duration::from_secs(1),
};
const BOTH: OpenMode = OpenMode::READ.union(OpenMode::WRITE);

type Hand = Terminal<SimWindow, CriticalSection, 16>;

/// Where the terminal of each test is put.
static PANEL: [OnceLock<&'static dyn AnyTerminal>; 8] = [const { OnceLock::new() }; 8];

struct Panel;

impl TerminalTable for Panel {
    fn terminal(base: usize) -> Option<&'static dyn AnyTerminal> {
        PANEL.get(base)?.get().copied()
    }
}

device_switch! {
    struct Devices {
        tty: Tty<Panel> = [
            Location::at(0), Location::at(1), Location::at(2), Location::at(3), Location::at(4), Location::at(5),
        ],
    }
}

type Boards = Switch<SimBus, NoInterrupts, Devices, 4>;

/// A terminal whose processor has a mailbox, and the memory as its host has it.
fn terminal() -> (&'static Hand, &'static SimMailbox<'static, 2>, SimWindow) {
    let system = SimSystem::<2>::in_virtual_time(1024);
    let [_, windows] = system.windows(HAND);
    let ram = Region::users(windows.data.clone()).unwrap();
    let mut allocator = Allocator::new(ram.size());
    let hand = Hand::new(ram.clone(), &mut allocator, CAPACITY, CriticalSection).unwrap();
    hand.configure(&TerminalSettings {
        echo: false,
        ..TerminalSettings::COOKED
    })
    .unwrap();
    let mut mailbox = system.mailbox(HAND).unwrap();
    mailbox.join().unwrap();
    (
        Box::leak(Box::new(hand)),
        Box::leak(Box::new(mailbox)),
        windows.data,
    )
}

fn put(base: usize, hand: &'static Hand, mailbox: &'static SimMailbox<'static, 2>) {
    let board: &'static _ = Box::leak(Box::new(TerminalBoard::new(hand, mailbox)));
    assert!(PANEL[base].set(board).is_ok());
}

fn switch() -> Boards {
    let devices = Boards::new(SimBus::new(), NoInterrupts, Devices::new());
    devices.start();
    devices
}

fn host(data: &SimWindow) -> TerminalReader<SimWindow> {
    TerminalReader::attach(Region::users(data.clone()).unwrap(), 0, HOST).unwrap()
}

/// What the host shows now, and has dealt with.
fn shown(host: &mut TerminalReader<SimWindow>) -> Vec<u8> {
    let mut bytes = [0; 100];
    let count = host.fetch(&mut bytes).unwrap().len;
    host.acknowledge(count).unwrap();
    bytes[..count].to_vec()
}

#[test]
fn a_terminal_opens_by_name_once_the_program_has_said_where_it_is() {
    let devices = switch();
    assert!(matches!(
        devices.open(":tty", 0, BOTH),
        Err(OpenError::NotPresent { .. })
    ));
    let (hand, mailbox, data) = terminal();
    put(0, hand, mailbox);
    devices.start();
    let fd = devices.open(":tty", 0, BOTH).unwrap();
    assert!(matches!(
        devices.open("tty", 0, OpenMode::READ | OpenMode::EXCLUSIVE),
        Err(OpenError::Busy { .. })
    ));

    assert_eq!(devices.write(fd, b"hello\n"), Ok(6));
    let mut host = host(&data);
    assert_eq!(shown(&mut host), b"hello\r\n");

    let mut into = [0; 8];
    assert_eq!(devices.read_ready(fd), Ok(false));
    assert!(matches!(
        devices.read(fd, &mut into),
        Err(IoError::WouldBlock)
    ));
    for character in *b"go\n\x04" {
        hand.accept(character).unwrap();
    }
    assert_eq!(devices.read_ready(fd), Ok(true));
    assert_eq!(devices.read(fd, &mut into), Ok(3));
    assert_eq!(&into[..3], b"go\n");
    assert!(matches!(
        devices.read(fd, &mut into),
        Err(IoError::Device(END_OF_FILE))
    ));
    hand.accept(3).unwrap();
    assert!(matches!(
        devices.read(fd, &mut into),
        Err(IoError::Device(INTERRUPTED))
    ));
    assert!(matches!(
        devices.read(fd, &mut into),
        Err(IoError::WouldBlock)
    ));

    devices.close(fd).unwrap();
    assert!(matches!(
        devices.write(fd, b"x"),
        Err(IoError::Fd(FdError::Closed { .. }))
    ));
}

#[test]
fn a_stream_waits_for_the_room_that_a_host_makes() {
    let (hand, mailbox, data) = terminal();
    put(1, hand, mailbox);
    hand.configure(&TerminalSettings::RAW).unwrap();
    hand.set_policy(BLOCK).unwrap();
    let devices = switch();
    let fd = devices.open(":tty", 1, OpenMode::WRITE).unwrap();
    let host = RefCell::new(host(&data));
    let arrived = RefCell::new(Vec::new());
    let waiting = || {
        Region::users(data.clone())
            .unwrap()
            .load(WAITING, LoadOrder::Relaxed)
    };
    let mut stream = DeviceStream::new(&devices, fd, |_| {
        // Who waits has said so, and wants a message when there is room.
        assert_eq!(waiting().unwrap(), 1);
        arrived.borrow_mut().extend(shown(&mut host.borrow_mut()));
        true
    });
    let text: Vec<u8> = (0..1000).map(|at: u32| at as u8).collect();
    stream.write_all(&text).unwrap();
    assert_eq!(waiting().unwrap(), 0);
    stream.flush().unwrap();
    assert_eq!((arrived.into_inner(), hand.lost()), (text, 0));

    // A host that died with a full ring is waited for, but not for ever.
    let mut stream = DeviceStream::new(&devices, fd, looks(3));
    assert_eq!(stream.write_all(&[b'-'; 64]), Ok(()));
    assert_eq!(stream.write_ready(), Ok(false));
    assert_eq!(stream.write_all(b"more"), Err(DeviceStreamError::TimedOut));
    assert_eq!(stream.flush(), Err(DeviceStreamError::TimedOut));
    assert_eq!((hand.lost(), waiting().unwrap()), (0, 1));
    devices.close(fd).unwrap();
    assert_eq!(waiting().unwrap(), 0);
}

#[test]
fn what_a_policy_drops_is_written_and_counted() {
    let (hand, mailbox, data) = terminal();
    put(2, hand, mailbox);
    hand.configure(&TerminalSettings::RAW).unwrap();
    let devices = switch();
    let fd = devices.open(":tty", 2, OpenMode::WRITE).unwrap();
    let mut stream = DeviceStream::new(&devices, fd, looks(0));
    let _killed = host(&data);
    hand.set_policy(Policy::DropNew).unwrap();
    stream.write_all(&[b'a'; 100]).unwrap();
    assert_eq!(hand.lost(), 36);
    stream.flush().unwrap();
    hand.set_policy(Policy::DropOld).unwrap();
    stream.write_all(&[b'b'; 100]).unwrap();
    assert_eq!(hand.lost(), 36);
    let mut host = host(&data);
    assert_eq!(shown(&mut host), [b'b'; 64]);
    assert_eq!(host.status().unwrap().overwritten, 100);
}

#[test]
fn memory_that_is_gone_is_an_error_and_holds_nobody() {
    let (hand, mailbox, data) = terminal();
    put(3, hand, mailbox);
    let devices = switch();
    let fd = devices.open(":tty", 3, BOTH).unwrap();
    data.lose();
    assert_eq!(devices.write(fd, b"x"), Err(IoError::Device(UNREACHABLE)));
    assert_eq!(devices.is_flushed(fd), Ok(true));
    devices.close(fd).unwrap();
}

type Ends = DeviceStream<'static, Boards, fn(u32) -> bool>;

static OUTPUT: BufferedOutput<Ends, 256> = BufferedOutput::new(Buffering::Line);
static INPUT: BufferedInput<Ends, 64> = BufferedInput::new();

#[test]
fn standard_output_and_input_are_a_terminal() {
    let (hand, mailbox, data) = terminal();
    put(4, hand, mailbox);
    let devices: &'static Boards = Box::leak(Box::new(switch()));
    let fd = devices.open(":tty", 4, BOTH).unwrap();
    let mut host = host(&data);
    let thrice: fn(u32) -> bool = |looks| looks < 3;
    assert!(OUTPUT.open(DeviceStream::new(devices, fd, thrice)).is_ok());
    assert!(INPUT.open(DeviceStream::new(devices, fd, thrice)).is_ok());
    stdio::set_output(&OUTPUT).unwrap();
    stdio::set_input(&INPUT).unwrap();

    condor_dev::print!("name? ");
    stdio::flush().unwrap();
    condor_dev::println!("it is {:.1}", 2.5);
    assert_eq!(shown(&mut host), b"name? it is 2.5\r\n");

    for character in *b"fins\x7fger\n" {
        hand.accept(character).unwrap();
    }
    let mut line = [0; 32];
    let input = stdio::stdin().unwrap();
    assert_eq!(input.read_line(&mut line).unwrap(), "finger\n");
    assert!(input.read(&mut line).is_err());
    assert_eq!(stdio::lost(), 0);
}

#[test]
fn readiness_is_that_of_the_terminal() {
    let (hand, mailbox, data) = terminal();
    put(5, hand, mailbox);
    hand.set_policy(BLOCK).unwrap();
    let devices = switch();
    let fd = devices.open(":tty", 5, BOTH).unwrap();
    let mut stream = DeviceStream::new(&devices, fd, looks(0));
    assert_eq!(
        (stream.read_ready(), stream.write_ready()),
        (Ok(false), Ok(true))
    );
    hand.accept(b'\n').unwrap();
    assert_eq!(stream.read_ready(), Ok(true));
    let _host = host(&data);
    stream.write_all(&[b'-'; 63]).unwrap();
    // A newline would not find room.
    assert_eq!(stream.write_ready(), Ok(false));
}
