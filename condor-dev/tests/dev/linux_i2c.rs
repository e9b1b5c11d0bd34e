//! The parts on I2C, on registers that the kernel's module `i2c-stub` keeps, where it is loaded:
//! `modprobe i2c-dev; modprobe i2c-stub chip_addr=0x36,0x40`.
#![cfg(all(feature = "linux", target_os = "linux"))]

use std::fs::{self, File};
use std::io;
use std::os::fd::AsRawFd as _;

use condor_dev::drivers::{As5600, ChipClock, Pca9685};
use condor_dev::{Bus as _, I2cBus, Location, NoInterrupts, OpenMode, Switch, device_switch};
use embedded_hal::i2c::{ErrorKind, ErrorType, I2c, Operation};

/// A controller of the kernel by its `SMBus` calls, the only ones that `i2c-stub` has.
struct Smbus(File);

const I2C_STUB: libc::c_ulong = 0x0703;
const I2C_SMBUS: libc::c_ulong = 0x0720;
const I2C_BLOCK_DATA: u32 = 8;
/// Bytes of a block.
const MOST: usize = 32;

/// `struct i2c_smbus_ioctl_data`.
#[repr(C)]
struct Call {
    is_read: u8,
    register: u8,
    size: u32,
    /// How many bytes, and the bytes.
    block: *mut [u8; MOST + 2],
}

impl Smbus {
    /// The adapter of `i2c-stub`, if there is one that this program may open.
    fn stub() -> Option<Self> {
        let adapters = fs::read_dir("/sys/class/i2c-dev").ok()?;
        let stub = adapters.flatten().find(|adapter| {
            let name = fs::read_to_string(adapter.path().join("name"));
            name.is_ok_and(|name| name.starts_with("SMBus stub"))
        })?;
        let device = std::path::Path::new("/dev").join(stub.file_name());
        let opened = File::options().read(true).write(true).open(device);
        opened.ok().map(Self)
    }

    fn block(&self, is_read: bool, register: u8, bytes: &mut [u8]) -> io::Result<()> {
        let mut block = [0; MOST + 2];
        block[0] = bytes.len() as u8;
        block[1..=bytes.len()].copy_from_slice(bytes);
        let call = Call {
            is_read: is_read.into(),
            register,
            size: I2C_BLOCK_DATA,
            block: &raw mut block,
        };
        // SAFETY: the call and its block are as the kernel's header has them, and live on.
        if unsafe { libc::ioctl(self.0.as_raw_fd(), I2C_SMBUS as _, &raw const call) } < 0 {
            return Err(io::Error::last_os_error());
        }
        bytes.copy_from_slice(&block[1..=bytes.len()]);
        Ok(())
    }
}

impl ErrorType for Smbus {
    type Error = ErrorKind;
}

impl I2c for Smbus {
    fn transaction(&mut self, part: u8, operations: &mut [Operation<'_>]) -> Result<(), ErrorKind> {
        // SAFETY: the call takes a number.
        if unsafe { libc::ioctl(self.0.as_raw_fd(), I2C_STUB as _, libc::c_ulong::from(part)) } < 0
        {
            return Err(ErrorKind::Other);
        }
        let done = match operations {
            [Operation::Write([register]), Operation::Read(into)] => {
                let mut blocks = (*register..).step_by(MOST).zip(into.chunks_mut(MOST));
                blocks.try_for_each(|(register, into)| self.block(true, register, into))
            }
            [Operation::Write([register, from @ ..])] => {
                let mut blocks = (*register..).step_by(MOST).zip(from.chunks(MOST));
                blocks.try_for_each(|(register, from)| {
                    self.block(false, register, &mut from.to_vec())
                })
            }
            _ => return Err(ErrorKind::Other),
        };
        done.map_err(|_| ErrorKind::Other)
    }
}

device_switch! {
    struct Parts {
        servos: Pca9685 = [Location::i2c(0x40)],
        angle: As5600 = [Location::i2c(As5600::ADDRESS)],
    }
}

#[test]
fn parts_are_reached_through_the_kernel() {
    let Some(stub) = Smbus::stub() else {
        println!("skipped: no adapter of the kernel's module i2c-stub can be opened");
        return;
    };
    let bus = I2cBus::new(stub);
    bus.write_block(0x3600, &[0; 0x20]).unwrap();
    // An angle, and a prescaler as it is after power came.
    bus.write_block(0x360b, &[0x20, 0x0a, 0xbc]).unwrap();
    bus.write8(0x40fe, 0x1e).unwrap();
    let parts = Switch::<_, _, _, 2>::new(&bus, NoInterrupts, Parts::new());
    parts.start();
    let angle = parts.open_typed(Parts::angle, 0, OpenMode::READ).unwrap();
    assert_eq!(angle.raw_angle(angle.registers), Ok(0xabc));
    assert!(angle.magnet(angle.registers).unwrap().is_detected);
    let servos = parts.open_typed(Parts::servos, 0, OpenMode::WRITE).unwrap();
    let at = servos.registers;
    assert_eq!(servos.set_frequency(at, ChipClock::NOMINAL, 50), Ok(50));
    assert_eq!(bus.read8(0x40fe), Ok(121));
    assert_eq!(servos.set_duties(servos.registers, 0, &[307; 16]), Ok(()));
    let mut registers = [0; 64];
    bus.read_block(0x4006, &mut registers).unwrap();
    assert_eq!(registers, [0, 0, 0x33, 0x01].repeat(16)[..]);
}
