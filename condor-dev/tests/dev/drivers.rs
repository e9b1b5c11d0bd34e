//! What each driver that ships does with its board.

use std::num::NonZeroU16;

use crate::boards::*;
use condor_dev::drivers::{As5600, Format, LineErrors, Pca9685, Uart16550};
use condor_dev::sim::{LineFault, Model, SimBus, UartModel};
use condor_dev::{
    Bus as _, BusErrorKind, DeviceError, Driver, IoError, OpenMode, Registers, Width,
};
use utah_mit_boards::sim::{AdcModel, DacModel, EncoderModel, MppModel};
use utah_mit_boards::{Adc16, ConversionTrigger, Dac16, Encoder8, Mpp};

#[test]
fn probes_know_their_own_board_only() {
    let bus = SimBus::new();
    bus.insert(0x100, AdcModel::default());
    bus.insert(0x200, DacModel::default());
    bus.insert(0x300, EncoderModel::default());
    bus.insert(0x400, MppModel::default());
    bus.insert(0x500, UartModel::<1>::default());
    bus.insert(0x600, UartModel::<4>::default());
    for base in (0x100..0x800).step_by(0x100) {
        let found = [
            finds::<Adc16>(&bus, base),
            finds::<Dac16>(&bus, base),
            finds::<Encoder8>(&bus, base),
            finds::<Mpp>(&bus, base),
            finds::<Serial>(&bus, base),
            finds::<Serial4>(&bus, base),
        ];
        let expected: [bool; 6] = std::array::from_fn(|kind| base == 0x100 * (kind + 1));
        assert_eq!(found, expected, "at {base:#x}");
    }
}

#[test]
fn start_up_finds_all_and_lets_none_interrupt() {
    let machine = Machine::started();
    assert_eq!(
        machine.switch.inventory().to_string(),
        "device   board      address vector level  found\n\
         adc          0       0x1000     67     4  present\n\
         dac          0       0x2000      -     -  present\n\
         encoder      0       0x3000      -     -  present\n\
         mpp          0       0x4000     65     3  present\n\
         mpp          1       0x4100     65     3  present\n\
         uart         0       0x5000     66     2  present\n\
         uart4        0       0x5100     66     2  present\n"
    );
    outside(&machine.mpp[0]).strobe_in(1);
    outside(&machine.uart).receive(1, LineFault::None);
    assert!(!machine.controller.is_pending());
}

#[test]
fn conversions_are_started_by_what_was_chosen() {
    let machine = Machine::started();
    outside(&machine.adc).channels[3] = 5;
    let fd = machine.open("adc", OpenMode::READ);
    let adc = machine.switch.device(Boards::adc, fd).unwrap();
    let channel = || {
        let mut channels = [0; 4];
        adc.scan(adc.registers, &mut channels).map(|_| channels[3])
    };
    assert_eq!(channel(), Ok(5));
    for trigger in [ConversionTrigger::Command, ConversionTrigger::External] {
        adc.set_trigger(adc.registers, trigger).unwrap();
        assert_eq!(adc.is_ready(adc.registers), Ok(false));
        assert_eq!(machine.read(fd), Err(IoError::WouldBlock));
        assert_eq!(machine.switch.read_ready(fd), Ok(false));
        if trigger == ConversionTrigger::Command {
            adc.start(adc.registers).unwrap();
        }
        // Does nothing unless it was chosen.
        outside(&machine.adc).trigger();
        outside(&machine.adc).channels[3] = 6;
        outside(&machine.adc).complete();
        outside(&machine.adc).channels[3] = 7;
        assert_eq!(adc.is_ready(adc.registers), Ok(true));
        assert_eq!(channel(), Ok(6));
        assert_eq!(machine.read(fd).unwrap()[6..8], 6_i16.to_ne_bytes());
    }
    drop(adc);
    machine.switch.close(fd).unwrap();
    let again = machine.open("adc", OpenMode::READ);
    assert_eq!(machine.switch.read_ready(again), Ok(true));
}

