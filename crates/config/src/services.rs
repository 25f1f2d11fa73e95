//! The services that a configuration offers to other ROS 2 nodes.

use std::collections::{BTreeMap, BTreeSet};

use telltale_engine::model::service::Service;

/// The offered services. None is offered unless the file names it: DDS is not authenticated.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Services(pub BTreeMap<Service, Offer>);

/// The conditions of one service.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Offer {
    /// Whether it is done while the vehicle is cleared or drives.
    pub while_driving: bool,
}

impl Services {
    pub fn names(&self) -> BTreeSet<Service> {
        self.0.keys().copied().collect()
    }

    pub fn offer(&self, service: Service) -> Option<Offer> {
        self.0.get(&service).copied()
    }
}
