//! The parts on I2C, on simulated registers through the adapter, and on the kernel's where it has some.

use std::sync::{Arc, Mutex};

use condor_dev::drivers::{As5600, Magnet, Pca9685};
use condor_dev::sim::{As5600Model, Bus, I2c, Pca9685Model};
use condor_dev::{
    Bus as _, BusErrorKind, DeviceError, I2cBus, Location, Mode, NoInterrupts, OpenError, Presence,
    Registers, Switch, device_switch,
};

device_switch! {
    struct Parts {
        servos: Pca9685 = [Location::i2c(0x40), Location::i2c(0x41)],
        angle: As5600 = [Location::i2c(As5600::ADDRESS)],
    }
}

type Arm = Switch<I2cBus<I2c<Bus>>, NoInterrupts, Parts, 4>;

fn arm() -> (Bus, Arm, Arc<Mutex<Pca9685Model>>, Arc<Mutex<As5600Model>>) {
    let bus = Bus::new();
    let servos = bus.insert(0x4000, Pca9685Model::default());
    let angle = bus.insert(0x3600, As5600Model::default());
    let arm = Switch::new(I2cBus::new(I2c(bus.clone())), NoInterrupts, Parts::new());
    arm.start();
    (bus, arm, servos, angle)
}

#[test]
fn the_parts_that_acknowledge_are_found() {
    let (bus, arm, ..) = arm();
    let absent = arm.open("servos", 1, Mode::WRITE).unwrap_err();
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
    assert_eq!(other.inventory().to_string().matches("Present").count(), 2);
}

#[test]
fn outputs_are_on_for_what_was_written_and_off_when_closed() {
    let (_, arm, model, _) = arm();
    let duty = |channel| model.lock().unwrap().duty(channel);
    assert_eq!(duty(0), None);
    let servos = arm.open_typed(Parts::servos, 0, Mode::WRITE).unwrap();
    let at = servos.registers;
    assert_eq!(servos.set_frequency(at, 50), Ok(50));
    assert_eq!(model.lock().unwrap().prescaler(), 121);
    assert_eq!(duty(15), Some(0));
    assert_eq!(servos.set_duties(at, 14, &[307, 4096]), Ok(()));
    assert_eq!(
        [duty(13), duty(14), duty(15)],
        [Some(0), Some(307), Some(4096)]
    );
    // Outputs that are on go on when the frequency has changed.
    assert_eq!(servos.set_frequency(at, 1000), Ok(1017));
    assert_eq!(duty(14), Some(307));
    for (hertz, found, prescaler) in [(1, 24, 255), (u16::MAX, 1526, 3)] {
        assert_eq!(servos.set_frequency(at, hertz), Ok(found));
        assert_eq!(model.lock().unwrap().prescaler(), prescaler);
    }
    let all: Vec<u8> = (0..16_u16).flat_map(|n| (n * 10).to_ne_bytes()).collect();
    assert_eq!(arm.write(servos.fd(), &all), Ok(32));
    assert!((0..16).all(|channel| duty(channel) == Some(channel as u16 * 10)));
    let beyond = Err(DeviceError::Length { bytes: 4, unit: 2 });
    assert_eq!(servos.set_duties(at, 15, &[0; 2]), beyond);
    servos.close().unwrap();
    let again = arm.open_typed(Parts::servos, 0, Mode::WRITE).unwrap();
    assert!((0..16).all(|channel| duty(channel) == Some(0)));
    drop(again);
}

#[test]
fn outputs_recover_from_an_error_of_the_bus_at_any_access() {
    for failing in 0..300 {
        let (bus, arm, model, _) = arm();
        let servos = arm.open_typed(Parts::servos, 0, Mode::WRITE).unwrap();
        let at = servos.registers;
        servos.set_duties(at, 0, &[1; 16]).unwrap();
        bus.fail_after(failing);
        let _ = servos.set_frequency(at, 60);
        let _ = servos.set_duties(at, 0, &[2; 16]);
        let rest = bus.accesses();
        // What failed is made again.
        while bus.accesses() < rest + failing {
            let _ = at.read8(0);
        }
        assert_eq!(servos.set_frequency(at, 60), Ok(60));
        assert_eq!(servos.set_duties(at, 0, &[3; 16]), Ok(()));
        assert!((0..16).all(|channel| model.lock().unwrap().duty(channel) == Some(3)));
    }
}

#[test]
fn an_angle_is_read_raw_and_in_its_range() {
    let (_, arm, _, model) = arm();
    let angle = arm.open_typed(Parts::angle, 0, Mode::READ).unwrap();
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
    let angle = arm.open_typed(Parts::angle, 0, Mode::READ).unwrap();
    bus.remove(0x3600);
    let error = angle.angle(angle.registers).unwrap_err();
    assert_eq!(error.kind, BusErrorKind::NoAnswer);
    assert_eq!(
        Registers::new(&I2cBus::new(I2c(bus)), 0x4000).read8(0),
        Ok(0x30)
    );
}
