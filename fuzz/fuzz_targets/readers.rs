//! Every reader of clouds. The first byte chooses the format, the second the options, the rest is the file.
//!
//! ```sh
//! CHLADNI_WRITE_CORPUS=fuzz/corpus/readers cargo test --test hostile   # a corpus to begin with
//! cargo +nightly fuzz run readers
//! ```

#![no_main]

use chladni::cloud::NonFinite;
use chladni::cloud::reader::{Format, ReadOptions, read};
use libfuzzer_sys::fuzz_target;

fuzz_target!(init: {
    // the fuzzer's own hook ends the process on every panic, also on those of libraries that the readers catch and
    // turn into an error; those that nobody catches end it anyhow
    drop(std::panic::take_hook());
}, |bytes: &[u8]| {
    let [format, options, file @ ..] = bytes else { return };
    let format = Format::ALL[usize::from(*format) % Format::ALL.len()];
    let options = ReadOptions {
        policy: if options & 1 == 0 { NonFinite::Reject } else { NonFinite::Drop },
        dimension: Some(usize::from(options >> 1 & 15)).filter(|dimension| *dimension > 0),
        ..ReadOptions::default()
    };
    let _ = Format::sniff(file);
    if let Ok(cloud) = read(file, format, &options) {
        // A number takes two bytes of text at least, one of binary.
        assert!(cloud.coordinates().len() <= file.len());
    }
});
