//! `telltale tls`: makes a certificate for the vehicle.

use std::net::IpAddr;
use std::process::ExitCode;

use anyhow::{Context as _, bail};
use clap::Subcommand;

use crate::cli::print::say;
use crate::cli::process::certificate::self_signed;
use crate::cli::process::data_folder::DataFolder;
use crate::yaml::private_file::{make_folder, write_private};

const CERTIFICATE: &str = "tls-cert.pem";
/// The key that is made in the data folder.
pub const KEY: &str = "tls-key.pem";

/// Make what the server needs to speak TLS.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Example:\n  telltale tls self-signed --name shuttle-1.example --data /var/lib/telltale\n  \
    telltale serve --config config/shuttle.yaml --data /var/lib/telltale --listen 0.0.0.0:8443 \\\n    \
    --origin https://shuttle-1.example:8443 \\\n    \
    --tls-cert /var/lib/telltale/tls-cert.pem --tls-key /var/lib/telltale/tls-key.pem"
)]
pub struct Args {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    data: DataFolder,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Make a key and a certificate that it signs itself: tls-cert.pem and tls-key.pem in the data folder
    ///
    /// Browsers ask once whether to trust it. They do not ask if it is installed at the display.
    SelfSigned {
        /// A name or an address by which browsers reach the display, beside those of this machine; may be repeated
        #[arg(long = "name", value_name = "HOST")]
        names: Vec<String>,
        /// Replace the files if they are there
        #[arg(long)]
        replace: bool,
    },
}

pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let Command::SelfSigned { names, replace } = &args.command;
    let folder = args.data.path()?;
    make_folder(&folder).with_context(|| format!("the folder {} cannot be made", folder.display()))?;
    let (certificate, key) = (folder.join(CERTIFICATE), folder.join(KEY));
    for file in [&certificate, &key] {
        if file.exists() && !replace {
            bail!("{} is there already; --replace makes both files anew", file.display());
        }
    }
    let names = all_names(names);
    let (certificate_pem, key_pem) = self_signed(&names)?;
    for (path, pem) in [(&key, key_pem), (&certificate, certificate_pem)] {
        write_private(path, pem.as_bytes())
            .with_context(|| format!("{} cannot be written", path.display()))?;
    }
    say!("made {}", certificate.display());
    say!("     {}", key.display());
    say!("for  {}", names.join(", "));
    say!("use  telltale serve --tls-cert {} --tls-key {} ...", certificate.display(), key.display());
    Ok(ExitCode::SUCCESS)
}

/// The given names, and the names and addresses of this machine.
pub(super) fn all_names(given: &[String]) -> Vec<String> {
    let mut names = given.to_vec();
    names.push("localhost".to_owned());
    let host = std::fs::read_to_string("/etc/hostname").unwrap_or_default();
    names.extend(Some(host.trim().to_owned()).filter(|host| !host.is_empty()));
    let interfaces = if_addrs::get_if_addrs().unwrap_or_default();
    names
        .extend(interfaces.iter().map(if_addrs::Interface::ip).filter(is_reachable).map(|ip| ip.to_string()));
    let mut seen = std::collections::HashSet::new();
    names.retain(|name| seen.insert(name.clone()));
    names
}

/// A link-local IPv6 address means nothing without the interface.
fn is_reachable(ip: &IpAddr) -> bool {
    match ip {
        IpAddr::V4(_) => true,
        IpAddr::V6(ip) => !ip.is_unicast_link_local(),
    }
}
