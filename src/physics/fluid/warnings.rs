//! Warnings of forces that are outside their range of validity, with the drag laws that would be valid.

use super::force::Forces;
use super::laws::{DragLaw, LAWS};
use super::validity::{Bound, DimensionlessNumber, FlowConditions};

/// Warnings for those of `forces` that are outside their range of validity, one per shared range. `without` returns
/// what else must change if another law is chosen, or `None` if that law cannot be chosen.
pub fn out_of_range(
    forces: &Forces,
    motion: &FlowConditions<'_>,
    without: impl Fn(&'static DragLaw) -> Option<String>,
) -> Vec<String> {
    let mut said: Vec<(Vec<&str>, String)> = Vec::new();
    for force in forces.iter() {
        let validity = force.validity();
        let Some(beyond) = validity.beyond(motion) else { continue };
        let text = format!("{beyond}{}", others(force.name(), validity.bounds, motion, &without));
        match said.iter_mut().find(|(_, other)| *other == text) {
            Some((names, _)) => names.push(force.name()),
            None => said.push((vec![force.name()], text)),
        }
    }
    let in_words = |(names, text): (Vec<&str>, String)| match &names[..] {
        [name] => format!("{name} is outside its range: {text}"),
        names => format!("{} are outside their range: {text}", names.join(" and ")),
    };
    said.into_iter().map(in_words).collect()
}

/// The alternatives to a force that would be valid: drag laws, or form drag on the head body.
fn others(
    name: &str,
    bounds: &[Bound],
    motion: &FlowConditions<'_>,
    without: impl Fn(&'static DragLaw) -> Option<String>,
) -> String {
    if bounds
        .iter()
        .any(|bound| bound.number == DimensionlessNumber::BodyReynolds && bound.value_outside(motion).is_some())
    {
        return "; head_body.form_drag_along and head_body.form_drag_across add form drag".to_string();
    }
    if !LAWS.iter().any(|law| law.name == name) {
        return String::new();
    }
    let holds =
        |law: &&&DragLaw| law.name != name && law.is_offered(motion.height.is_some()) && law.validity.holds(motion);
    let name = |law: &&'static DragLaw| Some(format!("\"{}\"{}", law.name, without(law)?));
    let names: Vec<String> = LAWS.iter().filter(holds).filter_map(name).collect();
    match &names[..] {
        [] => String::new(),
        [one] => format!("; drag.law = {one} is valid there"),
        [rest @ .., last] => format!("; drag.law = {} or {last} is valid there", rest.join(", ")),
    }
}
