//! Axes of a sweep: levels of scene keys (lists, ranges, factors, zipped keys), and Latin hypercube samples.

use serde::Deserialize;
use toml::Value;

use crate::error::{did_you_mean, nearest};
use crate::scene::KeyError;
use crate::scene::value::{optional_pair, refused};

/// Most levels of an axis, and most points of a sample.
const MAX_LEVELS: usize = 1_000_000;

/// Levels that differ from an integer by less than this fraction are integers.
const WHOLE_TOLERANCE: f64 = 1e-12;

/// Keys by which an axis is recognised.
pub(super) const AXIS_KEYS: [&str; 10] =
    ["values", "factors", "zip", "keys", "labels", "from", "to", "count", "between", "scale"];

/// How the levels of an axis are applied to its keys.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AxisKind {
    /// Levels replace the values.
    Values,
    /// Levels multiply the values.
    Factors,
    /// Each key has its own list of values, which advance together.
    Zip,
}

/// An axis of a sweep.
#[derive(Debug, Clone, PartialEq)]
pub struct SweepAxis {
    /// Its name, which is a column of the table.
    pub name: String,
    /// Its path in the sweep's file.
    pub(super) path: String,
    /// How the levels are applied.
    pub kind: AxisKind,
    /// The scene's keys that it sets.
    pub keys: Vec<String>,
    /// Labels of its levels, for the table.
    pub labels: Vec<Value>,
    /// The values, or factors, at each level: one per key, or one for all.
    pub(super) levels: Vec<Vec<Value>>,
    /// True if the levels are sampled points; all sampled axes advance together.
    pub sampled: bool,
    /// True if the levels are a geometric sequence.
    pub logarithmic: bool,
}

impl SweepAxis {
    /// True if the file of the sweep can refer to the axis by `name`.
    pub(super) fn is_called(&self, name: &str) -> bool {
        self.name == name || self.name.strip_prefix("axis.").is_some_and(|own| own == name && is_result(own))
    }
}

/// `[samples]`: a Latin hypercube.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Sampling {
    /// Number of points.
    pub count: usize,
    /// Seed of the random numbers; the same seed gives the same points.
    #[serde(default)]
    pub seed: u64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum LevelSpacing {
    #[default]
    Linear,
    Log,
}

/// Levels as read from the file.
enum AxisLevels {
    Listed { values: Vec<Value>, scale: LevelSpacing },
    Between { low: f64, high: f64, scale: LevelSpacing },
}

/// The axes in `table` at `path`, in no particular order.
pub(super) fn read(table: &toml::Table, path: &str) -> Result<Vec<SweepAxis>, KeyError> {
    let mut axes = Vec::new();
    for (key, value) in table {
        let path = format!("{path}.{key}");
        match value {
            Value::Table(inner) if !AXIS_KEYS.iter().any(|mark| inner.contains_key(*mark)) => {
                axes.extend(read(inner, &path)?);
            }
            Value::Table(_) | Value::Array(_) => axes.push(axis(value, &path)?),
            other => {
                let allowed = "a list of values, { from, to, count }, { between = [low, high] }, { values }, \
                    { factors } or { zip }";
                let meant = did_you_mean(nearest(key, AXIS_KEYS.into_iter()));
                return Err(KeyError { key: path, problem: format!("{}{meant}", refused(other, allowed)) });
            }
        }
    }
    if axes.is_empty() {
        return Err(KeyError { key: path.to_string(), problem: "found no axis; allowed: at least one".to_string() });
    }
    Ok(axes)
}

