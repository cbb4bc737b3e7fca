//! Snapshots: all that changes in a stepper during a run, in memory or serialised for another process.

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use twox_hash::XxHash3_128;

use super::Stepper;
use super::run_state::SavedRun;
use crate::error::{Error, Result};
use crate::model::Inputs;
use crate::system::{State, System};

/// The first bytes of every serialised snapshot.
const FILE_SIGNATURE: [u8; 8] = *b"caudal\x00\x01";

/// Everything that changes in a [`Stepper`]: time, state, inputs, totals and counts. It contains neither the model nor matrices
/// and factors, which every step recomputes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Snapshot {
    /// The fingerprint of the scene, see [`Scene::fingerprint`](crate::scene::Scene::fingerprint), or of the model of a stepper
    /// built without a scene.
    pub(super) scene: u128,
    saved: SavedRun,
}

/// The error for a snapshot of another scene.
const WRONG_SCENE: &str = "it was saved from another scene or model, or from this one with other parameters";

/// The header of a serialised snapshot.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Header {
    magic: [u8; 8],
    version: String,
    scene: u128,
    /// Checksum of the bytes that follow.
    checksum: u128,
}

impl Header {
    fn of(scene: u128, bytes: &[u8]) -> Self {
        let checksum = XxHash3_128::oneshot(bytes);
        Self { magic: FILE_SIGNATURE, version: env!("CARGO_PKG_VERSION").to_string(), scene, checksum }
    }

    fn check_version(&self) -> Result<()> {
        let here = env!("CARGO_PKG_VERSION");
        if self.version == here {
            return Ok(());
        }
        refuse(&format!("it was saved by caudal {}; this is {here}", self.version))
    }

    /// Deserialises the content that follows the header, after checking version and checksum.
    fn read<T: DeserializeOwned>(&self, content: &[u8]) -> Result<T> {
        self.check_version()?;
        if self.checksum != XxHash3_128::oneshot(content) {
            return refuse("it is damaged: its checksum is wrong");
        }
        postcard::from_bytes(content).map_err(|error| Error::Snapshot(error.to_string()))
    }
}

impl Snapshot {
    /// Time, s.
    pub fn time(&self) -> f64 {
        let now = &self.saved.now;
        now.pending_time.unwrap_or(now.state.t)
    }

    /// Serialises the snapshot for a stepper of the same scene, in any process of the same program version.
    ///
    /// # Errors
    /// Errors of [`seal`].
    pub fn serialize(&self) -> Result<Vec<u8>> {
        seal(self.scene, self)
    }

    /// Deserialises a snapshot of any scene. [`Stepper::restore`] returns an error for a snapshot of another scene.
    ///
    /// # Errors
    /// [`Error::Snapshot`] for bytes that are damaged, or come from another version or kind of file.
    pub fn deserialize(bytes: &[u8]) -> Result<Self> {
        let (header, content) = header_of(bytes)?;
        let snapshot: Self = header.read(content)?;
        if snapshot.scene == header.scene { Ok(snapshot) } else { refuse(WRONG_SCENE) }
    }
}

impl Stepper {
    /// A copy of everything that changes.
    pub fn save(&self) -> Snapshot {
        Snapshot { scene: self.scene, saved: self.saved() }
    }

    /// Restores a snapshot of this scene. The run that follows is bit-identical to the run that followed the snapshot.
    ///
    /// # Errors
    /// [`Error::Snapshot`] for a snapshot of another scene or model; [`Error::WrongLength`] if its arrays do not fit.
    pub fn restore(&mut self, snapshot: &Snapshot) -> Result<()> {
        if snapshot.scene != self.scene {
            return refuse(WRONG_SCENE);
        }
        let (expected, found) = (self.now.state.q.len(), snapshot.saved.now.state.q.len());
        if !self.fits(snapshot) {
            return Err(Error::WrongLength { name: "snapshot", expected, found });
        }
        self.restore_saved(&snapshot.saved);
        self.now.inputs_changed = true;
        Ok(())
    }

    /// Deserialises a snapshot of this scene from `bytes`.
    ///
    /// # Errors
    /// Errors of [`open`].
    pub fn deserialize(&self, bytes: &[u8]) -> Result<Snapshot> {
        let snapshot = open(self.scene, bytes)?;
        if self.fits(&snapshot) { Ok(snapshot) } else { refuse("its sizes do not match this scene") }
    }

    /// True if every array of `other` has the same length as here.
    fn fits(&self, other: &Snapshot) -> bool {
        let SavedRun { now, inputs: given, extrapolation, .. } = &other.saved;
        let (nodes, unknowns, here) = (self.dynamics.nodes(), self.now.state.q.len(), &self.now.state);
        let State { t: _, q, v, a, links, memory } = &now.state;
        let lengths = [q.len(), v.len(), a.len(), now.metrics.first_positions.len()];
        let inputs = |inputs: &Inputs| {
            let lagging = inputs.lagging.as_ref().map(|lagging| &lagging.given);
            let own = [inputs.natural.as_ref(), inputs.moment.as_ref(), lagging];
            own.into_iter().flatten().all(|x| x.len() == nodes)
                && inputs.force.as_ref().is_none_or(|x| x.len() == 2 * nodes)
        };
        lengths.iter().all(|len| *len == unknowns)
            && (links.len(), memory.len()) == (here.links.len(), here.memory.len())
            && now.metrics.now.nodes() == nodes
            && inputs(given)
            && extrapolation.as_ref().is_none_or(|extrapolation| extrapolation.parts().all(inputs))
    }
}

/// Serialises `content` for readers with the same scene, identified by its [fingerprint](crate::scene::Scene::fingerprint), and
/// the same version of the program.
///
/// # Errors
/// [`Error::Snapshot`].
pub fn seal(scene: u128, content: &impl Serialize) -> Result<Vec<u8>> {
    let failed = |error: postcard::Error| Error::Snapshot(error.to_string());
    let content = postcard::to_stdvec(content).map_err(failed)?;
    let mut bytes = postcard::to_stdvec(&Header::of(scene, &content)).map_err(failed)?;
    bytes.extend(content);
    Ok(bytes)
}

/// Deserialises what [`seal`] has serialised to `bytes`.
///
/// # Errors
/// [`Error::Snapshot`] for bytes that are damaged, or come from another scene, version or kind of file.
pub fn open<T: DeserializeOwned>(scene: u128, bytes: &[u8]) -> Result<T> {
    let (header, content) = header_of(bytes)?;
    header.check_version()?;
    if header.scene != scene {
        return refuse(WRONG_SCENE);
    }
    header.read(content)
}

/// Splits `bytes` into the header and the content that follows.
fn header_of(bytes: &[u8]) -> Result<(Header, &[u8])> {
    let header = postcard::take_from_bytes::<Header>(bytes).ok().filter(|(header, _)| header.magic == FILE_SIGNATURE);
    header.map_or_else(|| refuse("these bytes are not a saved state of caudal, or are damaged"), Ok)
}

fn refuse<T>(text: &str) -> Result<T> {
    Err(Error::Snapshot(text.to_string()))
}
