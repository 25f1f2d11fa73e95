//! Where on the network the bridge listens: flags, then what ROS 2 reads from the environment.

use std::fmt;
use std::net::{IpAddr, Ipv4Addr};

use super::fields::Definitions;
use super::interfaces::{self, Address};
use super::messages::GidSize;

/// The last domain whose ports are below 65536 (RTPS 2.5, 9.6.2.3).
pub const DOMAIN_MAX: u16 = 232;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Interface {
    /// The one that has this address.
    Ip(Ipv4Addr),
    /// Nothing leaves the machine.
    Loopback,
    All,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BridgeOptions {
    pub domain: u16,
    pub interface: Interface,
    /// What the distribution says; otherwise the bridge learns it from others.
    pub gid_size: Option<GidSize>,
    /// Of the messages whose fields are read.
    pub definitions: Definitions,
    /// As which the bridge is announced in the graph of ROS 2.
    pub node: &'static str,
}

const NODE: &str = "telltale";

#[derive(Debug, thiserror::Error)]
pub enum OptionsError {
    #[error("domain {0} does not exist: ROS domains are 0 to {DOMAIN_MAX}")]
    Domain(u64),
    #[error("{variable}={value:?} is not understood: set it to {expected}, or unset it")]
    Variable { variable: &'static str, value: String, expected: &'static str },
    #[error(
        "ROS_AUTOMATIC_DISCOVERY_RANGE=OFF hides every publisher: unset it, set it to LOCALHOST or SUBNET, or \
         choose with --interface"
    )]
    DiscoveryOff,
    #[error("no interface has {asked}; give `all`, `loopback`, or one of: {existing}")]
    NoSuchInterface { asked: String, existing: Existing },
    #[error("the network interfaces cannot be listed: {0}")]
    Interfaces(#[from] std::io::Error),
}

/// The addresses that a user may choose from.
#[derive(Debug)]
pub struct Existing(Vec<Address>);

impl fmt::Display for Existing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0.is_empty() {
            return f.write_str("(none has an IPv4 address now)");
        }
        for (index, address) in self.0.iter().enumerate() {
            let comma = if index == 0 { "" } else { ", " };
            write!(f, "{comma}{} ({})", address.ip, address.interface)?;
        }
        Ok(())
    }
}

impl BridgeOptions {
    /// Loopback alone, as demonstrations and tests use it.
    pub fn loopback(domain: u16) -> BridgeOptions {
        BridgeOptions {
            domain,
            interface: Interface::Loopback,
            gid_size: None,
            definitions: Definitions::default(),
            node: NODE,
        }
    }

    /// Flags win over `ROS_DOMAIN_ID`, `ROS_LOCALHOST_ONLY` and `ROS_AUTOMATIC_DISCOVERY_RANGE`,
    /// which `env` looks up. `interface` is `all`, `loopback`, an IPv4 address or an interface's name.
    ///
    /// # Errors
    /// What is out of range, not understood or not there, and what to do.
    pub fn resolve(
        domain: Option<u16>,
        interface: Option<&str>,
        env: impl Fn(&str) -> Option<String>,
    ) -> Result<BridgeOptions, OptionsError> {
        // An empty variable counts as unset, as in ROS 2.
        let env = |name: &str| env(name).filter(|value| !value.is_empty());
        let domain = match domain {
            Some(domain) => u64::from(domain),
            None => domain_of_environment(&env)?,
        };
        let domain = u16::try_from(domain)
            .ok()
            .filter(|&domain| domain <= DOMAIN_MAX)
            .ok_or(OptionsError::Domain(domain))?;
        let interface = match interface {
            Some(word) => interface_of_flag(word, interfaces::addresses()?)?,
            None => interface_of_environment(&env)?,
        };
        let gid_size = env("ROS_DISTRO").and_then(|name| GidSize::of_distro(&name));
        let definitions = Definitions::of_environment(Vec::new(), env);
        Ok(BridgeOptions { domain, interface, gid_size, definitions, node: NODE })
    }
}

fn domain_of_environment(env: &impl Fn(&str) -> Option<String>) -> Result<u64, OptionsError> {
    const VARIABLE: &str = "ROS_DOMAIN_ID";
    let Some(value) = env(VARIABLE) else { return Ok(0) };
    value.trim().parse().map_err(|_| OptionsError::Variable {
        variable: VARIABLE,
        value,
        expected: "a number from 0 to 232",
    })
}

fn interface_of_environment(env: &impl Fn(&str) -> Option<String>) -> Result<Interface, OptionsError> {
    const ONLY: &str = "ROS_LOCALHOST_ONLY";
    const RANGE: &str = "ROS_AUTOMATIC_DISCOVERY_RANGE";
    // Deprecated, but where it is enabled it wins, as in rcl.
    match env(ONLY).as_deref() {
        None | Some("0") => {}
        Some("1") => return Ok(Interface::Loopback),
        Some(value) => {
            return Err(OptionsError::Variable {
                variable: ONLY,
                value: value.to_owned(),
                expected: "0 or 1",
            });
        }
    }
    match env(RANGE).as_deref() {
        None | Some("SUBNET" | "SYSTEM_DEFAULT") => Ok(Interface::All),
        Some("LOCALHOST") => Ok(Interface::Loopback),
        Some("OFF") => Err(OptionsError::DiscoveryOff),
        Some(value) => Err(OptionsError::Variable {
            variable: RANGE,
            value: value.to_owned(),
            expected: "LOCALHOST, SUBNET or SYSTEM_DEFAULT",
        }),
    }
}

