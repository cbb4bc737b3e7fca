//! Report of many cases: figures of the effect of each axis, and a page with a table that can be sorted and filtered, and plays a
//! case.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use serde::Serialize;
use serde_json::{Map, Value};

use super::chart::{Chart, EffectAxis, Effects, Figure, Mark, Scale, Series};
use super::heat_map::{HeatMap, HeatMapAxis};
use super::page::{Animation, Figures, RawJson, render};
use super::rod_motion::RodMotion;
use crate::error::Result;
use crate::number_format::number;

/// Quantities in figures and page, in this order.
pub const QUANTITIES: [SummaryQuantity; 39] = [
    SummaryQuantity::new("net_displacement_m", "net displacement in x", "m", true).of_free_heads(),
    SummaryQuantity::new("cycle_thrust_n", "mean thrust over whole cycles", "N", true),
    SummaryQuantity::new("mean_thrust_n", "mean thrust of the whole run", "N", true).settled("cycle_thrust_n"),
    SummaryQuantity::new("cycle_head_moment_n_m", "mean moment on the head over whole cycles", "N m", true),
    SummaryQuantity::new("mean_head_moment_n_m", "mean moment on the head of the whole run", "N m", true)
        .settled("cycle_head_moment_n_m"),
    SummaryQuantity::new("max_head_force_n", "largest force on the head", "N", true),
    SummaryQuantity::new("max_head_moment_n_m", "largest moment on the head", "N m", true),
    SummaryQuantity::new("max_hinge_torque_n_m", "largest torque of the hinge's motor", "N m", true),
    SummaryQuantity::new("max_hinge_power_w", "largest power of the hinge's motor", "W", true),
    SummaryQuantity::new("max_head_power_w", "largest power of the head", "W", true),
    SummaryQuantity::new("max_joint_moment_n_m", "largest moment of a joint", "N m", true),
    SummaryQuantity::new("max_actuation_power_w", "largest power of the actuation", "W", true),
    SummaryQuantity::of_tendons("max_tendon_tension_n", "_tension_n", "largest tension of a tendon", "N"),
    SummaryQuantity::of_tendons("max_tendon_power_w", "_power_w", "largest power of a tendon", "W"),
    SummaryQuantity::of_tendons("max_tendon_speed_m_s", "_speed_m_s", "largest speed of a tendon", "m/s"),
    SummaryQuantity::of_tendons("max_tendon_travel_m", "_travel_m", "largest travel of a tendon", "m"),
    SummaryQuantity::new("max_lateral_excursion_m", "largest |y| of the centre of mass", "m", true).of_free_heads(),
    SummaryQuantity::new("cycle_forward_speed_m_s", "forward speed over whole cycles", "m/s", true).of_free_heads(),
    SummaryQuantity::new("cycle_body_lengths", "body lengths per cycle", "1", true).of_free_heads(),
    SummaryQuantity::new("cycle_slip", "slip over whole cycles", "1", true).of_free_heads(),
    SummaryQuantity::new("cycle_tip_excursion_m", "excursion of the tip over whole cycles", "m", true),
    SummaryQuantity::new("cycle_strouhal_number", "Strouhal number", "1", true),
    SummaryQuantity::new("cycle_hinge_amplitude_rad", "amplitude of the hinge over whole cycles", "rad", true),
    SummaryQuantity::new(
        "cycle_rms_tracking_error_rad",
        "rms tracking error of the hinge over whole cycles",
        "rad",
        true,
    ),
    SummaryQuantity::new(
        "cycle_rms_hinge_torque_n_m",
        "rms torque of the hinge's motor over whole cycles",
        "N m",
        true,
    ),
    SummaryQuantity::new("cycle_hinge_power_w", "power of the hinge's motor over whole cycles", "W", true),
    SummaryQuantity::new("cycle_actuation_power_w", "actuation power over whole cycles", "W", true),
    SummaryQuantity::new("cycle_head_power_w", "power of the head over whole cycles", "W", true),
    SummaryQuantity::new("cycle_cost_of_transport", "cost of transport over whole cycles", "1", true),
    SummaryQuantity::new("cycle_efficiency", "efficiency over whole cycles", "1", true),
    SummaryQuantity::new("mean_bending_energy_j", "mean bending energy of the whole run", "J", true),
    SummaryQuantity::new("mean_kinetic_energy_j", "mean kinetic energy of the whole run", "J", true),
    SummaryQuantity::new("actuation_work_j", "actuation work", "J", true),
    SummaryQuantity::new("viscous_work_j", "viscous work", "J", true),
    SummaryQuantity::new("cost_of_transport", "cost of transport of the whole run", "1", true)
        .settled("cycle_cost_of_transport"),
    SummaryQuantity::new("efficiency", "efficiency of the whole run", "1", true).settled("cycle_efficiency"),
    SummaryQuantity::new("numerical_dissipation_j", "numerical dissipation", "J", false),
    SummaryQuantity::new("newton_iterations", "Newton iterations", "1", false),
    SummaryQuantity::new("step_halvings", "step halvings", "1", false),
];

/// Maximum number of lines that join cases in a figure.
const MAX_JOINED_LINES: usize = 200;

/// Up to this many lines are named.
const MAX_NAMED_LINES: usize = 6;
/// Most dots of a figure.
const MAX_DOTS: usize = 2000;
/// Number of bins in which a sampled axis is averaged.
const SAMPLE_BINS: usize = 10;
/// Most rows of the page's table.
const MAX_TABLE_ROWS: usize = 20_000;
/// Most paths in a figure.
const MAX_PATHS: usize = 120;
/// Most cells of a heat map.
const MAX_CELLS: usize = 10_000;
/// A heat map has cells of equal width if the largest gap between two levels exceeds this multiple of the smallest, because the
/// narrowest cells would be slivers.
const MAX_CELL_RATIO: f64 = 4.0;
/// Levels from this multiple of the least on are drawn on a logarithmic axis if they are more even there.
const LOG_AXIS_RANGE: f64 = 4.0;
/// Levels whose gaps differ by less than this part are evenly spaced.
const EVEN_TOLERANCE: f64 = 0.01;
/// Up to this many levels at which values are missing are named.
const MAX_NAMED_LEVELS: usize = 4;

/// A quantity of a summary.
#[derive(Debug, Clone, Copy)]
pub struct SummaryQuantity {
    /// Its key in the summary; for a maximum over all tendons a separate name.
    pub key: &'static str,
    /// Its name.
    pub name: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// True if it has figures.
    pub drawn: bool,
    /// True if it is meaningless for a held head.
    pub of_free_heads: bool,
    /// The key of its mean over whole cycles.
    pub settled: Option<&'static str>,
    /// The suffix of the keys of the tendons over which it is the maximum.
    tendons: Option<&'static str>,
}

impl SummaryQuantity {
    const fn new(key: &'static str, name: &'static str, unit: &'static str, drawn: bool) -> Self {
        Self { key, name, unit, drawn, of_free_heads: false, settled: None, tendons: None }
    }

    const fn of_tendons(key: &'static str, end: &'static str, name: &'static str, unit: &'static str) -> Self {
        Self { tendons: Some(end), ..Self::new(key, name, unit, true) }
    }

