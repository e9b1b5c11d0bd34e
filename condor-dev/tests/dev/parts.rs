//! The parts on I2C, on simulated registers through the adapter, and on the kernel's where it has some.

use std::sync::{Arc, Mutex};

use condor_dev::drivers::{As5600, ChipClock, ClockError, Magnet, Pca9685};
use condor_dev::sim::{As5600Model, I2c, Pca9685Model, SimBus};
use condor_dev::{
    Bus as _, BusErrorKind, DeviceError, I2cBus, Location, NoInterrupts, OpenError, OpenMode,
    Presence, Registers, Switch, Unit, device_switch,
};
use embedded_hal::i2c;

device_switch! {
    struct Parts {
        servos: Pca9685 = [Location::i2c(0x40), Location::i2c(0x41)],
        angle: As5600 = [Location::i2c(As5600::ADDRESS)],
    }
}

type Arm = Switch<I2cBus<I2c<SimBus>>, NoInterrupts, Parts, 4>;

fn arm() -> (
    SimBus,
    Arm,
    Arc<Mutex<Pca9685Model>>,
    Arc<Mutex<As5600Model>>,
) {
    let bus = SimBus::new();
    let servos = bus.insert(0x4000, Pca9685Model::default());
    let angle = bus.insert(0x3600, As5600Model::default());
    let arm = Switch::new(I2cBus::new(I2c(bus.clone())), NoInterrupts, Parts::new());
    arm.start();
    (bus, arm, servos, angle)
}

#[test]
fn the_parts_that_acknowledge_are_found() {
    let (bus, arm, ..) = arm();
    let absent = arm.open("servos", 1, OpenMode::WRITE).unwrap_err();
    let presence = Presence::Absent;
    let (name, board) = ("servos", 1);
    let expected = OpenError::NotPresent {
        name,
        board,
        presence,
    };
    assert_eq!(absent, expected);
    // What is no PCA9685 is not taken for one.
    bus.insert(0x4100, As5600Model::default());
    let other = Switch::<_, _, _, 1>::new(I2cBus::new(I2c(bus)), NoInterrupts, Parts::new());
    other.start();
    assert_eq!(other.inventory().to_string().matches("present").count(), 2);
}

#[test]
fn outputs_are_on_for_what_was_written_and_off_when_closed() {
    let (_, arm, model, _) = arm();
    let duty = |channel| model.lock().unwrap().duty(channel);
    assert_eq!(duty(0), None);
    let servos = arm.open_typed(Parts::servos, 0, OpenMode::WRITE).unwrap();
    let at = servos.registers;
    assert_eq!(servos.set_frequency(at, ChipClock::NOMINAL, 50), Ok(50));
    assert_eq!(model.lock().unwrap().prescaler(), 121);
    assert_eq!(duty(15), Some(0));
    assert_eq!(servos.set_duties(at, 14, &[307, 4096]), Ok(()));
    assert_eq!(
        [duty(13), duty(14), duty(15)],
        [Some(0), Some(307), Some(4096)]
    );
    // Outputs that are on go on when the frequency has changed.
    assert_eq!(servos.set_frequency(at, ChipClock::NOMINAL, 1000), Ok(1017));
    assert_eq!(duty(14), Some(307));
    for (hertz, found, prescaler) in [(1, 24, 255), (u16::MAX, 1526, 3)] {
        assert_eq!(
            servos.set_frequency(at, ChipClock::NOMINAL, hertz),
            Ok(found)
        );
        assert_eq!(model.lock().unwrap().prescaler(), prescaler);
    }
    let all: Vec<u8> = (0..16_u16).flat_map(|n| (n * 10).to_ne_bytes()).collect();
    assert_eq!(arm.write(servos.fd(), &all), Ok(32));
    assert!((0..16).all(|channel| duty(channel) == Some(channel as u16 * 10)));
    let beyond = Err(DeviceError::Length { bytes: 4, unit: 2 });
    assert_eq!(servos.set_duties(at, 15, &[0; 2]), beyond);
    servos.close().unwrap();
    let again = arm.open_typed(Parts::servos, 0, OpenMode::WRITE).unwrap();
    assert!((0..16).all(|channel| duty(channel) == Some(0)));
    drop(again);
}