/// The axis that `value` at `path` describes. A sampled axis has its two ends as levels until it is sampled.
fn axis(value: &Value, path: &str) -> Result<SweepAxis, KeyError> {
    let fault = |problem: String| KeyError { key: path.to_string(), problem };
    let name = path.split_once('.').map_or(path, |(_, name)| name).to_string();
    let empty = toml::Table::new();
    let table = value.as_table().unwrap_or(&empty);
    let has = |key: &str| table.contains_key(key);
    if let Some(other) = table.keys().find(|key| !AXIS_KEYS.contains(&key.as_str())) {
        return Err(KeyError {
            key: format!("{path}.{other}"),
            problem: format!(
                "unknown key; allowed: {}{}",
                AXIS_KEYS.join(", "),
                did_you_mean(nearest(other, AXIS_KEYS.into_iter()))
            ),
        });
    }
    if let Some(zip) = table.get("zip") {
        if table.keys().any(|key| !["zip", "labels"].contains(&key.as_str())) {
            return Err(fault("found zip together with other keys; allowed: zip and labels".to_string()));
        }
        return zipped(zip, table.get("labels"), path, name);
    }
    let keys = match table.get("keys") {
        None => vec![name.clone()],
        Some(keys) => texts(keys).ok_or_else(|| KeyError {
            key: format!("{path}.keys"),
            problem: refused(keys, "a list of the scene's keys, such as [\"rod.outer_radius_m\"]"),
        })?,
    };
    // A range may be given along with the axis' own keys.
    let range = || {
        Value::Table(table.clone().into_iter().filter(|(key, _)| !["keys", "labels"].contains(&key.as_str())).collect())
    };
    let (kind, levels) = match (table.get("values"), table.get("factors")) {
        (Some(_), Some(_)) => {
            return Err(fault("found values together with factors; allowed: one of the two".to_string()));
        }
        (Some(values), None) => (AxisKind::Values, values.clone()),
        (None, Some(factors)) => (AxisKind::Factors, factors.clone()),
        (None, None) if value.is_array() => (AxisKind::Values, value.clone()),
        (None, None) => (AxisKind::Values, range()),
    };
    if (has("values") || has("factors"))
        && let Some(stray) = ["from", "to", "count", "between", "scale"].into_iter().find(|key| has(key))
    {
        return Err(fault(format!("found {stray} together with values or factors; allowed: inside them")));
    }
    let (levels, sampled, scale) = match listed(&levels, path)? {
        AxisLevels::Listed { values, scale } => (values, false, scale),
        AxisLevels::Between { low, high, scale } => (vec![Value::Float(low), Value::Float(high)], true, scale),
    };
    if kind == AxisKind::Factors
        && let Some(bad) = levels.iter().find(|level| !number(level).is_some_and(|x| x.is_finite() && x != 0.0))
    {
        return Err(fault(refused(bad, "factors: finite numbers that are not zero")));
    }
    let mut labels = levels.clone();
    if let Some(wanted) = table.get("labels") {
        labels = labelled(wanted, levels.len(), path)?;
        if sampled {
            return Err(KeyError {
                key: format!("{path}.labels"),
                problem: "found for a sample; allowed: for listed levels".into(),
            });
        }
    }
    let name = if kind == AxisKind::Factors && !has("keys") { format!("{name}.factor") } else { name };
    let levels = levels.into_iter().map(|level| vec![level]).collect();
    let logarithmic = scale == LevelSpacing::Log;
    Ok(SweepAxis { name, path: path.to_string(), kind, keys, labels, levels, sampled, logarithmic })
}

