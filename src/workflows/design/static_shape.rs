//! Static target shape: the stiffness with which the rod is in equilibrium in it, EI_k c_k = m_k without motion.

use serde::Serialize;

use super::basis::Basis;
use super::identify::{constraints, series, smooth};
use super::markers::{Markers, SmoothedMotion, SmoothedSample};
use super::qp::QuadraticProgram;
use super::table::DesignTable;
use crate::error::{Error, Result};
use crate::model::Dynamics;

/// Curvatures and moments below this fraction of the largest count as zero.
const NEGLIGIBLE: f64 = 1e-6;

/// Residual moments above this fraction of the joint's own are reported.
const MAX_RESIDUAL: f64 = 1e-6;

/// The equilibrium of the designed rod.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Equilibrium {
    /// In the shape, and stable.
    #[default]
    Stable,
    /// In the shape, but a small motion about it grows.
    Unstable,
    /// Not in the shape, which the constraints exclude.
    Missed,
    /// No equilibrium was found near the shape, or its stability is unknown.
    Unknown,
}

impl Equilibrium {
    /// The status of the design.
    pub fn name(self) -> &'static str {
        match self {
            Self::Stable => "solved",
            Self::Unstable => "unstable",
            Self::Missed => "missed",
            Self::Unknown => "not verified",
        }
    }

    /// A sentence about it, if needed.
    pub fn words(self) -> Option<String> {
        let text = match self {
            Self::Stable => return None,
            Self::Unstable => "the rod is in equilibrium in this shape, but the equilibrium is unstable",
            Self::Missed => "the rod comes to rest in another shape: bounds or other constraints exclude this one",
            Self::Unknown => "no equilibrium was found near this shape, or its stability is unknown",
        };
        Some(text.to_string())
    }
}

/// The stiffness with which a shape is an equilibrium.
#[derive(Debug, Clone, Serialize)]
pub struct StaticShape {
    /// Its equilibrium.
    pub state: Equilibrium,
    /// EI of the joints, N m².
    pub stiffness_n_m2: Vec<f64>,
    /// Joints whose stiffness is arbitrary: neither curvature nor moment.
    pub undecided: Vec<usize>,
    /// Joints that cannot have the shape because of constraints: node, and the required EI (N m²).
    pub missed: Vec<(usize, f64)>,
    /// Active constraints, with their duals.
    pub active: Vec<(String, f64)>,
}

/// Finds the stiffness with which the rod of `dynamics` is in equilibrium at `positions` (m, two entries per node) at time zero.
///
/// # Errors
/// [`Error::Design`] with all joints that would have to bend against their moment, and for contradictory constraints.
pub fn rest(dynamics: &mut Dynamics, positions: &[f64], table: &DesignTable) -> Result<StaticShape> {
    if dynamics.model.head.is_none() {
        let reason = "a shape at rest needs a held head: nothing balances the loads of a free rod".to_string();
        return Err(Error::Design { reason });
    }
    let markers = Markers { times: vec![0.0], positions: vec![positions.to_vec()], ..Markers::default() };
    let still = vec![0.0; positions.len()];
    let sample =
        SmoothedSample { index: 0, q: positions.to_vec(), v: still.clone(), a: still, weights: vec![[1.0, 0.0, 0.0]] };
    let motion = SmoothedMotion { samples: vec![sample], ..SmoothedMotion::default() };
    let (all, _) = series(dynamics, &markers, &motion)?;
    let rod = &dynamics.model.rod;
    let (reference, basis) = (rod.ei, Basis::of(table, rod));
    let pairs: Vec<[f64; 2]> = all.iter().map(|series| [series.curvature(1.0)[0], series.moment[0]]).collect();
    let largest = pairs.iter().fold([0.0_f64; 2], |max, pair| [0, 1].map(|i| max[i].max(pair[i].abs())));
    let is_none = |pair: &[f64; 2], i: usize| pair[i].abs() <= NEGLIGIBLE * largest[i];
    let against: Vec<String> = (rod.joints().zip(&pairs))
        .filter(|(_, pair)| {
            let both = pair[0] * pair[1] < 0.0 && !is_none(pair, 0) && !is_none(pair, 1);
            both || (is_none(pair, 0) && !is_none(pair, 1))
        })
        .map(|(k, [c, m])| format!("node {k} (curvature {:.3e} 1/m beyond the natural one, moment {m:.3e} N m)", c))
        .collect();
    if !against.is_empty() {
        let reason = format!("the shape bends against its loads, or not at all under them, at {}", against.join(", "));
        return Err(Error::Design { reason });
    }
    let mut programme = QuadraticProgram::new(basis.unknowns);
    for ([c, m], row) in pairs.iter().zip(&basis.rows) {
        if c.abs() > NEGLIGIBLE * largest[0] {
            // Relative errors of the moments, so that the tip has the same weight as the root.
            let size = m.abs().max(NEGLIGIBLE * largest[1]);
            let scaled: Vec<(usize, f64)> = row.iter().map(|(i, w)| (*i, w * c * reference / size)).collect();
            programme.add_square(&scaled, m / size, 1.0);
        }
    }
    smooth(&mut programme, &basis, table.smoothness);
    for i in 0..basis.unknowns {
        programme.add_square(&[(i, 1.0)], 1.0, 1e-12); // for joints that are undetermined
    }
    programme.constraints = constraints(table, &basis, true);
    let solution = programme.solve()?;
    let stiffness: Vec<f64> = basis.joints(&solution.x).iter().map(|x| x * reference).collect();
    let missed = (rod.joints().zip(&pairs).zip(&stiffness))
        .filter(|((_, pair), ei)| {
            !is_none(pair, 0)
                && (*ei * pair[0] - pair[1]).abs() > MAX_RESIDUAL * pair[1].abs().max(NEGLIGIBLE * largest[1])
        })
        .map(|((k, [c, m]), _)| (k, m / c))
        .collect();
    Ok(StaticShape {
        state: Equilibrium::Unknown,
        undecided: rod.joints().zip(&pairs).filter(|(_, pair)| is_none(pair, 0)).map(|(k, _)| k).collect(),
        missed,
        active: programme.active(&solution),
        stiffness_n_m2: stiffness,
    })
}