    /// Its value in the `row` of a case.
    fn of(&self, row: &Map<String, Value>) -> Option<f64> {
        let Some(end) = self.tendons else { return row.get(self.key).and_then(Value::as_f64) };
        let own = row.iter().filter(|(key, _)| key.starts_with("max_tendon_") && key.ends_with(end));
        own.filter_map(|(_, value)| value.as_f64()).reduce(f64::max)
    }

    /// True for a mean over whole cycles.
    fn is_of_cycles(&self) -> bool {
        self.key.starts_with("cycle_")
    }

    const fn settled(self, key: &'static str) -> Self {
        Self { settled: Some(key), ..self }
    }

    /// Its name with its unit, if it has one.
    fn with_unit(&self) -> String {
        if self.unit == "1" { self.name.to_string() } else { format!("{} ({})", self.name, self.unit) }
    }

    const fn of_free_heads(self) -> Self {
        Self { of_free_heads: true, ..self }
    }
}

/// An axis along which the cases differ.
#[derive(Debug, Clone)]
pub struct CaseAxis {
    /// Its name.
    pub name: String,
    /// Labels of its levels.
    pub labels: Vec<String>,
    /// Its levels as numbers, if all are.
    pub numbers: Option<Vec<f64>>,
    /// True if each case has its own level.
    pub sampled: bool,
    /// True for a geometric sequence.
    pub logarithmic: bool,
}

impl CaseAxis {
    /// The position at which level `i` is drawn: its number, or its index.
    fn at(&self, i: usize) -> f64 {
        self.numbers.as_ref().map_or(i as f64, |numbers| numbers[i])
    }

    /// The scale: logarithmic for a geometric sequence, and for listed levels that are more even there; levels that are not numbers are
    /// categories.
    fn scale(&self) -> Scale {
        match &self.numbers {
            Some(numbers) if self.is_logarithmic(numbers) => Scale::LogX,
            Some(_) => Scale::Linear,
            None => Scale::Categories(self.labels.clone()),
        }
    }

    fn is_logarithmic(&self, numbers: &[f64]) -> bool {
        let [low, high] = [f64::min, f64::max].map(|of| numbers.iter().copied().reduce(of).unwrap_or(0.0));
        let more_even = || unevenness(numbers, f64::ln) < unevenness(numbers, |x| x);
        low > 0.0 && (self.logarithmic || !self.sampled && high >= LOG_AXIS_RANGE * low && more_even())
    }

    /// The axis of a heat map, with levels in `groups`: as on any chart, or of equally wide cells for levels that are unevenly spaced
    /// there.
    fn of_map(&self, groups: &Groups) -> HeatMapAxis {
        let (name, scale) = (self.name.clone(), self.scale());
        let onto: fn(f64) -> f64 = if scale == Scale::LogX { f64::ln } else { |x| x };
        if self.numbers.is_some() && unevenness(&groups.at, onto) > MAX_CELL_RATIO {
            let at = (0..groups.at.len()).map(|i| i as f64).collect();
            return HeatMapAxis { name, at, scale: Scale::Categories(groups.labels.clone()) };
        }
        HeatMapAxis { name, at: groups.at.clone(), scale }
    }

    /// Groups of levels that are averaged: each level, or the bins of a sample.
    fn groups(&self) -> Groups {
        let at: Vec<f64> = (0..self.labels.len()).map(|i| self.at(i)).collect();
        let mut order: Vec<usize> = (0..at.len()).collect();
        order.sort_by(|a, b| at[*a].total_cmp(&at[*b]));
        if !self.sampled {
            // In the order of their numbers, in whatever order they are listed.
            let mut of = vec![0; at.len()];
            order.iter().enumerate().for_each(|(rank, level)| of[*level] = rank);
            let (at, labels) = order.iter().map(|level| (at[*level], self.labels[*level].clone())).unzip();
            return Groups { of, at, labels };
        }
        let parts = SAMPLE_BINS.min(at.len());
        let mut group = vec![0; at.len()];
        // On a logarithmic axis the middle is the mean of the logarithms.
        let [onto, back]: [fn(f64) -> f64; 2] =
            if self.scale() == Scale::LogX { [f64::log10, |x| 10_f64.powf(x)] } else { [|x| x, |x| x] };
        let mut sums = vec![(0.0, 0.0); parts];
        for (rank, level) in order.into_iter().enumerate() {
            let part = rank * parts / at.len();
            group[level] = part;
            sums[part] = (sums[part].0 + onto(at[level]), sums[part].1 + 1.0);
        }
        let middles: Vec<f64> = sums.into_iter().map(|(sum, count)| back(sum / count)).collect();
        let text = |x: &f64| number(format!("{x:.1e}").parse().unwrap_or(*x));
        let labels = middles.iter().map(text).collect();
        Groups { of: group, at: middles, labels }
    }
}

/// The largest gap between `numbers` on a scale over the least; one for fewer than three.
fn unevenness(numbers: &[f64], onto: fn(f64) -> f64) -> f64 {
    let mut places: Vec<f64> = numbers.iter().map(|x| onto(*x)).collect();
    places.sort_by(f64::total_cmp);
    places.dedup();
    let gaps = || places.windows(2).map(|pair| pair[1] - pair[0]);
    gaps().reduce(f64::max).zip(gaps().reduce(f64::min)).map_or(1.0, |(largest, least)| largest / least)
}

/// Cases whose averages compare like with like: those of the combinations of the other axes that have a value at every level of one.
struct BalancedCases {
    cases: Vec<usize>,
    /// The number of these combinations, and that of all; none for a sampled axis, whose cases have no combinations in common.
    complete: usize,
    combinations: usize,
}

impl BalancedCases {
    fn is_whole(&self) -> bool {
        self.complete == self.combinations
    }
}

/// Groups of levels.
struct Groups {
    /// The group of each level.
    of: Vec<usize>,
    /// Position at which each group is drawn.
    at: Vec<f64>,
    /// Its name.
    labels: Vec<String>,
}

impl Groups {
    /// The mean of values in each group, given with their levels; NaN for an empty group.
    fn means(&self, values: impl Iterator<Item = (usize, f64)>) -> Vec<f64> {
        let mut sums = vec![(0.0, 0.0); self.at.len()];
        for (level, value) in values {
            let sum = &mut sums[self.of[level]];
            *sum = (sum.0 + value, sum.1 + 1.0);
        }
        sums.into_iter().map(|(sum, count)| sum / count).collect()
    }
}

/// The data of the report.
#[derive(Debug)]
pub struct Cases {
    name: String,
    text: String,
    axes: Vec<CaseAxis>,
    split: Option<usize>,
    size: usize,
    /// Indices of the complete cases whose cycles still differ by more than 1 %.
    unsettled: BTreeSet<usize>,
    /// Indices of the cases, and their levels on each axis.
    indices: Vec<usize>,
    levels: Vec<Vec<usize>>,
    /// One column for each of [`QUANTITIES`]; NaN for missing values.
    columns: Vec<Vec<f64>>,
    endings: BTreeMap<usize, String>,
    motions: BTreeMap<usize, RodMotion>,
    /// Times (s) with the x of the centre of mass (m) of whole runs.
    paths: BTreeMap<usize, Vec<[f64; 2]>>,
}

