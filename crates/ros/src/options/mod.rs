//! Options of the bridge: where on the network it listens, from flags and then from the environment of ROS
//! 2.

pub(super) mod environment;
pub(super) mod interfaces;

use std::fmt;
use std::net::{IpAddr, Ipv4Addr};

use interfaces::Address;
use telltale_msg::fields::Definitions;
use telltale_msg::messages::GidSize;

/// The last domain whose ports are below 65536 (RTPS 2.5, 9.6.2.3).
pub const DOMAIN_MAX: u16 = 232;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Interface {
    /// The interface that has this address.
    Ip(Ipv4Addr),
    /// Nothing leaves the machine.
    Loopback,
    All,
}

/// The middleware of ROS 2.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Transport {
    Dds,
    /// As rmw_zenoh speaks it, through the router that the environment names.
    Zenoh,
}

/// As people are told of it.
impl std::fmt::Display for Transport {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Transport::Dds => "DDS",
            Transport::Zenoh => "Zenoh",
        })
    }
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BridgeOptions {
    pub transport: Transport,
    /// The Zenoh router, in place of the one that the environment names.
    pub router: Option<Box<str>>,
    pub domain: u16,
    pub interface: Interface,
    /// The size of a gid in this distribution; if it is unknown, the bridge learns it from others.
    pub gid_size: Option<GidSize>,
    /// Definitions of the messages whose fields are read.
    pub definitions: Definitions,
    /// The name of the bridge in the ROS 2 graph.
    pub node: &'static str,
    /// The namespace of our nodes and of topics without a first slash: empty, or `/ns`.
    pub namespace: Box<str>,
    /// Hosts that multicast does not reach, by address or name.
    pub peers: Vec<Box<str>>,
    /// Settings of the environment that have no effect, a line each.
    pub unheeded: Vec<String>,
    /// Where the library of DDS or Zenoh runs.
    pub dds_process: DdsProcess,
}

/// Where the library of DDS or Zenoh runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DdsProcess {
    /// In a child process of this program, with this limit on its memory, and the form of its log (`--log`).
    Child { megabytes: u32, log: &'static str },
    /// In this process: for tests and benchmarks of the library, which are another program.
    Thread,
}

const NODE: &str = "telltale";

