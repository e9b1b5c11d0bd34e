//! [`Failure`]: an error with its text, and the exception that it becomes.

use core::error::Error;
use core::fmt;
use core::time::Duration;

use condor_host::control::ControlClientError;
use condor_host::system::FindError;
use condor_host::view::ViewError;
use condor_mbox::exchange::ExchangeError;
use condor_robot::packet::ClientError;
use condor_toml::{TextError, TextErrors};
use condor_vars::RequestError;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

/// The class of an exception in `condor.errors`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// The base class, `Error`.
    Other,
    /// The exception `TimedOut`.
    TimedOut,
    /// The exception `NotFound`.
    NotFound,
    /// The exception `Refused`.
    Refused,
}

/// An error for Python: its text, and the class of the exception. It can be sent from thread to thread.
#[derive(Clone, Debug)]
pub(crate) struct Failure {
    pub(crate) kind: Kind,
    pub(crate) text: String,
}

impl Failure {
    pub(crate) fn new(kind: Kind, text: impl Into<String>) -> Self {
        let text = text.into();
        Self { kind, text }
    }

    pub(crate) fn not_found(text: impl Into<String>) -> Self {
        Self::new(Kind::NotFound, text)
    }

    pub(crate) fn refused(text: impl Into<String>) -> Self {
        Self::new(Kind::Refused, text)
    }

    pub(crate) fn timed_out(text: impl Into<String>) -> Self {
        Self::new(Kind::TimedOut, text)
    }
}

impl<E: Into<Box<dyn Error>>> From<E> for Failure {
    fn from(error: E) -> Self {
        let error = error.into();
        let mut cause: Option<&(dyn Error + 'static)> = Some(&*error);
        let mut kind = Kind::Other;
        while let (Kind::Other, Some(one)) = (kind, cause) {
            kind = kind_of(one);
            cause = one.source();
        }
        Self::new(kind, error.to_string())
    }
}

/// Returns the class of exception for `error`, without regard to its source.
fn kind_of(error: &(dyn Error + 'static)) -> Kind {
    if error.is::<FindError>()
        || matches!(
            error.downcast_ref(),
            Some(condor_robot::host::ConnectError::NoQueue { .. })
        )
    {
        return Kind::NotFound;
    }
    if error.is::<TextError>() || error.is::<TextErrors>() {
        return Kind::Refused;
    }
    let mailbox = error.downcast_ref();
    let exchange = match error.downcast_ref() {
        Some(RequestError::Exchange(exchange)) => Some(exchange),
        Some(RequestError::Busy { .. }) => return Kind::TimedOut,
        Some(
            RequestError::OutOfBounds { .. }
            | RequestError::Conflict { .. }
            | RequestError::WrongKind { .. }
            | RequestError::NoParam { .. },
        ) => return Kind::Refused,
        _ => error.downcast_ref(),
    };
    let exchange = match error.downcast_ref() {
        Some(ClientError::Exchange(exchange)) => Some(exchange),
        Some(ClientError::TimedOut { .. }) => return Kind::TimedOut,
        Some(
            ClientError::Length { .. }
            | ClientError::NotYours
            | ClientError::NotInControl(_)
            | ClientError::Exhausted
            | ClientError::Refused(_)
            | ClientError::Points(_),
        ) => return Kind::Refused,
        _ => exchange,
    };
    let mailbox = match (exchange, error.downcast_ref()) {
        (Some(ExchangeError::Mailbox(error)), _) | (_, Some(ViewError::Mailbox(error))) => {
            Some(error)
        }
        (_, Some(ViewError::NoVector(_))) => return Kind::NotFound,
        _ => mailbox,
    };
    match (mailbox, error.downcast_ref()) {
        (
            Some(
                condor_mbox::MailboxError::TimedOut { .. }
                | condor_mbox::MailboxError::Stalled { .. },
            ),
            _,
        )
        | (_, Some(ControlClientError::TimedOut { .. })) => Kind::TimedOut,
        (
            Some(
                condor_mbox::MailboxError::Refused { .. }
                | condor_mbox::MailboxError::HandlerFailed { .. },
            ),
            _,
        )
        | (_, Some(ControlClientError::Refused(_))) => Kind::Refused,
        (Some(condor_mbox::MailboxError::NoHandler { .. }), _) => Kind::NotFound,
        _ => Kind::Other,
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

impl From<Failure> for PyErr {
    fn from(failure: Failure) -> Self {
        let name = match failure.kind {
            Kind::Other => "Error",
            Kind::TimedOut => "TimedOut",
            Kind::NotFound => "NotFound",
            Kind::Refused => "Refused",
        };
        Python::attach(|py| {
            let made = py
                .import("condor.errors")
                .and_then(|errors| errors.getattr(name)?.call1((&failure.text,)));
            match made {
                Ok(exception) => Self::from_value(exception),
                // The package is not whole.
                Err(_) => PyRuntimeError::new_err(failure.text),
            }
        })
    }
}

/// Converts a number of seconds from Python. `what` is the name of the argument in errors.
pub(crate) fn seconds(what: &str, seconds: f64) -> Result<Duration, Failure> {
    Duration::try_from_secs_f64(seconds).map_err(|_| {
        Failure::refused(format!(
            "`{what}` must be a number of seconds, 0 or more, not {seconds}"
        ))
    })
}
