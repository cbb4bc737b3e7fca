//! The numbers of a scene, identified by their keys, as parameters of a differentiable simulation.

use std::f64::consts::TAU;

use super::finite_difference::FiniteDifference;
use super::parameter::Parameter;
use crate::error::{Error, Result};
use crate::fluid::DENSITY;
use crate::model::Model;
use crate::scene::parameter::{ProfileParameter, ScalarParameter};
use crate::scene::{Document, Scene};

/// A signed number below this fraction of its typical value counts as zero, because rounding errors of forces are divided by its
/// change.
const NEGLIGIBLE_FRACTION: f64 = 1e-3;

/// The key of the flow, m/s.
const FLOW: &str = "medium.flow_m_s";

/// The key of its shear, 1/s.
const SHEAR: &str = "medium.shear.rate_per_s";

/// A direction with a smaller component along interfaces is normal to them.
const ALONG: f64 = 1e-12;

/// A number of a scene.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneParameter {
    /// Its key.
    pub key: String,
    /// Index within the value of the key: empty for a scalar, that of a component, or that of a point [ξ, value].
    pub place: Vec<usize>,
    /// ξ of a point.
    pub xi: Option<f64>,
    /// SI unit, or `1` if dimensionless.
    pub unit: &'static str,
    /// Description.
    pub description: String,
    /// Its value in the scene.
    pub own: f64,
    /// The complete value of the key in the scene.
    whole: toml::Value,
    /// The parameter of the simulation; see [`assign_indices`] for [`Parameter::OfScene`].
    pub by: Parameter,
    /// A typical value.
    typical: f64,
    /// True if it may have both signs.
    is_signed: bool,
}

impl SceneParameter {
    /// The scale of the finite difference at this value: the value itself, unless it is small and may be zero.
    fn scale(&self, value: f64) -> f64 {
        let least = if self.is_signed { NEGLIGIBLE_FRACTION * self.typical } else { 0.0 };
        if value.abs() > least { value.abs() } else { self.typical }
    }

    /// The key, with the index within its value.
    pub fn label(&self) -> String {
        match (self.xi, self.place.first()) {
            (Some(xi), _) => format!("{} at xi = {xi}", self.key),
            (None, Some(i)) => format!("{}[{i}]", self.key),
            (None, None) => self.key.clone(),
        }
    }
}

/// The numbers of a scene.
#[derive(Debug)]
pub struct SceneParameters<'a> {
    scene: &'a Scene,
    model: &'a Model,
    scalars: Vec<ScalarParameter>,
    profiles: Vec<ProfileParameter>,
}

impl<'a> SceneParameters<'a> {
    /// The numbers of `scene`, whose model is `model`.
    pub fn of(scene: &'a Scene, model: &'a Model) -> Self {
        Self { scene, model, scalars: scene.parameters(), profiles: scene.profiles() }
    }

    /// The keys of all numbers that affect the motion.
    pub fn keys(&self) -> Vec<&str> {
        let scalars = self.scalars.iter().map(|scalar| &*scalar.key).filter(|key| self.fits(key));
        let mut keys: Vec<&str> = scalars.chain(self.profiles.iter().map(|points| points.key)).collect();
        keys.dedup();
        keys
    }

    /// The numbers of a key: one, two components, or one per point along the rod. Empty if it does not affect the motion.
    pub fn of_key(&self, key: &str) -> Vec<SceneParameter> {
        let list = |values: Vec<f64>| toml::Value::Array(values.into_iter().map(toml::Value::Float).collect());
        let scalars: Vec<&ScalarParameter> =
            self.scalars.iter().filter(|scalar| scalar.key == key && self.fits(key)).collect();
        if let Some(points) = self.profiles.iter().find(|points| points.key == key).filter(|_| scalars.is_empty()) {
            let whole = toml::Value::Array(points.points.iter().map(|point| list(point.to_vec())).collect());
            let number = |(i, [xi, value]): (usize, &[f64; 2])| SceneParameter {
                key: key.to_string(),
                place: vec![i, 1],
                xi: Some(*xi),
                unit: points.unit,
                description: "values at the points of the profile along the rod".to_string(),
                own: *value,
                whole: whole.clone(),
                by: Parameter::OfScene(0),
                typical: points
                    .points
                    .iter()
                    .fold(self.typical(key, points.unit), |most, point| most.max(point[1].abs())),
                is_signed: points.points.iter().any(|point| point[1] <= 0.0),
            };
            return points.points.iter().enumerate().map(number).collect();
        }
        let whole = list(scalars.iter().map(|scalar| scalar.value).collect());
        let number = |scalar: &&ScalarParameter| {
            let (place, whole) = match scalar.component {
                None => (vec![], toml::Value::Float(scalar.value)),
                Some(i) => (vec![i], whole.clone()),
            };
            let by = Parameter::of_key(key, self.model).filter(|_| place.is_empty() && !self.reaches_further(key));
            SceneParameter {
                key: key.to_string(),
                place,
                xi: None,
                unit: scalar.unit,
                description: scalar.description.clone(),
                own: scalar.value,
                whole,
                by: by.unwrap_or(Parameter::OfScene(0)),
                typical: scalars
                    .iter()
                    .fold(self.typical(key, scalar.unit), |most, scalar| most.max(scalar.value.abs())),
                is_signed: *scalar.range.start() < 0.0,
            }
        };
        scalars.iter().map(number).collect()
    }

