//! Crates that may panic on broken files: what they stumble over is the file's fault, told as such and no other way.

use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::sync::Once;

use super::{Format, ReadError};

thread_local! {
    static IS_GUARDED: Cell<bool> = const { Cell::new(false) };
}

/// Runs a reader of a crate that may panic on broken files. The panic prints nothing.
pub(super) fn guarded<T>(
    format: Format,
    read: impl FnOnce() -> Result<T, ReadError>,
) -> Result<T, ReadError> {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let others = take_hook();
        set_hook(Box::new(move |panic| {
            if !IS_GUARDED.get() {
                others(panic);
            }
        }));
    });
    let before = IS_GUARDED.replace(true);
    let result = catch_unwind(AssertUnwindSafe(read));
    IS_GUARDED.set(before);
    result
        .unwrap_or_else(|_| Err(ReadError::byte(format, 0, "the file contradicts itself and cannot be read")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_within_is_a_refusal_and_one_outside_is_a_panic() {
        let refused: Result<(), _> = guarded(Format::Laz, || panic!("on purpose"));
        assert!(refused.unwrap_err().to_string().contains("contradicts itself"));
        assert!(!IS_GUARDED.get());
        assert_eq!(guarded(Format::Laz, || Ok(7)), Ok(7));
    }
}
