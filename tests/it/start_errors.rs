//! Errors at the start: what is wrong, what to do, exit code 2.

use std::net::TcpListener;
use std::path::PathBuf;
use std::process::Output;

use crate::program;

const SHUTTLE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/config/shuttle.yaml");

fn telltale(words: &[&str]) -> Output {
    program::run(words)
}

/// The same, with variables of the environment.
fn telltale_with(words: &[&str], variables: &[(&str, &str)]) -> Output {
    program::telltale(words).envs(variables.iter().copied()).output().expect("the program can be run")
}

/// A folder for this test, below the folder that cargo provides.
fn folder(name: &str) -> PathBuf {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("start-{name}"));
    // Another version may have left one.
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).expect("cargo's folder can be written");
    folder
}

fn refuses(words: &[&str], said: &[&str]) {
    let output = telltale(words);
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{words:?}: {text}");
    for part in said {
        assert!(text.contains(part), "{words:?} does not say {part:?}: {text}");
    }
}

#[test]
fn a_broken_configuration_is_shown_where_it_breaks() {
    let file = folder("broken").join("broken.yaml");
    std::fs::write(&file, "vehicle: { id: a, nam: b }\ngroups: []\n").expect("the folder is there");
    let file = file.to_str().expect("the path is text");
    for command in ["serve", "sim"] {
        refuses(
            &[command, "--config", file],
            &["broken.yaml:1:19", "unknown key `nam`", "did you mean `name`?"],
        );
        refuses(
            &[command, "--config", "/nowhere.yaml"],
            &["/nowhere.yaml", "does not exist", "check the path"],
        );
    }
}

#[test]
fn metrics_stay_on_this_machine_unless_that_is_asked_for() {
    let data = folder("metrics");
    let data = data.to_str().expect("the path is text");
    let refused = ["beyond this machine", "--metrics-without-login"];
    refuses(
        &["serve", "--config", SHUTTLE, "--data", data, "--listen", "127.0.0.1:0", "--metrics", "0.0.0.0:0"],
        &refused,
    );
    refuses(&["demo", "--listen", "127.0.0.1:0", "--metrics", "0.0.0.0:0"], &refused);
    refuses(&["demo", "--metrics-without-login"], &["--metrics"]);
}

#[test]
fn a_login_at_an_issuer_that_cannot_work_is_told() {
    let data = folder("oidc");
    let secret = data.join("secret");
    std::fs::write(&secret, "word").expect("the folder is there");
    let readable = std::os::unix::fs::PermissionsExt::from_mode(0o644);
    std::fs::set_permissions(&secret, readable).expect("it is there");
    let (data, secret) = (data.to_str().expect("a path"), secret.to_str().expect("a path"));
    let serve =
        ["fleet", "serve", "--hub", "tls://127.0.0.1:1", "--credentials", "/nowhere.nk", "--data", data];
    let issuer = ["--oidc", "https://id.example", "--oidc-client", "fleet"];
    let granted = ["--oidc-grant", "north=engineer"];
    let said: &[(&[&str], &[&str])] = &[
        (&issuer[..2], &["--oidc-client <ID>", "--oidc-grant <VALUE=ROLE[:NAME,...]>"]),
        (&issuer, &["--oidc-grant <VALUE=ROLE[:NAME,...]>"]),
        (&granted, &["--oidc <ISSUER>"]),
        (&["--oidc", "http://id.example"], &["plain HTTP only reaches an issuer on this machine"]),
        (&["--oidc", "id.example"], &["https://id.example/realms/fleet"]),
        (
            &["--oidc-grant", "north=operator"],
            &["control_room, engineer, authority", "fleet-engineers=engineer"],
        ),
        (&["--oidc-grant", "north=engineer:Bus"], &["can be no name of a vehicle"]),
        (
            &[&issuer[..], &granted, &["--oidc-secret", secret]].concat(),
            &["may be read by others", "chmod 600"],
        ),
        (&[&issuer[..], &granted, &["--oidc-ca", secret]].concat(), &["holds no certificate", "PEM"]),
    ];
    for (words, said) in said {
        refuses(&[&serve[..], words].concat(), said);
    }
}

