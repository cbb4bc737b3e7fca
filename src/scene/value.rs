//! Types of the values of scene keys. Each type has a range, so that an error about a wrong value has a line number.

use std::fmt;
use std::marker::PhantomData;

use serde::de::value::{F64Deserializer, MapAccessDeserializer, SeqAccessDeserializer};
use serde::de::{Deserialize, Deserializer, Error, IgnoredAny, MapAccess, SeqAccess, Visitor};

use crate::head::Signal;
use crate::rod::Profile;

/// Defines a number type with a range: `$ok` tests it, `$allowed` describes it.
macro_rules! number {
    ($(#[$doc:meta])* $name:ident, $allowed:literal, $ok:expr) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq)]
        pub struct $name(f64);

        impl $name {
            /// A constant for defaults, which is not checked.
            pub(super) const fn constant(number: f64) -> Self {
                Self(number)
            }

            /// The number.
            pub const fn get(self) -> f64 {
                self.0
            }
        }

        impl TryFrom<f64> for $name {
            type Error = crate::error::Error;

            /// # Errors
            /// [`Error::BadValue`](crate::error::Error::BadValue) for a number that is out of range or not finite.
            fn try_from(number: f64) -> Result<Self, Self::Error> {
                let ok: fn(f64) -> bool = $ok;
                let allowed = $allowed;
                if number.is_finite() && ok(number) {
                    Ok(Self(number))
                } else {
                    Err(Self::Error::BadValue { name: stringify!($name), value: number, allowed })
                }
            }
        }

        impl<'de> Deserialize<'de> for $name {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                deserializer.deserialize_any(NumberVisitor { allowed: $allowed, ok: $ok }).map(Self)
            }
        }
    };
}

number!(
    /// A positive number.
    Positive,
    "a positive number",
    |x| x > 0.0
);
number!(
    /// A nonnegative number.
    NotNegative,
    "a number that is not negative",
    |x| x >= 0.0
);
number!(
    /// A finite number.
    Finite,
    "a finite number",
    |_| true
);
number!(
    /// A number above −1, so that 1 + a(1−ξ) stays positive.
    Gradient,
    "a number above -1",
    |x| x > -1.0
);
number!(
    /// A relative tolerance.
    Tolerance,
    "a number between 0 and 1",
    |x| x > 0.0 && x < 1.0
);

number!(
    /// A fraction between 0 and 1.
    Share,
    "a number from 0 to 1",
    |x| (0.0..=1.0).contains(&x)
);

struct NumberVisitor {
    allowed: &'static str,
    ok: fn(f64) -> bool,
}

impl Visitor<'_> for NumberVisitor {
    type Value = f64;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.allowed)
    }

    fn visit_f64<E: Error>(self, x: f64) -> Result<f64, E> {
        if x.is_finite() && (self.ok)(x) { Ok(x) } else { Err(E::custom(refused(x, self.allowed))) }
    }

    fn visit_i64<E: Error>(self, x: i64) -> Result<f64, E> {
        self.visit_f64(x as f64)
    }

    fn visit_u64<E: Error>(self, x: u64) -> Result<f64, E> {
        self.visit_f64(x as f64)
    }

    fn visit_i128<E: Error>(self, x: i128) -> Result<f64, E> {
        self.visit_f64(x as f64)
    }

    fn visit_u128<E: Error>(self, x: u128) -> Result<f64, E> {
        self.visit_f64(x as f64)
    }
}

/// The message about a value that is not allowed.
pub fn refused(found: impl fmt::Display, allowed: impl fmt::Display) -> String {
    format!("found {found}; allowed: {allowed}")
}

/// An integer from `MIN` to `MAX`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BoundedInteger<const MIN: u64, const MAX: u64>(u64);

impl<const MIN: u64, const MAX: u64> BoundedInteger<MIN, MAX> {
    /// The smallest integer.
    pub const LEAST: Self = Self(MIN);

    /// The allowed integer nearest to `n`.
    pub fn nearest(n: u64) -> Self {
        Self(n.clamp(MIN, MAX))
    }

