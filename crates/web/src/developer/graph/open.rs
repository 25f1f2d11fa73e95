//! The open groups of the graph, and the addresses that open and close groups.

use crate::developer::PageQuery;
use crate::developer::page_query::address;
use crate::view::View;
use telltale_engine::snapshot::Layout;

/// With no more modules than this, all groups but Telltale's own are open unless the address says otherwise.
const OPEN_MODULES: usize = 60;

pub(super) enum OpenGroups<'a> {
    AllBut(Vec<&'a str>),
    Only(Vec<&'a str>),
}

impl<'a> OpenGroups<'a> {
    pub fn of(view: &'a View<'_>, query: &'a PageQuery) -> OpenGroups<'a> {
        let those: Vec<&str> = query.all("open").collect();
        let layout = &view.snapshot.layout;
        if those.contains(&"all") {
            OpenGroups::AllBut(query.all("shut").collect())
        } else if those.is_empty() && layout.modules.len() <= OPEN_MODULES {
            let own = layout.groups.iter().filter(|group| group.is_system);
            OpenGroups::AllBut(own.map(|group| &*group.path).collect())
        } else {
            OpenGroups::Only(those)
        }
    }

    pub fn is(&self, path: &str) -> bool {
        match self {
            OpenGroups::AllBut(shut) => !shut.contains(&path),
            OpenGroups::Only(those) => those.contains(&path),
        }
    }

    /// The address at which a group is open that is closed now, or the other way round: it names
    /// those that are open or those that are not: the shorter list.
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
