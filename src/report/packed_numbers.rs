//! Numbers for the scripts of pages, packed.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde::{Serialize, Serializer};

/// Numbers in single precision, little-endian, as Base64: a third of the size of their decimals.
#[derive(Debug, Clone, PartialEq)]
pub struct PackedNumbers(Vec<f32>);

impl FromIterator<f64> for PackedNumbers {
    fn from_iter<I: IntoIterator<Item = f64>>(numbers: I) -> Self {
        Self(numbers.into_iter().map(|x| x as f32).collect())
    }
}

impl Serialize for PackedNumbers {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let bytes: Vec<u8> = self.0.iter().flat_map(|x| x.to_le_bytes()).collect();
        serializer.serialize_str(&STANDARD.encode(bytes))
    }
}

/// Numbers of a curve, relative to the first of them on a linear scale, so that small changes of large numbers keep their digits.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PackedCurve {
    first: f64,
    rest: PackedNumbers,
}

impl PackedCurve {
    /// Those on a scale that is linear or not.
    pub fn of(numbers: impl Iterator<Item = f64>, is_linear: bool) -> Self {
        let mut numbers = numbers.peekable();
        let first = numbers.peek().copied().filter(|x| is_linear && x.is_finite()).unwrap_or(0.0);
        Self { first, rest: numbers.map(|x| x - first).collect() }
    }
}

/// Numbers as parts of a size, in steps of 1/127, as Base64: enough for a colour.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct QuantizedNumbers {
    /// That of the largest number; or, if that is far beyond, as at a start that jumps, one that all but a hundredth stay within. Numbers
    /// beyond it have its colour.
    size: f64,
    #[serde(serialize_with = "in_base64")]
    parts: Vec<i8>,
}

/// Multiple of what nearly all numbers stay within from which the largest is not worth the scale.
const FAR_BEYOND: f64 = 4.0;

impl QuantizedNumbers {
    /// Those of numbers; `None` if all are zero.
    pub fn of(numbers: impl Iterator<Item = f64>) -> Option<Self> {
        let numbers: Vec<f64> = numbers.collect();
        let mut sizes: Vec<f64> = numbers.iter().map(|x| x.abs()).filter(|x| x.is_finite()).collect();
        let largest = sizes.iter().copied().fold(0.0, f64::max);
        let place = sizes.len().saturating_sub(1) * 99 / 100;
        let within = match sizes.is_empty() {
            true => 0.0,
            false => *sizes.select_nth_unstable_by(place, f64::total_cmp).1,
        };
        let size = if within > 0.0 && largest > FAR_BEYOND * within { within } else { largest };
        let part = |x: &f64| (127.0 * (x / size).clamp(-1.0, 1.0)).round() as i8;
        (size > 0.0).then(|| Self { size, parts: numbers.iter().map(part).collect() })
    }
}

fn in_base64<S: Serializer>(parts: &[i8], serializer: S) -> Result<S::Ok, S::Error> {
    let bytes: Vec<u8> = parts.iter().map(|part| part.cast_unsigned()).collect();
    serializer.serialize_str(&STANDARD.encode(bytes))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failure ends the test")]
    use super::*;

    #[test]
    fn small_changes_of_large_numbers_and_small_numbers_on_logarithmic_scales_keep_their_digits() {
        let read =
            |curve: PackedCurve| -> Vec<f64> { curve.rest.0.iter().map(|x| curve.first + f64::from(*x)).collect() };
        let far: Vec<f64> = (0..200).map(|k| 1.0 + 1e-6 * (0.1 * f64::from(k)).sin()).collect();
        let packed = read(PackedCurve::of(far.iter().copied(), true));
        assert!(far.iter().zip(&packed).all(|(a, b)| (a - b).abs() < 1e-12), "{packed:?}"); // 1e-13 was measured
        let falling: Vec<f64> = (0..20).map(|k| 10f64.powi(-k)).collect();
        let packed = read(PackedCurve::of(falling.iter().copied(), false));
        assert!(falling.iter().zip(&packed).all(|(a, b)| (a / b - 1.0).abs() < 1e-6), "{packed:?}");
    }
}
