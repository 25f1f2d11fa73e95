//! Filters: which received statuses belong to a group (paper, Sec. IV-A).

use std::sync::Arc;

use regex::Regex;

use super::Policy;

/// Which names are meant.
#[derive(Debug, Clone)]
pub enum Filter {
    /// The exact name.
    Name(Box<str>),
    /// Names that begin with this at a `/` or `:` border: `/sensors` takes `/sensors` and
    /// `/sensors/imu`, not `/sensors2`.
    Namespace(Box<str>),
    /// Names that contain this.
    Contains(Box<str>),
    /// Names that this matches in full.
    Regex(Regex),
}

impl Filter {
    /// A filter by a regular expression, which must match the whole name.
    ///
    /// # Errors
    ///
    /// The expression's own syntax error.
    pub fn regex(pattern: &str) -> Result<Filter, regex::Error> {
        // The pattern is parsed alone first: inside the anchors, an unbalanced `)` could escape them.
        Regex::new(pattern)?;
        Regex::new(&format!(r"\A(?:{pattern})\z")).map(Filter::Regex)
    }

    pub fn matches(&self, name: &str) -> bool {
        match self {
            Filter::Name(exact) => name == &**exact,
            Filter::Namespace(prefix) => {
                let border = |byte: &u8| matches!(byte, b'/' | b':');
                name.strip_prefix(&**prefix).is_some_and(|rest| {
                    rest.is_empty()
                        || rest.as_bytes().first().is_some_and(border)
                        || prefix.as_bytes().last().is_some_and(border)
                })
            }
            Filter::Contains(part) => name.contains(&**part),
            Filter::Regex(regex) => regex.is_match(name),
        }
    }
}

impl PartialEq for Filter {
    fn eq(&self, other: &Filter) -> bool {
        match (self, other) {
            (Filter::Name(a), Filter::Name(b))
            | (Filter::Namespace(a), Filter::Namespace(b))
            | (Filter::Contains(a), Filter::Contains(b)) => a == b,
            (Filter::Regex(a), Filter::Regex(b)) => a.as_str() == b.as_str(),
            (Filter::Name(_) | Filter::Namespace(_) | Filter::Contains(_) | Filter::Regex(_), _) => false,
        }
    }
}

/// One entry of a group's `match` list.
#[derive(Debug, Clone, PartialEq)]
pub struct Match {
    pub filter: Filter,
    /// Names that the filter matches and does not take.
    pub except: Vec<Filter>,
    /// Left out at the beginning of the names that people read.
    pub prefixes: Prefixes,
    /// The policy of the modules that it claims; `None`: [`Parts::discovered`](super::Parts::discovered).
    pub policy: Option<Policy>,
}

impl Match {
    pub fn takes(&self, name: &str) -> bool {
        self.filter.matches(name) && !self.except.iter().any(|filter| filter.matches(name))
    }
}

impl From<Filter> for Match {
    fn from(filter: Filter) -> Match {
        Match { filter, except: Vec::new(), prefixes: Prefixes::default(), policy: None }
    }
}

/// Beginnings of status names, in the order in which they are left out.
pub type Prefixes = Arc<[Box<str>]>;

/// The policy for the statuses that no group claims, in addition to [`Other`](super::Other).
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Unclaimed {
    /// `None`: [`Parts::discovered`](super::Parts::discovered).
    pub policy: Option<Policy>,
    /// Statuses that are dropped.
    pub except: Vec<Filter>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(filter: &Filter, takes: &[&str], leaves: &[&str]) {
        for name in takes {
            assert!(filter.matches(name), "{filter:?} should take {name}");
        }
        for name in leaves {
            assert!(!filter.matches(name), "{filter:?} should leave {name}");
        }
    }

    #[test]
    fn a_name_is_exact() {
        check(
            &Filter::Name("imu: status".into()),
            &["imu: status"],
            &["imu: status2", "imu", "a imu: status"],
        );
    }

    #[test]
    fn a_namespace_ends_at_a_border() {
        check(
            &Filter::Namespace("/sensors".into()),
            &["/sensors", "/sensors/imu", "/sensors: rate"],
            &["/sensors2", "/a/sensors", "sensors/imu", "/sensor"],
        );
        check(&Filter::Namespace("/sensors/".into()), &["/sensors/imu"], &["/sensors"]);
    }

    #[test]
    fn a_part_may_stand_anywhere() {
        check(&Filter::Contains("lidar".into()), &["lidar", "front lidar: x"], &["LIDAR", "lida"]);
    }

    #[test]
    fn an_expression_matches_the_whole_name() {
        let filter = Filter::regex("velodyne_.*|ouster").unwrap();
        check(&filter, &["velodyne_a", "velodyne_", "ouster"], &["my velodyne_a", "ouster2", "velodyne"]);
    }

    #[test]
    fn an_expression_cannot_escape_its_anchors() {
        assert!(Filter::regex("a)|(b").is_err());
    }
}