#[test]
fn outputs_change_together_and_rest_when_closed() {
    let machine = Machine::started();
    let outputs = || outside(&machine.dac).outputs();
    let fd = machine.open("dac", OpenMode::WRITE);
    assert!(outside(&machine.dac).is_connected());
    let dac = machine.switch.device(Boards::dac, fd).unwrap();
    let mut all = [0_i16; 16];
    all.iter_mut()
        .zip(-8..)
        .for_each(|(value, number)| *value = number);
    dac.write_all(dac.registers, &all).unwrap();
    assert_eq!(outputs(), all);
    dac.write_channels(dac.registers, 14, &[100, 101]).unwrap();
    assert_eq!(outputs()[13..], [5, 100, 101]);
    for failing in 0..3 {
        machine.bus.fail_after(failing);
        assert!(dac.write_channels(dac.registers, 0, &[-1, -2]).is_err());
        assert_eq!(outputs()[..2], [-8, -7], "none of them, or all");
    }
    let too_many = Err(DeviceError::Length { bytes: 4, unit: 2 });
    assert_eq!(dac.write_channels(dac.registers, 15, &[0, 0]), too_many);
    assert_eq!(
        dac.write_channels(dac.registers, usize::MAX, &[0, 0]),
        too_many
    );
    assert_eq!(dac.write_channels(dac.registers, 16, &[]), Ok(()));
    drop(dac);
    let bytes: Vec<u8> = [1_i16, 2].into_iter().flat_map(i16::to_ne_bytes).collect();
    assert_eq!(machine.switch.write(fd, &bytes), Ok(4));
    assert_eq!(outputs()[..3], [1, 2, -6]);
    let one = machine.switch.write(fd, &[0]);
    assert_eq!(one, Err(IoError::Length { bytes: 1, unit: 2 }));
    machine.switch.close(fd).unwrap();
    assert!(!outside(&machine.dac).is_connected());
    machine.open("dac", OpenMode::WRITE);
    assert_eq!(outputs(), [0; 16]);
}

#[test]
fn outputs_come_to_rest_whatever_access_fails() {
    for failing in 0..18 {
        let machine = Machine::started();
        let fd = machine.open("dac", OpenMode::WRITE);
        let dac = machine.switch.device(Boards::dac, fd).unwrap();
        dac.write_all(dac.registers, &[1000; 16]).unwrap();
        drop(dac);
        machine.bus.fail_after(failing);
        assert!(machine.switch.close(fd).is_err());
        assert_eq!(outside(&machine.dac).outputs(), [0; 16]);
    }
}

#[test]
fn counts_are_of_one_instant_and_wrap() {
    let machine = Machine::started();
    let fd = machine.open("encoder", OpenMode::READ);
    let encoder = machine.switch.device(Boards::encoder, fd).unwrap();
    outside(&machine.encoder).turn(7, i32::MAX);
    let mut last = [0; 8];
    assert_eq!(
        encoder
            .scan_differences(encoder.registers, &mut last)
            .unwrap()[7],
        i32::MAX
    );
    outside(&machine.encoder).turn(7, 3);
    outside(&machine.encoder).turn(0, -2);
    for failing in 0..9 {
        machine.bus.fail_after(failing);
        assert!(
            encoder
                .scan_differences(encoder.registers, &mut last)
                .is_err()
        );
    }
    let moved = encoder
        .scan_differences(encoder.registers, &mut last)
        .unwrap();
    assert_eq!(moved, [-2, 0, 0, 0, 0, 0, 0, 3]);
    assert_eq!(last[7], i32::MIN + 2);
    let bytes = machine.read(fd).unwrap();
    assert_eq!(bytes.len(), 32);
    assert_eq!(bytes[..4], (-2_i32).to_ne_bytes());
    let short = machine.switch.read(fd, &mut [0; 3]);
    assert_eq!(short, Err(IoError::Length { bytes: 3, unit: 4 }));
    assert_eq!(machine.switch.read(fd, &mut [0; 9]), Ok(8));
}

