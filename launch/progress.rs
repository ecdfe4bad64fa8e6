//! A run while it lasts: a bar on a terminal, plain lines elsewhere.

use std::io::{IsTerminal, Write};
use std::time::{Duration, Instant};

use echogrid_service::logging;
use echogrid_topics::Health;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use tracing::Level;

use crate::supervisor::{Event, Observer, Progress};

/// Without a terminal a line is printed this often.
const LINE_EVERY: Duration = Duration::from_secs(5);

/// Shows a run on standard error.
#[derive(Debug)]
pub struct Display {
    bar: Option<ProgressBar>,
    quiet: bool,
    lives: bool,
    json: bool,
    first_ns: Option<u64>,
    started: Option<Instant>,
    next_line: Instant,
}

impl Display {
    /// A display of standard error's kind; `quiet`: only what is logged; `lives`: of each process that starts and ends, too.
    #[must_use]
    pub fn new(quiet: bool, lives: bool) -> Self {
        let json = logging::is_json();
        let bar = (!quiet && !json && std::io::stderr().is_terminal()).then(|| {
            let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr());
            bar.set_style(style(false));
            bar
        });
        Self { bar, quiet, lives, json, first_ns: None, started: None, next_line: Instant::now() + LINE_EVERY }
    }

    /// Something worth knowing before it begins.
    pub fn remark(&self, text: &str) {
        if !self.quiet {
            self.tell(Level::WARN, text);
        }
    }

    /// A line, above the bar.
    pub(crate) fn print(&self, line: &str) {
        match &self.bar {
            Some(bar) => bar.suspend(|| write_line(line)),
            None => write_line(line),
        }
    }

    /// Something happened: as a line, or as JSON.
    fn tell(&self, level: Level, line: &str) {
        match level {
            _ if !self.json => self.print(line),
            Level::WARN => tracing::warn!("{line}"),
            _ => tracing::info!("{line}"),
        }
    }

    fn speed(&mut self, sensor: &Health) -> Option<f64> {
        if sensor.progress == 0 {
            return None;
        }
        let first_ns = *self.first_ns.get_or_insert(sensor.stamp_ns);
        let elapsed = self.started.get_or_insert_with(Instant::now).elapsed().as_secs_f64();
        (elapsed > 0.5).then(|| sensor.stamp_ns.saturating_sub(first_ns) as f64 * 1e-9 / elapsed)
    }
}

fn style(known_length: bool) -> ProgressStyle {
    let template = if known_length { "{bar:30} {percent:>3} %  {msg}" } else { "{spinner} {msg}" };
    ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar())
}

impl Observer for Display {
    fn event(&mut self, event: &Event<'_>) {
        // What went wrong is always worth a line, what goes well is not.
        let (level, text) = in_words(event);
        if self.lives || level == Level::WARN {
            self.tell(level, &text);
        }
    }

    fn progress(&mut self, progress: &Progress<'_>) {
        if self.quiet {
            return;
        }
        let (ready, all) = progress.ready;
        let speed = progress.sensor.and_then(|sensor| self.speed(sensor));
        let text = match progress.sensor {
            _ if !progress.finishing.is_empty() => format!("waiting for {}", progress.finishing.join(", ")),
            Some(sensor) if ready == all || sensor.progress > 0 => {
                let speed = speed.map_or(String::new(), |speed| format!(", {speed:.1} × real time"));
                format!("{} messages{speed}", sensor.progress)
            }
            _ => format!("{ready} of {all} services ready"),
        };
        let (messages, total) = progress.sensor.map_or((0, 0), |sensor| (sensor.progress, sensor.total));
        match &self.bar {
            Some(bar) => {
                if total > 0 && bar.length().is_none() {
                    bar.set_length(total);
                    bar.set_style(style(true));
                }
                bar.set_position(messages);
                bar.set_message(text);
            }
            None if Instant::now() >= self.next_line => {
                self.next_line = Instant::now() + LINE_EVERY;
                if self.json {
                    tracing::info!(messages, total, times_real_time = speed, "progress: {text}");
                    return;
                }
                let of =
                    if total > 0 && progress.finishing.is_empty() { format!(" of {total}") } else { String::new() };
                self.print(&format!("{text}{of}"));
            }
            None => {}
        }
    }

    fn line(&mut self, name: &str, line: &str) {
        // Not every service logs as it is told to.
        if self.json && !line.starts_with('{') {
            tracing::warn!(of = name, "{line}");
        } else {
            self.print(line);
        }
    }
}

/// What happened, as a line; a warning where something went wrong.
pub(crate) fn in_words(event: &Event<'_>) -> (Level, String) {
    match event {
        Event::Restarting { name, why, number, after } => {
            (Level::WARN, format!("{name} died ({why}): restart {number} in {:.1} s", after.as_secs_f64()))
        }
        Event::GivenUp { name, why } => {
            (Level::WARN, format!("{name} died ({why}): given up, the others go on without it"))
        }
        Event::Rebuilt { why } => (Level::WARN, format!("{why}: the graph's shared memory is made anew")),
        Event::Note { name, what } => (Level::WARN, format!("{name} {what}")),
        Event::Started { name, pid } => (Level::INFO, format!("{name} started (process {pid})")),
        Event::Ready => (Level::INFO, "all services ready".to_owned()),
        Event::Stopping { signal } => (Level::INFO, format!("{signal}: the graph ends")),
        Event::Ended { name, how } => (Level::INFO, format!("{name} ended: {how}")),
    }
}

/// Standard error may be closed; nobody is there to hear of that.
fn write_line(line: &str) {
    let _ = writeln!(std::io::stderr(), "{line}");
}

impl Drop for Display {
    fn drop(&mut self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}
