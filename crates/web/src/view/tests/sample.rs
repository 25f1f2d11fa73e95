//! A shuttle for tests: the real engine over a model as in the paper, fed by hand.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use telltale_engine::Engine;
use telltale_engine::input::{
    Input, ListenerReport, OperatorAction, Place, ReceptionTrouble, Response, StatusArray, TroubleKind,
};
use telltale_engine::model::filter::Filter;
use telltale_engine::model::output::Output;
use telltale_engine::model::wording::Wording;
use telltale_engine::model::{
    Dependency, DependsOn, Driving, FieldSource, GroupId, GroupSpec, Model, ModuleMonitor, ModuleSpec,
    NodeId, Parts, SignalSource, SignalSpec, StageModel, Stop, When, Within,
};
use telltale_engine::snapshot::Snapshot;
use telltale_engine::text::Text;
use telltale_engine::time::{Span, Timestamp};
use telltale_runtime::Published;

/// Path, names, place and dependencies of a component, and whether it matters only while driving.
type Component = (&'static str, &'static str, &'static str, (u8, u8), &'static [usize], bool);

const COMPONENTS: [Component; 8] = [
    ("sensors", "Sensors", "Sensoren", (1, 1), &[], false),
    ("localization", "Localization", "Lokalisierung", (2, 1), &[0, 4], false),
    ("perception", "Perception", "Wahrnehmung", (3, 1), &[0, 1], false),
    ("prediction", "Prediction", "Vorhersage", (4, 1), &[2], false),
    ("can", "CAN", "Fahrzeugbus (CAN)", (1, 2), &[], false),
    ("mission", "Mission", "Mission", (2, 2), &[], false),
    ("planning", "Planning", "Planung", (3, 2), &[1, 3, 5], true),
    ("execution", "Execution", "Ausführung", (4, 2), &[6, 4], true),
];

/// Component and module, what its fault is called, and what to do about it, in two languages each.
const MODULES: &str = "\
0 | velodyne_packet_alive | LiDAR data missing | LiDAR-Daten fehlen | Stop. Call the control room. | Anhalten. Leitstelle rufen.
0 | camera_front | Front camera without picture | Frontkamera ohne Bild | Watch the road. Be ready to stop. | Straße beobachten. Bremsbereit sein.
0 | imu | Motion sensor disturbed | Bewegungssensor gestört | Stop at the next safe place. Call the control room. | Am nächsten sicheren Ort anhalten. Leitstelle rufen.
0 | gnss | Satellite reception poor | Satellitenempfang schlecht | It may go on. Watch the position. | Weiterfahren möglich. Position beobachten.
1 | tf_map | Position missing | Position fehlt | Take over. Stop. Call the control room. | Übernehmen. Anhalten. Leitstelle rufen.
1 | tf_quality | Position jumped | Position ist gesprungen | Watch the road. Be ready to stop. | Straße beobachten. Bremsbereit sein.
1 | scan_matching | Surroundings do not fit the map | Umgebung passt nicht zur Karte | Watch the road. Be ready to stop. | Straße beobachten. Bremsbereit sein.
1 | odometry | Distance travelled is wrong | Gefahrene Strecke stimmt nicht | Stop. Call the control room. | Anhalten. Leitstelle rufen.
2 | costmap_delay | Obstacle map is late | Hinderniskarte kommt zu spät | Watch the road. Be ready to stop. | Straße beobachten. Bremsbereit sein.
2 | object_detection | Obstacles not recognized | Hindernisse nicht erkannt | Take over. Stop. | Übernehmen. Anhalten.
2 | object_tracking | Moving obstacles lost | Bewegte Hindernisse verloren | Take over. Stop. | Übernehmen. Anhalten.
3 | trajectories | Paths of others not predicted | Wege anderer nicht vorhergesagt | Watch the road. Be ready to stop. | Straße beobachten. Bremsbereit sein.
3 | lane_matching | Lanes of others unclear | Fahrstreifen anderer unklar | Watch the road. Be ready to stop. | Straße beobachten. Bremsbereit sein.
4 | bus | No connection to the vehicle | Keine Verbindung zum Fahrzeug | Take over. Stop. Call the control room. | Übernehmen. Anhalten. Leitstelle rufen.
4 | battery | Battery is low | Batterie ist schwach | It may go on. Charge after this trip. | Weiterfahren möglich. Nach dieser Fahrt laden.
5 | server | No connection to the control room | Keine Verbindung zur Leitstelle | Stop at the next stop. Call by phone. | An der nächsten Haltestelle anhalten. Telefonisch melden.
6 | planner_submitted | No driving plan | Geplanter Weg fehlt | Take over. Stop. | Übernehmen. Anhalten.
6 | trajectory | Planned path not drivable | Geplanter Weg nicht fahrbar | Take over. Stop. | Übernehmen. Anhalten.
7 | steering | Steering does not follow | Lenkung folgt nicht | Take over. Stop. Call the control room. | Übernehmen. Anhalten. Leitstelle rufen.
7 | brake | Brake does not follow | Bremse folgt nicht | Take over. Use the emergency brake. Call the control room. | Übernehmen. Notbremse benutzen. Leitstelle rufen.";

