//! What a servo processor was given, given again: the same outputs to the last bit.

use std::fs;
use std::path::Path;
use std::sync::Mutex;

use condor_dev::Bus;
use condor_fs::server::{FileServer, ServerOptions};
use condor_hand::grasp::distributed::{GraspOrder, GraspState};
use condor_hand::servo::{JointTarget, ServoMode};
use condor_hand::trajectory::StopGuard;
use condor_mbox::{MemoryWindow, Processor, Region, StoreOrder};
use condor_mcap::MessageHead;
use condor_robot::objects;
use condor_robot::plant::PlantRequest;
use condor_robot::recording::{OUTPUTS, ServoOutputs};
use condor_robot::replay::Replay;
use condor_robot::table::TableRequest;
use condor_rt::objects::ObjectKind;
use condor_rt::sim::VirtualSystem;
use condor_rt::{Machine, Program, numbers};
use condor_vars::AnyValue;
use utah_mit_boards::robot::{Board, address, output_counts, socket, zero_of};

use crate::rig::{
    FIRST, Master, Posture, SOON, TWO, WINDOW_BYTES, console, files, run_on, serve_files,
};

const READY: Posture = [[0.0, 0.6, 0.8, 0.7]; 4];
const TICKS: u32 = 900;
/// Where a digital-to-analog board has the register of its first channel.
const CHANNELS: usize = 0x20;

/// The recording that every target is given, and the hash of what comes of it.
const SHIPPED: &[u8] = include_bytes!("../data/servo.mcap");
const HASH: u64 = 0xdbdb_41bd_63fe_b575;

/// What a digital-to-analog converter was given: tick, and its counts.
type Seen = (usize, [u16; OUTPUTS]);

/// What the registers of the first servo processor's outputs hold, and since which of its ticks.
fn registers(master: &Master<'_>) -> Seen {
    let region = master.region(FIRST);
    let joints = objects::joints(&region).unwrap().unwrap();
    let joints = joints.subscriber(&region).unwrap().read().unwrap().value;
    let hand = &master.hand;
    let mut counts = [0; OUTPUTS];
    let fingers = hand
        .fingers
        .iter()
        .filter(|finger| finger.processor() == Some(FIRST.0));
    let actuators = fingers.flat_map(|finger| &finger.actuators);
    let outputs = actuators.map(|actuator| &actuator.dac);
    for (place, output) in counts.iter_mut().zip(outputs) {
        let at = socket(output.channel()).unwrap();
        let Board::Dac(board) = at.board else {
            panic!("{at:?}")
        };
        let at = address::DAC[usize::from(board)] + CHANNELS + 2 * usize::from(at.line);
        let register = master.machine.bus().read16(at).unwrap().cast_signed();
        *place = output_counts(zero_of(output), register) as u16;
    }
    (usize::try_from(joints.ticks).unwrap() - 1, counts)
}

