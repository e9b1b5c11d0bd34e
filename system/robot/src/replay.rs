//! The program that computes a servo processor's outputs again, from a [recording](crate::recording).
//!
//! The argument `from=FILE` names the recording. `to=FILE` names the file for the
//! [outputs](ServoOutputs), 320 bytes a tick; without it, no outputs are written. The file gets its name when it is
//! complete. Both are files of the
//! file service. The program needs neither boards nor other processors, and it may run as any
//! processor: the number of the recorded processor is in the recording. The configuration must be
//! that of the recorded run.
//!
//! The controllers are those of a [servo](crate::servo), in the same order and from the same counts, and
//! the elementary functions are the same on every target. So the outputs on every target are those
//! of the recorded run to the last bit. If they are not, the program fails and reports the first
//! tick that differs. Otherwise its terminal shows the number of ticks and the hash of the outputs:
//! the FNV-1a of 64 bits over the bytes of the outputs' file.

use core::fmt::Write as _;

use condor_dev::stdio::{BufReader, BufWriter, Buffering};
use condor_fs::{Errno, File, FileSystem, OpenOptions};
use condor_hand::controller::{FingerController, FingerTick};
use condor_hand::grasp::distributed::FingerControllers;
use condor_hand::servo::FingerReadings;
use condor_mbox::{MemoryWindow, Messenger};
use condor_rt::{
    Background, FILES, FilesOf, Machine, MailboxOf, Program, ProgramError, Setup, ShortText,
};
use embedded_io::Write;
use nalgebra::Vector3;
use zerocopy::IntoBytes;

use crate::arguments::Replay as Arguments;
use crate::failure::Failure;
use crate::recording::{Difference, Fnv, Row, Rows, ServoOutputs, ServoRecordingError};
use crate::servo::{Control, Controllers, Servos, controllers, rate_hz, served};
use crate::{ACTUATORS, Actuators, JOINTS, Mechanism, RobotDescription, start};

/// Bytes that are read or written at once.
const AT_ONCE: usize = 4096;
/// The bytes of the name under which outputs are written.
const HALF_BYTES: usize = 256;

/// The program that computes the outputs of a servo processor again from a recording, and fails if they differ from the
/// recorded ones.
#[derive(Clone, Copy, Debug, Default)]
pub struct Replay;

impl Program for Replay {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), ProgramError> {
        Setup::new(machine)?
            .console()?
            .files()?
            .background(|background| {
                let hand = start::configuration(background)?;
                let replaying = Replaying {
                    background,
                    hand: &hand,
                    arguments: Arguments::of(machine)?,
                };
                replaying.run(&background.files()?)
            })
    }
}

/// The state of a replay.
struct Replaying<'r, M: Machine> {
    background: &'r Background<'r, M>,
    hand: &'r RobotDescription,
    arguments: Arguments<'r>,
}

impl<'r, M: Machine> Replaying<'r, M> {
    fn run(&self, files: &FilesOf<'r, M>) -> Result<(), ProgramError> {
        let Arguments { from, to } = self.arguments;
        let reading = |error: ServoRecordingError| Failure::Recording {
            name: ShortText::of(&from),
            error,
        };
        let recording = files.open(from, OpenOptions::new().read());
        let recording = recording.map_err(|error| reading(error.into()))?;
        let (head, mut rows) =
            Rows::new(BufReader::<_, AT_ONCE>::new(recording)).map_err(reading)?;
        let number = u8::try_from(head.processor).unwrap_or(u8::MAX);
        let configured_hz = rate_hz(self.hand, number);
        if head.rate_hz != configured_hz {
            return Err(ProgramError::from(reading(ServoRecordingError::Rate {
                recorded_hz: head.rate_hz,
                processor: number,
                configured_hz,
            })));
        }
        let mut control = Control::new(self.hand, served(self.hand, number))?;
        let mut servos = ReplayedControllers {
            controllers: controllers(self.hand, number)?,
            row: None,
        };
        let mut sink = Self::sink(files, to)?;
        let mut hash = Fnv::new();
        let mut difference = None;
        while let Some(row) = rows.next().map_err(reading)? {
            if self.background.is_stopping() {
                return Ok(());
            }
            let done = row.done;
            let output = servos.step(&mut control, row);
            hash.add(output.as_bytes());
            if (output.counts, hash.value()) != (done.counts, done.hash) {
                // From here on the hashes say nothing new.
                difference.get_or_insert(ServoRecordingError::Differs {
                    tick: rows.ticks() - 1,
                    difference: Difference::of(&done.counts, &output.counts),
                });
            }
            sink.put(output.as_bytes())?;
        }
        sink.close()?;
        self.background.print(format_args!(
            "replayed {} ticks of processor {number}: hash of the outputs {:016x}\n",
            rows.ticks(),
            hash.value(),
        ));
        difference.map_or(Ok(()), |error| Err(reading(error).into()))
    }