pub fn text(en: &str, de: &str) -> Text {
    Text { en: en.into(), de: de.into() }
}

pub fn on_group(group: u32) -> Dependency {
    Dependency {
        on: DependsOn::Node(NodeId::Group(GroupId(group))),
        masks_unknown: false,
        within: Within::default(),
    }
}

pub fn group(path: &str, name: Text) -> GroupSpec {
    let filters = vec![Filter::Namespace(format!("/{path}").into()).into()];
    GroupSpec { filters, ..GroupSpec::new(path, name) }
}

pub fn module(group: &str, id: u32, name: &str) -> ModuleSpec {
    let path = format!("{group}/{name}");
    ModuleSpec::new(&path, GroupId(id), ModuleMonitor::SelfState(path.as_str().into()))
}

pub fn stop(id: &str, name: Text) -> Stop {
    Stop { id: id.into(), name, x_m: id.len() as f64, y_m: 2.0, yaw_deg: 90.0 }
}

/// The paper's shuttle.
pub fn parts() -> Parts {
    let groups = COMPONENTS.iter().map(|&(path, en, de, place, depends_on, driving)| GroupSpec {
        depends_on: depends_on.iter().map(|&on| on_group(on as u32)).collect(),
        when: driving.then(|| When { signals: vec![(0, true)], ..When::default() }),
        tile: Some(place),
        ..group(path, text(en, de))
    });
    let modules = MODULES.lines().map(|line| {
        let row: Vec<&str> = line.split(" | ").collect();
        let [index, name, en, de, help_en, help_de] = row[..] else { panic!("{line}") };
        let index: usize = index.parse().unwrap();
        ModuleSpec {
            name: Some(Wording::name(text(en, de)).into()),
            help: Some(Wording::help(text(help_en, help_de)).into()),
            ..module(COMPONENTS[index].0, index as u32, name)
        }
    });
    let active = SignalSource::Field(FieldSource {
        topic: "/mission/active".into(),
        type_name: "std_msgs/msg/Bool".into(),
        field: "data".into(),
    });
    Parts {
        vehicle_name: Text::plain("Shuttle 1"),
        signals: vec![SignalSpec::new("active", active)],
        groups: groups.collect(),
        modules: modules.collect(),
        driving: Driving {
            stops: vec![
                stop("depot", Text::plain("Depot")),
                stop("station", text("Main Station", "Hauptbahnhof")),
            ],
            ..Driving::default()
        },
        ..Parts::empty("shuttle-1", StageModel::Shuttle)
    }
}

/// The report of a module: level, message and values.
type Heard = (u8, String, Vec<(String, String)>);

/// A vehicle whose modules report as the test says, every second.
pub struct Sample {
    engine: Engine,
    now: Timestamp,
    reports: BTreeMap<String, Heard>,
}

