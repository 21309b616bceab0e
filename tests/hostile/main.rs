//! Files that mean harm, read by every reader: none panics, and none takes more memory than four times the file and
//! 64 MiB. A binary of its own, because it counts what is allocated.
//!
//! `CHLADNI_WRITE_CORPUS=fuzz/corpus/readers` writes them out for the fuzzer; `CHLADNI_MUTATIONS=1000000` changes as many
//! files at random.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

mod files;
mod mutations;
mod scans;

use std::panic::{AssertUnwindSafe, catch_unwind};

use chladni::cloud::reader::{Format, ReadOptions, read, read_columns, unpacked_bytes};
use chladni::cloud::{NonFinite, Numbers, take_most_mapped};
use peak_alloc::PeakAlloc;
use sha2::{Digest, Sha256};
use uuid::Uuid;

use files::{File, hostile_files, large_files, seeds};
use mutations::mutated;
use scans::large_scans;

#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

const BESIDES_BYTES: usize = 64 << 20;

/// Bytes that `work` takes at most, of the allocator and of the system, beyond what there was; `None` when it panics.
fn peak_of(work: impl FnOnce()) -> Option<usize> {
    MEMORY.reset_peak_usage();
    take_most_mapped();
    let mapped_before = take_most_mapped();
    let before = MEMORY.current_usage();
    catch_unwind(AssertUnwindSafe(work)).ok()?;
    let mapped = take_most_mapped().saturating_sub(mapped_before);
    Some(MEMORY.peak_usage().saturating_sub(before) + mapped)
}

fn options() -> impl Iterator<Item = ReadOptions> {
    let policies = [NonFinite::Reject, NonFinite::Drop].into_iter();
    policies.flat_map(|policy| {
        [None, Some(2), Some(8)].map(|dimension| ReadOptions { policy, dimension, ..ReadOptions::default() })
    })
}

/// Reads the file in every way, and tells what went wrong.
fn faults(file: &File, ways: impl Iterator<Item = ReadOptions>) -> Vec<String> {
    // What is packed counts unpacked.
    let allowed = 4 * unpacked_bytes(&file.bytes) + BESIDES_BYTES;
    let mut faults = Vec::new();
    let mut judge = |reader: &str, peak: Option<usize>| match peak {
        None => faults.push(format!("{reader} panics on {}", file.name)),
        Some(peak) if peak > allowed => {
            faults.push(format!("{reader} takes {peak} bytes for {} of {}", file.name, file.bytes.len()));
        }
        Some(_) => {}
    };
    for options in ways {
        // Whatever the file says it is: a client may call it anything.
        let formats: Vec<_> = match file.format {
            Some(format) => vec![format],
            None => Format::ALL.to_vec(),
        };
        for format in formats {
            let peak = peak_of(|| {
                let _ = Format::sniff(&file.bytes);
                let _ = read(&file.bytes, format, &options);
            });
            judge(format.name(), peak);
        }
    }
    judge("the reader of columns", peak_of(|| drop(read_columns(&file.bytes))));
    faults
}

/// One test, because what runs beside it would be counted too.
#[test]
fn no_file_makes_a_reader_panic_or_take_more_memory_than_it_may() {
    for seed in seeds() {
        let format = seed.format.unwrap();
        assert!(
            read(&seed.bytes, format, &ReadOptions::default()).is_ok(),
            "{} is not a file to begin with",
            seed.name
        );
    }
    assert!(
        Format::ALL.iter().all(|format| seeds().iter().any(|seed| seed.format == Some(*format))),
        "every format has a seed"
    );
    // A thing that is counted is seen.
    assert!(peak_of(|| drop(vec![1_u8; 10 << 20])).unwrap() >= 10 << 20);
    assert!(peak_of(|| drop(Numbers::zeros(10 << 20))).unwrap() >= 80 << 20);
    assert!(peak_of(|| panic!("on purpose")).is_none());

    let mut found = Vec::new();
    let small = hostile_files();
    for file in &small {
        found.extend(faults(file, options()));
    }
    let mut most: (f64, String) = (0.0, String::new());
    for make in large_files().into_iter().chain(large_scans()) {
        let file = make();
        let format = file.format.unwrap();
        let options = ReadOptions { policy: NonFinite::Drop, ..ReadOptions::default() };
        let peak = peak_of(|| drop(read(&file.bytes, format, &options))).unwrap_or(usize::MAX);
        let times = peak as f64 / file.bytes.len() as f64;
        if times > most.0 {
            most = (times, file.name.clone());
        }
        found.extend(faults(&file, std::iter::once(options)));
    }
    let mutations = std::env::var("CHLADNI_MUTATIONS").map_or(6_000, |count| count.parse().unwrap());
    let mut read_in_spite = 0;
    for (number, file) in mutated(mutations).enumerate() {
        let options = options().nth(number % 6).unwrap();
        found.extend(faults(&file, std::iter::once(options)));
        read_in_spite += usize::from(read(&file.bytes, file.format.unwrap(), &options).is_ok());
    }
    assert!(
        read_in_spite > mutations / 50,
        "{read_in_spite} of {mutations}: the damage is too great to reach far"
    );
    println!("{mutations} mutations, {read_in_spite} of them still files");
    println!(
        "{} small files; of the large, {} takes most: {:.1} times its size",
        small.len(),
        most.1,
        most.0
    );
    assert!(found.is_empty(), "{} faults:\n{}", found.len(), found.join("\n"));
    if let Some(folder) = std::env::var_os("CHLADNI_WRITE_CORPUS") {
        write_corpus(&small, std::path::Path::new(&folder));
    }
}

/// As the fuzz target `readers` takes them: the format's place, options, the file.
fn write_corpus(files: &[File], folder: &std::path::Path) {
    std::fs::create_dir_all(folder).unwrap();
    for file in files {
        let place = Format::ALL.iter().position(|format| file.format == Some(*format)).unwrap_or(0);
        let bytes = [&[place as u8, 1], file.bytes.as_slice()].concat();
        let digest = Uuid::from_slice(&Sha256::digest(&bytes)[..16]).unwrap();
        std::fs::write(folder.join(digest.simple().to_string()), bytes).unwrap();
    }
}
