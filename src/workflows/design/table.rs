//! `[design]`: the table of a scene that defines a design problem.

use std::collections::BTreeMap;
use std::fmt;

use serde::de::value::{MapAccessDeserializer, SeqAccessDeserializer};
use serde::de::{Error as _, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};

use crate::cycle::derivatives;
use crate::error::{Error, nearest};
use crate::fluid::DENSITY;
use crate::number_format::in_sentence;
use crate::scene::value::{self, ExactlyTwo};
use crate::scene::{Document, HeadKind, KeyError, Scene};
use crate::sensitivity::Parameter;
use crate::sensitivity::scene_parameter::{self, SceneParameter, SceneParameters};

/// Bounds of what has none, over the scene's.
pub const DEFAULT_BOUNDS: [f64; 2] = [0.01, 100.0];

/// A gain below this counts as zero, %.
const LEAST_GAIN_PERCENT: f64 = 0.005;

/// A change by this factor or more is reported as a factor.
const LEAST_FACTOR: f64 = 2.0;

/// What is wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(into = "&'static str")]
pub enum Goal {
    /// The stiffness with which tracked markers moved.
    Identify,
    /// The stiffness that rests in a given shape.
    StaticShape,
    /// A tip that moves as given.
    TrackTip,
    /// The longest way in a direction.
    Distance,
    /// The largest D|D|/W, with D the displacement of the centre of mass in `direction` over the whole run, and W the work of the
    /// actuation. With linear drag this is a constant times the efficiency.
    Efficiency,
    /// The largest or smallest mean over the last whole cycles of the measure with this key in summary.json.
    Cycle(&'static str),
}

/// The goals by name, except those over cycles.
const GOALS: [(&str, Goal); 5] = [
    ("identify", Goal::Identify),
    ("static-shape", Goal::StaticShape),
    ("track-tip", Goal::TrackTip),
    ("distance", Goal::Distance),
    ("efficiency", Goal::Efficiency),
];

impl TryFrom<String> for Goal {
    type Error = String;

    fn try_from(name: String) -> std::result::Result<Self, String> {
        let named = GOALS.iter().find(|(own, _)| *own == name).map(|(_, goal)| *goal);
        let cycle = || {
            derivatives::differentiable().find(|measure| measure.key == name).map(|measure| Self::Cycle(measure.key))
        };
        named.or_else(cycle).ok_or_else(|| {
            let all: Vec<&str> = GOALS
                .iter()
                .map(|(own, _)| *own)
                .chain(derivatives::differentiable().map(|measure| measure.key))
                .collect();
            let listed: Vec<String> = all.iter().map(|name| format!("`{name}`")).collect();
            let near =
                nearest(&name, all.into_iter()).map_or(String::new(), |near| format!("; did you mean `{near}`?"));
            format!("found {name:?}; allowed: {}{near}", listed.join(", "))
        })
    }
}

impl<'de> Deserialize<'de> for Goal {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        Self::try_from(String::deserialize(deserializer)?).map_err(D::Error::custom)
    }
}

impl From<Goal> for &'static str {
    fn from(goal: Goal) -> Self {
        match goal {
            Goal::Cycle(key) => key,
            goal => GOALS.iter().find(|(_, own)| *own == goal).map_or("", |(name, _)| name),
        }
    }
}

impl Goal {
    /// True if the goal is optimised by simulation.
    pub fn is_dynamic(self) -> bool {
        matches!(self, Self::TrackTip | Self::Distance | Self::Efficiency | Self::Cycle(_))
    }

    /// The name and unit of its objective.
    pub fn label(self) -> &'static str {
        match self {
            Self::TrackTip => "rms distance of the tip from its target (m)",
            Self::Identify => "rms distance of the rod from the markers (m)",
            Self::Distance => "distance (m)",
            Self::Cycle(key) => key,
            _ => "distance² over work (m²/J)",
        }
    }
}

/// What a search changes: along the rod, or a number of the scene.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize, Serialize)]
#[serde(from = "String", into = "String")]
pub enum DesignVariable {
    /// Bending stiffness.
    Stiffness,
    /// Amplitude of the actuation.
    Amplitude,
    /// A phase subtracted inside the actuation's function of phase.
    Phase,
    /// A number of the scene, by its key.
    Number(String),
}

