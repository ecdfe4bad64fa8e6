//! `--watch`: the live page as a process beside the graph.
//!
//! It is none of the graph's services: the graph neither waits for it nor fails with it. It is started again when it dies, at the
//! same address, so that pages that are open find it again.

use std::io::Write;
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::os::unix::process::CommandExt;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use echogrid_live::config::DEFAULT_PORT;
use echogrid_live::{LISTEN_VARIABLE, TOKEN_VARIABLE};
use echogrid_service::lifeline::LIFELINE_VARIABLE;
use echogrid_service::plan::DOMAIN_VARIABLE;
use serde_json::json;
use tracing::Level;

use crate::progress::{self, Display};
use crate::supervisor::{Event, Observer, Progress};

/// Lines that wait to be written; who does not read them misses them.
const LINES: usize = 256;
/// It is started again so often.
const RESTARTS_MAX: u32 = 10;
const RESTART_AFTER: Duration = Duration::from_millis(250);
/// It leaves by itself within this when all is over.
const LEAVE_WITHIN: Duration = Duration::from_secs(3);
const LOOK_EVERY: Duration = Duration::from_millis(20);

/// Where the page will be, and what it takes to start it.
#[derive(Debug)]
pub(in crate::commands) struct Watch {
    domain: String,
    listen: SocketAddr,
    token: String,
    running: Option<Running>,
    /// Whether it has been said where the page is.
    is_told: bool,
}

/// The process, over all its lives.
#[derive(Debug)]
struct Running {
    lines: SyncSender<String>,
    over: Arc<AtomicBool>,
    /// Whether somebody answers at the address by now.
    answers: Arc<AtomicBool>,
    keeper: JoinHandle<()>,
    writer: JoinHandle<()>,
}

/// The end of the pipe that the present life reads.
type Pipe = Arc<Mutex<Option<ChildStdin>>>;

impl Watch {
    /// Chooses the address: the one that was asked for, or, where that is only the default and taken, another port.
    ///
    /// # Errors
    /// It can't be listened at.
    pub(in crate::commands) fn new(domain: &str, asked: SocketAddr) -> Result<Self> {
        let bound = TcpListener::bind(asked).or_else(|error| match asked.port() {
            DEFAULT_PORT => TcpListener::bind((asked.ip(), 0)),
            _ => Err(error),
        });
        let listen =
            bound.and_then(|bound| bound.local_addr()).with_context(|| format!("--watch: listening at {asked}"))?;
        Ok(Self {
            domain: domain.to_owned(),
            listen,
            token: echogrid_live::new_token()?,
            running: None,
            is_told: false,
        })
    }

    /// Where the page is, once, as soon as it is there.
    fn news(&mut self) -> Option<String> {
        let answers = self.running.as_ref().is_some_and(|running| running.answers.load(Ordering::Relaxed));
        (answers && !std::mem::replace(&mut self.is_told, answers))
            .then(|| format!("live page: {}", echogrid_live::address(self.listen, &self.token)))
    }

    fn start(&mut self) {
        let (lines, to_write) = sync_channel(LINES);
        let (over, pipe) = (Arc::new(AtomicBool::new(false)), Pipe::default());
        let answers = Arc::new(AtomicBool::new(false));
        let (domain, listen, token) = (self.domain.clone(), self.listen.to_string(), self.token.clone());
        let keeper = Keeper { pipe: Arc::clone(&pipe), over: Arc::clone(&over), answers: Arc::clone(&answers) };
        let keeper = std::thread::spawn(move || keeper.keep(&domain, &listen, &token));
        let writer = std::thread::spawn(move || write_lines(&to_write, &pipe));
        self.running = Some(Running { lines, over, answers, keeper, writer });
    }

    fn say(&self, service: &str, level: &str, text: &str) {
        if let Some(running) = &self.running {
            let _ = running.lines.try_send(json!({ "service": service, "level": level, "text": text }).to_string());
        }
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        let Some(Running { lines, over, keeper, writer, .. }) = self.running.take() else { return };
        over.store(true, Ordering::Relaxed);
        // The writer closes the pipe when it has written the last line; the process then leaves.
        drop(lines);
        let _ = keeper.join();
        let _ = writer.join();
    }
}

