//! Tests of reloads: configurations that are taken, configurations that are refused, and a reload that hangs.

use super::*;
use crate::clock::Clock;
use crate::engine::input::{Input, StatusArray};
use crate::engine::snapshot::Snapshot;
use crate::engine::state::State;
use crate::runtime::Stamped;
use crate::runtime::{self, Link};

const OLD: &str = "vehicle: { stages: none }
groups:
  - { id: a, modules: [{ id: kept, status: k, timeout: 1h }, { id: gone, status: g, timeout: 1h }] }
";
const NEW: &str = "vehicle: { stages: none }
signals: { doors: { topic: /doors, type: std_msgs/msg/Bool } }
groups:
  - { id: a, modules: [{ id: kept, status: k, timeout: 1h, name: Kept }] }
  - { id: b, depends_on: [a], modules: [{ id: new, status: g, timeout: 1h }] }
";

/// A configuration file that is removed with the test, and an engine that runs by it.
struct Bench {
    _folder: tempfile::TempDir,
    path: PathBuf,
    loaded: Loaded,
    link: Link,
    clock: Clock,
}

impl Bench {
    fn new() -> Bench {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("vehicle.yaml");
        std::fs::write(&path, OLD).unwrap();
        let loaded = config::load(&path).unwrap();
        let clock = Clock::start();
        let link = runtime::start(loaded.model.clone(), clock);
        Bench { _folder: folder, path, loaded, link, clock }
    }

    fn write(&self, text: &str) {
        std::fs::write(&self.path, text).unwrap();
    }

    /// Feeds an ERROR of both modules and waits until it shows.
    async fn break_both(&mut self) {
        let mut array = StatusArray::default();
        array.push_status(2, "k", "broken", "");
        array.push_status(2, "g", "broken", "");
        let input = Input::Diagnostics(array);
        self.link.inputs.send(Stamped::new(input, self.clock.now())).await.unwrap();
        self.link.snapshots.wait_for(|it| shown(&it.snapshot, "a/kept") == Some(State::Error)).await.unwrap();
    }

    fn shown(&self, name: &str) -> Option<State> {
        shown(&self.link.snapshots.borrow().snapshot, name)
    }
}

fn shown(snapshot: &Snapshot, name: &str) -> Option<State> {
    snapshot.node(name).map(|node| snapshot.shown(node).0)
}

fn sentences(differences: &[Difference]) -> Vec<String> {
    differences.iter().map(ToString::to_string).collect()
}

#[tokio::test]
async fn what_stays_keeps_its_state_and_the_rest_comes_and_goes() {
    let mut bench = Bench::new();
    bench.break_both().await;
    bench.write(NEW);
    let outcome =
        reload(&bench.path, &bench.loaded, &Definitions::default(), &bench.link.reloads).await.unwrap();
    assert_eq!(
        sentences(&outcome.differences),
        [
            "signal `doors` is new",
            "group `b` is new",
            "module `a/gone` is gone",
            "module `a/kept`: name from none to \"Kept\"",
            "module `b/new` is new",
        ]
    );
    assert!(outcome.topics_changed && outcome.loaded.soundness().1.is_none());
    // Published before the answer.
    assert_eq!(bench.shown("a/kept"), Some(State::Error));
    assert_eq!(bench.shown("a/gone"), None);
    assert_eq!(bench.shown("b/new"), Some(State::Ignore), "it waits for `a`");
}

#[tokio::test]
async fn a_file_with_an_error_changes_nothing_and_says_everything() {
    let mut bench = Bench::new();
    bench.break_both().await;
    let seq = bench.link.snapshots.borrow().snapshot.seq;
    bench.write("groups: [{ id: b, depends_on: [c] }, { id: b }]\n");
    let error =
        reload(&bench.path, &bench.loaded, &Definitions::default(), &bench.link.reloads).await.unwrap_err();
    let ReloadError::Configuration(problems) = error else { panic!("{error}") };
    assert_eq!(problems.list().len(), 2, "{problems}");
    assert_eq!(bench.shown("a/gone"), Some(State::Error));
    assert_eq!(bench.link.snapshots.borrow().snapshot.seq, seq);
}

#[tokio::test]
async fn the_same_again_is_not_taken() {
    let bench = Bench::new();
    let seq = bench.link.snapshots.borrow().snapshot.seq;
    bench.write(&format!("# A comment.\n{OLD}"));
    let outcome =
        reload(&bench.path, &bench.loaded, &Definitions::default(), &bench.link.reloads).await.unwrap();
    assert_eq!(outcome.differences, []);
    assert_eq!(bench.link.snapshots.borrow().snapshot.seq, seq);
}

