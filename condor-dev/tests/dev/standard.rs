//! The standard input and output of a program: set once.

use crate::flaky::Flaky;
use condor_dev::stdio::{
    self, AlreadySet, BufferedInput, BufferedOutput, Buffering, LineError, StandardInput,
    StdioError, UntilError, stdin, stdout,
};
use embedded_io::{ErrorKind, Read, Write};

static OUTPUT: BufferedOutput<Device, 64> = BufferedOutput::new(Buffering::Line);
static INPUT: BufferedInput<Flaky, 16> = BufferedInput::new();
static ARRIVED: std::sync::Mutex<String> = std::sync::Mutex::new(String::new());

struct Device;

impl embedded_io::ErrorType for Device {
    type Error = ErrorKind;
}

impl embedded_io::Write for Device {
    fn write(&mut self, from: &[u8]) -> Result<usize, ErrorKind> {
        ARRIVED
            .lock()
            .unwrap()
            .push_str(str::from_utf8(from).unwrap());
        Ok(from.len())
    }

    fn flush(&mut self) -> Result<(), ErrorKind> {
        Ok(())
    }
}

fn arrived() -> String {
    ARRIVED.lock().unwrap().clone()
}

/// One test: a program has one standard output.
#[test]
fn standard_input_and_output_are_set_once() {
    condor_dev::println!("nobody {}", "hears");
    condor_dev::post!("this");
    assert_eq!(stdio::lost(), 13 + 4);
    assert_eq!(stdio::flush(), Err(StdioError::NotOpen));
    assert_eq!(stdout().err(), Some(StdioError::NotOpen));
    assert_eq!(stdin().err(), Some(StdioError::NotOpen));
    let mut line = [0; 16];

    OUTPUT.open(Device).ok().unwrap();
    stdio::set_output(&OUTPUT).unwrap();
    assert_eq!(stdio::set_output(&OUTPUT), Err(AlreadySet));
    condor_dev::print!("{} ", 1);
    condor_dev::postln!("{}", 2);
    assert_eq!(arrived(), "");
    condor_dev::println!("three");
    assert_eq!(arrived(), "1 2\nthree\n");
    condor_dev::println!();
    condor_dev::postln!();
    let mut output = stdout().unwrap();
    output.write_all(b"four").unwrap();
    Write::flush(&mut output).unwrap();
    assert_eq!(arrived(), "1 2\nthree\n\n\nfour");
    assert_eq!(stdio::lost(), 17);

    assert_eq!(
        StandardInput::read(&INPUT, &mut line),
        Err(StdioError::NotOpen)
    );
    let script = [Some(9), None].into();
    INPUT
        .open(Flaky::new(script, b"first\nsecond\n".to_vec()))
        .ok()
        .unwrap();
    stdio::set_input(&INPUT).unwrap();
    assert_eq!(stdio::set_input(&INPUT), Err(AlreadySet));
    let mut input = stdin().unwrap();
    assert_eq!(input.read_line(&mut line), Ok("first\n"));
    let late = LineError::Reader(UntilError {
        read: 3,
        error: StdioError::Failed(ErrorKind::TimedOut),
    });
    assert_eq!(input.read_line(&mut line), Err(late));
    assert_eq!(&line[..3], b"sec");
    assert_eq!(Read::read(&mut input, &mut line[3..]), Ok(4));
    assert_eq!(&line[..7], b"second\n");
    assert_eq!(input.read_line(&mut line), Ok(""));
}
