//! [`Failure`]: why a program of the hand ended before it was told to.

use condor_fs::FileError;
use condor_hand::controller::{ControllerError, TableError};
use condor_hand::kinematics::JointLimitsError;
use condor_hand::plant::PlantError;
use thiserror::Error;

use crate::boards::{BoardError, WiresError};
use crate::recording::ServoRecordingError;

/// What something else says, as much of it as fits.
pub type FailureText = condor_rt::ShortText<80>;

/// The name of a file, as much of it as fits.
pub type FileName = condor_rt::ShortText<32>;

/// Why a program of the hand ended before it was told to, as far as only this hand knows.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum Failure {
    /// The file of the configuration.
    #[error("{name}: {error}")]
    File {
        /// Its name.
        name: &'static str,
        /// Why it cannot be read.
        error: FileError,
    },
    /// The file of the configuration holds no valid image.
    #[error("{name}: {error}")]
    Image {
        /// Its name.
        name: &'static str,
        /// The text of the reader's error.
        error: FailureText,
    },
    /// The boards of the rack cannot serve the configuration.
    #[error(transparent)]
    Boards(#[from] BoardError),
    /// A board cannot be opened.
    #[error(transparent)]
    Wires(#[from] WiresError),
    /// The bus did not answer the simulated robot.
    #[error("the bus at address {address:#x}: {kind}")]
    Bus {
        /// Where.
        address: usize,
        /// What was wrong.
        kind: condor_dev::BusErrorKind,
    },
    /// A configuration that gives a servo processor no finger.
    #[error("the configuration has no finger for processor {processor}")]
    NoFinger {
        /// The processor.
        processor: u8,
    },
    /// A configuration without this processor.
    #[error("the configuration has no processor {processor}")]
    NoProcessor {
        /// The processor.
        processor: u8,
    },
    /// A finger whose form has no closed solution.
    #[error("finger {finger} is not a planar one of four joints")]
    Form {
        /// The finger, from 0.
        finger: usize,
    },
    /// A hand of another number of fingers than the simulated robot has.
    #[error("the configuration has {fingers} fingers, the simulated robot {simulated}")]
    Hand {
        /// How many it has.
        fingers: usize,
        /// How many there are.
        simulated: usize,
    },
    /// A finger that cannot be controlled.
    #[error("finger {finger}: {error}")]
    Controller {
        /// The finger, from 0.
        finger: usize,
        /// Why not.
        error: ControllerError,
    },
    /// The table.
    #[error(transparent)]
    Table(#[from] TableError),
    /// The limits of the trajectories.
    #[error(transparent)]
    Trajectory(#[from] condor_hand::trajectory::TrajectoryError),
    /// The limits of a finger's joints.
    #[error(transparent)]
    Limits(#[from] JointLimitsError),
    /// A robot that cannot be.
    #[error(transparent)]
    Plant(#[from] PlantError),
    /// The moment arms of a finger.
    #[error(transparent)]
    Arms(#[from] condor_hand::tendon::ArmError),
    /// An argument of the program.
    #[error("unknown argument \"{argument}\"; the program takes {known}")]
    Argument {
        /// The argument that was given.
        argument: FailureText,
        /// The arguments that the program takes.
        known: &'static str,
    },
    /// An argument that a program cannot do without.
    #[error("the argument {wanted} is missing")]
    NoArgument {
        /// The argument.
        wanted: &'static str,
    },
    /// A recording of a servo processor.
    #[error("{name}: {error}")]
    Recording {
        /// The name of its file.
        name: FileName,
        /// What is wrong.
        error: ServoRecordingError,
    },
}

impl From<Failure> for condor_rt::ProgramError {
    fn from(failure: Failure) -> Self {
        Self::program(&failure)
    }
}
