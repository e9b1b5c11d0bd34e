//! One output for all contexts: whatever interrupts whatever, each byte arrives once, is held, or is
//! counted as lost.

use std::fmt;
use std::sync::{Arc, Mutex};

use condor_dev::stdio::{BufferedOutput, Buffering, StandardOutput, StdioError};
use embedded_io::{ErrorKind, ErrorType, Write};
use proptest::prelude::*;

const N: usize = 24;

type Arrived = Arc<Mutex<Vec<u8>>>;

/// What the next calls of a device do; takes nothing in time at the end.
type Script = Vec<Option<usize>>;

struct Device {
    arrived: Arrived,
    script: std::vec::IntoIter<Option<usize>>,
    asked: Arc<Mutex<usize>>,
}

impl ErrorType for Device {
    type Error = ErrorKind;
}

impl Write for Device {
    fn write(&mut self, from: &[u8]) -> Result<usize, ErrorKind> {
        *self.asked.lock().unwrap() += 1;
        let Some(Some(most)) = self.script.next() else {
            return Err(ErrorKind::TimedOut);
        };
        let count = most.min(from.len());
        self.arrived.lock().unwrap().extend(&from[..count]);
        Ok(count)
    }

    fn flush(&mut self) -> Result<(), ErrorKind> {
        Ok(())
    }
}

fn device(script: Script) -> (Device, Arrived, Arc<Mutex<usize>>) {
    let (arrived, asked) = (Arrived::default(), Arc::default());
    let device = Device {
        arrived: Arc::clone(&arrived),
        script: script.into_iter(),
        asked: Arc::clone(&asked),
    };
    (device, arrived, asked)
}

fn willing() -> Script {
    vec![Some(usize::MAX); 5_000]
}

fn opened(script: Script, buffering: Buffering) -> (BufferedOutput<Device, N>, Arrived) {
    let (device, arrived, _) = device(script);
    let output = BufferedOutput::new(buffering);
    output.open(device).ok().unwrap();
    (output, arrived)
}

fn text(arrived: &Arrived) -> String {
    String::from_utf8(arrived.lock().unwrap().clone()).unwrap()
}

/// Whether `some` is what is left of `all` when bytes are taken out.
fn is_part(some: &[u8], all: &[u8]) -> bool {
    let mut all = all.iter();
    some.iter().all(|byte| all.any(|other| other == byte))
}

#[derive(Clone, Debug)]
enum Step {
    Print(String),
    Post(String),
    Write(String),
    Flush,
}

/// Miri is some hundred times slower than the machine.
const MANY: usize = if cfg!(miri) { 5 } else { 20 };

fn words(longest: usize) -> impl Strategy<Value = String> {
    let letter = |byte: u8| {
        if byte < 26 {
            char::from(b'a' + byte)
        } else {
            '\n'
        }
    };
    prop::collection::vec(0..28_u8, 0..=longest)
        .prop_map(move |bytes| bytes.into_iter().map(letter).collect())
}

fn steps() -> impl Strategy<Value = Vec<Step>> {
    let step = prop_oneof![
        words(40).prop_map(Step::Print),
        words(40).prop_map(Step::Post),
        words(40).prop_map(Step::Write),
        Just(Step::Flush),
    ];
    prop::collection::vec(step, 0..MANY)
}

fn buffering() -> impl Strategy<Value = Buffering> {
    prop_oneof![
        Just(Buffering::None),
        Just(Buffering::Line),
        Just(Buffering::Block)
    ]
}

proptest! {
    #[test]
    fn each_byte_arrives_or_is_held_or_counted(
        script in prop::collection::vec(prop::option::weighted(0.7, 1..10_usize), 0..3 * MANY),
        steps in steps(),
        buffering in buffering(),
    ) {
        let (output, arrived) = opened(script, buffering);
        let mut sent = Vec::new();
        for step in steps {
            match step {
                Step::Print(text) => {
                    output.print(format_args!("{text}"));
                    sent.extend(text.bytes());
                }
                Step::Post(text) => {
                    let before = arrived.lock().unwrap().len();
                    output.post(format_args!("{text}"));
                    sent.extend(text.bytes());
                    prop_assert_eq!(arrived.lock().unwrap().len(), before);
                }
                Step::Write(text) => match StandardOutput::write(&output, text.as_bytes()) {
                    Ok(taken) => {
                        prop_assert!(taken > 0 || text.is_empty());
                        sent.extend(&text.as_bytes()[..taken]);
                    }
                    Err(error) => {
                        prop_assert_eq!(error, StdioError::Failed(ErrorKind::TimedOut));
                        prop_assert_eq!(output.held(), N);
                    }
                },
                Step::Flush => match StandardOutput::flush(&output) {
                    Ok(()) => prop_assert_eq!(output.held(), 0),
                    Err(error) => {
                        prop_assert_eq!(error, StdioError::Failed(ErrorKind::TimedOut));
                    }
                },
            }
            let arrived = arrived.lock().unwrap();
            prop_assert!(is_part(&arrived, &sent));
            let accounted = arrived.len() + output.held() + output.lost() as usize;
            prop_assert_eq!(accounted, sent.len());
        }
    }

    #[test]
    fn a_willing_device_gets_all_that_is_printed(
        texts in prop::collection::vec(words(80), 0..MANY),
        buffering in buffering(),
    ) {
        let (output, arrived) = opened(willing(), buffering);
        let mut sent = String::new();
        for part in texts {
            output.print(format_args!("{part}"));
            sent += &part;
            let arrived = text(&arrived);
            prop_assert!(sent.starts_with(&arrived));
            if buffering == Buffering::None || (buffering == Buffering::Line && part.contains('\n')) {
                prop_assert_eq!(&arrived, &sent);
            }
        }
        StandardOutput::flush(&output).unwrap();
        prop_assert_eq!(text(&arrived), sent);
        prop_assert_eq!(output.lost(), 0);
    }
}

