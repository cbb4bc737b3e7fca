//! An FMU before it is written: a scene with its catalogue of variables, and which of them it exposes.

use super::catalogue::{Catalogue, Standard, token};
use crate::error::{Error, Result};
use crate::scene::parameter::ScalarParameter;
use crate::scene::{Document, Scene};
use crate::stepper::Stepper;
use crate::variable;

/// Selects the variables, parameters and nodes of a scene that its FMU exposes, and their form.
#[derive(Debug, Clone, Default)]
pub struct FmuOptions {
    /// Names of the exposed variables and parameters; `None` for all.
    pub variables: Option<Vec<String>>,
    /// Nodes whose array entries are exposed if each entry is a scalar variable; `None` for all.
    pub nodes: Option<Vec<usize>>,
    /// FMI 3.0 for hosts without support for arrays and structural parameters: each entry is a scalar variable.
    pub plain: bool,
}

/// A scene ready to be written as an FMU.
#[derive(Debug)]
pub struct Fmu<'a> {
    pub(super) document: &'a Document,
    pub(super) scene: Scene,
    pub(super) stepper: Stepper,
    pub(super) catalogue: Catalogue,
    pub(super) options: FmuOptions,
}

impl<'a> Fmu<'a> {
    /// Prepares the FMU of a scene.
    ///
    /// # Errors
    /// Errors of the scene and of its initial state.
    pub fn of(document: &'a Document) -> Result<Self> {
        let scene = document.scene()?;
        let stepper = document.stepper(&scene)?;
        let catalogue = Catalogue::of(&scene, &stepper);
        Ok(Self { document, scene, stepper, catalogue, options: FmuOptions::default() })
    }

    /// The same FMU with these options.
    ///
    /// # Errors
    /// [`Error::UnknownVariable`], and [`Error::Fmu`] for a node that the rod does not have.
    pub fn showing(self, options: FmuOptions) -> Result<Self> {
        let parameters = self.catalogue.parameters.iter().map(ScalarParameter::name);
        let names: Vec<String> =
            self.catalogue.variables().map(|(_, variable)| variable.name.to_string()).chain(parameters).collect();
        for name in options.variables.iter().flatten() {
            if !names.contains(name) {
                return Err(variable::unknown(name, self.catalogue.variables().map(|(_, variable)| variable.name)));
            }
        }
        let nodes = self.stepper.model().rod.nodes;
        match options.nodes.iter().flatten().find(|node| **node >= nodes) {
            Some(node) => Err(Error::Fmu(format!("node {node}: the rod has the nodes 0 to {}", nodes - 1))),
            None => Ok(Self { options, ..self }),
        }
    }

    /// True if the FMU of this standard has arrays, sized by the number of nodes.
    pub(super) fn has_arrays(&self, standard: Standard) -> bool {
        standard == Standard::Fmi3 && !self.options.plain
    }

    /// True if the variable or parameter with this name is exposed.
    pub(super) fn shows(&self, name: &str) -> bool {
        self.options.variables.as_ref().is_none_or(|names| names.iter().any(|shown| shown == name))
    }

    /// True if entries at this node are exposed.
    pub(super) fn shows_node(&self, node: usize) -> bool {
        self.options.nodes.as_ref().is_none_or(|nodes| nodes.contains(&node))
    }

    /// The C identifier that names the library: the scene's name with `_` for characters that C does not allow.
    pub fn identifier(&self) -> String {
        let mut identifier: String =
            self.scene.name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
        if !identifier.starts_with(|c: char| c.is_ascii_alphabetic()) {
            identifier.insert_str(0, "caudal_");
        }
        identifier
    }

    /// The instantiation token, see [`token`].
    pub fn token(&self) -> String {
        token(&self.scene)
    }
}