#[test]
fn counters_are_zeroed_now_or_by_their_index() {
    let machine = Machine::started();
    let fd = machine.open("encoder", OpenMode::READ);
    let encoder = machine.switch.device(Boards::encoder, fd).unwrap();
    let turn = |pulses| (0..4).for_each(|number| outside(&machine.encoder).turn(number, pulses));
    let counts = || {
        let mut counts = [0; 4];
        encoder.scan(encoder.registers, &mut counts).map(|_| counts)
    };
    turn(10);
    encoder.zero(encoder.registers, 0b0001).unwrap();
    encoder.zero_at_index(encoder.registers, 0b0010).unwrap();
    (1..4).for_each(|number| outside(&machine.encoder).index(number));
    turn(1);
    assert_eq!(counts(), Ok([1, 1, 11, 11]));
    outside(&machine.encoder).index(1);
    assert_eq!(counts(), Ok([1, 1, 11, 11]), "only the next index zeroes");
    machine.bus.fail_after(1);
    assert!(encoder.take_index(encoder.registers).is_err());
    assert_eq!(
        encoder.take_index(encoder.registers),
        Ok(0b1110),
        "none was lost"
    );
    assert_eq!(encoder.take_index(encoder.registers), Ok(0));
    outside(&machine.encoder).miss(5);
    assert_eq!(encoder.take_missed(encoder.registers), Ok(1 << 5));
    assert_eq!(encoder.take_missed(encoder.registers), Ok(0));
}

#[test]
fn a_parallel_port_moves_bytes_by_interrupt() {
    let machine = Machine::started();
    let fd = machine.open(":mpp", BOTH);
    assert_eq!(machine.read(fd), Err(IoError::WouldBlock));
    let mut expected = Vec::new();
    for byte in 0..10 {
        outside(&machine.mpp[0]).strobe_in(byte);
        expected.push(byte);
    }
    assert!(machine.controller.is_pending());
    machine.interrupts();
    assert!(!machine.controller.is_pending());
    assert_eq!(machine.switch.read_ready(fd), Ok(true));
    assert_eq!(machine.read(fd), Ok(expected));
    assert_eq!(machine.switch.read_ready(fd), Ok(false));
    // The board has room for 16 bytes until the other side takes them.
    assert_eq!(machine.switch.write(fd, &[7; 20]), Ok(16));
    assert_eq!(machine.switch.write(fd, &[7]), Err(IoError::WouldBlock));
    assert_eq!(machine.switch.write_ready(fd), Ok(false));
    assert_eq!(outside(&machine.mpp[0]).strobed.drain(..).count(), 16);
    assert_eq!(machine.switch.write_ready(fd), Ok(true));
}

#[test]
fn a_full_buffer_leaves_bytes_on_the_board() {
    let machine = Machine::started();
    let fd = machine.open("mpp", BOTH);
    let mpp = machine.switch.device(Boards::mpp, fd).unwrap();
    let (mut strobed, mut refused) = (Vec::new(), 0);
    for byte in (0..300_u16).map(|number| number as u8) {
        if outside(&machine.mpp[0]).strobe_in(byte) {
            strobed.push(byte);
        } else {
            refused += 1;
        }
        machine.interrupts();
    }
    assert_eq!(refused, 300 - 256 - 16);
    assert_eq!(machine.switch.interrupt_counts().stuck, 0);
    let mut read = Vec::new();
    while let Ok(bytes) = machine.read(fd) {
        read.extend(bytes);
        machine.interrupts();
    }
    assert_eq!(read, strobed);
    assert_eq!(mpp.overruns(), 1);
}

