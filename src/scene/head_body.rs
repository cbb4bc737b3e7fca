//! `[head_body]`: a rigid spheroid at the head of the rod.

use serde::Deserialize;

use super::key_error::KeyError;
use super::parameter::ParameterList;
use super::rod::SIZES;
use super::value::{self, NotNegative, Positive};
use super::{HeadKind, Scene};
use crate::error::{self, Error};
use crate::fluid::Force;
use crate::fluid::body::{BodyDrag, BodyInertia, FORM_DRAG_ACROSS, FORM_DRAG_ALONG};
use crate::model::Model;
use crate::rod::{Rod, Spheroid};

/// Form drag of a sphere between Reynolds numbers of 10³ and 10⁵ (S. F. Hoerner, Fluid-Dynamic Drag, 1965).
const SPHERE_DRAG: f64 = 0.47;

/// `[head_body]`. Its centre is node 0 and the rod's first node is node 1.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct HeadBodyTable {
    /// Semi-axis along the rod, m. The rod begins at its end.
    pub semi_axis_along_m: Positive,
    /// Semi-axis across the rod, m.
    pub semi_axis_across_m: Positive,
    /// Mass, kg. By default, the mass of the displaced fluid.
    pub mass_kg: Option<Positive>,
    /// Moment of inertia about its centre, kg m². By default, that of a homogeneous spheroid with `[reactive]`, and 0 without it,
    /// where drag dominates rotation.
    pub moment_of_inertia_kg_m2: Option<NotNegative>,
    /// Form drag coefficient along the rod for the area πb². By default, that of a sphere if the drag law has form drag, and 0
    /// for laws of creeping flow.
    pub form_drag_along: Option<NotNegative>,
    /// Form drag coefficient across the rod for the area πab. The default is that of `form_drag_along`.
    pub form_drag_across: Option<NotNegative>,
}

impl HeadBodyTable {
    /// Its geometry.
    pub fn spheroid(&self) -> Spheroid {
        Spheroid { along: self.semi_axis_along_m.get(), across: self.semi_axis_across_m.get() }
    }
}

impl Scene {
    /// The node at which the rod begins: 1 with a body, whose centre is node 0, and 0 without.
    pub fn front(&self) -> usize {
        usize::from(self.head_body.is_some())
    }

    /// Returns an error for a model with another number of nodes.
    pub(crate) fn fits(&self, model: &Model) -> error::Result<()> {
        let (expected, found) = (self.nodes(), model.rod.nodes);
        if expected == found { Ok(()) } else { Err(Error::WrongLength { name: "nodes", expected, found }) }
    }

    /// The total number of nodes: those of the rod, and the centre of a body.
    pub fn nodes(&self) -> usize {
        self.rod.nodes.get() + self.front()
    }

    /// The first node with a joint.
    pub fn first_joint(&self) -> usize {
        usize::from(self.head.kind == HeadKind::Free)
    }

    /// Mass of the body, kg: its own, or that of the fluid it displaces.
    fn body_mass(&self, body: &HeadBodyTable) -> Option<f64> {
        let neutral = || Some(body.spheroid().volume() * self.medium.as_ref()?.density_kg_m3.get());
        body.mass_kg.map(Positive::get).or_else(neutral)
    }

    /// The rod with the body in front, if there is one.
    pub(super) fn behind_body(&self, rod: Rod) -> Rod {
        let Some(body) = &self.head_body else { return rod };
        rod.behind_body(self.body_mass(body).unwrap_or_default(), body.spheroid())
    }

