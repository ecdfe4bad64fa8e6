//! `echogrid check`.

use anyhow::Result;

use crate::config::{Config, LoadRequest, render};

/// Prints the effective configuration.
pub(super) fn run(request: &LoadRequest) -> Result<()> {
    super::print(&render(&Config::load(request)?))
}
