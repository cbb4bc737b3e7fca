//! Placeholders for wrong values of a scene, so that all of its errors are found and reported at once.

use toml::Spanned;
use toml::de::{DeString, DeTable, DeValue};

/// Valid values of the keys without a default. They replace missing and wrong values while further errors are searched for.
pub(super) const PLACEHOLDERS: &str = "
rod = { nodes = 9, length_m = 1.0, outer_radius_m = 0.01, youngs_modulus_pa = 1e9, density_kg_m3 = 1e3 }
actuation = { kind = \"travelling-wave\", kappa_amp = 1.0, frequency_hz = 1.0, wavelength_m = 1.0 }
medium = { viscosity_pa_s = 1.0, density_kg_m3 = 1e3 }
drag = { ratio = 2.0 }
loads.point = [{ node = 0, force_n = [0.0, 0.0] }]
solver = { duration_s = 1.0 }
";

/// Sets a dotted key to the value in `placeholders`, or removes it if there is none. Returns false if nothing changed.
pub(super) fn substitute<'a>(table: &mut DeTable<'a>, placeholders: &DeTable<'a>, key: &str) -> bool {
    let (first, rest) = key.split_once('.').map_or((key, None), |(first, rest)| (first, Some(rest)));
    let known = placeholders.get(first).map(Spanned::get_ref);
    let inner = rest.zip(table.get_mut(first).map(Spanned::get_mut));
    if let Some((rest, value)) = inner {
        let nothing = DeTable::new();
        match value {
            DeValue::Table(inner) => {
                return substitute(inner, known.and_then(DeValue::as_table).unwrap_or(&nothing), rest);
            }
            DeValue::Array(items) => {
                let (index, rest) = rest.split_once('.').unwrap_or((rest, ""));
                let item = index.parse().ok().and_then(|index: usize| items.get_mut(index));
                let known = known.and_then(DeValue::as_array).and_then(|items| items.first());
                let known = known.and_then(|item| item.get_ref().as_table()).unwrap_or(&nothing);
                return match item.map(Spanned::get_mut) {
                    Some(DeValue::Table(inner)) if !rest.is_empty() => substitute(inner, known, rest),
                    _ => false,
                };
            }
            _ => {}
        }
    }
    let name = table.get_key_value(first).map(|(name, _)| name.clone());
    match (known, name) {
        (Some(value), name) => {
            // Without a span, because it is not part of the text.
            let name = name.unwrap_or_else(|| Spanned::new(0..0, first.to_string().into()));
            table.remove(&name);
            table.insert(Spanned::new(0..0, name.into_inner()), Spanned::new(0..0, without_span(value)));
            true
        }
        (None, Some(name)) => table.remove(&name).is_some(),
        (None, None) => false,
    }
}

/// A copy of a value without its position in the text.
fn without_span<'a>(value: &DeValue<'a>) -> DeValue<'a> {
    let nowhere = |value: &Spanned<DeValue<'a>>| Spanned::new(0..0, without_span(value.get_ref()));
    match value {
        DeValue::Table(table) => {
            let entry = |(key, value): (&Spanned<DeString<'a>>, &Spanned<DeValue<'a>>)| {
                (Spanned::new(0..0, key.get_ref().clone()), nowhere(value))
            };
            DeValue::Table(table.iter().map(entry).collect())
        }
        DeValue::Array(items) => DeValue::Array(items.iter().map(nowhere).collect()),
        other => other.clone(),
    }
}