#[test]
fn a_parallel_port_in_raw_mode_shows_its_lines() {
    let machine = Machine::started();
    let fd = machine.open("mpp", BOTH);
    let mpp = machine.switch.device(Boards::mpp, fd).unwrap();
    mpp.reset(mpp.registers).unwrap();
    machine.bus.fail_after(0);
    assert!(mpp.config_16bit_raw(mpp.registers).is_err());
    assert_eq!(machine.read(fd), Err(IoError::WouldBlock), "still bytes");
    mpp.config_16bit_raw(mpp.registers).unwrap();
    assert!(outside(&machine.mpp[0]).is_raw());
    outside(&machine.mpp[0]).samples.extend([0x1234, 0xabcd]);
    assert_eq!(mpp.read_16bits(mpp.registers), Ok(0x1234));
    assert_eq!(mpp.read_16bits(mpp.registers), Ok(0xabcd));
    mpp.write_16bits(mpp.registers, 0x55aa).unwrap();
    assert_eq!(outside(&machine.mpp[0]).outputs(), 0x55aa);
    outside(&machine.mpp[0]).samples.extend([1, 2]);
    // The second word fails: the first has been read all the same.
    machine.bus.fail_after(1);
    let mut bytes = [0; 5];
    assert_eq!(machine.switch.read(fd, &mut bytes), Ok(2));
    assert_eq!(bytes[..2], 1_u16.to_ne_bytes());
    assert_eq!(machine.switch.read(fd, &mut bytes[..2]), Ok(2));
    assert_eq!(bytes[..2], 2_u16.to_ne_bytes());
    let one = machine.switch.read(fd, &mut bytes[..1]);
    assert_eq!(one, Err(IoError::Length { bytes: 1, unit: 2 }));
    assert_eq!(machine.switch.write(fd, &0x0102_u16.to_ne_bytes()), Ok(2));
    assert_eq!(outside(&machine.mpp[0]).outputs(), 0x0102);
    mpp.config_8bit(mpp.registers).unwrap();
    assert_eq!(machine.read(fd), Err(IoError::WouldBlock));
}

#[test]
fn boards_without_interrupt_are_polled() {
    let machine = Machine::started();
    let mpp = machine.open("mpp", BOTH);
    let uart = machine.open("uart", BOTH);
    outside(&machine.mpp[0]).strobe_in(8);
    outside(&machine.uart).receive(9, LineFault::None);
    assert_eq!(machine.switch.write(uart, b"x"), Ok(1));
    let device = machine.switch.device(Boards::mpp, mpp).unwrap();
    device.poll(device.registers).unwrap();
    let device = machine.switch.device(Boards::uart, uart).unwrap();
    device.poll(device.registers).unwrap();
    assert_eq!(machine.read(mpp), Ok(vec![8]));
    assert_eq!(machine.read(uart), Ok(vec![9]));
    assert_eq!(outside(&machine.uart).transmit(), Some(b'x'));
}

#[test]
fn a_serial_port_sends_and_receives_by_interrupt() {
    let machine = Machine::started();
    let fd = machine.open("uart4", BOTH);
    let bytes: Vec<u8> = (0..100).collect();
    let (mut sent, mut received, mut accepted) = (Vec::new(), Vec::new(), 0);
    while sent.len() < bytes.len() {
        if let Ok(count) = machine.switch.write(fd, &bytes[accepted..]) {
            accepted += count;
        }
        machine.interrupts();
        assert_eq!(machine.switch.is_flushed(fd), Ok(false));
        let byte = outside(&machine.uart4)
            .transmit()
            .expect("it does not stall");
        outside(&machine.uart4).receive(byte, LineFault::None);
        sent.push(byte);
        machine.interrupts();
        if let Ok(bytes) = machine.read(fd) {
            received.extend(bytes);
        }
    }
    assert_eq!((&sent, &received), (&bytes, &bytes));
    assert_eq!(machine.switch.is_flushed(fd), Ok(true));
    // With nothing to send it is silent.
    machine.interrupts();
    assert!(!machine.controller.is_pending());
    machine.switch.close(fd).unwrap();
    outside(&machine.uart4).receive(1, LineFault::None);
    assert!(!machine.controller.is_pending());
    let fd = machine.open("uart4", BOTH);
    machine.interrupts();
    assert_eq!(
        machine.read(fd),
        Err(IoError::WouldBlock),
        "of a former incarnation"
    );
}

#[test]
fn a_serial_port_without_fifos_sends_byte_by_byte() {
    let machine = Machine::new();
    outside(&machine.uart).has_fifos = false;
    machine.switch.start();
    let fd = machine.open("uart", BOTH);
    assert_eq!(machine.switch.write(fd, b"memo"), Ok(4));
    let mut sent = Vec::new();
    for _ in 0..4 {
        machine.interrupts();
        sent.extend(outside(&machine.uart).transmit());
    }
    assert_eq!(sent, b"memo");
}

