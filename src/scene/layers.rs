//! `[medium.beyond]`, `[[medium.layers]]` and `[medium.shear]`: a nonuniform medium.

use nalgebra::Vector2;
use serde::Deserialize;

use super::key_error::KeyError;
use super::value::{self, Finite, Positive};
use super::{MediumTable, Scene};
use crate::fluid::Fluid;
use crate::fluid::medium::{Layer, Layers, MAX_LAYERS};

/// `[medium.beyond]`, or one of `[[medium.layers]]`: the fluid where normal·x > offset_m.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct LayerTable {
    /// Normal of the interface, towards this fluid, of any length. By default, that of the first layer.
    #[serde(default, deserialize_with = "value::optional_pair")]
    pub normal: Option<[Finite; 2]>,
    /// Position of the middle of the interface along the normal, m.
    pub offset_m: Finite,
    /// Thickness of the transition between the fluids, m.
    pub thickness_m: Positive,
    /// Dynamic viscosity of this fluid, Pa s.
    pub viscosity_pa_s: Positive,
    /// Density of this fluid, kg/m³.
    pub density_kg_m3: Positive,
    /// Velocity of the background flow in this fluid, along the interface, m/s. By default, that of the first fluid.
    #[serde(default, deserialize_with = "value::optional_pair")]
    pub flow_m_s: Option<[Finite; 2]>,
}

/// `[medium.shear]`: a linear shear flow.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct ShearTable {
    /// Velocity gradient along the normal, 1/s. The flow is along the normal rotated by −90°.
    pub rate_per_s: Finite,
    /// Direction of the gradient. By default, the normal of the interfaces.
    #[serde(default, deserialize_with = "value::optional_pair")]
    pub normal: Option<[Finite; 2]>,
}

/// Directions count as equal if the sine of the angle between them is at most this: the rounding of a rotated scene.
const PARALLEL_TOLERANCE: f64 = 1e-9;

fn vector(pair: [Finite; 2]) -> Vector2<f64> {
    Vector2::from(pair.map(Finite::get))
}

impl MediumTable {
    /// The fluids beyond the interfaces, in order.
    pub fn interfaces(&self) -> impl Iterator<Item = &LayerTable> {
        self.beyond.iter().chain(&self.layers)
    }

    /// True if the medium is nonuniform.
    pub fn is_stacked(&self) -> bool {
        self.normal().is_some()
    }

    /// The interfaces with their keys.
    fn keyed(&self) -> impl Iterator<Item = (String, &LayerTable)> {
        let layers = self.layers.iter().enumerate().map(|(i, layer)| (format!("medium.layers.{i}"), layer));
        self.beyond.iter().map(|layer| ("medium.beyond".to_string(), layer)).chain(layers)
    }

    /// The unit normal of its layers.
    fn normal(&self) -> Option<Vector2<f64>> {
        let given = self.interfaces().map(|layer| layer.normal).chain(self.shear.iter().map(|shear| shear.normal));
        given.flatten().next().map(|normal| vector(normal).normalize())
    }

    /// The steady flow of its first fluid.
    fn first_flow(&self) -> Vector2<f64> {
        self.steady_flow().map_or(Vector2::zeros(), Vector2::from)
    }

    /// Its layers, or `None` if it is uniform.
    pub(super) fn stack(&self) -> Option<Layers> {
        let normal = self.normal()?;
        let first = self.first_flow();
        let layers = self.interfaces().map(|layer| Layer {
            offset: layer.offset_m.get(),
            thickness: layer.thickness_m.get(),
            fluid: Fluid {
                viscosity: layer.viscosity_pa_s.get(),
                density: layer.density_kg_m3.get(),
                flow: layer.flow_m_s.map_or(Vector2::zeros(), |flow| vector(flow) - first),
                ..Fluid::NONE
            },
        });
        Some(Layers::new(normal, self.shear.as_ref().map_or(0.0, |shear| shear.rate_per_s.get()), layers))
    }

