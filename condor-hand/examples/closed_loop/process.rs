//! A plant that is another program, behind lines of text.

use std::fmt::Write as _;
use std::io::{BufRead as _, BufReader, Write as _};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use condor_hand::servo::FingerReadings;
use nalgebra::SVector;

use super::rig::{ACTUATORS, FINGERS, HandState, JOINTS, OfActuators, OfJoints, Plant, Result};

const COUNT: usize = FINGERS * JOINTS;

/// The protocol is that of `mujoco_hand.py`: `reset` or `step` with numbers, answered by
/// positions, rates, efforts, and whatever else the plant has, in one line.
pub(crate) struct Process {
    child: Child,
    requests: ChildStdin,
    answers: BufReader<ChildStdout>,
}

impl Process {
    pub(crate) fn start(command: &[String]) -> Result<Self> {
        let (program, arguments) = command.split_first().ok_or("no command")?;
        let mut child = Command::new(program)
            .args(arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(|error| format!("{program} could not be started: {error}"))?;
        let requests = child.stdin.take().ok_or("the plant has no input")?;
        let output = child.stdout.take().ok_or("the plant has no output")?;
        let answers = BufReader::new(output);
        Ok(Self {
            child,
            requests,
            answers,
        })
    }

    fn ask(&mut self, request: &str) -> Result<HandState> {
        writeln!(self.requests, "{request}")
            .map_err(|error| format!("the plant takes no request: {error}"))?;
        let mut answer = String::new();
        self.answers.read_line(&mut answer)?;
        let numbers: std::result::Result<Vec<f64>, _> =
            answer.split_whitespace().map(str::parse).collect();
        match numbers {
            Ok(numbers) if numbers.len() >= 4 * COUNT => Ok(state(&numbers)),
            _ => Err(format!("the plant answers: {answer}").into()),
        }
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // Both fail if the process has ended by itself.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Plant for Process {
    fn reset(&mut self, positions: &OfJoints<f64>) -> Result<HandState> {
        let mut request = "reset".to_owned();
        for position in positions.iter().flatten() {
            write!(request, " {position}")?;
        }
        self.ask(&request)
    }

    fn step(&mut self, commands: &OfActuators) -> Result<HandState> {
        let mut request = "step".to_owned();
        for command in commands.iter().flatten() {
            write!(request, " {command}")?;
        }
        self.ask(&request)
    }
}

/// Positions, rates, which sensors do not tell, and efforts.
fn state(numbers: &[f64]) -> HandState {
    std::array::from_fn(|finger| FingerReadings {
        position: SVector::from_fn(|joint, _| numbers[JOINTS * finger + joint]),
        actuator_position: [0.0; 8],
        effort: std::array::from_fn(|actuator| numbers[2 * COUNT + ACTUATORS * finger + actuator]),
        touch: 0.0,
    })
}
