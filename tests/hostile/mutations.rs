//! Valid files changed at random, the same way every time: what nobody thought of.

use rand::seq::IndexedRandom;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::files::{File, seeds};

/// Numbers at which counts and offsets overflow, or nearly so.
const EDGES: [u64; 12] = [
    0,
    1,
    0x7F,
    0x80,
    0xFF,
    0x7FFF,
    0xFFFF,
    0x7FFF_FFFF,
    0x8000_0000,
    0xFFFF_FFFF,
    i64::MAX as u64,
    u64::MAX,
];
/// The same as text, and what is not a number.
const WORDS: [&[u8]; 10] = [
    b"0",
    b"-1",
    b"65536",
    b"4294967295",
    b"18446744073709551616",
    b"1e308",
    b"nan",
    b"\n",
    b"\0",
    b"\xff\xfe",
];
/// Bytes that are moved at once, at most.
const RUN_MAX: usize = 64;

/// `count` files, from the seeds by turns.
pub(crate) fn mutated(count: usize) -> impl Iterator<Item = File> {
    let seeds = seeds();
    let mut random = ChaCha8Rng::seed_from_u64(7);
    (0..count).map(move |number| {
        let seed = &seeds[number % seeds.len()];
        let mut bytes = seed.bytes.clone();
        for _ in 0..random.random_range(1..8) {
            let donor = &seeds.choose(&mut random).unwrap().bytes;
            mutate(&mut bytes, donor, &mut random);
        }
        File { name: format!("{}, mutation {number}", seed.name), format: seed.format, bytes }
    })
}

fn mutate(bytes: &mut Vec<u8>, donor: &[u8], random: &mut ChaCha8Rng) {
    if bytes.is_empty() {
        return;
    }
    let place = random.random_range(0..bytes.len());
    let run = place..bytes.len().min(place + random.random_range(1..=RUN_MAX));
    match random.random_range(0..8) {
        0 => bytes[place] ^= 1 << random.random_range(0..8),
        1 => bytes[place] = random.random(),
        2 => {
            let edge = EDGES.choose(random).unwrap();
            let number = if random.random() { edge.to_le_bytes() } else { edge.to_be_bytes() };
            let width = [1, 2, 4, 8].choose(random).unwrap();
            let part = if number[0] == 0 { &number[8 - width..] } else { &number[..*width] };
            let end = bytes.len().min(place + part.len());
            bytes[place..end].copy_from_slice(&part[..end - place]);
        }
        3 => drop(bytes.drain(run)),
        4 => {
            let copy = bytes[run.clone()].to_vec();
            bytes.splice(place..place, copy);
        }
        5 => {
            let word = WORDS.choose(random).unwrap();
            let digits = bytes[place..].iter().take_while(|byte| byte.is_ascii_digit()).count();
            bytes.splice(place..place + digits, word.iter().copied());
        }
        6 => {
            let from = random.random_range(0..donor.len());
            let length = random.random_range(0..=RUN_MAX.min(donor.len() - from));
            bytes.splice(place..place, donor[from..from + length].iter().copied());
        }
        _ => bytes.truncate(place),
    }
}