    /// Checks the body's table.
    pub(super) fn check_body(&self) -> Result<(), KeyError> {
        let Some(body) = &self.head_body else { return Ok(()) };
        let fault = |key: &str, problem: String| Err(KeyError { key: key.to_string(), problem });
        if self.head.kind != HeadKind::Free {
            let problem = "found with a held head, whose body belongs to the host: remove [head_body], or use head.kind = \"free\"";
            return fault("head_body", problem.into());
        }
        let Some(mass) = self.body_mass(body) else {
            let problem = "missing; there is no [medium] whose density would make the body neutrally buoyant";
            return fault("head_body.mass_kg", problem.into());
        };
        let [along, across] = [body.semi_axis_along_m, body.semi_axis_across_m].map(Positive::get);
        let [low, high] = [SIZES.start(), SIZES.end()];
        let sizes = [
            ("mass_kg", "its mass", mass, "kg"),
            ("semi_axis_along_m", "its volume", along * across * across, "m^3"),
            ("semi_axis_along_m", "the drag of its spin", along.powi(3), "m^3"),
        ];
        for (key, what, size, unit) in sizes {
            if !SIZES.contains(&size) {
                let problem =
                    format!("makes {what} {size:e} {unit}; allowed: what makes it {low:e} to {high:e} {unit}");
                return fault(&format!("head_body.{key}"), problem);
            }
        }
        let height = self.drag.as_ref().and_then(|drag| drag.height_m);
        if let Some(height) = height.map(Positive::get).filter(|height| *height <= across) {
            let allowed =
                format!("above the semi-axis of [head_body] across it, {across:e} m: it would intersect the wall");
            return fault("drag.height_m", value::refused(format!("{height:e} m"), allowed));
        }
        if self.drag.is_none() && (body.form_drag_along.is_some() || body.form_drag_across.is_some()) {
            let key = if body.form_drag_along.is_some() { FORM_DRAG_ALONG } else { FORM_DRAG_ACROSS };
            return fault(key, "found without [drag], which it requires; add it".into());
        }
        if self.reactive.is_none() && body.moment_of_inertia_kg_m2.is_some() {
            let problem =
                "found without [reactive], without which drag stops every rotation at once; add it or remove this";
            return fault("head_body.moment_of_inertia_kg_m2", problem.into());
        }
        Ok(())
    }

    /// The drag of the body, for a drag law that is linear in velocity or not.
    pub(super) fn body_drag(&self, linear: bool) -> Option<Box<dyn Force>> {
        let body = self.head_body.as_ref()?;
        let spheroid = body.spheroid();
        let default = if linear { 0.0 } else { SPHERE_DRAG };
        let form = [body.form_drag_along, body.form_drag_across].map(|form| form.map_or(default, NotNegative::get));
        let height = self.drag.as_ref().and_then(|drag| drag.height_m);
        let viscous = height.map_or_else(|| spheroid.drag(), |height| spheroid.drag_beside(height.get()));
        Some(Box::new(BodyDrag { viscous, half_area: spheroid.areas().map(|area| 0.5 * area), form }))
    }

    /// The inertia of the fluid around the body, and of its spin.
    pub(super) fn body_inertia(&self) -> Option<Box<dyn Force>> {
        let body = self.head_body.as_ref()?;
        let spheroid = body.spheroid();
        let spread = self.body_mass(body).unwrap_or_default() * spheroid.inertia();
        let own = body.moment_of_inertia_kg_m2.map_or(spread, NotNegative::get);
        Some(Box::new(BodyInertia { added: spheroid.added(), own }))
    }

    /// Adds the numbers of the body.
    pub(super) fn body_parameters(&self, list: &mut ParameterList) {
        let Some(body) = &self.head_body else { return };
        list.add("head_body.semi_axis_along_m", "m", "semi-axis of the body along the rod", body.semi_axis_along_m);
        list.add("head_body.semi_axis_across_m", "m", "semi-axis of the body across the rod", body.semi_axis_across_m);
        if let Some(mass) = body.mass_kg {
            list.add("head_body.mass_kg", "kg", "mass of the body", mass);
        }
        let numbers = [
            ("head_body.moment_of_inertia_kg_m2", "kg m^2", "moment of inertia", body.moment_of_inertia_kg_m2),
            (FORM_DRAG_ALONG, "1", "form drag along the rod", body.form_drag_along),
            (FORM_DRAG_ACROSS, "1", "form drag across the rod", body.form_drag_across),
        ];
        for (key, unit, what, value) in numbers {
            if let Some(value) = value {
                list.add(key, unit, &format!("{what} of the body"), value);
            }
        }
    }
}
