//! Tracked markers: positions of nodes at measured times, outliers, and smoothing by local polynomials (Savitzky-Golay).

use std::path::Path;

use nalgebra::DMatrix;

use crate::error::{Error, Result};
use crate::number_format::number;
use crate::rod::Rod;
use crate::sensitivity::Trajectory;

/// Least number of samples of a motion.
pub const MIN_SAMPLES: usize = 2 * DEGREE + 1;

/// Degree of the local polynomials: velocities and accelerations of a sixth-degree motion are exact.
const DEGREE: usize = 6;

/// A window is too long if its residual exceeds that of shorter windows by more than this factor.
const MAX_RESIDUAL_GROWTH: f64 = 1.03;

/// Samples with a residual above this multiple of the median are left out.
const MAX_RESIDUAL: f64 = 4.0;

/// A marker is an outlier if its distance from its path exceeds the first multiple of the usual distance, while the rms distance of
/// its neighbours in the window is below the second. A window may contain this many outliers.
const GLITCH_THRESHOLDS: [f64; 2] = [6.0, 2.0];
const MAX_GLITCHES: usize = 4;

/// Half the window in which outliers are searched for, in samples.
const HALF_WINDOW: usize = 7;

/// A window longer than this multiple of the usual one contains a gap.
const MAX_GAP: f64 = 1.5;

/// Markers may be further apart than along the rod by this fraction of its length, to allow for noise.
const DISTANCE_TOLERANCE: f64 = 0.1;

/// The polyline through the markers must be at least this fraction of the rod's length.
const MIN_EXTENT: f64 = 0.5;

/// The length of the polyline through a row of positions, m.
fn length(row: &[f64]) -> f64 {
    let nodes = row.as_chunks::<2>().0;
    nodes.windows(2).map(|pair| (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1])).sum()
}

/// The median; 0 of an empty list.
fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
}

/// Positions of nodes at increasing times, as in `nodes.csv`.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Markers {
    /// Times of complete samples, s.
    pub times: Vec<f64>,
    /// Positions, one row per time, two entries per node, m.
    pub positions: Vec<Vec<f64>>,
    /// Descriptions of missing samples.
    pub missing: Vec<String>,
    /// The markers are at every `every`-th node, including the first and the last; 0 for a single marker.
    pub every: usize,
}

/// The nodes that have markers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MarkedNodes {
    /// All of them.
    All,
    /// All, every second, every third, …, including the first and the last.
    Every,
    /// The tip alone, or all.
    Tip,
}

