//! Streams of packed bits become numbers, each stream at its own pace [ASTM E2807, §6.3.3].

use e57::RecordDataType;

/// How the values of an attribute are packed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Packing {
    Single,
    Double,
    /// A number of bits above a minimum; the value is the sum times the scale, plus the offset.
    Integer {
        bits: u32,
        minimum: i64,
        scale: f64,
        offset: f64,
    },
}

impl Packing {
    pub(super) fn of(data: &RecordDataType) -> Self {
        let bits = |min: i64, max: i64| {
            let range = (i128::from(max) - i128::from(min)).unsigned_abs();
            range.checked_ilog2().map_or(0, |highest| highest + 1)
        };
        match *data {
            RecordDataType::Single { .. } => Self::Single,
            RecordDataType::Double { .. } => Self::Double,
            RecordDataType::Integer { min, max } => {
                Self::Integer { bits: bits(min, max), minimum: min, scale: 1.0, offset: 0.0 }
            }
            RecordDataType::ScaledInteger { min, max, scale, offset } => {
                Self::Integer { bits: bits(min, max), minimum: min, scale, offset }
            }
        }
    }

    /// Bits of a value; 0 for constants, which are not stored.
    pub(super) fn bits(self) -> u32 {
        match self {
            Self::Single => 32,
            Self::Double => 64,
            Self::Integer { bits, .. } => bits,
        }
    }

    /// Bytes of a value that is not packed.
    pub(super) fn unpacked_bytes(self) -> usize {
        match self.bits() {
            0 => 0,
            bits => (bits.div_ceil(8) as usize).next_power_of_two(),
        }
    }

    fn value(self, raw: u64) -> f64 {
        match self {
            Self::Single => f64::from(f32::from_bits(raw as u32)),
            Self::Double => f64::from_bits(raw),
            Self::Integer { minimum, scale, offset, .. } => {
                minimum.wrapping_add(raw.cast_signed()) as f64 * scale + offset
            }
        }
    }
}

/// The stream of an attribute: bits that are not yet a value wait for the next packet.
#[derive(Debug)]
pub(super) struct Stream {
    packing: Packing,
    /// Whole bytes of which all but the first bits are waiting, and eight more, so that a number can be read anywhere.
    waiting: Vec<u8>,
    /// Bits of the first byte that are taken.
    taken: usize,
    /// Values so far.
    pub(super) values: usize,
    /// Values in all.
    wanted: usize,
}

impl Stream {
    pub(super) fn new(packing: Packing, wanted: usize) -> Self {
        Self { packing, waiting: Vec::new(), taken: 0, values: 0, wanted }
    }

    pub(super) fn is_complete(&self) -> bool {
        self.values >= self.wanted
    }

    /// Takes the bytes of a packet, and hands every value to `put` with its place.
    pub(super) fn take(&mut self, bytes: &[u8], mut put: impl FnMut(usize, f64)) {
        let bits = self.packing.bits() as usize;
        if bits == 0 || self.is_complete() {
            return;
        }
        self.waiting.extend_from_slice(bytes);
        let there = 8 * self.waiting.len();
        self.waiting.extend([0; 9]);
        let count = ((there - self.taken) / bits).min(self.wanted - self.values);
        let mask = if bits == 64 { u64::MAX } else { (1 << bits) - 1 };
        let mut at = self.taken;
        let (packing, first) = (self.packing, self.values);
        for index in 0..count {
            let (byte, shift) = (at / 8, at % 8);
            let low = self.waiting[byte..].first_chunk().map_or(0, |bytes| u64::from_le_bytes(*bytes));
            let mut raw = low >> shift;
            if shift + bits > 64 {
                raw |= u64::from(self.waiting[byte + 8]) << (64 - shift);
            }
            put(first + index, packing.value(raw & mask));
            at += bits;
        }
        self.values += count;
        self.waiting.truncate(there / 8);
        self.waiting.drain(..at / 8);
        self.taken = at % 8;
    }

    /// Hands the value of a constant to `put` for every point.
    pub(super) fn repeat(&mut self, mut put: impl FnMut(usize, f64)) {
        let value = self.packing.value(0);
        (self.values..self.wanted).for_each(|place| put(place, value));
        self.values = self.wanted;
    }
}

#[cfg(test)]
#[allow(clippy::float_cmp)] // integers
mod tests {
    use super::*;

    /// Numbers of a fixed number of bits, one behind the other.
    fn packed(numbers: &[u64], bits: usize) -> Vec<u8> {
        let mut bytes = vec![0_u8; (numbers.len() * bits).div_ceil(8)];
        for (index, number) in numbers.iter().enumerate() {
            for bit in (0..bits).filter(|bit| number >> bit & 1 == 1) {
                bytes[(index * bits + bit) / 8] |= 1 << ((index * bits + bit) % 8);
            }
        }
        bytes
    }

    #[test]
    fn numbers_of_every_width_are_unpacked_across_packets_of_any_length() {
        for bits in 1..=64_u32 {
            let mask = if bits == 64 { u64::MAX } else { (1 << bits) - 1 };
            let numbers: Vec<u64> =
                (1..200_u64).map(|i| i.wrapping_mul(0x9E37_79B9_7F4A_7C15) & mask).collect();
            let bytes = packed(&numbers, bits as usize);
            for piece in [1, 3, 8, 1000] {
                let packing = Packing::Integer { bits, minimum: 0, scale: 1.0, offset: 0.0 };
                let mut stream = Stream::new(packing, numbers.len());
                let mut found = vec![f64::NAN; numbers.len()];
                bytes.chunks(piece).for_each(|bytes| stream.take(bytes, |place, value| found[place] = value));
                assert!(stream.is_complete());
                let expected: Vec<f64> = numbers.iter().map(|&number| number.cast_signed() as f64).collect();
                assert_eq!(found, expected, "{bits} bits, {piece} bytes");
            }
        }
    }

    #[test]
    fn a_constant_is_its_minimum() {
        let packing = Packing::Integer { bits: 0, minimum: 7, scale: 0.5, offset: 1.0 };
        let mut found = Vec::new();
        Stream::new(packing, 2).repeat(|_, value| found.push(value));
        assert_eq!(found, [4.5, 4.5]);
    }
}
