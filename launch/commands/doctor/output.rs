//! Where the map is saved.

use std::path::{Path, PathBuf};

use nix::errno::Errno;
use nix::sys::statvfs::statvfs;
use nix::unistd::{AccessFlags, access};

use super::finding::{Finding, size};

const CHECK: &str = "output";
/// A large map, in all formats, beside the one that it replaces.
const ROOM_BYTES: u64 = 100 << 20;

/// What is known of the folder.
#[derive(Debug, Clone)]
pub(super) struct Facts {
    out: PathBuf,
    /// It, or the first above it that is there.
    there: PathBuf,
    is_folder: bool,
    refused: Option<Errno>,
    free_bytes: Option<u64>,
}

impl Facts {
    pub(super) fn gather(out: &Path) -> Self {
        let there = out.ancestors().find(|path| path.exists()).unwrap_or(Path::new("/")).to_owned();
        #[allow(clippy::useless_conversion)] // the types differ between platforms
        let free =
            statvfs(&there).ok().map(|stat| u64::from(stat.blocks_available()) * u64::from(stat.fragment_size()));
        Self {
            out: out.to_owned(),
            is_folder: there.is_dir(),
            refused: access(&there, AccessFlags::W_OK | AccessFlags::X_OK).err(),
            free_bytes: free,
            there,
        }
    }

    pub(super) fn judge(&self) -> Finding {
        let (out, there) = (self.out.display(), self.there.display());
        if !self.is_folder {
            return Finding::problem(CHECK, format!("{out}: {there} is no folder"), "choose another: --out DIR");
        }
        if let Some(errno) = self.refused {
            let text = format!("{out}: {there} can't be written ({})", errno.desc());
            return Finding::problem(CHECK, text, format!("sudo chown $USER {there}, or choose another: --out DIR"));
        }
        let Some(free) = self.free_bytes else { return Finding::ok(CHECK, format!("{out} can be written")) };
        let text = format!("{out} can be written, {} free", size(free));
        let finding = if free < ROOM_BYTES {
            let text = format!("{text}; a large map takes {}", size(ROOM_BYTES));
            Finding::warning(CHECK, text, format!("free some of {there}, or choose another: --out DIR"))
        } else {
            Finding::ok(CHECK, text)
        };
        finding.with([("free_bytes", free), ("needed_bytes", ROOM_BYTES)])
    }
}

#[cfg(test)]
mod tests {
    use super::super::finding::Verdict;
    use super::*;

    #[test]
    fn folders() {
        let good = Facts {
            out: "/data/maps".into(),
            there: "/data".into(),
            is_folder: true,
            refused: None,
            free_bytes: Some(1 << 40),
        };
        let check = |facts: Facts, expected| {
            let finding = facts.judge();
            assert_eq!(finding.verdict, expected, "{finding}");
            assert!(finding.text.contains("/data/maps"), "{finding}");
        };
        check(good.clone(), Verdict::Ok);
        check(Facts { free_bytes: None, ..good.clone() }, Verdict::Ok);
        check(Facts { free_bytes: Some(1 << 20), ..good.clone() }, Verdict::Warning);
        check(Facts { refused: Some(Errno::EROFS), ..good.clone() }, Verdict::Problem);
        check(Facts { is_folder: false, ..good }, Verdict::Problem);
    }

    #[test]
    fn what_is_not_there_yet_is_judged_by_what_is() {
        let folder = tempfile::tempdir().unwrap();
        let facts = Facts::gather(&folder.path().join("new/maps"));
        assert_eq!((facts.there.as_path(), facts.refused), (folder.path(), None));
        let file = tempfile::NamedTempFile::new().unwrap();
        assert_eq!(Facts::gather(&file.path().join("maps")).judge().verdict, Verdict::Problem);
    }
}
