//! `telltale serve` without a configuration: drafts of one that shows every status that is heard, by node. A new
//! draft follows when something new is heard; what fell silent keeps its place.

use std::time::Duration;

use tokio::sync::mpsc;

use super::Lookout;
use crate::config::{self, Examined};
use crate::onboarding::init::{Draft, heard_text};
use crate::ros::BridgeOptions;

/// How often it is looked for something new.
const LOOK: Duration = Duration::from_secs(3);

/// The configuration of the start, before anything was heard.
pub fn examined() -> Examined {
    config::examine_from(NAME, heard_text(&Draft::default()).as_bytes())
}

/// In messages and on the developer's page.
const NAME: &str = "no configuration";

/// Texts of configurations, as more is heard. Each is taken before the next one is made.
///
/// # Errors
/// DDS cannot be started.
pub async fn drafts(options: BridgeOptions) -> anyhow::Result<mpsc::Receiver<String>> {
    tracing::warn!(
        "no configuration: everything that is heard is shown, by node. `telltale init -o robot.yaml` writes a first one; \
         then start `telltale serve --config robot.yaml`"
    );
    let mut lookout = Lookout::open(options, false, None).await?;
    let (sender, texts) = mpsc::channel(1);
    tokio::spawn(async move {
        let mut said = heard_text(&Draft::default());
        loop {
            if let Err(error) = lookout.listen(LOOK).await {
                tracing::error!("new statuses are not sorted by node any more: {error:#}");
                return;
            }
            let text = heard_text(&lookout.draft());
            if text != said {
                said.clone_from(&text);
                if sender.send(text).await.is_err() {
                    return;
                }
            }
        }
    });
    Ok(texts)
}

/// Reads such a text.
pub fn parse(text: &str) -> Result<config::Loaded, crate::yaml::Problems> {
    config::parse(NAME, text)
}
