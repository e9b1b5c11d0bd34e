//! [`Failure`]: why a drill ends before its time.

/// Why a drill ends before its time, or has not gone well.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Failure {
    /// An argument that is missing or wrong.
    #[error("an argument is missing or wrong: {expected}")]
    Argument {
        /// What is expected.
        expected: &'static str,
    },
    /// What the program was set up of.
    #[error(transparent)]
    Setup(condor_rt::Error),
    /// Somebody is not ready in time.
    #[error("processor {processor} is not ready in time")]
    Late {
        /// Whose part is missing.
        processor: u8,
    },
    /// Something was counted that must not be.
    #[error("something is wrong; see the counts")]
    Wrong,
}

/// What condor-rt has errors of.
impl<E: Into<condor_rt::Error>> From<E> for Failure {
    fn from(error: E) -> Self {
        Self::Setup(error.into())
    }
}
