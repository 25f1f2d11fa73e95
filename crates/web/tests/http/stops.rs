//! Every STOP counts: no release and no clearance that was asked for before it is done after it.

use axum::http::StatusCode;
use telltale_engine::input::{OperatorAction, Refusal, Response};
use telltale_engine::model::Stage;
use telltale_engine::time::Span;
use telltale_runtime::Command;
use tokio::sync::oneshot;

use crate::fixture::{Fixture, as_program, form_request};
use crate::vehicle::{Operator, refused};

const RELEASE: &str = "/vehicle/release";
const CLEARANCE: &str = "/vehicle/clearance";

const STOPPED_SINCE: &str = "STOP was tapped in the meantime, so this was not done. Look again.";

impl Operator {
    /// In front of a display, in a vehicle that drives.
    async fn driving() -> Operator {
        Operator::driving_in(Fixture::new().await).await
    }

    async fn driving_in(fixture: Fixture) -> Operator {
        let operator = Operator::standing_in(fixture).await;
        operator.fixture.look(&operator.cookie);
        operator.fixture.drive(true).await;
        operator
    }

    async fn stop(&self, tap: &str) -> StatusCode {
        let form = if tap.is_empty() { String::new() } else { format!("tap={tap}") };
        let request = form_request("/vehicle/stop", Some(&self.cookie), &form);
        self.fixture.send(as_program(request)).await.status
    }

    /// Both steps.
    async fn release(&self) {
        self.fixture.look(&self.cookie);
        let token = self.token_for(RELEASE).await;
        assert_eq!(self.confirm_at(RELEASE, &token).await.status, StatusCode::OK);
        assert!(!self.is_held());
    }

    fn is_held(&self) -> bool {
        self.fixture.link.snapshots.borrow().snapshot.stop_requested()
    }

    fn last_stop(&self) -> u64 {
        self.fixture.link.snapshots.borrow().snapshot.last_stop
    }
}

#[tokio::test]
async fn a_stop_between_the_two_steps_of_a_release_forbids_it() {
    for [first, second] in [["", ""], ["a", "b"], ["a", "a"]] {
        let operator = Operator::driving().await;
        assert_eq!(operator.stop(first).await, StatusCode::OK);
        operator.fixture.look(&operator.cookie);
        let token = operator.token_for(RELEASE).await;
        assert_eq!(operator.stop(second).await, StatusCode::OK);
        assert_eq!(refused(&operator.confirm_at(RELEASE, &token).await), [STOPPED_SINCE], "{first} {second}");
        assert!(operator.is_held(), "{first} {second}");
        operator.release().await;
    }
}

#[tokio::test]
async fn a_stop_between_the_two_steps_of_a_clearance_forbids_it_also_where_there_is_nothing_to_stop() {
    let operator = Operator::standing().await;
    operator.fixture.look(&operator.cookie);
    let token = operator.token_for(CLEARANCE).await;
    assert_eq!(operator.stop("").await, StatusCode::CONFLICT);
    assert_eq!(refused(&operator.confirm_at(CLEARANCE, &token).await), [STOPPED_SINCE]);
    assert_eq!(operator.fixture.stage(), Stage::Standby);
    operator.fixture.look(&operator.cookie);
    let token = operator.token_for(CLEARANCE).await;
    assert_eq!(operator.confirm_at(CLEARANCE, &token).await.status, StatusCode::OK);
}

/// The engine has the last word: a STOP that it took first wins, also after the web server admitted the release.
#[tokio::test]
async fn a_release_that_the_engine_receives_after_a_stop_is_not_done() {
    let operator = Operator::driving().await;
    assert_eq!(operator.stop("").await, StatusCode::OK);
    let asked_after = operator.last_stop();
    assert_eq!(operator.stop("").await, StatusCode::OK);
    for (last_stop, expected) in [
        (Some(asked_after), Response::Refused(vec![Refusal::StoppedSince])),
        (Some(operator.last_stop()), Response::Done),
    ] {
        let (reply, answer) = oneshot::channel();
        let action = OperatorAction::Release { display_live: true, storage_ok: true };
        operator.fixture.link.commands.send(Command { action, last_stop, reply }).await.unwrap();
        assert_eq!(answer.await.unwrap(), expected);
        assert_eq!(operator.is_held(), expected != Response::Done);
    }
}

#[tokio::test]
async fn the_name_of_a_tap_counts_only_while_its_stop_holds_and_is_being_repeated() {
    let (fixture, hand) = Fixture::with_hand().await;
    let operator = Operator::driving_in(fixture).await;
    for _ in 0..2 {
        assert_eq!(operator.stop("same").await, StatusCode::OK);
        assert!(operator.is_held());
        let number = operator.last_stop();
        assert_eq!(operator.stop("same").await, StatusCode::OK);
        assert_eq!(operator.last_stop(), number, "it is the same tap");
        operator.release().await;
    }
    assert_eq!(operator.stop("same").await, StatusCode::OK);
    let number = operator.last_stop();
    hand.advance(Span::from_secs(10));
    assert_eq!(operator.stop("same").await, StatusCode::OK);
    assert_eq!(operator.last_stop(), number + 1, "no attempt is under way for so long");
}

#[tokio::test]
async fn a_stop_that_failed_is_tried_again_under_its_name() {
    let operator = Operator::driving().await;
    operator.fixture.listeners(false).await;
    assert_eq!(operator.stop("same").await, StatusCode::SERVICE_UNAVAILABLE);
    operator.fixture.listeners(true).await;
    assert_eq!(operator.stop("same").await, StatusCode::OK);
}

/// Its configuration has no source of the speed, and nothing was heard of `active`.
#[tokio::test]
async fn a_vehicle_of_which_nobody_knows_whether_it_drives_can_be_stopped() {
    let fixture = Fixture::new().await;
    let cookie = fixture.cookie_of("operator").await;
    let operator = Operator { fixture, cookie };
    assert_eq!(operator.fixture.stage(), Stage::Localizing);
    let has_stop = async || {
        let page = operator.fixture.get("/", Some(&operator.cookie)).await.body;
        page.contains("action=\"/vehicle/stop\"")
    };
    assert!(has_stop().await);
    assert_eq!(operator.stop("").await, StatusCode::OK);
    assert!(operator.is_held());
    // Its word that it stands does not end that: it may have driven.
    operator.fixture.drive(false).await;
    assert!(operator.is_held());
    operator.release().await;
    assert!(!has_stop().await);
    assert_eq!(operator.stop("").await, StatusCode::CONFLICT);
}
