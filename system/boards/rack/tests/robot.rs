//! The boards as a robot of condor-robot has them: its channels, its registers, and which processor owns which board.

use condor_dev::Bus as _;
use condor_dev::sim::SimBus;
use condor_hand::config::{Channel, Converter};
use condor_robot::RobotDescription;
use condor_robot::boards::{BoardError, Boards, SimBoards};
use utah_mit_boards::robot::{
    Board, BoardSet, Rack, Socket, input_counts, input_register, output_counts, output_register,
    socket,
};
use utah_mit_boards::sim::AdcModel;

fn channel(converter: Converter, board: u8, channel: u8) -> Channel {
    Channel {
        converter,
        board,
        channel,
    }
}

#[test]
fn a_slot_has_two_boards_side_by_side() {
    let adc = |board, line| socket(channel(Converter::Adc, board, line));
    let at = |board, line| Some(Socket { board, line });
    assert_eq!(adc(0, 15), at(Board::Adc(0), 15));
    assert_eq!(adc(0, 16), at(Board::Adc(1), 0));
    assert_eq!(adc(1, 31), at(Board::Adc(3), 15));
    assert_eq!(adc(0, 32), None);
    assert_eq!(adc(2, 7), at(Board::Encoder, 7));
    assert_eq!(adc(2, 8), None);
    assert_eq!(adc(3, 0), None);
    let dac = |board, line| socket(channel(Converter::Dac, board, line));
    assert_eq!(dac(1, 2), at(Board::Dac(2), 2));
    assert_eq!(dac(255, 0), None);
}

#[test]
fn two_processors_that_write_one_board_are_named() {
    let text = include_str!("../../../../condor-hand/hands/utah-mit.toml");
    let mut hand = RobotDescription::from_toml(text, "utah-mit.toml").unwrap();
    assert_eq!(Rack::check(&hand), Ok(()));
    // The first tendon of the third finger, on the board of the second.
    hand.fingers[2].actuators[0].dac.board = 0;
    hand.fingers[2].actuators[0].dac.channel = 31;
    let refused = Rack::check(&hand).unwrap_err();
    assert!(matches!(refused, BoardError::Shared { board: 0 | 1, .. }));
    let text = refused.to_string();
    assert!(text.contains("processors 1 and 2"), "{text}");
    hand.fingers[0].joints[0].adc.as_mut().unwrap().channel = 40;
    assert!(matches!(
        Rack::check(&hand),
        Err(BoardError::NoChannel { .. })
    ));
    hand.fingers[0].joints[0].adc.as_mut().unwrap().channel = 0;
    hand.fingers[0].actuators[0].dac.bits = 16;
    assert!(matches!(
        Rack::check(&hand),
        Err(BoardError::Bits { bits: 16, .. })
    ));
}

#[test]
fn registers_and_counts_agree() {
    for zero in [0, 2048, 1 << 15] {
        for counts in [0, 1, zero, zero + 77, 2 * zero.max(1) - 1] {
            assert_eq!(output_counts(zero, output_register(zero, counts)), counts);
        }
        assert_eq!(output_register(zero, zero), 0);
    }
    for counts in [0, 4095, 65_535] {
        assert_eq!(input_counts(input_register(counts)), counts);
    }
}

#[test]
fn boards_are_told_apart_by_their_addresses() {
    let all = (0..4)
        .flat_map(|number| [Board::Adc(number), Board::Dac(number)])
        .chain([Board::Encoder]);
    for one in all.clone() {
        let mut boards = BoardSet::default();
        boards.insert(one);
        for other in all.clone() {
            assert_eq!(boards.contains(other), one == other);
        }
    }
    let mut boards = BoardSet::default();
    boards.insert(Board::Adc(4));
    assert_eq!(boards, BoardSet::default());
}

#[test]
fn a_timer_converts_ahead_of_the_middles_of_its_periods() {
    let bus = SimBus::new();
    bus.insert(0, AdcModel::default());
    let due = |since_ns, now_ns| Rack::is_due(&bus, 0, since_ns, now_ns).unwrap();
    assert!(due(0, 1), "all the time");
    let set = |rate_hz, ahead_us| {
        for (register, value) in [(8, rate_hz), (10, ahead_us), (2, 0x13)] {
            bus.write16(register, value).unwrap();
        }
    };
    set(400, 100);
    let day = 86_400_000_000_000;
    for begin in [0, day] {
        for middle in [1_250_000, 3_750_000, 999_998_750_000 - 5_000_000] {
            let at = begin + middle - 100_000;
            assert!(due(at - 1, at), "{at}");
            assert!(!due(at, at + 2_499_999), "{at}");
            assert!(due(at, at + 2_500_000), "{at}");
        }
    }
    // 300 Hz: a period of 10 000 000 / 3 ns.
    set(300, 0);
    assert!(!due(0, 1_666_666) && due(1_666_666, 1_666_667));
    set(0, u16::MAX);
    assert!(!due(0, u64::MAX));
}
