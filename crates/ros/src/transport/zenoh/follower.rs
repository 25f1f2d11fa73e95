//! The session that follows the graph, on a thread of its own. The messages have another session: they would wait
//! behind the tokens, and the library needs the longer for a token the more there are.

use std::any::Any;
use std::sync::Arc;
use std::sync::mpsc::Receiver;

use zenoh::Wait as _;
use zenoh::sample::{Sample, SampleKind};

use super::heard::Heard;
use super::names;
use super::session::{ask, open, refused};
use crate::transport::WRITING_MAX;

/// A task for the thread.
#[derive(Debug, PartialEq, Eq)]
pub enum Follow {
    /// From the beginning, as the follower with this number.
    Begin(u64),
    End,
    /// Ask the router whether tokens are gone.
    Confirm(u64),
}

/// Follows the graph until there is no more work.
pub fn run(domain: u16, router: Option<&str>, heard: &Arc<Heard>, work: &Receiver<Follow>) {
    let mut follower = None;
    while let Ok(work) = work.recv() {
        let done = match (work, &follower) {
            (Follow::Begin(number), _) => {
                // The one before ends first.
                follower = None;
                Follower::open(domain, router, heard, number).map(|opened| follower = Some(opened))
            }
            (Follow::Confirm(number), Some(follower)) => follower.confirm(heard, number),
            (Follow::Confirm(_), None) => Ok(()),
            (Follow::End, _) => {
                follower = None;
                Ok(())
            }
        };
        if let Err(error) = done {
            return heard.with(|state| state.broken = Some(error));
        }
    }
}

struct Follower {
    session: zenoh::Session,
    /// The subscriber, until it is dropped.
    _tokens: Box<dyn Any + Send>,
}

impl Follower {
    fn open(domain: u16, router: Option<&str>, heard: &Arc<Heard>, number: u64) -> Result<Follower, String> {
        let session = open(router)?;
        let on_token = {
            let heard = heard.clone();
            move |sample: Sample| {
                let key = sample.key_expr().as_str();
                heard.with(|state| state.token(number, key, sample.kind() == SampleKind::Put));
            }
        };
        let tokens = session.liveliness().declare_subscriber(names::tokens(domain));
        let tokens = tokens.history(true).callback(on_token).wait().map_err(refused)?;
        Ok(Follower { session, _tokens: Box::new(tokens) })
    }

    /// Asks the router whether it is there. It answers when it has told of all tokens before.
    fn confirm(&self, heard: &Arc<Heard>, number: u64) -> Result<(), String> {
        let heard = heard.clone();
        ask(&self.session, move || heard.with(|state| state.confirmed = state.confirmed.max(number)))
    }
}

impl Drop for Follower {
    fn drop(&mut self) {
        // It says goodbye if it can.
        let _ = self.session.close().timeout(WRITING_MAX).wait();
    }
}
