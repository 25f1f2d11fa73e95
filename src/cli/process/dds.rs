//! The flags for the middleware of ROS 2 and its network.

use super::log;
use crate::cli::fields::DefinitionFlags;
use crate::ros::{BridgeOptions, DdsProcess, Interface, OptionsError, Transport};

#[derive(Debug, Clone, clap::Args)]
pub struct DdsFlags {
    /// The middleware of the vehicle's nodes [default: zenoh if `RMW_IMPLEMENTATION` is `rmw_zenoh_cpp`, else dds]
    #[arg(long, value_name = "dds|zenoh", value_parser = transport)]
    pub transport: Option<Transport>,
    /// The DDS domain, 0 to 232 [default: `ROS_DOMAIN_ID`, or 0]
    #[arg(long, value_name = "N")]
    pub domain: Option<u16>,
    /// The interface on which DDS is spoken: its IPv4 address or name, `loopback` or `all`
    /// [default: as `ROS_AUTOMATIC_DISCOVERY_RANGE` and `ROS_LOCALHOST_ONLY` say, or `all`]
    #[arg(long, value_name = "IP|NAME|all")]
    pub interface: Option<String>,
    /// A host that multicast does not reach, by address or name; may be repeated [default: `ROS_STATIC_PEERS`]
    #[arg(long = "peer", value_name = "HOST")]
    pub peers: Vec<String>,
    /// Megabytes that each process of DDS or Zenoh may take; one that takes more is ended and replaced
    #[arg(long, value_name = "MB", default_value_t = DdsProcess::MEGABYTES, value_parser = clap::value_parser!(u32).range(64..))]
    pub dds_memory: u32,
    #[command(flatten)]
    pub definitions: DefinitionFlags,
}

impl DdsFlags {
    /// Fills in what the flags leave open from the environment, as ROS 2 does.
    ///
    /// # Errors
    /// What is out of range, not understood or not there.
    pub fn resolve(&self) -> Result<BridgeOptions, OptionsError> {
        let env = |name: &str| std::env::var(name).ok();
        let interface = self.interface.as_deref();
        let options = BridgeOptions::resolve(self.transport, self.domain, interface, &self.peers, env)?;
        for line in &options.unheeded {
            tracing::warn!("{line}");
        }
        if options.transport == Transport::Dds && options.interface != Interface::All {
            tracing::warn!(
                "the sockets of DDS are bound to all addresses, though only {} is spoken to: every host that reaches this \
                 machine can send to them. Restrict them with a firewall, or as docs/install.md has it for a service",
                describe(&options)
            );
        }
        let dds_process = DdsProcess::Child { megabytes: self.dds_memory, log: log::form().word() };
        Ok(BridgeOptions { definitions: self.definitions.definitions(), dds_process, ..options })
    }
}

/// # Errors
/// It is no middleware.
pub fn transport(word: &str) -> Result<Transport, String> {
    match word {
        "dds" => Ok(Transport::Dds),
        "zenoh" => Ok(Transport::Zenoh),
        _ => Err("write dds or zenoh".to_owned()),
    }
}

/// For people: `DDS domain 0 on all interfaces`.
pub fn describe(options: &BridgeOptions) -> String {
    let domain = options.domain;
    if options.transport == Transport::Zenoh {
        return format!("Zenoh, ROS domain {domain}");
    }
    match options.interface {
        Interface::All => format!("DDS domain {domain} on all interfaces"),
        Interface::Loopback => format!("DDS domain {domain} on the loopback interface"),
        Interface::Ip(ip) => format!("DDS domain {domain} on {ip}"),
    }
}