#[test]
fn a_port_in_use_and_an_address_of_others_are_told() {
    let taken = TcpListener::bind("127.0.0.1:0").expect("some port is free");
    let address = taken.local_addr().expect("it is bound").to_string();
    let data = folder("port");
    let data = data.to_str().expect("the path is text");
    let serve = ["serve", "--config", SHUTTLE, "--data", data, "--interface", "loopback", "--listen"];
    refuses(&[&serve[..], &[&*address]].concat(), &[&address, "is in use", "--listen"]);
    refuses(&["demo", "--listen", &address], &[&address, "is in use", "--listen"]);
    let foreign = [&serve[..], &["203.0.113.9:8080", "--insecure-http"]].concat();
    refuses(&foreign, &["no address 203.0.113.9", "--listen"]);
}

#[test]
fn plain_http_beyond_this_machine_has_to_be_asked_for_by_name() {
    let data = folder("plain");
    let data = data.to_str().expect("the path is text");
    let said = ["is beyond this machine", "--tls-cert", "telltale tls self-signed", "--insecure-http"];
    for listen in ["0.0.0.0:0", "[::]:0", "203.0.113.9:8080"] {
        refuses(&["serve", "--config", SHUTTLE, "--data", data, "--listen", listen], &said);
        refuses(&["demo", "--listen", listen], &said);
    }
}

#[test]
fn an_interface_and_a_domain_that_do_not_exist_are_told() {
    let data = folder("interface");
    let data = data.to_str().expect("the path is text");
    let serve = ["serve", "--config", SHUTTLE, "--listen", "127.0.0.1:0", "--data", data];
    refuses(
        &[&serve[..], &["--interface", "203.0.113.9"]].concat(),
        &["no interface has 203.0.113.9", "127.0.0.1 (lo)"],
    );
    refuses(&[&serve[..], &["--domain", "300"]].concat(), &["domain 300", "0 to 232"]);
    refuses(&["demo", "--listen", "127.0.0.1:0", "--domain", "300"], &["domain 300", "0 to 232"]);
}

#[test]
fn enforced_security_is_refused_and_other_variables_without_effect_are_warned_of() {
    let data = folder("security");
    let data = data.to_str().expect("the path is text");
    // A later option is refused too, so that the program ends.
    let serve =
        ["serve", "--config", SHUTTLE, "--listen", "203.0.113.9:1", "--insecure-http", "--data", data];
    let enforced = [("ROS_SECURITY_ENABLE", "true"), ("ROS_SECURITY_STRATEGY", "Enforce")];
    let output = telltale_with(&serve, &enforced);
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{text}");
    assert!(text.contains("unset ROS_SECURITY_STRATEGY"), "{text}");
    let unheeded = [
        ("ROS_SECURITY_ENABLE", "true"),
        ("RMW_IMPLEMENTATION", "rmw_email_cpp"),
        ("CYCLONEDDS_URI", "file:///none.xml"),
        ("ROS_DISCOVERY_SERVER", "127.0.0.1:11811"),
    ];
    let output = telltale_with(&serve, &unheeded);
    let text = String::from_utf8_lossy(&output.stderr);
    for (variable, value) in unheeded {
        let named = |line: &&str| line.contains(variable) && line.contains("has no effect");
        assert_eq!(text.lines().filter(named).count(), 1, "{variable}={value}: {text}");
    }
}

#[test]
fn a_data_folder_that_cannot_be_written_is_told() {
    let serve = ["serve", "--config", SHUTTLE, "--listen", "127.0.0.1:0", "--interface", "loopback"];
    refuses(&[&serve[..], &["--data", "/proc/telltale"]].concat(), &["/proc/telltale", "writable", "--data"]);
}