impl From<String> for DesignVariable {
    fn from(name: String) -> Self {
        match name.as_str() {
            "stiffness" => Self::Stiffness,
            "amplitude" => Self::Amplitude,
            "phase" => Self::Phase,
            _ => Self::Number(name),
        }
    }
}

impl From<DesignVariable> for String {
    fn from(variable: DesignVariable) -> Self {
        match variable {
            DesignVariable::Stiffness => "stiffness".to_string(),
            DesignVariable::Amplitude => "amplitude".to_string(),
            DesignVariable::Phase => "phase".to_string(),
            DesignVariable::Number(key) => key,
        }
    }
}

/// Least and largest of what is unknown, over what it is in the scene: of all alike, or by keys.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema), schemars(inline, untagged))]
pub enum Bounds {
    /// Of all.
    All([f64; 2]),
    /// By keys.
    Each(BTreeMap<String, [f64; 2]>),
}

impl<'de> Deserialize<'de> for Bounds {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        struct BoundsVisitor;
        impl<'de> Visitor<'de> for BoundsVisitor {
            type Value = Bounds;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("two values in brackets, or a table of them by keys of the scene")
            }

            fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> std::result::Result<Bounds, A::Error> {
                value::pair(SeqAccessDeserializer::new(seq)).map(Bounds::All)
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> std::result::Result<Bounds, A::Error> {
                let each: BTreeMap<String, ExactlyTwo<f64>> =
                    Deserialize::deserialize(MapAccessDeserializer::new(map))?;
                Ok(Bounds::Each(each.into_iter().map(|(key, pair)| (key, pair.0)).collect()))
            }
        }
        deserializer.deserialize_any(BoundsVisitor)
    }
}

/// A second goal: the front of designs on which neither goal can be better without loss of the other.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema), schemars(inline))]
#[serde(deny_unknown_fields)]
pub struct FrontSettings {
    /// The second goal: a mean over the cycles, `distance` or `efficiency`.
    #[cfg_attr(feature = "schema", schemars(with = "String"))]
    pub goal: Goal,
    /// Whether a "larger" or a "smaller" value is better. By default, "larger".
    pub better: Option<String>,
    /// Number of designs on the front, including its two ends.
    #[serde(default = "points")]
    pub points: usize,
}

fn points() -> usize {
    7
}

/// The value that the other goal of a front must reach, while one goal is optimised.
#[derive(Debug, Clone, PartialEq)]
pub struct Floor {
    /// The table with the other goal as its first.
    pub of: Box<DesignTable>,
    /// The value to reach.
    pub value: f64,
    /// Scale of the goal along the front.
    pub size: f64,
}

/// What counts where a design is for several scenes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema), schemars(inline))]
#[serde(rename_all = "kebab-case")]
pub enum Aggregate {
    /// The objective of the worst case.
    #[default]
    Worst,
    /// The mean of the objective over all cases.
    Mean,
}

impl Aggregate {
    /// Aggregates the goal's `values` in the scenes; `None` if one is missing.
    pub fn of(self, values: &[f64], smaller_is_better: bool) -> Option<f64> {
        match self {
            Self::Mean => (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64),
            Self::Worst if smaller_is_better => values.iter().copied().reduce(f64::max),
            Self::Worst => values.iter().copied().reduce(f64::min),
        }
    }

    /// It in words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Worst => "worst",
            Self::Mean => "mean",
        }
    }
}

