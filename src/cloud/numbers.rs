//! The numbers of a cloud, which may be gigabytes.
//!
//! What is filled once and kept is mostly the system's time: memory comes from it a page at a time. So many numbers lie in
//! memory of their own, for which the system is asked for large pages (2 million points of three doubles and three colors are
//! read in 0.040 s with pages of 4 kB, in 0.020 s with those of 2 MB). Linux gives them where it has them, and pages of the
//! usual size elsewhere.

use std::fmt;
use std::ops::{Deref, DerefMut};
use std::sync::atomic::{AtomicUsize, Ordering};

use memmap2::MmapMut;

/// Bytes from which on numbers lie in memory of their own, and of a large page.
const MANY_BYTES: usize = 4 << 20;
const PAGE_BYTES: usize = 2 << 20;

/// A list of numbers that is as long as it was made.
pub struct Numbers(Memory);

enum Memory {
    Few(Vec<f64>),
    Many(Own),
}

/// Memory of its own, zeroed.
struct Own {
    /// As long as whole large pages: from Linux 6.7 on it begins where one begins.
    memory: MmapMut,
    length: usize,
}

/// Bytes of such memory that the process has, which no allocator counts, and the most that it had.
static MAPPED: AtomicUsize = AtomicUsize::new(0);
static MOST_MAPPED: AtomicUsize = AtomicUsize::new(0);

/// The most bytes of memory outside of the allocator that the numbers of clouds had since the last call, for tests that count
/// what readers take.
#[allow(clippy::must_use_candidate)] // a call may only begin to count
pub fn take_most_mapped() -> usize {
    MOST_MAPPED.swap(MAPPED.load(Ordering::Relaxed), Ordering::Relaxed)
}

impl Own {
    fn new(length: usize) -> Option<Self> {
        let bytes = length.checked_mul(size_of::<f64>()).filter(|&bytes| bytes >= MANY_BYTES)?;
        let memory = MmapMut::map_anon(bytes.checked_next_multiple_of(PAGE_BYTES)?).ok()?;
        // A wish, which not every system knows. The rest behind the last whole page is not to take one.
        #[cfg(target_os = "linux")]
        {
            use memmap2::Advice::{HugePage, NoHugePage};
            let (whole, all) = (bytes - bytes % PAGE_BYTES, memory.len());
            let _ = memory.advise_range(HugePage, 0, whole);
            let _ = memory.advise_range(NoHugePage, whole, all - whole);
        }
        let mapped = MAPPED.fetch_add(memory.len(), Ordering::Relaxed) + memory.len();
        MOST_MAPPED.fetch_max(mapped, Ordering::Relaxed);
        Some(Self { memory, length })
    }
}

impl Drop for Own {
    fn drop(&mut self) {
        MAPPED.fetch_sub(self.memory.len(), Ordering::Relaxed);
    }
}

impl Numbers {
    /// So many zeros.
    #[must_use]
    pub fn zeros(length: usize) -> Self {
        Self(Own::new(length).map_or_else(|| Memory::Few(vec![0.0; length]), Memory::Many))
    }

    /// The same numbers as a list that can grow.
    pub(super) fn growing(&mut self) -> &mut Vec<f64> {
        if let Memory::Many(_) = self.0 {
            self.0 = Memory::Few(self.to_vec());
        }
        match &mut self.0 {
            Memory::Few(numbers) => numbers,
            Memory::Many(_) => unreachable!("it was made a list"),
        }
    }
}

impl Deref for Numbers {
    type Target = [f64];

    fn deref(&self) -> &[f64] {
        match &self.0 {
            Memory::Few(numbers) => numbers,
            Memory::Many(Own { memory, length }) => &bytemuck::cast_slice(memory)[..*length],
        }
    }
}

impl DerefMut for Numbers {
    fn deref_mut(&mut self) -> &mut [f64] {
        match &mut self.0 {
            Memory::Few(numbers) => numbers,
            Memory::Many(Own { memory, length }) => &mut bytemuck::cast_slice_mut(memory)[..*length],
        }
    }
}

impl Default for Numbers {
    fn default() -> Self {
        Vec::new().into()
    }
}

impl From<Vec<f64>> for Numbers {
    fn from(numbers: Vec<f64>) -> Self {
        Self(Memory::Few(numbers))
    }
}

impl FromIterator<f64> for Numbers {
    fn from_iter<I: IntoIterator<Item = f64>>(numbers: I) -> Self {
        Vec::from_iter(numbers).into()
    }
}

impl Clone for Numbers {
    fn clone(&self) -> Self {
        match &self.0 {
            Memory::Few(numbers) => numbers.clone().into(),
            Memory::Many(_) => {
                let mut copy = Self::zeros(self.len());
                copy.copy_from_slice(self);
                copy
            }
        }
    }
}

impl PartialEq for Numbers {
    fn eq(&self, other: &Self) -> bool {
        **self == **other
    }
}

impl<const N: usize> PartialEq<[f64; N]> for Numbers {
    fn eq(&self, other: &[f64; N]) -> bool {
        **self == *other
    }
}

impl fmt::Debug for Numbers {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries(self.iter()).finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn many_numbers_are_what_a_list_of_them_is() {
        for length in [0, 3, MANY_BYTES / 8 - 1, MANY_BYTES / 8, MANY_BYTES / 8 + 5] {
            let mut numbers = Numbers::zeros(length);
            assert_eq!(matches!(numbers.0, Memory::Many(_)), 8 * length >= MANY_BYTES, "{length}");
            assert!(numbers.len() == length && numbers.iter().all(|x| x.to_bits() == 0));
            numbers.iter_mut().enumerate().for_each(|(i, x)| *x = i as f64);
            let copy = numbers.clone();
            numbers.growing().push(-1.0);
            assert!(numbers.len() == length + 1 && numbers[..length] == *copy && numbers != copy);
            assert_eq!(copy, (0..length).map(|i| i as f64).collect::<Numbers>());
        }
    }
}