/// A case in the page's data.
#[derive(Serialize)]
struct PageContent<'a> {
    name: &'a str,
    version: &'static str,
    size: usize,
    done: usize,
    failed: usize,
    /// Complete cases whose cycles still differ.
    unsettled: usize,
    shown: usize,
    played: usize,
    /// Cases that failed without a motion.
    still: usize,
    text: &'a str,
    figures: Figures<'a>,
    /// Sentences on figures that are left out.
    left_out: &'a [String],
    data: RawJson<PageData<'a>>,
}

#[derive(Serialize)]
struct PageData<'a> {
    axes: Vec<(&'a str, &'a [String])>,
    quantities: Vec<(&'static str, &'static str)>,
    indices: Vec<usize>,
    levels: Vec<Vec<usize>>,
    columns: Vec<Vec<Option<f64>>>,
    endings: &'a BTreeMap<usize, String>,
    unsettled: &'a BTreeSet<usize>,
    motions: BTreeMap<usize, Animation>,
}

impl Cases {
    /// An empty report for a sweep of `size` cases along `axes`, whose file is `text`; the levels of `split` are shown separately.
    pub fn new(name: &str, axes: Vec<CaseAxis>, split: Option<usize>, size: usize, text: &str) -> Self {
        Self {
            name: name.to_string(),
            text: text.to_string(),
            levels: vec![Vec::new(); axes.len()],
            columns: vec![Vec::new(); QUANTITIES.len()],
            axes,
            split,
            size,
            unsettled: BTreeSet::new(),
            indices: Vec::new(),
            endings: BTreeMap::new(),
            motions: BTreeMap::new(),
            paths: BTreeMap::new(),
        }
    }

    /// Adds a case: its index, its level on each axis, its quantities, including `complete` and `ending`, and its recorded motion, if any.
    pub fn add(
        &mut self,
        index: usize,
        levels: &[usize],
        row: &Map<String, Value>,
        motion: Option<RodMotion>,
        path: Vec<[f64; 2]>,
    ) {
        self.indices.push(index);
        self.levels.iter_mut().zip(levels).for_each(|(column, level)| column.push(*level));
        let complete = row.get("complete") == Some(&Value::Bool(true));
        let held = row.get("mean_thrust_n").is_some_and(Value::is_number);
        for (column, quantity) in self.columns.iter_mut().zip(QUANTITIES) {
            let value = quantity.of(row);
            let shown = complete && !(held && quantity.of_free_heads);
            column.push(value.filter(|_| shown).unwrap_or(f64::NAN));
        }
        if !complete {
            let ending = row.get("ending").and_then(Value::as_str).unwrap_or_default();
            self.endings.insert(index, ending.to_string());
        }
        if complete && row.get("cycles_periodic") == Some(&Value::Bool(false)) {
            self.unsettled.insert(index);
        }
        if path.len() > 1 {
            self.paths.insert(index, path);
        }
        self.motions.extend(motion.filter(|motion| motion.frames.len() > 1).map(|motion| (index, motion)));
    }

    /// The levels that are shown separately, with the indices of their cases.
    fn parts(&self) -> Vec<(String, Vec<usize>)> {
        let all = 0..self.indices.len();
        match self.split {
            None => vec![(String::new(), all.collect())],
            Some(split) => {
                let axis = &self.axes[split];
                let of = |level: usize| all.clone().filter(|i| self.levels[split][*i] == level).collect();
                axis.labels.iter().enumerate().map(|(level, label)| (label.clone(), of(level))).collect()
            }
        }
    }

    /// The figures: heat maps for two axes, the effect of each axis on displacement or thrust, main effects on each quantity, paths
    /// of the centres of mass, and a comparison of the split's levels; and sentences on those that are left out.
    pub fn figures(&self) -> (Vec<Figure>, Vec<String>) {
        let (mut figures, mut names) = (Vec::new(), FileNames::default());
        let known = |column: &[f64]| column.iter().any(|x| x.is_finite());
        // If there is no mean over whole cycles, a mean that includes the start is drawn: their best cases may differ.
        let settled = |key: &str| QUANTITIES.iter().zip(&self.columns).any(|(q, column)| q.key == key && known(column));
        let shown = |quantity: &SummaryQuantity| quantity.drawn && !quantity.settled.is_some_and(settled);
        let drawn = || QUANTITIES.iter().zip(&self.columns).filter(|(quantity, _)| shown(quantity));
        // Quantities that are equal in all cases have no figure.
        let varies = |column: &[f64]| {
            let mut values = column.iter().filter(|x| x.is_finite());
            values.next().is_some_and(|first| values.any(|x| x != first))
        };
        let shown: Vec<usize> =
            (0..self.axes.len()).filter(|a| Some(*a) != self.split && self.axes[*a].labels.len() > 1).collect();
        let parts = self.parts();
        let of = |label: &str| if label.is_empty() { String::new() } else { format!(", {label}") };
        if let [across, up] = shown[..] {
            for (quantity, column) in drawn().filter(|(_, column)| varies(column)) {
                for (label, cases) in &parts {
                    let Some(map) = self.heat_map([across, up], quantity, column, label, cases) else { continue };
                    let [x, y] = [across, up].map(|axis| &self.axes[axis].name);
                    let without = || cases.iter().filter(|i| !column[**i].is_finite());
                    let failed = |i: &&usize| self.endings.contains_key(&self.indices[**i]);
                    let cross = if without().any(|i| failed(&i)) { " A cross is a case that failed." } else { "" };
                    let unsettled = if map.has_unsettled() {
                        " A stroke is a case that is not periodic yet; the largest and the least are among the others."
                    } else {
                        ""
                    };
                    let bar = if without().all(|i| failed(&i)) { "" } else { " A bar is a case that has none." };
                    let of_equal_cells = |(axis, drawn): (usize, &HeatMapAxis)| {
                        let equal = self.axes[axis].numbers.is_some() && matches!(drawn.scale, Scale::Categories(_));
                        equal.then_some(self.axes[axis].name.as_str())
                    };
                    let equal: Vec<_> =
                        [(across, &map.x), (up, &map.y)].into_iter().filter_map(of_equal_cells).collect();
                    let equal = match &equal[..] {
                        [] => String::new(),
                        names => format!(" Cells are equally wide along {}, whatever the levels.", names.join(" and ")),
                    };
                    let caption = format!(
                        "The {} of every case over {x} and {y}{}.{equal}{cross}{bar}{unsettled}",
                        quantity.name,
                        of(label)
                    );
                    figures.push(map.figure(names.file(&["map", quantity.key, label]), caption));
                }
            }
        }
        // The displacement and the speed, or the thrust if heads are held.
        let main = drawn().find(|(_, column)| known(column));
        let speed = drawn().find(|(quantity, column)| quantity.key == "cycle_forward_speed_m_s" && known(column));
        let first: Vec<_> = main.into_iter().chain(speed).collect();
        for (quantity, column) in &first {
            let stem = match quantity.key {
                "net_displacement_m" => "displacement",
                "cycle_forward_speed_m_s" => "speed",
                _ => "thrust",
            };
            for (label, cases) in &parts {
                for axis in &shown {
                    let (chart, lines) = self.against(*axis, quantity, column, label, cases);
                    let axis = &self.axes[*axis];
                    let missing = self.missing_in_words(column, cases);
                    let caption = format!(
                        "The {} of every case against {}{}.{lines}{missing}",
                        quantity.name,
                        axis.name,
                        of(label)
                    );
                    figures.extend(chart.figure(names.file(&[stem, &axis.name, label]), caption));
                }
            }
        }
        if let Some((quantity, column)) = main
            && let Some(chart) = self.compared(quantity, column)
        {
            let caption = format!("The {} of each case with every level of the split side by side.", quantity.name);
            figures.push(Figure::of_chart(names.file(&["compared"]), caption, &chart));
        }
        for (label, cases) in &parts {
            if let Some(chart) = self.paths(label, cases) {
                let caption = format!(
                    "How far the centres of mass come in x over time{}: of the cases that go least far and furthest, to either side, \
                     and of the one in the middle, others in grey.",
                    of(label)
                );
                figures.push(Figure::of_chart(names.file(&["paths", label]), caption, &chart));
            }
        }
        // Along a single axis the first quantities already have a figure.
        let is_drawn = |key: &str| {
            shown.len() == 1 && self.split.is_none() && first.iter().any(|(quantity, _)| quantity.key == key)
        };
        let mut without_effects = Vec::new();
        for (quantity, column) in drawn().filter(|(quantity, column)| varies(column) && !is_drawn(quantity.key)) {
            if let [axis] = shown[..] {
                // There is nothing to average over.
                let all: Vec<usize> = parts.iter().flat_map(|(_, cases)| cases.iter().copied()).collect();
                let missing = self.missing_in_words(column, &all);
                let caption = format!("The {} of every case over {}.{missing}", quantity.name, self.axes[axis].name);
                let file = names.file(&["effects", quantity.key]);
                figures.extend(self.over(axis, quantity, column, &parts).figure(file, caption));
            } else if let Some((effects, caption)) = self.effects(&shown, quantity, column, &parts) {
                figures.push(Figure::new(names.file(&["effects", quantity.key]), caption, effects.svg()));
            } else {
                without_effects.push(quantity.name);
            }
        }
        let left_out = (!without_effects.is_empty() && shown.len() > 1).then(|| {
            format!(
                "Main effects are left out for the {}: no combination of the other axes has a value at every level of an axis.",
                without_effects.join(", the ")
            )
        });
        (figures, left_out.into_iter().collect())
    }