/// The design problem that `caudal design` solves: identification of a stiffness, or an optimal body and drive.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct DesignTable {
    /// The goal of the design.
    #[cfg_attr(feature = "schema", schemars(with = "String"))]
    pub goal: Goal,
    /// The unknowns that identification determines and that a search varies: stiffness, amplitude, phase, and numbers of the
    /// scene by their keys.
    #[serde(default = "stiffness")]
    #[cfg_attr(feature = "schema", schemars(with = "Vec<String>"))]
    pub variables: Vec<DesignVariable>,
    /// Positions ξ along the rod at which profiles are unknown. By default, every joint. Between them, ln EI, ln amplitude and
    /// phase are linear in ξ; with `track-tip` 1/EI is linear instead of ln EI, and with `identify` and `static-shape` EI itself.
    pub knots: Option<Vec<f64>>,
    /// Smallest and largest stiffness, relative to the largest EI of the rod's sections.
    #[serde(default = "default_bounds", deserialize_with = "value::pair")]
    pub bounds: [f64; 2],
    /// True if the stiffness must not increase from head to tip.
    #[serde(default)]
    pub monotone: bool,
    /// Weight of the roughness ½Σ(second differences)² of the profiles: in identification that of the stiffness; in a search that
    /// of ln EI, ln amplitude and phase, relative to the objective of the first start.
    #[serde(default)]
    pub smoothness: f64,
    /// Mean stiffness, relative to the largest EI of the rod's sections: the largest mean in a search, and the exact mean
    /// otherwise.
    pub mean: Option<f64>,
    /// Smallest and largest amplitude, relative to that of the scene.
    #[serde(default, deserialize_with = "value::optional_pair")]
    pub amplitude_bounds: Option<[f64; 2]>,
    /// The largest mean amplitude, relative to that of the scene.
    pub amplitude_mean: Option<f64>,
    /// Smallest and largest phase, rad.
    #[serde(default, deserialize_with = "value::optional_pair")]
    pub phase_bounds_rad: Option<[f64; 2]>,
    /// Smallest and largest value of the numbers among the variables, relative to their values in the scene: one pair for all, or
    /// a table of pairs by key.
    pub number_bounds: Option<Bounds>,
    /// Those numbers.
    #[serde(skip)]
    pub numbers: Vec<SceneParameter>,
    /// CSV file with the positions of the markers, of the target shape, or of the target path of the tip.
    pub data: Option<String>,
    /// Standard deviation of the marker positions, m. By default, estimated from the residual of the fitted polynomials.
    pub noise_m: Option<f64>,
    /// Duration over which each polynomial is fitted, s. By default, as long as the data allow.
    pub window_s: Option<f64>,
    /// True if the strength of the actuation is unknown as well.
    #[serde(default)]
    pub actuation_gain: bool,
    /// Direction in which displacement counts: "+x" or "-x".
    pub direction: Option<String>,
    /// Whether a "larger" or a "smaller" mean over the cycles is better. By default, "larger".
    pub better: Option<String>,
    /// Largest total mass, kg.
    pub largest_mass_kg: Option<f64>,
    /// True if the swimmer must be as heavy as the fluid that it displaces.
    #[serde(default)]
    pub neutral_buoyancy: bool,
    /// Smallest thickness of the wall of a hollow section, m.
    pub least_wall_m: Option<f64>,
    /// Largest moment that a joint transmits at any time, N m.
    pub largest_moment_n_m: Option<f64>,
    /// Largest strain of the outermost fibre, beyond that of the natural curvature.
    pub largest_strain: Option<f64>,
    /// Largest power of the actuation at any time, W.
    pub largest_power_w: Option<f64>,
    /// Smallest mean forward speed over the last whole cycles, m/s.
    pub least_speed_m_s: Option<f64>,
    /// Smallest mean thrust on a held head over the last whole cycles, N.
    pub least_thrust_n: Option<f64>,
    /// File of a sweep of this scene: one design is found for all of its cases.
    pub over: Option<String>,
    /// The objective of several cases. By default, worst.
    pub robust: Option<Aggregate>,
    /// A second goal: the design is a Pareto front of both.
    pub front: Option<FrontSettings>,
    /// What the other goal of a front has to reach.
    #[serde(skip)]
    pub floor: Option<Floor>,
    /// Number of starts of a search. By default, 3, or 1 for a fit to measured positions.
    pub starts: Option<usize>,
    /// Largest number of iterations per start. By default, 200.
    pub iterations: Option<usize>,
}

fn default_bounds() -> [f64; 2] {
    DEFAULT_BOUNDS
}

fn stiffness() -> Vec<DesignVariable> {
    vec![DesignVariable::Stiffness]
}

#[cfg(feature = "schema")]
impl DesignTable {
    /// The JSON Schema of `[design]`, to be part of that of a scene.
    pub fn schema() -> serde_json::Value {
        let mut schema = crate::scene::schema::of::<Self>();
        if let Some(table) = schema.as_object_mut() {
            table.remove("$schema");
        }
        let measures = derivatives::differentiable().map(|measure| measure.key);
        schema["properties"]["goal"]["enum"] = GOALS.iter().map(|(name, _)| *name).chain(measures).collect();
        schema
    }
}

