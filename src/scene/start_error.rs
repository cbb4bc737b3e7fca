//! Errors at the start of a run, such as a rod that folds over, with the key of the scene that most likely causes them.

use super::Scene;
use super::actuation::ActuationTable;
use super::start::StartKind;
use super::value::{NumberOrProfile, Positive};
use crate::error::Error;

impl Scene {
    /// Returns `error` of a run that fails at the start, with the key that most likely causes it.
    pub(crate) fn start_error(&self, error: &Error) -> Error {
        let bent = |what: String| format!("{what} in the initial shape; allowed: a weaker one, or more nodes");
        let (key, problem) = match error {
            Error::FoldOver { node, .. } => {
                let turned = *node == 0 && self.actuation.is_some() && self.head.angle_rad.is_some();
                let key = if turned { "head.angle_rad".to_string() } else { self.bending_key() };
                (key, bent(format!("the rod folds over at node {node}")))
            }
            Error::EdgeCollapse { node, .. } => {
                (self.bending_key(), bent(format!("the edge after node {node} collapses")))
            }
            Error::NotFinite { node, what, .. } => {
                let problem = format!("{what} is not finite at node {node} at the start; try a less extreme number");
                (self.most_extreme_key().to_string(), problem)
            }
            Error::NotConverged { residual_n, node, .. } => {
                let problem = format!(
                    "the accelerations at the start do not balance the forces: a residual of {residual_n:e} N remains at node {node}; try a less extreme number"
                );
                (self.most_extreme_key().to_string(), problem)
            }
            other => return other.clone(),
        };
        self.error(&key, problem)
    }

    /// The key that bends the rod at the start: the wave, the tendon with the largest moment, or the curvature of the start;
    /// without these, the angle of the head.
    fn bending_key(&self) -> String {
        let drives = self.drives();
        // Tensions bend the rod only in a shaped start.
        let pulled = drives.tendons && self.start.kind == StartKind::Shaped;
        match &self.start.curvature_1_m {
            _ if drives.actuation => self.amplitude_key().to_string(),
            Some(_) => "start.curvature_1_m".to_string(),
            _ if pulled => self.strongest_tendon_key(),
            None => "head.angle_rad".to_string(),
        }
    }

    /// The key of the amplitude of the actuation.
    fn amplitude_key(&self) -> &'static str {
        self.actuation.as_ref().map_or("actuation.kappa_amp", ActuationTable::amplitude_key)
    }

    /// The key of the most extreme number, the one furthest from 1, among those that determine forces.
    fn most_extreme_key(&self) -> &'static str {
        let rod = &self.rod;
        let (actuation, medium) = (self.actuation.as_ref(), self.medium.as_ref());
        let largest = |value: &Option<NumberOrProfile<Positive>>| Some(value.as_ref()?.profile().largest());
        let numbers = [
            ("rod.axial_stiffness_n", largest(&rod.axial_stiffness_n)),
            ("rod.bending_stiffness_n_m2", largest(&rod.bending_stiffness_n_m2)),
            ("rod.mass_per_length_kg_m", largest(&rod.mass_per_length_kg_m)),
            ("rod.youngs_modulus_pa", rod.youngs_modulus_pa.map(Positive::get)),
            ("rod.density_kg_m3", largest(&rod.density_kg_m3)),
            ("rod.length_m", Some(rod.length_m.get())),
            ("rod.outer_radius_m", largest(&rod.outer_radius_m)),
            (self.amplitude_key(), actuation.map(|table| table.slope.map_or(table.amplitude().abs(), Positive::get))),
            ("actuation.frequency_hz", actuation.map(|table| table.frequency_hz.get())),
            ("medium.viscosity_pa_s", medium.map(|table| table.viscosity_pa_s.get())),
        ];
        let far = numbers.into_iter().filter_map(|(key, number)| Some((key, number.filter(|x| *x > 0.0)?.ln().abs())));
        far.max_by(|a, b| a.1.total_cmp(&b.1)).map_or("rod.youngs_modulus_pa", |(key, _)| key)
    }
}
