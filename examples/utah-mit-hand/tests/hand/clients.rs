//! Programs that ask the master's queue for motions, in virtual time.

use std::collections::HashMap;
use std::time::Duration;

use condor_hand::queue::{Answer, Identity, Reason, State};
use condor_hand::trajectory::image::append;
use condor_hand::trajectory::{Pace, Primitive, Profile, Target};
use utah_mit_hand::motions::{MotionsClient, MotionsError};

use crate::typist::{MASTER, Typist, run};

const SOON: Duration = Duration::from_secs(2);

/// A client of the master, as the typist's processor.
macro_rules! ask {
    ($typist:expr, $client:ident, $question:expr) => {{
        let region = $typist.region(MASTER);
        let blocks = utah_mit_hand::objects::motions(&region).unwrap().unwrap();
        let mailbox = $typist.mailbox();
        let mut $client = MotionsClient::new(mailbox, MASTER, &blocks, &region).unwrap();
        let answer: Result<_, MotionsError> = $question;
        answer
    }};
}

fn open(typist: &mut Typist<'_>) -> u32 {
    ask!(typist, client, client.open(SOON)).unwrap()
}

fn control(typist: &mut Typist<'_>, session: u32, from_other: bool) -> u32 {
    ask!(typist, client, client.control(session, from_other, SOON)).unwrap()
}

fn offer(typist: &mut Typist<'_>, identity: Identity, motions: &[u8]) -> Answer {
    ask!(typist, client, client.offer(identity, motions, SOON)).unwrap()
}

fn look(typist: &mut Typist<'_>, identity: Identity) -> Answer {
    ask!(typist, client, client.look(identity, SOON)).unwrap().0
}

/// Waits until nothing changes any more.
fn end(typist: &mut Typist<'_>, identity: Identity) -> (State, Reason) {
    for _ in 0..1000 {
        match look(typist, identity) {
            Answer::Known(state, reason) if state.is_final() => return (state, reason),
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
    let len = append(&motion, &mut image, 0).unwrap();
    image.truncate(len);
    image
}

#[test]
fn a_client_in_control_moves_the_hand_and_others_look() {
    run(|typist| {
        typist.begin();
        let (first, second) = (open(typist), open(typist));
        assert_ne!(first, second);
        let of = |session, number| Identity { session, number };
        let refused = |reason| Answer::Known(State::Refused, reason);
        let wave = offer(typist, of(first, 1), b"wave");
        assert_eq!(wave, refused(Reason::NotInControl));
        assert_eq!(control(typist, first, false), first);
        assert_eq!(control(typist, second, false), first);
        // The same identity has the same outcome.
        let wave = offer(typist, of(first, 1), b"wave");
        assert_eq!(wave, refused(Reason::NotInControl));
        for (number, motions, why) in [
            (2, &b"wave"[..], Reason::NotReady),
            (3, b"dance", Reason::NoMotion),
            (4, b"CNDM", Reason::NoMotion),
        ] {
            offer(typist, of(first, number), motions);
            assert_eq!(end(typist, of(first, number)), (State::Refused, why));
        }
        enable(typist);
        typist.shown.clear();
        for _ in 0..3 {
            offer(typist, of(first, 5), b"open");
        }
        offer(typist, of(first, 6), &small(0.9));
        assert!(matches!(
            look(typist, of(second, 1)),
            Answer::New | Answer::Known(..)
        ));
        assert_eq!(end(typist, of(first, 6)), (State::Done, Reason::None));
        assert_eq!(end(typist, of(first, 5)), (State::Done, Reason::None));
        typist.wait(0.1);
        assert_eq!(typist.shown.matches("open is done").count(), 1);
        let middle = typist.truth().position[3][2];
        assert!((middle - 0.9).abs() < 0.01, "{middle}");

        // Another one takes control, which is announced.
        typist.shown.clear();
        assert_eq!(control(typist, second, true), second);
        typist.expect(&format!("session {second} is in control"), 1.0);
        let late = offer(typist, of(first, 7), b"open");
        assert_eq!(late, refused(Reason::NotInControl));
        assert_eq!(
            typist.says("run open"),
            format!("session {second} is in control: `control` takes it\n")
        );
        offer(typist, of(second, 1), b"wave");
        typist.wait(0.5);
        typist.shown.clear();
        let aborted = ask!(typist, client, client.abort(first, SOON)).unwrap();
        assert_eq!(aborted, second, "who is not in control ends nothing");
        typist.wait(0.1);
        assert!(!typist.shown.contains("stops"), "{}", typist.shown);
        ask!(typist, client, client.abort(second, SOON)).unwrap();
        typist.expect("all motion stops", 1.0);
        assert_eq!(
            end(typist, of(second, 1)),
            (State::Aborted, Reason::Command)
        );
        assert_eq!(typist.says("control"), "");
        typist.runs("open");
        // As many sessions as there are places do not take the terminal's away.
        for _ in 0..9 {
            open(typist);
        }
        typist.runs("open");
        assert_eq!(look(typist, of(second, 1)), Answer::NoSession);
        let (first, second) = (open(typist), open(typist));
        assert!(first < second);

        let long = ask!(typist, client, client.offer(of(second, 2), &[0; 481], SOON));
        assert_eq!(
            long.unwrap_err().to_string(),
            "481 bytes of motions; at most 480 fit in a request"
        );
        assert_eq!(look(typist, of(99, 1)), Answer::NoSession);
        assert_eq!(look(typist, of(second, 2)), Answer::New);
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
            let identity = Identity {
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
                typist.expect("processor 1 serves", 5.0);
                typist.expect("processor 2 serves", 5.0);
                typist.wait(0.3);
                said += &std::mem::take(&mut typist.shown);
                enable(typist);
                offer(typist, identity, &motions);
            }
            for (identity, outcome) in &mut outcomes {
                let now = look(typist, *identity);
                match (*outcome, now) {
                    (Some((state, reason)), Answer::Known(now, why)) => {
                        assert_eq!((state, reason), (now, why), "{identity}");
                    }
                    (None, Answer::Known(state, reason)) if state.is_final() => {
                        *outcome = Some((state, reason));
                    }
                    (None, Answer::Known(..)) | (Some(_), Answer::Forgotten) => {}
                    (before, now) => panic!("{identity}: {before:?}, {now:?}"),
                }
            }
            if random(2) == 0 {
                end(typist, identity);
            }
        }
        typist.wait(3.0);
        said += &typist.shown;
        let mut counts = HashMap::<State, u32>::new();
        for (identity, outcome) in outcomes {
            let (state, _) = outcome.unwrap_or_else(|| end(typist, identity));
            *counts.entry(state).or_default() += 1;
            let Identity { session, number } = identity;
            let done = format!("motion {session}.{number} is done\n");
            let runs = said.matches(&done).count();
            let expected = usize::from(state == State::Done);
            assert_eq!(runs, expected, "{identity} is {state:?}:\n{said}");
        }
        println!("{counts:?}");
        assert!(counts[&State::Done] > 10, "{counts:?}");
        assert!(
            counts
                .keys()
                .any(|it| [State::Lost, State::BrokenOff].contains(it)),
            "{counts:?}"
        );
    });
}
