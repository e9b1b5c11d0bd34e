//! Programs that ask the master's queue for motions, in virtual time.

use std::collections::HashMap;
use std::time::Duration;

use condor_hand::trajectory::image::append;
use condor_hand::trajectory::{Pace, Primitive, Profile, StreamPoint, Target};
use condor_robot::motions::{Batch, MotionsClient, SentPoints};
use condor_robot::packet::ClientError;
use condor_robot::queue::{InControl, QueueAnswer, RefusalReason, RequestIdentity, RequestState};

use crate::typist::{MASTER, Typist, run};

const SOON: Duration = Duration::from_secs(2);

/// A client of the master, as the typist's processor.
macro_rules! ask {
    ($typist:expr, $client:ident, $question:expr) => {{
        let region = $typist.region(MASTER);
        let blocks = condor_robot::objects::motions(&region).unwrap().unwrap();
        let mailbox = $typist.mailbox();
        let mut $client = MotionsClient::new(mailbox, MASTER, &blocks, &region).unwrap();
        let answer: Result<_, ClientError> = $question;
        answer
    }};
}

/// Begins, enables the hand, and returns a session that is in control.
fn in_control(typist: &mut Typist<'_>) -> u32 {
    typist.begin();
    enable(typist);
    let session = open(typist);
    control(typist, session, false);
    session
}

pub(crate) fn open(typist: &mut Typist<'_>) -> u32 {
    ask!(typist, client, client.open(SOON)).unwrap()
}

pub(crate) fn control(typist: &mut Typist<'_>, session: u32, from_other: bool) -> InControl {
    match ask!(
        typist,
        client,
        client.take_control(session, from_other, SOON)
    ) {
        Ok(()) => InControl::Session(session),
        Err(ClientError::NotInControl(other)) => other,
        Err(error) => panic!("{error}"),
    }
}

pub(crate) fn offer(
    typist: &mut Typist<'_>,
    identity: RequestIdentity,
    motions: &[u8],
) -> QueueAnswer {
    ask!(typist, client, client.offer(identity, motions, SOON)).unwrap()
}

fn look(typist: &mut Typist<'_>, identity: RequestIdentity) -> QueueAnswer {
    ask!(typist, client, client.look(identity, SOON))
        .unwrap()
        .answer
}

/// Waits until nothing changes any more.
fn end(typist: &mut Typist<'_>, identity: RequestIdentity) -> (RequestState, RefusalReason) {
    for _ in 0..1000 {
        match look(typist, identity) {
            QueueAnswer::Known(state, reason) if state.is_final() => return (state, reason),
            _ => typist.wait(0.02),
        }
    }
    panic!("{identity} does not end:\n{}", typist.shown);
}

fn enable(typist: &mut Typist<'_>) {
    typist.types("enable");
    typist.wait(1.5);
}

/// The middle joint of the thumb goes somewhere, in 0.3 s.
fn small(position: f64) -> Vec<u8> {
    let motion = Primitive::<16>::new(Pace::Duration(0.3), Profile::MinimumJerk);
    let motion = motion.with(14, Target::Absolute(position)).unwrap();
    let mut image = vec![0; 480];
    let len = append(16, &motion, &mut image, 0).unwrap();
    image.truncate(len);
    image
}

