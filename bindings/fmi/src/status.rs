//! How calls end: the standards' statuses, and why a call was refused.

use caudal::error::Error;

/// How a call ended; the numbers are those of both versions of the standard.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(C)]
pub enum Status {
    /// All well.
    Ok = 0,
    /// Done, but not quite as asked.
    Warning = 1,
    /// Not done; what was before is still there.
    Discard = 2,
    /// The call is not allowed here.
    Error = 3,
    /// The instance is broken.
    Fatal = 4,
}

impl Status {
    pub fn category(self) -> &'static str {
        match self {
            Self::Ok => "logSteps",
            Self::Warning => "logStatusWarning",
            Self::Discard => "logStatusDiscard",
            Self::Error | Self::Fatal => "logStatusError",
        }
    }
}

/// Why a call was refused.
#[derive(Debug)]
pub struct Refusal {
    pub status: Status,
    pub message: String,
}

impl From<Error> for Refusal {
    fn from(error: Error) -> Self {
        Self { status: Status::Error, message: error.to_string() }
    }
}

impl Refusal {
    /// A step that cannot be made.
    pub fn discard(error: Error) -> Self {
        Self { status: Status::Discard, message: error.to_string() }
    }
}

/// Refuses a call.
pub fn refuse<T>(message: impl Into<String>) -> Outcome<T> {
    Err(Refusal { status: Status::Error, message: message.into() })
}

pub type Outcome<T = ()> = std::result::Result<T, Refusal>;
