//! Nonlocal drag: regularised Stokeslets along the rod, see [`nonlocal`](crate::fluid::nonlocal).

use super::{Dependence, DragLaw, LEAST_SLENDERNESS, LawInputs, SectionInput};
use crate::fluid::nonlocal::{Nonlocal, least_spacing};
use crate::fluid::uncertainty::{Published, Uncertainty};
use crate::fluid::validity::{Bound, DimensionlessNumber, STEADY, Validity};

/// Minimum height over radius near a wall. Compared with a long cylinder near a plane, 2πμ/acosh(h/a) along and twice
/// that across, drag is 1.2 and 3.2 % low there, 5 and 9 % at 2, 31 and 36 % at 1.2.
const MIN_HEIGHT_RATIO: f64 = 3.0;

/// The entry of this law in the list of laws.
pub static LAW: DragLaw = DragLaw {
    name: "nonlocal",
    meaning: "drag with hydrodynamic interaction of all parts of the rod, near a plane wall if height_m is given",
    validity: Validity {
        range: "steady creeping flow over the whole length, nodes at least half a blob of 1.65 radii apart; drag of a straight \
            cylinder within 2 % for length over radius of at least 100, and within 4 % of that near a wall",
        bounds: &[
            Bound::at_most(DimensionlessNumber::LengthReynolds, 1.0),
            Bound::at_least(DimensionlessNumber::Slenderness, LEAST_SLENDERNESS),
            Bound::at_least(DimensionlessNumber::Height, MIN_HEIGHT_RATIO),
            STEADY,
        ],
        source: "R. Cortez, J. Comput. Phys. 375 (2018); J. R. Blake, Proc. Camb. Phil. Soc. 70 (1971)",
    },
    reynolds: 0.5,
    published: Published {
        table: &[
            Uncertainty::at(5e-4, [0.03, 0.05, 0.05]),
            Uncertainty::at(0.016, [0.10, 0.10, 0.05]),
            Uncertainty::at(0.26, [0.10, 0.10, 0.24]),
        ],
        source: "compared here, in drag and rotation of straight cylinders, with M. M. Tirado, C. López Martínez & J. García de la Torre (1984); growth with inertia: as of cox",
    },
    reach: Dependence::Rod { least_spacing, most_nodes: 257 },
    takes: SectionInput::Round,
    keys: &["height_m"],
    needs: &[],
    resistance: None,
    slender: Some(|inputs: &LawInputs<'_>| inputs.rod.length),
    build: |inputs| Box::new(Nonlocal::new(&LAW, inputs)),
    parts: None,
};