impl Markers {
    /// Reads the columns time_s, x0_m, y0_m, … of the `marked` nodes of `rod`, or time_s, tip_x_m, tip_y_m of a tip: at least `least`
    /// samples. Incomplete samples are left out and reported; impossible ones are an error.
    ///
    /// # Errors
    /// [`Error::Read`]; [`Error::Scene`] with file, line and column if the file is not such a table.
    pub fn read(path: &Path, rod: &Rod, marked: MarkedNodes, least: usize) -> Result<Self> {
        let refuse = |line: u64, problem: String| Error::Scene {
            place: format!("{}:{line}", path.display()),
            key: String::new(),
            problem,
        };
        let mut reader = csv::ReaderBuilder::new()
            .comment(Some(b'#'))
            .trim(csv::Trim::All)
            .flexible(true)
            .from_path(path)
            .map_err(|e| Error::Read { path: path.to_path_buf(), reason: e.to_string() })?;
        let header = reader.headers().map_err(|e| refuse(1, e.to_string()))?.clone();
        let tip = marked == MarkedNodes::Tip && header.iter().eq(["time_s", "tip_x_m", "tip_y_m"]);
        // With a head body the nodes of a coarser mesh are not nodes of a finer one.
        let spread = marked == MarkedNodes::Every && rod.front == 0;
        let count = header.len().saturating_sub(1) / 2;
        let every = match rod.nodes - 1 {
            edges if spread && count > 1 && edges % (count - 1) == 0 => edges / (count - 1),
            _ => 1,
        };
        let last = (rod.nodes - 1) / every;
        let expected: Vec<String> = std::iter::once("time_s".to_string())
            .chain((0..=last).flat_map(|k| [format!("x{k}_m"), format!("y{k}_m")]))
            .collect();
        if !tip && !header.iter().eq(expected.iter().map(String::as_str)) {
            let found = format!("found {} columns from {:?}", header.len(), header.iter().next().unwrap_or_default());
            let last = rod.nodes - 1;
            let each = format!("time_s, x0_m, y0_m, … y{last}_m: one marker a node of the scene's rod");
            let allowed = match marked {
                MarkedNodes::Every if spread => format!(
                    "{each}, or at every second, third, … of its {} nodes, numbered from 0, the first and the last among them",
                    rod.nodes
                ),
                MarkedNodes::All => format!("{each}; with design.variables they may be at every second, third, …"),
                _ => each,
            };
            return Err(refuse(1, format!("{found}; allowed: {allowed}")));
        }
        let (mut markers, mut lines) = (Self { every, ..Self::default() }, Vec::new());
        let mut last = f64::NEG_INFINITY;
        for record in reader.records() {
            let record = record.map_err(|e| refuse(e.position().map_or(0, csv::Position::line), e.to_string()))?;
            let line = record.position().map_or(0, csv::Position::line);
            if record.len() != header.len() {
                let problem = format!("found {} columns; allowed: {}, as in the header", record.len(), header.len());
                return Err(refuse(line, problem));
            }
            let number = |i: usize| -> Result<f64> {
                let text = &record[i];
                if i > 0 && (text.is_empty() || text.eq_ignore_ascii_case("nan")) {
                    return Ok(f64::NAN);
                }
                text.parse().ok().filter(|x: &f64| x.is_finite()).ok_or_else(|| {
                    refuse(line, format!("found {text:?} in column {}; allowed: a number, or nothing", &header[i]))
                })
            };
            let time = number(0)?;
            if time <= last {
                return Err(refuse(line, format!("found time {time} s after {last} s; allowed: rising times")));
            }
            last = time;
            let row: Vec<f64> = (1..header.len()).map(number).collect::<Result<_>>()?;
            match row.iter().position(|x| x.is_nan()) {
                Some(_) if tip => markers.missing.push(format!("the tip at t = {time} s")),
                Some(i) => markers.missing.push(format!("node {} at t = {time} s", i / 2)),
                None => {
                    lines.push(line);
                    markers.times.push(time);
                    markers.positions.push(row);
                }
            }
        }
        if markers.times.len() < least {
            let found = format!("found {} complete samples", markers.times.len());
            return Err(refuse(1, format!("{found}; allowed: at least {least}")));
        }
        let impossible = if tip { markers.stray_tip(rod.length) } else { markers.impossible(rod) };
        match impossible {
            Some((sample, entry, problem)) => {
                let column = header.get(1 + entry).unwrap_or_default();
                Err(Error::Scene {
                    place: format!("{}:{}", path.display(), lines[sample]),
                    key: column.to_string(),
                    problem: format!("found {}: {problem}", number(markers.positions[sample][entry])),
                })
            }
            None => Ok(markers),
        }
    }

    /// The node of marker `k`.
    pub(super) fn node(&self, k: usize) -> usize {
        k * self.every.max(1)
    }

    /// Arc length at marker `k`, m.
    fn arc_length(&self, rod: &Rod, k: usize) -> f64 {
        rod.arc_length(self.node(k))
    }

