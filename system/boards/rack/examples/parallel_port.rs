//! The memo's program (A.I. Memo 977, section 3.1): a parallel port is opened, used and closed.
//!
//! `cargo run -p utah-mit-boards --example parallel_port`

use std::error::Error;
use std::process::ExitCode;
use std::sync::{Arc, Mutex, PoisonError};

use condor_dev::BusAccessError;
use condor_dev::sim::{Controller, SimBus};
use condor_dev::{Fd, InterruptVector, IoError, Location, OpenMode, Switch, device_switch};
use utah_mit_boards::Mpp;
use utah_mit_boards::sim::MppModel;

device_switch! {
    /// The system configuration file: where parallel ports may be.
    struct Boards {
        mpp: Mpp = [
            Location::at(0xee00_0000).interrupting(65, 3),
            Location::at(0xee00_0100).interrupting(65, 3),
        ],
    }
}

type Devices = Switch<SimBus, Controller, Boards, 4>;

fn parallel_port_startup(devices: &Devices, board_number: u8) -> Result<Fd, Box<dyn Error>> {
    let fd = devices
        .open(":mpp", board_number, OpenMode::READ | OpenMode::WRITE)
        .map_err(|error| format!("couldn't open device: {error}"))?;
    let mpp = devices.device(Boards::mpp, fd)?;
    // Reset the board.
    mpp.reset(mpp.registers)?;
    // Configure the board to be in raw 16-bit mode.
    mpp.config_16bit_raw(mpp.registers)?;
    // Return the fd, so that the user can use it later.
    Ok(fd)
}

fn parallel_port_read(
    devices: &Devices,
    fd: Fd,
    buffer: &mut [u16],
) -> Result<usize, Box<dyn Error>> {
    let mpp = devices.device(Boards::mpp, fd)?;
    for value in &mut *buffer {
        // Perform the read 16 bits at a time.
        *value = mpp.read_16bits(mpp.registers)?;
    }
    Ok(buffer.len())
}

/// Bytes by interrupt: they are in the device's buffer before anybody asks for them.
fn parallel_port_receive(
    devices: &Devices,
    fd: Fd,
    buffer: &mut [u8],
) -> Result<usize, IoError<BusAccessError>> {
    match devices.read(fd, buffer) {
        Err(IoError::WouldBlock) => Ok(0),
        result => result,
    }
}

fn parallel_port_exit(devices: &Devices, fd: Fd) -> Result<(), IoError<BusAccessError>> {
    devices.close(fd)
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
    let (bus, controller) = (SimBus::new(), Controller::new());
    let board = bus.insert(0xee00_0000, MppModel::default());
    controller.connect(InterruptVector(65), board.clone());
    let devices = Devices::new(bus, controller.clone(), Boards::new());
    devices.start();
    print!("{}", devices.inventory());
    if let Err(error) = parallel_port_startup(&devices, 1) {
        println!("board 1: {error}");
    }

    let fd = parallel_port_startup(&devices, 0)?;
    let outside = |act: &dyn Fn(&mut MppModel)| act(&mut lock(&board));
    outside(&|board| board.samples.extend([0x0977, 0x1988, 0xbeef]));
    let mut buffer = [0; 3];
    let count = parallel_port_read(&devices, fd, &mut buffer)?;
    println!("{count} words of 16 bits: {buffer:04x?}");

    let mpp = devices.device(Boards::mpp, fd)?;
    mpp.config_8bit(mpp.registers)?;
    drop(mpp);
    outside(&|board| {
        for &byte in b"Condor" {
            board.strobe_in(byte);
        }
    });
    if controller.is_pending() {
        devices.on_interrupt();
    }
    let mut bytes = [0; 16];
    let count = parallel_port_receive(&devices, fd, &mut bytes)?;
    let text = String::from_utf8_lossy(&bytes[..count]);
    println!("{count} bytes by interrupt: {text}");

    parallel_port_exit(&devices, fd)?;
    match parallel_port_exit(&devices, fd) {
        Err(error) => println!("closed; again: {error}"),
        Ok(()) => return Err("a closed descriptor was closed again".into()),
    }
    Ok(())
}

fn lock<T>(board: &Arc<Mutex<T>>) -> std::sync::MutexGuard<'_, T> {
    board.lock().unwrap_or_else(PoisonError::into_inner)
}
