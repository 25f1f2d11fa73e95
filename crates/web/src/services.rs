//! Does what other ROS 2 nodes ask for by services. DDS authenticates nobody, so they may do only what moves nothing,
//! and each call is recorded with the node that asked.

use super::Live;
use super::developer::reload::have_taken;
use super::incidents::mark_moment;
use super::operator::act::{AskedAction, act_in_turn};
use super::operator::not_done::NotDone;
use super::view;
use crate::texts::{HttpError, InvalidTap, Lang};
use telltale_engine::input::{AlarmRef, OperatorAction};
use telltale_engine::model::service::Service;
use telltale_engine::snapshot::Snapshot;
use telltale_engine::state::State;
use telltale_engine::time::{Span, Timestamp};
use telltale_runtime::Rereading;
use telltale_store::Caller;
use telltale_store::audit::{Action, Record};

/// The source of their records.
const DDS: &str = "DDS";

/// An action that takes longer is refused: it may have waited for the disk, or for others.
const WITHIN: Span = Span::from_secs(3);

/// Alarms that an answer names.
const ALARMS_NAMED: usize = 8;

/// A request of a node.
#[derive(Debug)]
pub struct ServiceRequest {
    pub service: Service,
    /// Of [`Service::Acknowledge`] and [`Service::Reset`].
    pub argument: Box<str>,
    /// The node as it calls itself, and its participant.
    pub caller: Box<str>,
    /// Whether this service is done while the vehicle is cleared or drives.
    pub while_driving: bool,
}

/// The answer in words: what was done, or why not.
pub type Answer = Result<String, String>;

/// Does what a node asks for, or refuses it. The caller awaits the end before the next request.
pub async fn serve(app: &Live, request: &ServiceRequest) -> Answer {
    let until = app.clock.now() + WITHIN;
    match request.service {
        Service::Acknowledge => request.acknowledge(app, until).await,
        Service::Reset => request.reset(app, until).await,
        Service::Reload => request.reload(app).await,
        Service::Mark => request.mark(app).await,
    }
}

impl ServiceRequest {
    /// A record of this request. What is refused can be caused by anybody, so it is bounded in number.
    fn record(&self, action: Action) -> Record {
        let record = Record::of(action, DDS).by_anybody(Caller::Elsewhere);
        Record { who: self.caller.to_string(), ..record }
    }

    /// Alarms alone. A WARNING is accepted by an operator: a clearance asks for that.
    async fn acknowledge(&self, app: &Live, until: Timestamp) -> Answer {
        let argument = &*self.argument;
        let named = match named_alarms(&app.published().snapshot, argument) {
            Ok(named) => named,
            Err(why) => {
                let record = self.record(Action::Acknowledge).on(argument).refused(&*why);
                app.store.record(record, None).await;
                return Err(why);
            }
        };
        if named.is_empty() {
            return Ok(format!("{argument}: acknowledged before"));
        }
        for number in &named {
            let action = OperatorAction::Acknowledge { alarm: AlarmRef::Number(*number) };
            let target = match argument.parse::<u64>() {
                Ok(_) => argument.to_owned(),
                Err(_) => format!("{number}: {argument}"),
            };
            self.act(app, action, self.record(Action::Acknowledge).on(target), until).await?;
        }
        let numbers: Vec<String> = named.iter().map(u64::to_string).collect();
        Ok(format!("acknowledged: alarm {}", numbers.join(", ")))
    }

    async fn reset(&self, app: &Live, until: Timestamp) -> Answer {
        let action = OperatorAction::Reset { module: self.argument.clone() };
        self.act(app, action, self.record(Action::Reset).on(&*self.argument), until).await?;
        Ok(format!("{} is reset", self.argument))
    }

