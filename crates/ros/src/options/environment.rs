//! Environment variables of ROS 2: the one that names the middleware, and those that Telltale cannot honour. Each of
//! these is reported, and if security is enforced, nothing is started.

use super::{OptionsError, Transport};

/// RMW implementations that speak DDS, as this program does.
const DDS_RMWS: [&str; 5] = [
    "rmw_cyclonedds_cpp",
    "rmw_fastrtps_cpp",
    "rmw_fastrtps_dynamic_cpp",
    "rmw_connextdds",
    "rmw_gurumdds_cpp",
];

const ZENOH_RMW: &str = "rmw_zenoh_cpp";

/// The middleware that ROS 2 would use here.
pub fn transport(env: &impl Fn(&str) -> Option<String>) -> Transport {
    if env("RMW_IMPLEMENTATION").as_deref() == Some(ZENOH_RMW) { Transport::Zenoh } else { Transport::Dds }
}

/// A line for each variable that has no effect here.
///
/// # Errors
/// DDS may be spoken only with security.
pub fn unheeded(
    transport: Transport,
    env: &impl Fn(&str) -> Option<String>,
) -> Result<Vec<String>, OptionsError> {
    let mut lines = Vec::new();
    if transport == Transport::Zenoh {
        let of_dds = [
            "ROS_LOCALHOST_ONLY",
            "ROS_AUTOMATIC_DISCOVERY_RANGE",
            "ROS_STATIC_PEERS",
            "ROS_SECURITY_ENABLE",
        ];
        for variable in of_dds.into_iter().filter(|variable| env(variable).is_some()) {
            lines.push(format!(
                "{variable} has no effect over Zenoh: ZENOH_SESSION_CONFIG_URI and ZENOH_CONFIG_OVERRIDE say where the \
                 router is and how it is spoken to"
            ));
        }
        return Ok(lines);
    }
    if env("ROS_SECURITY_ENABLE").as_deref() == Some("true") {
        if env("ROS_SECURITY_STRATEGY").as_deref() == Some("Enforce") {
            return Err(OptionsError::Security);
        }
        lines.push(
            "ROS_SECURITY_ENABLE=true has no effect: Telltale speaks DDS without security, hears no node that \
             insists on it, and believes what it hears from all others"
                .to_owned(),
        );
    }
    if let Some(rmw) = env("RMW_IMPLEMENTATION").filter(|rmw| !DDS_RMWS.contains(&rmw.as_str())) {
        lines.push(format!(
            "RMW_IMPLEMENTATION={rmw} has no effect: Telltale speaks DDS now, and hears no node that speaks anything \
             else. Nodes with rmw_zenoh_cpp are heard with --transport zenoh"
        ));
    }
    for (variable, instead) in [
        ("CYCLONEDDS_URI", "choose the interface with --interface and hosts without multicast with --peer"),
        ("FASTRTPS_DEFAULT_PROFILES_FILE", "choose the interface with --interface and hosts with --peer"),
        ("FASTDDS_DEFAULT_PROFILES_FILE", "choose the interface with --interface and hosts with --peer"),
        ("ROS_DISCOVERY_SERVER", "Telltale finds nodes without a server, by multicast or with --peer"),
    ] {
        if env(variable).is_some() {
            lines.push(format!("{variable} has no effect on Telltale: {instead}"));
        }
    }
    Ok(lines)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(env: &[(&str, &str)]) -> Result<Vec<String>, String> {
        let look =
            |name: &str| env.iter().find(|(key, _)| *key == name).map(|(_, value)| (*value).to_owned());
        unheeded(Transport::Dds, &look).map_err(|error| error.to_string())
    }

    #[test]
    fn each_variable_without_effect_is_said() {
        assert_eq!(told(&[("ROS_DOMAIN_ID", "3"), ("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp")]), Ok(vec![]));
        for (variable, value, expected) in [
            ("RMW_IMPLEMENTATION", "rmw_email", "rmw_email has no effect: Telltale speaks DDS now"),
            ("CYCLONEDDS_URI", "file:///c.xml", "CYCLONEDDS_URI has no effect on Telltale: choose"),
            ("FASTRTPS_DEFAULT_PROFILES_FILE", "f.xml", "FASTRTPS_DEFAULT_PROFILES_FILE has no effect"),
            ("FASTDDS_DEFAULT_PROFILES_FILE", "f.xml", "FASTDDS_DEFAULT_PROFILES_FILE has no effect"),
            ("ROS_DISCOVERY_SERVER", "10.0.0.1:11811", "ROS_DISCOVERY_SERVER has no effect"),
            ("ROS_SECURITY_ENABLE", "true", "believes what it hears"),
        ] {
            let lines = told(&[(variable, value)]).unwrap();
            assert!(lines.len() == 1 && lines[0].contains(expected), "{lines:?}");
        }
    }

    #[test]
    fn where_security_is_enforced_nothing_is_started() {
        let error =
            told(&[("ROS_SECURITY_ENABLE", "true"), ("ROS_SECURITY_STRATEGY", "Enforce")]).unwrap_err();
        assert!(error.contains("unset ROS_SECURITY_STRATEGY"), "{error}");
        assert_eq!(told(&[("ROS_SECURITY_STRATEGY", "Enforce")]), Ok(vec![]), "ROS 2 asks for both");
    }
}
