//! Converts the written services into those that are offered.

use crate::file::services::{RawOffer, RawService, RawServices};
use crate::services::{Offer, Services};
use telltale_engine::model::StageModel;
use telltale_engine::model::service::Service;
use telltale_yaml::{Log, Problem};

pub(crate) fn services(raw: Option<&RawServices>, stages: StageModel, log: &mut Log) -> Services {
    let Some(raw) = raw else { return Services::default() };
    let mut offer = |raw: &Option<RawService>| match raw {
        None | Some(RawService::Is(false)) => None,
        Some(RawService::Is(true)) => Some(Offer::default()),
        Some(RawService::With(RawOffer { while_driving: None })) => Some(Offer::default()),
        Some(RawService::With(RawOffer { while_driving: Some(written) })) => {
            if stages == StageModel::None {
                let problem = Problem::at(written.span, "a machine without stages never counts as driving");
                log.push(problem.help("remove `while_driving`: the service is always done there"));
            }
            Some(Offer { while_driving: written.value })
        }
    };
    let offers = [
        (Service::Acknowledge, offer(&raw.acknowledge)),
        (Service::Reset, offer(&raw.reset)),
        (Service::Reload, offer(&raw.reload)),
        // A mark concerns nobody who drives.
        (Service::Mark, raw.mark.unwrap_or(false).then_some(Offer { while_driving: true })),
    ];
    Services(offers.into_iter().filter_map(|(service, offer)| Some((service, offer?))).collect())
}