/// Each peer costs 32 datagrams every other second.
const PEERS_MAX: usize = 64;

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
    #[error(
        "ROS_SECURITY_ENABLE=true with ROS_SECURITY_STRATEGY=Enforce asks for DDS with security, which Telltale does \
         not speak: it would neither be heard nor know whom it hears. To start it all the same, beside nodes \
         without security, unset ROS_SECURITY_STRATEGY for it"
    )]
    Security,
    #[error("{0:?} is no host: give an IPv4 address or a name")]
    Peer(String),
    #[error("{0} peers are too many: at most {PEERS_MAX} are spoken to")]
    TooManyPeers(usize),
    #[error(
        "a peer on another machine is not reached over the loopback interface: choose the one that leads there with \
         --interface, or `all`"
    )]
    PeerBeyondLoopback,
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
    /// Loopback only, for demonstrations and tests.
    pub fn loopback(domain: u16) -> BridgeOptions {
        BridgeOptions {
            transport: Transport::Dds,
            router: None,
            dds_process: DdsProcess::Thread,
            domain,
            interface: Interface::Loopback,
            gid_size: None,
            definitions: Definitions::default(),
            node: NODE,
            namespace: Box::default(),
            peers: Vec::new(),
            unheeded: Vec::new(),
        }
    }

    /// A name as ROS 2 resolves it: names without a first slash are below the namespace.
    pub fn whole_name(&self, name: &str) -> String {
        if name.starts_with('/') { name.to_owned() } else { format!("{}/{name}", self.namespace) }
    }

    /// The same over Zenoh: it has no interfaces and no peers, and a gid always has 16 bytes.
    #[must_use]
    pub fn over_zenoh(self) -> BridgeOptions {
        let (transport, interface) = (Transport::Zenoh, Interface::Loopback);
        BridgeOptions { transport, interface, gid_size: Some(GidSize::Bytes16), peers: Vec::new(), ..self }
    }

    /// `transport` is that of the flag; without one, `RMW_IMPLEMENTATION` decides between DDS and Zenoh.
    ///
    /// Flags win over `ROS_DOMAIN_ID`, `ROS_LOCALHOST_ONLY`, `ROS_AUTOMATIC_DISCOVERY_RANGE` and
    /// `ROS_STATIC_PEERS`, which `env` looks up. `interface` is `all`, `loopback`, an IPv4 address or an
    /// interface's name.
    ///
    /// # Errors
    /// A value that is out of range, not understood or does not exist, and what to do.
    pub fn resolve(
        transport: Option<Transport>,
        domain: Option<u16>,
        interface: Option<&str>,
        peers: &[String],
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
        let namespace = namespace(&env)?;
        let transport = transport.unwrap_or_else(|| environment::transport(&env));
        let mut unheeded = environment::unheeded(transport, &env)?;
        let peers = peers_of(peers, interface, &env, &mut unheeded)?;
        let dds_process = DdsProcess::Child { megabytes: DdsProcess::MEGABYTES, log: "text" };
        let options = BridgeOptions {
            transport: Transport::Dds,
            router: None,
            domain,
            interface,
            gid_size,
            definitions,
            node: NODE,
            namespace,
            peers,
            unheeded,
            dds_process,
        };
        Ok(if transport == Transport::Zenoh { options.over_zenoh() } else { options })
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

/// Separated by semicolons in the variable, as in ROS 2.
fn peers_of(
    flags: &[String],
    interface: Interface,
    env: &impl Fn(&str) -> Option<String>,
    unheeded: &mut Vec<String>,
) -> Result<Vec<Box<str>>, OptionsError> {
    const VARIABLE: &str = "ROS_STATIC_PEERS";
    let is_host = |word: &str| {
        let is_known = |c: char| c.is_ascii_alphanumeric() || matches!(c, '.' | '-' | '_');
        word.len() <= 253 && word.chars().all(is_known)
    };
    let split = |list: &str| -> Vec<Box<str>> {
        list.split(';').map(str::trim).filter(|word| !word.is_empty()).map(Box::from).collect()
    };
    let (peers, from_environment): (Vec<Box<str>>, bool) = match env(VARIABLE) {
        Some(list) if flags.is_empty() => (split(&list), true),
        _ => (flags.iter().flat_map(|list| split(list)).collect(), false),
    };
    if let Some(wrong) = peers.iter().find(|word| !is_host(word)) {
        return Err(OptionsError::Peer(wrong.to_string()));
    }
    if peers.len() > PEERS_MAX {
        return Err(OptionsError::TooManyPeers(peers.len()));
    }
    let is_here = |peer: &str| peer == "localhost" || peer.parse().is_ok_and(|ip: IpAddr| ip.is_loopback());
    if interface == Interface::Loopback && !peers.iter().all(|peer| is_here(peer)) {
        if !from_environment {
            return Err(OptionsError::PeerBeyondLoopback);
        }
        unheeded.push(format!(
            "{VARIABLE} has no effect: nothing leaves this machine, as ROS_AUTOMATIC_DISCOVERY_RANGE, \
             ROS_LOCALHOST_ONLY or --interface says. Choose the interface that leads to the peers with --interface"
        ));
        return Ok(Vec::new());
    }
    Ok(peers)
}

/// ROS 2 itself knows only `--ros-args -r __ns:=`; the variable comes from ROS 1 and many launch files.
fn namespace(env: &impl Fn(&str) -> Option<String>) -> Result<Box<str>, OptionsError> {
    const VARIABLE: &str = "ROS_NAMESPACE";
    let Some(value) = env(VARIABLE) else { return Ok(Box::default()) };
    let parts = value.trim_matches('/').split('/');
    let is_token = |part: &str| {
        part.chars().all(|c| c == '_' || c.is_ascii_alphanumeric())
            && !part.starts_with(|first: char| first.is_ascii_digit())
            && !part.is_empty()
    };
    if value.trim_matches('/').is_empty() {
        Ok(Box::default())
    } else if parts.clone().all(is_token) {
        Ok(format!("/{}", value.trim_matches('/')).into())
    } else {
        Err(OptionsError::Variable { variable: VARIABLE, value, expected: "a name such as /robot1" })
    }
}

fn interface_of_environment(env: &impl Fn(&str) -> Option<String>) -> Result<Interface, OptionsError> {
    const ONLY: &str = "ROS_LOCALHOST_ONLY";
    const RANGE: &str = "ROS_AUTOMATIC_DISCOVERY_RANGE";
    // Deprecated, but if it is enabled it wins, as in rcl.
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
        BridgeOptions::resolve(None, domain, interface, &[], look_up).map_err(|error| error.to_string())
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
    fn peers_come_from_flags_or_the_environment() {
        let resolve = |flags: &[&str], interface: &str, env: &str| {
            let flags: Vec<String> = flags.iter().map(|&flag| flag.to_owned()).collect();
            let look = |name: &str| (name == "ROS_STATIC_PEERS").then(|| env.to_owned());
            let options = BridgeOptions::resolve(None, None, Some(interface), &flags, look);
            options.map(|it| (it.peers.join(" "), it.unheeded.len())).map_err(|error| error.to_string())
        };
        let peers = |list: &str, unheeded| Ok((list.to_owned(), unheeded));
        assert_eq!(resolve(&[], "all", "10.0.0.1; lidar-pc ;"), peers("10.0.0.1 lidar-pc", 0));
        assert_eq!(resolve(&["10.0.0.2"], "all", "10.0.0.1"), peers("10.0.0.2", 0), "flags win");
        assert_eq!(resolve(&[], "loopback", "10.0.0.1"), peers("", 1));
        assert_eq!(resolve(&["localhost"], "loopback", ""), peers("localhost", 0));
        assert!(resolve(&["10.0.0.1"], "loopback", "").unwrap_err().contains("--interface"));
        assert!(resolve(&["http://a"], "all", "").unwrap_err().contains("is no host"));
        assert!(resolve(&[], "all", &"a;".repeat(65)).unwrap_err().contains("at most 64"));
    }

    #[test]
    fn relative_names_are_below_the_namespace() {
        for (namespace, expected) in [
            ("", "/telltale"),
            ("/", "/telltale"),
            ("robot1", "/robot1/telltale"),
            ("/a/b/", "/a/b/telltale"),
        ] {
            let options = resolve(None, None, &[("ROS_NAMESPACE", namespace)]).unwrap();
            assert_eq!(options.whole_name("telltale"), expected);
            assert_eq!(options.whole_name("/diagnostics"), "/diagnostics");
        }
        let error = resolve(None, None, &[("ROS_NAMESPACE", "1robot")]).unwrap_err();
        assert!(error.contains("a name such as /robot1"), "{error}");
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
