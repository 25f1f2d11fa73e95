//! Names in a keyframe: those that are not declared, and the writers of all.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::{Names, Route};
use crate::files::{KeyframeError, count};
use crate::model::{GroupId, ModuleId};
use crate::module::writers::WriterReports;

#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct KeptNames {
    #[serde(deserialize_with = "count")]
    seen: u64,
    /// In the order of their first receipt.
    routes: Vec<KeptRoute>,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
struct KeptRoute {
    name: Arc<str>,
    #[serde(deserialize_with = "count")]
    number: u64,
    /// The discovered modules that it feeds.
    made: Vec<ModuleId>,
    lacking: bool,
    dropped_by: Vec<GroupId>,
    /// Its modules were made at the word of a node that is not known yet.
    unproven: bool,
    writers: WriterReports,
}

impl Names {
    /// `fixed`: the number of modules that follow from the configuration.
    pub(crate) fn kept(&self, fixed: usize) -> KeptNames {
        let Names {
            index,
            routes,
            seen,
            unproven,
            // From the configuration.
            discovered_max: _,
            // From the routes. Their indices mean nothing outside of this.
            free: _,
            of_module: _,
            bytes: _,
            // They are matched again.
            dropped: _,
        } = self;
        let kept = |route: &u32| {
            let Route {
                name,
                number,
                first: _,
                more: _,
                lacking,
                dropped_by,
                writer_reports,
                // It only saves the groups from being asked again.
                counted: _,
                // About one array, which is over.
                array: _,
                position: _,
                overruled: _,
                // A guess, which only saves time.
                next: _,
            } = &routes[*route as usize];
            let made = self.modules(*route).filter(|id| id.0 as usize >= fixed).collect();
            let (name, writers) = (name.clone(), writer_reports.clone());
            let (dropped_by, unproven) = (dropped_by.clone(), unproven.contains(route));
            KeptRoute { name, number: *number, made, lacking: *lacking, dropped_by, unproven, writers }
        };
        let says_more = |it: &KeptRoute| !it.made.is_empty() || it.lacking || !it.writers.is_empty();
        let mut routes: Vec<KeptRoute> = index.values().map(kept).filter(says_more).collect();
        routes.sort_unstable_by_key(|route| route.number);
        KeptNames { seen: *seen, routes }
    }

    /// Goes on with the state of a keyframe.
    pub(crate) fn resume(
        &mut self,
        kept: KeptNames,
        is_discovered: impl Fn(ModuleId) -> bool,
    ) -> Result<(), KeyframeError> {
        let KeptNames { seen, routes } = kept;
        // Those that lack a module are named.
        self.routes.iter_mut().for_each(|route| route.lacking = false);
        for KeptRoute { name, number, made, lacking, dropped_by, unproven, writers } in routes {
            for module in made {
                if !is_discovered(module) || self.of_module.contains_key(&module) {
                    let what = format!("the status {name:?} feeds a module that was not discovered by it");
                    return Err(KeyframeError::new(what));
                }
                self.discovered(&name, module);
            }
            let Some(route) = self.find(&name) else {
                return Err(KeyframeError::new(format!("the status {name:?} feeds no module")));
            };
            if unproven {
                self.doubt(route);
            }
            let route = &mut self.routes[route as usize];
            route.dropped_by = dropped_by;
            (route.number, route.lacking, route.writer_reports) = (number, lacking, writers);
        }
        self.seen = seen;
        Ok(())
    }
}
