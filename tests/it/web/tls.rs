//! TLS: the vehicle's own certificate, faults of other certificates, and a page over TLS.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use rustls::pki_types::pem::PemObject as _;
use rustls::pki_types::{CertificateDer, ServerName};
use rustls::{ClientConfig, RootCertStore};
use telltale::engine::input::{Input, Upkeep};
use telltale::engine::model::NodeId;
use telltale::engine::snapshot::Snapshot;
use telltale::engine::state::State;
use telltale::engine::text::Text;
use telltale::web::{AppState, CertificateValidity, Origins, Settings, Tls, serve};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio_rustls::TlsConnector;
use tokio_rustls::client::TlsStream;
use tokio_tungstenite::tungstenite::client::IntoClientRequest;

use super::fixture::Fixture;
use crate::program;

const DAY: Duration = Duration::from_secs(24 * 3600);

struct Files {
    certificate: PathBuf,
    key: PathBuf,
}

fn self_signed(name: &str) -> Files {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("tls-{name}"));
    let _ = std::fs::remove_dir_all(&folder);
    let run = |more: &[&str]| {
        let words = ["tls", "self-signed", "--name", "shuttle-1.example", "--data", folder.to_str().unwrap()];
        program::run([&words[..], more].concat())
    };
    let made = run(&[]);
    assert!(made.status.success(), "{made:?}");
    let again = run(&[]);
    assert!(!again.status.success() && String::from_utf8_lossy(&again.stderr).contains("--replace"));
    Files { certificate: folder.join("tls-cert.pem"), key: folder.join("tls-key.pem") }
}

#[expect(clippy::disallowed_methods, reason = "certificates are valid by the wall clock")]
fn wall() -> SystemTime {
    SystemTime::now()
}

#[test]
fn what_is_wrong_with_a_certificate_is_said_with_what_to_do() {
    use std::os::unix::fs::PermissionsExt as _;
    let own = self_signed("own");
    let other = self_signed("other");
    for file in [&own.certificate, &own.key] {
        assert_eq!(
            std::fs::metadata(file).unwrap().permissions().mode() & 0o777,
            0o600,
            "{}",
            file.display()
        );
    }
    let nowhere = PathBuf::from("/nowhere/cert.pem");
    let text = own.key.with_file_name("text.pem");
    std::fs::write(&text, "no certificate\n").unwrap();
    let broken = own.key.with_file_name("broken.pem");
    std::fs::write(&broken, "-----BEGIN CERTIFICATE-----\nAAAA\n-----END CERTIFICATE-----\n").unwrap();
    let garbled = own.key.with_file_name("garbled.pem");
    std::fs::write(&garbled, "-----BEGIN CERTIFICATE-----\n!!!!\n-----END CERTIFICATE-----\n").unwrap();
    let cases: [(&Path, &Path, &[&str]); 7] = [
        (&nowhere, &own.key, &["/nowhere/cert.pem", "cannot be read"]),
        (&own.certificate, &nowhere, &["/nowhere/cert.pem", "cannot be read"]),
        (&text, &own.key, &["text.pem", "holds no certificate"]),
        (&own.certificate, &text, &["text.pem", "holds no private key"]),
        (&broken, &own.key, &["broken.pem", "telltale tls self-signed"]),
        (&garbled, &own.key, &["garbled.pem"]),
        (&own.certificate, &other.key, &["is not that of the certificate"]),
    ];
    for (certificate, key, said) in cases {
        let error = Tls::load(certificate, key).expect_err("it is wrong").to_string();
        assert!(said.iter().all(|part| error.contains(part)), "{error}");
    }
    let tls = Tls::load(&own.certificate, &own.key).unwrap();
    for host in ["shuttle-1.example", "localhost", "127.0.0.1", "[::1]"] {
        tls.check_name(host).unwrap();
    }
    let error = tls.check_name("shuttle-2.example").unwrap_err().to_string();
    assert!(error.contains("shuttle-2.example") && error.contains("shuttle-1.example"), "{error}");
}