    /// How many of `cases` failed or have no value, in a sentence; empty if all have one.
    fn missing_in_words(&self, column: &[f64], cases: &[usize]) -> String {
        let missing = cases.iter().copied().filter(|i| !column[*i].is_finite());
        let (failed, without): (Vec<_>, Vec<_>) = missing.partition(|i| self.endings.contains_key(&self.indices[*i]));
        let named = |some: &[usize]| match &self.axes[..] {
            [axis] if some.len() <= MAX_NAMED_LEVELS => {
                let levels: Vec<_> = some.iter().map(|i| axis.labels[self.levels[0][*i]].as_str()).collect();
                format!(" (at {})", levels.join(", "))
            }
            _ => String::new(),
        };
        let has = if without.len() == 1 { "has" } else { "have" };
        let parts: Vec<String> = [(failed, "failed"), (without, &format!("{has} no value"))]
            .into_iter()
            .filter(|(some, _)| !some.is_empty())
            .map(|(some, what)| format!("{} {what}{}", some.len(), named(&some)))
            .collect();
        match &parts[..] {
            [] => String::new(),
            parts => format!(
                " Of {} cases, {}; strokes on the axis are at their levels, as far as it reaches.",
                cases.len(),
                parts.join(" and ")
            ),
        }
    }

    /// Strokes at the levels of `cases` without a value; `None` if all have one.
    fn missing(&self, axis: usize, column: &[f64], cases: impl Iterator<Item = usize>) -> Option<Series> {
        let levels: BTreeSet<usize> = cases.filter(|i| !column[*i].is_finite()).map(|i| self.levels[axis][i]).collect();
        let points = levels.into_iter().take(MAX_DOTS).map(|level| (self.axes[axis].at(level), f64::NAN)).collect();
        Some(Series::new("", points, Mark::Missing)).filter(|series| !series.points.is_empty())
    }

    /// The cases of `cases` to average over at each level of an axis.
    fn balanced(&self, axis: usize, groups: &Groups, column: &[f64], cases: &[usize]) -> BalancedCases {
        let known = |i: &usize| column[*i].is_finite();
        if self.axes[axis].sampled {
            return BalancedCases {
                cases: cases.iter().copied().filter(known).collect(),
                complete: 0,
                combinations: 0,
            };
        }
        let mut found: BTreeMap<Vec<usize>, (BTreeSet<usize>, Vec<usize>)> = BTreeMap::new();
        for i in cases {
            let others = (0..self.axes.len()).filter(|a| *a != axis).map(|a| self.levels[a][*i]).collect();
            let (levels, own) = found.entry(others).or_default();
            if known(i) {
                levels.insert(groups.of[self.levels[axis][*i]]);
                own.push(*i);
            }
        }
        let combinations = found.len();
        found.retain(|_, (levels, _)| levels.len() == groups.at.len());
        let complete = found.len();
        let mut cases: Vec<usize> = found.into_values().flat_map(|(_, own)| own).collect();
        cases.sort_unstable(); // sums in the order of the cases
        BalancedCases { cases, complete, combinations }
    }

    fn titled(&self, what: &str, label: &str) -> String {
        if label.is_empty() { format!("{}: {what}", self.name) } else { format!("{}, {label}: {what}", self.name) }
    }

    /// A quantity over two axes; `None` for sampled axes, whose cases are not a grid, and for too many cells.
    fn heat_map(
        &self,
        axes: [usize; 2],
        quantity: &SummaryQuantity,
        column: &[f64],
        label: &str,
        cases: &[usize],
    ) -> Option<HeatMap> {
        let of = axes.map(|axis| &self.axes[axis]);
        if of.iter().any(|axis| axis.sampled) || of.iter().map(|axis| axis.labels.len()).product::<usize>() > MAX_CELLS
        {
            return None;
        }
        let [across, up] = of.map(CaseAxis::groups);
        let cell = |i: &usize| {
            let [x, y] = axes.map(|axis| self.levels[axis][*i]);
            (across.of[x], up.of[y], column[*i], self.indices[*i])
        };
        let cells = cases.iter().map(cell).collect();
        Some(HeatMap {
            title: self.titled(quantity.name, label),
            x: of[0].of_map(&across),
            y: of[1].of_map(&up),
            value: quantity.with_unit(),
            cells,
            failed: self.endings.keys().copied().collect(),
            unsettled: if quantity.is_of_cycles() { self.unsettled.clone() } else { BTreeSet::new() },
        })
    }

