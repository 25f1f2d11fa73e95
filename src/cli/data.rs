//! Where a vehicle keeps what outlives a restart.

use std::path::PathBuf;

use anyhow::bail;

/// The data folder: the one given, else `telltale` in the user's data folder as the XDG base
/// directories name it.
///
/// # Errors
/// If none is given and the environment names none either.
pub fn folder(given: Option<PathBuf>) -> anyhow::Result<PathBuf> {
    if let Some(folder) = given {
        return Ok(folder);
    }
    // The specification ignores relative paths.
    let absolute = |name| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let data = absolute("XDG_DATA_HOME").or_else(|| Some(absolute("HOME")?.join(".local/share")));
    match data {
        Some(data) => Ok(data.join("telltale")),
        None => bail!("no data folder: neither XDG_DATA_HOME nor HOME is set; name one with --data"),
    }
}
