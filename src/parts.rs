//! Work that programs elsewhere do in parts, with no disk in common: all that they need goes there as bytes, what comes back are lines
//! with checksums, and only the program that sent them writes.

use crate::error::Result;

/// A job of which any part can be done anywhere.
pub trait Parts: Send {
    /// How many there are.
    fn count(&self) -> usize;

    /// Those that are still to be done.
    fn todo(&self) -> Vec<usize>;

    /// Part `index` in words.
    fn describe(&self, index: usize) -> String;

    /// All that is needed to do them, as bytes for the same version of the program.
    ///
    /// # Errors
    /// [`Error::Read`](crate::Error::Read) for a file that is no longer there.
    fn parcel(&self) -> Result<Vec<u8>>;

    /// Keeps what came back of a part; false where it is there already.
    ///
    /// # Errors
    /// [`Error::Parcel`](crate::Error::Parcel) or [`Error::Journal`](crate::Error::Journal) where the line is damaged;
    /// [`Error::Write`](crate::Error::Write).
    fn keep(&mut self, line: &[u8]) -> Result<bool>;
}
