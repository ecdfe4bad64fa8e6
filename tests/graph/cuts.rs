//! Cut at every write: the program fails, dies or loses its power at each change that it makes to a disk, and goes on.
//!
//! `ECHOGRID_CUTS` says at how many changes each series cuts, `all` of them or so many (docs/reliability.md).

use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::atomic::{AtomicU32, Ordering};

use echogrid_formats::map::native;
use echogrid_harness::cut::{self, Fate, Ran};
use echogrid_harness::leftovers;
use echogrid_topics::Domain;

use crate::support::{Drive, ECHOGRID, echogrid, path, said};

/// Metres: a second or two of work.
const DRIVE_M: f64 = 2.0;

static NEXT: AtomicU32 = AtomicU32::new(0);

type Files = BTreeMap<String, Vec<u8>>;

fn files(folder: &Path) -> Files {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries.map(|entry| (entry.file_name().into_string().unwrap(), std::fs::read(entry.path()).unwrap())).collect()
}

/// Where one series of runs works: everything that it writes lies below one folder.
struct Place {
    drive: Drive,
    is_spooled: bool,
    expected: Files,
    /// What is there before each run: below the folder, by name.
    before: Vec<(PathBuf, Files)>,
    resumes: bool,
}

impl Place {
    fn new(is_spooled: bool) -> Self {
        let drive = Drive::new(DRIVE_M);
        let place = Self { drive, is_spooled, expected: Files::new(), before: Vec::new(), resumes: false };
        let output = echogrid(place.arguments(&domain(), &place.drive.out("expected"), false));
        assert!(output.status.success(), "{}", said(&output));
        let expected = files(&place.drive.out("expected"));
        assert!(expected.contains_key("map.echogrid") && expected.contains_key("readings.echogrid"));
        Self { expected, ..place }
    }

    fn folder(&self) -> PathBuf {
        self.drive.out("cut")
    }

    fn out(&self) -> PathBuf {
        self.folder().join("maps")
    }

    fn spool(&self) -> PathBuf {
        self.folder().join("spool")
    }

    fn arguments(&self, domain: &Domain, out: &Path, resumes: bool) -> Vec<String> {
        let log = self.drive.log();
        let words = ["map", &path(&log), "--out", &path(out), "--domain", domain.name(), "--fix", "truth"];
        let sets =
            ["mapper.doubt=true", "mapper.keep_readings=true", "mapper.remap=true", "supervision.backoff_s=0.01"];
        let sets = sets.into_iter().flat_map(|set| ["--set", set]);
        let mut arguments: Vec<String> = words.into_iter().chain(sets).map(str::to_owned).collect();
        if self.is_spooled {
            arguments.extend(["--spool".into(), path(&self.spool())]);
        }
        arguments.extend(resumes.then(|| "--resume".into()));
        arguments
    }

    /// Puts there what each run finds.
    fn prepare(&self) {
        let _ = std::fs::remove_dir_all(self.folder());
        std::fs::create_dir_all(self.folder()).unwrap();
        for (folder, files) in &self.before {
            std::fs::create_dir_all(folder).unwrap();
            files.iter().for_each(|(name, bytes)| std::fs::write(folder.join(name), bytes).unwrap());
        }
    }

    /// One run that is cut; none where the system can't do that.
    fn cut(&self, at: u64, fate: Fate) -> Option<Ran> {
        self.prepare();
        let domain = domain();
        let arguments = self.arguments(&domain, &self.out(), self.resumes);
        let ran = cut::run(Command::new(ECHOGRID).args(arguments), &domain, &self.folder(), Some((at, fate)));
        let ran = match ran {
            Ok(ran) => ran,
            Err(error) => {
                let _ = writeln!(std::io::stderr(), "skipped: no process can be held at its calls here ({error})");
                return None;
            }
        };
        self.judge(&ran, &domain, at, fate);
        Some(ran)
    }