    /// The number.
    pub const fn get(self) -> usize {
        self.0 as usize
    }
}

impl<'de, const MIN: u64, const MAX: u64> Deserialize<'de> for BoundedInteger<MIN, MAX> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Within<const MIN: u64, const MAX: u64>;
        impl<const MIN: u64, const MAX: u64> Visitor<'_> for Within<MIN, MAX> {
            type Value = u64;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "a whole number from {MIN} to {MAX}")
            }

            fn visit_i64<E: Error>(self, x: i64) -> Result<u64, E> {
                match u64::try_from(x) {
                    Ok(n) => self.visit_u64(n),
                    Err(_) => Err(E::custom(refused(x, format_args!("a whole number from {MIN} to {MAX}")))),
                }
            }

            fn visit_i128<E: Error>(self, x: i128) -> Result<u64, E> {
                Err(E::custom(refused(x, format_args!("a whole number from {MIN} to {MAX}"))))
            }

            fn visit_u64<E: Error>(self, n: u64) -> Result<u64, E> {
                if (MIN..=MAX).contains(&n) {
                    Ok(n)
                } else {
                    Err(E::custom(refused(n, format_args!("a whole number from {MIN} to {MAX}"))))
                }
            }
        }
        deserializer.deserialize_any(Within::<MIN, MAX>).map(Self)
    }
}

/// A function of time in a scene.
#[derive(Debug, Clone, PartialEq)]
pub enum SignalValue {
    /// A number or a sinusoid.
    Formula(Signal),
    /// A table in a file, with its path relative to the scene.
    Table(String),
}

impl SignalValue {
    /// The signal, unless it is a table.
    pub fn formula(&self) -> Option<&Signal> {
        match self {
            Self::Formula(signal) => Some(signal),
            Self::Table(_) => None,
        }
    }
}

/// The keys that a function of time may have.
pub(super) const SIGNAL_KEYS: [&str; 5] = ["amplitude", "frequency_hz", "phase_rad", "offset", "table"];

/// The keys of a function of time with values of type T and phases of type P.
#[derive(serde::Deserialize)]
#[serde(
    deny_unknown_fields,
    expecting = "a number, { amplitude, frequency_hz, phase_rad, offset } or { table = \"file.csv\" }"
)]
struct SignalKeys<T, P> {
    amplitude: Option<T>,
    frequency_hz: Option<NotNegative>,
    phase_rad: Option<P>,
    offset: Option<T>,
    table: Option<String>,
}

impl<T, P> SignalKeys<T, P> {
    /// The functions, where `component` and `phase` return entry `i` of a value and of a phase.
    fn signal_value<const M: usize, E: Error>(
        self,
        component: fn(&T, usize) -> f64,
        phase: fn(&P, usize) -> f64,
    ) -> Result<[SignalValue; M], E> {
        match self {
            Self { table: Some(file), amplitude: None, frequency_hz: None, phase_rad: None, offset: None } => {
                Ok(std::array::from_fn(|_| SignalValue::Table(file.clone())))
            }
            Self { table: Some(_), .. } => Err(E::custom(refused(
                "a table together with other keys",
                "either { table } or { amplitude, frequency_hz, phase_rad, offset }",
            ))),
            Self { amplitude: Some(amplitude), frequency_hz: Some(frequency), phase_rad, offset, .. } => {
                Ok(std::array::from_fn(|i| {
                    SignalValue::Formula(Signal::Sinusoid {
                        amplitude: component(&amplitude, i),
                        frequency: frequency.get(),
                        phase: phase_rad.as_ref().map_or(0.0, |value| phase(value, i)),
                        offset: offset.as_ref().map_or(0.0, |offset| component(offset, i)),
                    })
                }))
            }
            _ => Err(E::custom(refused("an incomplete sinusoid", "amplitude and frequency_hz together, or a table"))),
        }
    }
}

/// A number for both components, or one for each.
#[derive(Clone, Copy)]
struct Each([f64; 2]);

