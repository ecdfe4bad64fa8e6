//! What the system shows of a process.

use std::fs;

use echogrid_supervision::Usage;

/// Looks at process `pid`; none: it is gone.
pub(super) fn of(pid: u32) -> Option<Usage> {
    let (state, ticks) = fs::read_to_string(format!("/proc/{pid}/stat")).ok().as_deref().and_then(stat)?;
    // Who may not be looked at so closely has the processor to show.
    let bytes = fs::read_to_string(format!("/proc/{pid}/io")).map_or(0, |text| io(&text));
    Some(Usage { state, ticks, bytes })
}

/// State and processor time of `/proc/PID/stat`; a name may hold spaces and parentheses.
fn stat(text: &str) -> Option<(char, u64)> {
    let (_, fields) = text.rsplit_once(')')?;
    let fields: Vec<&str> = fields.split_whitespace().collect();
    let state = fields.first()?.chars().next()?;
    let ticks = |field: usize| fields.get(field)?.parse::<u64>().ok();
    Some((state, ticks(11)?.saturating_add(ticks(12)?)))
}

/// Bytes read and written, of `/proc/PID/io`.
fn io(text: &str) -> u64 {
    let counts = ["rchar: ", "wchar: ", "read_bytes: ", "write_bytes: "];
    let of = |line: &str| counts.iter().find_map(|name| line.strip_prefix(name))?.trim().parse().ok();
    text.lines().filter_map(of).fold(0, |sum: u64, count: u64| sum.saturating_add(count))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_system_is_understood() {
        let text = "7 (a) b (c) R 1 7 7 0 -1 4194304 99 0 0 0 12 30 0 0 20 0 1 0 55 1 2";
        assert_eq!(stat(text), Some(('R', 42)));
        assert_eq!(stat("7 (cut) R 1"), None);
        assert_eq!(io("rchar: 10\nwchar: 20\nsyscr: 3\nread_bytes: 5\nwrite_bytes: x\n"), 35);
        let own = fs::read_to_string("/proc/self/stat").unwrap();
        assert!(matches!(stat(&own), Some(('R' | 'S', _))), "{own}");
    }
}