impl DesignTable {
    /// The table with each key checked separately. It is read as text, as a scene is, so that errors have the same keys and messages.
    fn read(table: &toml::Table) -> std::result::Result<Self, KeyError> {
        #[derive(Deserialize)]
        struct Tables {
            design: DesignTable,
        }
        let text = toml::Table::from_iter([("design".to_string(), table.clone().into())]).to_string();
        match Document::new("scene", text).read_as() {
            Ok(Tables { design }) => Ok(design),
            Err(Error::Scene { key, problem, .. }) => Err(KeyError { key, problem }),
            Err(other) => Err(KeyError { key: "design".to_string(), problem: other.to_string() }),
        }
    }

    /// The table of a scene, checked.
    ///
    /// # Errors
    /// The problem, and the key at fault.
    pub fn of(scene: &Scene) -> std::result::Result<Self, KeyError> {
        let fault = |key: &str, problem: String| KeyError { key: key.to_string(), problem };
        let Some(table) = &scene.design else {
            return Err(fault("design", "missing; a design needs a table [design] with a goal".to_string()));
        };
        let mut table = Self::read(table)?;
        let [low, high] = table.bounds;
        if !(low > 0.0 && high >= low && high.is_finite()) {
            let problem = format!("found [{low}, {high}]; allowed: [least, largest], both positive");
            return Err(fault("design.bounds", problem));
        }
        if !(table.smoothness >= 0.0 && table.smoothness.is_finite()) {
            return Err(fault("design.smoothness", format!("found {}; allowed: 0 or more", table.smoothness)));
        }
        if let Some(mean) = table.mean.filter(|mean| !(*mean > 0.0 && mean.is_finite())) {
            return Err(fault("design.mean", format!("found {mean}; allowed: a positive number")));
        }
        if let Some(knots) = &table.knots {
            let rising = knots.windows(2).all(|pair| pair[0] < pair[1]);
            if knots.is_empty() || !rising || !knots.iter().all(|xi| (0.0..=1.0).contains(xi)) {
                return Err(fault("design.knots", format!("found {knots:?}; allowed: rising numbers from 0 to 1")));
            }
        }
        for (key, value) in [("design.noise_m", table.noise_m), ("design.window_s", table.window_s)] {
            if let Some(value) = value.filter(|value| !(*value > 0.0 && value.is_finite())) {
                return Err(fault(key, format!("found {value}; allowed: a positive number")));
            }
        }
        table.numbers = table.numbers_of(scene).map_err(|problem| fault("design.variables", problem))?;
        table.check_numbers().map_err(|(key, problem)| fault(key, problem))?;
        table.check_variables(scene).map_err(|(key, problem)| fault(key, problem))?;
        table.check_limits(scene).map_err(|(key, problem)| fault(key, problem))?;
        let needs_data = matches!(table.goal, Goal::Identify | Goal::StaticShape | Goal::TrackTip);
        if needs_data && table.data.is_none() {
            return Err(fault("design.data", "missing; this goal needs a CSV file with node positions".to_string()));
        }
        match (table.better.as_deref(), table.goal) {
            (None | Some("larger" | "smaller"), Goal::Cycle(_)) | (None, _) => {}
            (Some(better), Goal::Cycle(_)) => {
                let problem = format!("found {better:?}; allowed: \"larger\" or \"smaller\"");
                return Err(fault("design.better", problem));
            }
            (Some(_), _) => {
                let problem = "found with a goal that implies it; allowed: with means over cycles, \"cycle_…\"";
                return Err(fault("design.better", problem.to_string()));
            }
        }
        match (&table.direction, table.goal) {
            (Some(direction), Goal::Distance | Goal::Efficiency) if !["+x", "-x"].contains(&direction.as_str()) => {
                Err(fault("design.direction", format!("found {direction:?}; allowed: \"+x\" or \"-x\"")))
            }
            (None, Goal::Distance | Goal::Efficiency) => Err(fault(
                "design.direction",
                "missing; allowed: \"+x\" or \"-x\", the direction of travel".to_string(),
            )),
            (Some(_), Goal::Identify | Goal::StaticShape | Goal::TrackTip | Goal::Cycle(_)) => {
                let problem = "found with a goal without direction; allowed: with \"distance\" and \"efficiency\"";
                Err(fault("design.direction", problem.to_string()))
            }
            _ => Ok(table),
        }
    }

