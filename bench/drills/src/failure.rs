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

impl From<Failure> for condor_rt::Error {
    fn from(failure: Failure) -> Self {
        Self::program(&failure)
    }
}
