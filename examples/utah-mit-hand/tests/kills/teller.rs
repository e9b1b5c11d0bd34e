//! [`Teller`]: a program that leaves nothing out, and says so.
//!
//! It numbers the lines that it writes to its terminal, the messages to its partner and the lines that it
//! appends to a file, again and again replaces another file as a whole, and repeats what is typed.
//! `end` ends that, and `total` says how much it was.

use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
use std::time::Duration;

use condor_fs::OpenOptions;
use condor_mbox::{Messenger, Processor, Vector};
use condor_rt::{Background, HandlerCall, Machine, Program, ProgramError, Setup};
use condor_tty::{ConsoleError, Policy, TerminalSettings};
use embedded_io::{Read, Write};

/// Messages with and without reply.
const ASKED: Vector = Vector(1);
const TOLD: Vector = Vector(2);
/// Longer than a service needs to be started again.
const PATIENCE: Duration = Duration::from_secs(30);
/// The time between two lines.
const PAUSE: Duration = Duration::from_millis(4);
/// Every which line is appended to the file, and every which of these replaces the other file.
const APPENDED: u32 = 4;
const REPLACED: u32 = 16;
/// The number of copies of the number in the file that is replaced.
const COPIES: usize = 100;

type Failed = Box<dyn std::error::Error>;

/// The program; its argument is the number of its partner.
pub(crate) struct Teller;

impl Program for Teller {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), ProgramError> {
        tell(machine)
    }
}

/// The messages of one kind that have come from the partner.
#[derive(Default)]
struct Heard {
    count: AtomicU32,
    /// Those that were not the next.
    wrong: AtomicU32,
}

impl Heard {
    fn hear(&self, call: &HandlerCall<'_>) -> u32 {
        let expected = self.count.fetch_add(1, Relaxed);
        if call.data() != expected {
            self.wrong.fetch_add(1, Relaxed);
        }
        call.data()
    }
}

#[derive(Clone, Copy, Default)]
struct Total {
    said: u32,
    asked: u32,
    told: u32,
    appended: u32,
    replaced: u32,
}

fn tell<M: Machine>(machine: &M) -> Result<(), ProgramError> {
    let (asked, told) = (Heard::default(), Heard::default());
    Setup::new(machine)?
        .console()?
        .files()?
        .on(ASKED, "asked", &|call| asked.hear(call))
        .on(TOLD, "told", &|call| told.hear(call))
        .background(|background| {
            tell_on(background, &asked, &told).map_err(|error| ProgramError::program(&error))
        })
}

fn tell_on<M: Machine>(
    background: &Background<'_, M>,
    asked: &Heard,
    told: &Heard,
) -> Result<(), Failed> {
    let (machine, mailbox) = (background.machine(), background.mailbox());
    let number = machine.number();
    let partner = machine.argument(0).ok_or("no partner")?;
    let partner = Processor(partner.parse()?);
    let terminal = background.console()?;
    // Echoed characters would come between the words of a line.
    terminal.configure(&TerminalSettings {
        echo: false,
        ..TerminalSettings::COOKED
    })?;
    terminal.set_policy(Policy::Block { timeout: PATIENCE })?;
    let files = background.files()?;
    let (lines, part, whole) = (
        format!("{}.lines", number.0),
        format!("{}.part", number.0),
        format!("{}.whole", number.0),
    );
    let mut log = files.open(&lines, OpenOptions::new().append().create())?;
    let mut console = terminal.console(mailbox).with_read_timeout(PAUSE);
    let mut line = [0; 64];
    let mut total = Total::default();
    let mut ended = false;
    while !machine.is_stopping() {
        match console.read(&mut line) {
            Ok(len) => match line[..len].trim_ascii() {
                b"end" => ended = true,
                b"total" => {
                    let (heard, others) = (asked.count.load(Relaxed), told.count.load(Relaxed));
                    let wrong = asked.wrong.load(Relaxed) + told.wrong.load(Relaxed);
                    let Total {
                        said,
                        asked,
                        told,
                        appended,
                        replaced,
                    } = total;
                    writeln!(
                        console,
                        "total {said} {asked} {told} {appended} {replaced} {heard} {others} {wrong}"
                    )?;
                }
                text => writeln!(console, "typed {}", String::from_utf8_lossy(text))?,
            },
            Err(ConsoleError::TimedOut { .. }) if ended => {}
            Err(ConsoleError::TimedOut { .. }) => {
                writeln!(console, "said {}", total.said)?;
                total.said += 1;
                if mailbox.send_with_reply(partner, ASKED, total.asked, PATIENCE)? != total.asked {
                    return Err(format!("message {} was answered wrongly", total.asked).into());
                }
                total.asked += 1;
                mailbox.send(partner, TOLD, total.told, PATIENCE)?;
                total.told += 1;
                if total.said.is_multiple_of(APPENDED) {
                    writeln!(log, "{}", total.appended)?;
                    total.appended += 1;
                    if total.appended.is_multiple_of(REPLACED) {
                        let text = format!("{:06}\n", total.replaced).repeat(COPIES);
                        let options = OpenOptions::new().write().create().truncate();
                        let mut file = files.open(&part, options)?;
                        file.write_all(text.as_bytes())?;
                        file.close()?;
                        files.rename(&part, &whole)?;
                        total.replaced += 1;
                    }
                }
            }
            Err(error) => return Err(error.into()),
        }
    }
    log.close()?;
    Ok(())
}

/// The counts that a teller prints at its end.
pub(crate) struct Tally {
    pub(crate) said: u32,
    pub(crate) asked: u32,
    pub(crate) told: u32,
    pub(crate) appended: u32,
    pub(crate) replaced: u32,
    /// Of what the partner asked and told.
    pub(crate) heard: u32,
    pub(crate) others: u32,
    pub(crate) wrong: u32,
}

impl Tally {
    /// From the line, if it is one.
    pub(crate) fn read(line: &str) -> Option<Self> {
        let numbers = line.strip_prefix("total ")?.split(' ');
        let numbers: Result<Vec<u32>, _> = numbers.map(str::parse).collect();
        match numbers.ok()?.as_slice() {
            &[said, asked, told, appended, replaced, heard, others, wrong] => Some(Self {
                said,
                asked,
                told,
                appended,
                replaced,
                heard,
                others,
                wrong,
            }),
            _ => None,
        }
    }

    /// The files of the teller `number` in `root`, compared with what it said.
    pub(crate) fn check_files(&self, root: &std::path::Path, number: u8) -> Vec<String> {
        let mut wrong = Vec::new();
        let expected: Vec<_> = (0..self.appended).map(|line| format!("{line}\n")).collect();
        let expected = expected.concat();
        match std::fs::read_to_string(root.join(format!("{number}.lines"))) {
            Ok(text) if text == expected => {}
            Ok(text) => wrong.push(format!(
                "{number}.lines has {} lines, not {} in order",
                text.lines().count(),
                self.appended
            )),
            Err(error) => wrong.push(format!("{number}.lines: {error}")),
        }
        let Some(last) = self.replaced.checked_sub(1) else {
            return wrong;
        };
        let expected = format!("{last:06}\n").repeat(COPIES);
        match std::fs::read_to_string(root.join(format!("{number}.whole"))) {
            Ok(text) if text == expected => {}
            Ok(_) => wrong.push(format!("{number}.whole is not that of {last}")),
            Err(error) => wrong.push(format!("{number}.whole: {error}")),
        }
        wrong
    }
}
