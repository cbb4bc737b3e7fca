//! Root search: the first zero crossing of a function of one variable, by sampling, golden-section search for narrow peaks, and
//! bisection.

/// Sampling intervals of the search, and bisections of the one with the crossing.
pub(super) const SAMPLES: usize = 60;
const BISECTIONS: usize = 30;

/// Golden-section steps in the search for a narrow peak between samples.
const GOLDEN_STEPS: usize = 24;

/// The golden ratio.
const GOLDEN_RATIO: f64 = 0.618_033_988_749_895;

/// Two arguments between which `f` first becomes positive, from `samples` (x, f(x)) with increasing x. Between samples around a
/// negative maximum, the peak is searched for.
pub(super) fn first_rise(samples: &[(f64, f64)], mut f: impl FnMut(f64) -> f64) -> Option<[f64; 2]> {
    for i in 0..samples.len() {
        let (x, here) = samples[i];
        if here > 0.0 {
            return Some([if i == 0 { x } else { samples[i - 1].0 }, x]);
        }
        let Some(((from, before), (to, after))) = i.checked_sub(1).map(|i| samples[i]).zip(samples.get(i + 1).copied())
        else {
            continue;
        };
        if after > 0.0 || here <= before || here < after {
            continue;
        }
        // Golden-section search: the higher one of the two inner points stays inside.
        let (mut low, mut high) = (from, to);
        let mut places = [high - GOLDEN_RATIO * (high - low), low + GOLDEN_RATIO * (high - low)];
        let mut heights = places.map(&mut f);
        for _ in 0..GOLDEN_STEPS {
            if let Some(top) = (0..2).find(|i| heights[*i] > 0.0) {
                return Some([from, places[top]]);
            }
            if heights[0] > heights[1] {
                high = places[1];
                places = [high - GOLDEN_RATIO * (high - low), places[0]];
                heights = [f(places[0]), heights[0]];
            } else {
                low = places[0];
                places = [places[1], low + GOLDEN_RATIO * (high - low)];
                heights = [heights[1], f(places[1])];
            }
        }
    }
    None
}

/// The smallest x between `low` and `high` at which `f` becomes positive.
pub(super) fn first_crossing(low: f64, high: f64, mut f: impl FnMut(f64) -> f64) -> Option<f64> {
    let at = |i: usize| low + (high - low) * i as f64 / SAMPLES as f64;
    let mut samples = Vec::with_capacity(SAMPLES);
    // Samples beyond the first positive one are not needed.
    for x in (1..=SAMPLES).map(at) {
        let here = f(x);
        samples.push((x, here));
        if here > 0.0 {
            break;
        }
    }
    let [mut below, mut above] = first_rise(&samples, &mut f)?;
    if below == above {
        below = low;
    }
    for _ in 0..BISECTIONS {
        let middle = 0.5 * (below + above);
        if f(middle) > 0.0 { above = middle } else { below = middle }
    }
    Some(0.5 * (below + above))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failure ends the test")]
    use super::*;

    #[test]
    fn a_crossing_is_found_wherever_it_is_and_however_narrow_what_is_above() {
        for place in (1..400).map(|i| f64::from(i) / 400.0) {
            let found = first_crossing(0.0, 1.0, |x| x - place).unwrap();
            assert!((found - place).abs() < 1e-9, "{found} for {place}");
            // A peak that is positive only between x = place ± width, which is narrower than the sample spacing.
            let spacing = 1.0 / SAMPLES as f64;
            for width in [0.3 * spacing, 1e-2 * spacing, 1e-3 * spacing] {
                let first = place - width;
                if !(2.0 * spacing..=1.0 - spacing).contains(&place) {
                    continue; // the ends have no sample beyond them
                }
                let lopsided = |x: f64| {
                    let off = (x - place) / width;
                    if off > 0.0 { 1.0 - 3.0 * off } else { 1.0 + off }
                };
                let found = first_crossing(0.0, 1.0, lopsided).unwrap();
                assert!((found - first).abs() < 1e-9, "{found} for {first}, {width} wide");
            }
        }
        assert!(first_crossing(0.0, 1.0, |x| -1e-3 - (x - 0.345).powi(2)).is_none());
        assert!(first_crossing(0.0, 1.0, |_| 0.0).is_none());
    }
}