#[test]
fn errors_of_the_line_are_counted_and_lose_nothing() {
    let machine = Machine::started();
    let fd = machine.open("uart", BOTH);
    let uart = machine.switch.device(Boards::uart, fd).unwrap();
    let faults = [
        LineFault::None,
        LineFault::Parity,
        LineFault::Framing,
        LineFault::Break,
        LineFault::Framing,
    ];
    for (byte, fault) in (1..).zip(faults) {
        outside(&machine.uart).receive(byte, fault);
    }
    machine.interrupts();
    assert_eq!(machine.read(fd), Ok(vec![1, 2, 3, 4, 5]));
    let expected = LineErrors {
        parity: 1,
        framing: 2,
        breaks: 1,
        overruns: 0,
    };
    assert_eq!(uart.line_errors(), expected);
    for byte in 0..18 {
        outside(&machine.uart).receive(byte, LineFault::None);
    }
    machine.interrupts();
    assert_eq!(machine.read(fd).unwrap().len(), 16);
    assert_eq!(uart.line_errors().overruns, 1);
}

#[test]
fn a_full_receive_buffer_leaves_bytes_in_the_fifo() {
    let machine = Machine::started();
    let fd = machine.open("uart", BOTH);
    let mut received = Vec::new();
    for byte in 0..100 {
        if outside(&machine.uart).receive(byte, LineFault::None) {
            received.push(byte);
        }
        machine.interrupts();
    }
    assert_eq!(received.len(), 32 + 16);
    assert!(!machine.controller.is_pending(), "it does not ask in vain");
    let mut read = Vec::new();
    while let Ok(bytes) = machine.read(fd) {
        read.extend(bytes);
        machine.interrupts();
    }
    assert_eq!(read, received);
}

#[test]
fn the_speed_is_set_whatever_access_fails() {
    let machine = Machine::started();
    let fd = machine.open("uart", BOTH);
    let uart = machine.switch.device(Boards::uart, fd).unwrap();
    let divisor = NonZeroU16::new(0x0203).unwrap();
    let format = Format::SEVEN_BITS.even().two_stop_bits();
    for failing in 0..4 {
        machine.bus.fail_after(failing);
        assert!(uart.configure(uart.registers, divisor, format).is_err());
        outside(&machine.uart).receive(77, LineFault::None);
        machine.interrupts();
        assert_eq!(machine.read(fd), Ok(vec![77]), "{failing}");
    }
    uart.configure(uart.registers, divisor, format).unwrap();
    assert_eq!(outside(&machine.uart).divisor(), 0x0203);
}

#[test]
fn boards_that_share_a_vector_are_all_served() {
    let machine = Machine::started();
    let fds = [0, 1].map(|board| machine.switch.open("mpp", board, BOTH).unwrap());
    for round in 0..20 {
        outside(&machine.mpp[0]).strobe_in(round);
        outside(&machine.mpp[1]).strobe_in(100 + round);
        machine.interrupts();
        assert_eq!(machine.read(fds[0]), Ok(vec![round]));
        assert_eq!(machine.read(fds[1]), Ok(vec![100 + round]));
    }
    let serial = ["uart", "uart4"].map(|name| machine.open(name, BOTH));
    outside(&machine.uart).receive(1, LineFault::None);
    outside(&machine.uart4).receive(2, LineFault::None);
    machine.interrupts();
    assert_eq!(machine.read(serial[0]), Ok(vec![1]));
    assert_eq!(machine.read(serial[1]), Ok(vec![2]));
    assert_eq!(machine.switch.interrupt_counts().unclaimed, 0);
    // One of the two is gone: the other one goes on.
    machine.bus.remove(MPP[0]);
    outside(&machine.mpp[1]).strobe_in(9);
    machine.interrupts();
    assert_eq!(machine.read(fds[1]), Ok(vec![9]));
    let gone = machine.switch.write(fds[0], &[1]);
    assert!(matches!(gone, Err(IoError::Bus(error)) if error.kind == BusErrorKind::NoAnswer));
}