#[test]
fn a_client_in_control_moves_the_hand_and_others_look() {
    run(|typist| {
        typist.begin();
        let (first, second) = (open(typist), open(typist));
        assert_ne!(first, second);
        let of = |session, number| RequestIdentity { session, number };
        let refused = |reason| QueueAnswer::Known(RequestState::Refused, reason);
        let wave = offer(typist, of(first, 1), b"wave");
        assert_eq!(wave, refused(RefusalReason::NotInControl));
        let in_control = InControl::Session(first);
        assert_eq!(control(typist, first, false), in_control);
        assert_eq!(control(typist, second, false), in_control);
        // The same identity has the same outcome.
        let wave = offer(typist, of(first, 1), b"wave");
        assert_eq!(wave, refused(RefusalReason::NotInControl));
        for (number, motions, why) in [
            (2, &b"wave"[..], RefusalReason::NotReady),
            (3, b"dance", RefusalReason::NoMotion),
            (4, b"CNDM", RefusalReason::NoMotion),
        ] {
            offer(typist, of(first, number), motions);
            assert_eq!(end(typist, of(first, number)), (RequestState::Refused, why));
        }
        enable(typist);
        typist.shown.clear();
        for _ in 0..3 {
            offer(typist, of(first, 5), b"open");
        }
        offer(typist, of(first, 6), &small(0.9));
        assert!(matches!(
            look(typist, of(second, 1)),
            QueueAnswer::New | QueueAnswer::Known(..)
        ));
        assert_eq!(
            end(typist, of(first, 6)),
            (RequestState::Done, RefusalReason::None)
        );
        assert_eq!(
            end(typist, of(first, 5)),
            (RequestState::Done, RefusalReason::None)
        );
        typist.wait(0.1);
        assert_eq!(typist.shown.matches("open is done").count(), 1);
        let middle = typist.truth().position[3][2];
        assert!((middle - 0.9).abs() < 0.01, "{middle}");

        // Another one takes control, which is announced.
        typist.shown.clear();
        let in_control = InControl::Session(second);
        assert_eq!(control(typist, second, true), in_control);
        typist.expect(&format!("is in control, by session {second}"), 1.0);
        let late = offer(typist, of(first, 7), b"open");
        assert_eq!(late, refused(RefusalReason::NotInControl));
        let said = typist.says("run open");
        assert!(said.contains("`control` takes control"), "{said}");
        offer(typist, of(second, 1), b"wave");
        typist.wait(0.5);
        typist.shown.clear();
        let aborted = ask!(typist, client, client.abort(first, SOON));
        let refused = Err(ClientError::NotInControl(in_control));
        assert_eq!(aborted, refused, "who is not in control ends nothing");
        typist.wait(0.1);
        assert!(!typist.shown.contains("stops"), "{}", typist.shown);
        ask!(typist, client, client.abort(second, SOON)).unwrap();
        typist.expect("all motion stops", 1.0);
        assert_eq!(
            end(typist, of(second, 1)),
            (RequestState::Aborted, RefusalReason::Command)
        );
        typist.does("control");
        typist.runs("open");
        // The terminal needs none of the sessions, of which there are as many as places.
        for _ in 0..20 {
            open(typist);
        }
        typist.runs("open");
        assert_eq!(look(typist, of(second, 1)), QueueAnswer::NoSession);
        let (first, second) = (open(typist), open(typist));
        assert!(first < second);

        let long = ask!(typist, client, client.offer(of(second, 2), &[0; 481], SOON));
        assert_eq!(
            long.unwrap_err().to_string(),
            "the request has more than the 480 bytes for which there is room"
        );
        assert_eq!(look(typist, of(99, 1)), QueueAnswer::NoSession);
        assert_eq!(look(typist, of(second, 2)), QueueAnswer::New);
    });
}

