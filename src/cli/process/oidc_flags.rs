//! The flags of the login by OpenID Connect at a fleet's console.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};

use super::believing::believing;
use crate::console::oidc::{Issuer, Settings, issuer};
use crate::store::{Grant, Pattern, Role};
use crate::yaml::private_file::{NotPrivate, read_private};

/// Bytes of the file of a secret that are read.
const SECRET_BYTES_MAX: u64 = 4096;

#[derive(Debug, clap::Args)]
pub struct OidcFlags {
    /// Let people log in at this OpenID Connect issuer too
    #[arg(long, value_name = "ISSUER", value_parser = issuer, requires_all = ["oidc_client", "oidc_grants"])]
    oidc: Option<Issuer>,
    /// The name of this console at the issuer
    #[arg(long, value_name = "ID", requires = "oidc")]
    oidc_client: Option<String>,
    /// The file of the secret that the issuer gave this console, if it gave one; only its owner may read it
    #[arg(long, value_name = "FILE", requires = "oidc")]
    oidc_secret: Option<PathBuf>,
    /// The claim of the issuer's token that is granted something: a string or a list of strings
    #[arg(long, value_name = "NAME", default_value = "groups", requires = "oidc")]
    oidc_claim: String,
    /// Give people with this value in the claim a role for the vehicles with these names (`*` for any letters), or for all;
    /// may be repeated
    #[arg(long = "oidc-grant", value_name = "VALUE=ROLE[:NAME,...]", value_parser = grant, requires = "oidc")]
    oidc_grants: Vec<(String, Grant)>,
    /// The certificates that sign the issuer's certificate [default: the system's]
    #[arg(long, value_name = "FILE", requires = "oidc")]
    oidc_ca: Option<PathBuf>,
}

impl OidcFlags {
    /// # Errors
    /// The secret or the certificates cannot be read.
    pub fn read(&self) -> anyhow::Result<Option<Settings>> {
        let (Some(issuer), Some(client)) = (self.oidc.clone(), self.oidc_client.clone()) else {
            return Ok(None);
        };
        let is_secure = issuer.starts_with("https://");
        let tls = is_secure.then(|| believing(self.oidc_ca.as_deref(), "--oidc-ca")).transpose()?;
        Ok(Some(Settings {
            issuer,
            client,
            secret: self.oidc_secret.as_deref().map(secret).transpose()?,
            claim: self.oidc_claim.clone(),
            grants: self.oidc_grants.clone(),
            tls: tls.map(Into::into),
        }))
    }
}

/// Reads `VALUE=ROLE[:NAME,...]`. A value may have `=` and `:` in it.
fn grant(text: &str) -> Result<(String, Grant), String> {
    let example = "fleet-engineers=engineer, or north=control_room:shuttle-*,bus-7";
    let (value, granted) = text.rsplit_once('=').ok_or_else(|| format!("write VALUE=ROLE: {example}"))?;
    let (role, names) = match granted.split_once(':') {
        Some((role, names)) => (role, Some(names)),
        None => (granted, None),
    };
    let role = Role::from_word(role).filter(|role| Role::OF_CONSOLE.contains(role)).ok_or_else(|| {
        let roles = Role::OF_CONSOLE.map(Role::as_str).join(", ");
        format!("{role:?} is no role of a console; it has {roles}: {example}")
    })?;
    if value.is_empty() {
        return Err(format!("write which value of the claim has the role: {example}"));
    }
    let pattern = |name: &str| {
        let wrong =
            || format!("{name:?} can be no name of a vehicle: use small letters, digits, `_`, `-` and `*`");
        Pattern::new(name).ok_or_else(wrong)
    };
    let vehicles = names.map_or(Ok(Vec::new()), |names| names.split(',').map(pattern).collect())?;
    Ok((value.to_owned(), Grant { role, vehicles }))
}

/// Reads the file of a secret.
fn secret(path: &Path) -> anyhow::Result<String> {
    let shown = path.display();
    let text = match read_private(path, SECRET_BYTES_MAX) {
        Ok(text) => text,
        Err(NotPrivate::Unreadable(error)) => return Err(error).context(shown.to_string()),
        Err(NotPrivate::Open(mode)) => {
            bail!("{shown} may be read by others (mode {mode:o}): take that right away with `chmod 600`")
        }
    };
    match text.trim() {
        "" => bail!("{shown} is empty: write the secret into it that the issuer gave this console"),
        text => Ok(text.to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::{Permissions, set_permissions, write};
    use std::os::unix::fs::PermissionsExt as _;

    #[test]
    fn a_grant_names_a_value_a_role_and_perhaps_vehicles() {
        let pattern = |text: &str| Pattern::new(text).unwrap();
        for (text, value, role, vehicles) in [
            ("fleet=engineer", "fleet", Role::Engineer, vec![]),
            ("cn=fleet,ou=x=control_room", "cn=fleet,ou=x", Role::ControlRoom, vec![]),
            (
                "urn:x:y=authority:bus-*,van",
                "urn:x:y",
                Role::Authority,
                vec![pattern("bus-*"), pattern("van")],
            ),
        ] {
            assert_eq!(grant(text), Ok((value.to_owned(), Grant { role, vehicles })), "{text}");
        }
        for (text, says) in [
            ("fleet", "VALUE=ROLE"),
            ("=engineer", "which value"),
            ("fleet=operator", "control_room, engineer, authority"),
            ("fleet=Engineer", "no role of a console"),
            ("fleet=engineer:", "no name of a vehicle"),
            ("fleet=engineer:bus-*,", "no name of a vehicle"),
            ("fleet=engineer:Bus", "small letters"),
        ] {
            assert!(grant(text).unwrap_err().contains(says), "{text}: {:?}", grant(text));
        }
    }

    #[test]
    fn a_secret_is_read_only_from_a_file_of_its_owner_alone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("secret");
        let said = || secret(&path).map_err(|error| format!("{error:#}"));
        assert!(said().unwrap_err().contains("secret: No such file"));
        for (mode, text, expected) in [
            (0o640, "word\n", Err("chmod 600")),
            (0o604, "word\n", Err("mode 604")),
            (0o600, " \n", Err("is empty")),
            (0o600, "word\n", Ok("word")),
        ] {
            write(&path, text).unwrap();
            set_permissions(&path, Permissions::from_mode(mode)).unwrap();
            match expected {
                Ok(text) => assert_eq!(said(), Ok(text.to_owned())),
                Err(why) => assert!(said().unwrap_err().contains(why), "{:?}", said()),
            }
        }
    }
}
