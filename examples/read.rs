//! How fast clouds are read: `cargo run --release --example read FILE...` reads each five times from memory and prints the
//! best.

#![allow(clippy::print_stdout)] // that is what it is for

use std::path::Path;
use std::time::Instant;

use chladni::cloud::NonFinite;
use chladni::cloud::reader::{Format, Limits, ReadOptions, read};

const ROUNDS: usize = 5;

/// That of the service: how fast memory is had is a large part of the time.
#[global_allocator]
static ALLOCATOR: tikv_jemallocator::Jemalloc = tikv_jemallocator::Jemalloc;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let limits = Limits { points_max: u32::MAX as usize, faces_max: u32::MAX as usize, ..Limits::default() };
    let options = ReadOptions { limits, policy: NonFinite::Drop, ..ReadOptions::default() };
    for name in std::env::args().skip(1) {
        let bytes = std::fs::read(&name)?;
        let format = Format::of_file(Path::new(&name).file_name().and_then(|name| name.to_str()), &bytes)
            .ok_or("the format cannot be told from name and content")?;
        let mut best = f64::INFINITY;
        let mut points = 0;
        for _ in 0..ROUNDS {
            let began = Instant::now();
            points = read(&bytes, format, &options)?.len();
            best = best.min(began.elapsed().as_secs_f64());
        }
        let megabytes = bytes.len() as f64 / 1e6;
        println!("{name}\t{points} points\t{megabytes:.0} MB\t{best:.3} s\t{:.0} MB/s", megabytes / best);
    }
    Ok(())
}