#[test]
fn what_was_accepted_runs_once_or_is_lost_whatever_ends() {
    run(|typist| {
        typist.begin();
        enable(typist);
        let sessions = [open(typist), open(typist), open(typist)];
        let mut numbers = [0_u32; 3];
        let mut outcomes = HashMap::new();
        let mut said = String::new();
        let mut seed = 0x2545_f491_4f6c_dd1d_u64;
        let mut random = move |below: u32| {
            seed ^= seed << 13;
            seed ^= seed >> 7;
            seed ^= seed << 17;
            (seed % u64::from(below)) as u32
        };
        for round in 0..30 {
            let client = random(3) as usize;
            let session = sessions[client];
            control(typist, session, true);
            numbers[client] += 1;
            let identity = RequestIdentity {
                session,
                number: numbers[client],
            };
            let motions = small(0.6 + 0.02 * f64::from(random(10)));
            // A client that dies after it has sent it sends it again.
            for _ in 0..=random(2) {
                offer(typist, identity, &motions);
            }
            outcomes.insert(identity, None);
            if random(3) == 0 {
                typist.kill_files();
            }
            if round % 6 == 5 {
                typist.wait(0.01 * f64::from(random(40)));
                typist.restart(MASTER);
                typist.expect("processor 1 controls", 5.0);
                typist.expect("processor 2 controls", 5.0);
                typist.wait(0.3);
                said += &std::mem::take(&mut typist.shown);
                enable(typist);
                offer(typist, identity, &motions);
            }
            for (identity, outcome) in &mut outcomes {
                let now = look(typist, *identity);
                match (*outcome, now) {
                    (Some((state, reason)), QueueAnswer::Known(now, why)) => {
                        assert_eq!((state, reason), (now, why), "{identity}");
                    }
                    (None, QueueAnswer::Known(state, reason)) if state.is_final() => {
                        *outcome = Some((state, reason));
                    }
                    (None, QueueAnswer::Known(..)) | (Some(_), QueueAnswer::Forgotten) => {}
                    (before, now) => panic!("{identity}: {before:?}, {now:?}"),
                }
            }
            if random(2) == 0 {
                end(typist, identity);
            }
        }
        typist.wait(3.0);
        said += &typist.shown;
        let mut counts = HashMap::<RequestState, u32>::new();
        for (identity, outcome) in outcomes {
            let (state, _) = outcome.unwrap_or_else(|| end(typist, identity));
            *counts.entry(state).or_default() += 1;
            let RequestIdentity { session, number } = identity;
            let done = format!("motion {session}.{number} is done\n");
            let runs = said.matches(&done).count();
            let expected = usize::from(state == RequestState::Done);
            assert_eq!(runs, expected, "{identity} is {state:?}:\n{said}");
        }
        println!("{counts:?}");
        assert!(counts[&RequestState::Done] > 10, "{counts:?}");
        assert!(
            counts
                .keys()
                .any(|it| [RequestState::Lost, RequestState::BrokenOff].contains(it)),
            "{counts:?}"
        );
    });
}

#[test]
fn a_motion_whose_finger_is_lost_is_never_done() {
    run(|typist| {
        let session = in_control(typist);
        let mut number = 0;
        let mut begin = |typist: &mut Typist<'_>| {
            number += 1;
            let identity = RequestIdentity { session, number };
            offer(typist, identity, b"wave");
            typist.wait(0.5);
            let running = QueueAnswer::Known(RequestState::Started, RefusalReason::None);
            assert_eq!(look(typist, identity), running);
            identity
        };
        // All fingers wave; of one, only its own motions are aborted by the generator.
        let request = begin(typist);
        typist.says("disable index");
        let ended = (RequestState::Aborted, RefusalReason::Command);
        assert_eq!(end(typist, request), ended, "{}", typist.shown);
        typist.says("enable");
        typist.wait(1.5);
        // It is taken up again before anybody has looked.
        let request = begin(typist);
        typist.types("disable ring");
        typist.types("enable ring");
        assert_eq!(end(typist, request), ended, "{}", typist.shown);
        typist.wait(1.5);
        let request = begin(typist);
        typist.says("fault thumb.middle-flexor drive");
        let failed = (RequestState::Aborted, RefusalReason::Failure);
        assert_eq!(end(typist, request), failed, "{}", typist.shown);
        assert!(!typist.shown.contains("wave is done"), "{}", typist.shown);
    });
}

#[test]
fn what_is_typed_waits_like_all_requests_and_ends_no_other() {
    run(|typist| {
        typist.begin();
        enable(typist);
        typist.runs("open");
        typist.types("run wave");
        typist.wait(0.3);
        assert_eq!(
            typist.says("to thumb.middle 0.9 0.4"),
            "the motion waits: it is number 1 in the queue\n"
        );
        typist.expect("wave is done\n", 20.0);
        typist.expect("thumb.middle is done\n", 2.0);
        let middle = typist.truth().position[3][2];
        assert!((middle - 0.9).abs() < 0.01, "{middle}");
        // One that is not possible is refused, and the next one runs.
        typist.shown.clear();
        typist.types("run open");
        typist.types("to thumb.middle 0.6 0.001");
        typist.types("to thumb.middle 7 1");
        typist.types("to thumb.middle 0.8 0.4");
        typist.expect("open is done\n", 20.0);
        typist.expect("thumb.middle cannot go to 7 rad", 1.0);
        typist.expect("thumb.middle is done\n", 2.0);
    });
}

