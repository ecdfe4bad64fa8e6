//! Writes small recordings: ROS 1 bags and MCAP files, messages as ROS 1 and as ROS 2 put them into bytes.

use std::io::Write as _;

/// How the fields of messages are put into bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Encoding {
    Ros1,
    Cdr,
}

/// How chunks are packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Packing {
    None,
    Bzip2,
    Lz4,
    Zstandard,
}

/// The kind of file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum File {
    Bag(Packing),
    Mcap(Packing, Encoding),
}

/// One message, whatever the encoding.
#[derive(Debug, Clone)]
pub(crate) struct Recorded {
    /// Messages of one topic and number share a connection.
    pub(crate) topic: &'static str,
    pub(crate) connection: u32,
    pub(crate) log_ns: u64,
    pub(crate) content: Content,
}

#[derive(Debug, Clone)]
pub(crate) enum Content {
    Scan {
        stamp_ns: u64,
        frame: &'static str,
        first: f32,
        step: f32,
        beam_s: f32,
        min: f32,
        max: f32,
        ranges: Vec<f32>,
    },
    Range {
        stamp_ns: u64,
        frame: &'static str,
        fov: f32,
        min: f32,
        max: f32,
        range: f32,
    },
    Odometry {
        stamp_ns: u64,
        frame: &'static str,
        child: &'static str,
        pose: [f64; 3],
        v: f64,
        w: f64,
    },
    Transforms(Vec<Edge>),
    Pose {
        stamp_ns: u64,
        pose: [f64; 3],
    },
    Text(&'static str),
}

/// When, parent, child, translation, quaternion.
pub(crate) type Edge = (u64, &'static str, &'static str, [f64; 3], [f64; 4]);

/// The quaternion of a heading.
pub(crate) fn yaw(theta: f64) -> [f64; 4] {
    [0.0, 0.0, (theta / 2.0).sin(), (theta / 2.0).cos()]
}

impl Content {
    fn datatype(&self) -> (&'static str, &'static str) {
        match self {
            Self::Scan { .. } => ("sensor_msgs", "LaserScan"),
            Self::Range { .. } => ("sensor_msgs", "Range"),
            Self::Odometry { .. } => ("nav_msgs", "Odometry"),
            Self::Transforms(_) => ("tf2_msgs", "TFMessage"),
            Self::Pose { .. } => ("geometry_msgs", "PoseStamped"),
            Self::Text(_) => ("std_msgs", "String"),
        }
    }

    fn bytes(&self, encoding: Encoding) -> Vec<u8> {
        let mut to = Fields { out: Vec::new(), encoding };
        match self {
            Self::Scan { stamp_ns, frame, first, step, beam_s, min, max, ranges } => {
                to.head(*stamp_ns, frame);
                let last = first + step * (ranges.len() as f32 - 1.0);
                [*first, last, *step, *beam_s, 0.1, *min, *max].into_iter().for_each(|value| to.f32(value));
                to.u32(ranges.len() as u32);
                ranges.iter().for_each(|range| to.f32(*range));
                to.u32(2);
                [7.0, 8.0].into_iter().for_each(|value| to.f32(value));
            }
            Self::Range { stamp_ns, frame, fov, min, max, range } => {
                to.head(*stamp_ns, frame);
                to.out.push(0);
                [*fov, *min, *max, *range].into_iter().for_each(|value| to.f32(value));
            }
            Self::Odometry { stamp_ns, frame, child, pose: [x, y, theta], v, w } => {
                to.head(*stamp_ns, frame);
                to.text(child);
                [*x, *y, 0.0].into_iter().chain(yaw(*theta)).for_each(|value| to.f64(value));
                (0..36).for_each(|_| to.f64(0.0));
                [*v, 0.0, 0.0, 0.0, 0.0, *w].into_iter().for_each(|value| to.f64(value));
                (0..36).for_each(|_| to.f64(0.0));
            }
            Self::Transforms(transforms) => {
                to.u32(transforms.len() as u32);
                for (stamp_ns, parent, child, translation, rotation) in transforms {
                    to.head(*stamp_ns, parent);
                    to.text(child);
                    translation.iter().chain(rotation).for_each(|value| to.f64(*value));
                }
            }
            Self::Pose { stamp_ns, pose: [x, y, theta] } => {
                to.head(*stamp_ns, "map");
                [*x, *y, 0.0].into_iter().chain(yaw(*theta)).for_each(|value| to.f64(value));
            }
            Self::Text(text) => to.text(text),
        }
        match encoding {
            Encoding::Ros1 => to.out,
            Encoding::Cdr => [&[0, 1, 0, 0], to.out.as_slice()].concat(),
        }
    }
}

struct Fields {
    out: Vec<u8>,
    encoding: Encoding,
}

impl Fields {
    fn align(&mut self, to: usize) {
        if self.encoding == Encoding::Cdr {
            self.out.resize(self.out.len().next_multiple_of(to), 0);
        }
    }

