//! Many independent jobs on all processors.

use std::io::{IsTerminal as _, Write as _};
use std::sync::atomic::{AtomicUsize, Ordering};

use anyhow::{Result, anyhow};

/// What each job came to, in their order, or the first failure. Who watches a terminal is told how far they are; `what` they are.
pub(crate) fn run<J: Sync, R: Send>(what: &str, jobs: &[J], work: impl Fn(&J) -> Result<R> + Sync) -> Result<Vec<R>> {
    let watched = std::io::stderr().is_terminal();
    let next = AtomicUsize::new(0);
    let threads = std::thread::available_parallelism().map_or(1, usize::from).min(jobs.len());
    let mut done: Vec<(usize, R)> = std::thread::scope(|scope| {
        let worker = || {
            let mut done = Vec::new();
            while let Some((index, job)) = take(&next, jobs) {
                if watched {
                    tell(&format!("{what} {} of {}", index + 1, jobs.len()));
                }
                done.push((index, work(job)?));
            }
            Ok::<_, anyhow::Error>(done)
        };
        let threads: Vec<_> = (0..threads).map(|_| scope.spawn(worker)).collect();
        let mut all = Vec::with_capacity(jobs.len());
        for thread in threads {
            all.extend(thread.join().map_err(|_| anyhow!("an evaluating thread panicked"))??);
        }
        Ok::<_, anyhow::Error>(all)
    })?;
    if watched {
        tell("");
    }
    done.sort_by_key(|(index, _)| *index);
    Ok(done.into_iter().map(|(_, result)| result).collect())
}

/// In the place of what was told before. Nobody may be there to hear of it.
fn tell(line: &str) {
    let _ = write!(std::io::stderr(), "\r\x1b[K{line}");
}

fn take<'a, J>(next: &AtomicUsize, jobs: &'a [J]) -> Option<(usize, &'a J)> {
    let index = next.fetch_add(1, Ordering::Relaxed);
    jobs.get(index).map(|job| (index, job))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_come_in_the_order_of_the_jobs() {
        let jobs: Vec<u32> = (0..1000).collect();
        assert_eq!(run("job", &jobs, |job| Ok(job * 2)).unwrap(), jobs.iter().map(|job| job * 2).collect::<Vec<_>>());
        let failed = run("job", &jobs, |job| if *job == 500 { Err(anyhow!("no")) } else { Ok(()) });
        assert_eq!(failed.unwrap_err().to_string(), "no");
        assert!(run("job", &[] as &[u32], |job| Ok(*job)).unwrap().is_empty());
    }
}
