//! The entries of a group's `match` list in the file: the statuses that become modules of the group.

use super::policy::Policy;
use crate::decode::{All, FromNode, Spanned};
use crate::fields::Fields;
use crate::file::forms::WRITERS;
use crate::glob::{self, is_glob};
use telltale_yaml::decode::{did_you_mean, scalar};
use telltale_yaml::schema::{needs_any, needs_one, not_empty, of_type, one_of};
use telltale_yaml::{Kind, Log, Members, Node, Problem, Schema, Span, key, map, suggest};

#[derive(Debug)]
pub(crate) struct Filter {
    pub span: Span,
    /// `None`: it only expects statuses.
    pub pattern: Option<Pattern>,
    /// Names that it leaves.
    pub except: Vec<Pattern>,
    /// Left out at the beginning of the names that people read.
    pub prefixes: Vec<String>,
    /// Names of statuses that must come.
    pub expected: Vec<Spanned<String>>,
    /// The policy of the modules that it makes.
    pub policy: Policy,
    pub writers: Option<Writers>,
}

/// The nodes whose reports of a status count.
pub(crate) type Writers = Spanned<All<Spanned<String>>>;

/// The rule for names.
#[derive(Debug)]
pub(crate) struct Pattern {
    pub span: Span,
    pub kind: FilterKind,
    pub text: Spanned<String>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum FilterKind {
    Name,
    Namespace,
    Contains,
    Regex,
}

const KINDS: [(&str, FilterKind); 4] = [
    ("name", FilterKind::Name),
    ("namespace", FilterKind::Namespace),
    ("contains", FilterKind::Contains),
    ("regex", FilterKind::Regex),
];

impl FromNode for Filter {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let doc = map("filter", "a filter").rules(|| {
            vec![needs_any(&[&["name"], &["namespace"], &["contains"], &["regex"], &["expected"]])]
        });
        let mut fields = Fields::of(node, doc, log)?;
        may_have_kinds(&mut fields);
        let except = fields.or_default(key("except").about("Names that this entry leaves to others."));
        let prefixes = key("prefix").about(
            "Left out at the beginning of the names that people read, with a `:` and the spaces behind it. Several are left out one after the other. A `/` is like a space.",
        );
        let prefixes = fields.optional::<OneOrMore>(prefixes).map(|OneOrMore(all)| all).unwrap_or_default();
        let expected = key("expected")
            .about("Exact names of statuses that must come: each is a module from the start. Other groups take them too.")
            .rules(not_empty);
        let expected: Vec<Spanned<String>> = fields.or_default(expected);
        let policy = Policy::of_filter(&mut fields);
        let writers = fields.optional(WRITERS);
        let pattern = match pattern(&mut fields, node) {
            Found::One(pattern) => Some(pattern),
            Found::None if fields.key_span("expected").is_some() => None,
            Found::None if let Some(problem) = unknown(&fields, node) => {
                fields.refuse(problem);
                return None;
            }
            Found::None | Found::Several => {
                without_kind(node.span, fields.log);
                return None;
            }
            Found::Unreadable => return None,
        };
        Some(Filter { span: node.span, pattern, except, prefixes, expected, policy, writers })
    }
}

impl FromNode for Pattern {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let doc = map("exception", "an exception")
            .rules(|| vec![needs_one(&[&["name"], &["namespace"], &["contains"], &["regex"]])]);
        let mut fields = Fields::of(node, doc, log)?;
        may_have_kinds(&mut fields);
        let found = pattern(&mut fields, node);
        match found {
            Found::None if let Some(problem) = unknown(&fields, node) => {
                fields.refuse(problem);
                return None;
            }
            Found::None | Found::Several => without_kind(node.span, fields.log),
            Found::One(_) | Found::Unreadable => {}
        }
        if let Found::One(pattern) = found { Some(pattern) } else { None }
    }
}

fn without_kind(span: Span, log: &mut Log) {
    let text = "a filter needs one of `name`, `namespace`, `contains`, `regex`";
    log.push(Problem::at(span, text).help("write one filter for each: `- { namespace: /sensors }`"));
}

fn may_have_kinds(fields: &mut Fields) {
    fields.may_have::<String>(key("name").about("The exact name."));
    fields.may_have::<String>(key("namespace").about("Names that begin with this at a `/` or `:`."));
    fields.may_have::<String>(key("contains").about("Names that contain this."));
    fields.may_have::<String>(
        key("regex").about("Names that this matches as a whole.").rules(|| vec![("format", "regex".into())]),
    );
}

/// The kinds that a map names.
enum Found {
    None,
    One(Pattern),
    Unreadable,
    Several,
}

fn pattern(fields: &mut Fields, node: &Node) -> Found {
    let named: Vec<_> = KINDS.into_iter().filter(|(key, _)| fields.node(*key).is_some()).collect();
    match named[..] {
        [] => Found::None,
        [(key, kind)] => match fields.optional(key) {
            Some(text) => Found::One(Pattern { span: node.span, kind, text }),
            None => Found::Unreadable,
        },
        _ => Found::Several,
    }
}

/// The help for an unknown filter: users bring names from other tools.
fn unknown(fields: &Fields, filter: &Node) -> Option<Problem> {
    let Kind::Mapping(entries) = &filter.kind else { return None };
    // Alone, `prefix` is meant as a filter.
    let is_unknown = |key: &str| !fields.knows(key) || key == "prefix";
    let (key, node) = entries.iter().find(|(key, _)| is_unknown(&key.text))?;
    let text = scalar(node).unwrap_or("...");
    let escaped = || regex_syntax::escape(text);
    let plain = key.text.to_lowercase().replace(['_', '-'], "");
    let help = match plain.as_str() {
        "startswith" | "beginswith" | "prefix" => format!(
            "write `namespace: {text}` for names that begin with it up to a `/` or `:`, or `regex: '{}.*'` for any",
            escaped()
        ),
        "endswith" | "suffix" => format!("write `regex: '.*{}'`", escaped()),
        "glob" | "pattern" | "wildcard" | "fnmatch" | "like" if is_glob(text) => {
            format!("write {}", glob::instead(text))
        }
        "pattern" | "regexp" | "re" | "matches" => format!("write `regex: '{text}'`"),
        "glob" | "wildcard" | "fnmatch" | "like" | "includes" | "substring" => {
            format!("write `contains: {text}`")
        }
        "equals" | "exact" | "is" | "status" | "id" => format!("write `name: {text}`"),
        _ => did_you_mean(suggest(&key.text, ["name", "namespace", "contains", "regex"])?),
    };
    Some(Problem::at(key.span, format!("there is no filter `{}`", key.text)).help(help))
}

/// One text, or a list of them.
#[derive(Debug)]
struct OneOrMore(Vec<String>);

impl FromNode for OneOrMore {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        match node.kind {
            Kind::Sequence(_) => Vec::from_node(node, log).map(OneOrMore),
            _ => String::from_node(node, log).map(|text| OneOrMore(vec![text])),
        }
    }

    fn form(_: &mut Schema) -> Members {
        one_of([of_type("string"), telltale_yaml::schema::list(of_type("string"))])
    }
}
