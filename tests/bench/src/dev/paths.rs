//! The ways to a device, one function each, whose instructions are counted from its first to its
//! return.
//!
//! The functions have names for the linker, so that callgrind finds them and the compiler knows
//! nothing of their arguments.

use std::convert::Infallible;
use std::hint::black_box;
use std::io::Write as _;

use condor_dev::stdio::{self, Buffering, StandardOutput as _};
use condor_dev::{Driver as _, Fd, NoInterrupts};
use vm_device::bus::MmioAddress;
use vm_device::device_manager::{IoManager, MmioManager as _};

use super::boards::{BenchSwitch, Boards, MODE, Memory, PORT, Port, PortDevice, set};
use super::peers::{Board, DynSwitch, io_manager};
use crate::Result;

/// Bytes of the buffers.
const BUFFER: usize = 256;

#[unsafe(no_mangle)]
#[inline(never)]
extern "Rust" fn condor_path_direct(board: &Board<Port>, bytes: &[u8]) -> bool {
    matches!(board.driver.write(board.registers, bytes), Ok(2))
}

#[unsafe(no_mangle)]
#[inline(never)]
pub(super) extern "Rust" fn condor_path_fd(switch: &BenchSwitch, fd: Fd, bytes: &[u8]) -> bool {
    matches!(switch.write(fd, bytes), Ok(2))
}

#[unsafe(no_mangle)]
#[inline(never)]
extern "Rust" fn condor_path_dyn(switch: &DynSwitch, fd: Fd, bytes: &[u8]) -> bool {
    matches!(switch.write(fd, bytes), Ok(2))
}

#[unsafe(no_mangle)]
#[inline(never)]
extern "Rust" fn condor_path_vm_device(manager: &IoManager, address: u64, bytes: &[u8]) -> bool {
    manager.mmio_write(MmioAddress(address), bytes).is_ok()
}

#[unsafe(no_mangle)]
#[inline(never)]
extern "Rust" fn condor_path_direct16(board: &Board<Port>, value: u16) -> bool {
    set(board.registers, value).is_ok()
}

#[unsafe(no_mangle)]
#[inline(never)]
extern "Rust" fn condor_path_typed(port: &PortDevice<'_>, value: u16) -> bool {
    set(port.registers, value).is_ok()
}

#[unsafe(no_mangle)]
#[inline(never)]
extern "Rust" fn condor_path_putc(writer: &mut stdio::BufWriter<Sink, BUFFER>, byte: u8) -> bool {
    writer.put(byte).is_ok()
}

#[unsafe(no_mangle)]
#[inline(never)]
extern "Rust" fn condor_path_std_buf_writer(
    writer: &mut std::io::BufWriter<Sink>,
    byte: u8,
) -> bool {
    writer.write_all(&[byte]).is_ok()
}

#[unsafe(no_mangle)]
#[inline(never)]
extern "Rust" fn condor_path_output(
    output: &stdio::BufferedOutput<Sink, BUFFER>,
    bytes: &[u8],
) -> bool {
    output.write(bytes).is_ok()
}

/// A device that takes everything.
#[derive(Debug)]
struct Sink;

impl embedded_io::ErrorType for Sink {
    type Error = Infallible;
}

impl embedded_io::Write for Sink {
    fn write(&mut self, from: &[u8]) -> std::result::Result<usize, Infallible> {
        Ok(black_box(from).len())
    }

    fn flush(&mut self) -> std::result::Result<(), Infallible> {
        Ok(())
    }
}

impl std::io::Write for Sink {
    fn write(&mut self, from: &[u8]) -> std::io::Result<usize> {
        Ok(black_box(from).len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

static BUS: Memory = Memory::new();
static SWITCH: BenchSwitch = BenchSwitch::new(Memory::new(), NoInterrupts, Boards::new());
static OUTPUT: stdio::BufferedOutput<Sink, BUFFER> = stdio::BufferedOutput::new(Buffering::Block);

/// Opens the port.
pub(super) fn open() -> Result<(&'static BenchSwitch, Fd)> {
    SWITCH.start();
    // Not the first descriptor.
    let first = SWITCH.open(":lamps", 0, MODE);
    first.map_err(|error| error.to_string())?;
    let fd = SWITCH.open(":port", 1, MODE);
    Ok((&SWITCH, fd.map_err(|error| error.to_string())?))
}

/// The function of a path, to be called by the index of the call.
type Path = Box<dyn FnMut(usize) -> bool>;

/// Goes `calls` times down one path: what callgrind runs.
///
/// # Errors
/// Returns an error if there is no such path, or if the device refuses.
pub(crate) fn go(name: &str, calls: usize) -> Result<()> {
    let (switch, fd) = open()?;
    let board: &'static Board<Port> = Box::leak(Box::new(Board::new(&BUS, PORT)));
    let bytes = |call: usize| (call as u16).to_ne_bytes();
    let mut path: Path = match name {
        "direct" => Box::new(move |call| condor_path_direct(board, &bytes(call))),
        "fd" => Box::new(move |call| condor_path_fd(switch, fd, &bytes(call))),
        "dyn" => {
            let switch = DynSwitch::new(&BUS, PORT);
            switch.open(fd, MODE);
            Box::new(move |call| condor_path_dyn(&switch, fd, &bytes(call)))
        }
        "vm_device" => {
            let manager = io_manager(&BUS, PORT)?;
            Box::new(move |call| condor_path_vm_device(&manager, PORT as u64, &bytes(call)))
        }
        "direct16" => Box::new(move |call| condor_path_direct16(board, call as u16)),
        "typed" => {
            let port = switch.device(Boards::port, fd)?;
            Box::new(move |call| condor_path_typed(&port, call as u16))
        }
        "putc" => {
            let mut writer = stdio::BufWriter::new(Sink, Buffering::Line);
            Box::new(move |call| condor_path_putc(&mut writer, letter(call)))
        }
        "std_buf_writer" => {
            let mut writer = std::io::BufWriter::with_capacity(BUFFER, Sink);
            Box::new(move |call| condor_path_std_buf_writer(&mut writer, letter(call)))
        }
        "output" => {
            OUTPUT.open(Sink).map_err(|_| "the output is open")?;
            Box::new(move |call| condor_path_output(&OUTPUT, &[letter(call); 16]))
        }
        _ => return Err(format!("there is no path {name}").into()),
    };
    for call in 0..calls {
        if !path(black_box(call)) {
            return Err(format!("{name}: call {call} failed").into());
        }
    }
    Ok(())
}

/// Returns a letter, so that the text has no newlines.
fn letter(call: usize) -> u8 {
    b'a' + (call % 26) as u8
}