    /// The numbers as they are in the scene.
    pub fn initial_numbers(&self) -> Vec<(String, f64)> {
        self.numbers.iter().map(|number| (number.label(), number.own)).collect()
    }

    /// The same table without limits on the body.
    pub fn of_motion(&self) -> Self {
        Self { largest_mass_kg: None, neutral_buoyancy: false, least_wall_m: None, ..self.clone() }
    }

    /// The same table with `goal` as its first goal, and no second.
    pub(super) fn with_goal(&self, goal: Goal) -> Self {
        Self { goal, front: None, floor: None, ..self.clone() }
    }

    /// The same table with the second goal as its first.
    pub fn second(&self) -> Option<Self> {
        let FrontSettings { goal, better, .. } = self.front.clone()?;
        let direction = self.direction.clone().filter(|_| matches!(goal, Goal::Distance | Goal::Efficiency));
        Some(Self { better, direction, ..self.with_goal(goal) })
    }

    /// Checks limits and the second goal.
    fn check_limits(&self, scene: &Scene) -> std::result::Result<(), (&'static str, String)> {
        let limits = [
            ("design.largest_mass_kg", self.largest_mass_kg),
            ("design.least_wall_m", self.least_wall_m),
            ("design.largest_moment_n_m", self.largest_moment_n_m),
            ("design.largest_strain", self.largest_strain),
            ("design.largest_power_w", self.largest_power_w),
            ("design.least_speed_m_s", self.least_speed_m_s),
            ("design.least_thrust_n", self.least_thrust_n),
        ];
        if let Some((key, value)) =
            limits.iter().find_map(|(key, value)| Some((key, value.filter(|x| !(*x > 0.0 && x.is_finite()))?)))
        {
            return Err((key, format!("found {value}; allowed: a positive number")));
        }
        let neutral = ("design.neutral_buoyancy", self.neutral_buoyancy.then_some(1.0));
        let given = limits.iter().chain([&neutral]).find(|(_, value)| value.is_some()).map(|(key, _)| *key);
        let searched = matches!(self.goal, Goal::Distance | Goal::Efficiency | Goal::Cycle(_));
        if let Some(key) = given.or(self.front.as_ref().map(|_| "design.front")).filter(|_| !searched) {
            return Err((key, "found with a goal that has no such limit; allowed: with \"distance\", \"efficiency\" and means over cycles".into()));
        }
        let held = scene.head.kind != HeadKind::Free;
        let head = if held { "a held head" } else { "a free head" };
        for (key, given, fits, found, instead) in [
            (
                "design.least_speed_m_s",
                self.least_speed_m_s,
                !held,
                head,
                "a free head; design.least_thrust_n is for held ones",
            ),
            (
                "design.least_thrust_n",
                self.least_thrust_n,
                held,
                head,
                "a held head; design.least_speed_m_s is for free ones",
            ),
            (
                "design.largest_power_w",
                self.largest_power_w,
                scene.drives().bend(),
                "a passive tail",
                "an [actuation] or [[tendons]], whose power that is",
            ),
        ] {
            if given.is_some() && !fits {
                return Err((key, format!("found with {found}; allowed: with {instead}")));
            }
        }
        if self.over.is_some() && !searched {
            return Err((
                "design.over",
                "found with a goal that is of one scene; allowed: with \"distance\", \"efficiency\" and means over cycles".into(),
            ));
        }
        if self.robust.is_some() && self.over.is_none() {
            return Err(("design.robust", "found without design.over, which names the cases; allowed: with it".into()));
        }
        let of_body = [
            ("design.largest_mass_kg", self.largest_mass_kg.is_some()),
            ("design.neutral_buoyancy", self.neutral_buoyancy),
            ("design.least_wall_m", self.least_wall_m.is_some()),
        ];
        if let Some((key, _)) = of_body.iter().find(|(_, given)| *given && self.numbers.is_empty()) {
            return Err((key, "found where no number of the body is among the variables; allowed: with \"rod.outer_radius_m\" and the like in variables".into()));
        }
        let Some(front) = &self.front else { return Ok(()) };
        if self.over.is_some() {
            return Err(("design.front", "found with design.over; allowed: one of the two".into()));
        }
        if !matches!(front.goal, Goal::Distance | Goal::Efficiency | Goal::Cycle(_)) || front.goal == self.goal {
            let name: &str = front.goal.into();
            return Err((
                "design.front.goal",
                format!("found {name:?}; allowed: another goal, \"distance\", \"efficiency\" or a mean over cycles"),
            ));
        }
        if self.direction.is_none() && matches!(front.goal, Goal::Distance | Goal::Efficiency) {
            return Err((
                "design.front.goal",
                "\"distance\" and \"efficiency\" need design.direction; allowed: with a goal that has one".into(),
            ));
        }
        if !(3..=100).contains(&front.points) {
            return Err(("design.front.points", format!("found {}; allowed: 3 to 100", front.points)));
        }
        match front.better.as_deref() {
            Some(better) if !matches!(front.goal, Goal::Cycle(_)) => {
                let allowed = "with means over cycles, \"cycle_…\"; design.direction gives the direction of travel";
                Err((
                    "design.front.better",
                    format!("found {better:?} with a goal that implies it; allowed: {allowed}"),
                ))
            }
            None | Some("larger" | "smaller") => Ok(()),
            Some(better) => {
                Err(("design.front.better", format!("found {better:?}; allowed: \"larger\" or \"smaller\"")))
            }
        }
    }

