//! Compressed request bodies (`Content-Encoding`), decompressed within bounds of size and ratio.

use std::io::{self, Cursor, Read};

use axum::body::Bytes;
use axum::http::{HeaderMap, header};
use flate2::read::MultiGzDecoder;
use ruzstd::decoding::{FrameDecoder, StreamingDecoder};

use super::problem::{Kind, Problem};

/// Every decoder of zstd in HTTP must manage windows of this size, and none need manage larger ones (RFC 9659 §3): what
/// a frame announces is allocated before its content is there.
const WINDOW_BYTES_MAX: u64 = 8 << 20;

/// Up to this size the ratio does not count: a small file of equal lines is not a bomb.
const RATIO_FREE_BYTES: u64 = 1 << 20;

/// What is accepted, as `Accept-Encoding` says it.
const ACCEPTED: &str = "gzip, zstd";

/// A compression of request bodies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Coding {
    /// RFC 1952.
    Gzip,
    /// RFC 8878.
    Zstd,
}

/// How much may come out of a compressed body.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bounds {
    /// Bytes.
    pub bytes_max: u64,
    /// Times as much as went in.
    pub ratio_max: u64,
}

impl Coding {
    /// What the headers say; `None` for a body as it is.
    ///
    /// # Errors
    /// A problem that names what is accepted.
    pub(crate) fn of(headers: &HeaderMap) -> Result<Option<Self>, Problem> {
        let named: Vec<_> = headers
            .get_all(header::CONTENT_ENCODING)
            .iter()
            .flat_map(|value| value.to_str().unwrap_or("?").split(','))
            .map(|name| name.trim().to_ascii_lowercase())
            .filter(|name| !name.is_empty() && name != "identity")
            .collect();
        match named.iter().map(String::as_str).collect::<Vec<_>>().as_slice() {
            [] => Ok(None),
            ["gzip" | "x-gzip"] => Ok(Some(Self::Gzip)),
            ["zstd"] => Ok(Some(Self::Zstd)),
            _ => Err(Problem::new(
                Kind::UnsupportedEncoding,
                format!("the body cannot be decompressed; accepted is one Content-Encoding of {ACCEPTED}"),
            )
            .with("accepted", vec!["gzip", "zstd"])
            .with_header(header::ACCEPT_ENCODING, ACCEPTED)),
        }
    }

    /// What `bytes` hold, to be decoded piece by piece.
    pub(crate) fn decoder(self, bytes: Bytes, bounds: Bounds) -> Decoder {
        let by_ratio = (bytes.len() as u64).saturating_mul(bounds.ratio_max).max(RATIO_FREE_BYTES);
        let limit = bounds.bytes_max.min(by_ratio);
        let source = match self {
            Self::Gzip => Source::Gzip(Box::new(MultiGzDecoder::new(Cursor::new(bytes)))),
            Self::Zstd => Source::BetweenFrames(Cursor::new(bytes)),
        };
        Decoder { source, bounds, limit, decoded: Vec::new() }
    }
}

/// A compressed body on its way out.
pub(crate) struct Decoder {
    source: Source,
    bounds: Bounds,
    limit: u64,
    decoded: Vec<u8>,
}

enum Source {
    Gzip(Box<MultiGzDecoder<Cursor<Bytes>>>),
    Zstd(Box<StreamingDecoder<Cursor<Bytes>, FrameDecoder>>),
    /// Parallel compressors write several frames of zstd, one after the other.
    BetweenFrames(Cursor<Bytes>),
}

impl Decoder {
    /// Bytes that came out so far.
    pub(crate) fn decoded(&self) -> u64 {
        self.decoded.len() as u64
    }

    /// What came out.
    pub(crate) fn into_bytes(self) -> Vec<u8> {
        self.decoded
    }

    /// Decodes about `piece` bytes more, and tells whether that was all.
    ///
    /// # Errors
    /// A problem: damaged, cut off, or over the bounds.
    pub(crate) fn decode(&mut self, piece: usize) -> Result<bool, Problem> {
        let piece = (piece as u64).min(self.limit.saturating_add(1) - self.decoded());
        let read = self.source.read(piece, &mut self.decoded);
        if self.decoded() > self.limit {
            return Err(self.bounds.crossed(self.limit));
        }
        read.map_err(|error| {
            Problem::new(
                Kind::MalformedRequest,
                format!("the body does not match its Content-Encoding or is incomplete: {error}"),
            )
        })
    }
}

impl Source {
    /// Appends `piece` bytes at most, fewer at the end of a frame; whether that was all.
    fn read(&mut self, piece: u64, decoded: &mut Vec<u8>) -> io::Result<bool> {
        match self {
            Self::Gzip(gzip) => Ok((gzip.take(piece).read_to_end(decoded)? as u64) < piece),
            Self::Zstd(frame) => {
                if (frame.take(piece).read_to_end(decoded)? as u64) < piece {
                    self.end_frame()?;
                }
                Ok(false)
            }
            Self::BetweenFrames(bytes) => {
                if bytes.position() >= bytes.get_ref().len() as u64 {
                    return Ok(true);
                }
                let bytes = std::mem::take(bytes);
                let frame = StreamingDecoder::new_with_max_window_size(bytes, WINDOW_BYTES_MAX);
                *self = Self::Zstd(Box::new(frame.map_err(io::Error::other)?));
                Ok(false)
            }
        }
    }