/// An axis whose keys each have their own list.
fn zipped(zip: &Value, labels: Option<&Value>, path: &str, name: String) -> Result<SweepAxis, KeyError> {
    let at = format!("{path}.zip");
    let mut lists = Vec::new();
    if let Some(table) = zip.as_table() {
        leaves(table, "", &mut lists);
    }
    let refuse = |found: String| KeyError {
        key: at.clone(),
        problem: refused(found, "keys of the scene with lists of the same length, at least two keys"),
    };
    if lists.len() < 2 {
        return Err(refuse(zip.to_string()));
    }
    let mut levels: Vec<Vec<Value>> = Vec::new();
    for (key, value) in &lists {
        let list = value.as_array().ok_or_else(|| refuse(format!("{value} for {key}")))?;
        if list.is_empty() || (!levels.is_empty() && levels.len() != list.len()) {
            return Err(refuse(format!("a list of {} for {key}", list.len())));
        }
        levels.resize(list.len(), Vec::new());
        levels.iter_mut().zip(list).for_each(|(level, value)| level.push(value.clone()));
    }
    let labels = match labels {
        Some(labels) => labelled(labels, levels.len(), path)?,
        None => {
            // The values of the first key serve as labels, unless they repeat.
            let first: Vec<Value> = levels.iter().map(|level| level[0].clone()).collect();
            let distinct = (1..first.len()).all(|i| !first[..i].contains(&first[i]));
            let all = |level: &Vec<Value>| level.iter().map(Value::to_string).collect::<Vec<_>>().join(", ");
            if distinct { first } else { levels.iter().map(all).map(Value::String).collect() }
        }
    };
    let keys = lists.into_iter().map(|(key, _)| key).collect();
    Ok(SweepAxis {
        name,
        path: path.to_string(),
        kind: AxisKind::Zip,
        keys,
        labels,
        levels,
        sampled: false,
        logarithmic: false,
    })
}

fn labelled(labels: &Value, count: usize, path: &str) -> Result<Vec<Value>, KeyError> {
    match texts(labels) {
        Some(texts) if texts.len() == count => Ok(texts.into_iter().map(Value::String).collect()),
        _ => Err(KeyError {
            key: format!("{path}.labels"),
            problem: refused(labels, format!("a list of {count} texts, one for each level")),
        }),
    }
}

/// Names of result columns: columns that are not in a summary, and quantities of a summary that are not means over cycles.
const RESULT_COLUMNS: [&str; 93] = [
    "case",
    "scene_hash",
    "caudal_version",
    "name",
    "scene_file",
    "scene_fingerprint",
    "complete",
    "ending",
    "end_time_s",
    "nodes",
    "model",
    "model_reason",
    "forces",
    "fluid_reason",
    "fluid_error",
    "fluid_uncertainty",
    "integrator",
    "form",
    "time_step_s",
    "tolerance",
    "steps",
    "rejected_steps",
    "newton_iterations",
    "factorisations",
    "linear_solver",
    "linear_fallbacks",
    "step_halvings",
    "newton_floor_stops",
    "max_strain",
    "max_rotation_per_step_rad",
    "x_com_m",
    "y_com_m",
    "net_displacement_m",
    "max_lateral_excursion_m",
    "com_path_m",
    "initial_energy_j",
    "stretching_energy_j",
    "bending_energy_j",
    "kinetic_energy_j",
    "fluid_energy_j",
    "mean_stretching_energy_j",
    "mean_bending_energy_j",
    "mean_kinetic_energy_j",
    "actuation_work_j",
    "material_work_j",
    "viscous_work_j",
    "wake_work_j",
    "spray_work_j",
    "other_work_j",
    "load_work_j",
    "head_work_j",
    "flow_work_j",
    "mean_actuation_power_w",
    "mean_material_power_w",
    "mean_viscous_power_w",
    "mean_wake_power_w",
    "mean_spray_power_w",
    "mean_load_power_w",
    "mean_head_power_w",
    "mean_flow_power_w",
    "mean_other_power_w",
    "numerical_dissipation_j",
    "rod_momentum_n_s",
    "fluid_momentum_n_s",
    "drag_impulse_n_s",
    "wake_impulse_n_s",
    "flow_impulse_n_s",
    "load_impulse_n_s",
    "head_impulse_n_s",
    "spray_impulse_n_s",
    "other_impulse_n_s",
    "momentum_defect_n_s",
    "notes",
    "cost_of_transport",
    "efficiency",
    "head_force_n",
    "head_moment_n_m",
    "mean_head_force_n",
    "mean_thrust_n",
    "mean_head_moment_n_m",
    "max_head_force_n",
    "max_head_moment_n_m",
    "max_hinge_torque_n_m",
    "max_hinge_power_w",
    "max_hinge_speed_rad_s",
    "max_head_power_w",
    "max_joint_moment_n_m",
    "max_actuation_power_w",
    "swims",
    "periodic",
    "wall_s",
    "verification",
    "final_positions_m",
];