/// Something of everything that a servo processor can be given, within 2.2 s.
fn script(master: &mut Master<'_>, seen: &mut Vec<Seen>) {
    master.wait_for_all();
    // The table begins to move, and the palm with it.
    let speed = 0.6;
    let home = TableRequest::Home { speed };
    assert!(master.ask_table(&home).is_ok());
    master.enable();
    master.hold(0.1);
    master.go(0.5, READY);
    seen.push(registers(master));
    let to = [0.05, -0.05, 0.04];
    let go = TableRequest::Move { to, speed };
    assert!(master.ask_table(&go).is_ok());
    // A guard stops a finger on its way, which catches up then.
    master.guards[1] = [StopGuard {
        motion: 3,
        torque: 0.0,
        ..StopGuard::NONE
    }; 4];
    master.go(0.06, READY.map(|finger| finger.map(|joint| joint + 0.05)));
    let region = master.region(FIRST);
    let stops = objects::stops(&region).unwrap().unwrap();
    let stops = stops.subscriber(&region).unwrap().read().unwrap().value;
    assert_eq!((stops.motion[1], stops.motion[0]), ([3; 4], [0; 4]));
    master.guards[1] = [StopGuard::NONE; 4];
    // Other modes, targets and gains.
    master.client(FIRST, |client| {
        client.set_effort(0, 0, (0, 12.0), SOON).unwrap();
        client.set_effort(0, 0, (1, 9.0), SOON).unwrap();
        client
            .set_target(1, 3, &JointTarget::Torque(0.05), SOON)
            .unwrap();
    });
    for (name, value) in [
        ("servo.kp", 2.0),
        ("servo.ki", 1.0),
        ("stop.zone", 0.1),
        ("servo.velocity_cutoff_hz", 120.0),
    ] {
        let name = format!("middle.middle.{name}");
        master.set(FIRST, &name, AnyValue::F64(value));
    }
    for (name, value) in [("gains.kp", 0.8), ("faults.above", 170.0)] {
        let name = format!("middle.middle-flexor.{name}");
        master.set(FIRST, &name, AnyValue::F64(value));
    }
    master.set(FIRST, "faults.tracking_rad", AnyValue::F64(0.5));
    master.set(FIRST, "middle.middle.servo.law", AnyValue::Choice(0));
    master.stay(0.06);
    seen.push(registers(master));
    master.client(FIRST, |client| {
        client
            .enable(0, Some(0), ServoMode::Position, SOON)
            .unwrap();
        client
            .enable(1, Some(3), ServoMode::Position, SOON)
            .unwrap();
    });
    // A grasp of air, and another that the law refuses.
    let stiffness = [200.0, 250.0, 150.0, 0.1, 0.1, 0.1];
    let damping = [4.0, 4.0, 4.0, 2e-3, 2e-3, 2e-3];
    let mut order = GraspOrder::hold(0b1101, master.tips(), stiffness, damping);
    order.ramp_s = 1.0;
    order.squeeze_n = 0.5;
    master.grasp(&order);
    master.hold(0.06);
    let report = master.report(FIRST);
    assert_eq!(report.state, GraspState::Holding, "{:?}", report.reason);
    seen.push(registers(master));
    order.fingers = 0b1;
    master.grasp(&order);
    master.hold(0.04);
    master.grasp(&GraspOrder::RELEASE);
    master.hold(0.06);
    assert_eq!(master.report(FIRST).state, GraspState::Idle);
    // A finger fails, and is whole again.
    let broken = PlantRequest::CutDrive {
        finger: 1,
        actuator: 2,
    };
    assert_eq!(master.ask_plant(&broken), Ok(()));
    master.hold(0.16);
    let status =
        |master: &Master<'_>| master.client(FIRST, |client| client.status(1, SOON).unwrap());
    assert!(status(master).fault.is_some());
    seen.push(registers(master));
    assert_eq!(master.ask_plant(&PlantRequest::Mend), Ok(()));
    master.hold(0.5);
    master.client(FIRST, |client| client.restart(1, SOON).unwrap());
    master.hold(0.04);
    assert!(status(master).fault.is_none());
    seen.push(registers(master));
    master.enable();
    master.hold(0.1);
    // Until all that was recorded is in the file.
    master.hold(0.6);
}

/// Records the script into `files`; gives what the converters had now and then.
fn record(files: &Path, ticks: u32) -> (Vec<Seen>, String) {
    let mut seen = Vec::new();
    let arguments = ["record=servo.mcap", &format!("ticks={ticks}")];
    let run = run_on(files, TWO, &arguments, None, 4.0, None, |master| {
        script(master, &mut seen);
    });
    (seen, run.said[0].clone())
}

/// Replays `servo.mcap` of `files` on a processor; gives what it said, or why it failed.
fn replay(files: &Path, number: u8) -> Result<String, String> {
    let server = FileServer::new(files, ServerOptions::default()).unwrap();
    let said = Mutex::new(String::new());
    let mut system = VirtualSystem::new(WINDOW_BYTES).unwrap();
    let number = Processor(number);
    system
        .arguments(number, ["from=servo.mcap", "to=servo.out"])
        .unwrap();
    system
        .host(numbers::FILES, |machine| {
            serve_files(machine, &server, u64::MAX)
        })
        .unwrap();
    system
        .host(number, |machine| {
            let outcome = Replay.run(machine);
            let data = machine.windows()[number.index()].data.clone();
            *said.lock().unwrap() = console(&Region::users(data).unwrap());
            outcome
        })
        .unwrap();
    let outcome = system.run_until(10_000_000_000);
    let said = said.into_inner().unwrap();
    outcome.map(|_| said).map_err(|error| error.to_string())
}

/// The FNV-1a of 64 bits.
fn hash(bytes: &[u8]) -> u64 {
    let step = |hash: u64, byte: &u8| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, step)
}

