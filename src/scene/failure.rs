//! Runs that cannot begin: which key is to blame.

use super::Scene;
use super::value::Positive;
use crate::error::Error;

impl Scene {
    /// Why a run of it cannot begin, as `error` says, with the key that is most likely to blame.
    pub(crate) fn cannot_start(&self, error: &Error) -> Error {
        let bent = |what: String| format!("{what} in the first shape; allowed: a weaker one, or more nodes");
        let (key, problem) = match error {
            Error::FoldOver { node, .. } => {
                let turned = *node == 0 && self.head.angle_rad.is_some() || self.actuation.is_none();
                let key = if turned { "head.angle_rad" } else { self.bends() };
                (key, bent(format!("the rod folds over at node {node}")))
            }
            Error::EdgeCollapse { node, .. } => (self.bends(), bent(format!("the edge after node {node} collapses"))),
            Error::NotFinite { node, what, .. } => {
                let problem = format!("{what} is not finite at node {node} at the start; try a less extreme number");
                (self.extreme(), problem)
            }
            Error::NotConverged { residual_n, node, .. } => {
                let problem = format!(
                    "no accelerations at the start balance the forces: {residual_n:e} N are left at node {node}; try a less extreme number"
                );
                (self.extreme(), problem)
            }
            other => return other.clone(),
        };
        self.error(key, problem)
    }

    /// The key that says how much the rod bends.
    fn bends(&self) -> &'static str {
        let slope = self.actuation.as_ref().is_some_and(|table| table.slope.is_some());
        if slope { "actuation.slope" } else { "actuation.kappa_amp" }
    }

    /// The key of the number that is the furthest from 1 of those that make forces.
    fn extreme(&self) -> &'static str {
        let rod = &self.rod;
        let (actuation, medium) = (self.actuation.as_ref(), self.medium.as_ref());
        let numbers = [
            ("rod.youngs_modulus_pa", Some(rod.youngs_modulus_pa.get())),
            ("rod.density_kg_m3", Some(rod.density_kg_m3.profile().largest())),
            ("rod.length_m", Some(rod.length_m.get())),
            ("rod.outer_radius_m", Some(rod.outer_radius_m.profile().largest())),
            (self.bends(), actuation.map(|table| table.slope.map_or(table.amplitude().abs(), Positive::get))),
            ("actuation.frequency_hz", actuation.map(|table| table.frequency_hz.get())),
            ("medium.viscosity_pa_s", medium.map(|table| table.viscosity_pa_s.get())),
        ];
        let far = numbers.into_iter().filter_map(|(key, number)| Some((key, number.filter(|x| *x > 0.0)?.ln().abs())));
        far.max_by(|a, b| a.1.total_cmp(&b.1)).map_or("rod.youngs_modulus_pa", |(key, _)| key)
    }
}