/// True if `name` is that of a result column.
pub(super) fn is_result(name: &str) -> bool {
    RESULT_COLUMNS.contains(&name) || ["cycle", "max_tendon_"].iter().any(|begin| name.starts_with(begin))
}

/// The levels that `value` describes: a list, or a table with a range.
fn listed(value: &Value, path: &str) -> Result<AxisLevels, KeyError> {
    #[derive(Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Range {
        from: Option<Value>,
        to: Option<Value>,
        count: Option<usize>,
        #[serde(default, deserialize_with = "optional_pair")]
        between: Option<[f64; 2]>,
        #[serde(default)]
        scale: LevelSpacing,
    }
    const ALLOWED: &str =
        "a list, { from, to, count, scale = \"linear\" or \"log\" } or { between = [low, high], scale }";
    let fault = |found: String, allowed: &str| KeyError { key: path.to_string(), problem: refused(found, allowed) };
    if let Value::Array(values) = value {
        return match values.len() {
            0 => Err(fault("an empty list".to_string(), "at least one level")),
            _ => Ok(AxisLevels::Listed { values: values.clone(), scale: LevelSpacing::Linear }),
        };
    }
    let range: Range = value.clone().try_into().map_err(|_| fault(value.to_string(), ALLOWED))?;
    let ends = |low: f64, high: f64| match range.scale {
        _ if !(low.is_finite() && high.is_finite()) => Err(fault(format!("{low} to {high}"), "finite numbers")),
        LevelSpacing::Log if low.min(high) <= 0.0 => {
            Err(fault(format!("{low} to {high}"), "positive numbers on a log scale"))
        }
        _ => Ok(()),
    };
    match range {
        Range { from: Some(from), to: Some(to), count: Some(count), between: None, scale } => {
            let (Some(low), Some(high)) = (number(&from), number(&to)) else {
                return Err(fault(value.to_string(), "numbers"));
            };
            ends(low, high)?;
            if !(2..=MAX_LEVELS).contains(&count) {
                return Err(fault(format!("count = {count}"), &format!("2 to {MAX_LEVELS}")));
            }
            let whole = from.is_integer() && to.is_integer();
            let level = |i: usize| match between(low, high, scale, i as f64 / (count - 1) as f64) {
                _ if i == count - 1 => to.clone(),
                x if whole && (x - x.round()).abs() <= WHOLE_TOLERANCE * x.abs() => Value::Integer(x.round() as i64),
                x => Value::Float(rounded(x, low.abs().max(high.abs()))),
            };
            Ok(AxisLevels::Listed { values: (0..count).map(level).collect(), scale })
        }
        Range { from: None, to: None, count: None, between: Some([low, high]), scale } => {
            ends(low, high)?;
            if low >= high {
                return Err(fault(format!("between = [{low}, {high}]"), "[low, high]"));
            }
            Ok(AxisLevels::Between { low, high, scale })
        }
        _ => Err(fault(value.to_string(), ALLOWED)),
    }
}

/// Removes the rounding of a range up to `size`: returns the nearest number with twelve decimal digits if `x` differs from it only
/// by rounding, otherwise `x`.
fn rounded(x: f64, size: f64) -> f64 {
    let short = format!("{x:.11e}").parse().unwrap_or(x);
    if (short - x).abs() <= 4.0 * f64::EPSILON * size { short } else { x }
}

/// The point at fraction x between `low` and `high`; exactly `low` at 0.
fn between(low: f64, high: f64, scale: LevelSpacing, x: f64) -> f64 {
    match scale {
        LevelSpacing::Linear => low + (high - low) * x,
        LevelSpacing::Log if x == 0.0 => low,
        LevelSpacing::Log => (low.ln() + (high.ln() - low.ln()) * x).exp(),
    }
}

