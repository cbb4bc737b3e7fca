//! Drag laws, one per file: range and source as data, coefficients and exact derivatives.

pub mod auto;
pub mod coefficients;
pub mod cox;
pub mod cross_flow;
pub mod gray_hancock;
pub mod lighthill;
#[cfg(feature = "faer")]
pub mod nonlocal;
pub mod resistance;
pub mod spheroid;
pub mod stokes_like;
pub mod wall;
pub mod weak_inertia;

use super::force::Force;
use super::local::HeadWeight;
use super::reactive::OMITTED;
use super::uncertainty::{Published, Uncertainty};
use crate::fluid::validity::Validity;
use crate::rod::{HalfEdge, Profile, Rod};

/// All drag laws. To add one, write its file and list it here.
pub static LAWS: &[&DragLaw] = &[
    &cox::LAW,
    &lighthill::LAW,
    &gray_hancock::LAW,
    &spheroid::LAW,
    &coefficients::LAW,
    &wall::LAW,
    &weak_inertia::LAW,
    &cross_flow::LAW,
    #[cfg(feature = "faer")]
    &nonlocal::LAW,
    &stokes_like::LAW,
    &auto::LAW,
];

/// The law for scenes that name none.
pub static DEFAULT: &DragLaw = &cox::LAW;

/// Reynolds number of the depth above which a drag linear in velocity is out of its range.
pub const CREEPING: f64 = 1.0;

/// Minimum ratio of length to radius for laws of slender bodies.
pub const LEAST_SLENDERNESS: f64 = 10.0;

/// Minimum ln(ℒ/a) of a body that counts as slender.
pub const MIN_LOG_SLENDERNESS: f64 = 1.3;

/// What determines the force of a law at a node.
#[derive(Debug, Clone, Copy)]
pub enum Dependence {
    /// The edge there and its motion: matrices are banded, and derivatives exact.
    Edge,
    /// The motion of the whole rod: Newton's matrix is dense, and a step on N nodes costs N³. The fluid must be uniform,
    /// and there is neither a chain form nor sensitivities, see [`Force::global`].
    Rod {
        /// The minimum node spacing, m.
        least_spacing: fn(&LawInputs<'_>) -> f64,
        /// Number of nodes up to which a step takes at most tenths of a second.
        most_nodes: usize,
    },
}

impl Dependence {
    /// True if the law can be computed on the mesh of the rod in `inputs`.
    pub fn allows(&self, inputs: &LawInputs<'_>) -> bool {
        match self {
            Self::Edge => true,
            Self::Rod { least_spacing, most_nodes } => {
                inputs.rod.spacing >= least_spacing(inputs) && inputs.rod.nodes <= *most_nodes
            }
        }
    }
}

/// The properties of a cross-section that a law uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SectionInput {
    /// Depth, perimeter and form drag; the viscous part uses the properties of its own law.
    Outline,
    /// [`Section::slender_radius`](crate::rod::Section::slender_radius), which represents a section in slender-body
    /// theory, and [`Section::slender_across`](crate::rod::Section::slender_across).
    SlenderRadius,
    /// The same, in a theory of round rods: an ellipse is treated as a round rod, a rectangle is refused.
    Round,
    /// The area of the material.
    Area,
    /// None: its coefficients are given, or are those of another law.
    Nothing,
}

impl SectionInput {
    /// A description.
    pub fn in_words(self) -> &'static str {
        match self {
            Self::Outline => "depth, perimeter and form drag of the section",
            Self::SlenderRadius => {
                "an equivalent round rod, because slow flow hardly depends on the shape of the section"
            }
            Self::Round => "round rods; an ellipse is treated as a round rod of its radius, a rectangle is rejected",
            Self::Area => "a disc of the area of the material",
            Self::Nothing => "no property of the section",
        }
    }
}

