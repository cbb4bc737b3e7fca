//! Scenes: what a user edits. TOML with units in the keys; unknown keys and values out of range are refused.

mod actuation;
mod body;
mod document;
mod failure;
pub mod files;
pub mod fluid;
mod head;
pub mod layers;
mod loads;
pub mod parameter;
mod record;
mod rod;
#[cfg(feature = "schema")]
pub(crate) mod schema;
mod solver;
mod start;
mod table;
pub mod value;
mod variants;

use std::path::{Path, PathBuf};

use serde::{Deserialize, Deserializer};
use twox_hash::XxHash3_128;

pub use actuation::ActuationTable;
pub use body::HeadBodyTable;
#[cfg(feature = "report")]
pub(crate) use document::rivals;
pub use document::{Document, Fault};
pub use files::Files;
pub use fluid::{DragTable, MediumTable, ReactiveTable};
pub use head::{HeadKind, HeadTable};
pub use layers::{LayerTable, ShearTable};
pub use loads::{LoadsTable, PointLoad};
pub use record::{NodesTable, RecordTable};
pub use rod::RodTable;
pub(crate) use solver::whole_steps;
pub use solver::{FormKey, SolverTable};
pub use start::{StartKind, StartTable};
use value::Finite;

use crate::error::{Error, Result};
use crate::model::Model;
use crate::reduced::FluidChoice;

/// Fewest and most nodes a scene may have.
pub const NODES: [u64; 2] = [3, 10_000_000];

/// A scene: everything there is to say about a run.
///
/// From a file by [`load`](Self::load), from text by [`Document`]; as a value of serde it is read as such a text, with the same checks.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(remote = "Self", deny_unknown_fields)]
pub struct Scene {
    /// Name; the file's where the scene has none.
    #[serde(default)]
    pub name: String,
    /// The rod.
    pub rod: RodTable,
    /// Actuation; absent: a passive rod.
    pub actuation: Option<ActuationTable>,
    /// How the run starts.
    #[serde(default)]
    pub start: StartTable,
    /// The fluid.
    pub medium: Option<MediumTable>,
    /// Drag; absent: none.
    pub drag: Option<DragTable>,
    /// The water that the rod accelerates; absent: no added mass.
    pub reactive: Option<ReactiveTable>,
    /// A rigid body before the rod; absent: none.
    pub head_body: Option<HeadBodyTable>,
    /// Gravity and point loads; absent: none.
    pub loads: Option<LoadsTable>,
    /// The head; absent: free.
    #[serde(default)]
    pub head: HeadTable,
    /// How it is solved.
    pub solver: SolverTable,
    /// What is recorded.
    #[serde(default)]
    pub record: RecordTable,
    /// What `caudal design` is asked for; a run takes no notice of it.
    #[cfg_attr(feature = "schema", schemars(with = "Option<serde_json::Map<String, serde_json::Value>>"))]
    pub design: Option<toml::Table>,
    /// Folder that tables are looked for in.
    #[serde(skip)]
    pub folder: PathBuf,
    /// Where these are read from.
    #[serde(skip)]
    pub(crate) read_from: Files,
    /// The file that says it, as errors name it.
    #[serde(skip)]
    file: PathBuf,
    /// Names the contents of its tables when it was read.
    #[serde(skip)]
    contents: u128,
    /// The law of the fluid that was taken when it was read, where it leaves that to the program: scenes made from it keep it.
    #[serde(skip)]
    taken: Option<FluidChoice>,
}

/// The tables of a scene, each key judged by itself only.
struct Unchecked(Scene);

impl<'de> Deserialize<'de> for Unchecked {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        Scene::deserialize(deserializer).map(Self)
    }
}

impl<'de> Deserialize<'de> for Scene {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        let text = toml::Table::deserialize(deserializer)?.to_string();
        Document::new("scene", text).scene().map_err(serde::de::Error::custom)
    }
}