    /// Whether all is as it should be: at once, or when the run was gone on with.
    fn judge(&self, ran: &Ran, domain: &Domain, at: u64, fate: Fate) {
        let told = |what: &str, output: &Output| {
            let how = ran.cut.as_deref().unwrap_or("not cut");
            format!(
                "{fate:?} at {at} of {} ({how}): {what}\n{}\n--- cut:\n{}",
                ran.changes,
                said(output),
                said(&ran.output)
            )
        };
        let is_killed = ran.output.status.code().is_none();
        let map = self.out().join("map.echogrid");
        if map.exists()
            && let Err(error) = native::read(&map)
        {
            panic!("{}", told(&error.to_string(), &ran.output));
        }
        if ran.output.status.success() {
            self.judge_files(&|what| told(what, &ran.output));
        } else {
            if !is_killed {
                assert_eq!(ran.output.status.code(), Some(1), "{}", told("another exit code", &ran.output));
                let error = String::from_utf8_lossy(&ran.output.stderr);
                assert!(error.contains(&path(&self.folder())), "{}", told("no file is named", &ran.output));
            }
            let domain = if is_killed { domain.clone() } else { self::domain() };
            let resumes = self.is_spooled && self.spool().join("run.toml").exists();
            let next = echogrid(self.arguments(&domain, &self.out(), resumes));
            // The run may have come to its end before, and its launcher died while it tidied up.
            let is_over = resumes && !next.status.success() && said(&next).contains("no run to resume");
            if is_over {
                assert!(files(&self.out()) == self.expected, "{}", told("ended with other files", &next));
                assert!(!self.spool().join("run.toml").exists(), "{}", told("what is over is not tidied up", &next));
            } else {
                assert!(next.status.success(), "{}", told("it can't be gone on with", &next));
                self.judge_files(&|what| told(what, &next));
            }
        }
        assert_eq!(leftovers(domain), Vec::<String>::new());
    }

    fn judge_files(&self, told: &dyn Fn(&str) -> String) {
        let found = files(&self.out());
        let names = |files: &Files| files.keys().cloned().collect::<Vec<_>>();
        assert_eq!(names(&found), names(&self.expected), "{}", told("other files"));
        let other: Vec<&String> = found.keys().filter(|name| found[*name] != self.expected[*name]).collect();
        assert!(other.is_empty(), "{}", told(&format!("{other:?} differ")));
        assert!(!self.spool().exists(), "{}", told("the spool is left"));
    }

    /// Cuts at every change, or at some of them.
    fn cut_everywhere(&self, name: &str) {
        let wanted = std::env::var("ECHOGRID_CUTS").unwrap_or_else(|_| "1".into());
        let Some(uncut) = self.cut(u64::MAX, Fate::Killed) else { return };
        let step = wanted.parse().map_or(1, |count: u64| uncut.changes.div_ceil(count).max(1));
        let mut runs = 0;
        for (number, fate) in (0..).zip(Fate::ALL) {
            // Not all of them at the same changes.
            let mut at = step * number / Fate::ALL.len() as u64;
            while let Some(Ran { cut: Some(_), .. }) = self.cut(at, fate) {
                runs += 1;
                at += step;
            }
        }
        let _ = writeln!(std::io::stderr(), "{name}: {runs} runs cut, of about {} changes each", uncut.changes);
    }
}

fn domain() -> Domain {
    Domain::named(&format!("cut{}-{}", std::process::id(), NEXT.fetch_add(1, Ordering::Relaxed))).unwrap()
}

#[test]
fn a_spooled_run_that_is_cut_at_any_write_is_gone_on_with() {
    Place::new(true).cut_everywhere("spool");
}

#[test]
fn so_is_one_that_was_resumed() {
    let mut place = Place::new(true);
    let Some(uncut) = place.cut(u64::MAX, Fate::Killed) else { return };
    place.prepare();
    let domain = domain();
    let arguments = place.arguments(&domain, &place.out(), false);
    let cut = Some((uncut.changes / 2, Fate::AllKilled));
    let ran = cut::run(Command::new(ECHOGRID).args(arguments), &domain, &place.folder(), cut).unwrap();
    assert!(ran.output.status.code().is_none(), "{}", said(&ran.output));
    place.before = [place.out(), place.spool()].map(|folder| (folder.clone(), files(&folder))).to_vec();
    place.resumes = true;
    place.cut_everywhere("resume");
}

#[test]
fn a_save_that_is_cut_at_any_write_leaves_whole_files() {
    let mut place = Place::new(false);
    let other = Drive::new(1.0);
    assert!(other.map("maps", &[]).status.success());
    place.before = vec![(place.out(), files(&other.out("maps")))];
    place.cut_everywhere("save");
}