/// An entry in the list of drag laws: its name, range and sources, and its constructor.
pub struct DragLaw {
    /// Name in a scene.
    pub name: &'static str,
    /// A one-line description.
    pub meaning: &'static str,
    /// Its range of validity, and the source.
    pub validity: Validity,
    /// Reynolds number of the depth up to which it holds.
    pub reynolds: f64,
    /// Its published uncertainty.
    pub published: Published,
    /// What determines the force at a node.
    pub reach: Dependence,
    /// The properties of a cross-section that it uses.
    pub takes: SectionInput,
    /// The keys of `[drag]` that it accepts in addition to those of every law.
    pub keys: &'static [&'static str],
    /// Those of them that are required.
    pub needs: &'static [&'static str],
    /// Drag along and across the rod per length, speed and viscosity on half an edge, if the law has that form.
    pub resistance: Option<fn(&LawInputs<'_>, &HalfEdge) -> [f64; 2]>,
    /// The length ℒ (m) in its logarithm, which must be at least e^[`MIN_LOG_SLENDERNESS`] radii; `None` for a law
    /// without a logarithm.
    pub slender: Option<fn(&LawInputs<'_>) -> f64>,
    /// The constructor of the force.
    pub build: fn(&LawInputs<'_>) -> Box<dyn Force>,
    /// The constructor of the forces by cause whose sum it is; `None` if viscosity is the only cause.
    pub parts: Option<SplitByCause>,
}

/// Forces, each with its cause.
pub type ForcesByCause = Vec<(&'static str, Box<dyn Force>)>;

/// A constructor of forces by cause whose sum is the force of a law.
pub type SplitByCause = fn(&LawInputs<'_>) -> ForcesByCause;

impl std::fmt::Debug for DragLaw {
    /// The name only, which is the same in every run of the program.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name)
    }
}

impl PartialEq for DragLaw {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

impl DragLaw {
    /// The law of this name.
    pub fn named(name: &str) -> Option<&'static Self> {
        LAWS.iter().copied().find(|law| law.name == name)
    }

    /// Its name, with that of the reactive force if that is included.
    pub fn with_reactive(&self, reactive: bool) -> String {
        format!("{}{}", self.name, if reactive { " + reactive" } else { "" })
    }

    /// The published uncertainty of results at a Reynolds number, with or without the reactive force; `None` if it is
    /// unknown, for example outside the range of the law.
    pub fn uncertainty(&self, reynolds: f64, reactive: bool) -> Option<Uncertainty> {
        let drag = self.published.at(reynolds).filter(|_| reynolds <= self.reynolds)?;
        let omitted = if reactive { None } else { OMITTED.at(reynolds) };
        Some(omitted.map_or(drag, |omitted| drag.with(omitted)))
    }

    /// The forces by cause whose sum it is.
    pub fn parts(&self, inputs: &LawInputs<'_>) -> ForcesByCause {
        match self.parts {
            Some(parts) => parts(inputs),
            None => vec![("viscous", (self.build)(inputs))],
        }
    }

    /// True for a law that has published results and needs no key of its own, in a scene with or without the height
    /// above a wall.
    pub fn is_offered(&self, beside_wall: bool) -> bool {
        let given = |key: &str| beside_wall && key == "height_m";
        let knows_wall = !beside_wall || self.keys.contains(&"height_m");
        !self.published.table.is_empty() && knows_wall && self.needs.iter().all(|key| given(key))
    }

    /// True if the force at a node depends on the motion of the whole rod.
    pub fn is_nonlocal(&self) -> bool {
        matches!(self.reach, Dependence::Rod { .. })
    }
}

/// The inputs from which laws are built. Those that a law lists in [`DragLaw::needs`] are present.
#[derive(Debug, Clone)]
pub struct LawInputs<'a> {
    /// The rod.
    pub rod: &'a Rod,
    /// The wavelength of the actuation along the rod, m.
    pub wavelength: Option<f64>,
    /// Frequency of the drive, Hz.
    pub frequency: Option<f64>,
    /// The factor on the drag of the head.
    pub head: HeadWeight,
    /// The law chosen by `auto`.
    pub taken: Option<&'static DragLaw>,
    /// The law of the viscous part.
    pub viscous: &'static DragLaw,
    /// `slender_length_m`.
    pub slender_length: Option<f64>,
    /// `ratio`.
    pub ratio: f64,
    /// `along_n_s_m2`.
    pub along: Profile,
    /// `across_n_s_m2`.
    pub across: Profile,
    /// `height_m`.
    pub height: f64,
    /// `form_drag`.
    pub form_drag: Option<f64>,
    /// `thinning`.
    pub thinning: Option<f64>,
    /// `skin_friction`.
    pub skin_friction: Option<f64>,
    /// `turbulent_friction`.
    pub turbulent_friction: Option<f64>,
}

impl<'a> LawInputs<'a> {
    /// Defaults for everything but the rod.
    pub fn plain(rod: &'a Rod) -> Self {
        Self {
            rod,
            wavelength: None,
            frequency: None,
            head: HeadWeight::NONE,
            taken: None,
            viscous: DEFAULT,
            slender_length: None,
            ratio: 1.0,
            along: 0.0.into(),
            across: 0.0.into(),
            height: f64::INFINITY,
            form_drag: None,
            thinning: None,
            skin_friction: None,
            turbulent_friction: None,
        }
    }

    /// The length ℒ of most laws, m: the scene's `slender_length_m`, else the shorter of rod and wavelength.
    pub fn slender(&self) -> f64 {
        self.slender_length.unwrap_or_else(|| self.rod.length.min(self.wavelength.unwrap_or(f64::INFINITY)))
    }
}
