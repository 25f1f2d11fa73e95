//! Reports to the engine which outputs could not be sent to the vehicle, and when they can be sent again.

use super::{OutputContext, OutputTopic};
use crate::PublishError;
use telltale_engine::input::{Input, OutputReport};
use telltale_engine::model::output::{Output, Publication};
use telltale_msg::received::Stamped;

/// Whether the engine received it. A full queue must not delay the vehicle.
pub fn tell(context: &OutputContext, output: Output, topic: &str, error: Option<PublishError>) -> bool {
    if let Some(error) = &error {
        tracing::error!("{error}");
    }
    let error = error.map(|error| error.to_string().into());
    send(context, OutputReport { output, topic: topic.into(), error })
}

/// Reports that nothing at all can be sent, or that everything can be sent again: some messages are so rare
/// that their own success would come late.
pub fn tell_all(context: &OutputContext, error: Option<&str>) {
    for OutputTopic { publication, topic, .. } in context.topics.iter() {
        if let Publication::Vehicle(output) = *publication {
            send(context, OutputReport { output, topic: topic.clone(), error: error.map(Box::from) });
        }
    }
}

fn send(context: &OutputContext, news: OutputReport) -> bool {
    let stamped = Stamped::new(Input::Output(news), context.clock.now());
    context.inputs.try_send(stamped).is_ok()
}