#[test]
fn a_certificate_whose_time_is_over_is_used_and_said_to_be() {
    let own = self_signed("time");
    let tls = Tls::load(&own.certificate, &own.key).unwrap();
    assert_eq!(tls.validity(wall()), CertificateValidity::Good);
    assert!(
        matches!(tls.validity(wall() + 800 * DAY), CertificateValidity::EndsSoon(at) if at > wall() + 819 * DAY)
    );
    assert!(
        matches!(tls.validity(wall() + 821 * DAY), CertificateValidity::Ended(at) if at < wall() + 820 * DAY)
    );
    assert!(matches!(tls.validity(wall() - 2 * DAY), CertificateValidity::NotYet(_)));
    assert!(matches!(tls.validity(SystemTime::UNIX_EPOCH), CertificateValidity::NotYet(_)));
}

#[test]
fn a_certificate_that_was_renewed_is_taken_and_a_bad_one_is_not() {
    let (own, other) = (self_signed("renewed"), self_signed("renewal"));
    let hosts = ["shuttle-1.example".to_owned()];
    let tls = Tls::load(&own.certificate, &own.key).unwrap();
    assert!(!tls.reload(&hosts).unwrap(), "nothing changed");
    // Half of a renewal: the key is not there yet.
    std::fs::copy(&other.certificate, &own.certificate).unwrap();
    let error = tls.reload(&hosts).unwrap_err().to_string();
    assert!(error.contains("is not that of the certificate"), "{error}");
    assert!(!tls.reload(&hosts).unwrap(), "it is said once");
    std::fs::copy(&other.key, &own.key).unwrap();
    assert!(tls.reload(&hosts).unwrap());
    std::fs::write(&own.certificate, "no certificate\n").unwrap();
    assert!(tls.reload(&hosts).is_err());
    // A pipe would never answer.
    std::fs::remove_file(&own.certificate).unwrap();
    assert!(std::process::Command::new("mkfifo").arg(&own.certificate).status().unwrap().success());
    let error = tls.reload(&hosts).unwrap_err().to_string();
    assert!(error.contains("no regular file"), "{error}");
    std::fs::remove_file(&own.certificate).unwrap();
    tls.check_name("shuttle-1.example").unwrap();
    std::fs::copy(&other.certificate, &own.certificate).unwrap();
    let elsewhere = ["shuttle-2.example".to_owned()];
    assert!(tls.reload(&elsewhere).unwrap_err().to_string().contains("does not name shuttle-2.example"));
}

