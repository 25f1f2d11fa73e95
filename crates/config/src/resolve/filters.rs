//! Filters, and the detection of filters that can never match.

use std::collections::HashSet;

use regex_automata::Anchored;
use regex_automata::dfa::{Automaton, StartKind, dense};
use regex_automata::util::start;
use regex_syntax::hir::Hir;

use super::names::Names;
use crate::file::{self, FilterKind};
use crate::glob;
use telltale_engine::model::filter::Filter;
use telltale_engine::model::{Match, Policy, Prefixes};
use telltale_yaml::{Log, Problem, Span};

/// Larger automata are not examined.
const AUTOMATON_BYTES_MAX: usize = 1 << 20;

pub(crate) fn filters(raw: &[file::Filter], names: &Names, defaults: &Policy, log: &mut Log) -> Vec<Match> {
    let mut filters: Vec<(Filter, Span)> = Vec::new();
    let mut matches = Vec::new();
    for filter in raw {
        let except: Vec<(Filter, Span)> =
            filter.except.iter().filter_map(|it| Some((resolve(it, log)?, it.span))).collect();
        let resolved = filter.pattern.as_ref().and_then(|pattern| Some((pattern, resolve(pattern, log)?)));
        let policy = policy(filter, defaults, log);
        let Some((pattern, resolved)) = resolved else { continue };
        if let Some((_, first)) = filters.iter().find(|(earlier, _)| covers(earlier, &resolved)) {
            let problem = Problem::at(filter.span, "this filter takes nothing that an earlier one leaves");
            log.push(
                problem.label("never used").also(*first, "this one is first").help("remove one of the two"),
            );
        }
        if let Some((_, all)) = except.iter().find(|(exception, _)| covers(exception, &resolved)) {
            let problem = Problem::at(filter.span, "this filter takes nothing that its `except` leaves");
            log.push(problem.label("never used").also(*all, "this takes all").help("remove one of the two"));
        }
        if pattern.kind == FilterKind::Name
            && let Some(module) = names.claimed_by(&pattern.text.value)
        {
            let text = format!("the declared module `{}` takes this status before any filter", module.path);
            let also = module.status().map_or(filter.span, |status| status.span);
            log.push(
                Problem::at(filter.span, text)
                    .label("never used")
                    .also(also, "taken here")
                    .help("remove the filter"),
            );
        }
        // With exceptions, an entry leaves names for later ones.
        if except.is_empty() {
            filters.push((resolved.clone(), filter.span));
        }
        let except = except.into_iter().map(|(exception, _)| exception).collect();
        matches.push(Match { filter: resolved, except, prefixes: prefixes(filter), policy });
    }
    matches
}

/// `None`: that of all discovered modules.
fn policy(filter: &file::Filter, defaults: &Policy, log: &mut Log) -> Option<Policy> {
    let file::Policy { timeout, stale, forget_after, .. } = &filter.policy;
    let differs = timeout.is_some() || stale.is_some() || forget_after.is_some();
    let writers = super::writers(filter.writers.as_ref(), log);
    (differs || writers.is_some()).then(|| {
        let policy = super::policy(&filter.policy, defaults, log);
        Policy { writers, ..policy }
    })
}

pub(crate) fn prefixes(filter: &file::Filter) -> Prefixes {
    filter.prefixes.iter().map(|prefix| prefix.as_str().into()).collect()
}

/// The filter for a pattern; `None` if the log has the reason.
pub(crate) fn resolve(filter: &file::Pattern, log: &mut Log) -> Option<Filter> {
    let text: Box<str> = filter.text.value.as_str().into();
    match filter.kind {
        FilterKind::Name => Some(Filter::Name(text)),
        FilterKind::Namespace => Some(Filter::Namespace(text)),
        FilterKind::Contains => Some(Filter::Contains(text)),
        FilterKind::Regex => regex(filter, log),
    }
}

