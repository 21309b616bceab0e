//! Command line of chladni.

/// Gives memory back to the system some seconds after a burst; that of the C library keeps most of it for the rest of the
/// process (docs/operation.md has the figures).
#[global_allocator]
static ALLOCATOR: tikv_jemallocator::Jemalloc = tikv_jemallocator::Jemalloc;

fn main() -> std::process::ExitCode {
    chladni::cli::main()
}
