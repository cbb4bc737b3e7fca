//! The status codes of the standards, and errors of calls.

use caudal::error::Error;

/// The status of a call, with the numbers of both versions of the standard.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(C)]
pub enum Status {
    /// Success.
    Ok = 0,
    /// Success, with a warning.
    Warning = 1,
    /// The call was not executed; the previous state is unchanged.
    Discard = 2,
    /// The call is not allowed in this situation.
    Error = 3,
    /// The instance is unusable.
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

/// The error of a call.
#[derive(Debug)]
pub struct FmiError {
    pub status: Status,
    pub message: String,
}

impl From<Error> for FmiError {
    fn from(error: Error) -> Self {
        Self { status: Status::Error, message: error.to_string() }
    }
}

impl FmiError {
    /// The error of a step that fails.
    pub fn discard(error: Error) -> Self {
        Self { status: Status::Discard, message: error.to_string() }
    }
}

/// Returns an error for a call.
pub fn refuse<T>(message: impl Into<String>) -> FmiResult<T> {
    Err(FmiError { status: Status::Error, message: message.into() })
}

pub type FmiResult<T = ()> = std::result::Result<T, FmiError>;
