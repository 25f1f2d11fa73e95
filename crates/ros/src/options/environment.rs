//! Environment variables of ROS 2 that Telltale cannot honour: each is reported, and if security is
//! enforced, nothing is started.

use super::OptionsError;

/// RMW implementations that speak DDS, as this program does.
const DDS_RMWS: [&str; 5] = [
    "rmw_cyclonedds_cpp",
    "rmw_fastrtps_cpp",
    "rmw_fastrtps_dynamic_cpp",
    "rmw_connextdds",
    "rmw_gurumdds_cpp",
];

/// A line for each variable that has no effect here.
///
/// # Errors
/// DDS may be spoken only with security.
pub fn unheeded(env: &impl Fn(&str) -> Option<String>) -> Result<Vec<String>, OptionsError> {
    let mut lines = Vec::new();
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
            "RMW_IMPLEMENTATION={rmw} has no effect: Telltale speaks DDS. It hears no node that speaks anything \
             else, such as Zenoh; give those nodes a DDS implementation, for example rmw_cyclonedds_cpp"
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
        unheeded(&look).map_err(|error| error.to_string())
    }

    #[test]
    fn each_variable_without_effect_is_said() {
        assert_eq!(told(&[("ROS_DOMAIN_ID", "3"), ("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp")]), Ok(vec![]));
        for (variable, value, expected) in [
            ("RMW_IMPLEMENTATION", "rmw_zenoh_cpp", "rmw_zenoh_cpp has no effect: Telltale speaks DDS."),
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