    async fn act(
        &self,
        app: &Live,
        action: OperatorAction,
        record: Record,
        until: Timestamp,
    ) -> Result<(), String> {
        let judged = || {
            if app.clock.now() >= until {
                return Err(InvalidTap::Late);
            }
            if self.is_for_operator(&app.published().snapshot) {
                Err(InvalidTap::ForOperator)
            } else {
                Ok(action.clone())
            }
        };
        let asked = AskedAction {
            app,
            record: &record,
            until,
            last_stop: None,
            judged: &judged,
            tell_recorder: &|_, _| {},
        };
        act_in_turn(asked).await.map_err(|not_done| match not_done {
            NotDone::Refused(reasons) => view::refusals(&app.published(), Lang::En, &reasons).join(" "),
            NotDone::Invalid(invalid) => Lang::En.invalid_tap(invalid).to_owned(),
            NotDone::HttpError(error) => words(error),
        })
    }

    async fn reload(&self, app: &Live) -> Answer {
        let record = self.record(Action::Configuration);
        if self.is_for_operator(&app.published().snapshot) {
            let why = Lang::En.invalid_tap(InvalidTap::ForOperator).to_owned();
            app.store.record(record.refused(&*why), None).await;
            return Err(why);
        }
        let (read, _) = have_taken(app.clone(), None, record).await.map_err(words)?;
        let Rereading { taken, differences, problems, warnings, .. } = read;
        if let Some(problems) = problems {
            return Err(format!("the file is wrong, and the old configuration stays:\n{problems}"));
        }
        if !taken {
            return Ok("the file means the same as what runs".to_owned());
        }
        let mut answer = format!("taken: {}", differences.join("; "));
        if let Some(warnings) = warnings {
            answer.push_str(&format!("\nIt can be used, but:\n{warnings}"));
        }
        Ok(answer)
    }

    async fn mark(&self, app: &Live) -> Answer {
        // Marks are few, and none is left out.
        let record = Record { by_anybody: None, ..self.record(Action::Mark) };
        let id = mark_moment(app, &self.caller, "", record).await.map_err(words)?;
        Ok(format!("incident {id} is marked"))
    }

    /// Whether this is for the operator alone now, who hears and sees the alarms of a vehicle that drives or may
    /// start to.
    fn is_for_operator(&self, snapshot: &Snapshot) -> bool {
        snapshot.is_under_way() && !self.while_driving
    }
}

fn words(error: HttpError) -> String {
    Lang::En.error_text(error).to_owned()
}

/// The alarms that are not acknowledged, by a number or the name of a node.
///
/// # Errors
/// There is none of this name, and which there are.
fn named_alarms(snapshot: &Snapshot, argument: &str) -> Result<Vec<u64>, String> {
    let open = || snapshot.alarms.iter().filter(|alarm| !alarm.acknowledged);
    let listed = || {
        let named =
            |it: &telltale_engine::snapshot::Alarm| format!("{} {}", it.id, snapshot.node_name(it.node));
        let names: Vec<String> = open().take(ALARMS_NAMED).map(named).collect();
        let more = open().count().saturating_sub(ALARMS_NAMED);
        match (names.is_empty(), more) {
            (true, _) => "none is open".to_owned(),
            (false, 0) => format!("open are {}", names.join(", ")),
            (false, more) => format!("open are {} and {more} more", names.join(", ")),
        }
    };
    if argument.is_empty() {
        return Err(format!("name an alarm by its number, or a node: {}", listed()));
    }
    let all: Vec<_> = match (argument.parse::<u64>(), snapshot.node(argument)) {
        (Ok(number), None) => snapshot.alarms.iter().filter(|alarm| alarm.id == number).collect(),
        (_, Some(node)) => snapshot.alarms.iter().filter(|alarm| alarm.node == node).collect(),
        (Err(_), None) => return Err(format!("there is no group and no module {argument}")),
    };
    if all.is_empty() {
        let warns = snapshot.node(argument).is_some_and(|node| snapshot.own(node) == State::Warning);
        let why = if warns {
            "it has a WARNING, which an operator accepts at the page"
        } else {
            "there is no such alarm"
        };
        return Err(format!("{argument}: {why}; {}", listed()));
    }
    Ok(all.into_iter().filter(|alarm| !alarm.acknowledged).map(|alarm| alarm.id).collect())
}
