//! How messages lie in shared memory.
//!
//! Every type is `#[repr(C)]`, in SI units, of fixed layout, and named `echogrid/<Name>/<version>`;
//! a process in C, C++ or Python that iceoryx2 speaks to can declare the same. `layout.txt` beside
//! this crate lists every field with its offset; a test fails when a layout changes and that file,
//! with the version in it, does not.
//!
//! Enumerations travel as numbers and are checked on arrival: see [`crate::contract`].

pub(crate) use iceoryx2::prelude::ZeroCopySend;

use crate::control::{ControlReplyWire, ControlRequestWire};
use crate::topic::Topic;

/// Header flag: the stream ends here.
pub(crate) const END: u16 = 1;
/// Header flag, on relayed topics: the process whose number `stamp_ns` is has been told all that counts.
pub(crate) const TOLD: u16 = 2;

/// One field of a wire type.
#[derive(Debug, Clone, Copy)]
pub struct Field {
    /// The name of the field.
    pub name: &'static str,
    /// The Rust type of the field.
    pub ty: &'static str,
    /// Bytes from the start of the message.
    pub offset: usize,
    /// The size of the field, bytes.
    pub size: usize,
    /// The layout of a wire type within this one.
    pub part: Option<&'static Layout>,
}

/// The layout of a wire type.
#[derive(Debug, Clone, Copy)]
pub struct Layout {
    /// The name of the type and its version: `echogrid/<Name>/<version>`.
    pub schema: &'static str,
    /// The size of the type, bytes.
    pub size: usize,
    /// The alignment of the type, bytes.
    pub align: usize,
    /// Fields in order.
    pub fields: &'static [Field],
}

/// A message type with its name, version and layout.
pub trait Wire: ZeroCopySend + core::fmt::Debug + Copy + Default + 'static {
    /// `echogrid/<Name>/<version>`.
    const SCHEMA: &'static str;
    /// Name, size and fields.
    const LAYOUT: &'static Layout;
}

