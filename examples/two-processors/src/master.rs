//! The master: moves the joint through the angles of a file, and then to those that are typed.

use core::time::Duration;

use condor_rt::{Error, Machine, Messenger as _, OpenOptions, Program, Setup};

use crate::{MOVE, SERVO};

const PATIENCE: Duration = Duration::from_millis(100);

/// The program.
pub struct Master;

impl Program for Master {
    type Error = Error;

    fn run<M: Machine>(&self, machine: &M) -> Result<(), Error> {
        Setup::new(machine)?
            .console()?
            .files()?
            .background(|background| {
                let mut text = [0; 256];
                let files = background.files()?;
                let mut file = files.open("moves", OpenOptions::new().read())?;
                let count = file.read(&mut text)?;
                let moves = str::from_utf8(text.get(..count).unwrap_or_default());
                let mut moves = moves.unwrap_or_default().split_whitespace();
                let mut target = 0_i32;
                for pass in (0..20).cycle() {
                    let mut line = [0; 16];
                    let next = match background.read_line(&mut line, PATIENCE)? {
                        _ if background.is_stopping() => return Ok(()),
                        Some(typed) => typed,
                        None if pass == 0 => moves.next().unwrap_or_default(),
                        None => continue,
                    };
                    target = next.parse().unwrap_or(target);
                    let call = (SERVO, MOVE, target as u32);
                    match background
                        .mailbox()
                        .send_with_reply(call.0, call.1, call.2, PATIENCE)
                    {
                        Ok(at) => {
                            background.print(format_args!("from {} to {target}\r\n", at as i32))
                        }
                        Err(error) => background.print(format_args!("servo: {error}\r\n")),
                    }
                }
                Ok(())
            })
    }
}
