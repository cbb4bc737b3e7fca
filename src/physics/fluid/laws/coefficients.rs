//! Resistance measured in an experiment: ξ∥ and ξ⊥ along the rod, whatever the fluid.

use super::resistance::{ACROSS, ALONG, Resistance};
use super::{Dependence, DragLaw, SectionInput};
use crate::fluid::uncertainty::Published;
use crate::fluid::validity::Validity;

/// The entry of this law in the list of laws.
pub static LAW: DragLaw = DragLaw {
    name: "coefficients",
    meaning: "the drag that the scene gives, along and across",
    validity: Validity { range: "that of the measurement", bounds: &[], source: "the scene" },
    reynolds: f64::INFINITY,
    published: Published::NOTHING,
    reach: Dependence::Edge,
    takes: SectionInput::Nothing,
    keys: &["along_n_s_m2", "across_n_s_m2"],
    needs: &["along_n_s_m2", "across_n_s_m2"],
    resistance: None,
    slender: None,
    build: |inputs| Resistance::given(&LAW, inputs, &[ALONG, ACROSS]),
    parts: None,
};
