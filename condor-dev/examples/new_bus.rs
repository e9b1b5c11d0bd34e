//! A bus for new hardware: boards behind a serial bridge, reached by an unchanged driver.
//!
//! `cargo run -p condor-dev --example new_bus`

use std::cell::RefCell;
use std::error::Error;
use std::process::ExitCode;

use condor_dev::conformance::{self, BusMemory};
use condor_dev::{
    Bus, BusErrorKind, Location, NoInterrupts, OpenMode, Switch, Width, device_switch,
};
use utah_mit_boards::Adc16;

/// Boards behind a bridge. A request is a command (1, 2 or 4 bytes, 0x80 to write), the address
/// and a value; an answer is a status and a value.
struct Bridge<L>(L);

impl<L: Link> Bridge<L> {
    fn request(&self, command: u8, address: usize, value: u32) -> Result<u32, BusErrorKind> {
        let address = u32::try_from(address).map_err(|_| BusErrorKind::OutOfRange)?;
        let mut request = [command; 9];
        request[1..5].copy_from_slice(&address.to_le_bytes());
        request[5..].copy_from_slice(&value.to_le_bytes());
        match self.0.transfer(request) {
            [0, value @ ..] => Ok(u32::from_le_bytes(value)),
            [1, ..] => Err(BusErrorKind::Misaligned),
            [2, ..] => Err(BusErrorKind::NoAnswer),
            _ => Err(BusErrorKind::Other),
        }
    }
}

impl<L: Link> Bus for Bridge<L> {
    type Error = BusErrorKind;

    fn read(&self, address: usize, width: Width) -> Result<u32, BusErrorKind> {
        self.request(width as u8, address, 0)
    }

    fn write(&self, address: usize, width: Width, value: u32) -> Result<(), BusErrorKind> {
        self.request(width as u8 | 0x80, address, value).map(drop)
    }
}

// Here ends what a user writes; what follows stands in for the hardware and is the program.

/// A link that sends a request of nine bytes to the bridge, and returns its answer of five.
trait Link {
    fn transfer(&self, request: [u8; 9]) -> [u8; 5];
}

/// The far end of the link: an analog-to-digital board at 0x100, and memory from 0x200 to 0x240.
struct FarEnd(RefCell<[u8; 0x240]>);

impl FarEnd {
    fn new() -> Self {
        let mut bytes = [0; 0x240];
        bytes[0x100..0x102].copy_from_slice(&0xadc0_u16.to_ne_bytes());
        let values = (0_i16..).map(|channel| 1000 - 250 * channel);
        for (register, value) in bytes[0x120..0x140].chunks_exact_mut(2).zip(values) {
            register.copy_from_slice(&value.to_ne_bytes());
        }
        Self(RefCell::new(bytes))
    }
}

impl Link for FarEnd {
    fn transfer(&self, [command, request @ ..]: [u8; 9]) -> [u8; 5] {
        let [a, b, c, d, value @ ..] = request;
        let (address, width) = (
            u32::from_le_bytes([a, b, c, d]) as usize,
            usize::from(command & 7),
        );
        let present = (0x100..0x140).contains(&address) || (0x200..0x240).contains(&address);
        if !address.is_multiple_of(width) {
            return [1, 0, 0, 0, 0];
        }
        if !present {
            return [2, 0, 0, 0, 0];
        }
        let mut bytes = self.0.borrow_mut();
        let place = &mut bytes[address..address + width];
        let value = u32::from_le_bytes(value);
        if command & 0x80 != 0 {
            match width {
                1 => place[0] = value as u8,
                2 => place.copy_from_slice(&(value as u16).to_ne_bytes()),
                _ => place.copy_from_slice(&value.to_ne_bytes()),
            }
        }
        let found = match *place {
            [byte] => byte.into(),
            [a, b] => u16::from_ne_bytes([a, b]).into(),
            [a, b, c, d] => u32::from_ne_bytes([a, b, c, d]),
            _ => 0,
        };
        let [a, b, c, d] = found.to_le_bytes();
        [0, a, b, c, d]
    }
}

device_switch! {
    struct Boards {
        adc: Adc16 = [Location::at(0x100), Location::at(0x180)],
    }
}

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<(), Box<dyn Error>> {
    let bridge = Bridge(FarEnd::new());
    let ground = BusMemory {
        memory: 0x200,
        absent: Some(0x240),
        refuses_misaligned: true,
    };
    conformance::bus(&bridge, ground)?;
    println!("the bridge conforms to what a bus promises");

    let switch = Switch::<_, _, _, 4>::new(bridge, NoInterrupts, Boards::new());
    switch.start();
    print!("{}", switch.inventory());
    let fd = switch
        .open(":adc", 0, OpenMode::READ)
        .map_err(|error| error.to_string())?;
    let adc = switch.device(Boards::adc, fd)?;
    let mut channels = [0; Adc16::CHANNELS];
    adc.scan(adc.registers, &mut channels)
        .map_err(|error| error.to_string())?;
    println!("channels {channels:?}");
    Ok(())
}
