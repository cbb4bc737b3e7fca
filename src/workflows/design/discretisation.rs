//! The effect of mesh and step errors of the simulation on identified numbers, since the data are free of these errors.
//!
//! With half the spacing, and with half the step, the markers' nodes move by Δ. The changes of the unknowns that compensate the
//! whole error of either are δ = −J⁺cΔ, with the Jacobian J of the coordinates with respect to the unknowns and c = 2ᵖ/(2ᵖ − 1) for
//! an error of order p (Richardson). The standard deviation of each number and joint includes the moduli of its components of both
//! δ, because their signs are unknown if steps are not yet small. A number that is dominated by mesh and steps is not called
//! identified.

use nalgebra::DVector;

use super::designed_scene::{scene_with, simulations};
use super::identify::{Identifiability, MAX_RELATIVE_DEVIATION};
use super::markers::Markers;
use super::search::SearchResult;
use super::table::{DesignTable, DesignVariable};
use super::unknowns::RANK_TOLERANCE;
use crate::rod::MassLumping;
use crate::scene::{Document, Scene};
use crate::sensitivity::Problem;

impl SearchResult {
    /// Adds the effect of mesh and steps to the deviations of numbers and joints, as identified from `markers` in the `scene` of
    /// `document`. The deviations are unchanged if a simulation fails.
    pub(super) fn count_discretisation(
        &mut self,
        document: &Document,
        scene: &Scene,
        table: &DesignTable,
        markers: &Markers,
    ) {
        let Some(moved) = self.moved_by_discretisation(document, scene, table, markers) else { return };
        let of = |variable: &DesignVariable| {
            let [step, mesh] = moved.each_ref().map(|by| self.at.0.changes(variable, &self.at.1, by));
            step.into_iter().zip(mesh).collect::<Vec<(f64, f64)>>()
        };
        let of_joints = of(&DesignVariable::Stiffness);
        let variables = table.variables.iter().filter(|variable| matches!(variable, DesignVariable::Number(_)));
        let of_numbers: Vec<(f64, f64)> = variables.flat_map(of).collect();
        for (deviation, (step, mesh)) in self.deviations.iter_mut().zip(of_joints) {
            *deviation = deviation.hypot(step.abs() + mesh.abs());
        }
        for (number, (step, mesh)) in self.numbers.iter_mut().zip(of_numbers) {
            let size = number.value.abs();
            let moved = Some((step + mesh) * size).filter(|moved| moved.is_finite());
            number.discretisation = number.deviation.and(moved);
            number.deviation = number.deviation.map(|deviation| deviation.hypot((step.abs() + mesh.abs()) * size));
            let known = number.deviation.is_some_and(|all| all <= MAX_RELATIVE_DEVIATION * size);
            if number.verdict == Some(Identifiability::Identified) && !known {
                number.verdict = Some(Identifiability::TooCoarse);
            }
        }
    }

    /// δ of the steps and of the mesh; `None` if they are unknown.
    fn moved_by_discretisation(
        &self,
        document: &Document,
        scene: &Scene,
        table: &DesignTable,
        markers: &Markers,
    ) -> Option<[Vec<f64>; 2]> {
        let jacobian = self.jacobian.as_ref()?;
        let front = usize::from(scene.head_body.is_some());
        let places = |changes: &[String]| -> Option<DVector<f64>> {
            let variant = scene_with(document, &table.numbers, changes, &self.profile).ok()?;
            let finer = (variant.rod.nodes.get() - 1) / (scene.rod.nodes.get() - 1);
            let trajectory = Problem::of(&variant).ok()?.simulate().ok()?;
            let mut all = Vec::with_capacity(jacobian.nrows());
            for time in &markers.times {
                all.extend(markers.of_nodes(&trajectory.at(*time)?, (finer, front)));
            }
            Some(DVector::from_vec(all))
        };
        let own = places(&[])?;
        let svd = jacobian.as_ref().clone().svd(true, true);
        let least = RANK_TOLERANCE * svd.singular_values.max();
        let moved = |changes: &[String], order: u32| -> Option<Vec<f64>> {
            let factor = f64::from(2_u32.pow(order));
            let error = (places(changes)? - &own) * (factor / (factor - 1.0));
            Some(svd.solve(&error, least).ok()?.iter().map(|x| -x).collect())
        };
        let [_, (_, step), _, (_, mesh)] = simulations(scene).try_into().ok()?;
        let mesh_order = if scene.rod.mass_lumping == MassLumping::Uniform { 1 } else { 2 };
        Some([moved(&step, scene.integrator().ok()?.order())?, moved(&mesh, mesh_order)?])
    }
}
