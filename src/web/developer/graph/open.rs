//! The open groups of the graph, and the addresses that open and close groups.

use crate::engine::snapshot::Layout;
use crate::web::developer::PageQuery;
use crate::web::developer::page_query::address;
use crate::web::view::View;

/// With no more modules than this, all groups are open unless the address says otherwise.
const OPEN_MODULES: usize = 60;

pub(super) enum Open<'a> {
    AllBut(Vec<&'a str>),
    Those(Vec<&'a str>),
}

impl<'a> Open<'a> {
    pub fn of(view: &View<'_>, asked: &'a PageQuery) -> Open<'a> {
        let those: Vec<&str> = asked.all("open").collect();
        let few = view.snapshot.layout.modules.len() <= OPEN_MODULES;
        if those.contains(&"all") || those.is_empty() && few {
            Open::AllBut(asked.all("shut").collect())
        } else {
            Open::Those(those)
        }
    }

    pub fn is(&self, path: &str) -> bool {
        match self {
            Open::AllBut(shut) => !shut.contains(&path),
            Open::Those(those) => those.contains(&path),
        }
    }

    /// The address at which a group is open that is closed now, or the other way round: it names
    /// those that are open or those that are not, whichever are fewer.
    pub fn toggle(&self, layout: &Layout, path: &str) -> String {
        let groups = layout.groups.iter().map(|group| &*group.path);
        let is_open = |known: &&str| self.is(known) != (*known == path);
        let (open, shut): (Vec<&str>, Vec<&str>) = groups.partition(is_open);
        if open.is_empty() {
            address([("open", "none")].into_iter())
        } else if shut.len() < open.len() {
            address([("open", "all")].into_iter().chain(shut.into_iter().map(|path| ("shut", path))))
        } else {
            address(open.into_iter().map(|path| ("open", path)))
        }
    }
}