    /// A quantity over the only axis, a line for each level of the split.
    fn over(&self, axis: usize, quantity: &SummaryQuantity, column: &[f64], parts: &[(String, Vec<usize>)]) -> Chart {
        let of = &self.axes[axis];
        let series = parts.iter().map(|(label, cases)| {
            let known = cases.iter().filter(|i| column[**i].is_finite());
            let mut points: Vec<_> = known.map(|i| (of.at(self.levels[axis][*i]), column[*i])).collect();
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            let points = points.into_iter().step_by(cases.len().div_ceil(MAX_DOTS).max(1)).collect();
            Series::new(label.clone(), points, if of.sampled { Mark::Dots } else { Mark::Dotted })
        });
        Chart {
            title: self.titled(quantity.name, ""),
            x: of.name.clone(),
            y: quantity.with_unit(),
            scale: of.scale(),
            series: series.chain(self.missing(axis, column, 0..self.indices.len())).collect(),
        }
    }

    /// A quantity against one axis: lines join cases that differ in nothing else. A few lines, of one other axis, are named by its
    /// levels; of more there is a line of means. With what a caption says of the lines.
    fn against(
        &self,
        axis: usize,
        quantity: &SummaryQuantity,
        column: &[f64],
        label: &str,
        cases: &[usize],
    ) -> (Chart, String) {
        let of = &self.axes[axis];
        let point = |i: usize| (of.at(self.levels[axis][i]), column[i]);
        let missing = self.missing(axis, column, cases.iter().copied());
        let groups = of.groups();
        let balanced = self.balanced(axis, &groups, column, cases);
        let cases = || cases.iter().copied().filter(|i| column[*i].is_finite());
        let mut joined: HashMap<Vec<usize>, Vec<(f64, f64)>> = HashMap::new();
        let others = |i: usize| (0..self.axes.len()).filter(|a| *a != axis).map(|a| self.levels[a][i]).collect();
        let mut order: Vec<Vec<usize>> = Vec::new();
        if !of.sampled {
            for i in cases() {
                let key: Vec<usize> = others(i);
                joined
                    .entry(key.clone())
                    .or_insert_with(|| {
                        order.push(key);
                        Vec::new()
                    })
                    .push(point(i));
            }
        }
        joined.values_mut().for_each(|line| line.sort_by(|a, b| a.0.total_cmp(&b.0)));
        let chart = |series: Vec<Series>| Chart {
            title: self.titled(&format!("{} against {}", quantity.name, of.name), label),
            x: of.name.clone(),
            y: quantity.with_unit(),
            scale: of.scale(),
            series: series.into_iter().chain(missing.clone()).collect(),
        };
        let bars = matches!(of.scale(), Scale::Categories(_));
        let varied: Vec<usize> = (0..self.axes.len())
            .filter(|a| *a != axis)
            .enumerate()
            .filter(|(place, _)| order.iter().any(|key| key[*place] != order[0][*place]))
            .map(|(place, _)| place)
            .collect();
        if let [place] = varied[..]
            && order.len() <= MAX_NAMED_LINES
        {
            let other = &self.axes[place + usize::from(place >= axis)];
            let name = last_key(&other.name);
            let named = |key: &Vec<usize>| {
                Series::new(format!("{name} {}", other.labels[key[place]]), joined[key].clone(), Mark::Dotted)
            };
            let what = if bars { "bar" } else { "line" };
            let says = format!(" One {what} for each level of {}.", other.name);
            return (chart(order.iter().map(named).collect()), says);
        }
        if let [only] = &order[..] {
            let says = if bars { "" } else { " The line joins them." };
            return (chart(vec![Series::new("cases", joined[only].clone(), Mark::Dotted)]), says.to_string());
        }
        let stride = order.len().div_ceil(MAX_JOINED_LINES).max(1);
        let lines = order.iter().step_by(stride).map(|key| joined[key].clone()).filter(|line| line.len() > 1);
        let mut series: Vec<_> = lines.map(|line| Series::new("", line, Mark::Ghost)).collect();
        let says = match (bars, of.sampled, series.is_empty()) {
            (true, ..) => " Bars are means.",
            (_, true, _) => " The line joins means over equal parts of the sample.",
            (.., true) => " The line joins means.",
            _ => " Grey lines join cases that differ in nothing else, the other line joins means.",
        };
        let stride = cases().count().div_ceil(MAX_DOTS).max(1);
        series.push(Series::new("cases", cases().step_by(stride).map(point).collect(), Mark::Dots));
        if balanced.cases.is_empty() {
            let lines =
                if bars || series.len() < 2 { "" } else { " Grey lines join cases that differ in nothing else." };
            let says = "There are no means, since no combination of the other axes has a value at every level.";
            return (chart(series), format!("{lines} {says}"));
        }
        let means = groups.means(balanced.cases.iter().map(|i| (self.levels[axis][*i], column[*i])));
        series.push(Series::new("mean", groups.at.into_iter().zip(means).collect(), Mark::Dotted));
        let over = if balanced.is_whole() {
            String::new()
        } else {
            format!(
                " Means are over the {} of {} combinations of the other axes that have a value at every level.",
                balanced.complete, balanced.combinations
            )
        };
        (chart(series), format!("{says}{over}"))
    }

