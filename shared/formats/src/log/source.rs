//! Bytes of a file: hashed as stored, decompressed if gzip, bzip2 or Zstandard packed them.

use std::io::{self, BufRead, BufReader, Chain, Cursor, Read};

use bzip2::bufread::MultiBzDecoder;
use flate2::bufread::MultiGzDecoder;
use sha2::{Digest as _, Sha256};

use super::zstandard::Zstandard;

const GZIP_MAGIC: [u8; 2] = [0x1f, 0x8b];
const BZIP2_MAGIC: [u8; 3] = *b"BZh";
const ZSTANDARD_MAGIC: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];
const BUFFER_BYTES: usize = 64 * 1024;

/// Counts and hashes what passes.
struct Tap<R> {
    inner: R,
    hasher: Sha256,
    bytes: u64,
}

impl<R: Read> Read for Tap<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let length = self.inner.read(buffer)?;
        self.hasher.update(buffer.get(..length).unwrap_or_default());
        self.bytes += length as u64;
        Ok(length)
    }
}

/// A decoder that is not asked again once it met damage: the one for bzip2 panics then.
struct UntilDamage<R> {
    inner: R,
    damage: Option<(io::ErrorKind, String)>,
}

impl<R: Read> Read for UntilDamage<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if let Some((kind, text)) = &self.damage {
            return Err(io::Error::new(*kind, text.clone()));
        }
        let read = self.inner.read(buffer);
        if let Err(error) = &read
            && is_damage(error)
        {
            self.damage = Some((error.kind(), error.to_string()));
        }
        read
    }
}

type Stored<R> = BufReader<Chain<Cursor<Vec<u8>>, Tap<R>>>;

/// A file's content, decompressed if its first bytes say how (whatever its name says).
pub(crate) struct Source<R: Read>(Content<R>);

enum Content<R: Read> {
    Plain(Stored<R>),
    Gzip(Box<BufReader<MultiGzDecoder<Stored<R>>>>),
    Bzip2(Box<BufReader<UntilDamage<MultiBzDecoder<Stored<R>>>>>),
    Zstandard(Box<BufReader<Zstandard<Stored<R>>>>),
}

/// What the stored bytes were.
pub(crate) struct Stamp {
    pub(crate) hasher: Sha256,
    pub(crate) bytes: u64,
}

impl<R: Read> Source<R> {
    pub(crate) fn new(stored: R) -> io::Result<Self> {
        let mut tap = Tap { inner: stored, hasher: Sha256::new(), bytes: 0 };
        let mut magic = Vec::with_capacity(4);
        tap.by_ref().take(4).read_to_end(&mut magic)?;
        let begins = |with: &[u8]| magic.starts_with(with);
        let (gzip, bzip2, zstandard) = (begins(&GZIP_MAGIC), begins(&BZIP2_MAGIC), begins(&ZSTANDARD_MAGIC));
        let stored = BufReader::with_capacity(BUFFER_BYTES, Cursor::new(magic).chain(tap));
        Ok(Self(if gzip {
            Content::Gzip(Box::new(BufReader::with_capacity(BUFFER_BYTES, MultiGzDecoder::new(stored))))
        } else if bzip2 {
            let decoder = UntilDamage { inner: MultiBzDecoder::new(stored), damage: None };
            Content::Bzip2(Box::new(BufReader::with_capacity(BUFFER_BYTES, decoder)))
        } else if zstandard {
            Content::Zstandard(Box::new(BufReader::with_capacity(BUFFER_BYTES, Zstandard::new(stored))))
        } else {
            Content::Plain(stored)
        }))
    }

    /// Whether the content is compressed.
    pub(crate) fn is_compressed(&self) -> bool {
        !matches!(self.0, Content::Plain(_))
    }

    /// Reads the stored bytes to their end, for their hash and number.
    pub(crate) fn finish(self) -> io::Result<Stamp> {
        let stored = match self.0 {
            Content::Plain(stored) => stored,
            Content::Gzip(decoded) => decoded.into_inner().into_inner(),
            Content::Bzip2(decoded) => decoded.into_inner().inner.into_inner(),
            Content::Zstandard(decoded) => decoded.into_inner().into_inner(),
        };
        let (_, mut tap) = stored.into_inner().into_inner();
        io::copy(&mut tap, &mut io::sink())?;
        Ok(Stamp { hasher: tap.hasher, bytes: tap.bytes })
    }
}