#[test]
fn a_request_tells_how_far_it_is() {
    run(|typist| {
        let session = in_control(typist);
        let (first, second) = (
            RequestIdentity { session, number: 1 },
            RequestIdentity { session, number: 2 },
        );
        offer(typist, first, b"wave");
        offer(typist, second, b"open");
        let mut told = Vec::new();
        loop {
            let seen = ask!(typist, client, client.look(first, SOON)).unwrap();
            if seen.answer != QueueAnswer::Known(RequestState::Started, RefusalReason::None) {
                break;
            }
            let next = ask!(typist, client, client.look(second, SOON)).unwrap();
            if next.answer == QueueAnswer::Known(RequestState::Accepted, RefusalReason::None) {
                assert_eq!((next.before, next.progress), (1, None));
            }
            told.push(seen.progress.unwrap());
            typist.wait(0.1);
        }
        assert!(told.is_sorted(), "{told:?}");
        assert!(told[0] < 0.1 && told[told.len() - 1] > 0.9, "{told:?}");
        assert!(told.len() > 10, "{told:?}");
        end(typist, second);
    });
}

#[test]
fn a_request_whose_file_does_not_come_in_time_waits_and_runs() {
    run(|typist| {
        let session = in_control(typist);
        let of = |number| RequestIdentity { session, number };
        let waits = QueueAnswer::Known(RequestState::Accepted, RefusalReason::None);
        // Longer than the master waits for a file.
        typist.stall("motions/open.motion", 11.0);
        typist.shown.clear();
        assert_eq!(offer(typist, of(1), b"open"), waits);
        // What the master cannot look at meanwhile is answered, too.
        let late = ask!(typist, client, client.offer(of(2), &small(0.9), SOON));
        assert!(
            matches!(late, Err(ClientError::TimedOut { .. })),
            "{late:?}"
        );
        for _ in 0..7 {
            assert_eq!(look(typist, of(1)), waits);
            typist.wait(1.0);
        }
        typist.expect("error: motions/open.motion: ", 2.0);
        assert_eq!(
            end(typist, of(1)),
            (RequestState::Done, RefusalReason::None)
        );
        offer(typist, of(2), &small(0.9));
        assert_eq!(
            end(typist, of(2)),
            (RequestState::Done, RefusalReason::None)
        );
        typist.wait(0.1);
        assert_eq!(typist.shown.matches("open is done").count(), 1);
    });
}

#[test]
fn the_terminal_keeps_control_only_if_somebody_has_typed_so() {
    run(|typist| {
        typist.begin();
        enable(typist);
        let session = open(typist);
        // With its last motion its control ends.
        typist.runs("open");
        let mine = InControl::Session(session);
        assert_eq!(control(typist, session, false), mine);
        typist.expect(&format!("is in control, by session {session}"), 1.0);
        typist.does("control");
        typist.runs("open");
        let terminal = control(typist, session, false);
        assert_eq!(terminal, InControl::Program);
        // Until a client takes it.
        assert_eq!(control(typist, session, true), mine);
        typist.expect(&format!("is in control, by session {session}"), 1.0);
        ask!(typist, client, client.give_up_control(session, SOON)).unwrap();
        typist.runs("open");
        assert_eq!(control(typist, session, false), mine);
    });
}

/// Waits until the clock of the host shows more seconds.
fn pass(seconds: u32) {
    let now = || {
        std::time::SystemTime::UNIX_EPOCH
            .elapsed()
            .unwrap()
            .as_secs()
    };
    while now() <= seconds.into() {
        std::thread::yield_now();
    }
}

