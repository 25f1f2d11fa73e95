//! Recordings over HTTP that cannot be trusted: a disk that takes none, and files that were changed.

use serde_json::json;
use telltale_record::folder::{file_name, folder_in};
use telltale_record::summary::{Recording, Summary};
use telltale_record::writer::hash_file;

use crate::recordings::incidents::{BYTES, Recorded};

#[tokio::test]
async fn without_a_recording_there_is_no_clearance_whatever_the_operator_accepts() {
    let recorded = Recorded::new("clearance").await;
    let operator = recorded.fixture.cookie_of("operator").await;
    let refused = async || {
        let form = format!("version={}", recorded.fixture.app.published().snapshot.seq);
        let answer = recorded.fixture.post("/vehicle/clearance", Some(&operator), &form).await;
        answer.body.contains("Nothing can be recorded")
    };
    assert!(!refused().await);
    recorded.fault.send_replace(Some("the disk is full".into()));
    assert!(refused().await);
    recorded.fault.send_replace(None);
    assert!(!refused().await);
}

#[tokio::test]
async fn a_recording_that_was_changed_is_told_on_its_page_in_its_report_and_to_programs() {
    let recorded = Recorded::new("changed").await;
    let developer = recorded.fixture.cookie_of("developer").await;
    // It has another hash.
    recorded.add(1, "a/b", true).await;
    let path = folder_in(&recorded.data).join(file_name(2));
    std::fs::write(&path, BYTES).unwrap();
    let hash = hash_file(&path).unwrap();
    let recording = Recording {
        file: file_name(2),
        bytes: BYTES.len() as u64,
        finished: true,
        sha256: Some(hash.clone()),
        ..Recording::default()
    };
    let summary = Summary { id: 2, until_ms: Some(1), recording, ..Summary::default() };
    recorded.fixture.store.incident_finished(&summary).await.unwrap();
    recorded.add(3, "a/b", false).await;
    std::fs::write(folder_in(&recorded.data).join(file_name(4)), BYTES).unwrap();
    let recording = Recording { file: file_name(4), ..summary.recording.clone() };
    let four = Summary { id: 4, recording, ..summary.clone() };
    recorded.fixture.store.incident_finished(&four).await.unwrap();
    let told = async |id: u64| {
        let one = recorded.fixture.get_json(&format!("/api/v1/incidents/{id}"), &developer).await;
        let mut told = Vec::new();
        for ending in ["", ".html"] {
            let page = recorded.fixture.get(&format!("/incidents/{id}{ending}"), Some(&developer)).await.body;
            told.push(
                page.contains("is not as it was recorded: the file was changed") && page.contains(&hash),
            );
        }
        (one["recording"]["as_recorded"].clone(), told)
    };
    assert_eq!(told(1).await, (json!(false), vec![true, true]));
    assert_eq!(told(2).await, (json!(true), vec![false, false]));
    assert_eq!(told(3).await, (json!(null), vec![false, false]), "it is still written");
    // Somebody changes what the row says, and leaves the file as it is.
    recorded.fixture.store.incident_updated(&Summary { stage: "active".into(), ..four }).await.unwrap();
    let one = recorded.fixture.get_json("/api/v1/incidents/4", &developer).await;
    assert_eq!(one["recording"]["as_recorded"], json!(false));
    let page = recorded.fixture.get("/incidents/4", Some(&developer)).await.body;
    assert!(page.contains("is not what the audit log proves"), "{page}");
    // Somebody changes the file, and its hash in the row.
    std::fs::write(&path, b"another").unwrap();
    let recording = Recording { sha256: Some(hash_file(&path).unwrap()), ..summary.recording.clone() };
    recorded.fixture.store.incident_updated(&Summary { recording, ..summary }).await.unwrap();
    let one = recorded.fixture.get_json("/api/v1/incidents/2", &developer).await;
    assert_eq!(one["recording"]["as_recorded"], json!(false), "the audit log has the other one");
}