    /// Main effects of the axes on a quantity, and their caption: means at each level over the combinations of the other axes that have
    /// a value at every level, relative to their mean if signs allow. Axes without such a combination are left out; `None` if all are.
    fn effects(
        &self,
        shown: &[usize],
        quantity: &SummaryQuantity,
        column: &[f64],
        parts: &[(String, Vec<usize>)],
    ) -> Option<(Effects, String)> {
        let values = || column.iter().filter(|x| x.is_finite());
        let relative = values().all(|x| *x > 0.0) || values().all(|x| *x < 0.0);
        struct EffectPanel {
            axis: usize,
            groups: Groups,
            parts: Vec<BalancedCases>,
        }
        let panel = |axis: &usize| {
            let groups = self.axes[*axis].groups();
            let parts = parts.iter().map(|(_, cases)| self.balanced(*axis, &groups, column, cases)).collect();
            EffectPanel { axis: *axis, groups, parts }
        };
        let (panels, empty): (Vec<_>, Vec<_>) =
            shown.iter().map(panel).partition(|panel| panel.parts.iter().any(|part| !part.cases.is_empty()));
        if panels.is_empty() {
            return None;
        }
        let series = parts.iter().enumerate().map(|(k, (label, _))| {
            let of = |EffectPanel { axis, groups, parts }: &EffectPanel| {
                let cases = &parts[k].cases;
                let mean = cases.iter().map(|i| column[*i]).sum::<f64>() / cases.len() as f64;
                let scale = if relative { mean } else { 1.0 };
                groups.means(cases.iter().map(|i| (self.levels[*axis][*i], column[*i] / scale)))
            };
            (label.clone(), panels.iter().map(of).collect())
        });
        let name = |panel: &EffectPanel| self.axes[panel.axis].name.as_str();
        let is_whole = panels.iter().flat_map(|panel| &panel.parts).all(BalancedCases::is_whole);
        let mut caption = format!("The {} at each level of an axis, averaged over ", quantity.name);
        if is_whole && empty.is_empty() {
            caption += "all other axes.";
        } else {
            let count = |panel: &EffectPanel| {
                let sum = |of: fn(&BalancedCases) -> usize| panel.parts.iter().map(of).sum::<usize>();
                let (complete, all) = (sum(|part| part.complete), sum(|part| part.combinations));
                (all > 0).then(|| format!("{complete} of {all} for {}", name(panel)))
            };
            let counts: Vec<_> = panels.iter().filter_map(count).collect();
            caption += "the combinations of the other axes that have a value at every level of it";
            caption += &if counts.is_empty() { ".".to_string() } else { format!(": {}.", counts.join(", ")) };
            if !empty.is_empty() {
                let names: Vec<_> = empty.iter().map(name).collect();
                caption += &format!(" {} is left out: it has no such combination.", names.join(", "));
            }
        }
        let uneven = |panel: &EffectPanel| {
            let axis = &self.axes[panel.axis];
            axis.numbers.is_some() && !axis.sampled && unevenness(&panel.groups.at, |x| x) > 1.0 + EVEN_TOLERANCE
        };
        if panels.iter().any(uneven) {
            caption += " Levels are drawn equally far apart, whatever their values.";
        }
        let axis = |EffectPanel { axis, groups, .. }: &EffectPanel| {
            let CaseAxis { name, numbers, .. } = &self.axes[*axis];
            EffectAxis { name: name.clone(), labels: groups.labels.clone(), joined: numbers.is_some() }
        };
        let effects = Effects {
            title: self.titled(&format!("main effects on the {}", quantity.name), ""),
            y: if relative { format!("{}, relative to the mean", quantity.name) } else { quantity.with_unit() },
            axes: panels.iter().map(axis).collect(),
            series: series.collect(),
        };
        Some((effects, caption))
    }

    /// The cases of each level of the split side by side, sorted by the first level's values.
    fn compared(&self, quantity: &SummaryQuantity, column: &[f64]) -> Option<Chart> {
        let split = self.split?;
        let others = |i: usize| -> Vec<usize> {
            (0..self.axes.len()).filter(|a| *a != split).map(|a| self.levels[a][i]).collect()
        };
        let parts = self.parts();
        let mut first: Vec<usize> = parts.first()?.1.iter().copied().filter(|i| column[*i].is_finite()).collect();
        first.sort_by(|a, b| column[*a].abs().total_cmp(&column[*b].abs()));
        let rank: HashMap<Vec<usize>, usize> = first.iter().enumerate().map(|(rank, i)| (others(*i), rank)).collect();
        let series = parts.iter().map(|(label, cases)| {
            let place =
                |i: &usize| Some((*rank.get(&others(*i))? as f64, column[*i])).filter(|point| point.1.is_finite());
            let stride = cases.len().div_ceil(MAX_DOTS).max(1);
            Series::new(label.clone(), cases.iter().step_by(stride).filter_map(place).collect(), Mark::Dots)
        });
        let size = |of: fn(f64, f64) -> f64, start| column.iter().map(|x| x.abs()).filter(|x| *x > 0.0).fold(start, of);
        let decades =
            (size(f64::max, 0.0).log10().ceil() - size(f64::min, f64::INFINITY).log10().floor()).clamp(1.0, 12.0);
        Some(Chart {
            title: self.titled(&format!("{}, levels of {} compared", quantity.name, self.axes[split].name), ""),
            x: format!("case, in the order of its {} ({})", quantity.name, parts[0].0),
            y: quantity.with_unit(),
            scale: Scale::SignedLogY(decades as i32),
            series: series.collect(),
        })
    }

    /// The x of the centres of mass over time; the least, median and largest displacement are highlighted.
    fn paths(&self, label: &str, cases: &[usize]) -> Option<Chart> {
        // Cases that failed or have a held head are left out.
        let way = QUANTITIES.iter().position(|quantity| quantity.key == "net_displacement_m")?;
        let complete = cases.iter().filter(|i| self.columns[way][**i].is_finite());
        let mut moved: Vec<(usize, &Vec<[f64; 2]>)> =
            complete.filter_map(|i| Some((*i, self.paths.get(&self.indices[*i])?))).collect();
        let far = |path: &[[f64; 2]]| path[path.len() - 1][1] - path[0][1];
        moved.sort_by(|a, b| far(a.1).abs().total_cmp(&far(b.1).abs()));
        let path = |path: &[[f64; 2]]| path.iter().map(|[time, x]| (*time, x - path[0][1])).collect();
        let stride = moved.len().div_ceil(MAX_PATHS).max(1);
        let mut series: Vec<_> =
            moved.iter().step_by(stride).map(|(_, own)| Series::new("", path(own), Mark::Ghost)).collect();
        let last = moved.len().checked_sub(1)?;
        for (what, at) in [("least far", 0), ("middle", last / 2), ("furthest", last)] {
            let (i, own) = moved[at];
            series.push(Series::new(format!("{what}: case {}", self.indices[i]), path(own), Mark::Line));
        }
        Some(Chart {
            title: self.titled("paths of the centres of mass", label),
            x: "time (s)".to_string(),
            y: "x displacement of the centre of mass (m)".to_string(),
            scale: Scale::Linear,
            series,
        })
    }

    /// How many cases are not periodic yet.
    pub fn unsettled(&self) -> usize {
        self.unsettled.len()
    }

    /// Endings of the cases that did not reach their end.
    pub fn into_endings(self) -> BTreeMap<usize, String> {
        self.endings
    }

    /// report.html: one self-contained page.
    ///
    /// # Errors
    /// [`Error::Page`](crate::Error::Page).
    pub fn page(&self, figures: &[Figure], left_out: &[String]) -> Result<String> {
        let stride = self.indices.len().div_ceil(MAX_TABLE_ROWS).max(1);
        // Six digits are plenty to look at; the table has them all.
        let short = |x: &f64| format!("{x:.5e}").parse().ok().filter(|x: &f64| x.is_finite());
        let shown: Vec<usize> = self.indices.iter().step_by(stride).copied().collect();
        let quantities: Vec<usize> =
            (0..QUANTITIES.len()).filter(|k| self.columns[*k].iter().any(|x| x.is_finite() && *x != 0.0)).collect();
        let still = self.endings.keys().filter(|index| !self.motions.contains_key(index)).count();
        let content = PageContent {
            name: &self.name,
            version: env!("CARGO_PKG_VERSION"),
            size: self.size,
            done: self.indices.len(),
            failed: self.endings.len(),
            unsettled: self.unsettled.len(),
            shown: shown.len(),
            played: self.motions.len(),
            still,
            text: &self.text,
            figures: Figures::of(figures).playing(!self.motions.is_empty()),
            left_out,
            data: RawJson(PageData {
                axes: self.axes.iter().map(|axis| (axis.name.as_str(), axis.labels.as_slice())).collect(),
                quantities: quantities.iter().map(|k| (QUANTITIES[*k].name, QUANTITIES[*k].unit)).collect(),
                indices: shown,
                levels: self.levels.iter().map(|column| column.iter().step_by(stride).copied().collect()).collect(),
                columns: quantities
                    .iter()
                    .map(|k| self.columns[*k].iter().step_by(stride).map(short).collect())
                    .collect(),
                endings: &self.endings,
                unsettled: &self.unsettled,
                motions: self.motions.iter().map(|(index, motion)| (*index, Animation::of(motion))).collect(),
            }),
        };
        render(include_str!("cases.html"), &content)
    }
}

