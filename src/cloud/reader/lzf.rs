//! LZF, the compression of Marc Lehmann's `liblzf` that PCD uses.
//!
//! Written here: the crate `lzf` allocates the announced length before it looks at a byte, and has `unsafe` in it.
//! A control byte below 32 announces as many literal bytes and one more; any other begins a reference back: three
//! bits of length (7: another byte follows), 13 bits of distance.

/// Unpacks to exactly `length` bytes; `None` when the data says otherwise. Memory grows with what is unpacked.
pub(super) fn unpack(packed: &[u8], length: usize) -> Option<Vec<u8>> {
    let mut out: Vec<u8> = Vec::new();
    let mut rest = packed;
    while let Some((&control, after)) = rest.split_first() {
        let control = usize::from(control);
        if control < 32 {
            let (literal, after) = after.split_at_checked(control + 1)?;
            out.extend_from_slice(literal);
            rest = after;
        } else {
            let (more, after) = if control >> 5 == 7 { after.split_first()? } else { (&0, after) };
            let (&low, after) = after.split_first()?;
            let distance = ((control & 31) << 8 | usize::from(low)) + 1;
            let copied = (control >> 5) + usize::from(*more) + 2;
            let start = out.len().checked_sub(distance)?;
            // Source and destination may overlap: that is how runs are written.
            for at in start..start + copied {
                out.push(out[at]);
            }
            rest = after;
        }
        if out.len() > length {
            return None;
        }
    }
    (out.len() == length).then_some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn literals_references_and_runs_are_unpacked() {
        assert_eq!(unpack(&[2, b'a', b'b', b'c'], 3).unwrap(), b"abc");
        // "abc", then 3 bytes from 3 back
        assert_eq!(unpack(&[2, b'a', b'b', b'c', 1 << 5, 2], 6).unwrap(), b"abcabc");
        // A test of the crate lzf, from Redis: 97 repeated 200 times.
        let run = unpack(&[1, 97, 97, 224, 187, 0, 1, 97, 97], 200).unwrap();
        assert_eq!(run, [97; 200]);
    }

    #[test]
    fn what_contradicts_itself_is_refused() {
        assert_eq!(unpack(&[2, b'a'], 3), None, "literals missing");
        assert_eq!(unpack(&[0, b'a', 1 << 5], 4), None, "distance missing");
        assert_eq!(unpack(&[0, b'a', 1 << 5, 1], 4), None, "before the beginning");
        assert_eq!(unpack(&[0, b'a'], 2), None, "shorter than announced");
        assert_eq!(unpack(&[1, b'a', b'a', 224, 187, 0], 10), None, "longer than announced");
        assert_eq!(unpack(&[], 0).unwrap(), b"");
    }
}