#[test]
fn a_print_waits_for_a_dead_device_once() {
    let (device, arrived, asked) = device(Vec::new());
    let output = BufferedOutput::<_, N>::new(Buffering::Line);
    output.open(device).ok().unwrap();
    output.print(format_args!("{}{}\n", "a".repeat(30), "b".repeat(30)));
    assert_eq!(*asked.lock().unwrap(), 1);
    assert_eq!(output.lost(), 61 - 24);
    assert_eq!(output.held(), 24);
    assert_eq!(text(&arrived), "");
}

/// A value in whose formatting another context prints.
struct Interrupted<'o>(&'o BufferedOutput<Device, N>);

impl fmt::Display for Interrupted<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("<")?;
        self.0.print(format_args!("print\n"));
        self.0.post(format_args!("post"));
        f.write_str(">")
    }
}

#[test]
fn a_print_stands_in_the_middle_of_the_one_it_interrupts() {
    let (output, arrived) = opened(willing(), Buffering::Line);
    output.print(format_args!("before {} after\n", Interrupted(&output)));
    assert_eq!(text(&arrived), "before <print\npost> after\n");
    assert_eq!(output.lost(), 0);
}

static NESTED: BufferedOutput<Nested, N> = BufferedOutput::new(Buffering::Line);

/// A device that is interrupted while it writes, by one who prints to it.
struct Nested {
    arrived: Arrived,
    interrupts: u32,
}

impl ErrorType for Nested {
    type Error = ErrorKind;
}

impl Write for Nested {
    fn write(&mut self, from: &[u8]) -> Result<usize, ErrorKind> {
        if self.interrupts > 0 {
            self.interrupts -= 1;
            NESTED.print(format_args!("{}\n", self.interrupts));
            assert_eq!(StandardOutput::flush(&NESTED), Err(StdioError::InUse));
            let full = "x".repeat(N);
            NESTED.print(format_args!("{full}"));
        }
        self.arrived.lock().unwrap().extend(from);
        Ok(from.len())
    }

    fn flush(&mut self) -> Result<(), ErrorKind> {
        Ok(())
    }
}

#[test]
fn who_interrupts_the_writing_never_waits_and_is_written_after_it() {
    let arrived = Arrived::default();
    let device = Nested {
        arrived: Arc::clone(&arrived),
        interrupts: 2,
    };
    NESTED.open(device).ok().unwrap();
    NESTED.print(format_args!("hello\n"));
    // Six bytes were held, two came, and sixteen of the x; then eight were free for as many.
    let expected = format!("hello\n1\n{}0\n{}", "x".repeat(16), "x".repeat(4));
    assert_eq!(text(&arrived), expected);
    assert_eq!(NESTED.held(), 0);
    assert_eq!(NESTED.lost(), 8 + 20);
}

#[test]
fn threads_lose_nothing_uncounted() {
    const LINES: usize = if cfg!(miri) { 10 } else { 500 };
    let (output, arrived) = opened(willing(), Buffering::Line);
    std::thread::scope(|scope| {
        for name in ["one", "two"] {
            let output = &output;
            scope.spawn(move || {
                for _ in 0..LINES {
                    output.print(format_args!("{name}\n"));
                    output.post(format_args!("{name}\n"));
                }
            });
        }
    });
    let flushed = StandardOutput::flush(&output);
    assert_eq!(flushed, Ok(()));
    let accounted = text(&arrived).len() + output.lost() as usize;
    assert_eq!(accounted, 2 * 2 * LINES * 4);
}

#[test]
fn an_output_without_a_device_holds_and_counts() {
    let output = BufferedOutput::<Device, N>::new(Buffering::Line);
    output.print(format_args!("early\n"));
    assert_eq!(StandardOutput::flush(&output), Err(StdioError::NotOpen));
    let (device, arrived, _) = device(willing());
    output.open(device).ok().unwrap();
    StandardOutput::flush(&output).unwrap();
    assert_eq!(text(&arrived), "early\n");
    let (another, ..) = self::device(willing());
    assert!(output.open(another).is_err());
}
