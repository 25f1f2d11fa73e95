//! The page of topics in a replay: the messages that the recording holds up to the instant that is shown.

use askama::Template;

use crate::developer::pager::Pager;
use crate::developer::{DevFrame, Page, PageQuery, frame};
use crate::incidents::wall_time;
use crate::texts::{Lang, MESSAGE, NAME, clean};
use crate::view::page::frame::PageFrame;
use crate::view::{PageContext, View, html};
use telltale_clock::unix_ms;
use telltale_replay::{FlowThen, Flows};
use telltale_runtime::Published;

use super::{RENEW_MS, ROWS, TypeParts, broken};

struct Row {
    name: String,
    broken: String,
    type_parts: TypeParts,
    rate: String,
    flow: String,
    messages: u64,
    /// When the last one came, and how many seconds before; `None`: there was none yet.
    last: Option<(String, String)>,
}

#[derive(Template)]
#[template(path = "developer/topics_then.html")]
struct TopicsThenHtml {
    frame: PageFrame,
    dev: DevFrame,
    filter: String,
    pager: Pager,
    rows: Vec<Row>,
}

pub fn page(published: &Published, context: &PageContext, query: &PageQuery, flows: &Flows) -> String {
    let view = &View::new(published, context.lang, false);
    let filter = query.get("q").to_lowercase();
    let at_ms = unix_ms(published.at);
    // The instant that is shown lies within its millisecond.
    let at_ns = u64::try_from(at_ms).unwrap_or(0).saturating_add(1).saturating_mul(1_000_000);
    let mut topics = flows.at(at_ns);
    let holds = |text: &str| text.to_lowercase().contains(&filter);
    topics.retain(|it| filter.is_empty() || holds(&it.topic) || holds(&it.type_name));
    let (pager, shown) = Pager::of(query, "matching", "page", topics.len(), ROWS);
    html(&TopicsThenHtml {
        frame: frame(context),
        dev: DevFrame::new(view, context, Page::Topics, RENEW_MS),
        filter: clean(query.get("q"), MESSAGE),
        pager,
        rows: topics[shown].iter().map(|topic| row(view.lang, topic, at_ms)).collect(),
    })
}

fn row(lang: Lang, then: &FlowThen, at_ms: i64) -> Row {
    let last = then.last_ns.map(|ns| i64::try_from(ns / 1_000_000).unwrap_or(i64::MAX));
    let is_flowing = then.rate_hz > 0.0;
    Row {
        name: clean(&then.topic, 2 * NAME),
        broken: broken(&then.topic),
        type_parts: TypeParts::of(&then.type_name),
        rate: if is_flowing { lang.decimals(&format!("{:.1} Hz", then.rate_hz)) } else { String::new() },
        flow: if is_flowing { format!("{}/s", lang.size(then.bytes_per_s as u64)) } else { String::new() },
        messages: then.messages,
        last: last.map(|last_ms| {
            let before_ms = at_ms.saturating_sub(last_ms).max(0);
            (wall_time(last_ms), lang.decimals(&format!("{}.{} s", before_ms / 1000, before_ms % 1000 / 100)))
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view::Palette;
    use crate::view::tests::{context, jump};
    use telltale_record::file::Channel;

    #[test]
    fn a_topic_is_shown_as_it_was_then_and_its_name_is_text() {
        let mut flows = Flows::default();
        let published = jump().published();
        let at_ns = unix_ms(published.at) as u64 * 1_000_000;
        for tick in (0..100).rev() {
            flows.count(&Channel::cdr("/<b>", "t/msg/T", None), at_ns - tick * 100_000_000, 500, true);
        }
        flows.count(&Channel::cdr("/later", "t/msg/T", None), at_ns + 5_000_000_000, 1, true);
        let context = context(Lang::En, Palette::Night);
        let html = page(&published, &context, &PageQuery::default(), &flows);
        for part in ["/&#60;b&#62;", "10.0 Hz", "5.0 kB/s", "no message yet"] {
            assert!(html.contains(part), "{part}: {html}");
        }
        let asked = PageQuery::of(vec![("q".to_owned(), "LATER".to_owned())]);
        assert!(!page(&published, &context, &asked, &flows).contains("10.0 Hz"));
    }
}