    /// The coordinates of the markers among those of all nodes, or of the nodes of a rod of `finer` times as many edges that begins at node
    /// `front`, m.
    pub(super) fn of_nodes<'a>(
        &'a self,
        positions: &'a [f64],
        (finer, front): (usize, usize),
    ) -> impl Iterator<Item = f64> + 'a {
        let count = self.positions.first().map_or(0, |row| row.len() / 2);
        let node = move |k: usize| finer_node(self.node(k), finer, front);
        (0..count).flat_map(move |k| [0, 1].map(|axis| positions[2 * node(k) + axis]))
    }

    /// The first sample and entry that are impossible for `rod`, and why: nodes cannot be further apart than along the rod.
    fn impossible(&self, rod: &Rod) -> Option<(usize, usize, String)> {
        let reach = |i: usize, j: usize| {
            (self.arc_length(rod, i) - self.arc_length(rod, j)).abs() + DISTANCE_TOLERANCE * rod.length
        };
        let far = |row: &[f64], i: usize, j: usize| {
            (row[2 * i] - row[2 * j]).hypot(row[2 * i + 1] - row[2 * j + 1]) > reach(i, j)
        };
        let sizes: Vec<f64> = self.positions.iter().map(|row| length(row) / rod.length).collect();
        let middle = median(&sizes);
        if middle > 10.0 {
            // All rows are wrong, so the error is not in a single marker.
            let problem = format!(
                "the markers of a sample are {middle:.3e} times the rod's length along the rod; allowed: positions in metres of \
                 a rod of {} m; are these millimetres?",
                rod.length
            );
            return Some((0, 0, problem));
        }
        for (sample, row) in self.positions.iter().enumerate() {
            let nodes = row.len() / 2;
            if (1..nodes).all(|k| !far(row, k - 1, k)) {
                continue;
            }
            // The marker that is too far from most others.
            let strangers = |k: &usize| (0..nodes).filter(|j| far(row, *k, *j)).count();
            let node = (0..nodes).rev().max_by_key(strangers)?;
            // The coordinate with the larger deviation.
            let off = |axis: usize| {
                let all: Vec<f64> = (0..nodes).map(|k| row[2 * k + axis]).collect();
                (row[2 * node + axis] - median(&all)).abs()
            };
            let problem = format!(
                "node {node} is off the rod: further from the others than {} m along it; allowed: metres, and nothing where a \
                 marker was not seen",
                rod.length
            );
            return Some((sample, 2 * node + usize::from(off(1) > off(0)), problem));
        }
        let sample = sizes.iter().position(|size| *size < MIN_EXTENT)?;
        let problem = format!(
            "the markers of this sample are {:.3e} times the rod's length along the rod; allowed: positions in metres of \
             a rod of {} m, which hardly stretches",
            sizes[sample], rod.length
        );
        Some((sample, 0, problem))
    }

    /// The first sample and entry of a tip that is further than the rod's `length` from its neighbours in time.
    fn stray_tip(&self, length: f64) -> Option<(usize, usize, String)> {
        let step = |i: usize| {
            let [a, b] = [self.positions.get(i)?, self.positions.get(i + 1)?];
            Some((a[0] - b[0]).hypot(a[1] - b[1]))
        };
        let jumps = |i: Option<usize>| i.and_then(step).is_none_or(|step| step > length);
        let count = self.positions.len();
        let sample = (0..count).find(|i| count > 2 && jumps(i.checked_sub(1)) && jumps(Some(*i)))?;
        let other = &self.positions[if sample == 0 { 1 } else { sample - 1 }];
        let off = |axis: usize| (self.positions[sample][axis] - other[axis]).abs();
        let problem = format!(
            "the tip jumps by more than the rod's length, {length} m, from one sample to the next; allowed: metres, and nothing \
             where it was not seen"
        );
        Some((sample, usize::from(off(1) > off(0)), problem))
    }

    /// The same markers without samples that contain an outlier, which are reported as missing.
    pub fn without_glitches(mut self) -> Self {
        let glitches = self.glitches();
        let name = |(sample, node, off): &(usize, usize, f64)| {
            format!("node {node} at t = {} s, {off:.1e} m off its path", self.times[*sample])
        };
        let names: Vec<String> = glitches.iter().map(name).collect();
        self.missing.extend(names);
        let clean: Vec<bool> = (0..self.times.len()).map(|i| glitches.iter().all(|glitch| glitch.0 != i)).collect();
        let mut keep = clean.iter();
        self.times.retain(|_| keep.next() == Some(&true));
        let mut keep = clean.iter();
        self.positions.retain(|_| keep.next() == Some(&true));
        self
    }

    /// Outliers: sample, node, and distance from the path (m).
    fn glitches(&self) -> Vec<(usize, usize, f64)> {
        let (count, span) = (self.times.len(), 2 * HALF_WINDOW + 1);
        let nodes = self.positions.first().map_or(0, |row| row.len() / 2);
        let mut found = Vec::new();
        if count < 2 * span {
            return found;
        }
        let first = |i: usize| i.saturating_sub(HALF_WINDOW).min(count - span);
        let all: Vec<usize> = (0..span).collect();
        let fits: Vec<Option<Vec<f64>>> =
            (0..count).map(|i| fitted(&self.times[first(i)..first(i) + span], &all, i - first(i))).collect();
        for node in 0..nodes {
            let at = |i: usize| [self.positions[i][2 * node], self.positions[i][2 * node + 1]];
            // Distance from the prediction of the samples `chosen` around `i`, over the deviation due to unit noise.
            let off = |i: usize, first: usize, chosen: &[usize], weights: &[f64]| {
                let own = at(i);
                let [x, y] = [0, 1].map(|axis| {
                    let said: f64 = chosen.iter().zip(weights).map(|(j, w)| w * at(first + j)[axis]).sum();
                    own[axis] - said
                });
                let part = chosen.iter().position(|j| first + j == i);
                let squares: f64 = weights.iter().map(|w| w * w).sum();
                // A residual within the fit is smaller than the noise, outside of it larger.
                let scale = part.map_or(1.0 + squares, |_| (1.0 - squares).max(0.01));
                (x.hypot(y), (x.hypot(y) / std::f64::consts::SQRT_2) / scale.sqrt())
            };
            let usual: Vec<f64> =
                (0..count).filter_map(|i| Some(off(i, first(i), &all, fits[i].as_ref()?).1)).collect();
            let usual = median(&usual);
            for i in (0..count).filter(|_| usual > 0.0) {
                let begin = first(i);
                let window = begin..begin + span;
                let suspicious =
                    |j: usize| fits[j].as_ref().is_some_and(|fit| off(j, first(j), &all, fit).1 > 3.0 * usual);
                if !window.clone().any(suspicious) {
                    continue;
                }
                // The path without the samples that are furthest from it, removed one after the other.
                let mut chosen = all.clone();
                let mut last = f64::INFINITY;
                for _ in 0..=MAX_GLITCHES {
                    let distance = |j: usize, chosen: &[usize]| {
                        let fit = fitted(&self.times[window.clone()], chosen, j)?;
                        Some(off(begin + j, begin, chosen, &fit).1)
                    };
                    let own: Vec<(usize, f64)> =
                        chosen.iter().filter_map(|j| Some((*j, distance(*j, &chosen)?))).collect();
                    let rms = (own.iter().map(|(_, d)| d * d).sum::<f64>() / own.len().max(1) as f64).sqrt();
                    last = rms;
                    let Some((worst, far)) = own.into_iter().max_by(|a, b| a.1.total_cmp(&b.1)) else { break };
                    if rms <= GLITCH_THRESHOLDS[1] * usual && far <= 4.0 * usual {
                        break;
                    }
                    chosen.retain(|j| *j != worst);
                }
                let out = !chosen.contains(&(i - begin));
                if let Some(fit) = fitted(&self.times[window.clone()], &chosen, i - begin).filter(|_| out) {
                    let (distance, over) = off(i, begin, &chosen, &fit);
                    if over > GLITCH_THRESHOLDS[0] * usual && last <= GLITCH_THRESHOLDS[1] * usual {
                        found.push((i, node, distance));
                    }
                }
            }
        }
        found.sort_by_key(|(sample, node, _)| (*sample, *node));
        found
    }

    /// Smooths the motion at all samples with a full window of `half` samples to either side. By default, the longest window over
    /// which polynomials fit as well as over shorter ones.
    ///
    /// # Errors
    /// [`Error::Design`] if no sample has a full window.
    pub fn smooth(&self, half: Option<usize>) -> Result<SmoothedMotion> {
        if let Some(half) = half {
            return self.smoothed(half.max(DEGREE / 2 + 1));
        }
        let mut best = self.smoothed(DEGREE / 2 + 1)?;
        let mut least = best.noise;
        let mut half = DEGREE / 2 + 1;
        loop {
            half += 1 + half / 4;
            if 6 * half > self.times.len() {
                return Ok(best);
            }
            let Ok(next) = self.smoothed(half) else { return Ok(best) };
            if next.noise > MAX_RESIDUAL_GROWTH * least {
                return Ok(best);
            }
            least = least.min(next.noise);
            best = next;
        }
    }

    fn smoothed(&self, half: usize) -> Result<SmoothedMotion> {
        let count = self.times.len();
        let mut spans: Vec<f64> = self.times.windows(2 * half + 1).map(|w| w[2 * half] - w[0]).collect();
        spans.sort_by(f64::total_cmp);
        let usual = spans.get(spans.len() / 2).copied().unwrap_or(0.0);
        let mut motion = SmoothedMotion { half, ..SmoothedMotion::default() };
        let mut squares = Vec::new();
        let mut beside = 0;
        for i in half..count.saturating_sub(half) {
            let window = &self.times[i - half..=i + half];
            if window[2 * half] - window[0] > MAX_GAP * usual {
                beside += 1;
                continue;
            }
            let Some(weights) = weights(window, self.times[i]) else { continue };
            let rows = &self.positions[i - half..=i + half];
            let filtered = |of: usize| -> Vec<f64> {
                let column = |c: usize| weights.iter().zip(rows).map(|(w, row)| w[of] * row[c]).sum();
                (0..rows[0].len()).map(column).collect()
            };
            let [q, v, a] = [0, 1, 2].map(filtered);
            // The variance of the middle residual is σ²(1 − w) with w the middle's own weight.
            let own = (1.0 - weights[half][0]) * q.len() as f64;
            squares.push(q.iter().zip(&self.positions[i]).map(|(q, x)| (q - x).powi(2)).sum::<f64>() / own);
            motion.samples.push(SmoothedSample { index: i, q, v, a, weights });
        }
        if motion.samples.is_empty() {
            let reason = format!("no sample has {half} others without a gap on either side of it");
            return Err(Error::Design { reason });
        }
        // The median, because motion that is temporarily too fast for the window, as at a start, is not noise.
        let mut sorted = squares.clone();
        sorted.sort_by(f64::total_cmp);
        let median = sorted[sorted.len() / 2];
        motion.noise = median.sqrt();
        let mut fits = squares.iter().map(|square| *square <= MAX_RESIDUAL * MAX_RESIDUAL * median);
        let before = motion.samples.len();
        motion.samples.retain(|_| fits.next().unwrap_or(false));
        for (left_out, why) in [
            (beside, "next to a gap, or between rows with a longer interval than most"),
            (before - motion.samples.len(), "too fast for the smoothing window, or outliers"),
        ] {
            if left_out > 0 {
                let samples = if left_out == 1 { "sample" } else { "samples" };
                motion.left_out.push(format!("{left_out} {samples} {why}"));
            }
        }
        Ok(motion)
    }
}

