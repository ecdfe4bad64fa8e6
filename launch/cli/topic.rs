//! `echogrid topic`, as it is typed.

use clap::Subcommand;

use super::values::window;

/// What is shown of the topics.
#[derive(Debug, Subcommand)]
pub enum TopicCommand {
    /// The layouts of all messages, for programs in other languages.
    Layout {
        /// In which language.
        #[arg(long, value_name = "LANGUAGE", default_value = "text")]
        lang: LayoutLanguage,
    },
    /// The topics, what each promises, who writes it and who reads it.
    List {
        /// Which graph; may be left out when only one runs.
        #[arg(long, value_name = "NAME")]
        domain: Option<String>,
        /// Prints them as JSON.
        #[arg(long)]
        json: bool,
    },
    /// Prints messages as they come, those first that are kept for whoever comes late.
    Echo {
        /// The topic, as in map/info.
        name: String,
        /// Which graph; may be left out when only one runs.
        #[arg(long, value_name = "NAME")]
        domain: Option<String>,
        /// Ends after so many [default: with the graph].
        #[arg(long, value_name = "N")]
        count: Option<u64>,
        /// Prints each as JSON, all of it, in a line of its own.
        #[arg(long)]
        json: bool,
    },
    /// Prints how many messages come in a second.
    Hz {
        /// The topic, as in odometry/raw.
        name: String,
        /// Which graph; may be left out when only one runs.
        #[arg(long, value_name = "NAME")]
        domain: Option<String>,
        /// Ends after so many lines [default: with the graph].
        #[arg(long, value_name = "N")]
        count: Option<u64>,
        /// Seconds that a line is about.
        #[arg(long, value_name = "SECONDS", default_value_t = 1.0, value_parser = window)]
        window: f64,
        /// Prints each line as JSON.
        #[arg(long)]
        json: bool,
    },
}

/// A language that layouts are written in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum LayoutLanguage {
    /// A plain list.
    Text,
    /// A module of ctypes structures.
    Python,
    /// A header.
    C,
}
