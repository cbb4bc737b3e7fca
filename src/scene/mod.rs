//! Scenes: the TOML files that users write. Keys end in their units; unknown keys and values out of range are errors.

mod actuation;
mod csv_table;
mod document;
mod error_location;
pub mod files;
pub mod fluid;
mod head;
mod head_body;
mod key_error;
mod keys_by_choice;
pub mod layers;
mod loads;
mod material;
mod override_layers;
pub mod parameter;
mod placeholders;
mod record;
mod rod;
#[cfg(feature = "schema")]
pub(crate) mod schema;
mod solver;
mod start;
mod start_error;
mod tendons;
pub mod value;
mod variants;

use std::path::{Path, PathBuf};

use serde::{Deserialize, Deserializer};
use twox_hash::XxHash3_128;

pub use actuation::ActuationTable;
pub use document::Document;
#[cfg(feature = "report")]
pub(crate) use error_location::rephrase;
pub use files::Files;
pub use fluid::{DragTable, MediumTable, ReactiveTable};
pub use head::{HeadKind, HeadTable};
pub use head_body::HeadBodyTable;
pub use key_error::KeyError;
pub use layers::{LayerTable, ShearTable};
pub use loads::{LoadsTable, PointLoad};
pub use material::DampingTime;
#[cfg(feature = "report")]
pub(crate) use override_layers::exclusive_keys;
pub use record::{NodesTable, RecordTable};
pub use rod::RodTable;
pub(crate) use solver::whole_steps;
pub use solver::{FormKey, SolverTable};
pub use start::{StartKind, StartTable};
pub use tendons::TendonTable;
use value::Finite;

use crate::error::{Error, Result};
use crate::model::Model;
use crate::reduced::FluidChoice;

/// The smallest and the largest number of nodes of a scene.
pub const NODES: [u64; 2] = [3, 10_000_000];

/// A scene: the complete description of a run.
///
/// [`load`](Self::load) reads it from a file and [`Document`] from text. Deserialising it by serde applies the same checks.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(remote = "Self", deny_unknown_fields)]
pub struct Scene {
    /// Name of the scene. By default, the name of the file without its extension.
    #[serde(default)]
    pub name: String,
    /// Mesh, cross-section and material of the rod.
    pub rod: RodTable,
    /// The wave of natural curvature, or of active moment, that drives the rod. Without this table the rod is passive.
    pub actuation: Option<ActuationTable>,
    /// Tendons: cables along the rod, at a distance from its centreline, that bend it.
    #[serde(default)]
    pub tendons: Vec<TendonTable>,
    /// Shape and motion of the rod at the start.
    #[serde(default)]
    pub start: StartTable,
    /// The surrounding fluid. Without this table the rod moves in a vacuum.
    pub medium: Option<MediumTable>,
    /// Drag of the fluid on the rod. Without this table there is none.
    pub drag: Option<DragTable>,
    /// Added mass: the inertia of the fluid that the rod accelerates. Without this table there is none.
    pub reactive: Option<ReactiveTable>,
    /// A rigid spheroid at the head of the rod. Without this table there is none.
    pub head_body: Option<HeadBodyTable>,
    /// Gravity, buoyancy and point loads. Without this table there are none.
    pub loads: Option<LoadsTable>,
    /// Boundary condition at the head of the rod: free, clamped, driven or hinged.
    #[serde(default)]
    pub head: HeadTable,
    /// Model, integrator, step size and duration.
    pub solver: SolverTable,
    /// Output: the times and nodes that are recorded.
    #[serde(default)]
    pub record: RecordTable,
    /// Goal, variables and constraints of `caudal design`. A run ignores this table.
    #[cfg_attr(feature = "schema", schemars(with = "Option<serde_json::Map<String, serde_json::Value>>"))]
    pub design: Option<toml::Table>,
    /// Folder that relative paths of tables start from.
    #[serde(skip)]
    pub folder: PathBuf,
    /// Source of these tables: the disk or memory.
    #[serde(skip)]
    pub(crate) read_from: Files,
    /// The file of the scene, as shown in errors.
    #[serde(skip)]
    file: PathBuf,
    /// Hash of the contents of its tables at the time of reading.
    #[serde(skip)]
    contents: u128,
    /// The drag law chosen when it was read, if the scene leaves the choice to the program. Scenes derived from it keep the choice.
    #[serde(skip)]
    fluid_choice: Option<FluidChoice>,
}