impl<'de> Deserialize<'de> for Each {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct OneOrTwo;
        const NUMBER: NumberVisitor = NumberVisitor { allowed: "a finite number, or two", ok: |_| true };
        impl<'de> Visitor<'de> for OneOrTwo {
            type Value = Each;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(NUMBER.allowed)
            }

            fn visit_f64<E: Error>(self, x: f64) -> Result<Each, E> {
                NUMBER.visit_f64(x).map(|x| Each([x; 2]))
            }

            fn visit_i64<E: Error>(self, x: i64) -> Result<Each, E> {
                self.visit_f64(x as f64)
            }

            fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<Each, A::Error> {
                pair(SeqAccessDeserializer::new(seq)).map(|pair: [Finite; 2]| Each(pair.map(Finite::get)))
            }
        }
        deserializer.deserialize_any(OneOrTwo)
    }
}

/// Exactly two values. A serde array of two would accept other TOML too.
pub struct ExactlyTwo<T>(pub [T; 2]);

impl<'de, T: Deserialize<'de>> Deserialize<'de> for ExactlyTwo<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Two<T>(PhantomData<T>);
        impl<'de, T: Deserialize<'de>> Visitor<'de> for Two<T> {
            type Value = [T; 2];

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("two values in brackets")
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<[T; 2], A::Error> {
                let (first, second) = (seq.next_element()?, seq.next_element()?);
                let mut count = usize::from(first.is_some()) + usize::from(second.is_some());
                while seq.next_element::<IgnoredAny>()?.is_some() {
                    count += 1;
                }
                match (first, second, count) {
                    (Some(first), Some(second), 2) => Ok([first, second]),
                    _ => Err(A::Error::custom(refused(format_args!("a list of {count}"), "two values in brackets"))),
                }
            }
        }
        deserializer.deserialize_any(Two(PhantomData)).map(Self)
    }
}

/// Reads two values.
pub fn pair<'de, D: Deserializer<'de>, T: Deserialize<'de>>(deserializer: D) -> Result<[T; 2], D::Error> {
    ExactlyTwo::deserialize(deserializer).map(|pair| pair.0)
}

/// Reads two values of an optional key.
pub fn optional_pair<'de, D: Deserializer<'de>, T: Deserialize<'de>>(
    deserializer: D,
) -> Result<Option<[T; 2]>, D::Error> {
    pair(deserializer).map(Some)
}

/// Reads a list of pairs of an optional key.
pub fn optional_pairs<'de, D: Deserializer<'de>, T: Deserialize<'de>>(
    deserializer: D,
) -> Result<Option<Vec<[T; 2]>>, D::Error> {
    let pairs: Vec<ExactlyTwo<T>> = Deserialize::deserialize(deserializer)?;
    Ok(Some(pairs.into_iter().map(|pair| pair.0).collect()))
}

/// A number, or a profile along the rod: points [ξ, number] with ξ increasing from 0 to 1, linear in between.
#[derive(Debug, Clone, PartialEq)]
pub struct NumberOrProfile<T> {
    points: Vec<[f64; 2]>,
    /// The number, if it is uniform.
    number: Option<T>,
}

impl NumberOrProfile<Positive> {
    /// The value multiplied by a positive `factor`.
    pub(super) fn times(&self, factor: f64) -> Self {
        Self {
            points: self.points.iter().map(|[xi, value]| [*xi, value * factor]).collect(),
            number: self.number.map(|number| Positive::constant(number.get() * factor)),
        }
    }

    /// A constant for comparisons; not checked.
    pub(super) fn constant(number: f64) -> Self {
        Self { points: vec![[0.0, number]], number: Some(Positive(number)) }
    }
}

impl<T: Copy> NumberOrProfile<T> {
    /// The number, unless it is a profile.
    pub fn number(&self) -> Option<T> {
        self.number
    }

    /// Its points [ξ, value], if it is a profile.
    pub fn points(&self) -> Option<&[[f64; 2]]> {
        self.number.is_none().then_some(&self.points)
    }