    fn end_frame(&mut self) -> io::Result<()> {
        let Self::Zstd(frame) = std::mem::replace(self, Self::BetweenFrames(Cursor::default())) else {
            return Ok(());
        };
        let announced = frame.decoder.get_checksum_from_data();
        if announced.is_some() && announced != frame.decoder.get_calculated_checksum() {
            return Err(io::Error::other("its checksum does not hold"));
        }
        *self = Self::BetweenFrames(frame.into_inner());
        Ok(())
    }
}

impl Bounds {
    fn crossed(self, limit: u64) -> Problem {
        let why = if limit == self.bytes_max {
            format!("the body decompresses to more than {limit} bytes, the limit of this service")
        } else {
            format!("the body decompresses to more than {} times its size; send it as it is", self.ratio_max)
        };
        Problem::new(Kind::TooLarge, why).with("limit", limit)
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use axum::http::HeaderValue;
    use flate2::Compression;
    use flate2::write::GzEncoder;
    use ruzstd::encoding::{CompressionLevel, compress_to_vec};

    use super::*;

    const BOUNDS: Bounds = Bounds { bytes_max: 4 << 20, ratio_max: 20 };

    fn gzip(bytes: &[u8]) -> Vec<u8> {
        let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
        encoder.write_all(bytes).unwrap();
        encoder.finish().unwrap()
    }

    fn zstd(bytes: &[u8]) -> Vec<u8> {
        compress_to_vec(bytes, CompressionLevel::Fastest)
    }

    /// Numbers that compress to about a third.
    fn scan() -> Vec<u8> {
        (0..20_000)
            .flat_map(|i| format!("{} {} 1\n", i * 7919 % 10_007, i * 104_729 % 7_919).into_bytes())
            .collect()
    }

    fn decode(coding: Coding, bytes: &[u8], bounds: Bounds) -> Result<Vec<u8>, Problem> {
        let mut decoder = coding.decoder(Bytes::copy_from_slice(bytes), bounds);
        while !decoder.decode(10_000)? {}
        Ok(decoder.into_bytes())
    }

    #[test]
    fn what_was_compressed_comes_back_in_one_part_or_several() {
        let halves = scan();
        let (first, second) = halves.split_at(halves.len() / 2);
        for (coding, compress) in [(Coding::Gzip, gzip as fn(&[u8]) -> Vec<u8>), (Coding::Zstd, zstd)] {
            assert_eq!(decode(coding, &compress(&halves), BOUNDS).unwrap(), halves);
            let parts = [compress(first), compress(second)].concat();
            assert_eq!(decode(coding, &parts, BOUNDS).unwrap(), halves);
        }
    }

    #[test]
    fn more_than_the_bytes_allowed_is_refused() {
        let bounds = Bounds { bytes_max: 1000, ratio_max: u64::MAX };
        for (coding, compressed) in [(Coding::Gzip, gzip(&scan())), (Coding::Zstd, zstd(&scan()))] {
            let refused = decode(coding, &compressed, bounds).unwrap_err();
            assert_eq!(refused.kind(), Kind::TooLarge, "{coding:?}");
        }
    }

    #[test]
    fn a_bomb_is_refused_by_its_ratio() {
        let bomb = vec![b'0'; 3 << 20];
        for (coding, compressed) in [(Coding::Gzip, gzip(&bomb)), (Coding::Zstd, zstd(&bomb))] {
            assert!(compressed.len() < 10_000);
            assert_eq!(decode(coding, &compressed, BOUNDS).unwrap_err().kind(), Kind::TooLarge, "{coding:?}");
        }
        let small = vec![b'0'; RATIO_FREE_BYTES as usize];
        assert_eq!(decode(Coding::Gzip, &gzip(&small), BOUNDS).unwrap(), small);
    }

    #[test]
    fn what_is_damaged_or_cut_off_is_refused() {
        for (coding, compressed) in [(Coding::Gzip, gzip(&scan())), (Coding::Zstd, zstd(&scan()))] {
            for bytes in [&compressed[..compressed.len() / 2], b"neither", &compressed[1..]] {
                let refused = decode(coding, bytes, BOUNDS).unwrap_err();
                assert_eq!(refused.kind(), Kind::MalformedRequest, "{coding:?}");
            }
        }
    }

    #[test]
    fn a_window_larger_than_http_allows_is_refused_before_it_is_allocated() {
        // Magic number, a descriptor without content size, a window of 2^(10 + 21) bytes, an empty last block.
        let frame = [0x28, 0xb5, 0x2f, 0xfd, 0x00, 21 << 3, 0x01, 0x00, 0x00];
        assert_eq!(decode(Coding::Zstd, &frame, BOUNDS).unwrap_err().kind(), Kind::MalformedRequest);
    }

    #[test]
    fn one_known_encoding_is_understood_and_no_other() {
        let of = |value| {
            Coding::of(&HeaderMap::from_iter([(header::CONTENT_ENCODING, HeaderValue::from_static(value))]))
        };
        assert_eq!(of("gzip").unwrap(), Some(Coding::Gzip));
        assert_eq!(of("ZSTD").unwrap(), Some(Coding::Zstd));
        assert_eq!(of("identity").unwrap(), None);
        assert_eq!(Coding::of(&HeaderMap::new()).unwrap(), None);
        for unknown in ["br", "gzip, zstd", "deflate"] {
            assert_eq!(of(unknown).unwrap_err().kind(), Kind::UnsupportedEncoding, "{unknown}");
        }
    }
}
