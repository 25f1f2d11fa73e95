//! Offers the services of the configuration to other ROS 2 nodes, and has done what they ask for.

use std::sync::Arc;

use tokio::sync::{mpsc, watch};

use crate::clock::Clock;
use crate::config::services::Services as Offered;
use crate::msg::services::Reply;
use crate::ros::services::{CALLS_MAX, Call, Services};
use crate::ros::{Bridge, BridgeOptions, services};
use crate::web::Live;
use crate::web::services::{ServiceRequest, serve};

/// The services, and the conditions under which each is done.
#[derive(Debug)]
pub struct Serving {
    services: Services,
    offered: watch::Sender<Arc<Offered>>,
}

/// The calls that wait, for [`answer`].
pub type Calls = (mpsc::Receiver<Call>, watch::Receiver<Arc<Offered>>);

pub fn start(options: &BridgeOptions, offered: &Offered, bridge: &Bridge, clock: Clock) -> (Serving, Calls) {
    let (calls, waiting) = mpsc::channel(CALLS_MAX);
    let services = services::start(options.clone(), offered.names(), calls, bridge.graph(), clock);
    let (offered, conditions) = watch::channel(Arc::new(offered.clone()));
    (Serving { services, offered }, (waiting, conditions))
}

impl Serving {
    /// Offers what another configuration names.
    pub fn follow(&self, offered: &Offered) {
        self.offered.send_replace(Arc::new(offered.clone()));
        self.services.follow(offered.names());
    }

    pub async fn shutdown(self) {
        self.services.shutdown().await;
    }
}

/// Does one call after the other, until nobody calls any more.
pub async fn answer((mut calls, offered): Calls, app: Live) {
    while let Some(Call { service, argument, caller, reply }) = calls.recv().await {
        let Some(offer) = offered.borrow().offer(service) else {
            // The caller was admitted by the configuration before.
            let _ = reply.send(Reply::refused("this service is not offered any more"));
            continue;
        };
        let request = ServiceRequest { service, argument, caller, while_driving: offer.while_driving };
        let answer = serve(&app, &request).await;
        let (ServiceRequest { caller, .. }, name) = (&request, service.as_str());
        match &answer {
            Ok(_) => tracing::info!("{name} is done for {caller}"),
            Err(why) => tracing::info!("{name} is refused to {caller}: {why}"),
        }
        // The caller may have gone.
        let _ = reply.send(answer.map_or_else(Reply::refused, Reply::done));
    }
}