/// The tables of a scene, with each key checked on its own only.
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

    /// Checks the keys against each other. Reading a scene calls this; Rust code that changes its fields must call it.
    ///
    /// # Errors
    /// [`KeyError`] for the first key that conflicts with others.
    pub fn check(&self) -> std::result::Result<(), KeyError> {
        self.check_name()?;
        self.rod.check()?;
        self.actuation.as_ref().map_or(Ok(()), ActuationTable::check)?;
        self.check_tendons()?;
        self.start.check(&self.head)?;
        self.check_body()?;
        self.check_fluid()?;
        let nodes = self.nodes();
        self.loads.as_ref().map_or(Ok(()), |loads| loads.check(nodes))?;
        self.record.check_nodes(nodes)?;
        self.head.check()?;
        self.check_loss_factor()?;
        self.check_damped_rate()?;
        self.check_radius()?;
        self.rod.check_sizes(self.head.kind != HeadKind::Free || self.head_body.is_some())?;
        let duration = self.solver.duration_s.get();
        self.solver.check_steps()?;
        self.record.check_rows(duration)?;
        self.check_model()?;
        self.check_method()
    }

    /// Checks the name, which is also used for a folder.
    fn check_name(&self) -> std::result::Result<(), KeyError> {
        let refuse = |found: std::fmt::Arguments<'_>| {
            Err(KeyError { key: "name".into(), problem: value::refused(found, "a valid folder name") })
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

    /// Builds the model that the scene describes.
    ///
    /// # Errors
    /// [`Error::Read`] or [`Error::Scene`] for the table of a driven head or of a flow.
    pub fn model(&self) -> Result<Model> {
        let rod = self.rod_on(self.rod.nodes.get());
        let loads = self.loads.as_ref();
        let (fluid, flow) = self.fluid()?;
        let layers = self.medium.as_ref().and_then(MediumTable::stack);
        // In layers, buoyancy is a force that depends on position.
        let uniform = layers.is_none_or(|layers| layers.iter().len() == 0);
        let mut forces = self.forces(&rod).map_err(|KeyError { key, problem }| self.error(&key, problem))?;
        let tendons = self.tendons_on(&rod)?;
        forces.0.extend(tendons::force(&tendons));
        Ok(Model {
            actuation: self.drive(&rod),
            active_moments: self.has_active_moments(),
            largest_drive: self.largest_drive(&rod),
            lag: self.actuation.as_ref().and_then(|actuation| actuation.lag_s).map(value::Positive::get),
            start: self.start.build(),
            forces,
            tendons,
            fluid,
            flow,
            layers,
            load: loads.and_then(|loads| loads.build(&rod)),
            buoyancy: loads.filter(|_| uniform).and_then(|loads| loads.buoyancy(&rod)),
            head: self.head_motion()?,
            hinge: self.hinge()?,
            head_input: self.head.input.unwrap_or_default(),
            spin: self.start.spin_rad_s.map_or(0.0, Finite::get),
            initial_curvature: self.start.initial_curvature(&rod),
            rod,
        })
    }

    /// The file of the scene, as an absolute path if it exists.
    pub fn file(&self) -> PathBuf {
        self.file.canonicalize().unwrap_or_else(|_| self.file.clone())
    }

    /// Hash of the content of the scene and its tables, and of the version of the program. It excludes the location of the file
    /// and the name.
    pub fn fingerprint(&self) -> u128 {
        let mut nowhere = self.clone();
        (nowhere.name, nowhere.folder, nowhere.file) = <_>::default();
        nowhere.read_from = Files::default();
        nowhere.fluid_choice = None; // determined by the rest
        // This text contains every part of the scene, and every number to the bit.
        XxHash3_128::oneshot(format!("{} {nowhere:?}", env!("CARGO_PKG_VERSION")).as_bytes())
    }

    /// The [fingerprint](Self::fingerprint) in hexadecimal digits, as output files contain it.
    pub fn fingerprint_text(&self) -> String {
        format!("{:032x}", self.fingerprint())
    }
}
