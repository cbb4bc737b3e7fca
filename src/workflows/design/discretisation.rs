//! What mesh and steps of the simulation do to what is identified with them: data know no mesh.
//!
//! With half the spacing, and with half the step, the markers' nodes move by Δ. The unknowns that make up for the whole error move by
//! δ = −J⁺ΣcΔ, with the Jacobian J of the coordinates by the unknowns and c = 2ᵖ/(2ᵖ − 1) for an error of order p (Richardson). The
//! standard deviation of each number contains its part of δ, and a number that mesh and steps decide is not called identified.

use nalgebra::DVector;

use super::designed_scene::{scene_with, simulations};
use super::identify::{Identifiability, MAX_RELATIVE_DEVIATION};
use super::markers::Markers;
use super::search::SearchResult;
use super::table::{DesignTable, DesignVariable};
use super::unknowns::RANK_TOLERANCE;
use crate::scene::{Document, Scene};
use crate::sensitivity::Problem;

/// Order of the error of the mesh.
const MESH_ORDER: u32 = 2;

impl SearchResult {
    /// Adds to the deviations of the numbers how far mesh and steps move them, as identified from `markers` in the `scene` of `document`.
    /// They stay as they are where a simulation fails.
    pub(super) fn count_discretisation(
        &mut self,
        document: &Document,
        scene: &Scene,
        table: &DesignTable,
        markers: &Markers,
    ) {
        let Some(moved) = self.moved_by_discretisation(document, scene, table, markers) else { return };
        let variables = table.variables.iter().filter(|variable| matches!(variable, DesignVariable::Number(_)));
        let parts = variables.flat_map(|variable| self.at.0.changes(variable, &self.at.1, &moved));
        let parts: Vec<f64> = parts.collect();
        for (number, part) in self.numbers.iter_mut().zip(parts) {
            let part = part * number.value.abs();
            number.discretisation = Some(part).filter(|part| part.is_finite());
            number.deviation = number.deviation.map(|deviation| deviation.hypot(part));
            let known = number.deviation.is_some_and(|all| all <= MAX_RELATIVE_DEVIATION * number.value.abs());
            if number.verdict == Some(Identifiability::Identified) && !known {
                number.verdict = Some(Identifiability::TooCoarse);
            }
        }
    }

    /// δ, or `None` if it is not known.
    fn moved_by_discretisation(
        &self,
        document: &Document,
        scene: &Scene,
        table: &DesignTable,
        markers: &Markers,
    ) -> Option<Vec<f64>> {
        let jacobian = self.jacobian.as_ref()?;
        let places = |changes: &[String]| -> Option<DVector<f64>> {
            let variant = scene_with(document, &table.numbers, changes, &self.profile).ok()?;
            let finer = (variant.rod.nodes.get() - 1) / (scene.rod.nodes.get() - 1);
            let trajectory = Problem::of(&variant).ok()?.simulate().ok()?;
            let mut all = Vec::with_capacity(jacobian.nrows());
            for time in &markers.times {
                all.extend(markers.of_nodes(&trajectory.at(*time)?, finer));
            }
            Some(DVector::from_vec(all))
        };
        // A body's neck is half a cell, which a finer mesh moves.
        if scene.model().ok()?.rod.front > 0 {
            return None;
        }
        let own = places(&[])?;
        let whole = |changes: &[String], order: u32| -> Option<DVector<f64>> {
            let factor = f64::from(2_u32.pow(order));
            Some((places(changes)? - &own) * (factor / (factor - 1.0)))
        };
        let [_, (_, step), _, (_, mesh)] = simulations(scene).try_into().ok()?;
        let error = whole(&step, scene.integrator().ok()?.order())? + whole(&mesh, MESH_ORDER)?;
        let svd = jacobian.as_ref().clone().svd(true, true);
        let least = RANK_TOLERANCE * svd.singular_values.max();
        let moved = svd.solve(&error, least).ok()?;
        Some(moved.iter().map(|x| -x).collect())
    }
}
