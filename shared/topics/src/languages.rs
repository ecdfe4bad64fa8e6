//! The layouts of all messages, written for other languages: `python/echogrid/layouts.py` and `c/echogrid_layouts.h` of this repository.
//!
//! Both are printed by `echogrid topic layout`, too, so that a program elsewhere can have those of the echogrid that it talks to.

use core::fmt::Write;

use crate::topic::Topic;
use crate::wire::{Field, Layout, all_layouts};

/// What a field is made of, and how many of it if it is an array: `f64`, `[u8; 64]`, `[SensorWire; 256]`.
fn element(ty: &str) -> (&str, Option<&str>) {
    let array = ty.strip_prefix('[').and_then(|ty| ty.strip_suffix(']')?.rsplit_once("; "));
    array.map_or((ty, None), |(element, length)| (element, Some(length)))
}

/// `Header` of `echogrid/Header/3`.
fn name(layout: &Layout) -> &'static str {
    layout.schema.split('/').nth(1).unwrap_or(layout.schema)
}

/// `range_reading` of `RangeReading`.
fn snake(name: &str) -> String {
    let mut snake = String::new();
    for (at, letter) in name.char_indices() {
        if letter.is_uppercase() && at > 0 {
            snake.push('_');
        }
        snake.extend(letter.to_lowercase());
    }
    snake
}

/// A module of `ctypes` structures, with the topics that they go over.
#[must_use]
pub fn python() -> String {
    let mut text = "\"\"\"Layouts of all messages. Written by echogrid (`echogrid topic layout --lang python`); do not edit.\"\"\"\n\n\
                    import ctypes\nfrom typing import NamedTuple\n"
        .to_owned();
    for layout in all_layouts() {
        let _ = write!(
            text,
            "\n\nclass {}(ctypes.Structure):\n    \"\"\"{}, {} bytes.\"\"\"\n\n",
            name(layout),
            layout.schema,
            layout.size
        );
        text += "    _fields_ = [\n";
        for field in layout.fields {
            let (ty, length) = element(field.ty);
            let of = field.part.map_or_else(|| format!("ctypes.{}", ctype(ty)), |part| name(part).to_owned());
            let times = length.map_or_else(String::new, |length| format!(" * {length}"));
            let _ = writeln!(text, "        (\"{}\", {of}{times}),", field.name);
        }
        let _ =
            write!(text, "    ]\n\n    @staticmethod\n    def type_name():\n        return \"{}\"\n", layout.schema);
    }
    text += "\n\nclass Topic(NamedTuple):\n    \"\"\"A topic: its number on the wire, what its messages are, and what it promises.\"\"\"\n\n";
    text += "    code: int\n    payload: type\n    is_slice: bool\n    delivery: str\n\n\nTOPICS = {\n";
    for topic in Topic::ALL {
        let (code, payload) = (topic.code(), name(topic.layout()));
        let is_slice = if topic.is_slice() { "True" } else { "False" };
        let _ = writeln!(
            text,
            "    \"{}\": Topic({code}, {payload}, {is_slice}, \"{}\"),",
            topic.name(),
            topic.delivery().word()
        );
    }
    text += "}\n\n# Where every field must lie, in bytes.\n_OFFSETS = {\n";
    for layout in all_layouts() {
        let offsets: Vec<String> = layout.fields.iter().map(|field| field.offset.to_string()).collect();
        let _ = writeln!(text, "    {}: ({}, [{}]),", name(layout), layout.size, offsets.join(", "));
    }
    text += "}\n\nfor _type, (_size, _offsets) in _OFFSETS.items():\n";
    text += "    _here = [getattr(_type, field[0]).offset for field in _type._fields_]\n";
    text += "    if (ctypes.sizeof(_type), _here) != (_size, _offsets):\n";
    text += "        raise ImportError(f\"{_type.type_name()}: this machine lays it out otherwise: {_here}\")\n";
    text
}

fn ctype(ty: &str) -> &'static str {
    match ty {
        "u8" => "c_uint8",
        "u16" => "c_uint16",
        "u32" => "c_uint32",
        "u64" => "c_uint64",
        "i32" => "c_int32",
        "f32" => "c_float",
        _ => "c_double",
    }
}

/// A header of structures, each with assertions that the compiler lays it out so.
#[must_use]
pub fn c_header() -> String {
    let mut text = "/* Layouts of all messages. Written by echogrid (`echogrid topic layout --lang c`); do not edit. */\n\n\
                    #ifndef ECHOGRID_LAYOUTS_H\n#define ECHOGRID_LAYOUTS_H\n\n#include <stddef.h>\n#include <stdint.h>\n\n\
                    #ifdef __cplusplus\n#define ECHOGRID_ASSERT static_assert\n#else\n#define ECHOGRID_ASSERT _Static_assert\n#endif\n"
        .to_owned();
    for layout in all_layouts() {
        let of_c = format!("struct echogrid_{}", snake(name(layout)));
        let _ = write!(text, "\n/* {} */\n{of_c} {{\n", layout.schema);
        for field in layout.fields {
            let (ty, length) = element(field.ty);
            let of = field
                .part
                .map_or_else(|| c_type(ty).to_owned(), |part| format!("struct echogrid_{}", snake(name(part))));
            let times = length.map_or_else(String::new, |length| format!("[{length}]"));
            let _ = writeln!(text, "    {of} {}{times};", field.name);
        }
        let _ = writeln!(text, "}};\nECHOGRID_ASSERT(sizeof({of_c}) == {}, \"{}\");", layout.size, layout.schema);
        for Field { name, offset, .. } in layout.fields {
            let _ = writeln!(text, "ECHOGRID_ASSERT(offsetof({of_c}, {name}) == {offset}, \"{}\");", layout.schema);
        }
    }
    text.push('\n');
    for topic in Topic::ALL {
        let constant = topic.name().replace('/', "_").to_uppercase();
        let _ = writeln!(text, "#define ECHOGRID_TOPIC_{constant} {}", topic.code());
    }
    text + "\n#endif\n"
}

fn c_type(ty: &str) -> &'static str {
    match ty {
        "u8" => "uint8_t",
        "u16" => "uint16_t",
        "u32" => "uint32_t",
        "u64" => "uint64_t",
        "i32" => "int32_t",
        "f32" => "float",
        _ => "double",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is in the repository is what is written here; `ECHOGRID_WRITE_LAYOUT=1` has it so.
    fn check(file: &str, written: &str) {
        let path = std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join(file);
        if std::env::var_os("ECHOGRID_WRITE_LAYOUT").is_some() {
            std::fs::write(&path, written).unwrap();
        }
        assert!(std::fs::read_to_string(&path).unwrap() == written, "{file}: ECHOGRID_WRITE_LAYOUT=1 writes it anew");
    }

    #[test]
    fn the_module_for_python_and_the_header_for_c_are_up_to_date() {
        check("python/echogrid/layouts.py", &python());
        check("c/echogrid_layouts.h", &c_header());
    }

    #[test]
    fn every_topic_is_there() {
        let (python, c) = (python(), c_header());
        for topic in Topic::ALL {
            assert!(python.contains(&format!("\"{}\": Topic({}, ", topic.name(), topic.code())), "{topic:?}");
            let constant = topic.name().replace('/', "_").to_uppercase();
            assert!(c.contains(&format!("#define ECHOGRID_TOPIC_{constant} {}\n", topic.code())), "{topic:?}");
        }
        assert!(python.contains("\"range/scan\": Topic(3, RangeReading, True, \"lossless\")"));
    }
}