/// The smoothed motion of markers.
#[derive(Debug, Clone, Default)]
pub struct SmoothedMotion {
    /// Half the window, in samples.
    pub half: usize,
    /// Standard deviation of the positions about the polynomials, m.
    pub noise: f64,
    /// The samples with a full window.
    pub samples: Vec<SmoothedSample>,
    /// Descriptions of the samples that were left out.
    pub left_out: Vec<String>,
}

/// The smoothed motion at one sample.
#[derive(Debug, Clone)]
pub struct SmoothedSample {
    /// Index of the sample.
    pub index: usize,
    /// Positions, m, two entries per node.
    pub q: Vec<f64>,
    /// Velocities, m/s.
    pub v: Vec<f64>,
    /// Accelerations, m/s².
    pub a: Vec<f64>,
    /// Weights of the window's samples in the value and its two derivatives.
    pub weights: Vec<[f64; 3]>,
}

/// Weights of the samples `chosen` of those at `times` in the least-squares polynomial at sample `at`.
fn fitted(times: &[f64], chosen: &[usize], at: usize) -> Option<Vec<f64>> {
    let own: Vec<f64> = chosen.iter().map(|j| times[*j]).collect();
    (own.len() > DEGREE).then(|| weights(&own, times[at])).flatten().map(|all| all.into_iter().map(|w| w[0]).collect())
}

