//! The configuration of the Zenoh session: that of rmw_zenoh, from the same variables of the environment.

use zenoh::Config;

use crate::transport::BODY_BYTES_MAX;

/// A configuration file in JSON5.
const FILE: &str = "ZENOH_SESSION_CONFIG_URI";
/// Single settings, `key=value;key=value`, with values in JSON5.
const OVERRIDE: &str = "ZENOH_CONFIG_OVERRIDE";
/// The router of rmw_zenoh.
const ROUTER: &str = r#"["tcp/localhost:7447"]"#;

/// The longest time for all routers together, and for each, in milliseconds.
const OPENING_MS: usize = 8000;
const OPENING_ONE_MS: usize = 3000;

/// Reads the environment, unless a router is given. Telltale is always a client: a peer that hangs would hold back the vehicle's publishers.
///
/// # Errors
/// A variable that is not understood, and what to do.
pub fn session(router: Option<&str>, env: impl Fn(&str) -> Option<String>) -> Result<Config, String> {
    let env = |name: &str| env(name).filter(|value| !value.is_empty() && router.is_none());
    let mut config = match env(FILE) {
        Some(uri) => {
            let path = uri.strip_prefix("file://").unwrap_or(&uri);
            Config::from_file(path).map_err(|error| format!("{FILE}={uri:?} cannot be read: {error}"))?
        }
        None => defaults(router)?,
    };
    for setting in env(OVERRIDE).iter().flat_map(|all| all.split(';')).filter(|it| !it.trim().is_empty()) {
        let wrong = |why: String| format!("{OVERRIDE}: {setting:?} is not understood: {why}");
        let (key, value) = setting.split_once('=').ok_or_else(|| wrong("write KEY=VALUE".to_owned()))?;
        config.insert_json5(key.trim(), value.trim()).map_err(|error| wrong(error.to_string()))?;
    }
    // The library tries each router once: with a time for all of them it would spend that on the first.
    let routers = config.get_json("connect/endpoints").map_or(1, |texts| texts.matches('"').count() / 2);
    let each_ms = (OPENING_MS / routers.max(1)).min(OPENING_ONE_MS).to_string();
    let limit = (BODY_BYTES_MAX + (1 << 20)).to_string();
    let ours = [
        ("mode", r#""client""#),
        ("listen/endpoints", "[]"),
        ("transport/link/rx/max_message_size", &*limit),
        ("connect/timeout_ms", "0"),
        ("transport/unicast/open_timeout", &*each_ms),
        ("connect/exit_on_failure", "true"),
    ];
    set(&mut config, &ours)?;
    Ok(config)
}

fn defaults(router: Option<&str>) -> Result<Config, String> {
    let mut config = Config::default();
    let router = router.map_or_else(|| ROUTER.to_owned(), |endpoint| format!("[\"{endpoint}\"]"));
    set(
        &mut config,
        &[
            ("connect/endpoints", &*router),
            ("scouting/multicast/enabled", "false"),
            ("scouting/gossip/enabled", "false"),
            ("transport/link/tx/lease", "60000"),
        ],
    )?;
    Ok(config)
}

/// A router on this computer alone, for simulations.
pub fn router() -> Result<Config, String> {
    let mut config = defaults(None)?;
    let ours = [
        ("mode", r#""router""#),
        ("connect/endpoints", "[]"),
        ("listen/endpoints", r#"["tcp/127.0.0.1:0"]"#),
    ];
    set(&mut config, &ours)?;
    Ok(config)
}

fn set(config: &mut Config, settings: &[(&str, &str)]) -> Result<(), String> {
    let mut set = |(key, value): &(&str, &str)| {
        config.insert_json5(key, value).map_err(|error| format!("Zenoh takes no {key}: {error}"))
    };
    settings.iter().try_for_each(&mut set)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config(env: &[(&str, &str)]) -> Result<Config, String> {
        session(None, |name| env.iter().find(|(key, _)| *key == name).map(|(_, value)| (*value).to_owned()))
    }

    fn is(config: &Config, key: &str) -> String {
        config.get_json(key).unwrap_or_default()
    }

    #[test]
    fn telltale_is_a_client_of_the_router_that_the_environment_names() {
        let plain = config(&[]).unwrap();
        assert_eq!(is(&plain, "mode"), r#""client""#);
        assert_eq!(is(&plain, "connect/endpoints"), r#"["tcp/localhost:7447"]"#);
        let other = r#"connect/endpoints=["tcp/10.0.0.1:7447"];mode="peer";listen/endpoints=["tcp/[::]:0"]"#;
        let other = config(&[(OVERRIDE, other)]).unwrap();
        assert_eq!(is(&other, "connect/endpoints"), r#"["tcp/10.0.0.1:7447"]"#);
        assert_eq!((is(&other, "mode"), is(&other, "listen/endpoints")), (r#""client""#.into(), "[]".into()));
        let four = r#"connect/endpoints=["tcp/a:1","tcp/b:1","tcp/c:1","tcp/d:1"]"#;
        let opening = |config: &Config| is(config, "transport/unicast/open_timeout");
        assert_eq!([opening(&plain), opening(&config(&[(OVERRIDE, four)]).unwrap())], ["3000", "2000"]);
    }

    #[test]
    fn a_variable_that_is_not_understood_is_named() {
        for (variable, value) in [(FILE, "/nowhere.json5"), (OVERRIDE, "mode"), (OVERRIDE, "nothing/such=1")]
        {
            let error = config(&[(variable, value)]).unwrap_err();
            assert!(error.contains(variable), "{error}");
        }
    }
}
