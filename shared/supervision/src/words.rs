//! What is said of services that are gone: whoever waits for one need not.

use std::time::{Duration, Instant};

use crate::Supervision;
use crate::life::Process;

/// What was said is said again so often: who was stopped meanwhile, or had more to read than its queue holds, may have missed it.
const AGAIN_EVERY: Duration = Duration::from_millis(500);
/// Names that are said again at once: no more than a queue holds.
const AT_ONCE: usize = 2;

/// What was said of those who are gone.
#[derive(Debug)]
pub(crate) struct Words {
    /// The names of the services, the first to go first.
    said: Vec<String>,
    /// The place among them of the next that is said again.
    next: usize,
    again_at: Instant,
}

impl Words {
    pub(crate) fn new(now: Instant) -> Self {
        Self { said: Vec::new(), next: 0, again_at: now }
    }
}

impl<P: Process> Supervision<P> {
    /// The services of which is to be said now that they are gone; those that went last come last, and are sure to be read.
    pub fn words(&mut self) -> Vec<String> {
        let has_news = std::mem::take(&mut self.has_news_of_gone);
        if !has_news && (self.words.said.is_empty() || self.now < self.words.again_at) {
            return Vec::new();
        }
        let gone: Vec<String> = self.gone().map(str::to_owned).collect();
        let Words { said, next, again_at } = &mut self.words;
        said.retain(|name| gone.contains(name));
        let news: Vec<String> = gone.into_iter().filter(|name| !said.contains(name)).collect();
        said.extend(news);
        *again_at = self.now + AGAIN_EVERY;
        if has_news {
            return said.clone();
        }
        let again = said.iter().cycle().skip(*next).take(AT_ONCE.min(said.len())).cloned().collect();
        *next = (*next + AT_ONCE) % said.len().max(1);
        again
    }
}