fn interface_of_flag(word: &str, existing: Vec<Address>) -> Result<Interface, OptionsError> {
    match word {
        "all" => return Ok(Interface::All),
        "loopback" | "localhost" | "lo" => return Ok(Interface::Loopback),
        _ => {}
    }
    let asked = word.parse::<IpAddr>();
    let found = existing.iter().find(|address| match asked {
        Ok(ip) => ip == IpAddr::V4(address.ip),
        Err(_) => *address.interface == *word,
    });
    match found {
        Some(address) if address.ip.is_loopback() => Ok(Interface::Loopback),
        Some(address) => Ok(Interface::Ip(address.ip)),
        None => {
            Err(no_such(asked.map_or_else(|_| format!("the name {word:?}"), |ip| ip.to_string()), existing))
        }
    }
}

fn no_such(asked: String, existing: Vec<Address>) -> OptionsError {
    OptionsError::NoSuchInterface { asked, existing: Existing(existing) }
}

/// The addresses that the participant may use; `None` for all.
///
/// # Errors
/// No interface has the address now.
pub(super) fn networks(interface: Interface) -> Result<Option<Vec<Ipv4Addr>>, OptionsError> {
    match interface {
        Interface::All => Ok(None),
        Interface::Loopback => Ok(Some(vec![Ipv4Addr::LOCALHOST])),
        Interface::Ip(ip) => {
            let existing = interfaces::addresses()?;
            if existing.iter().any(|address| address.ip == ip) {
                Ok(Some(vec![ip]))
            } else {
                Err(no_such(ip.to_string(), existing))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn resolve(
        domain: Option<u16>,
        interface: Option<&str>,
        env: &[(&str, &str)],
    ) -> Result<BridgeOptions, String> {
        let env: Vec<(String, String)> =
            env.iter().map(|(name, value)| ((*name).to_owned(), (*value).to_owned())).collect();
        let look_up =
            move |name: &str| env.iter().find(|(known, _)| known == name).map(|(_, value)| value.clone());
        BridgeOptions::resolve(domain, interface, look_up).map_err(|error| error.to_string())
    }

    #[test]
    fn environment_as_ros_2_reads_it() {
        type Case = (&'static [(&'static str, &'static str)], u16, Interface);
        let cases: [Case; 8] = [
            (&[], 0, Interface::All),
            (&[("ROS_DOMAIN_ID", "")], 0, Interface::All),
            (&[("ROS_DOMAIN_ID", "42")], 42, Interface::All),
            (&[("ROS_LOCALHOST_ONLY", "1")], 0, Interface::Loopback),
            (&[("ROS_LOCALHOST_ONLY", "0"), ("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")], 0, Interface::All),
            (&[("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")], 0, Interface::Loopback),
            (&[("ROS_AUTOMATIC_DISCOVERY_RANGE", "SYSTEM_DEFAULT")], 0, Interface::All),
            (
                &[("ROS_LOCALHOST_ONLY", "1"), ("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")],
                0,
                Interface::Loopback,
            ),
        ];
        for (env, domain, interface) in cases {
            let options = resolve(None, None, env).unwrap();
            assert_eq!((options.domain, options.interface), (domain, interface), "{env:?}");
        }
    }

    #[test]
    fn flags_win() {
        let env = [("ROS_DOMAIN_ID", "no number"), ("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")];
        let options = resolve(Some(7), Some("loopback"), &env).unwrap();
        assert_eq!((options.domain, options.interface), (7, Interface::Loopback));
        assert_eq!(resolve(Some(7), Some("127.0.0.1"), &env).unwrap().interface, Interface::Loopback);
        assert_eq!(resolve(Some(7), Some("all"), &env).unwrap().interface, Interface::All);
    }

    #[test]
    fn the_distribution_tells_the_size_of_a_gid() {
        let humble = resolve(None, None, &[("ROS_DISTRO", "humble")]).unwrap();
        assert_eq!(humble.gid_size, Some(GidSize::Bytes24));
        assert_eq!(resolve(None, None, &[]).unwrap().gid_size, None);
    }

    #[test]
    fn errors_say_what_to_do() {
        type Case =
            (Option<u16>, Option<&'static str>, &'static [(&'static str, &'static str)], &'static str);
        let cases: [Case; 7] = [
            (Some(233), None, &[], "domain 233 does not exist: ROS domains are 0 to 232"),
            (None, None, &[("ROS_DOMAIN_ID", "300")], "domain 300 does not exist: ROS domains are 0 to 232"),
            (None, None, &[("ROS_DOMAIN_ID", "a")], "set it to a number from 0 to 232"),
            (None, None, &[("ROS_LOCALHOST_ONLY", "yes")], "set it to 0 or 1"),
            (None, None, &[("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")], "choose with --interface"),
            (None, None, &[("ROS_AUTOMATIC_DISCOVERY_RANGE", "subnet")], "set it to LOCALHOST, SUBNET or"),
            (
                None,
                Some("203.0.113.9"),
                &[],
                "no interface has 203.0.113.9; give `all`, `loopback`, or one of: ",
            ),
        ];
        for (domain, interface, env, expected) in cases {
            let error = resolve(domain, interface, env).unwrap_err();
            assert!(error.contains(expected), "{error}");
        }
        let error = resolve(None, Some("wlan77"), &[]).unwrap_err();
        assert!(error.contains("wlan77") && error.contains("127.0.0.1 (lo)"), "{error}");
    }
}