    /// True if a number affects the motion.
    fn fits(&self, key: &str) -> bool {
        let fluid = ["medium.viscosity_pa_s", DENSITY].contains(&key) && self.model.buoyancy.is_none();
        let passive = ["solver.", "start."].iter().any(|part| key.starts_with(part));
        Parameter::of_key(key, self.model).is_some() || !(fluid || passive)
    }

    /// True if a number affects more of the model than the parameter of the equations that stands for it.
    fn reaches_further(&self, key: &str) -> bool {
        let law = self.scene.drag.as_ref().map(|drag| drag.law_name());
        // A damping time follows from the loss factor and the frequency of the drive, if the scene gives no frequency for the
        // loss factor.
        let loss = self.scene.rod.loss_factor.is_some() && self.scene.rod.loss_frequency_hz.is_none();
        key == DENSITY && self.scene.head_body.is_some() // the mass of the body
            || key.ends_with("frequency_hz") && (law == Some("weak-inertia") || loss)
    }

    /// A typical value of a number with this unit.
    fn typical(&self, key: &str, unit: &str) -> f64 {
        let rod = &self.model.rod;
        let length = rod.length;
        let driven = self.model.actuation.as_ref().map_or(f64::INFINITY, |(_, drive)| 1.0 / (TAU * drive.frequency));
        // The start of a rod that is driven faster than it vibrates is not linear in the damping.
        let time = rod.bending_time().min(driven);
        match unit {
            _ if key == "rod.inner_radius_m" => 1e-3 * length,
            "m" => length,
            "1/m" => 1.0 / length,
            "s" => time,
            "1/s" => 1.0 / time,
            "m/s" => length / time,
            "m/s^2" => length / (time * time),
            "N" => rod.ei / (length * length),
            "N m" => rod.ei / length,
            _ => 1.0,
        }
    }
}

/// Assigns indices in the result of [`finite_differences`] to those of `numbers` without an analytic derivative.
pub fn assign_indices(numbers: &mut [SceneParameter]) {
    let of_scene = numbers.iter_mut().filter(|number| matches!(number.by, Parameter::OfScene(_)));
    of_scene.enumerate().for_each(|(i, number)| number.by = Parameter::OfScene(i));
}

/// The keys of a scene, with `values` for the first of `numbers` and the others unchanged.
pub fn keys_with(numbers: &[SceneParameter], values: &[f64]) -> Vec<(String, toml::Value)> {
    let mut keys: Vec<(String, toml::Value)> = Vec::new();
    for (number, value) in numbers.iter().zip(values) {
        let at = keys.iter().position(|(key, _)| *key == number.key).unwrap_or_else(|| {
            keys.push((number.key.clone(), number.whole.clone()));
            keys.len() - 1
        });
        let to = number.place.iter().try_fold(&mut keys[at].1, |to, i| to.get_mut(*i));
        if let Some(to) = to {
            *to = toml::Value::Float(*value);
        }
    }
    keys
}

/// The finite differences of the scene of `document`, whose `numbers` have these `values`, with respect to each number without an
/// analytic derivative. All perturbed scenes keep its drag law. A flow along interfaces is only changed along them: derivatives
/// with respect to its components are those of the tangential part, and zero for a component normal to the interfaces or any
/// other number that must be zero.
///
/// # Errors
/// Errors of [`Document::scene`] and of the model.
pub fn finite_differences(
    document: &Document,
    numbers: &[SceneParameter],
    values: &[f64],
) -> Result<Vec<FiniteDifference>> {
    let of_scene: Vec<usize> = (0..numbers.len()).filter(|i| matches!(numbers[*i].by, Parameter::OfScene(_))).collect();
    if of_scene.is_empty() {
        return Ok(Vec::new());
    }
    let scene_of = |values: &[f64]| {
        let mut document = document.clone();
        document.begin_layer();
        keys_with(numbers, values).iter().for_each(|(key, value)| document.set_value("a derivative", key, value));
        document.scene()
    };
    let own = scene_of(values)?;
    let layers = own.model()?.layers;
    let of = |i: usize| {
        let number = &numbers[i];
        // The change of all numbers with this one, which may occur twice.
        let is_same = |other: &SceneParameter| other.key == number.key && other.place == number.place;
        let mut direction: Vec<f64> = numbers.iter().map(|other| if is_same(other) { 1.0 } else { 0.0 }).collect();
        if let (Some(layers), FLOW) = (&layers, &*number.key) {
            let normal: [f64; 2] = layers.normal.into();
            let axis = |j: usize| numbers[j].place.first().copied().unwrap_or_default();
            for j in (0..numbers.len()).filter(|j| numbers[*j].key == FLOW) {
                direction[j] -= normal[axis(i)] * normal[axis(j)];
            }
        }
        if direction.iter().all(|part| part.abs() < ALONG) {
            return Ok(FiniteDifference::zero(&own.model()?));
        }
        let moved = FiniteDifference::of(0.0, number.scale(values[i]), |change| {
            let values: Vec<f64> = values.iter().zip(&direction).map(|(own, part)| own + change * part).collect();
            let scene = scene_of(&values)?.with_fluid_of(&own);
            Ok([scene.model()?, scene.model()?])
        });
        match moved {
            // A number that must be zero, such as gravity along horizontal layers.
            Err(Error::Scene { .. }) if values[i] == 0.0 => Ok(FiniteDifference::zero(&own.model()?)),
            Ok(moved) if [FLOW, SHEAR].contains(&&*number.key) => Ok(moved.of_flow()),
            moved => moved,
        }
    };
    of_scene.into_iter().map(of).collect()
}
