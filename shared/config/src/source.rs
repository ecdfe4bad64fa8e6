//! Where text comes from, and which line of it a value stands on.

use std::io::{self, Read};
use std::ops::Range;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

use echogrid_formats::open_regular;

use super::problem::Origin;

/// A configuration is typed by hand: what is longer is something else.
pub(crate) const TEXT_BYTES_MAX: usize = 1 << 20;

/// A text that settings are read from.
pub(crate) struct Source {
    place: SourceText,
    /// What relative paths are relative to; none: they stay as they are.
    base: Option<PathBuf>,
}

enum SourceText {
    File { name: Arc<str>, line_ends: Vec<usize> },
    Argument(Arc<str>),
}

impl Source {
    pub(crate) fn file(name: &str, text: &str, base: Option<&Path>) -> Self {
        let line_ends = text.bytes().enumerate().filter(|(_, b)| *b == b'\n').map(|(at, _)| at).collect();
        Self { place: SourceText::File { name: name.into(), line_ends }, base: base.map(Path::to_path_buf) }
    }

    pub(crate) fn argument(argument: &str, base: Option<&Path>) -> Self {
        Self { place: SourceText::Argument(argument.into()), base: base.map(Path::to_path_buf) }
    }

    pub(crate) fn origin(&self, span: &Range<usize>) -> Origin {
        match &self.place {
            SourceText::File { name, line_ends } => Origin::File {
                name: Arc::clone(name),
                line: line_ends.partition_point(|end| *end < span.start).saturating_add(1),
            },
            SourceText::Argument(argument) => Origin::Argument(Arc::clone(argument)),
        }
    }

    /// A path of this source, absolute where a base is known. None when that is not Unicode.
    pub(crate) fn absolute(&self, path: &str) -> Option<String> {
        let Some(base) = &self.base else { return Some(path.to_owned()) };
        let joined = base.join(path);
        let plain = without_parents(base, path).or_else(|| std::path::absolute(&joined).ok()).unwrap_or(joined);
        plain.into_os_string().into_string().ok()
    }
}

/// `../maps` from `/a/b` as `/a/maps`. Only what leads is taken away, and only from a folder that
/// is there: a name may be a link to elsewhere, and its parent is another then.
fn without_parents(base: &Path, path: &str) -> Option<PathBuf> {
    let path = Path::new(path);
    let leads = |part: &Component<'_>| matches!(part, Component::ParentDir | Component::CurDir);
    let ups = path.components().take_while(leads).filter(|part| *part == Component::ParentDir).count();
    if ups == 0 {
        return None;
    }
    let real = base.canonicalize().ok()?;
    let rest: PathBuf = path.components().skip_while(leads).collect();
    Some(real.ancestors().nth(ups).unwrap_or(Path::new("/")).join(rest))
}

/// A file of text, or as much of it as shows that it is too long.
pub(crate) fn read(path: &Path) -> io::Result<String> {
    let mut text = String::new();
    open_regular(path)?.take(TEXT_BYTES_MAX as u64 + 1).read_to_string(&mut text)?;
    // Editors of some systems begin a text with a mark of its encoding.
    Ok(text.strip_prefix('\u{feff}').map(ToOwned::to_owned).unwrap_or(text))
}
