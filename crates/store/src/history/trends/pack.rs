//! The points of values as bytes: in columns, which zstd makes short.

use std::io::Read as _;
use std::sync::Arc;

/// A row unpacks to no more, also if a damaged file claims so: 20,000 values with long names need less.
const UNPACKED_MAX: u64 = 32 << 20;
const EFFORT: i32 = 3;

/// A value over a minute or an hour.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Which minute of the hour, or hour of the day.
    pub place: u16,
    /// For how long it was known, in tenths of a second.
    pub tenths: u32,
    pub least: f32,
    pub mean: f32,
    pub most: f32,
}

/// The points of each value of a module, by its key.
pub type Values = Vec<(Box<str>, Vec<Point>)>;

impl Point {
    /// Both together. Their means count by the time for which they were known.
    pub fn joined(self, other: Point) -> Point {
        let tenths = self.tenths.saturating_add(other.tenths);
        let sum =
            f64::from(self.mean) * f64::from(self.tenths) + f64::from(other.mean) * f64::from(other.tenths);
        let mean = if tenths == 0 { f64::from(self.mean) } else { sum / f64::from(tenths) };
        Point {
            place: self.place,
            tenths,
            least: self.least.min(other.least),
            mean: mean as f32,
            most: self.most.max(other.most),
        }
    }
}

/// Puts points into the values that there are. Those of one place are joined.
pub fn join(values: &mut Values, key: &str, points: impl Iterator<Item = Point>) {
    let index = values.iter().position(|(known, _)| **known == *key).unwrap_or_else(|| {
        values.push((key.into(), Vec::new()));
        values.len() - 1
    });
    let known = &mut values[index].1;
    for point in points {
        match known.binary_search_by_key(&point.place, |it| it.place) {
            Ok(at) => known[at] = known[at].joined(point),
            Err(at) => known.insert(at, point),
        }
    }
}

/// The values of one module.
pub fn pack(values: &Values) -> std::io::Result<Vec<u8>> {
    let mut raw = Vec::new();
    put_values(&mut raw, values);
    zstd::encode_all(&raw[..], EFFORT)
}

/// `None` if the bytes are not such values.
pub fn unpack(data: &[u8]) -> Option<Values> {
    values_of(&unpacked(data)?)
}

/// The values of all modules.
pub fn pack_all(nodes: &[(Arc<str>, Values)]) -> std::io::Result<Vec<u8>> {
    let mut raw = Vec::new();
    for (node, values) in nodes {
        put_text(&mut raw, node);
        let start = raw.len();
        raw.extend([0; 4]);
        put_values(&mut raw, values);
        let length = (raw.len() - start - 4) as u32;
        raw[start..start + 4].copy_from_slice(&length.to_le_bytes());
    }
    zstd::encode_all(&raw[..], EFFORT)
}

/// The modules that `is_wanted`, with their values; `None` if the bytes are not such.
pub fn unpack_all(data: &[u8], is_wanted: impl Fn(&str) -> bool) -> Option<Vec<(Box<str>, Values)>> {
    let raw = unpacked(data)?;
    let mut rest = &raw[..];
    let mut nodes = Vec::new();
    while !rest.is_empty() {
        let node = text(&mut rest)?;
        let length = u32::from_le_bytes(*rest.split_off(..4)?.first_chunk()?);
        let values = rest.split_off(..usize::try_from(length).ok()?)?;
        if is_wanted(node) {
            nodes.push((node.into(), values_of(values)?));
        }
    }
    Some(nodes)
}

fn unpacked(data: &[u8]) -> Option<Vec<u8>> {
    let mut raw = Vec::new();
    let read =
        zstd::Decoder::with_buffer(data).and_then(|it| it.take(UNPACKED_MAX + 1).read_to_end(&mut raw));
    read.ok().filter(|&bytes| bytes as u64 <= UNPACKED_MAX).map(|_| raw)
}

fn put_values(raw: &mut Vec<u8>, values: &Values) {
    for (key, points) in values {
        put_text(raw, key);
        raw.extend((points.len() as u16).to_le_bytes());
        raw.extend(points.iter().flat_map(|it| it.place.to_le_bytes()));
        raw.extend(points.iter().flat_map(|it| it.tenths.to_le_bytes()));
        for column in [|it: &Point| it.least, |it: &Point| it.mean, |it: &Point| it.most] {
            raw.extend(points.iter().flat_map(|it| column(it).to_le_bytes()));
        }
    }
}

fn values_of(mut rest: &[u8]) -> Option<Values> {
    let mut values = Values::new();
    while !rest.is_empty() {
        let key = text(&mut rest)?;
        let count = usize::from(u16::from_le_bytes(*rest.split_off(..2)?.first_chunk()?));
        let places = rest.split_off(..2 * count)?.as_chunks().0;
        let mut column = || Some(rest.split_off(..4 * count)?.as_chunks().0);
        let (tenths, least, mean, most) = (column()?, column()?, column()?, column()?);
        let point = |at: usize| Point {
            place: u16::from_le_bytes(places[at]),
            tenths: u32::from_le_bytes(tenths[at]),
            least: f32::from_le_bytes(least[at]),
            mean: f32::from_le_bytes(mean[at]),
            most: f32::from_le_bytes(most[at]),
        };
        values.push((key.into(), (0..count).map(point).collect()));
    }
    Some(values)
}

/// Texts are bounded where they come from.
fn put_text(raw: &mut Vec<u8>, text: &str) {
    raw.extend((text.len() as u16).to_le_bytes());
    raw.extend(text.as_bytes());
}

fn text<'a>(rest: &mut &'a [u8]) -> Option<&'a str> {
    let length = u16::from_le_bytes(*rest.split_off(..2)?.first_chunk()?);
    std::str::from_utf8(rest.split_off(..usize::from(length))?).ok()
}
