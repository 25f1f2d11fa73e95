//! The path of a field: `twist.twist.linear.x`, `poses[0].position.x`,
//! `transforms[child_frame_id=base_link].transform`, `status_list[-1].status`, `poses.length`; `detections[].bbox` of each
//! element.

#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Step {
    Member(Box<str>),
    Index(u32),
    /// The last element.
    Last,
    /// All elements.
    Each,
    /// The first element with a member of this value.
    Where {
        key: Vec<Step>,
        value: Box<str>,
    },
}

/// The longest accepted path.
const BYTES_MAX: usize = 1000;

/// # Errors
/// What is wrong with it and how to write it.
pub fn parse(path: &str) -> Result<Vec<Step>, String> {
    if path.len() > BYTES_MAX {
        return Err(format!("it has {} characters; at most {BYTES_MAX} are taken", path.len()));
    }
    let mut steps = Vec::new();
    let mut rest = path;
    loop {
        rest = member(rest, &mut steps)?;
        while let Some(inside) = rest.strip_prefix('[') {
            rest = element(inside, &mut steps)?;
        }
        match rest.strip_prefix('.') {
            Some(after) => rest = after,
            None if rest.is_empty() => return Ok(steps),
            None => return Err(format!("`{rest}` follows where `.` or `[` belongs")),
        }
    }
}

fn member<'a>(text: &'a str, steps: &mut Vec<Step>) -> Result<&'a str, String> {
    let end = text.find(|it: char| !(it.is_ascii_alphanumeric() || it == '_')).unwrap_or(text.len());
    let (name, rest) = text.split_at(end);
    if name.is_empty() {
        return Err(if text.is_empty() {
            "the name of a field is missing at its end".to_owned()
        } else {
            format!("the name of a field is missing before `{text}`")
        });
    }
    steps.push(Step::Member(name.into()));
    Ok(rest)
}

/// The text between brackets; the opening bracket is already read.
fn element<'a>(text: &'a str, steps: &mut Vec<Step>) -> Result<&'a str, String> {
    const WRITE: &str = "write a number from 0 on, `[0]`, `[-1]` for the last, or a field and its value, `[child_frame_id=base_link]`";
    let (inside, rest) = text.split_once(']').ok_or_else(|| format!("`[{text}` has no `]`"))?;
    let step = match inside.split_once('=') {
        None if inside.trim().is_empty() => Step::Each,
        None if inside.trim() == "-1" => Step::Last,
        None => {
            Step::Index(inside.trim().parse().map_err(|_| format!("`[{inside}]` is no element: {WRITE}"))?)
        }
        Some((key, value)) => {
            let key = parse(key.trim()).map_err(|why| format!("`[{inside}]`: {why}"))?;
            if key.iter().any(|step| !matches!(step, Step::Member(_))) {
                return Err(format!("`[{inside}]`: an array cannot be asked for within an array"));
            }
            Step::Where { key, value: unquoted(value.trim()).into() }
        }
    };
    steps.push(step);
    Ok(rest)
}

fn unquoted(value: &str) -> &str {
    let quoted = |quote| value.strip_prefix(quote).and_then(|value| value.strip_suffix(quote));
    quoted('"').or_else(|| quoted('\'')).unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_read() {
        let member = |name: &str| Step::Member(name.into());
        let cases = [
            ("data", vec![member("data")]),
            ("poses[12].position", vec![member("poses"), Step::Index(12), member("position")]),
            (
                "t[header.frame_id = 'a/b.c'].x",
                vec![
                    member("t"),
                    Step::Where { key: vec![member("header"), member("frame_id")], value: "a/b.c".into() },
                    member("x"),
                ],
            ),
            ("a[].b", vec![member("a"), Step::Each, member("b")]),
            ("status_list[-1].status", vec![member("status_list"), Step::Last, member("status")]),
            ("grid[0][1]", vec![member("grid"), Step::Index(0), Step::Index(1)]),
        ];
        for (path, expected) in cases {
            assert_eq!(parse(path), Ok(expected), "{path}");
        }
    }

    #[test]
    fn other_texts_are_refused() {
        for (path, words) in [
            ("", "missing at its end"),
            ("a..b", "missing before"),
            ("a.", "missing at its end"),
            ("a b", "where `.`"),
            ("a[-2]", "from 0 on"),
            ("a[99999999999]", "from 0 on"),
            ("a[0", "no `]`"),
            ("a[b[0]=1]", "from 0 on"),
            ("[0]", "missing before"),
        ] {
            let error = parse(path).unwrap_err();
            assert!(error.contains(words), "{path}: {error}");
        }
        assert!(parse(&"a.".repeat(1000)).is_err());
    }
}