#[test]
fn a_stuck_board_does_not_hang_the_processor() {
    for stick in [
        (|machine: &Machine| outside(&machine.mpp[1]).stuck = true) as fn(&Machine),
        |machine| outside(&machine.uart).stuck = true,
    ] {
        let machine = Machine::started();
        let fd = machine.switch.open("mpp", 1, BOTH).unwrap();
        machine.open("uart", BOTH);
        stick(&machine);
        let before = machine.bus.accesses();
        machine.switch.on_interrupt();
        assert_eq!(machine.switch.interrupt_counts().stuck, 1);
        assert!(machine.bus.accesses() - before < 1000);
        // What was stuck can still be polled.
        outside(&machine.mpp[1]).strobe_in(3);
        let mpp = machine.switch.device(Boards::mpp, fd).unwrap();
        mpp.poll(mpp.registers).unwrap();
        assert_eq!(machine.read(fd), Ok(vec![3]));
    }
}

#[test]
fn a_board_that_fails_in_start_up_is_tried_again() {
    let accesses = {
        let machine = Machine::new();
        machine.switch.start();
        machine.bus.accesses()
    };
    for failing in 0..accesses {
        let machine = Machine::new();
        machine.bus.fail_after(failing);
        machine.switch.start();
        let found = machine.switch.inventory().to_string();
        let missing = found.matches("absent").count() + found.matches("not initialised").count();
        assert_eq!(missing, 1, "access {failing}");
        machine.switch.start();
        let found = machine.switch.inventory().to_string();
        assert_eq!(found.matches("present").count(), 7, "access {failing}");
        assert!(!machine.controller.is_pending());
    }
}

/// Eight registers, all with the same bits, that count what is written.
struct Plain(u8, usize);

impl Model for Plain {
    fn size(&self) -> usize {
        8
    }

    fn read(&mut self, _: usize, _: Width) -> Option<u32> {
        Some(self.0.into())
    }

    fn write(&mut self, _: usize, _: Width, _: u32) -> Option<()> {
        self.1 += 1;
        Some(())
    }
}

#[test]
fn a_probe_writes_nothing() {
    let bus = SimBus::new();
    for byte in 0..=u8::MAX {
        let plain = bus.insert(0x100, Plain(byte, 0));
        let found = [
            finds::<Adc16>(&bus, 0x100),
            finds::<Dac16>(&bus, 0x100),
            finds::<Encoder8>(&bus, 0x100),
            finds::<Mpp>(&bus, 0x100),
            finds::<Pca9685>(&bus, 0x100),
            finds::<As5600>(&bus, 0x100),
        ];
        assert_eq!(found, [false; 6], "{byte:#x}");
        let _ = finds::<Serial>(&bus, 0x100);
        assert_eq!(outside(&plain).1, 0, "{byte:#x}");
    }
    for nothing in [0, u8::MAX] {
        bus.insert(0x100, Plain(nothing, 0));
        assert!(!finds::<Serial>(&bus, 0x100));
    }
    // Neither does one that finds its board.
    let uart = bus.insert(0x100, UartModel::<1>::default());
    bus.write8(0x107, 0x77).unwrap();
    let accesses = bus.accesses();
    assert!(finds::<Serial>(&bus, 0x100));
    assert!(bus.accesses() > accesses);
    assert_eq!(outside(&uart).read(7, Width::Bits8), Some(0x77));
}

#[test]
fn a_serial_port_forgets_what_a_former_program_set() {
    let bus = SimBus::new();
    let uart = bus.insert(0x100, UartModel::<1>::default());
    // Everything interrupts, seven bits behind the divisor, a loop-back, and a byte in the FIFO.
    for (register, byte) in [
        (1, 0x0f),
        (2, 0x01),
        (3, 0x82),
        (0, 0x34),
        (1, 0x12),
        (4, 0x10),
    ] {
        bus.write8(0x100 + register, byte).unwrap();
    }
    outside(&uart).receive(1, LineFault::None);
    let driver = Uart16550::<1, 32, 13>::NEW;
    let at = Registers::new(&bus, 0x100);
    assert!(Uart16550::<1, 32, 13>::probe(at));
    driver.init(at).unwrap();
    let registers = [1, 3, 4].map(|register| bus.read8(0x100 + register).unwrap());
    assert_eq!(registers, [0, 0x03, 0x0b]);
    assert_eq!(bus.read8(0x105), Ok(0x60), "the FIFOs are empty");
    assert_eq!(outside(&uart).divisor(), 13);
}