#[test]
fn a_ledger_that_is_deleted_or_cut_is_made_anew_and_nothing_runs_again() {
    run(|typist| {
        let session = in_control(typist);
        let of = |number| RequestIdentity { session, number };
        offer(typist, of(1), &small(0.9));
        let done = (RequestState::Done, RefusalReason::None);
        assert_eq!(end(typist, of(1)), done);
        // While it runs.
        for (number, len) in [(2, None), (3, Some(100)), (4, Some(0))] {
            typist.cut_file("motions.ledger", len);
            typist.wait(0.2);
            offer(typist, of(number), &small(0.8));
            assert_eq!(end(typist, of(number)), done, "{}", typist.shown);
        }
        for number in 1..=4 {
            assert_eq!(end(typist, of(number)), done);
        }
        let whole = typist.file("motions.ledger");
        // Between two incarnations. New sessions are numbered by the seconds of the host.
        pass(session);
        let (restarted, len) = (
            |typist: &mut Typist<'_>| typist.restart(MASTER),
            whole.len(),
        );
        typist.cut_file("motions.ledger", None);
        restarted(typist);
        typist.begin();
        assert_eq!(look(typist, of(1)), QueueAnswer::NoSession);
        let newer = open(typist);
        assert!(newer > session, "{newer} after {session}");
        typist.cut_file("motions.ledger", Some(len - 32));
        typist.shown.clear();
        restarted(typist);
        let complaint = "motions.ledger: the image must have ";
        typist.expect(complaint, 5.0);
        // However often it tries, it says so once.
        typist.wait(5.0);
        assert_eq!(
            typist.shown.matches(complaint).count(),
            1,
            "{}",
            typist.shown
        );
        // It goes on without moving, and reads it when it is there.
        assert!(typist.says("status").contains("no motion"));
        pass(newer);
        typist.cut_file("motions.ledger", None);
        assert!(open(typist) > newer);
    });
}

/// The checksum of a row of the ledger: CRC-32 (ISO-HDLC).
fn checksum(words: &[u8]) -> u32 {
    let bit = |sum: u32| (sum >> 1) ^ (0xedb8_8320 & (sum & 1).wrapping_neg());
    !words.iter().fold(u32::MAX, |sum, byte| {
        (0..8).fold(sum ^ u32::from(*byte), |sum, _| bit(sum))
    })
}

#[test]
fn a_ledger_with_the_last_session_says_that_it_must_be_removed() {
    run(|typist| {
        let session = in_control(typist);
        // The row of this session has the last number.
        let mut ledger = typist.file("motions.ledger");
        let rows = ledger.as_chunks_mut::<32>().0;
        let is_own = |row: &&mut [u8; 32]| row[4..8] == session.to_le_bytes();
        let row = rows.iter_mut().skip(1).find(is_own).unwrap();
        assert_eq!(row[28..], checksum(&row[..28]).to_le_bytes());
        row[4..8].fill(0xff);
        let sum = checksum(&row[..28]);
        row[28..].copy_from_slice(&sum.to_le_bytes());
        std::fs::write(typist.files.join("motions.ledger"), ledger).unwrap();
        typist.restart(MASTER);
        typist.begin();
        let opened = ask!(typist, client, client.open(SOON));
        let refused = opened.unwrap_err();
        assert_eq!(refused, ClientError::Exhausted);
        let said = refused.to_string();
        assert!(said.contains("remove the file"), "{said}");
        // The terminal goes on without a session.
        enable(typist);
        typist.runs("open");
        pass(session);
        typist.cut_file("motions.ledger", None);
        typist.restart(MASTER);
        typist.begin();
        assert!(open(typist) > session);
    });
}

/// The middle joint of the thumb, alone.
const MASK: u32 = 1 << 14;

/// A batch of points of that joint: time, position and velocity.
fn batch(sequence: u32, points: &[(f64, f64, f64)], is_last: bool) -> Batch<16> {
    let point = |&(time, position, velocity): &(f64, f64, f64)| StreamPoint {
        time,
        positions: [position; 16],
        velocities: [velocity; 16],
    };
    Batch {
        sequence,
        is_last,
        points: points.iter().map(point).collect(),
    }
}

fn send(
    typist: &mut Typist<'_>,
    identity: RequestIdentity,
    batch: &Batch<16>,
) -> Result<SentPoints, ClientError> {
    ask!(typist, client, client.points(identity, MASK, batch, SOON))
}