/// Samples the axes: a Latin hypercube, with one random point of each axis in each of `count` equal parts of its range, in random
/// order (McKay, Beckman & Conover 1979).
pub(super) fn sample(axes: &mut [SweepAxis], samples: Option<Sampling>) -> Result<(), KeyError> {
    let mut sampled = axes.iter_mut().filter(|axis| axis.sampled).peekable();
    let fault = |key: &str, problem: String| Err(KeyError { key: key.to_string(), problem });
    let Some(Sampling { count, seed }) = samples else {
        return match sampled.peek() {
            Some(axis) => {
                fault(&axis.path, "found between without samples; add count and seed: [samples] in a file, samples={\"count\": 100, \"seed\": 1} in Python".to_string())
            }
            None => Ok(()),
        };
    };
    if sampled.peek().is_none() {
        return fault("samples", "found without an axis { between = [low, high] }; allowed: only with one".to_string());
    }
    if !(1..=MAX_LEVELS).contains(&count) {
        return fault("samples.count", refused(count, format!("1 to {MAX_LEVELS}")));
    }
    let mut dice = fastrand::Rng::with_seed(seed);
    for axis in sampled {
        let [low, high] = [0, 1].map(|i| axis.levels[i].first().and_then(number).unwrap_or_default());
        let scale = if axis.logarithmic { LevelSpacing::Log } else { LevelSpacing::Linear };
        let mut parts: Vec<usize> = (0..count).collect();
        dice.shuffle(&mut parts);
        let point = |part: usize| between(low, high, scale, (part as f64 + dice.f64()) / count as f64);
        axis.labels = parts.into_iter().map(point).map(Value::Float).collect();
        axis.levels = axis.labels.iter().map(|label| vec![label.clone()]).collect();
    }
    Ok(())
}

/// An integer or a float.
pub(super) fn number(value: &Value) -> Option<f64> {
    match value {
        Value::Float(x) => Some(*x),
        Value::Integer(x) => Some(*x as f64),
        _ => None,
    }
}

fn texts(value: &Value) -> Option<Vec<String>> {
    let texts: Option<Vec<_>> = value.as_array()?.iter().map(|text| text.as_str().map(str::to_string)).collect();
    texts.filter(|texts| !texts.is_empty())
}

/// The dotted keys and values of all leaves below `table`.
pub(super) fn leaves(table: &toml::Table, path: &str, found: &mut Vec<(String, Value)>) {
    for (key, value) in table {
        let path = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
        match value {
            Value::Table(inner) if !inner.is_empty() => leaves(inner, &path, found),
            value => found.push((path, value.clone())),
        }
    }
}

/// The value of a dotted key, in which entries of a list are indexed from 0, as in an override.
pub(super) fn look_up<'a>(table: &'a toml::Table, key: &str) -> Option<&'a Value> {
    let mut parts = key.split('.');
    let first = table.get(parts.next()?)?;
    parts.try_fold(first, |value, part| match value {
        Value::Table(table) => table.get(part),
        Value::Array(entries) => entries.get(part.parse::<usize>().ok()?),
        _ => None,
    })
}

/// Why the value `old` of a scene's `key` has no product with a factor.
pub(super) fn no_product(key: &str, old: Option<&Value>) -> String {
    // The second number of a point is the value of a profile there.
    let numbers = |entries: &[Value]| match entries.first() {
        Some(Value::Array(_)) => (0..entries.len()).map(|i| format!("\"{key}.{i}.1\"")).collect::<Vec<_>>(),
        _ => (0..entries.len()).map(|i| format!("\"{key}.{i}\"")).collect(),
    };
    match old {
        Some(Value::Array(entries)) if !entries.is_empty() => format!(
            "multiplies {key}, which is a list; allowed: its numbers, with keys = [{}], or whole lists as values",
            numbers(entries).join(", ")
        ),
        _ => format!("multiplies {key}, which is not a number"),
    }
}

/// The product of two numbers; an integer if the first is an integer and the product is, too.
pub(super) fn product(value: &Value, factor: &Value) -> Option<Value> {
    let product = number(value)? * number(factor)?;
    let whole = value.is_integer() && product == product.round() && product.abs() < 9e15;
    Some(if whole { Value::Integer(product as i64) } else { Value::Float(product) })
}