#[tokio::test]
async fn a_page_and_its_socket_work_over_tls_and_plain_http_does_not() {
    let files = self_signed("page");
    let fixture = Fixture::new().await;
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    let settings = Settings::plain(Origins::of_listener(address, true), true);
    let tls = Tls::load(&files.certificate, &files.key).unwrap();
    let app = AppState::new(fixture.link.clone(), fixture.store.clone(), fixture.clock, settings);
    tokio::spawn(serve(listener, Some(tls), app, std::future::pending()));

    let mut roots = RootCertStore::empty();
    roots.add(CertificateDer::from_pem_file(&files.certificate).unwrap()).unwrap();
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let config = ClientConfig::builder_with_provider(provider).with_safe_default_protocol_versions().unwrap();
    let connector = TlsConnector::from(Arc::new(config.with_root_certificates(roots).with_no_client_auth()));
    let connect = async || -> TlsStream<TcpStream> {
        let stream = TcpStream::connect(address).await.unwrap();
        connector.connect(ServerName::try_from("localhost").unwrap(), stream).await.unwrap()
    };
    let form = "name=operator&secret=246810";
    let mut stream = connect().await;
    let login = format!(
        "POST /login HTTP/1.1\r\nhost: localhost:{0}\r\norigin: https://localhost:{0}\r\nconnection: close\r\n\
         content-type: application/x-www-form-urlencoded\r\ncontent-length: {1}\r\n\r\n{form}",
        address.port(),
        form.len(),
    );
    stream.write_all(login.as_bytes()).await.unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).await.unwrap();
    let (_, cookie) = answer.split_once("__Host-telltale=").unwrap_or_else(|| panic!("{answer}"));
    let (token, attributes) = cookie.split_once(';').unwrap();
    assert!(attributes.lines().next().unwrap().ends_with("; Secure"), "{attributes}");

    let url = format!("wss://localhost:{}/ws", address.port());
    for (origin, status) in [("https", None), ("http", Some(403))] {
        let mut request = url.as_str().into_client_request().unwrap();
        let headers = request.headers_mut();
        headers.insert("cookie", format!("__Host-telltale={token}").parse().unwrap());
        headers.insert("origin", format!("{origin}://localhost:{}", address.port()).parse().unwrap());
        let refused = match tokio_tungstenite::client_async(request, connect().await).await {
            Ok(_) => None,
            Err(tokio_tungstenite::tungstenite::Error::Http(answer)) => Some(answer.status().as_u16()),
            Err(error) => panic!("{error}"),
        };
        assert_eq!(refused, status, "{origin}");
    }

    let mut plain = TcpStream::connect(address).await.unwrap();
    plain.write_all(b"GET /login HTTP/1.1\r\nhost: localhost\r\n\r\n").await.unwrap();
    let mut said = Vec::new();
    let _ = plain.read_to_end(&mut said).await;
    assert!(!said.starts_with(b"HTTP/"), "{said:?}");
}

#[tokio::test]
async fn what_is_wrong_with_the_clock_the_certificate_or_the_recorder_stands_on_the_page() {
    let fixture = Fixture::new().await;
    let operator = fixture.cookie_of("operator").await;
    let said = |en: &str, de: &str| Some(Text { en: en.into(), de: de.into() });
    let upkeep = Upkeep {
        clock: said("the clock shows 1970", "die Uhr zeigt 1970"),
        certificate: said("it ends soon", "es endet bald"),
        recording: said("raise `recording.memory`", "`recording.memory` erhöhen"),
        fleet: None,
    };
    fixture.input(Input::Upkeep(upkeep)).await;
    let is_warning = |snapshot: &Snapshot, id: &str| {
        let Some(NodeId::Module(module)) = snapshot.node(id) else { panic!("{id} is always there") };
        snapshot.module(module).1.own == State::Warning
    };
    let all = ["telltale/clock", "telltale/certificate", "telltale/recording"];
    fixture.until(|snapshot| all.iter().all(|id| is_warning(snapshot, id))).await;
    for (lang, words) in [
        (
            "en",
            [
                "Clock is wrong",
                "the clock shows 1970",
                "Certificate has to be renewed",
                "it ends soon",
                "Recordings are missing or too short",
            ],
        ),
        (
            "de",
            [
                "Uhr geht falsch",
                "die Uhr zeigt 1970",
                "Zertifikat muss erneuert werden",
                "es endet bald",
                "Aufzeichnungen fehlen oder sind zu kurz",
            ],
        ),
    ] {
        let page = fixture.get("/", Some(&format!("{operator}; lang={lang}"))).await.body;
        assert!(words.iter().all(|it| page.contains(it)), "{words:?}\n{page}");
    }
    fixture.input(Input::Upkeep(Upkeep::default())).await;
    fixture.until(|snapshot| !all.iter().any(|id| is_warning(snapshot, id))).await;

    fixture.input(Input::Nodes { repeated: Some("/planner".into()) }).await;
    fixture.until(|snapshot| is_warning(snapshot, "telltale/nodes")).await;
    fixture.input(Input::Nodes { repeated: None }).await;
    fixture.until(|snapshot| !is_warning(snapshot, "telltale/nodes")).await;
}
