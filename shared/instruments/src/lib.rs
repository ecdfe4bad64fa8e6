//! What measures echogrid: whole runs in one thread, scored where the truth is known (`echogrid evaluate`, `echogrid experiment`), and
//! what is learnt of a robot from drives of its own (`echogrid calibrate`). Each gives its report as text, or as JSON.

mod align;
pub mod calibrate;
pub mod evaluate;
pub mod experiment;
pub mod in_process;
mod jobs;
mod observer;

use std::fmt::Display;

pub use align::{Align, Alignment, at};
use anyhow::{Context, Result};
use serde::Serialize;

/// What was found, as JSON for programs or as text for people.
///
/// # Errors
/// It can't be written as JSON.
pub fn told(found: &(impl Serialize + Display), as_json: bool) -> Result<String> {
    if as_json { json(found) } else { Ok(found.to_string()) }
}

/// A value as JSON over several lines.
///
/// # Errors
/// It can't be written as JSON.
pub fn json(value: &impl Serialize) -> Result<String> {
    Ok(serde_json::to_string_pretty(value).context("the figures as JSON")? + "\n")
}
