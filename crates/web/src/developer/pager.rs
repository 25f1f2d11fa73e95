//! Divides long tables into pages, with links to the others.

use std::ops::Range;

use super::PageQuery;

/// Rows of a table that is made for a file.
pub const ROWS_MAX: usize = 5000;

pub struct Pager {
    /// The `id` of the element that has the number of rows.
    pub id: &'static str,
    /// Counted from 1; 0 where there is nothing.
    pub first: usize,
    pub last: usize,
    pub count: usize,
    pub previous: Option<String>,
    pub next: Option<String>,
}

impl Pager {
    /// The page that the address names in `field`, or the nearest that exists, with the range of its rows.
    pub fn of(
        query: &PageQuery,
        id: &'static str,
        field: &str,
        count: usize,
        rows: usize,
    ) -> (Pager, Range<usize>) {
        let rows = if query.wants_all_rows() { ROWS_MAX } else { rows };
        let pages = count.div_ceil(rows).max(1);
        let wanted = usize::try_from(query.number(field).unwrap_or(1)).unwrap_or(pages);
        let page = wanted.clamp(1, pages);
        let shown = (page - 1) * rows..(page * rows).min(count);
        let to = |page: usize| query.with(field, &page.to_string());
        let pager = Pager {
            id,
            first: if count == 0 { 0 } else { shown.start + 1 },
            last: shown.end,
            count,
            previous: (page > 1).then(|| to(page - 1)),
            next: (page < pages).then(|| to(page + 1)),
        };
        (pager, shown)
    }

    /// Whether there is more than one page.
    pub fn is_needed(&self) -> bool {
        self.previous.is_some() || self.next.is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_has_many_rows_and_no_address_asks_for_them() {
        let asked = |query: PageQuery| Pager::of(&query, "", "page", 20_000, 10).1;
        let named = || PageQuery::of(vec![("rows".to_owned(), "20000".to_owned())]);
        assert_eq!(asked(named()), 0..10);
        assert_eq!(asked(named().of_all_rows()), 0..ROWS_MAX);
    }

    #[test]
    fn every_row_is_on_one_page_and_no_page_is_beyond() {
        for (page, count, shown, first, ways) in [
            ("", 0, 0..0, 0, (false, false)),
            ("1", 10, 0..10, 1, (false, false)),
            ("1", 11, 0..10, 1, (false, true)),
            ("2", 21, 10..20, 11, (true, true)),
            ("3", 21, 20..21, 21, (true, false)),
            ("99999999999999999999", 21, 0..10, 1, (false, true)),
            ("18446744073709551615", 21, 20..21, 21, (true, false)),
            ("0", 21, 0..10, 1, (false, true)),
        ] {
            let query = PageQuery::of(vec![("page".to_owned(), page.to_owned())]);
            let (pager, range) = Pager::of(&query, "", "page", count, 10);
            let has = (pager.previous.is_some(), pager.next.is_some());
            assert_eq!((range, pager.first, has), (shown, first, ways), "{page} of {count}");
        }
    }
}
