//! The last requests with their replies: a client that repeats a request gets the same reply, and what it asked
//! for is done once.

use std::collections::VecDeque;

use crate::transport::SampleId;
use telltale_msg::services::{Correlation, Reply};

/// Requests that are remembered.
const REMEMBERED: usize = 64;

/// A request, by what its client says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RequestId {
    /// The sample; for a client that counts in the body, its writer alone.
    sample: SampleId,
    correlation: Correlation,
}

impl RequestId {
    pub fn new(sample: SampleId, correlation: Correlation) -> RequestId {
        let sequence = match correlation {
            // The same request comes as another sample.
            Correlation::Header { .. } => 0,
            Correlation::Sample => sample.sequence,
        };
        RequestId { sample: SampleId { sequence, ..sample }, correlation }
    }
}

/// The state of a request.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Known {
    New,
    /// It is being worked on, and will be answered.
    Waits,
    Answered(Reply),
}

#[derive(Debug, Default)]
pub struct LastRequests(VecDeque<(RequestId, Option<Reply>)>);

impl LastRequests {
    pub fn find(&self, id: RequestId) -> Known {
        match self.0.iter().find(|(known, _)| *known == id) {
            Some((_, Some(reply))) => Known::Answered(reply.clone()),
            Some((_, None)) => Known::Waits,
            None => Known::New,
        }
    }

    /// Takes in a request that is worked on from now on.
    pub fn begin(&mut self, id: RequestId) {
        self.0.push_back((id, None));
        if self.0.len() > REMEMBERED {
            self.0.pop_front();
        }
    }

    pub fn answer(&mut self, id: RequestId, reply: &Reply) {
        if let Some((_, answer)) = self.0.iter_mut().find(|(known, _)| *known == id) {
            *answer = Some(reply.clone());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn request(writer: u8, sample: i64, sequence: i64) -> RequestId {
        let correlation = Correlation::Header { client: 5, sequence };
        RequestId::new(SampleId { writer: [writer; 16], sequence: sample }, correlation)
    }

    #[test]
    fn a_repeated_request_is_answered_as_before_and_no_other() {
        let mut last = LastRequests::default();
        let ask = |last: &mut LastRequests, id| {
            let known = last.find(id);
            if known == Known::New {
                last.begin(id);
            }
            known
        };
        assert_eq!(ask(&mut last, request(1, 1, 1)), Known::New);
        assert_eq!(ask(&mut last, request(1, 2, 1)), Known::Waits);
        last.answer(request(1, 1, 1), &Reply::done("yes"));
        assert_eq!(ask(&mut last, request(1, 3, 1)), Known::Answered(Reply::done("yes")));
        assert_eq!(ask(&mut last, request(2, 1, 1)), Known::New, "another client with the same header");
        for sequence in [1, 2] {
            let sample = SampleId { writer: [1; 16], sequence };
            assert_eq!(ask(&mut last, RequestId::new(sample, Correlation::Sample)), Known::New);
        }
        for number in 10..10 + REMEMBERED as i64 {
            last.begin(request(3, 1, number));
        }
        assert_eq!((last.0.len(), last.find(request(1, 1, 1))), (REMEMBERED, Known::New));
    }
}
