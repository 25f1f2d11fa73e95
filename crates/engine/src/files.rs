//! How values stand in files: numbers that JSON lacks, counts, and maps. Everything that is read is untrusted.

use std::fmt;

use serde::de::{Error, Unexpected, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// A number. JSON has neither infinity nor "not a number", so these are the words `inf`, `-inf` and `nan`. For
/// fields, as `#[serde(with = "float")]`.
pub(super) mod float {
    use super::*;

    pub(crate) fn serialize<S: Serializer>(number: &f64, to: S) -> Result<S::Ok, S::Error> {
        match *number {
            finite if finite.is_finite() => to.serialize_f64(finite),
            f64::INFINITY => to.serialize_str("inf"),
            f64::NEG_INFINITY => to.serialize_str("-inf"),
            _ => to.serialize_str("nan"),
        }
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
        from.deserialize_any(Number)
    }

    struct Number;

    impl Visitor<'_> for Number {
        type Value = f64;

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("a number, `inf`, `-inf` or `nan`")
        }

        fn visit_f64<E: Error>(self, number: f64) -> Result<f64, E> {
            Ok(number)
        }

        fn visit_u64<E: Error>(self, number: u64) -> Result<f64, E> {
            Ok(number as f64)
        }

        fn visit_i64<E: Error>(self, number: i64) -> Result<f64, E> {
            Ok(number as f64)
        }

        fn visit_str<E: Error>(self, word: &str) -> Result<f64, E> {
            match word {
                "inf" => Ok(f64::INFINITY),
                "-inf" => Ok(f64::NEG_INFINITY),
                "nan" => Ok(f64::NAN),
                _ => Err(E::invalid_value(Unexpected::Str(word), &self)),
            }
        }
    }
}

/// A vector of numbers, as `#[serde(with = "floats")]`.
pub(super) mod floats {
    use super::*;

    #[derive(Serialize, Deserialize)]
    struct Float(#[serde(with = "float")] f64);

    pub(crate) fn serialize<const N: usize, S: Serializer>(
        numbers: &[f64; N],
        to: S,
    ) -> Result<S::Ok, S::Error> {
        to.collect_seq(numbers.map(Float))
    }

    pub(crate) fn deserialize<'de, const N: usize, D: Deserializer<'de>>(
        from: D,
    ) -> Result<[f64; N], D::Error> {
        let numbers: Vec<f64> = Vec::<Float>::deserialize(from)?.into_iter().map(|it| it.0).collect();
        numbers.try_into().map_err(|_| D::Error::custom(format!("{N} numbers are wanted")))
    }
}

/// A map whose keys are no texts: a list of its entries, as `#[serde(with = "pairs")]`.
pub(super) mod pairs {
    use super::*;

    pub(crate) fn serialize<M, S: Serializer>(map: M, to: S) -> Result<S::Ok, S::Error>
    where
        M: IntoIterator,
        M::Item: Serialize,
    {
        to.collect_seq(map)
    }

    pub(crate) fn deserialize<'de, K, V, M, D>(from: D) -> Result<M, D::Error>
    where
        (K, V): Deserialize<'de>,
        M: IntoIterator<Item = (K, V)> + FromIterator<(K, V)>,
        D: Deserializer<'de>,
    {
        Ok(Vec::<(K, V)>::deserialize(from)?.into_iter().collect())
    }
}

/// The largest count that is read: counts go on from there and must never overflow.
const COUNT_MAX: u64 = 1 << 53;

/// Reads a count, as `#[serde(deserialize_with = "count")]`.
pub(super) fn count<'de, D: Deserializer<'de>, T: TryFrom<u64>>(from: D) -> Result<T, D::Error> {
    let number = u64::deserialize(from)?;
    let count = Some(number).filter(|&number| number <= COUNT_MAX).and_then(|it| T::try_from(it).ok());
    count.ok_or_else(|| D::Error::invalid_value(Unexpected::Unsigned(number), &"a count up to 2^53"))
}

/// The reason why a keyframe cannot be loaded.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct KeyframeError(Box<str>);

impl KeyframeError {
    pub(super) fn new(reason: impl Into<Box<str>>) -> KeyframeError {
        KeyframeError(reason.into())
    }

    /// Whether the keyframe has as many of something as the configuration.
    pub(super) fn unless_same(what: &str, kept: usize, configured: usize) -> Result<(), KeyframeError> {
        if kept == configured {
            return Ok(());
        }
        Err(KeyframeError::new(format!(
            "the keyframe does not fit the configuration: it has {kept} {what}, the configuration {configured}"
        )))
    }
}

impl fmt::Display for KeyframeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for KeyframeError {}
