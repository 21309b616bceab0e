//! The frame of a LAS file, as bytes: what stands around its points comes back as it was.

use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Header and records of a LAS file, each byte for byte.
///
/// The records that describe how the points are packed (`LASzip`) or indexed are not among them: they are wrong for a
/// file that is written anew.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Survey {
    /// The public header block, as long as it says.
    pub header: Bytes,
    /// Records of variable length, each with its head of 54 bytes.
    pub records: Vec<Bytes>,
    /// Extended records of variable length, each with its head of 60 bytes.
    pub extended: Vec<Bytes>,
}

/// Bytes that stand as hexadecimal digits in JSON.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Bytes(pub Vec<u8>);

impl Serialize for Bytes {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        use std::fmt::Write;
        let mut text = String::with_capacity(2 * self.0.len());
        for byte in &self.0 {
            // Writing to a string cannot fail.
            let _ = write!(text, "{byte:02x}");
        }
        serializer.serialize_str(&text)
    }
}

impl<'de> Deserialize<'de> for Bytes {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = String::deserialize(deserializer)?;
        let digit =
            |pair: &[u8]| std::str::from_utf8(pair).ok().and_then(|pair| u8::from_str_radix(pair, 16).ok());
        let bytes: Option<Vec<u8>> = text.as_bytes().chunks(2).map(digit).collect();
        bytes.map(Self).ok_or_else(|| serde::de::Error::custom("not pairs of hexadecimal digits"))
    }
}