    /// Checks the layers, and other tables against them.
    pub(super) fn check(&self, scene: &Scene) -> Result<(), KeyError> {
        let fault = |key: String, problem: String| Err(KeyError { key, problem });
        if self.beyond.is_some() && !self.layers.is_empty() {
            let problem = "found together with [[medium.layers]]; make it the first of them";
            return fault("medium.beyond".into(), problem.into());
        }
        if self.layers.len() > MAX_LAYERS {
            let found = format!("{} layers", self.layers.len());
            return fault(
                format!("medium.layers.{MAX_LAYERS}"),
                value::refused(found, format!("at most {MAX_LAYERS}")),
            );
        }
        let mut keys = self.keyed().map(|(key, layer)| (key, layer.normal));
        let first = keys.next().or(self.shear.as_ref().map(|shear| ("medium.shear".to_string(), shear.normal)));
        let Some((first, normal)) = first else { return Ok(()) };
        let key = |table: &str, key: &str| format!("{table}.{key}");
        let Some(normal) = normal else {
            return fault(key(&first, "normal"), "missing; the direction across the layers has no default".into());
        };
        if vector(normal) == Vector2::zeros() {
            return fault(key(&first, "normal"), value::refused("[0, 0]", "a direction"));
        }
        let normal = vector(normal).normalize();
        let others = keys.chain(self.shear.iter().map(|shear| ("medium.shear".to_string(), shear.normal)));
        for (table, other) in others.filter_map(|(table, other)| Some((table, vector(other?)))) {
            if other.perp(&normal).abs() > PARALLEL_TOLERANCE * other.norm() || other.dot(&normal) <= 0.0 {
                let found = format!("[{}, {}]", other.x, other.y);
                let allowed = format!("the direction of {first}.normal, as all interfaces are parallel; leave it out");
                return fault(key(&table, "normal"), value::refused(found, allowed));
            }
        }
        if self.steady_flow().is_none() {
            let problem = "changes in time in a nonuniform medium, where the pressure would accelerate fluids of different density differently; make it steady, or remove the layers and the shear";
            return fault("medium.flow_m_s".into(), problem.into());
        }
        let crosses = |flow: Vector2<f64>| normal.dot(&flow).abs() > PARALLEL_TOLERANCE * flow.norm();
        let flows = self.keyed().filter_map(|(table, layer)| Some((key(&table, "flow_m_s"), layer.flow_m_s?)));
        let flows = flows.map(|(key, flow)| (key, vector(flow)));
        for (key, flow) in std::iter::once(("medium.flow_m_s".to_string(), self.first_flow())).chain(flows) {
            if crosses(flow) {
                let found = format!("[{}, {}], which crosses the layers", flow.x, flow.y);
                let allowed = "a flow along them (normal · flow = 0): a flow across them would carry the layers away";
                return fault(key, value::refused(found, allowed));
            }
        }
        let tables: Vec<_> = self.keyed().collect();
        for pair in tables.windows(2) {
            let [(_, before), (table, after)] = pair else { continue };
            let ends = [before, after].map(|layer| (layer.offset_m.get(), 0.5 * layer.thickness_m.get()));
            let [(low, half), (high, other)] = ends;
            if low + half > high - other {
                let allowed = format!(
                    "at least {:e} m, as interfaces follow each other along the normal and do not overlap",
                    low + half + other
                );
                return fault(key(table, "offset_m"), value::refused(format!("{high:e} m"), allowed));
            }
        }
        let gravity = scene.loads.as_ref().and_then(|loads| loads.gravity_m_s2).map_or(Vector2::zeros(), vector);
        if !tables.is_empty() && normal.perp(&gravity).abs() > PARALLEL_TOLERANCE * gravity.norm() {
            let found = format!("[{}, {}], which is not along the normal", normal.x, normal.y);
            let allowed = "with gravity, the direction of gravity or its opposite: fluids at rest lie in level layers; \
                turn the normal, or remove loads.gravity_m_s2";
            return fault(key(&first, "normal"), value::refused(found, allowed));
        }
        if scene.head_body.is_some() {
            let problem = "found in a nonuniform medium: its drag and inertia are valid in a uniform fluid only; \
                remove it, or the layers and the shear of [medium]";
            return fault("head_body".into(), problem.into());
        }
        if scene.reactive.is_some() {
            let sheared =
                self.shear.as_ref().filter(|shear| shear.rate_per_s.get() != 0.0).map(|_| "medium.shear".into());
            let flowing = |(table, layer): &(String, &LayerTable)| {
                let own = layer.flow_m_s.map(vector)?;
                (own != self.first_flow()).then(|| key(table, "flow_m_s"))
            };
            if let Some(key) = sheared.or_else(|| tables.iter().find_map(flowing)) {
                let problem =
                    "found with [reactive], whose theory holds in a flow without vorticity; remove one of them";
                return fault(key, problem.into());
            }
        }
        Ok(())
    }
}
