//! Basis functions of a profile along the rod: the values at the joints as a linear function of the unknowns, which are values at the
//! joints themselves or at knots, with linear interpolation between them.

use super::table::DesignTable;
use crate::rod::Rod;

/// The joint values as a linear function of the unknowns.
#[derive(Debug, Clone)]
pub struct Basis {
    /// Number of unknowns.
    pub unknowns: usize,
    /// Weights of the unknowns, one row per joint.
    pub rows: Vec<Vec<(usize, f64)>>,
}

impl Basis {
    /// The basis functions of `table` for the joints of `rod`.
    pub fn of(table: &DesignTable, rod: &Rod) -> Self {
        let joints = rod.joints();
        let Some(knots) = &table.knots else {
            return Self { unknowns: joints.len(), rows: (0..joints.len()).map(|i| vec![(i, 1.0)]).collect() };
        };
        let row = |k: usize| {
            let xi = rod.xi(k);
            let after = knots.partition_point(|knot| *knot <= xi);
            match (after.checked_sub(1), after < knots.len()) {
                (Some(i), true) => {
                    let part = (xi - knots[i]) / (knots[after] - knots[i]);
                    vec![(i, 1.0 - part), (after, part)]
                }
                (Some(i), false) => vec![(i, 1.0)],
                (None, _) => vec![(0, 1.0)],
            }
        };
        Self { unknowns: knots.len(), rows: joints.map(row).collect() }
    }

    /// The values at the joints.
    pub fn joints(&self, unknowns: &[f64]) -> Vec<f64> {
        self.rows.iter().map(|row| row.iter().map(|(i, w)| w * unknowns[*i]).sum()).collect()
    }
}

/// Second differences D₂ of the joint values, as rows of the unknowns.
pub fn second_differences(basis: &Basis) -> impl Iterator<Item = Vec<(usize, f64)>> {
    basis.rows.windows(3).map(|rows| {
        let parts = rows.iter().zip([1.0, -2.0, 1.0]);
        parts.flat_map(|(part, factor)| part.iter().map(move |(i, w)| (*i, factor * w))).collect()
    })
}