    /// True if its goal, or a limit, is a mean over whole cycles.
    pub fn is_over_cycles(&self) -> bool {
        let over = |goal: &Goal| matches!(goal, Goal::Cycle(_));
        let limited = self.least_speed_m_s.or(self.least_thrust_n).is_some();
        over(&self.goal) || limited || self.front.as_ref().is_some_and(|front| over(&front.goal))
    }

    /// Number of its starts.
    pub fn start_count(&self) -> usize {
        self.starts.unwrap_or(if self.fits_positions() { 1 } else { 3 }).max(1)
    }

    /// The aggregation over the cases of the design.
    pub fn aggregate(&self) -> Aggregate {
        self.robust.unwrap_or_default()
    }

    /// Lower and upper bound of the numbers of a key, over their values in the scene.
    pub fn bounds_of(&self, key: &str) -> [f64; 2] {
        match &self.number_bounds {
            Some(Bounds::All(bounds)) => *bounds,
            Some(Bounds::Each(each)) => each.get(key).copied().unwrap_or(DEFAULT_BOUNDS),
            None => DEFAULT_BOUNDS,
        }
    }

    /// True if the answer is searched by simulation.
    pub fn is_searched(&self) -> bool {
        self.goal.is_dynamic() || !self.numbers.is_empty()
    }

    /// True if a smaller objective is better.
    pub fn smaller_is_better(&self) -> bool {
        matches!(self.goal, Goal::Identify | Goal::TrackTip) || self.better.as_deref() == Some("smaller")
    }

    /// The relative improvement of `value` over `other`, %; zero if they are equal, even at zero. `None` for more than twice the
    /// distance from markers, where the other may be almost zero, and for distances from a static shape, where the better one is
    /// almost zero.
    pub fn gain_percent(&self, value: f64, other: f64) -> Option<f64> {
        let better = if self.smaller_is_better() { other - value } else { value - other };
        match better {
            _ if self.goal == Goal::StaticShape => None,
            0.0 => Some(0.0),
            better if better < -other.abs() && self.goal == Goal::Identify => None,
            better => Some(100.0 * better / other.abs()),
        }
    }

    /// Describes how much better or worse `value` is than `other`, which `than` names; `None` if there is no meaningful difference.
    pub fn gain_in_words(&self, value: f64, other: f64, than: &str) -> Option<String> {
        let gain = self.gain_percent(value, other)?;
        let larger = (gain > 0.0) != self.smaller_is_better();
        gain_in_words(gain, if larger { value / other } else { other / value }, than)
    }