#[test]
fn outputs_recover_from_an_error_of_the_bus_at_any_access() {
    for failing in 0..300 {
        let (bus, arm, model, _) = arm();
        let servos = arm.open_typed(Parts::servos, 0, OpenMode::WRITE).unwrap();
        let at = servos.registers;
        servos.set_duties(at, 0, &[1; 16]).unwrap();
        bus.fail_after(failing);
        let _ = servos.set_frequency(at, ChipClock::NOMINAL, 60);
        let _ = servos.set_duties(at, 0, &[2; 16]);
        let rest = bus.accesses();
        // What failed is made again.
        while bus.accesses() < rest + failing {
            let _ = at.read8(0);
        }
        assert_eq!(servos.set_frequency(at, ChipClock::NOMINAL, 60), Ok(60));
        assert_eq!(servos.set_duties(at, 0, &[3; 16]), Ok(()));
        assert!((0..16).all(|channel| model.lock().unwrap().duty(channel) == Some(3)));
    }
}

#[test]
fn an_angle_is_read_raw_and_in_its_range() {
    let (_, arm, _, model) = arm();
    let angle = arm.open_typed(Parts::angle, 0, OpenMode::READ).unwrap();
    let at = angle.registers;
    model.lock().unwrap().angle = 0x0abc;
    assert_eq!(angle.raw_angle(at), Ok(0xabc));
    assert_eq!(angle.angle(at), Ok(0xabc));
    let mut bytes = [0; 3];
    assert_eq!(arm.read(angle.fd(), &mut bytes), Ok(2));
    assert_eq!(bytes, *[0xabc_u16.to_ne_bytes().as_slice(), &[0]].concat());
    angle.set_range(at, 0xa00, 0xe00).unwrap();
    assert_eq!(angle.angle(at), Ok(0x2f0));
    assert_eq!(angle.raw_angle(at), Ok(0xabc));
    let magnet = Magnet {
        is_detected: true,
        is_too_weak: false,
        is_too_strong: false,
        gain: 64,
        magnitude: 0x800,
    };
    assert_eq!(angle.magnet(at), Ok(magnet));
    model.lock().unwrap().status = 0x57;
    let found = angle.magnet(at).unwrap();
    assert_eq!((found.is_detected, found.is_too_weak), (false, true));
}

#[test]
fn a_part_that_is_taken_away_does_not_answer() {
    let (bus, arm, ..) = arm();
    let angle = arm.open_typed(Parts::angle, 0, OpenMode::READ).unwrap();
    bus.remove(0x3600);
    let error = angle.angle(angle.registers).unwrap_err();
    assert_eq!(error.kind, BusErrorKind::NoAnswer);
    assert_eq!(
        Registers::new(&I2cBus::new(I2c(bus)), 0x4000).read8(0),
        Ok(0x30)
    );
}

/// A part of another kind at each of two addresses. Its registers have 16 bits: a read gives the bytes of one, the
/// high one first, again and again.
struct Wide {
    registers: [u16; 16],
    writes: Arc<Mutex<usize>>,
}

impl i2c::ErrorType for Wide {
    type Error = i2c::ErrorKind;
}