/// Unique file names.
#[derive(Debug, Default)]
struct FileNames(Vec<String>);

/// Most letters of each part of a file name.
const MAX_NAME_LENGTH: usize = 40;

impl FileNames {
    /// The name of a figure's file: letters, digits and a few other characters of its parts, with a number if it is taken.
    fn file(&mut self, parts: &[&str]) -> String {
        let sign = |c: char| if c.is_ascii_alphanumeric() || c == '.' { c } else { '-' };
        let clean = |part: &&str| part.chars().take(MAX_NAME_LENGTH).map(sign).collect::<String>();
        let parts: Vec<String> = parts.iter().filter(|part| !part.is_empty()).map(clean).collect();
        let stem = parts.join("_");
        // Some file systems do not distinguish upper and lower case.
        let taken = |name: &String| self.0.iter().any(|other| other.eq_ignore_ascii_case(name));
        let numbered = (2..).map(|number| format!("{stem}_{number}.svg"));
        let name = std::iter::once(format!("{stem}.svg")).chain(numbered).find(|name| !taken(name)).unwrap_or_default();
        self.0.push(name.clone());
        name
    }
}

/// The last key of a path of keys, with the number of an entry.
fn last_key(path: &str) -> &str {
    let begin = |end: usize| path[..end].rfind('.').map_or(0, |dot| dot + 1);
    let last = begin(path.len());
    let is_entry = last > 0 && path[last..].bytes().all(|digit| digit.is_ascii_digit());
    &path[if is_entry { begin(last - 1) } else { last }..]
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failure ends the test")]
    use serde_json::json;

    use super::super::rod_motion::DrawnRod;
    use super::*;
    use crate::report::Frame;

    fn axis(name: &str, numbers: &[f64]) -> CaseAxis {
        let labels = numbers.iter().map(f64::to_string).collect();
        CaseAxis { name: name.to_string(), labels, numbers: Some(numbers.to_vec()), sampled: false, logarithmic: false }
    }

    fn motion(way: f64) -> Option<RodMotion> {
        let frame =
            |time: f64| Frame { time, points: vec![[0.0; 2]; 3], com: [way * time, 0.0], medium: None, loads: None };
        Some(RodMotion::whole(DrawnRod::at(None, vec![0, 1, 2]), vec![frame(0.0), frame(1.0)]))
    }

    /// A sweep along one axis, whose last case fails before it moves.
    fn one_axis() -> Cases {
        let mut cases = Cases::new("sweep", vec![axis("rod.length_m", &[1.0, 2.0, 4e6])], None, 3, "");
        for (i, way) in [(0, -0.002), (1, -1.4)] {
            let row =
                json!({ "complete": true, "net_displacement_m": way, "cycle_strouhal_number": way, "efficiency": 0.0 });
            cases.add(i, &[i], row.as_object().unwrap(), motion(way), vec![[0.0, 0.0], [1.0, way]]);
        }
        cases.add(
            2,
            &[2],
            json!({ "complete": false, "ending": "no convergence" }).as_object().unwrap(),
            None,
            Vec::new(),
        );
        cases
    }

    fn captions(cases: &Cases) -> Vec<(String, String)> {
        cases.figures().0.into_iter().map(|figure| (figure.file, figure.caption)).collect()
    }

    #[test]
    fn a_line_is_named_by_its_last_key_and_the_number_of_its_entry() {
        for (path, name) in
            [("medium.flow_m_s.0", "flow_m_s.0"), ("rod.nodes", "nodes"), ("nodes", "nodes"), ("0", "0")]
        {
            assert_eq!(last_key(path), name, "{path}");
        }
    }

    #[test]
    fn captions_speak_of_the_lines_that_are_there() {
        let all = captions(&one_axis());
        let of = |file: &str| &all.iter().find(|(name, _)| name == file).unwrap().1;
        let failed =
            "Of 3 cases, 1 failed (at 4000000); strokes on the axis are at their levels, as far as it reaches.";
        let joined = format!("against rod.length_m. The line joins them. {failed}");
        assert!(of("displacement_rod.length-m.svg").ends_with(&joined), "{all:?}");
        let over = format!("The Strouhal number of every case over rod.length_m. {failed}");
        assert_eq!(*of("effects_cycle-strouhal-number.svg"), over);
        assert!(!all.iter().any(|(_, caption)| caption.contains("mean") || caption.contains("averaged")), "{all:?}");
    }

    #[test]
    fn a_case_that_failed_stretches_no_axis() {
        let figure = one_axis().figures().0.into_iter().find(|figure| figure.file.starts_with("displacement")).unwrap();
        assert!(!figure.svg.contains("10⁶") && figure.svg.contains(">1.4<"), "{}", figure.svg);
    }

    #[test]
    fn the_page_counts_one_case_as_one_and_says_why_one_is_not_played() {
        let cases = one_axis();
        let page = cases.page(&[], &[]).unwrap();
        assert!(page.contains("One case did not reach its end. Its row gives the reason"), "{page}");
        assert!(!page.contains("by chance") && page.contains("A case that failed before it moved cannot be played."));
        // A quantity that is zero in all cases has no column.
        assert!(page.contains("Strouhal number") && !page.contains("\"efficiency of the whole run\""));
    }

    #[test]
    fn the_cost_of_transport_of_whole_cycles_is_drawn_instead_of_that_of_the_whole_run_and_what_is_not_periodic_is_marked()
     {
        let axes = vec![axis("a", &[1.0, 2.0]), axis("b", &[1.0, 2.0])];
        let of = |cycles: bool| {
            let mut cases = Cases::new("sweep", axes.clone(), None, 4, "");
            for i in 0..4 {
                let cost = 0.1 + i as f64;
                let row = json!({ "complete": true, "cost_of_transport": 2.0 * cost, "cycles_periodic": i != 3,
                    "cycle_cost_of_transport": cycles.then_some(cost) });
                cases.add(i, &[i % 2, i / 2], row.as_object().unwrap(), None, Vec::new());
            }
            cases
        };
        let map = |cases: &Cases, file: &str| cases.figures().0.into_iter().find(|figure| figure.file == file);
        let [with, without] = [true, false].map(of);
        let drawn = map(&with, "map_cycle-cost-of-transport.svg").unwrap();
        assert!(drawn.svg.contains("largest: 2.100 (case 2)"), "{}", drawn.svg);
        assert!(drawn.caption.contains("A stroke is a case that is not periodic yet"), "{}", drawn.caption);
        assert!(map(&with, "map_cost-of-transport.svg").is_none());
        let whole = map(&without, "map_cost-of-transport.svg").unwrap();
        assert!(whole.svg.contains("case 3") && !whole.caption.contains("periodic"), "{}", whole.caption);
        assert!(with.page(&[], &[]).unwrap().contains("\"unsettled\":[3]"));
    }

    #[test]
    fn a_map_and_the_paths_name_cases_by_size_and_what_has_no_value_is_told_from_what_failed() {
        let axes = vec![axis("a", &[1.0, 2.0]), axis("b", &[1.0, 2.0])];
        let mut cases = Cases::new("sweep", axes, None, 4, "");
        for (i, way) in [-0.0026, -1.394, -0.5].into_iter().enumerate() {
            let strouhal = (i != 1).then_some(0.1 + way);
            let row = json!({ "complete": true, "net_displacement_m": way, "cycle_strouhal_number": strouhal });
            cases.add(i, &[i % 2, i / 2], row.as_object().unwrap(), motion(way), vec![[0.0, 0.0], [1.0, way]]);
        }
        cases.add(3, &[1, 1], json!({ "complete": false }).as_object().unwrap(), None, Vec::new());
        let (figures, _) = cases.figures();
        let of = |file: &str| figures.iter().find(|figure| figure.file == file).unwrap();
        let map = of("map_net-displacement-m.svg");
        assert!(map.svg.contains("largest in size: -1.394 (case 1)"), "{}", map.svg);
        assert!(of("paths.svg").svg.contains("furthest: case 1"));
        assert!(map.caption.ends_with(" A cross is a case that failed."), "{}", map.caption);
        let caption = &of("map_cycle-strouhal-number.svg").caption;
        assert!(caption.ends_with(" A cross is a case that failed. A bar is a case that has none."), "{caption}");
    }

    #[test]
    fn heads_that_are_held_have_no_paths_and_tendons_their_largest_pull() {
        let mut cases = Cases::new("sweep", vec![axis("a", &[1.0, 2.0])], None, 2, "");
        for i in 0..2 {
            let row = json!({
                "complete": true, "mean_thrust_n": 1.0, "net_displacement_m": 0.5, "cycle_head_moment_n_m": 0.1, "mean_head_moment_n_m": 0.3,
                "max_tendon_1_tension_n": 2.0, "max_tendon_2_tension_n": 3.0 + i as f64,
            });
            cases.add(i, &[i], row.as_object().unwrap(), motion(0.5), vec![[0.0, 0.0], [1.0, 0.5]]);
        }
        let all = captions(&cases);
        assert!(all.iter().any(|(file, _)| file == "effects_max-tendon-tension-n.svg"), "{all:?}");
        assert!(!all.iter().any(|(file, _)| file.starts_with("paths")), "{all:?}");
        let tension = QUANTITIES.iter().position(|quantity| quantity.key == "max_tendon_tension_n").unwrap();
        assert_eq!(cases.columns[tension], [3.0, 4.0]);
    }

    /// A sweep over two axes whose case has this way for each pair of levels; cases without one failed.
    fn two_axes(axes: [(&str, &[f64]); 2], way: impl Fn(usize, usize) -> Option<f64>) -> Cases {
        let counts = axes.map(|(_, levels)| levels.len());
        let axes = axes.map(|(name, levels)| axis(name, levels)).to_vec();
        let mut cases = Cases::new("sweep", axes, None, counts[0] * counts[1], "");
        for i in 0..counts[0] * counts[1] {
            let (a, b) = (i / counts[1], i % counts[1]);
            let row = json!({ "complete": way(a, b).is_some(), "net_displacement_m": way(a, b) });
            cases.add(i, &[a, b], row.as_object().unwrap(), None, Vec::new());
        }
        cases
    }

    #[test]
    fn main_effects_compare_like_with_like_where_cases_failed() {
        // Twice as far at the higher frequency, whatever the amplitude; the largest amplitude bears the lower one alone.
        let way = |a: usize, b: usize| (a < 2 || b == 0).then(|| [1.0, 2.0, 1000.0][a] * [1.0, 2.0][b]);
        let cases = two_axes([("a", &[1.0, 2.0, 3.0]), ("b", &[1.0, 2.0])], way);
        let column = &cases.columns[0];
        let (effects, caption) = cases.effects(&[0, 1], &QUANTITIES[0], column, &cases.parts()).unwrap();
        let (a, b) = (&effects.series[0].1[0], &effects.series[0].1[1]);
        assert!((b[1] / b[0] - 2.0).abs() < 1e-12, "{b:?}");
        assert!((a[1] / a[0] - 2.0).abs() < 1e-12 && (a[2] / a[0] - 1000.0).abs() < 1e-9, "{a:?}");
        assert!(caption.contains("1 of 2 for a, 2 of 3 for b"), "{caption}");
        let (figures, _) = cases.figures();
        let line = &figures.iter().find(|figure| figure.file == "displacement_b.svg").unwrap().caption;
        assert!(!line.contains("means") && line.contains("1 failed"), "few lines are named: {line}");
    }

    #[test]
    fn main_effects_without_a_whole_combination_are_left_out_with_a_word() {
        let cases = two_axes([("a", &[1.0, 2.0]), ("b", &[1.0, 2.0])], |a, b| (a == b).then_some(1.0 + a as f64));
        let (figures, left_out) = cases.figures();
        assert!(!figures.iter().any(|figure| figure.file.starts_with("effects")));
        assert!(left_out[0].contains("left out for the net displacement in x"), "{left_out:?}");
        let page = cases.page(&figures, &left_out).unwrap();
        assert!(page.contains(&left_out[0]), "{page}");
    }

    #[test]
    fn levels_that_are_even_in_logarithms_are_drawn_so_and_others_as_equal_cells() {
        let scale = |levels: &[f64]| axis("a", levels).scale();
        assert_eq!(scale(&[1e4, 1e5, 1e6, 1e7]), Scale::LogX);
        assert_eq!(scale(&[0.5, 1.0, 2.0]), Scale::LogX);
        assert_eq!(scale(&[1.0, 2.0, 3.0]), Scale::Linear);
        assert_eq!(scale(&[0.0, 1.0, 10.0]), Scale::Linear);
        let uneven = axis("a", &[1.0, 12.0, 3000.0, 20.0, 25.0]);
        let map = uneven.of_map(&uneven.groups());
        assert_eq!(map.scale, Scale::Categories(["1", "12", "20", "25", "3000"].map(str::to_string).to_vec()));
        let even = axis("a", &[1.0, 2.0, 4.0]);
        assert_eq!(even.of_map(&even.groups()).scale, Scale::LogX);
        let cases = two_axes([("a", &[1.0, 12.0, 3000.0]), ("b", &[1.0, 2.0])], |a, b| Some((a + b) as f64));
        let figures = cases.figures().0;
        let caption = &figures.iter().find(|figure| figure.file.starts_with("map")).unwrap().caption;
        assert!(!caption.contains("equally wide"), "on a logarithmic axis they are even: {caption}");
    }

    #[test]
    fn a_printed_table_is_whole() {
        let page = one_axis().page(&[], &[]).unwrap();
        assert!(page.contains("@media screen { td { white-space: nowrap; } }"), "{page}");
    }
}