    /// True if the goal is to come close to given positions.
    pub fn fits_positions(&self) -> bool {
        self.is_searched() && matches!(self.goal, Goal::Identify | Goal::TrackTip)
    }

    /// The numbers of `scene` among the variables.
    fn numbers_of(&self, scene: &Scene) -> std::result::Result<Vec<SceneParameter>, String> {
        let keys = self.variables.iter().filter_map(|variable| match variable {
            DesignVariable::Number(key) => Some(key),
            _ => None,
        });
        let keys: Vec<&String> = keys.collect();
        let (false, Ok(model)) = (keys.is_empty(), scene.model()) else { return Ok(Vec::new()) };
        let known = SceneParameters::of(scene, &model);
        let mut numbers: Vec<SceneParameter> = Vec::new();
        for key in keys {
            let of_key = known.of_key(key);
            if of_key.is_empty() {
                let listed = known.keys().join(", ");
                let reason = scene.not_a_number(key).map_or(String::new(), |reason| format!(": {reason}"));
                return Err(format!(
                    "found {key:?}{reason}; allowed: \"stiffness\", \"amplitude\", \"phase\", and numbers of this scene that its \
                     motion depends on: {listed}; a number that the scene leaves to its default is among them once the scene \
                     gives it, as `form_drag = 1.1` in [drag]"
                ));
            }
            let before = numbers.len();
            numbers.extend(of_key.into_iter().filter(|number| number.own != 0.0));
            if numbers.len() == before {
                return Err(format!("found {key:?}, which is 0 in the scene; allowed: a number to begin with"));
            }
        }
        // The mass of a body may depend on the density.
        for number in numbers.iter_mut().filter(|number| number.key == DENSITY && self.neutral_buoyancy) {
            number.by = Parameter::OfScene(0);
        }
        scene_parameter::assign_indices(&mut numbers);
        Ok(numbers)
    }

    /// Checks the keys that concern numbers.
    fn check_numbers(&self) -> std::result::Result<(), (&'static str, String)> {
        if let Some(bounds) = &self.number_bounds {
            if self.numbers.is_empty() {
                let allowed = "only with keys of the scene, as \"medium.viscosity_pa_s\", in variables";
                return Err(("design.number_bounds", format!("found without any; allowed: {allowed}")));
            }
            let all: Vec<[f64; 2]> = match bounds {
                Bounds::All(bounds) => vec![*bounds],
                Bounds::Each(each) => each.values().copied().collect(),
            };
            if let Some([low, high]) =
                all.into_iter().find(|[low, high]| !(*low > 0.0 && high >= low && high.is_finite()))
            {
                let problem = format!("found [{low}, {high}]; allowed: [least, largest], both positive");
                return Err(("design.number_bounds", problem));
            }
            let has = |key: &String| self.numbers.iter().any(|number| number.key == *key);
            if let Bounds::Each(each) = bounds
                && let Some(key) = each.keys().find(|key| !has(key))
            {
                return Err(("design.number_bounds", format!("found {key:?}; allowed: keys that are in variables")));
            }
        }
        if self.numbers.is_empty() {
            return Ok(());
        }
        if self.goal == Goal::StaticShape {
            return Err((
                "design.variables",
                "\"static-shape\" finds stiffness alone; allowed: [\"stiffness\"]".into(),
            ));
        }
        for (key, given) in
            [("design.actuation_gain", self.actuation_gain), ("design.window_s", self.window_s.is_some())]
        {
            if given {
                let instead = "\"actuation.kappa_amp\" (or \"actuation.moment_amp_n_m\") in variables for the strength of the actuation";
                return Err((
                    key,
                    format!("found with numbers of the scene, which are found by simulation; allowed: {instead}"),
                ));
            }
        }
        Ok(())
    }

