//! The ways to a device, one function each, whose instructions are counted from its first to its
//! return.
//!
//! The functions have names for the linker, so that callgrind finds them and the compiler knows
//! nothing of their arguments.

use std::hint::black_box;

use condor_dev::{Driver, Fd, NoInterrupts, Registers};

use super::boards::{BenchSwitch, Boards, MODE, Memory, PORT, Port, PortDevice, set};
use crate::Result;

/// The port as its caller has it: the state of its driver, and where it is.
struct Board {
    driver: Port,
    registers: Registers<'static, Memory>,
}

#[unsafe(no_mangle)]
#[inline(never)]
extern "Rust" fn condor_path_direct(board: &Board, bytes: &[u8]) -> bool {
    matches!(board.driver.write(board.registers, bytes), Ok(2))
}

#[unsafe(no_mangle)]
#[inline(never)]
extern "Rust" fn condor_path_fd(switch: &BenchSwitch, fd: Fd, bytes: &[u8]) -> bool {
    matches!(switch.write(fd, bytes), Ok(2))
}

#[unsafe(no_mangle)]
#[inline(never)]
extern "Rust" fn condor_path_direct16(board: &Board, value: u16) -> bool {
    set(board.registers, value).is_ok()
}

#[unsafe(no_mangle)]
#[inline(never)]
extern "Rust" fn condor_path_typed(port: &PortDevice<'_>, value: u16) -> bool {
    set(port.registers, value).is_ok()
}

static BUS: Memory = Memory::new();
static SWITCH: BenchSwitch = BenchSwitch::new(Memory::new(), NoInterrupts, Boards::new());

/// The function of a path, to be called by the index of the call.
type Path = Box<dyn FnMut(usize) -> bool>;

/// Goes `calls` times down one path: what callgrind runs.
///
/// # Errors
/// Returns an error if there is no such path, or if the device refuses.
pub(crate) fn go(name: &str, calls: usize) -> Result<()> {
    SWITCH.start();
    // Not the first descriptor.
    let opened = SWITCH.open(":lamps", 0, MODE);
    let opened = opened.and_then(|_| SWITCH.open(":port", 1, MODE));
    let fd = opened.map_err(|error| error.to_string())?;
    let board: &'static Board = Box::leak(Box::new(Board {
        driver: Port::NEW,
        registers: Registers::new(&BUS, PORT),
    }));
    let bytes = |call: usize| (call as u16).to_ne_bytes();
    let mut path: Path = match name {
        "direct" => Box::new(move |call| condor_path_direct(board, &bytes(call))),
        "fd" => Box::new(move |call| condor_path_fd(&SWITCH, fd, &bytes(call))),
        "direct16" => Box::new(move |call| condor_path_direct16(board, call as u16)),
        "typed" => {
            let port = SWITCH.device(Boards::port, fd)?;
            Box::new(move |call| condor_path_typed(&port, call as u16))
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
