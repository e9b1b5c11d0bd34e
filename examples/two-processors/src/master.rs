//! The master: moves the joint to the angles in a file, and to those that are typed.

use core::time::Duration;

use condor_rt::{Background, Buffering, Machine, Messenger as _, OpenOptions, Program};
use condor_rt::{ProgramError, STDIN, Setup, StdioError};

use crate::{MOVE, SERVO};

const PATIENCE: Duration = Duration::from_millis(100);

/// The program of the master: it sends the angles in the file `moves`, one every two seconds, and those that a person
/// types to the servo. It says when somebody else moves the joint.
pub struct Master;

impl Program for Master {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), ProgramError> {
        Setup::new(machine)?
            .console()?
            .files()?
            .listen(SERVO, &|call| {
                // Others may move the joint, too: a person by `send`, for example.
                if call.vector() == MOVE && call.sender() != call.number() {
                    let (by, angle) = (call.sender(), call.data() as i32);
                    call.print(format_args!("{by} moves the joint to {angle}\r\n"));
                }
            })
            .background(lead)
    }
}

fn lead<M: Machine>(background: &Background<'_, M>) -> Result<(), ProgramError> {
    let mut line = [0; 16];
    let files = background.files()?;
    let mut stdio = background.stdio().with_files(&files);
    let moves = stdio.open_file("moves", OpenOptions::new().read(), Buffering::None)?;
    // One angle of the file in two seconds.
    for pass in (0..=20).cycle() {
        let from = if pass == 0 { moves } else { STDIN };
        let next = match stdio.read_line(from, &mut line, PATIENCE) {
            Err(StdioError::Line { .. }) => continue,
            next => next?,
        };
        if background.is_stopping() {
            break;
        }
        let Some(Ok(angle)) = next.map(|line| line.trim().parse::<i32>()) else {
            continue;
        };
        let mailbox = background.mailbox();
        match mailbox.send_with_reply(SERVO, MOVE, angle as u32, PATIENCE) {
            Ok(at) => background.print(format_args!("{} -> {angle}\r\n", at as i32)),
            Err(error) => background.print(format_args!("{error}\r\n")),
        }
        background.log(format_args!("sends the joint to {angle} mrad"))?;
    }
    Ok(())
}