#[tokio::test]
async fn a_request_previews_first_and_takes_when_told() {
    let bench = Bench::new();
    let mut reloads =
        start(bench.path.clone(), bench.loaded.clone(), Definitions::default(), bench.link.reloads.clone())
            .unwrap();
    let ask_shown = async |take: bool, shown: Option<String>| {
        let (reply, answer) = oneshot::channel();
        reloads.requests.send(Reread { take, shown, reply }).await.unwrap();
        answer.await.unwrap()
    };
    let ask = async |take: bool| ask_shown(take, None).await;
    bench.write(NEW);
    let preview = ask(false).await;
    assert_eq!((preview.taken, preview.differences.len(), preview.problems), (false, 5, None));
    assert_eq!(preview.running[0].text, OLD, "what runs, not what is in the file by now");
    // What can happen is found out meanwhile.
    let judged = async || {
        let asked = async {
            loop {
                let answer = ask(false).await;
                if answer.judged {
                    return answer;
                }
                tokio::task::yield_now().await;
            }
        };
        tokio::time::timeout(std::time::Duration::from_secs(60), asked).await.expect("it is found out")
    };
    assert_eq!(judged().await.digest, preview.digest);
    assert_eq!(bench.shown("b/new"), None);
    // What was shown is not what would be taken.
    bench.write(&NEW.replace("id: new", "id: newer"));
    assert_ne!(ask(false).await.digest, preview.digest);
    let other = ask_shown(true, Some(preview.digest.clone())).await;
    assert!(!other.taken && other.digest != preview.digest && other.differences.len() == 5);
    assert_eq!((bench.shown("b/newer"), &*other.running[0].text), (None, OLD));
    bench.write(NEW);
    assert_eq!(ask(false).await.digest, preview.digest);
    // What was shown is taken: the file is not read again.
    bench.write("groups: 3\n");
    let taken = ask_shown(true, Some(preview.digest.clone())).await;
    bench.write(NEW);
    assert_eq!((taken.taken, taken.differences.len(), taken.judged), (true, 5, true));
    assert_eq!(taken.running[0].text, NEW);
    let again = judged().await;
    assert_eq!(again.differences.len(), 0);
    assert_ne!(again.digest, preview.digest, "the same file, but nothing to take");
    assert_eq!(bench.shown("b/new"), Some(State::Unknown));
    assert_eq!(reloads.running.borrow_and_update().model.groups.len(), 2);
    // From what runs now, not from what ran at first.
    assert_eq!(ask(true).await.differences.len(), 0);
    bench.write("groups: 3\n");
    let refused = ask(true).await;
    assert!(!refused.taken && refused.problems.unwrap().contains("expected a list"));
    assert_eq!(bench.shown("b/new"), Some(State::Unknown));
}

#[tokio::test]
async fn a_pipe_in_place_of_a_file_is_refused_and_the_next_reload_works() {
    let bench = Bench::new();
    let pipe = bench.path.with_file_name("pipe.yaml");
    let make_pipe = |path: &Path| {
        use rustix::fs::{CWD, FileType, Mode, mknodat};
        mknodat(CWD, path, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap();
    };
    make_pipe(&pipe);
    let definitions = Definitions::default();
    let again = || reload(&bench.path, &bench.loaded, &definitions, &bench.link.reloads);
    bench.write(&format!("include: [pipe.yaml]\n{OLD}"));
    let error = again().await.unwrap_err().to_string();
    assert!(error.contains("pipe.yaml") && error.contains("no regular file"), "{error}");
    std::fs::remove_file(&bench.path).unwrap();
    make_pipe(&bench.path);
    let error = again().await.unwrap_err().to_string();
    assert!(error.contains("vehicle.yaml") && error.contains("no regular file"), "{error}");
    std::fs::remove_file(&bench.path).unwrap();
    bench.write(NEW);
    assert!(!again().await.unwrap().differences.is_empty());
}

#[tokio::test(start_paused = true)]
async fn a_reading_that_hangs_is_given_up_and_the_next_one_works() {
    let readings = Readings::default();
    let (hold, held) = std::sync::mpsc::channel::<()>();
    let held = Arc::new(std::sync::Mutex::new(held));
    for _ in 0..READINGS_MAX {
        let held = held.clone();
        let hang = move || {
            let _ = held.lock().map(|held| held.recv());
            Ok(())
        };
        let read = timeout(Duration::from_secs(21), readings.read(hang)).await;
        assert!(matches!(read.expect("it is given up after 20 s"), Err(ReloadError::Slow)));
        if Arc::strong_count(&readings.0) <= READINGS_MAX {
            // Time stands still while it is awaited: a thread is real.
            tokio::time::resume();
            assert_eq!(readings.read(|| Ok(7)).await.unwrap(), 7);
            tokio::time::pause();
        }
    }
    assert!(matches!(readings.read(|| Ok(())).await, Err(ReloadError::Stuck)), "they are bounded");
    drop(hold);
}