impl i2c::I2c for Wide {
    fn transaction(
        &mut self,
        part: u8,
        operations: &mut [i2c::Operation<'_>],
    ) -> Result<(), i2c::ErrorKind> {
        if part != 0x40 && part != 0x36 {
            return Err(i2c::ErrorKind::NoAcknowledge(
                i2c::NoAcknowledgeSource::Address,
            ));
        }
        let mut register = 0;
        for operation in operations {
            match operation {
                i2c::Operation::Write([number]) => register = usize::from(*number) % 16,
                i2c::Operation::Write(_) => *self.writes.lock().unwrap() += 1,
                i2c::Operation::Read(into) => {
                    let bytes = self.registers[register].to_be_bytes();
                    let again = bytes.into_iter().cycle();
                    into.iter_mut()
                        .zip(again)
                        .for_each(|(place, byte)| *place = byte);
                }
            }
        }
        Ok(())
    }
}

#[test]
fn another_part_is_neither_taken_for_ours_nor_written() {
    // A power monitor and a fuel gauge; all the same; with a plausible byte in each register.
    let monitor = |index| {
        [0x399f, 0x0120, 0x0320, 0x0500]
            .get(index)
            .copied()
            .unwrap_or(0x971c)
    };
    let plausible = |index| {
        [0x399f, 0x0120, 0xf020, 0x0600]
            .get(index % 4)
            .copied()
            .unwrap_or(0)
    };
    for registers in [
        std::array::from_fn(monitor),
        std::array::from_fn(plausible),
        [u16::MAX; 16],
        [0x399f; 16],
        [0x2020; 16],
    ] {
        let writes = Arc::new(Mutex::new(0));
        let wide = Wide {
            registers,
            writes: writes.clone(),
        };
        let other = Switch::<_, _, _, 1>::new(I2cBus::new(wide), NoInterrupts, Parts::new());
        other.start();
        let found = other.inventory().to_string();
        assert_eq!(
            found.matches("absent").count(),
            3,
            "{registers:x?}: {found}"
        );
        assert_eq!(*writes.lock().unwrap(), 0, "{registers:x?}");
    }
}

#[test]
fn a_chip_is_known_whatever_a_former_program_set() {
    for mode1 in 0..=u8::MAX {
        let bus = SimBus::new();
        let model = bus.insert(0x4000, Pca9685Model::default());
        for (register, byte) in [
            (0x01, 0x1f),
            (0x02, 0xff),
            (0x05, 0x66),
            (0xfa, 0xff),
            (0xfb, 0xff),
            (0xfe, 0xff),
        ] {
            bus.write8(0x4000 + register, byte).unwrap();
        }
        for byte in [mode1 | 0x10, mode1] {
            bus.write8(0x4000, byte).unwrap();
        }
        let arm: Arm = Switch::new(I2cBus::new(I2c(bus.clone())), NoInterrupts, Parts::new());
        arm.start();
        let servos = arm.open_typed(Parts::servos, 0, OpenMode::WRITE).unwrap();
        let at = servos.registers;
        assert_eq!(servos.set_duties(at, 3, &[307]), Ok(()));
        let mut known = [0; 6];
        at.read_block(0, &mut known).unwrap();
        let clock = mode1 & 0x40;
        assert_eq!(
            known,
            [0x20 | clock, 0x04, 0xe2, 0xe4, 0xe8, 0xe0],
            "{mode1:#x}"
        );
        let duties: Vec<_> = (0..16).map(|n| model.lock().unwrap().duty(n)).collect();
        let expected: Vec<_> = (0..16)
            .map(|n| Some(if n == 3 { 307 } else { 0 }))
            .collect();
        assert_eq!(duties, expected, "{mode1:#x}");
        assert_eq!(at.read8(0xfe), Ok(0x1e), "{mode1:#x}");
    }
}

#[test]
fn a_measured_or_external_clock_is_computed_with() {
    let (bus, arm, model, _) = arm();
    let prescaler = || model.lock().unwrap().prescaler();
    let servos = arm.open_typed(Parts::servos, 0, OpenMode::WRITE).unwrap();
    let at = servos.registers;
    // 26.6 MHz / (4096 · 130) = 49.95 Hz
    assert_eq!(
        servos.set_frequency(at, ChipClock::Internal(26_600_000), 50),
        Ok(50)
    );
    assert_eq!(prescaler(), 129);
    servos.set_duties(at, 0, &[7]).unwrap();
    assert_eq!(
        servos.set_frequency(at, ChipClock::External(50_000_000), 50),
        Ok(50)
    );
    assert_eq!((prescaler(), bus.read8(0x4000)), (243, Ok(0x60)));
    assert_eq!(model.lock().unwrap().duty(0), Some(7));
    assert_eq!(
        servos.set_frequency(at, ChipClock::External(u32::MAX), u16::MAX),
        Ok(65535)
    );
    assert_eq!(servos.set_frequency(at, ChipClock::External(0), 0), Ok(0));
    // The external clock outlives the program, which is told so.
    for _ in 0..2 {
        let next: Arm = Switch::new(I2cBus::new(I2c(bus.clone())), NoInterrupts, Parts::new());
        next.start();
        let servos = next.open_typed(Parts::servos, 0, OpenMode::WRITE).unwrap();
        let refused = servos
            .set_frequency(at, ChipClock::NOMINAL, 50)
            .unwrap_err();
        assert_eq!(refused, ClockError::External);
        assert!(
            refused.to_string().contains("switch its power off and on"),
            "{refused}"
        );
        assert_eq!(
            servos.set_frequency(at, ChipClock::External(10_000_000), 50),
            Ok(50)
        );
        assert_eq!(prescaler(), 48);
    }
}

#[test]
fn the_address_of_all_chips_is_no_location() {
    // After power-on the chip answers there, and not once it is initialised.
    let bus = SimBus::new();
    bus.insert(0x4000, Pca9685Model::default());
    assert_eq!(bus.read8(0x7000), Ok(0x11));
    let parts =
        Switch::<_, _, _, 1>::new(I2cBus::new(I2c(bus.clone())), NoInterrupts, Parts::new());
    parts.start();
    assert!(bus.read8(0x7000).is_err());
    let refused = |place: fn()| std::panic::catch_unwind(place).is_err();
    assert!(refused(|| Unit::<Pca9685>::check(Location::i2c(0x70))));
    assert!(refused(|| Unit::<Pca9685>::check(Location::i2c_from(
        0x8000, 0x70
    ))));
    assert!(refused(|| Unit::<Pca9685>::check(Location::i2c(0x3f))));
    for address in (0x40..0x70).chain(0x71..0x78) {
        Unit::<Pca9685>::check(Location::i2c(address));
    }
    // A multiplexer may be at 0x70, and nothing at a reserved address.
    Unit::<As5600>::check(Location::i2c(0x70));
    for address in (0..8).chain(0x78..0x80) {
        assert!(std::panic::catch_unwind(|| Location::i2c(address)).is_err());
    }
}

device_switch! {
    struct Twice {
        servos: Pca9685 = [Location::i2c(0x71), Location::i2c(0x40)],
    }
}

#[test]
fn a_chip_that_is_found_by_another_address_is_one_board() {
    let bus = SimBus::new();
    bus.insert(0x4000, Pca9685Model::default());
    // A former program enabled the first sub-address.
    bus.write8(0x4000, 0x19).unwrap();
    let twice = Switch::<_, _, _, 1>::new(I2cBus::new(I2c(bus)), NoInterrupts, Twice::new());
    twice.start();
    assert_eq!(twice.inventory().to_string().matches("present").count(), 1);
    twice.open("servos", 1, OpenMode::WRITE).unwrap();
}

#[test]
fn a_sensor_forgets_what_a_former_program_set() {
    let bus = SimBus::new();
    let model = bus.insert(0x3600, As5600Model::default());
    // Ranges, a power mode and a watchdog; the upper bits have no name.
    bus.write_block(0x3601, &[0xfa, 0x00, 0x0e, 0x00, 0x51, 0x00, 0xff, 0xff])
        .unwrap();
    let arm: Arm = Switch::new(I2cBus::new(I2c(bus.clone())), NoInterrupts, Parts::new());
    arm.start();
    model.lock().unwrap().angle = 0xabc;
    let angle = arm.open_typed(Parts::angle, 0, OpenMode::READ).unwrap();
    assert_eq!(angle.angle(angle.registers), Ok(0xabc));
    let mut set = [0; 8];
    bus.read_block(0x3601, &mut set).unwrap();
    assert_eq!(set, [0xf0, 0, 0, 0, 0x50, 0, 0xc0, 0]);
}
