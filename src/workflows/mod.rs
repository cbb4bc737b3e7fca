//! Workflows on scenes, on threads or on distributed workers: run, study, sweep, design.

#[cfg(feature = "report")]
pub mod distributed;

pub mod run;

#[cfg(feature = "report")]
pub mod study;

#[cfg(feature = "report")]
pub mod sweep;

#[cfg(feature = "design")]
pub mod design;