/// The outputs of a replay.
fn outputs(files: &Path) -> Vec<ServoOutputs> {
    let bytes = fs::read(files.join("servo.out")).unwrap();
    let (outputs, rest) = bytes.as_chunks::<{ size_of::<ServoOutputs>() }>();
    assert!(rest.is_empty());
    outputs
        .iter()
        .map(|bytes| zerocopy::transmute!(*bytes))
        .collect()
}

#[test]
fn what_is_replayed_is_what_was_put_out() {
    let files = files();
    let files = files.path();
    let (seen, said) = record(files, TICKS);
    assert!(
        said.contains(&format!("recorded {TICKS} ticks in servo.mcap\r\n")),
        "{said}"
    );
    assert!(!said.contains("broken"), "{said}");

    let said = replay(files, 1).unwrap();
    let first = fs::read(files.join("servo.out")).unwrap();
    let told = format!(
        "replayed {TICKS} ticks of processor 1: hash of the outputs {:016x}\r\n",
        hash(&first)
    );
    assert_eq!(said, told);
    // On another processor, and from the start again.
    assert_eq!(replay(files, 5).unwrap(), told);
    assert!(fs::read(files.join("servo.out")).unwrap() == first);

    let outputs = outputs(files);
    assert_eq!(outputs.len(), TICKS as usize);
    assert_eq!(seen.len(), 5);
    for (tick, counts) in seen {
        assert_eq!(outputs[tick].counts, counts, "tick {tick}");
    }
    // The fingers did not just lie there.
    let most = outputs
        .iter()
        .flat_map(|output| output.command)
        .fold(0.0, f64::max);
    assert!(most > 20.0, "{most} N");
}

#[test]
fn the_shipped_recording_has_the_same_outputs_everywhere() {
    let files = files();
    fs::write(files.path().join("servo.mcap"), SHIPPED).unwrap();
    let said = replay(files.path(), 0).unwrap();
    let told =
        format!("replayed {TICKS} ticks of processor 1: hash of the outputs {HASH:016x}\r\n");
    assert_eq!(said, told);
}

/// Bytes of a record before the data of a message.
const HEAD: usize = MessageHead::HEAD_BYTES;

/// Where the data of the messages of a channel begin in a recording.
fn all(recording: &[u8], channel: u8) -> impl Iterator<Item = usize> {
    let mut next = 8;
    let records = std::iter::from_fn(move || {
        let at = next;
        let length = recording.get(at + 1..at + 9)?;
        next += 9 + usize::try_from(u64::from_le_bytes(length.try_into().unwrap())).unwrap();
        Some(at)
    });
    let of_channel = move |&at: &usize| recording[at] == 5 && recording[at + 9] == channel;
    records.filter(of_channel).map(|at| at + HEAD)
}

/// Where the data of the first message of a channel begin.
fn first(recording: &[u8], channel: u8) -> usize {
    all(recording, channel).next().unwrap()
}

#[test]
fn the_smallest_change_is_found() {
    let files = files();
    let path = files.path().join("servo.mcap");
    // Where the bit of lowest value is changed: of an input, of an acceleration of the palm, of a
    // tip that is ordered, of a joint of another processor, of a set-point, of what was put out.
    let tick = all(SHIPPED, 1).nth(300).unwrap();
    let points = all(SHIPPED, 5).filter(|at| SHIPPED[at + 12] == 6).nth(40);
    let [palm, order, others, done] = [2, 3, 4, 6].map(|kind| first(SHIPPED, kind));
    // Each is looked at, not only kept.
    for (at, found) in [
        (tick + 4 + 8, "tick 300 differs"),
        (palm + 4 + 6, "tick "),
        (order + 4 + 8 + 8 + 288 + 288 + 72 + 6, "tick "),
        (others + 4 + 64 + 6, "tick "),
        (points.unwrap() + 4 + 12 + 5, "tick "),
        (done + 4, "tick 0 differs"),
        (done + 4 + 64, "tick 0 differs"),
    ] {
        let mut other = SHIPPED.to_vec();
        other[at] ^= 1;
        fs::write(&path, &other).unwrap();
        let error = replay(files.path(), 1).unwrap_err();
        assert!(error.contains(found), "{at}: {error}");
    }
}

