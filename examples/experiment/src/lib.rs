//! An experiment: a motor gets a stimulus from a file, and its response is sampled at 1 kHz into another file.
//!
//! The loop puts the samples into shared memory, and the file service takes them from there: nobody copies them.
#![no_std]

use core::sync::atomic::Ordering::{Acquire, Relaxed, Release};
use core::sync::atomic::{AtomicI32, AtomicU32};
use core::time::Duration;

use condor_dev::drivers::{As5600, Pca9685};
use condor_dev::sim::{I2c, SimJoint};
use condor_dev::{I2cBus, Location, NoInterrupts, OpenMode, Switch, device_switch};
use condor_fs::Buffer;
use condor_rt::objects::ObjectKind;
use condor_rt::{Background, Buffering, Machine, OpenOptions, Program, ProgramError, Rate, STDIN};
use condor_rt::{Setup, Var};

const HZ: u16 = 1000;
/// The most samples, and the bytes of each: the duty of the motor in percent, and the angle in steps of the sensor.
const SAMPLES: usize = 10_000;
const BYTES: u32 = 8;
const ROOM: u32 = SAMPLES as u32 * BYTES;
const LOOK: Duration = Duration::from_millis(20);

device_switch! {
    struct Boards {
        motor: Pca9685 = [Location::i2c(0x40)],
        sensor: As5600 = [Location::i2c(As5600::ADDRESS)],
    }
}

/// The duty of each sample, in percent.
type Stimulus = [AtomicI32; SAMPLES];

/// The program of the experiment.
pub struct Experiment;

impl Program for Experiment {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), ProgramError> {
        // With a real motor, `I2cBus::new` has the I2C controller of the board instead.
        let joint = SimJoint::default();
        let i2c = I2cBus::new(I2c(&joint));
        let boards = Switch::<_, _, _, 2>::new(i2c, NoInterrupts, Boards::new());
        boards.start();
        let motor = boards.open_typed(Boards::motor, 0, OpenMode::WRITE)?;
        let sensor = boards.open_typed(Boards::sensor, 0, OpenMode::READ)?;
        let (duty, angle) = (Var::new("duty", "%"), Var::new("angle", "steps"));
        let stimulus: Stimulus = [const { AtomicI32::new(0) }; SAMPLES];
        let (wanted, taken) = (AtomicU32::new(0), AtomicU32::new(0));

        let mut setup = Setup::new(machine)?;
        let own = setup.own().clone();
        let samples = setup.place("samples", ObjectKind::Other, |it| {
            Buffer::new(&own, it, ROOM)
        })?;
        let memory = samples.memory().clone();
        let sample = |number: u32| {
            let percent = stimulus.get(number as usize)?.load(Relaxed);
            let pulse = percent.unsigned_abs() as u16 * (Pca9685::CYCLE / 100);
            let duties = if percent < 0 { [0, pulse] } else { [pulse, 0] };
            motor.set_duties(motor.registers, 0, &duties).ok()?;
            joint.advance(1.0 / f32::from(HZ));
            let steps = u32::from(sensor.angle(sensor.registers).ok()?);
            duty.set(percent);
            angle.set(steps);
            memory.set_word(number * BYTES, percent as u32).ok()?;
            memory.set_word(number * BYTES + 4, steps).ok()
        };
        (setup.console()?.files()?.watch(&duty).watch(&angle))
            .servo("sample", Rate::hz(HZ.into()), &mut |_| {
                let number = taken.load(Relaxed);
                if number < wanted.load(Acquire) && sample(number).is_some() {
                    taken.store(number + 1, Release);
                }
            })
            .background(|background| {
                let number = read(background, &stimulus)?;
                let (files, mut stdio) = (background.files()?, background.stdio());
                let mut samples = Some(samples);
                while !background.is_stopping() {
                    if stdio.read_line(STDIN, &mut [0; 16], LOOK)?.is_some() {
                        wanted.store(number, Release);
                    }
                    if taken.load(Acquire) == number
                        && let Some(samples) = samples.take()
                    {
                        let options = OpenOptions::new().write().create().truncate();
                        let mut file = files.open("response", options)?;
                        let written = file.write_buffer(samples, number * BYTES);
                        let (written, _) = written.map_err(|it| it.error)?;
                        background.print(format_args!("{written} bytes are in `response`\n"));
                    }
                }
                Ok(())
            })
    }
}

/// Reads the stimulus from lines of a duration in ms and a duty in percent, at most 10 s in all, and returns its number of
/// samples.
fn read<M: Machine>(background: &Background<'_, M>, to: &Stimulus) -> Result<u32, ProgramError> {
    let files = background.files()?;
    let mut stdio = background.stdio().with_files(&files);
    let file = stdio.open_file("stimulus", OpenOptions::new().read(), Buffering::None)?;
    let (mut line, mut free) = ([0; 32], to.iter());
    while let Some(text) = stdio.read_line(file, &mut line, LOOK)?
        && !text.is_empty()
    {
        let text = text.trim();
        let step = text.split_once(' ');
        let step = step.and_then(|(time, duty)| Some((time.parse().ok()?, duty.parse().ok()?)));
        let step = step.filter(|(time, duty)| free.len() >= *time && (-100..=100).contains(duty));
        let Some((time, duty)) = step else {
            return Err(ProgramError::program(&format_args!(
                "stimulus: {text} is not MS PERCENT"
            )));
        };
        for sample in free.by_ref().take(time) {
            sample.store(duty, Relaxed);
        }
    }
    Ok(to.len().saturating_sub(free.len()) as u32)
}