macro_rules! wire {
    ($(#[$doc:meta])* $schema:literal $name:ident { $($(#[$fdoc:meta])* $field:ident: $ty:ty,)* }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, ZeroCopySend)]
        #[type_name($schema)]
        #[repr(C)]
        pub struct $name { $($(#[$fdoc])* pub $field: $ty,)* }

        impl Default for $name {
            fn default() -> Self { crate::wire::Plain::ZERO }
        }
        impl crate::wire::Plain for $name {
            const ZERO: Self = Self { $($field: crate::wire::Plain::ZERO,)* };
            const PART: Option<&'static crate::wire::Layout> = Some(<Self as crate::wire::Wire>::LAYOUT);
        }
        impl crate::wire::Wire for $name {
            const SCHEMA: &'static str = $schema;
            const LAYOUT: &'static crate::wire::Layout = &crate::wire::Layout {
                schema: $schema,
                size: size_of::<$name>(),
                align: align_of::<$name>(),
                fields: &[$(crate::wire::Field {
                    name: stringify!($field),
                    ty: stringify!($ty),
                    offset: core::mem::offset_of!($name, $field),
                    size: size_of::<$ty>(),
                    part: <$ty as crate::wire::Plain>::PART,
                },)*],
            };
        }
    };
}
pub(crate) use wire;

/// What a wire type is made of: numbers, arrays, other wire types.
pub trait Plain {
    /// All zero, also of arrays longer than `Default` knows.
    const ZERO: Self;
    /// The layout of the wire type that it is, or is an array of.
    const PART: Option<&'static Layout> = None;
}
macro_rules! plain { ($($ty:ty = $zero:expr),*) => { $(impl Plain for $ty { const ZERO: Self = $zero; })* } }
plain!(u8 = 0, u16 = 0, u32 = 0, u64 = 0, i32 = 0, f32 = 0.0, f64 = 0.0);
impl<T: Plain, const N: usize> Plain for [T; N] {
    const ZERO: Self = [T::ZERO; N];
    const PART: Option<&'static Layout> = T::PART;
}

wire! {
    /// Goes with every message of every topic.
    "echogrid/Header/3" Header {
        /// Number of this message: 1, 2, 3 …; on a lossless topic within the run, else within the producer's life.
        sequence: u64,
        /// On a lossless topic the run's, as the plan says; else the producer's life.
        epoch: u64,
        /// When the content was true, by the sensor's clock, nanoseconds.
        stamp_ns: u64,
        /// Bit 0: the stream ends here; bit 1: the process whose number `stamp_ns` is has been told all that counts. The payload
        /// says nothing in either case.
        flags: u16,
        /// Number of the robot that the message speaks of; 0: the only one.
        robot: u16,
        /// The producer's life: differs after each restart.
        life: u32,
    }
}

/// A layout that is not there yet, after those of its parts.
fn add_layout(layout: &'static Layout, all: &mut Vec<&'static Layout>) {
    layout.fields.iter().filter_map(|field| field.part).for_each(|part| add_layout(part, all));
    if !all.iter().any(|known| known.schema == layout.schema) {
        all.push(layout);
    }
}

/// The layouts of all message types, each once and after those of its parts.
pub(crate) fn all_layouts() -> Vec<&'static Layout> {
    let mut all = Vec::new();
    let topics = Topic::ALL.map(|topic| topic.row().layout);
    let orders = [ControlRequestWire::LAYOUT, ControlReplyWire::LAYOUT];
    [Header::LAYOUT].into_iter().chain(topics).chain(orders).for_each(|layout| add_layout(layout, &mut all));
    all
}

/// The layouts of all message types as text: `layout.txt` of this crate.
#[must_use]
pub fn layouts() -> String {
    all_layouts().into_iter().map(text).collect()
}

/// The layout of a topic's messages as text, after those of its parts.
#[must_use]
pub fn layout_of(topic: Topic) -> String {
    let mut all = Vec::new();
    add_layout(topic.row().layout, &mut all);
    all.into_iter().map(text).collect()
}

/// The bytes of a message as they lie in shared memory.
pub(crate) fn bytes_of<W: Wire>(wire: &W) -> &[u8] {
    // SAFETY: in bounds; wire types are `repr(C)` of numbers and arrays of them, and a test holds that there is no padding between.
    unsafe { core::slice::from_raw_parts((&raw const *wire).cast(), size_of::<W>()) }
}

/// A layout without those of its parts.
fn text(layout: &Layout) -> String {
    let Layout { schema, size, align, fields } = layout;
    let fields = fields.iter().map(|field| format!("  {:>5} {}: {}\n", field.offset, field.name, field.ty));
    format!("{schema} size {size} align {align}\n{}", fields.collect::<String>())
}

/// Text padded with zeros; cut at a character where it is too long.
pub(crate) fn text_to_bytes<const N: usize>(text: &str) -> [u8; N] {
    let mut end = text.len().min(N);
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    let mut bytes = [0; N];
    bytes[..end].copy_from_slice(&text.as_bytes()[..end]);
    bytes
}

/// The text before the first zero; bytes that are not UTF-8 are replaced.
pub(crate) fn bytes_to_text(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|b| *b == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..end]).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A layout may change only together with the version in its name: then write the new
    /// `layout.txt` with `ECHOGRID_WRITE_LAYOUT=1 cargo test -p echogrid-topics layouts`.
    #[test]
    fn layouts_change_only_with_their_version() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/layout.txt");
        if std::env::var_os("ECHOGRID_WRITE_LAYOUT").is_some() {
            let before = std::fs::read_to_string(path).unwrap_or_default();
            for block in blocks(&before) {
                let name = block.split(' ').next().unwrap();
                if let Some(now) = blocks(&layouts()).iter().find(|b| b.split(' ').next() == Some(name)) {
                    assert_eq!(now, &block, "{name} changed: raise its version first");
                }
            }
            std::fs::write(path, layouts()).unwrap();
        }
        assert_eq!(std::fs::read_to_string(path).unwrap(), layouts());
    }

    fn blocks(text: &str) -> Vec<String> {
        let mut blocks: Vec<String> = Vec::new();
        for line in text.lines() {
            match blocks.last_mut() {
                Some(block) if line.starts_with(' ') => *block += &format!("\n{line}"),
                _ => blocks.push(line.into()),
            }
        }
        blocks
    }

    #[test]
    fn no_message_holds_padding() {
        // Padding would carry whatever bytes the sender's memory held.
        let topics = Topic::ALL.map(|topic| topic.row().layout);
        let orders = [Header::LAYOUT, ControlRequestWire::LAYOUT, ControlReplyWire::LAYOUT];
        let mut layouts: Vec<&Layout> = topics.into_iter().chain(orders).collect();
        while let Some(layout) = layouts.pop() {
            let end = layout.fields.iter().fold(0, |end, field| {
                assert_eq!(field.offset, end, "before {} of {}", field.name, layout.schema);
                end + field.size
            });
            assert_eq!(end, layout.size, "behind {}", layout.schema);
            layouts.extend(layout.fields.iter().filter_map(|field| field.part));
        }
    }

    #[test]
    fn text_survives_and_is_cut_at_characters() {
        assert_eq!(bytes_to_text(&text_to_bytes::<8>("mapper")), "mapper");
        assert_eq!(bytes_to_text(&text_to_bytes::<5>("Größe")), "Grö");
    }
}