impl Sample {
    /// Just started: nothing has reported, nobody is logged in.
    pub fn of(parts: Parts) -> Sample {
        let model = Model::new(parts).unwrap_or_else(|cycle| panic!("{cycle:?}"));
        let reports = model.modules.iter().map(|module| {
            (
                module.id.to_string(),
                (0, "running".to_owned(), vec![("rate_hz".to_owned(), "10.0".to_owned())]),
            )
        });
        let reports = reports.collect();
        Sample { engine: Engine::new(Arc::new(model), Timestamp::ZERO), now: Timestamp::ZERO, reports }
    }

    /// The paper's shuttle with all well for a minute and an operator in charge.
    pub fn shuttle(driving: bool) -> Sample {
        let standing = Sample::of(parts()).login().signal("active", false).pass(5).localize("depot");
        standing.pass(5).signal("active", driving).pass(50)
    }

    pub fn login(mut self) -> Sample {
        self.input(&Input::Operator(OperatorAction::Login { name: "operator".into() }));
        self.engine.start_in(telltale_engine::model::Stage::Standby);
        self
    }

    /// A login alone: where the vehicle stands is not known yet.
    pub fn unlock(self) -> Sample {
        self.act(OperatorAction::Login { name: "operator".into() })
    }

    /// Does what an operator may do; panics if it is refused.
    pub fn act(mut self, action: OperatorAction) -> Sample {
        let answer = self.engine.handle(&Input::Operator(action), self.now);
        assert_eq!(answer, Response::Done);
        self
    }

    pub fn localize(self, stop: &str) -> Sample {
        self.act(OperatorAction::Localize { place: Place::Stop(stop.into()) })
    }

    pub fn signal(mut self, name: &str, value: bool) -> Sample {
        self.input(&Input::Signal { name: name.into(), value });
        self
    }

    /// From now on the module reports this.
    pub fn report(mut self, status: &str, level: u8, message: &str, values: &[(&str, &str)]) -> Sample {
        let values = values.iter().map(|&(key, value)| (key.to_owned(), value.to_owned())).collect();
        self.reports.insert(status.to_owned(), (level, message.to_owned(), values));
        self
    }

    /// From now on the module says nothing.
    pub fn silence(mut self, status: &str) -> Sample {
        self.reports.remove(status);
        self
    }

    /// From now on somebody listens, or nobody, to requests of this kind.
    pub fn listeners(mut self, output: Output, heard: bool) -> Sample {
        self.input(&Input::Listened(ListenerReport { output, topic: "/stop".into(), heard }));
        self
    }

    pub fn trouble(mut self, topic: &str, kind: TroubleKind, count: u64, text: &str) -> Sample {
        let trouble = ReceptionTrouble { topic: topic.into(), kind, count, text: text.into() };
        self.input(&Input::Reception(trouble));
        self
    }

    /// Lets seconds pass, with a report of every module at the end of each.
    pub fn pass(mut self, seconds: u64) -> Sample {
        for _ in 0..seconds {
            self.now = self.now + Span::from_secs(1);
            let mut array = StatusArray::default();
            for (name, (level, message, values)) in &self.reports {
                array.push_status(*level, name, message, "");
                for (key, value) in values {
                    array.push_value(key, value);
                }
            }
            self.input(&Input::Diagnostics(array));
        }
        self
    }

    /// The vehicle's present snapshot, to go on from.
    pub fn snapshot(&mut self) -> Arc<Snapshot> {
        self.engine.snapshot()
    }

    pub fn published(mut self) -> Published {
        // A fixed day, plus what has passed: pages say times by it.
        let start = SystemTime::UNIX_EPOCH + Duration::from_secs(1_795_176_000);
        let at = start + Duration::from_nanos(self.now.as_nanos());
        Published::recorded(self.engine.snapshot(), at)
    }

    pub fn input(&mut self, input: &Input) {
        self.engine.handle(input, self.now);
    }
}
