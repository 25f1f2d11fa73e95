//! `telltale tls`: makes a certificate for the vehicle.

use std::io::Write as _;
use std::net::IpAddr;
use std::path::Path;
use std::process::ExitCode;
use std::time::Duration;

use anyhow::{Context as _, bail};
use clap::Subcommand;
use rcgen::{CertificateParams, DistinguishedName, DnType, ExtendedKeyUsagePurpose, KeyPair};

use crate::cli::print::say;
use crate::cli::process::data_folder::DataFolder;
use crate::clock::Clock;
use crate::store::{give_to_owner_of, make_folder};

const CERTIFICATE: &str = "tls-cert.pem";
/// The key that is made in the data folder.
pub const KEY: &str = "tls-key.pem";

/// Browsers reject server certificates that are valid for longer than 825 days.
const VALID: Duration = Duration::from_secs(820 * 24 * 3600);
/// Browsers' clocks may be a little behind.
const VALID_BEFORE: Duration = Duration::from_secs(24 * 3600);

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
    write_private(&key, &key_pem)?;
    write_private(&certificate, &certificate_pem)?;
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

pub(super) fn self_signed(names: &[String]) -> anyhow::Result<(String, String)> {
    let key = KeyPair::generate().context("no key can be made")?;
    let wrong = "a name is none: give host names and addresses, without scheme or port";
    let mut params = CertificateParams::new(names.to_vec()).context(wrong)?;
    let now = Clock::start().wall();
    params.not_before = (now - VALID_BEFORE).into();
    params.not_after = (now + VALID).into();
    params.extended_key_usages = vec![ExtendedKeyUsagePurpose::ServerAuth];
    params.distinguished_name = DistinguishedName::new();
    params.distinguished_name.push(DnType::CommonName, names.first().map_or("telltale", String::as_str));
    let certificate = params.self_signed(&key).context(wrong)?;
    Ok((certificate.pem(), key.serialize_pem()))
}

/// Writes a file that only its owner may read, whatever the umask and an earlier file.
pub(super) fn write_private(path: &Path, text: &str) -> anyhow::Result<()> {
    let context = || format!("{} cannot be written", path.display());
    let new = path.with_extension("pem.new");
    let mut options = std::fs::OpenOptions::new();
    options.write(true).create_new(true);
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    // One that an earlier run left behind may be anybody's.
    let _ = std::fs::remove_file(&new);
    let mut file = options.open(&new).with_context(context)?;
    give_to_owner_of(path.parent().unwrap_or(Path::new(".")), &file);
    file.write_all(text.as_bytes()).and_then(|()| file.sync_all()).with_context(context)?;
    std::fs::rename(&new, path).with_context(context)
}
