//! [`RemoteError`].

use std::time::Duration;

use crate::wire::RemoteRefusal;

/// The reason why a request to a robot has failed, or why a client cannot connect.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RemoteError {
    /// The gateway has refused the request.
    #[error(transparent)]
    Refused(#[from] RemoteRefusal),
    /// No answer has come: the robot cannot be reached, or the client is not allowed to ask. What was asked for may
    /// have been done.
    #[error(
        "the robot `{robot}` has not answered within {timeout:.1?}: its gateway cannot be reached, or this client has \
         no right to ask"
    )]
    NoAnswer {
        /// The name of the robot.
        robot: String,
        /// The time that it had.
        timeout: Duration,
    },
    /// The answer cannot be read: it is not one of this version.
    #[error("cannot understand the answer of the gateway, whose version may differ: {0}")]
    Strange(String),
    /// There is no topic of this name.
    #[error("there is no topic `{name}`; the topics are {}", there.join(", "))]
    NoTopic {
        /// The name that was asked for.
        name: String,
        /// The names of all topics.
        there: Vec<String>,
    },
    /// The name of a robot or a client is wrong.
    #[error("{0}")]
    Name(String),
    /// zenoh has refused a configuration, or has failed.
    #[error("zenoh, the network library, failed: {0}")]
    Zenoh(String),
}

impl From<zenoh::Error> for RemoteError {
    fn from(error: zenoh::Error) -> Self {
        Self::Zenoh(error.to_string())
    }
}