#[test]
fn a_stream_moves_the_hand_and_brakes_when_its_points_stay_away() {
    use RefusalReason::{Command, NoMotion, NotReady, Starved};
    use RequestState::{Aborted, Done, Refused};

    run(|typist| {
        let session = in_control(typist);
        let of = |number| RequestIdentity { session, number };
        offer(typist, of(1), &small(0.9));
        // It waits for its turn like any other; its first batch waits for that.
        let state = |state| QueueAnswer::Known(state, RefusalReason::None);
        let accepted = state(RequestState::Accepted);
        let stream = |typist: &mut Typist<'_>, number| {
            ask!(typist, client, client.stream(of(number), MASK, SOON)).unwrap()
        };
        assert_eq!(stream(typist, 2), accepted);
        assert_eq!(stream(typist, 2), accepted);
        // Nobody but its client knows how many points are still to come.
        for _ in 0..1000 {
            let seen = ask!(typist, client, client.look(of(2), SOON)).unwrap();
            if seen.answer == state(RequestState::Started) {
                assert_eq!(seen.progress, None);
                break;
            }
            typist.wait(0.02);
        }
        let begin = typist.wanted.len();
        // A wave of 0.2 rad, in 1.2 s: 60 points, which are more than the master has room for.
        let point = |index: u32| {
            let (time, rate) = (0.02 * f64::from(index + 1), core::f64::consts::TAU / 1.2);
            let angle = rate * time;
            (
                time,
                0.9 + 0.1 * (1.0 - angle.cos()),
                0.1 * rate * angle.sin(),
            )
        };
        for sequence in 0..12 {
            let mut points: Vec<_> = (5 * sequence..5 * sequence + 5).map(point).collect();
            if sequence == 11 {
                points[4] = (1.2, 0.9, 0.0);
            }
            let points = batch(sequence, &points, sequence == 11);
            for _ in 0..2 {
                let sent = send(typist, of(2), &points).unwrap();
                let until = Duration::from_millis(100 * (u64::from(sequence) + 1));
                assert_eq!(sent, SentPoints::Until(until), "batch {sequence}");
            }
        }
        assert_eq!(end(typist, of(2)), (Done, RefusalReason::None));
        let farthest = typist.wanted[begin..].iter().map(|it| it[3][2]);
        let farthest = farthest.fold(0.0, f64::max);
        assert!((farthest - 1.1).abs() < 1e-6, "{farthest}");
        // What a joint cannot do is refused, with the limit; the stream goes on.
        stream(typist, 3);
        let far = send(typist, of(3), &batch(0, &[(0.5, 7.0, 0.0)], false));
        let far = far.unwrap_err().to_string();
        assert!(
            far.starts_with("joint 14 at 0.5 s: the position, rad, is 7; it must be at most"),
            "{far}"
        );
        let late = send(typist, of(3), &batch(1, &[(0.5, 1.0, 0.0)], false));
        assert_eq!(
            late.unwrap_err().to_string(),
            "batch 1 has come, but batch 0 must come first"
        );
        send(typist, of(3), &batch(0, &[(0.3, 1.0, 1.0)], false)).unwrap();
        assert_eq!(end(typist, of(3)), (Aborted, Starved));
        let answer = QueueAnswer::Known(Aborted, Starved);
        let after = send(typist, of(3), &batch(1, &[(0.5, 1.0, 0.0)], true)).unwrap();
        assert_eq!(after, SentPoints::Ended(answer));
        // Nobody sends anything, and somebody ends it.
        stream(typist, 4);
        assert_eq!(end(typist, of(4)), (Aborted, Starved));
        stream(typist, 5);
        send(typist, of(5), &batch(0, &[(2.0, 0.9, 0.0)], false)).unwrap();
        typist.wait(0.3);
        typist.types("abort");
        assert_eq!(end(typist, of(5)), (Aborted, Command));
        // The next one begins where it stopped.
        offer(typist, of(6), &small(0.8));
        assert_eq!(end(typist, of(6)), (Done, RefusalReason::None));
        for pair in typist.wanted[begin..].windows(2) {
            let step = (pair[1][3][2] - pair[0][3][2]).abs();
            assert!(step < 0.1, "{step} rad in a tick");
        }
        let none = ask!(typist, client, client.stream(of(7), 0, SOON)).unwrap();
        assert_eq!(none, QueueAnswer::Known(Refused, NoMotion));
        typist.says("disable thumb");
        stream(typist, 8);
        assert_eq!(end(typist, of(8)), (Refused, NotReady));
    });
}