    fn u32(&mut self, value: u32) {
        self.align(4);
        self.out.extend(value.to_le_bytes());
    }

    fn f32(&mut self, value: f32) {
        self.u32(value.to_bits());
    }

    fn f64(&mut self, value: f64) {
        self.align(8);
        self.out.extend(value.to_le_bytes());
    }

    fn text(&mut self, text: &str) {
        let end: &[u8] = if self.encoding == Encoding::Cdr { &[0] } else { &[] };
        self.u32((text.len() + end.len()) as u32);
        self.out.extend(text.as_bytes());
        self.out.extend(end);
    }

    fn head(&mut self, stamp_ns: u64, frame: &str) {
        if self.encoding == Encoding::Ros1 {
            self.u32(17);
        }
        self.u32((stamp_ns / 1_000_000_000) as u32);
        self.u32((stamp_ns % 1_000_000_000) as u32);
        self.text(frame);
    }
}

impl File {
    /// The bytes of a recording of these messages, so many of them in a chunk.
    pub(crate) fn write(self, messages: &[Recorded], per_chunk: usize) -> Vec<u8> {
        match self {
            Self::Bag(packing) => bag(messages, per_chunk, packing),
            Self::Mcap(packing, encoding) => mcap(messages, per_chunk, packing, encoding),
        }
    }
}

fn pack(content: &[u8], packing: Packing) -> Vec<u8> {
    match packing {
        Packing::None => content.to_vec(),
        Packing::Bzip2 => {
            let mut encoder = bzip2::write::BzEncoder::new(Vec::new(), bzip2::Compression::fast());
            encoder.write_all(content).unwrap();
            encoder.finish().unwrap()
        }
        Packing::Lz4 => {
            let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
            encoder.write_all(content).unwrap();
            encoder.finish().unwrap()
        }
        Packing::Zstandard => ruzstd::encoding::compress_to_vec(content, ruzstd::encoding::CompressionLevel::Fastest),
    }
}

fn counted(bytes: &[u8]) -> Vec<u8> {
    [&(bytes.len() as u32).to_le_bytes(), bytes].concat()
}

fn record(fields: &[(&str, &[u8])], data: &[u8]) -> Vec<u8> {
    let field = |(name, value): &(&str, &[u8])| counted(&[name.as_bytes(), b"=", value].concat());
    let header: Vec<u8> = fields.iter().flat_map(field).collect();
    [counted(&header), counted(data)].concat()
}

fn bag(messages: &[Recorded], per_chunk: usize, packing: Packing) -> Vec<u8> {
    let name: &[u8] = match packing {
        Packing::None => b"none",
        Packing::Bzip2 => b"bz2",
        Packing::Lz4 => b"lz4",
        Packing::Zstandard => b"zstd",
    };
    let mut known = Vec::new();
    let mut chunks = Vec::new();
    let mut infos = 0_u32;
    for messages in messages.chunks(per_chunk) {
        let mut chunk = Vec::new();
        for message in messages {
            let id = message.connection.to_le_bytes();
            if !known.contains(&message.connection) {
                known.push(message.connection);
                let (package, datatype) = message.content.datatype();
                let datatype = format!("{package}/{datatype}");
                let field = |name: &str, value: &str| counted(format!("{name}={value}").as_bytes());
                let about = [field("topic", message.topic), field("type", &datatype), field("md5sum", "*")].concat();
                chunk.extend(record(&[("op", &[7]), ("conn", &id), ("topic", message.topic.as_bytes())], &about));
            }
            let time = [
                ((message.log_ns / 1_000_000_000) as u32).to_le_bytes(),
                ((message.log_ns % 1_000_000_000) as u32).to_le_bytes(),
            ]
            .concat();
            let fields: [(&str, &[u8]); 3] = [("op", &[2]), ("conn", &id), ("time", &time)];
            chunk.extend(record(&fields, &message.content.bytes(Encoding::Ros1)));
        }
        let size = (chunk.len() as u32).to_le_bytes();
        let packed = pack(&chunk, packing);
        chunks.extend(record(&[("op", &[5]), ("compression", name), ("size", &size)], &packed));
        chunks.extend(record(&[("op", &[4]), ("ver", &1_u32.to_le_bytes())], b"index data"));
        infos += 1;
    }
    let magic = b"#ROSBAG V2.0\n";
    let head = |index_at: u64| {
        let numbers = (index_at.to_le_bytes(), (known.len() as u32).to_le_bytes(), infos.to_le_bytes());
        let fields: [(&str, &[u8]); 4] =
            [("op", &[3]), ("index_pos", &numbers.0), ("conn_count", &numbers.1), ("chunk_count", &numbers.2)];
        record(&fields, &[b' '; 64])
    };
    let index_at = magic.len() + head(0).len() + chunks.len();
    let index: Vec<u8> = (0..infos).flat_map(|_| record(&[("op", &[6])], b"chunk info")).collect();
    [magic.as_slice(), &head(index_at as u64), &chunks, &index].concat()
}

fn mcap(messages: &[Recorded], per_chunk: usize, packing: Packing, encoding: Encoding) -> Vec<u8> {
    let record = |kind: u8, content: &[u8]| [&[kind], &(content.len() as u64).to_le_bytes()[..], content].concat();
    let text = |text: &str| counted(text.as_bytes());
    let (profile, encoded, schema_encoding) = match encoding {
        Encoding::Ros1 => ("ros1", "ros1", "ros1msg"),
        Encoding::Cdr => ("ros2", "cdr", "ros2msg"),
    };
    let magic = b"\x89MCAP0\r\n";
    let mut out = [magic.as_slice(), &record(1, &[text(profile), text("a test")].concat())].concat();
    let mut known = Vec::new();
    for messages in messages.chunks(per_chunk) {
        let mut chunk = Vec::new();
        for message in messages {
            let id = (message.connection as u16 + 1).to_le_bytes();
            if !known.contains(&message.connection) {
                known.push(message.connection);
                let (package, datatype) = message.content.datatype();
                let datatype = match encoding {
                    Encoding::Ros1 => format!("{package}/{datatype}"),
                    Encoding::Cdr => format!("{package}/msg/{datatype}"),
                };
                chunk.extend(record(3, &[&id[..], &text(&datatype), &text(schema_encoding), &text("")].concat()));
                let channel = [&id[..], &id[..], &text(message.topic), &text(encoded), &0_u32.to_le_bytes()];
                chunk.extend(record(4, &channel.concat()));
            }
            let time = message.log_ns.to_le_bytes();
            let head = [&id[..], &[0; 4], &time, &time].concat();
            chunk.extend(record(5, &[head, message.content.bytes(encoding)].concat()));
        }
        let packed = pack(&chunk, packing);
        let name = match packing {
            Packing::None => "",
            Packing::Lz4 => "lz4",
            Packing::Zstandard => "zstd",
            Packing::Bzip2 => "bz2",
        };
        let mut head = [0_u8; 16].to_vec();
        head.extend((chunk.len() as u64).to_le_bytes());
        head.extend(crc32fast::hash(&chunk).to_le_bytes());
        head.extend(text(name));
        head.extend((packed.len() as u64).to_le_bytes());
        out.extend(record(6, &[head, packed].concat()));
    }
    out.extend(record(15, &[0; 4]));
    out.extend(record(2, &[0; 20]));
    out.extend(magic);
    out
}