    /// The value as a profile.
    pub fn profile(&self) -> Profile {
        Profile::through(self.points.clone()).unwrap_or(Profile::from(0.0))
    }

    /// The error of an invalid profile: ξ does not increase, or not from 0 to 1.
    pub(super) fn disorder(&self) -> Option<String> {
        let mut last = f64::NEG_INFINITY;
        for [xi, value] in &self.points {
            if *xi <= last || !(0.0..=1.0).contains(xi) {
                return Some(format!("the point [{xi}, {value}]"));
            }
            last = *xi;
        }
        self.points.is_empty().then(|| "no points".to_string())
    }
}

impl NumberOrProfile<NotNegative> {
    /// A default; not checked.
    pub(super) fn constant(number: f64) -> Self {
        Self { points: vec![[0.0, number]], number: Some(NotNegative(number)) }
    }
}

impl<'de, T: Deserialize<'de>> Deserialize<'de> for NumberOrProfile<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct NumberOrPoints<T>(PhantomData<T>);
        impl<'de, T: Deserialize<'de>> Visitor<'de> for NumberOrPoints<T> {
            type Value = NumberOrProfile<T>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a number, or points [[xi, number], …]")
            }

            fn visit_f64<E: Error>(self, x: f64) -> Result<NumberOrProfile<T>, E> {
                Ok(NumberOrProfile { points: vec![[0.0, x]], number: Some(T::deserialize(F64Deserializer::new(x))?) })
            }

            fn visit_i64<E: Error>(self, x: i64) -> Result<NumberOrProfile<T>, E> {
                self.visit_f64(x as f64)
            }

            fn visit_u64<E: Error>(self, x: u64) -> Result<NumberOrProfile<T>, E> {
                self.visit_f64(x as f64)
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<NumberOrProfile<T>, A::Error> {
                let mut points = Vec::new();
                while let Some(ExactlyTwo([xi, value])) = seq.next_element::<ExactlyTwo<Finite>>()? {
                    T::deserialize(F64Deserializer::<A::Error>::new(value.get()))?;
                    points.push([xi.get(), value.get()]);
                }
                Ok(NumberOrProfile { points, number: None })
            }
        }
        deserializer.deserialize_any(NumberOrPoints(PhantomData))
    }
}

/// One function of time.
#[derive(Debug, Clone, PartialEq)]
pub struct ScalarSignal(pub SignalValue);

impl<'de> Deserialize<'de> for ScalarSignal {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Scalar;
        impl<'de> Visitor<'de> for Scalar {
            type Value = SignalValue;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a number, { amplitude, frequency_hz, phase_rad, offset } or { table = \"file.csv\" }")
            }

            fn visit_f64<E: Error>(self, x: f64) -> Result<SignalValue, E> {
                NumberVisitor { allowed: "a finite number", ok: |_| true }
                    .visit_f64(x)
                    .map(|x| SignalValue::Formula(Signal::Constant(x)))
            }

            fn visit_i64<E: Error>(self, x: i64) -> Result<SignalValue, E> {
                self.visit_f64(x as f64)
            }

            fn visit_u64<E: Error>(self, x: u64) -> Result<SignalValue, E> {
                self.visit_f64(x as f64)
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<SignalValue, A::Error> {
                let keys = SignalKeys::<Finite, Finite>::deserialize(MapAccessDeserializer::new(map))?;
                let [signal_value] = keys.signal_value(|value, _| value.get(), |phase, _| phase.get())?;
                Ok(signal_value)
            }
        }
        deserializer.deserialize_any(Scalar).map(Self)
    }
}

/// Two functions of time, x and y.
#[derive(Debug, Clone, PartialEq)]
pub struct VectorSignal(pub [SignalValue; 2]);

impl<'de> Deserialize<'de> for VectorSignal {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Vector;
        impl<'de> Visitor<'de> for Vector {
            type Value = [SignalValue; 2];

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("[x, y], { amplitude = [x, y], frequency_hz, phase_rad, offset = [x, y] } or { table = \"file.csv\" }")
            }

            fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<[SignalValue; 2], A::Error> {
                pair(SeqAccessDeserializer::new(seq)).map(|[x, y]: [ScalarSignal; 2]| [x.0, y.0])
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<[SignalValue; 2], A::Error> {
                SignalKeys::<ExactlyTwo<Finite>, Each>::deserialize(MapAccessDeserializer::new(map))?
                    .signal_value(|value, i| value.0[i].get(), |phase, i| phase.0[i])
            }
        }
        deserializer.deserialize_any(Vector).map(Self)
    }
}

/// The JSON schemas of these values.
#[cfg(feature = "schema")]
mod schema {
    use std::borrow::Cow;

    use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};

    use super::*;

    macro_rules! described {
        ($([$($generic:tt)*] $name:ty, $title:literal, |$generator:ident| $schema:expr;)*) => {$(
            impl<$($generic)*> JsonSchema for $name {
                fn inline_schema() -> bool {
                    true
                }

                fn schema_name() -> Cow<'static, str> {
                    $title.into()
                }

                #[allow(unused_variables, reason = "only some are made of others")]
                fn json_schema($generator: &mut SchemaGenerator) -> Schema {
                    $schema
                }
            }
        )*};
    }

    /// The schema of a function of time with the given schemas of its values, or a table.
    fn signal(constant: Schema, value: Schema, phase: Schema) -> Schema {
        json_schema!({ "anyOf": [
            constant,
            {
                "type": "object",
                "description": "offset + amplitude sin(2 pi frequency_hz t + phase_rad): the phase is added, whereas the actuation's phase_profile_rad is subtracted inside its sine",
                "properties": {
                    "amplitude": value,
                    "frequency_hz": { "type": "number", "minimum": 0 },
                    "phase_rad": phase,
                    "offset": value
                },
                "required": ["amplitude", "frequency_hz"],
                "additionalProperties": false
            },
            {
                "type": "object",
                "properties": { "table": { "type": "string", "description": "a CSV file next to the scene: time, value[, rate]" } },
                "required": ["table"],
                "additionalProperties": false
            }
        ] })
    }

    fn two(of: Schema) -> Schema {
        json_schema!({ "type": "array", "items": of, "minItems": 2, "maxItems": 2 })
    }

    described! {
        [] Positive, "Positive", |generator| json_schema!({ "type": "number", "exclusiveMinimum": 0 });
        [] NotNegative, "NotNegative", |generator| json_schema!({ "type": "number", "minimum": 0 });
        [] Finite, "Finite", |generator| json_schema!({ "type": "number" });
        [] Gradient, "Gradient", |generator| json_schema!({ "type": "number", "exclusiveMinimum": -1 });
        [] Tolerance, "Tolerance", |generator| json_schema!({ "type": "number", "exclusiveMinimum": 0, "exclusiveMaximum": 1 });
        [] Share, "Share", |generator| json_schema!({ "type": "number", "minimum": 0, "maximum": 1 });
        [const MIN: u64, const MAX: u64] BoundedInteger<MIN, MAX>, "Whole", |generator|
            json_schema!({ "type": "integer", "minimum": MIN, "maximum": MAX });
        [T: JsonSchema] NumberOrProfile<T>, "Along", |generator| {
            let value = T::json_schema(generator);
            let point = json_schema!({
                "type": "array",
                "prefixItems": [{ "type": "number", "minimum": 0, "maximum": 1 }, value],
                "minItems": 2,
                "maxItems": 2
            });
            json_schema!({ "anyOf": [value, { "type": "array", "items": point, "minItems": 1 }] })
        };
        [] ScalarSignal, "ScalarSignal", |generator| {
            let number = || json_schema!({ "type": "number" });
            signal(number(), number(), number())
        };
        [] VectorSignal, "VectorSignal", |generator| {
            let number = || json_schema!({ "type": "number" });
            let either = json_schema!({ "anyOf": [number(), two(number())] });
            signal(two(signal(number(), number(), number())), two(number()), either)
        };
    }
}
