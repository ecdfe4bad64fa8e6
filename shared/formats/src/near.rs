//! Near names, for suggestions in errors.

use std::path::{Path, PathBuf};

/// The candidate that `word` was probably meant to be.
pub(crate) fn near_word<'a>(word: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    candidates
        .into_iter()
        .map(|candidate| (strsim::normalized_damerau_levenshtein(word, candidate), candidate))
        .filter(|(similarity, _)| *similarity > 0.6)
        .max_by(|a, b| a.0.total_cmp(&b.0).then_with(|| b.1.cmp(a.1)))
        .map(|(_, candidate)| candidate)
}

/// A file in the same folder whose name is nearly that of `path`.
pub(crate) fn near_file(path: &Path) -> Option<PathBuf> {
    let folder = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    let wanted = path.file_name()?.to_str()?;
    // A folder may be huge; a suggestion is not worth more than a glance.
    let names: Vec<String> = std::fs::read_dir(folder)
        .ok()?
        .take(4096)
        .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
        .collect();
    near_word(wanted, names.iter().map(String::as_str)).map(|name| path.with_file_name(name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nearest_wins() {
        assert_eq!(near_word("aces.lgo", ["aces.log", "freiburg.log"]), Some("aces.log"));
        assert_eq!(near_word("zzz", ["aces.log"]), None);
    }
}
