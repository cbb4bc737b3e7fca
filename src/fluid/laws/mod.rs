//! Drag laws, one per file: range and source as data, coefficients and exact derivatives.

pub mod auto;
pub mod coefficients;
pub mod cox;
pub mod cross_flow;
pub mod gray_hancock;
pub mod lighthill;
pub mod resistance;
pub mod spheroid;
pub mod stokes_like;
pub mod wall;
pub mod weak_inertia;

use super::force::{Force, Validity};
use super::local::HeadWeight;
use crate::rod::{Half, Profile, Rod};

/// All laws; adding one is its file and its line here.
pub static LAWS: &[&DragLaw] = &[
    &cox::LAW,
    &lighthill::LAW,
    &gray_hancock::LAW,
    &spheroid::LAW,
    &coefficients::LAW,
    &wall::LAW,
    &weak_inertia::LAW,
    &cross_flow::LAW,
    &stokes_like::LAW,
    &auto::LAW,
];

/// The law of a scene that names none.
pub static DEFAULT: &DragLaw = &cox::LAW;

/// Reynolds number of the depth from which a drag linear in velocity is out of its range.
pub const CREEPING: f64 = 1.0;

/// Least ln(ℒ/a) of a body that counts as slender.
pub const SLENDER: f64 = 1.3;

/// What is known of a law, and how to make it.
#[derive(Debug)]
pub struct DragLaw {
    /// Name in a scene.
    pub name: &'static str,
    /// What it says, in a line.
    pub meaning: &'static str,
    /// Where it holds, and its source.
    pub validity: Validity,
    /// Reynolds number of the depth up to which it holds.
    pub reynolds: f64,
    /// The keys of `[drag]` that it takes beside those of every law.
    pub keys: &'static [&'static str],
    /// Those of them that it cannot do without.
    pub needs: &'static [&'static str],
    /// Drag along and across the rod per length, speed and viscosity, of half an edge, where the law is of that form.
    pub resistance: Option<fn(&Recipe<'_>, &Half) -> [f64; 2]>,
    /// The length ℒ (m) in its logarithm, which must be at least e^[`SLENDER`] radii; none for a law without.
    pub slender: Option<fn(&Recipe<'_>) -> f64>,
    /// The force.
    pub build: fn(&Recipe<'_>) -> Box<dyn Force>,
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
}

/// What laws are made from. What a law needs is there, by its [`DragLaw::needs`].
#[derive(Debug, Clone)]
pub struct Recipe<'a> {
    /// The rod.
    pub rod: &'a Rod,
    /// The wavelength of the actuation along the rod, m.
    pub wavelength: Option<f64>,
    /// Frequency of what drives the rod, Hz.
    pub frequency: Option<f64>,
    /// Reynolds number of the depth in the motion that the scene prescribes, see [`Regime`](crate::regime::Regime).
    pub reynolds: f64,
    /// The drag on the head.
    pub head: HeadWeight,
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

impl<'a> Recipe<'a> {
    /// Nothing but the rod.
    pub fn plain(rod: &'a Rod) -> Self {
        Self {
            rod,
            wavelength: None,
            frequency: None,
            reynolds: 0.0,
            head: HeadWeight::NONE,
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

    /// The length ℒ of most laws: the one that the scene names, else the shorter of rod and wave, m.
    pub fn slender(&self) -> f64 {
        self.slender_length.unwrap_or_else(|| self.rod.length.min(self.wavelength.unwrap_or(f64::INFINITY)))
    }
}