    /// Checks the variables of a search.
    fn check_variables(&self, scene: &Scene) -> std::result::Result<(), (&'static str, String)> {
        let has = |variable| self.variables.contains(&variable);
        let (amplitude, phase) = (has(DesignVariable::Amplitude), has(DesignVariable::Phase));
        let twice = (1..self.variables.len()).any(|i| self.variables[..i].contains(&self.variables[i]));
        if self.variables.is_empty() || twice {
            let allowed = "some of \"stiffness\", \"amplitude\", \"phase\" and numbers of the scene, each once";
            return Err(("design.variables", format!("allowed: {allowed}")));
        }
        if (amplitude || phase) && !self.goal.is_dynamic() {
            let allowed = "with \"track-tip\", \"distance\" and \"efficiency\"";
            return Err((
                "design.variables",
                format!("this goal finds stiffness alone; others are allowed: {allowed}"),
            ));
        }
        if self.actuation_gain && scene.has_active_moments() {
            let problem = "found where moments drive the rod; allowed: \"actuation.moment_amp_n_m\" in variables, found by simulation";
            return Err(("design.actuation_gain", problem.to_string()));
        }
        if scene.filters_drive() {
            let beside = "together with a drive with a limit or a lag; allowed: without actuation.lag_s, largest_1_m and largest_moment_n_m";
            if self.actuation_gain {
                return Err(("design.actuation_gain", format!("found {beside}")));
            }
            if amplitude || phase {
                return Err((
                    "design.variables",
                    format!("found amplitude or phase {beside}, or numbers of the scene"),
                ));
            }
        }
        if (amplitude || phase) && scene.actuation.is_none() {
            return Err(("design.variables", "amplitude and phase need a table [actuation]".to_string()));
        }
        let least = self.amplitude_bounds.map_or(0.0, |bounds| bounds[0]);
        for (key, mean, least) in
            [("design.mean", self.mean, self.bounds[0]), ("design.amplitude_mean", self.amplitude_mean, least)]
        {
            if let Some(mean) = mean.filter(|mean| self.goal.is_dynamic() && *mean < least) {
                return Err((key, format!("found {mean}; allowed: at least the lowest bound, {least}")));
            }
        }
        for (key, given, variable, name) in [
            ("design.amplitude_bounds", self.amplitude_bounds.is_some(), amplitude, "amplitude"),
            ("design.amplitude_mean", self.amplitude_mean.is_some(), amplitude, "amplitude"),
            ("design.phase_bounds_rad", self.phase_bounds_rad.is_some(), phase, "phase"),
        ] {
            if given && !variable {
                return Err((key, format!("found without \"{name}\" in variables; allowed: only with it")));
            }
        }
        if let Some([low, high]) =
            self.amplitude_bounds.filter(|[low, high]| !(*low > 0.0 && high >= low && high.is_finite()))
        {
            let problem = format!("found [{low}, {high}]; allowed: [least, largest], both positive");
            return Err(("design.amplitude_bounds", problem));
        }
        if let Some([low, high]) =
            self.phase_bounds_rad.filter(|[low, high]| !(high >= low && high - low < f64::INFINITY))
        {
            return Err(("design.phase_bounds_rad", format!("found [{low}, {high}]; allowed: [least, largest]")));
        }
        if let Some(mean) = self.amplitude_mean.filter(|mean| !(*mean > 0.0 && mean.is_finite())) {
            return Err(("design.amplitude_mean", format!("found {mean}; allowed: a positive number")));
        }
        Ok(())
    }
}

/// Describes a gain (%), or the factor above one that it corresponds to; `None` if it is negligible.
fn gain_in_words(percent: f64, factor: f64, than: &str) -> Option<String> {
    let what = if percent > 0.0 { "better" } else { "worse" };
    let words = if factor >= LEAST_FACTOR {
        format!("{what}{than} by a factor of {}", in_sentence(factor, 3))
    } else {
        format!("{} % {what}{than}", in_sentence(percent.abs(), 3))
    };
    (percent.abs() >= LEAST_GAIN_PERCENT).then_some(words)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gains_are_said_in_three_digits_and_large_ones_as_factors() {
        let words = |percent, factor| gain_in_words(percent, factor, " than the scene's own");
        assert_eq!(words(7.5159, 1.075).as_deref(), Some("7.52 % better than the scene's own"));
        assert_eq!(words(-39.04, 1.64).as_deref(), Some("39 % worse than the scene's own"));
        assert_eq!(words(1128.11, 12.2811).as_deref(), Some("better than the scene's own by a factor of 12.3"));
        assert_eq!(words(99.9996, 225_000.0).as_deref(), Some("better than the scene's own by a factor of 2.25·10⁵"));
        assert_eq!(words(1e-4, 1.000001), None);
    }
}