/// Keeps the process running.
struct Keeper {
    pipe: Pipe,
    over: Arc<AtomicBool>,
    answers: Arc<AtomicBool>,
}

impl Keeper {
    /// Starts the process whenever there is none, until it is over.
    fn keep(&self, domain: &str, listen: &str, token: &str) {
        let mut starts = 0;
        while !self.is_over() && starts <= RESTARTS_MAX {
            starts += 1;
            let Ok(mut child) = spawn(domain, listen, token) else { return };
            *self.pipe.lock().unwrap_or_else(PoisonError::into_inner) = child.stdin.take();
            self.wait(&mut child, listen);
            let again = Instant::now() + RESTART_AFTER;
            while !self.is_over() && Instant::now() < again {
                std::thread::sleep(LOOK_EVERY);
            }
        }
    }

    fn is_over(&self) -> bool {
        self.over.load(Ordering::Relaxed)
    }

    /// Until the process has ended; when all is over it is given a moment.
    fn wait(&self, child: &mut Child, listen: &str) {
        let mut deadline = None;
        while matches!(child.try_wait(), Ok(None)) {
            if !self.answers.load(Ordering::Relaxed) && TcpStream::connect(listen).is_ok() {
                self.answers.store(true, Ordering::Relaxed);
            }
            if self.is_over() && Instant::now() > *deadline.get_or_insert_with(|| Instant::now() + LEAVE_WITHIN) {
                let _ = child.kill();
                let _ = child.wait();
                return;
            }
            std::thread::sleep(LOOK_EVERY);
        }
    }
}

fn spawn(domain: &str, listen: &str, token: &str) -> std::io::Result<Child> {
    let mut command = Command::new("/proc/self/exe");
    command.arg0("echogrid").args(["service", "live"]);
    command.env(DOMAIN_VARIABLE, domain).env(LISTEN_VARIABLE, listen).env(TOKEN_VARIABLE, token);
    command.env(LIFELINE_VARIABLE, "stdin").stdin(Stdio::piped()).stdout(Stdio::null());
    // Ctrl-C is for the launcher, which tells whom it wants.
    command.process_group(0).spawn()
}

fn write_lines(lines: &Receiver<String>, pipe: &Pipe) {
    while let Ok(line) = lines.recv() {
        if let Some(pipe) = pipe.lock().unwrap_or_else(PoisonError::into_inner).as_mut() {
            // One that has just died gets the next ones in its next life.
            let _ = writeln!(pipe, "{line}");
        }
    }
    pipe.lock().unwrap_or_else(PoisonError::into_inner).take();
}

/// Shows a run on standard error, and tells the page of it, where there is one.
#[derive(Debug)]
pub(in crate::commands) struct Watched {
    pub(in crate::commands) display: Display,
    pub(in crate::commands) watch: Option<Watch>,
}

impl Watched {
    /// Says where the page is as soon as somebody answers there.
    fn tell_page(&mut self) {
        if let Some(news) = self.watch.as_mut().and_then(Watch::news) {
            self.display.print(&news);
        }
    }
}

impl Observer for Watched {
    fn event(&mut self, event: &Event<'_>) {
        if let Some(watch) = &mut self.watch {
            // Not before: the domain may have been another's until now.
            if matches!(event, Event::Started { .. }) && watch.running.is_none() {
                watch.start();
            }
            let (level, text) = progress::in_words(event);
            watch.say("launcher", if level == Level::WARN { "warn" } else { "info" }, &text);
        }
        self.display.event(event);
        self.tell_page();
    }

    fn progress(&mut self, progress: &Progress<'_>) {
        self.display.progress(progress);
        self.tell_page();
    }

    fn line(&mut self, name: &str, line: &str) {
        if let Some(watch) = &self.watch {
            let level = if line.contains("ERROR") {
                "error"
            } else if line.contains("WARN") {
                "warn"
            } else {
                "info"
            };
            watch.say(name, level, line);
        }
        self.display.line(name, line);
    }
}