    fn sink<'f>(
        files: &'f FilesOf<'r, M>,
        to: Option<&'r str>,
    ) -> Result<Sink<'f, 'r, MailboxOf<'r, M>, M::Window>, ProgramError> {
        let mut sink = Sink {
            files,
            name: to.unwrap_or_default(),
            half: heapless::String::new(),
            writer: None,
        };
        if to.is_some() {
            let written = write!(sink.half, "{}.half", sink.name);
            written.map_err(|_| sink.failed(condor_fs::FileError::from(Errno::NAMETOOLONG)))?;
            let options = OpenOptions::new().write().create().truncate();
            let file = files.open(&*sink.half, options);
            let file = file.map_err(|error| sink.failed(error))?;
            sink.writer = Some(BufWriter::new(file, Buffering::Block));
        }
        Ok(sink)
    }
}

/// The file of what is put out, if there is one.
struct Sink<'f, 'm, S: Messenger + ?Sized, W: MemoryWindow> {
    files: &'f FileSystem<'m, S, W, FILES>,
    name: &'m str,
    /// The file's name until it is complete.
    half: heapless::String<HALF_BYTES>,
    writer: Option<BufWriter<File<'f, 'm, S, W, FILES>, AT_ONCE>>,
}

impl<S: Messenger + ?Sized, W: MemoryWindow + Clone> Sink<'_, '_, S, W> {
    fn put(&mut self, bytes: &[u8]) -> Result<(), Failure> {
        let Some(writer) = &mut self.writer else {
            return Ok(());
        };
        let written = writer.write_all(bytes);
        written.map_err(|error| self.failed(error))
    }

    fn close(mut self) -> Result<(), Failure> {
        let Some(mut writer) = self.writer.take() else {
            return Ok(());
        };
        writer.flush().map_err(|error| self.failed(error))?;
        let file = writer.into_inner();
        let named = file
            .sync()
            .and_then(|()| file.close())
            .and_then(|()| self.files.rename(&*self.half, self.name));
        named.map_err(|error| self.failed(error))
    }

    fn failed(&self, error: impl Into<ServoRecordingError>) -> Failure {
        Failure::Recording {
            name: ShortText::of(&self.name),
            error: error.into(),
        }
    }
}

/// The controllers, which are asked for what was asked for in the recorded run.
struct ReplayedControllers {
    controllers: Controllers,
    row: Option<Row>,
}

impl ReplayedControllers {
    fn step(&mut self, control: &mut Control<'_>, row: Row) -> ServoOutputs {
        let given = row.given.clone();
        let measured = control.measure(given.period_s, self, |number, _| row.inputs.get(number));
        self.row = Some(row);
        let ticks = control.step(&measured, &given, self);
        control.output(&ticks, |_, _| {})
    }
}

impl FingerControllers<JOINTS> for ReplayedControllers {
    type Controller = FingerController<Mechanism, Actuators, JOINTS, ACTUATORS>;

    fn of_finger(&mut self, finger: usize) -> Option<&mut Self::Controller> {
        self.controllers.of_finger(finger)
    }
}

impl Servos for ReplayedControllers {
    fn tick(
        &mut self,
        finger: usize,
        sensed: &FingerReadings<JOINTS, ACTUATORS>,
        gravity: &Vector3<f64>,
        period_s: f64,
    ) -> Option<FingerTick<JOINTS, ACTUATORS>> {
        let controller = self.controllers.of_finger(finger)?;
        let requests = self.row.iter().flat_map(|row| &row.requests);
        for (_, request) in requests.filter(|(of, _)| *of == finger) {
            request.repeat(controller);
        }
        Some(controller.tick(sensed, gravity, period_s))
    }
}