impl Scene {
    /// Reads and checks a scene file.
    ///
    /// # Errors
    /// [`Error::Read`], [`Error::Scene`].
    pub fn load(path: impl AsRef<Path>) -> Result<Self> {
        Document::read(path.as_ref())?.scene()
    }

    /// Checks what no single key can tell.
    fn check(&self) -> std::result::Result<(), Fault> {
        self.check_name()?;
        self.rod.check()?;
        self.actuation.as_ref().map_or(Ok(()), ActuationTable::check)?;
        self.start.check(&self.head)?;
        self.check_body()?;
        self.check_fluid()?;
        let nodes = self.nodes();
        self.loads.as_ref().map_or(Ok(()), |loads| loads.check(nodes))?;
        self.record.check_nodes(nodes)?;
        self.head.check()?;
        self.rod.check_sizes(self.head.kind != HeadKind::Free || self.head_body.is_some())?;
        let duration = self.solver.duration_s.get();
        self.solver.check_steps()?;
        self.record.check_rows(duration)?;
        self.check_model()?;
        self.check_method()
    }

    /// A name is also that of a folder.
    fn check_name(&self) -> std::result::Result<(), Fault> {
        let refuse = |found: std::fmt::Arguments<'_>| {
            Err(Fault { key: "name".into(), problem: value::refused(found, "a name that can be a folder's") })
        };
        if let Some(bad) = self.name.chars().find(|c| c.is_control() || ['/', '\\'].contains(c)) {
            return refuse(format_args!("{bad:?} in it"));
        }
        if ["", ".", ".."].contains(&self.name.trim()) {
            return refuse(format_args!("{:?}", self.name));
        }
        Ok(())
    }

    pub(crate) fn error(&self, key: &str, problem: String) -> Error {
        Error::Scene { place: self.file.display().to_string(), key: key.to_string(), problem }
    }

    /// The model it describes.
    ///
    /// # Errors
    /// [`Error::Read`] or [`Error::Scene`] for the table of a driven head or of a flow.
    pub fn model(&self) -> Result<Model> {
        let rod = self.rod_on(self.rod.nodes.get());
        let loads = self.loads.as_ref();
        let (fluid, flow) = self.fluid()?;
        let layers = self.medium.as_ref().and_then(MediumTable::stack);
        // In layers buoyancy is a force that depends on the place.
        let uniform = layers.is_none_or(|layers| layers.iter().len() == 0);
        Ok(Model {
            actuation: self.drive(&rod),
            start: self.start.build(),
            forces: self.forces(&rod).map_err(|Fault { key, problem }| self.error(&key, problem))?,
            fluid,
            flow,
            layers,
            load: loads.and_then(|loads| loads.build(&rod)),
            buoyancy: loads.filter(|_| uniform).and_then(|loads| loads.buoyancy(&rod)),
            head: self.head_motion()?,
            head_input: self.head.input.unwrap_or_default(),
            spin: self.start.spin_rad_s.map_or(0.0, Finite::get),
            rod,
        })
    }

    /// The file that says it, from the root where there is such a file.
    pub fn file(&self) -> PathBuf {
        self.file.canonicalize().unwrap_or_else(|_| self.file.clone())
    }

    /// Names what this scene says, the contents of its tables when it was read, and the version of the program; not where
    /// it stands, nor its name, which may be the file's.
    pub fn fingerprint(&self) -> u128 {
        let mut nowhere = self.clone();
        (nowhere.name, nowhere.folder, nowhere.file) = <_>::default();
        nowhere.read_from = Files::default();
        nowhere.taken = None; // follows from the rest
        // The text of what is left has every part of the scene, and every number to the bit.
        XxHash3_128::oneshot(format!("{} {nowhere:?}", env!("CARGO_PKG_VERSION")).as_bytes())
    }

    /// The [fingerprint](Self::fingerprint) as files have it.
    pub fn fingerprint_text(&self) -> String {
        format!("{:032x}", self.fingerprint())
    }
}
