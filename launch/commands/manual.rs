//! `echogrid completions`, `echogrid man`: what is made of the description of the command line.

use std::path::Path;

use anyhow::{Context, Result};
use clap::CommandFactory as _;

use crate::cli::Cli;

/// Prints what completes the command line in a shell.
pub(super) fn completions(shell: clap_complete::Shell) -> Result<()> {
    let mut text = Vec::new();
    clap_complete::generate(shell, &mut Cli::command(), "echogrid", &mut text);
    super::print(&String::from_utf8(text).context("completions")?)
}

/// Prints the manual page, or writes a page for each command into a folder.
pub(super) fn pages(folder: Option<&Path>) -> Result<()> {
    let Some(folder) = folder else {
        let mut page = Vec::new();
        clap_mangen::Man::new(Cli::command()).render(&mut page)?;
        return super::print(&String::from_utf8(page).context("the manual page")?);
    };
    let failed = || format!("{}: the manual pages can't be written", folder.display());
    std::fs::create_dir_all(folder).with_context(failed)?;
    clap_mangen::generate_to(Cli::command(), folder).with_context(failed)
}