#[test]
fn what_is_no_recording_is_refused() {
    let files = files();
    let path = files.path().join("servo.mcap");
    let outputs = files.path().join("servo.out");
    let changed = |at: usize, byte: u8| {
        let mut other = SHIPPED.to_vec();
        other[at] = byte;
        other
    };
    let tick = first(SHIPPED, 1);
    let done = first(SHIPPED, 6);
    let end = first(SHIPPED, 7);
    let rate = SHIPPED
        .windows(7)
        .position(|bytes| bytes == b"rate_hz")
        .unwrap()
        + 11;
    let version = SHIPPED
        .windows(7)
        .position(|bytes| bytes == b"version")
        .unwrap()
        + 11;
    for (recording, said) in [
        (
            Vec::new(),
            "servo.mcap: the recording is incomplete: it ends after 0 ticks",
        ),
        (
            changed(0, b'K'),
            "servo.mcap: cannot read the recording after 0 ticks: it is not an MCAP file",
        ),
        (
            changed(version, b'9'),
            "it is not a recording of this version: its version is 9, not 7",
        ),
        (
            changed(version - 8, b'V'),
            "it is not a recording of this version: its version is missing, not 7",
        ),
        (changed(rate, b'9'), "servo.mcap: it was recorded at"),
        (SHIPPED[..end - HEAD].to_vec(), "it ends after 900 ticks"),
        (SHIPPED[..done + 5].to_vec(), "it ends after 0 ticks"),
        (
            changed(tick - HEAD + 9, 9),
            "after 0 ticks there is an unexpected message, of channel 9 with 192 bytes",
        ),
        (
            changed(tick + 1, 7),
            "after 0 ticks there is an unexpected message, of channel 1 with 196 bytes",
        ),
        (
            changed(tick - HEAD + 4, 255),
            "after 0 ticks: a record of kind 0x05 has",
        ),
        (
            changed(end + 4, 0),
            "after 900 ticks there is an unexpected message, of channel 7",
        ),
    ] {
        fs::write(&path, &recording).unwrap();
        fs::write(&outputs, "former").unwrap();
        let error = replay(files.path(), 1).unwrap_err();
        assert!(error.contains(said), "{said}: {error}");
        // Outputs that break off do not replace others.
        assert_eq!(fs::read(&outputs).unwrap(), b"former");
    }
}

#[test]
fn a_recording_that_falls_behind_is_broken_off_and_the_servos_go_on() {
    let files = files();
    let arguments = ["record=servo.mcap"];
    let away = Some((0.8, 4.0));
    let run = run_on(files.path(), TWO, &arguments, away, 6.0, None, |master| {
        master.wait_for_all();
        master.enable();
        master.hold(5.0);
    });
    let said = &run.said[0];
    assert!(
        said.contains("servo.mcap: the recording ended early, after"),
        "{said}"
    );
    assert!(said.contains("the file service wrote too slowly"), "{said}");
    assert!(!said.contains("fault"), "{said}");
    let error = replay(files.path(), 1).unwrap_err();
    assert!(error.contains("it ends after"), "{error}");
}

#[test]
fn a_ring_in_which_somebody_else_writes_ends_the_recording_alone() {
    let files = files();
    let run = run_on(
        files.path(),
        TWO,
        &["record=servo.mcap"],
        None,
        4.0,
        None,
        |master| {
            master.wait_for_all();
            master.enable();
            master.hold(0.1);
            let region = master.region(FIRST);
            let ring = condor_rt::objects::find(&region, "recording", ObjectKind::Other);
            let ring = ring.unwrap().unwrap();
            for at in (ring.offset..ring.offset + ring.len).step_by(4) {
                region.store(at, u32::MAX, StoreOrder::Relaxed).unwrap();
            }
            master.hold(1.0);
        },
    );
    let said = &run.said[0];
    let told = "there is an unexpected message, of channel 65535 with 262144 bytes";
    assert!(said.contains(told), "{said}");
    assert!(!said.contains("fault"), "{said}");
}

#[test]
#[ignore = "makes the shipped recording anew"]
fn record_anew() {
    let files = files();
    let (_, said) = record(files.path(), TICKS);
    print!("{said}");
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/servo.mcap");
    fs::copy(files.path().join("servo.mcap"), data).unwrap();
    print!("{}", replay(files.path(), 1).unwrap());
}
