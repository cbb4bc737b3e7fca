//! Lumping of the rod's mass to its nodes.

use serde::Deserialize;

/// How an edge's mass is given to nodes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MassLumping {
    /// ρAΔL at every node: the source study's; total mass ρAL·N/(N−1), mesh error of first order.
    Uniform,
    /// Half of that at the two ends: total mass ρAL, mesh error of second order.
    #[default]
    Tributary,
}

impl MassLumping {
    /// The masses (kg) of `nodes` nodes whose edges weigh `edge` (kg) each.
    pub fn masses(self, nodes: usize, edge: f64) -> Vec<f64> {
        let mut masses = vec![edge; nodes];
        if self == Self::Tributary {
            masses[0] = 0.5 * edge;
            masses[nodes - 1] = 0.5 * edge;
        }
        masses
    }
}