impl<R: Read> Read for Source<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match &mut self.0 {
            Content::Plain(content) => content.read(buffer),
            Content::Gzip(content) => content.read(buffer),
            Content::Bzip2(content) => content.read(buffer),
            Content::Zstandard(content) => content.read(buffer),
        }
    }
}

impl<R: Read> BufRead for Source<R> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        match &mut self.0 {
            Content::Plain(content) => content.fill_buf(),
            Content::Gzip(content) => content.fill_buf(),
            Content::Bzip2(content) => content.fill_buf(),
            Content::Zstandard(content) => content.fill_buf(),
        }
    }

    fn consume(&mut self, amount: usize) {
        match &mut self.0 {
            Content::Plain(content) => content.consume(amount),
            Content::Gzip(content) => content.consume(amount),
            Content::Bzip2(content) => content.consume(amount),
            Content::Zstandard(content) => content.consume(amount),
        }
    }
}

/// Whether an error of reading compressed content means that the stream is damaged, not that the file
/// can't be read.
pub(crate) fn is_damage(error: &io::Error) -> bool {
    use io::ErrorKind::{InvalidData, InvalidInput, Other, UnexpectedEof};
    matches!(error.kind(), InvalidData | InvalidInput | Other | UnexpectedEof)
}

/// A digest as hexadecimal digits.
pub(crate) fn hex(hasher: Sha256) -> String {
    hasher.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use super::*;

    fn gzip(content: &[u8]) -> Vec<u8> {
        let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
        encoder.write_all(content).unwrap();
        encoder.finish().unwrap()
    }

    fn bzip2(content: &[u8]) -> Vec<u8> {
        let mut encoder = bzip2::write::BzEncoder::new(Vec::new(), bzip2::Compression::fast());
        encoder.write_all(content).unwrap();
        encoder.finish().unwrap()
    }

    fn zstandard(content: &[u8]) -> Vec<u8> {
        ruzstd::encoding::compress_to_vec(content, ruzstd::encoding::CompressionLevel::Fastest)
    }

    #[test]
    fn plain_and_compressed_give_the_same_content() {
        let members = |pack: fn(&[u8]) -> Vec<u8>| [pack(b"one\n"), pack(b"two\n")].concat();
        let mut skipped = zstandard(b"one\n");
        skipped.extend([0x50, 0x2a, 0x4d, 0x18, 3, 0, 0, 0, 1, 2, 3]);
        skipped.extend(zstandard(b"two\n"));
        for stored in [b"one\ntwo\n".to_vec(), members(gzip), members(bzip2), members(zstandard), skipped] {
            let mut content = Vec::new();
            let mut source = Source::new(stored.as_slice()).unwrap();
            source.read_to_end(&mut content).unwrap();
            assert_eq!(content, b"one\ntwo\n");
            let stamp = source.finish().unwrap();
            assert_eq!(stamp.bytes, stored.len() as u64);
            assert_eq!(hex(stamp.hasher), hex(Sha256::new_with_prefix(&stored)));
        }
    }

    #[test]
    fn a_cut_stream_is_damage() {
        for pack in [gzip, bzip2, zstandard] {
            let stored = pack(&b"x".repeat(10_000));
            let mut source = Source::new(&stored[..stored.len() / 2]).unwrap();
            let error = source.read_to_end(&mut Vec::new()).unwrap_err();
            assert!(source.is_compressed() && is_damage(&error), "{error}");
            assert_eq!(source.finish().unwrap().bytes, stored.len() as u64 / 2);
        }
    }

    #[test]
    fn damage_is_told_again_whoever_reads_on() {
        for pack in [gzip, bzip2, zstandard] {
            let stored = pack(&(0..200_u8).collect::<Vec<u8>>());
            for at in 4..stored.len() {
                let mut damaged = stored.clone();
                damaged[at] ^= 0x55;
                let Ok(mut source) = Source::new(damaged.as_slice()) else { continue };
                let Err(error) = source.read_to_end(&mut Vec::new()) else { continue };
                assert!(is_damage(&error), "{error}");
                if matches!(source.0, Content::Bzip2(_)) {
                    assert_eq!(source.read(&mut [0; 8]).unwrap_err().to_string(), error.to_string());
                }
            }
        }
    }
}
