//! The fields of a message, as ROS 1 and ROS 2 put them into bytes.

use super::container::Encoding;

/// Reads the fields of a message one after the other; none where they end.
pub(crate) struct Fields<'a> {
    bytes: &'a [u8],
    at: usize,
    layout: Layout,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Layout {
    /// Packed, little-endian.
    Ros1,
    /// Aligned to their size, at most so many bytes.
    Cdr { is_big_endian: bool, align_max: usize },
}

impl<'a> Fields<'a> {
    pub(crate) fn new(data: &'a [u8], encoding: Encoding) -> Option<Self> {
        match encoding {
            Encoding::Ros1 => Some(Self { bytes: data, at: 0, layout: Layout::Ros1 }),
            Encoding::Cdr => {
                // Two bytes say how, two are left for options. Kinds: plain CDR, and plain CDR of version 2.
                let (head, bytes) = data.split_at_checked(4)?;
                let layout = match head {
                    [0, kind @ (0 | 1), ..] => Layout::Cdr { is_big_endian: *kind == 0, align_max: 8 },
                    [0, kind @ (6 | 7), ..] => Layout::Cdr { is_big_endian: *kind == 6, align_max: 4 },
                    _ => return None,
                };
                Some(Self { bytes, at: 0, layout })
            }
            Encoding::Other => None,
        }
    }

    pub(crate) fn is_ros1(&self) -> bool {
        self.layout == Layout::Ros1
    }

    fn raw<const N: usize>(&mut self) -> Option<[u8; N]> {
        if let Layout::Cdr { align_max, .. } = self.layout {
            self.at = self.at.checked_next_multiple_of(N.min(align_max))?;
        }
        let end = self.at.checked_add(N)?;
        let mut raw: [u8; N] = self.bytes.get(self.at..end)?.try_into().ok()?;
        self.at = end;
        if matches!(self.layout, Layout::Cdr { is_big_endian: true, .. }) {
            raw.reverse();
        }
        Some(raw)
    }

    pub(crate) fn u8(&mut self) -> Option<u8> {
        self.raw::<1>().map(|[byte]| byte)
    }

    pub(crate) fn u32(&mut self) -> Option<u32> {
        self.raw().map(u32::from_le_bytes)
    }

    pub(crate) fn f32(&mut self) -> Option<f64> {
        self.raw().map(f32::from_le_bytes).map(f64::from)
    }

    pub(crate) fn f64(&mut self) -> Option<f64> {
        self.raw().map(f64::from_le_bytes)
    }

    pub(crate) fn f64s<const N: usize>(&mut self) -> Option<[f64; N]> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.f64()?;
        }
        Some(values)
    }

    /// A sequence of 32-bit numbers; their number is checked against what is there.
    pub(crate) fn f32s(&mut self) -> Option<Vec<f64>> {
        let count = self.count(4)?;
        // Numbers of this size follow each other without a gap, in every layout.
        let end = self.at.checked_add(count.checked_mul(4)?)?;
        let raw = self.bytes.get(self.at..end)?;
        self.at = end;
        let is_big_endian = matches!(self.layout, Layout::Cdr { is_big_endian: true, .. });
        let number = |raw: &[u8; 4]| if is_big_endian { f32::from_be_bytes(*raw) } else { f32::from_le_bytes(*raw) };
        Some(raw.as_chunks().0.iter().map(number).map(f64::from).collect())
    }

    /// How many elements of at least so many bytes follow.
    pub(crate) fn count(&mut self, bytes_each: usize) -> Option<usize> {
        let count = usize::try_from(self.u32()?).ok()?;
        let left = self.bytes.len().saturating_sub(self.at);
        (count.checked_mul(bytes_each)? <= left).then_some(count)
    }

    pub(crate) fn text(&mut self) -> Option<&'a str> {
        let count = self.count(1)?;
        let end = self.at + count;
        let text = self.bytes.get(self.at..end)?;
        self.at = end;
        // ROS 2 ends texts with a zero.
        core::str::from_utf8(text.strip_suffix(&[0]).unwrap_or(text)).ok()
    }

    /// Seconds and nanoseconds; none where they are no time after 1970.
    pub(crate) fn time(&mut self) -> Option<Option<u64>> {
        let (seconds, nanoseconds) = (self.u32()?, self.u32()?);
        let is_time = (self.is_ros1() || i32::try_from(seconds).is_ok()) && nanoseconds < 1_000_000_000;
        let stamp_ns = u64::from(seconds) * 1_000_000_000 + u64::from(nanoseconds);
        Some((is_time && stamp_ns > 0).then_some(stamp_ns))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_fields_in_every_layout() {
        let ros1 = [&3_u32.to_le_bytes()[..], b"abc", &1.5_f64.to_le_bytes(), &7_u32.to_le_bytes()].concat();
        let little = [b"\0\x01\0\0", &4_u32.to_le_bytes()[..], b"abc\0", &1.5_f64.to_le_bytes(), &7_u32.to_le_bytes()];
        let big = [b"\0\0\0\0", &4_u32.to_be_bytes()[..], b"abc\0", &1.5_f64.to_be_bytes(), &7_u32.to_be_bytes()];
        for (data, encoding) in
            [(ros1, Encoding::Ros1), (little.concat(), Encoding::Cdr), (big.concat(), Encoding::Cdr)]
        {
            let mut fields = Fields::new(&data, encoding).unwrap();
            assert_eq!((fields.text(), fields.f64(), fields.u32()), (Some("abc"), Some(1.5), Some(7)));
            assert_eq!(fields.u8(), None);
        }
    }

    #[test]
    fn fields_are_aligned_behind_the_head() {
        let head = |kind: u8| vec![0, kind, 0, 0, 9, 0, 0, 0];
        let mut plain = head(1);
        plain.extend([0; 4]);
        plain.extend(2.5_f64.to_le_bytes());
        let mut second = head(7);
        second.extend(2.5_f64.to_le_bytes());
        for data in [plain, second] {
            let mut fields = Fields::new(&data, Encoding::Cdr).unwrap();
            assert_eq!((fields.u8(), fields.f64()), (Some(9), Some(2.5)));
        }
        assert!(Fields::new(&[0, 3, 0, 0], Encoding::Cdr).is_none(), "parameter lists are no messages of ROS");
    }

    #[test]
    fn a_count_beyond_the_end_takes_no_memory() {
        let data = u32::MAX.to_le_bytes();
        assert_eq!(Fields::new(&data, Encoding::Ros1).unwrap().f32s(), None);
        assert_eq!(Fields::new(&data, Encoding::Ros1).unwrap().text(), None);
    }
}