fn regex(filter: &file::Pattern, log: &mut Log) -> Option<Filter> {
    let pattern = &filter.text.value;
    let span = filter.text.span;
    let hir = match regex_syntax::parse(pattern) {
        Ok(hir) => hir,
        Err(error) => {
            let (what, at) = syntax(&error);
            let problem =
                Problem::at(point(span, pattern, at), format!("this is no regular expression: {what}"));
            // A `?` that repeats nothing does not belong to a regular expression.
            let is_glob = pattern.contains(['*', '?']) && is_glob(&pattern.replace('?', ""));
            log.push(problem.help(match is_glob {
                true => format!("it looks like a pattern of file names: write {}", glob::instead(pattern)),
                false => format!("see character {} of the expression", at + 1),
            }));
            return None;
        }
    };
    if let Some((at, letter)) = repeated(pattern) {
        let text = format!("in a regular expression `{letter}*` is any number of `{letter}`");
        log.push(
            Problem::at(point(span, pattern, at), text)
                .help(format!("write {}; if it is meant so, `(?:{letter})*`", glob::instead(pattern))),
        );
    }
    if never_matches(&hir, pattern) {
        let problem = Problem::at(span, "this regular expression can never match").label("matches nothing");
        log.push(problem.help("remove the filter, or what contradicts itself in the expression"));
    }
    match Filter::regex(pattern) {
        Ok(filter) => Some(filter),
        Err(error) => {
            let problem = Problem::at(span, format!("this regular expression cannot be used: {error}"));
            log.push(problem.help("make it shorter"));
            None
        }
    }
}

/// Whether it contains nothing that only regular expressions have.
fn is_glob(pattern: &str) -> bool {
    !pattern.contains(['.', '+', '?', '(', ')', '[', ']', '{', '}', '|', '\\', '^', '$'])
}

/// The letter before a `*`, and the index of the `*`, in a text that looks like a shell pattern.
fn repeated(pattern: &str) -> Option<(usize, char)> {
    let letters: Vec<char> = pattern.chars().collect();
    let star = letters.iter().position(|&letter| letter == '*').filter(|_| is_glob(pattern))?;
    let letter = *letters.get(star.checked_sub(1)?)?;
    (letter.is_alphanumeric() || letter == '/').then_some((star, letter))
}

/// The error, and the index of its character.
fn syntax(error: &regex_syntax::Error) -> (String, usize) {
    match error {
        regex_syntax::Error::Parse(error) => (error.kind().to_string(), error.span().start.column - 1),
        regex_syntax::Error::Translate(error) => (error.kind().to_string(), error.span().start.column - 1),
        _ => (error.to_string(), 0),
    }
}

/// The place of a character of an expression; the whole expression if quotes or escapes shift it.
fn point(span: Span, pattern: &str, at: usize) -> Span {
    let written = (span.end - span.start) as usize;
    let quote = match written.checked_sub(pattern.len()) {
        Some(0) => 0,
        Some(2) => 1,
        _ => return span,
    };
    let before: usize = pattern.chars().take(at).map(char::len_utf8).sum();
    let start = span.start + (quote + before) as u32;
    let length = pattern[before..].chars().next().map_or(0, char::len_utf8) as u32;
    Span { start, end: start + length, ..span }
}

/// An expression without a shortest match never matches, nor does one whose automaton never accepts.
fn never_matches(hir: &Hir, pattern: &str) -> bool {
    hir.properties().minimum_len().is_none() || accepts_nothing(pattern) == Some(true)
}

/// Walks every state of the automaton. `None` if it is too large, or cannot be built because of a word border
/// that depends on more than one byte.
fn accepts_nothing(pattern: &str) -> Option<bool> {
    let config = dense::Config::new()
        .dfa_size_limit(Some(AUTOMATON_BYTES_MAX))
        .determinize_size_limit(Some(AUTOMATON_BYTES_MAX))
        .start_kind(StartKind::Anchored);
    let dfa = dense::Builder::new().configure(config).build(&format!(r"\A(?:{pattern})\z")).ok()?;
    let start = dfa.start_state(&start::Config::new().anchored(Anchored::Yes)).ok()?;
    let mut seen = HashSet::from([start]);
    let mut waiting = vec![start];
    while let Some(state) = waiting.pop() {
        if dfa.is_match_state(state) {
            return Some(false);
        }
        let next = (0..=u8::MAX).map(|byte| dfa.next_state(state, byte)).chain([dfa.next_eoi_state(state)]);
        waiting.extend(next.filter(|&state| seen.insert(state)));
    }
    Some(true)
}

/// Whether the first matches every name that the second matches, as far as their texts show.
pub(crate) fn covers(first: &Filter, second: &Filter) -> bool {
    match (first, second) {
        (Filter::Regex(a), Filter::Regex(b)) => a.as_str() == b.as_str(),
        (_, Filter::Name(name)) => first.matches(name),
        (Filter::Contains(part), Filter::Namespace(text) | Filter::Contains(text)) => text.contains(&**part),
        (Filter::Namespace(_), Filter::Namespace(prefix)) => first.matches(prefix),
        _ => false,
    }
}
