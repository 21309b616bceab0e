//! A space-filling curve: points that follow each other on it are near each other (Morton 1966).

/// Place on the curve: interleaves the leading `63 / d` bits of the coordinates' places in the bounding cube, most significant first.
pub(super) fn key(coordinates: impl Iterator<Item = f64>, extent: f64, d: usize) -> u64 {
    let bits = 63 / d;
    let cells = (1_u64 << bits) as f64;
    let mut key = 0;
    for (axis, x) in coordinates.enumerate() {
        let place = if extent > 0.0 { x / extent + 0.5 } else { 0.0 };
        let cell = ((place * cells) as u64).min((1 << bits) - 1);
        for bit in 0..bits {
            key |= (cell >> bit & 1) << (bit * d + axis);
        }
    }
    key
}
