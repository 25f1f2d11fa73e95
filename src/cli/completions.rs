//! `telltale completions` and `telltale man`: what a package installs for shells and for `man`.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context as _;

/// Print the completions of a shell.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  source <(telltale completions bash)")]
pub struct CompletionsArgs {
    shell: Shell,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum Shell {
    Bash,
    Zsh,
    Fish,
}

/// Write the manual pages of all commands into a folder.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  telltale man /usr/local/share/man/man1")]
pub struct ManArgs {
    #[arg(value_name = "DIR")]
    folder: PathBuf,
}

pub fn print(args: &CompletionsArgs, mut command: clap::Command) -> anyhow::Result<ExitCode> {
    use clap_complete::Shell as Known;
    let shell = match args.shell {
        Shell::Bash => Known::Bash,
        Shell::Zsh => Known::Zsh,
        Shell::Fish => Known::Fish,
    };
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut command, "telltale", &mut script);
    super::print::text(&String::from_utf8(script).context("the completions are no text")?);
    Ok(ExitCode::SUCCESS)
}

pub fn write_pages(args: &ManArgs, command: clap::Command) -> anyhow::Result<ExitCode> {
    let folder = &args.folder;
    let refused = || format!("the manual pages cannot be written to {}", folder.display());
    std::fs::create_dir_all(folder).with_context(refused)?;
    clap_mangen::generate_to(command, folder).with_context(refused)?;
    Ok(ExitCode::SUCCESS)
}