/// Weights of samples at `times` in the value and the first two derivatives, at `time`, of the least-squares polynomial.
fn weights(times: &[f64], time: f64) -> Option<Vec<[f64; 3]>> {
    let scale = 0.5 * (times.last()? - times.first()?);
    let powers = DMatrix::from_fn(times.len(), DEGREE + 1, |i, j| ((times[i] - time) / scale).powi(j as i32));
    let qr = powers.qr();
    let (q, r) = (qr.q(), qr.r());
    let inverse = r.solve_upper_triangular(&q.transpose())?;
    Some(
        (0..times.len())
            .map(|j| [inverse[(0, j)], inverse[(1, j)] / scale, 2.0 * inverse[(2, j)] / (scale * scale)])
            .collect(),
    )
}

/// Root mean square.
pub(super) fn rms(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len() as f64;
    (values.map(|x| x * x).sum::<f64>() / count).sqrt()
}

/// The node on a mesh of `finer` times as many edges at the position of node `k` of a rod that begins at node `front`.
pub(super) fn finer_node(k: usize, finer: usize, front: usize) -> usize {
    if k < front { k } else { front + finer * (k - front) }
}

/// Root mean square distance (m) of the nodes of a rod from the markers at each of their times; `None` if the simulation ends
/// earlier. The rod has `finer` times as many edges as that of the scene, and begins at node `front`.
pub(super) fn distances(trajectory: &Trajectory, markers: &Markers, finer: (usize, usize)) -> Option<Vec<f64>> {
    let rows = markers.times.iter().zip(&markers.positions);
    rows.map(|(time, row)| {
        let q = trajectory.at(*time)?;
        let squares = markers.of_nodes(&q, finer).zip(row).map(|(q, x)| (q - x).powi(2));
        Some((squares.sum::<f64>() / (row.len() / 2) as f64).sqrt())
    })
    .collect()
}