#[test]
fn a_data_folder_has_one_display_and_others_may_look_after_it() {
    let folder = folder("held");
    let data = folder.to_str().expect("the path is text");
    assert!(user(&["add", "anna", "--role", "operator", "--data", data], "975310").status.code().is_some());
    let held = std::fs::File::open(&folder).expect("it is there");
    held.try_lock().expect("nobody else has it");
    let serve = ["serve", "--config", SHUTTLE, "--listen", "127.0.0.1:0", "--interface", "loopback"];
    refuses(&[&serve[..], &["--data", data]].concat(), &["another `telltale serve`", data, "--data"]);
    for words in [["user", "list"], ["audit", "verify"]] {
        assert!(telltale(&[&words[..], &["--data", data]].concat()).status.success(), "{words:?}");
    }
    // Who comes after it gets on to what else is wrong.
    drop(held);
    refuses(&[&serve[..], &["--data", data, "--origin", "here"]].concat(), &["\"here\" is no origin"]);
}

#[test]
fn an_origin_behind_a_proxy_on_this_machine_is_warned_of() {
    let data = folder("proxy");
    let data = data.to_str().expect("the path is text");
    // It ends at the origin that is none, after what it has to say.
    let serve = ["serve", "--config", SHUTTLE, "--listen", "127.0.0.1:0", "--data", data, "--origin", "here"];
    let warns = |more: &[&str]| {
        let output = telltale(&[&serve[..], &["--interface", "loopback"], more].concat());
        [output.stdout, output.stderr].concat().windows(14).any(|it| it == b"--display none")
    };
    assert!(warns(&["--origin", "https://shuttle-1.example"]));
    assert!(warns(&["--origin", "http://10.0.0.5", "--display", "loopback"]));
    assert!(!warns(&["--origin", "http://10.0.0.5", "--display", "none"]));
    assert!(!warns(&["--origin", "http://10.0.0.5", "--display", "10.0.0.7"]));
    assert!(!warns(&["--origin", "http://localhost:9000"]) && !warns(&["--origin", "http://[::1]:9000"]));
}

#[test]
fn an_origin_that_is_none_is_told() {
    let data = folder("origin");
    let data = data.to_str().expect("the path is text");
    let serve =
        ["serve", "--config", SHUTTLE, "--listen", "127.0.0.1:0", "--interface", "loopback", "--data", data];
    refuses(
        &[&serve[..], &["--origin", "here"]].concat(),
        &["--origin", "\"here\" is no origin", "https://"],
    );
}

/// Runs `telltale user ...` with a secret on standard input.
fn user(words: &[&str], secret: &str) -> Output {
    program::run_with([&["user"], words].concat(), &format!("{secret}\n{secret}\n"))
}

#[test]
fn only_the_first_user_makes_a_database() {
    let folder = folder("typo").join("nowhere");
    let _ = std::fs::remove_dir_all(&folder);
    let data = folder.to_str().expect("the path is text");
    for words in [
        &["user", "list"][..],
        &["user", "passwd", "anna"],
        &["user", "remove", "anna"],
        &["user", "tokens"],
        &["user", "token", "anna"],
        &["audit", "verify"],
    ] {
        refuses(&[words, &["--data", data]].concat(), &["there is no database", "nowhere", "--data"]);
        assert!(!folder.exists(), "{words:?} made {data}");
        // A folder that may not be read is not called empty.
        refuses(
            &[words, &["--data", "/dev/null/data"]].concat(),
            &["/dev/null/data cannot be used", "--data"],
        );
    }
}

