//! The views in a keyframe: the texts, the names of discovered modules, and since when each node shows its
//! state. The states are those of the net, and the roots are searched again.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::Views;
use super::members::{Told, made};
use crate::discovery::WriterId;
use crate::files::{KeyframeError, count};
use crate::mask::net::Net;
use crate::mask::node::ModuleKind;
use crate::model::{GroupId, ModuleId};
use crate::snapshot::{ModuleInfo, Reception, Report};
use crate::text::Text;
use crate::time::Timestamp;

#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct KeptViews {
    #[serde(deserialize_with = "count")]
    seq: u64,
    #[serde(deserialize_with = "count")]
    revision: u64,
    seq_changed: bool,
    revision_changed: bool,
    /// By [`GroupId`].
    groups: Vec<KeptGroup>,
    /// By [`ModuleId`].
    modules: Vec<KeptModule>,
    /// The modules that do not follow from the configuration: the last of `modules`.
    made: Vec<MadeName>,
    reception: Vec<Reception>,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
struct KeptGroup {
    since: Timestamp,
    hint: Option<Text>,
    /// Its members that do not follow from the configuration, in order.
    made: Vec<ModuleId>,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
struct KeptModule {
    since: Timestamp,
    writer: WriterId,
    /// `None`: empty.
    report: Option<Arc<Report>>,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
struct MadeName {
    name: Arc<str>,
    status: Option<Arc<str>>,
    #[serde(deserialize_with = "count")]
    number: u64,
}

impl KeptViews {
    /// The made modules of each group, in order.
    pub(crate) fn members(&self) -> impl Iterator<Item = &[ModuleId]> {
        self.groups.iter().map(|group| &*group.made)
    }
}

impl Views {
    /// `fixed`: the number of modules that follow from the configuration.
    pub(crate) fn kept(&self, fixed: usize) -> KeptViews {
        let Views {
            seq,
            revision,
            layout,
            groups,
            modules,
            reception,
            reports,
            budget,
            seq_changed,
            revision_changed,
            // From the names, the net and the rest of the engine.
            names: _,
            roots: _,
            alarms: _,
            vehicle: _,
            motion: _,
            signals: _,
            overall: _,
            stage: _,
            operator: _,
            unexplained: _,
            masked_root: _,
            // The ages of all reports are updated after loading.
            heard: _,
            is_heard: _,
        } = self;
        let is_made = |id: &&ModuleId| id.0 as usize >= fixed;
        let group = |(view, info): (&crate::snapshot::GroupView, &crate::snapshot::GroupInfo)| {
            let made = info.modules.iter().filter(is_made).copied().collect();
            KeptGroup { since: view.since, hint: info.hint.clone(), made }
        };
        let module = |(view, id): (&crate::snapshot::ModuleView, u32)| KeptModule {
            since: view.since,
            writer: budget.source(ModuleId(id)),
            report: Some(&reports[id as usize]).filter(|it| ***it != Report::default()).cloned(),
        };
        let name = |info: &Arc<ModuleInfo>| MadeName {
            name: info.id.clone(),
            status: info.status.clone(),
            number: info.number,
        };
        KeptViews {
            seq: *seq,
            revision: *revision,
            seq_changed: *seq_changed,
            revision_changed: *revision_changed,
            groups: groups.iter().zip(&layout.groups).map(group).collect(),
            modules: modules.iter().zip(0..).map(module).collect(),
            made: layout.modules[fixed..].iter().map(name).collect(),
            reception: reception.to_vec(),
        }
    }

    /// Takes over the names and texts of a keyframe; the net has its modules already.
    pub(crate) fn resume_names(
        &mut self,
        kept: &KeptViews,
        net: &Net,
        now: Timestamp,
    ) -> Result<(), KeyframeError> {
        KeyframeError::unless_same("groups", kept.groups.len(), net.groups.len())?;
        KeyframeError::unless_same("modules", kept.modules.len(), net.modules.len())?;
        KeyframeError::unless_same("names", kept.made.len(), net.modules.len() - net.fixed())?;
        let layout = Arc::make_mut(&mut self.layout);
        for (info, group) in layout.groups.iter_mut().zip(&kept.groups) {
            info.modules.extend(&group.made);
            info.hint.clone_from(&group.hint);
        }
        for (id, MadeName { name, status, number }) in (net.fixed() as u32..).zip(&kept.made) {
            let module = &net.modules[id as usize];
            let gone = module.kind == ModuleKind::Gone;
            if !gone && !Arc::make_mut(&mut self.names).insert(name.clone()) {
                return Err(KeyframeError::new(format!("two nodes have the name {name:?}")));
            }
            let group = module.node.parent.unwrap_or(GroupId(0));
            let told = Told::of(net, ModuleId(id), status.clone());
            let info = made(name.clone(), *number, group, told);
            layout.modules.push(Arc::new(ModuleInfo { gone, ..info }));
        }
        for _ in &kept.made {
            self.push_module(now);
        }
        for (module, id) in kept.modules.iter().zip((0..).map(ModuleId)) {
            let report = module.report.clone().unwrap_or_default();
            self.budget.store(id, module.writer, report.weight(), report.cut > 0);
            self.put_report(id, report);
            self.note_heard(id);
        }
        Ok(())
    }

    /// Takes over the times and numbers of a keyframe, after every state is there.
    pub(crate) fn resume_times(&mut self, kept: KeptViews) {
        let KeptViews { seq, revision, seq_changed, revision_changed, groups, modules, made: _, reception } =
            kept;
        (self.seq, self.revision) = (seq, revision);
        (self.seq_changed, self.revision_changed) = (seq_changed, revision_changed);
        self.reception = reception.into();
        for (index, group) in groups.iter().enumerate() {
            self.groups.get_mut(index).into_iter().for_each(|view| view.since = group.since);
        }
        for (index, module) in modules.iter().enumerate() {
            self.modules.get_mut(index).into_iter().for_each(|view| view.since = module.since);
        }
    }
}
