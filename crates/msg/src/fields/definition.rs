//! Parses a message definition, `Name.msg`, of ROS 2.

/// The type of a member that is not a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Primitive {
    Bool,
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl Primitive {
    /// Its size on the wire, which is also its alignment.
    pub const fn bytes(self) -> u8 {
        match self {
            Primitive::Bool | Primitive::I8 | Primitive::U8 => 1,
            Primitive::I16 | Primitive::U16 => 2,
            Primitive::I32 | Primitive::U32 | Primitive::F32 => 4,
            Primitive::I64 | Primitive::U64 | Primitive::F64 => 8,
        }
    }

    /// In ROS 2 `char` is a number of 8 bits, and so is `byte`.
    fn from_word(word: &str) -> Option<Primitive> {
        Some(match word {
            "bool" => Primitive::Bool,
            "int8" => Primitive::I8,
            "uint8" | "byte" | "char" => Primitive::U8,
            "int16" => Primitive::I16,
            "uint16" => Primitive::U16,
            "int32" => Primitive::I32,
            "uint32" => Primitive::U32,
            "int64" => Primitive::I64,
            "uint64" => Primitive::U64,
            "float32" => Primitive::F32,
            "float64" => Primitive::F64,
            _ => return None,
        })
    }
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Base {
    Primitive(Primitive),
    Text,
    WideText,
    /// `package/msg/Name`.
    Message(Box<str>),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arity {
    One,
    Fixed(u32),
    /// With or without a bound: on the wire both are the same.
    Sequence,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Member {
    pub name: Box<str>,
    pub base: Base,
    pub arity: Arity,
}

/// Members of one message; no message has more.
const MEMBERS_MAX: usize = 1000;

/// The members of a message of this package, in order. Constants and default values are skipped, because they
/// are not on the wire.
///
/// # Errors
///
/// The first line that is not part of a definition.
pub fn parse(package: &str, text: &str) -> Result<Vec<Member>, String> {
    let mut members: Vec<Member> = Vec::new();
    for (number, line) in text.lines().enumerate() {
        let line = line.split('#').next().unwrap_or_default().trim();
        if line.is_empty() {
            continue;
        }
        let member = member(package, line).map_err(|why| format!("line {}: {why}", number + 1))?;
        let Some(member) = member else { continue };
        if members.iter().any(|known| known.name == member.name) {
            return Err(format!("line {}: `{}` stands here for the second time", number + 1, member.name));
        }
        if members.len() == MEMBERS_MAX {
            return Err(format!("more than {MEMBERS_MAX} fields"));
        }
        members.push(member);
    }
    Ok(members)
}

/// `None` for a constant.
fn member(package: &str, line: &str) -> Result<Option<Member>, String> {
    let (kind, rest) =
        line.split_once(char::is_whitespace).ok_or_else(|| format!("`{line}` has a type and no name"))?;
    let rest = rest.trim_start();
    let end = rest.find(|it: char| !(it.is_ascii_alphanumeric() || it == '_')).unwrap_or(rest.len());
    let (name, after) = rest.split_at(end);
    if !name.starts_with(|it: char| it.is_ascii_alphabetic()) {
        return Err(format!("`{rest}` is no name of a field"));
    }
    let (base, arity) = kind_of(package, kind)?;
    match after.chars().next() {
        Some('=') => return Ok(None),
        Some(it) if !it.is_whitespace() => return Err(format!("`{rest}` is no name of a field")),
        _ if after.trim_start().starts_with('=') => return Ok(None),
        _ => {}
    }
    Ok(Some(Member { name: name.into(), base, arity }))
}

/// A number that a message has a name for, as `uint8 CHARGING=1` says.
#[derive(Debug, Clone, PartialEq)]
pub struct Constant {
    pub name: Box<str>,
    pub primitive: Primitive,
    pub value: i64,
}

/// The whole numbers that a message has names for, in order. More than 1,000 are left out, as are lines that cannot be
/// read.
pub fn constants(text: &str) -> Vec<Constant> {
    let constant = |line: &str| {
        let (declared, value) = line.split('#').next().unwrap_or_default().split_once('=')?;
        let (kind, name) = declared.trim().split_once(char::is_whitespace)?;
        let value = value.trim();
        let value = match value.strip_prefix("0x") {
            Some(digits) => i64::from_str_radix(digits, 16).ok()?,
            None => value.parse().ok()?,
        };
        Some(Constant { name: name.trim().into(), primitive: Primitive::from_word(kind)?, value })
    };
    text.lines().filter_map(constant).take(MEMBERS_MAX).collect()
}

/// `float64`, `string<=10`, `Pose[]`, `pkg/Name[<=5]`, `uint8[36]`.
fn kind_of(package: &str, kind: &str) -> Result<(Base, Arity), String> {
    let (base, arity) = match kind.strip_suffix(']').map(|kind| kind.rsplit_once('[')) {
        None => (kind, Arity::One),
        Some(None) => return Err(format!("`{kind}` has no `[`")),
        Some(Some((base, ""))) => (base, Arity::Sequence),
        Some(Some((base, count))) => {
            let bound = count.strip_prefix("<=");
            let number = bound.unwrap_or(count).parse::<u32>();
            let number = number.ok().filter(|&number| number > 0);
            let number = number.ok_or_else(|| format!("`[{count}]` is no length of an array"))?;
            (base, if bound.is_some() { Arity::Sequence } else { Arity::Fixed(number) })
        }
    };
    let bounded = |word: &str| {
        base.strip_prefix(word).is_some_and(|rest| {
            rest.is_empty() || rest.strip_prefix("<=").is_some_and(|bound| bound.parse::<u32>().is_ok())
        })
    };
    let base = match Primitive::from_word(base) {
        Some(primitive) => Base::Primitive(primitive),
        None if bounded("string") => Base::Text,
        None if bounded("wstring") => Base::WideText,
        None => Base::Message(
            message_name(package, base).ok_or_else(|| format!("`{base}` is no name of a type"))?.into(),
        ),
    };
    Ok((base, arity))
}

/// The full name: `Pose` is of the same package, `package/Pose` of another.
fn message_name(package: &str, name: &str) -> Option<String> {
    let word = |part: &str| {
        part.starts_with(|it: char| it.is_ascii_alphabetic())
            && part.bytes().all(|it| it.is_ascii_alphanumeric() || it == b'_')
    };
    let (package, name) = match name.split('/').collect::<Vec<_>>()[..] {
        [name] => (package, name),
        [package, name] | [package, "msg", name] => (package, name),
        _ => return None,
    };
    (word(package) && word(name)).then(|| format!("{package}/msg/{name}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_names_of_numbers_are_read() {
        let text = "uint8 NONE=0 # nothing\nint32  LOW = -5\nbyte HIGH=0x1F\nstring WORD=\"A=1\"\nfloat32 HALF=0.5\nuint8 state\n";
        let constant = |name: &str, primitive, value| Constant { name: name.into(), primitive, value };
        let expected = [
            constant("NONE", Primitive::U8, 0),
            constant("LOW", Primitive::I32, -5),
            constant("HIGH", Primitive::U8, 31),
        ];
        assert_eq!(constants(text), expected);
    }

    #[test]
    fn every_kind_of_line_is_read() {
        let message = |name: &str| Base::Message(name.into());
        let cases = [
            ("float64 x", Some(("x", Base::Primitive(Primitive::F64), Arity::One))),
            ("  byte   level  # of a status", Some(("level", Base::Primitive(Primitive::U8), Arity::One))),
            ("char c", Some(("c", Base::Primitive(Primitive::U8), Arity::One))),
            ("string name \"a b\"", Some(("name", Base::Text, Arity::One))),
            ("string<=10[<=3] names ['a', \"b\"]", Some(("names", Base::Text, Arity::Sequence))),
            ("wstring<=4 wide", Some(("wide", Base::WideText, Arity::One))),
            ("int32[] numbers [1, 2]", Some(("numbers", Base::Primitive(Primitive::I32), Arity::Sequence))),
            (
                "float64[36] covariance",
                Some(("covariance", Base::Primitive(Primitive::F64), Arity::Fixed(36))),
            ),
            ("Pose pose", Some(("pose", message("own/msg/Pose"), Arity::One))),
            (
                "geometry_msgs/Pose[<=2] poses",
                Some(("poses", message("geometry_msgs/msg/Pose"), Arity::Sequence)),
            ),
            (
                "geometry_msgs/msg/Pose[2] two",
                Some(("two", message("geometry_msgs/msg/Pose"), Arity::Fixed(2))),
            ),
            ("uint8 NONE=0", None),
            ("string WORD = # nothing", None),
            ("# a comment", None),
        ];
        for (line, expected) in cases {
            let expected = expected.map(|(name, base, arity)| Member { name: name.into(), base, arity });
            assert_eq!(parse("own", line), Ok(expected.into_iter().collect()), "{line}");
        }
    }

    #[test]
    fn other_lines_are_refused_with_their_number() {
        for (line, words) in [
            ("float64", "no name"),
            ("float64 1x", "no name of a field"),
            ("float64 a-b", "no name of a field"),
            ("float64[-1] x", "no length"),
            ("float64[99999999999] x", "no length"),
            ("float64[0] x", "no length"),
            ("float64] x", "no `[`"),
            ("a/b/c/d x", "no name of a type"),
            ("../b x", "no name of a type"),
            ("string<=x y", "no name of a type"),
            ("float64 x\nfloat64 x", "second time"),
        ] {
            let error = parse("own", &format!("\n{line}")).unwrap_err();
            assert!(error.contains(words) && error.starts_with("line "), "{line}: {error}");
        }
    }
}