#[test]
fn users_and_tokens_are_made_on_the_command_line_and_recorded() {
    let folder = folder("users");
    let _ = std::fs::remove_dir_all(&folder);
    let data = folder.to_str().expect("the path is text");
    let long = "x".repeat(65);
    for (name, role, secret, good) in [
        ("anna", "operator", "975310", true),
        ("dora", "developer", "a long password", true),
        ("dora", "developer", "a long password", false),
        ("<b>x", "operator", "975310", false),
        ("a b", "operator", "975310", false),
        (&long, "operator", "975310", false),
        ("short", "developer", "975310", false),
    ] {
        let added = user(&["add", name, "--role", role, "--data", data], secret);
        assert_eq!(added.status.success(), good, "{name} {role}: {added:?}");
        let said = String::from_utf8_lossy(&added.stderr).into_owned();
        assert_eq!(said.contains("no server runs on"), good, "{name} {role}: {said}");
        assert!(!folder.join("telltale.db-wal").exists(), "it is not closed");
    }
    let token = user(&["token", "dora", "--label", "dashboard", "--data", data], "");
    let token = String::from_utf8(token.stdout).expect("it is text");
    assert!(token.trim().len() == 64, "the token alone is on standard output: {token:?}");
    refuses(&["user", "token", "anna", "--data", data], &["anna is an operator"]);
    let tokens = telltale(&["user", "tokens", "--data", data]);
    let listed = String::from_utf8_lossy(&tokens.stdout).into_owned();
    assert!(listed.contains("dashboard") && !listed.contains(token.trim()), "{listed}");
    let file = std::fs::read(folder.join("telltale.db-wal")).unwrap_or_default();
    let file = [std::fs::read(folder.join("telltale.db")).expect("it is there"), file].concat();
    assert!(!file.windows(64).any(|it| it == token.trim().as_bytes()), "the token lies on the disk");
    assert!(
        user(&["role", "dora", "--role", "authority", "--data", data], "another password").status.success()
    );
    assert!(telltale(&["user", "tokens", "--data", data]).stdout.is_empty(), "tokens end with the role");

    let verified = telltale(&["audit", "verify", "--data", data]);
    let said = String::from_utf8_lossy(&verified.stdout).into_owned();
    assert!(verified.status.success() && said.contains("4 records"), "{said}");
    let foreign = format!("3:{}", "0".repeat(64));
    let other = telltale(&["audit", "verify", "--data", data, "--head", &foreign]);
    let said = String::from_utf8_lossy(&other.stdout).into_owned();
    assert!(other.status.code() == Some(1) && said.contains("record 3"), "{said}");
    refuses(&["audit", "verify", "--data", data, "--head", "3"], &["a head is a number, a colon"]);

    let noted = std::fs::read_to_string(folder.join("audit.head")).expect("it is noted");
    std::fs::remove_file(folder.join("audit.head")).expect("it is there");
    let open = telltale(&["audit", "verify", "--data", data]);
    let said = String::from_utf8_lossy(&open.stdout).into_owned();
    assert!(
        open.status.code() == Some(1)
            && said.starts_with("BAD")
            && said.contains("audit.head")
            && said.contains("--head"),
        "{said}"
    );
    let proven = telltale(&["audit", "verify", "--data", data, "--head", noted.trim()]);
    assert!(proven.status.success(), "{proven:?}");
    assert!(telltale(&["user", "list", "--data", data]).status.success());
    let recorded = telltale(&["audit", "verify", "--data", data, "--head", noted.trim()]);
    let said = String::from_utf8_lossy(&recorded.stdout).into_owned();
    assert!(recorded.status.success() && said.contains("5 records"), "the loss is a record: {said}");
}

#[test]
fn a_certificate_that_cannot_be_used_is_told_before_anything_listens() {
    let folder = folder("tls");
    let data = folder.to_str().expect("the path is text");
    let made = telltale(&["tls", "self-signed", "--replace", "--name", "shuttle-1.example", "--data", data]);
    assert!(made.status.success(), "{made:?}");
    let [certificate, key] = ["tls-cert.pem", "tls-key.pem"].map(|name| format!("{data}/{name}"));
    let serve =
        ["serve", "--config", SHUTTLE, "--listen", "127.0.0.1:0", "--interface", "loopback", "--data", data];
    let with = |more: &[&str], said: &[&str]| refuses(&[&serve[..], more].concat(), said);
    with(&["--tls-cert", &certificate], &["--tls-key"]);
    with(&["--tls-cert", &key, "--tls-key", &key], &["tls-key.pem", "holds no certificate"]);
    with(&["--tls-cert", &certificate, "--tls-key", "/nowhere.pem"], &["/nowhere.pem", "cannot be read"]);
    let origin = ["--tls-cert", &certificate, "--tls-key", &key, "--origin", "https://shuttle-2.example"];
    with(
        &origin,
        &["--origin https://shuttle-2.example", "does not name shuttle-2.example", "shuttle-1.example"],
    );
    with(&["--display", "shuttle"], &["is no display", "loopback"]);
    refuses(&["tls", "self-signed", "--data", data], &["tls-cert.pem is there already", "--replace"]);
}
