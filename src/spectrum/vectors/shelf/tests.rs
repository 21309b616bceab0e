//! The same vectors in memory and in a file.

use super::*;
use crate::progress::Canceled;

const GROUPS: Groups = Groups { first: 2, width: 3 };
const ROWS: usize = 2 * TILE_ROWS + 100;

fn entry(i: usize, j: usize) -> f32 {
    (i * 31 + j * 17) as f32
}

/// The same nine columns in memory and in a file.
fn shelves() -> [Shelf; 2] {
    let file = tempfile::tempfile().unwrap();
    let mut shelves = [Shelf::in_memory(ROWS, 9, GROUPS), Shelf::in_file(file, ROWS, 9, GROUPS)];
    for shelf in &mut shelves {
        assert_eq!(shelf.groups(), [0..2, 2..5, 5..8, 8..9]);
        for group in shelf.groups() {
            let mut block = Block::zeros(ROWS, group.len() + 1);
            block
                .for_each_row(|i, row| row.iter_mut().zip(group.clone()).for_each(|(x, j)| *x = entry(i, j)));
            shelf.store(group, &block, &Progress::new()).unwrap();
        }
    }
    shelves
}

fn has_entries(shelf: &Shelf, entry: impl Fn(usize, usize) -> f32) -> bool {
    let view = shelf.view(0..ROWS).unwrap();
    let columns = 0..shelf.columns();
    (0..ROWS).all(|i| view.row(i).iter().copied().eq(columns.clone().map(|j| entry(i, j))))
}

#[test]
fn groups_and_rows_have_the_same_numbers_in_memory_and_in_a_file() {
    for mut shelf in shelves() {
        assert!(has_entries(&shelf, entry));
        let mut group = shelf.take(5..8, &Progress::new()).unwrap();
        assert_eq!(shelf.columns_of(&group).row(ROWS - 1), [5, 6, 7].map(|j| entry(ROWS - 1, j)));
        shelf.change(&mut group, |i, row| row[1] = -(i as f32));
        shelf.put(group, &Progress::new()).unwrap();
        let changed = |i: usize, j: usize| if j == 6 { -(i as f32) } else { entry(i, j) };
        assert!(has_entries(&shelf, changed));
        let unchanged = shelf.take(2..5, &Progress::new()).unwrap();
        shelf.put_unchanged(unchanged);
        for (j, first) in [(1, 0), (6, 5), (7, 5), (8, 8)] {
            let (read, place) = shelf.read(j, &Progress::new()).unwrap();
            assert_eq!(place, j - first);
            let found = read.columns().row(TILE_ROWS)[place];
            assert_eq!(found.to_bits(), changed(TILE_ROWS, j).to_bits());
        }
        let found = shelf.with_row(ROWS - 1, |row| row[3]).unwrap();
        assert_eq!(found.to_bits(), entry(ROWS - 1, 3).to_bits());
    }
}

#[test]
fn fewer_columns_are_the_first_ones_and_stretches_change_all_rows() {
    for mut shelf in shelves() {
        shelf.set_columns(7);
        assert!(has_entries(&shelf, entry));
        shelf
            .for_each_stretch(&Progress::new(), |first, rows, width| {
                for (k, row) in rows.chunks_mut(width).enumerate() {
                    row[0] = (first + k) as f32;
                    row[6] += 1.0;
                }
            })
            .unwrap();
        let changed = |i: usize, j: usize| match j {
            0 => i as f32,
            6 => entry(i, 6) + 1.0,
            _ => entry(i, j),
        };
        assert!(has_entries(&shelf, changed));
        assert_eq!(shelf.groups(), [0..2, 2..5, 5..7]);
        let group = shelf.take(5..7, &Progress::new()).unwrap();
        assert_eq!(shelf.columns_of(&group).row(9), [changed(9, 5), changed(9, 6)]);
    }
}

#[test]
fn a_cancellation_ends_what_goes_through_all_rows() {
    let canceled = Progress::new();
    canceled.cancel();
    let ended = |result: Result<(), SpectrumError>| assert_eq!(result.err(), Some(Canceled.into()));
    for mut shelf in shelves() {
        ended(shelf.for_each_stretch(&canceled, |_, _, _| panic!("canceled")));
    }
    let [_, mut in_file] = shelves();
    ended(in_file.store(0..2, &Block::zeros(ROWS, 2), &canceled));
    ended(in_file.take(0..2, &canceled).map(|_| ()));
    ended(in_file.read(3, &canceled).map(|_| ()));
    assert!(has_entries(&in_file, entry));
}

#[test]
fn a_file_that_ends_too_early_is_an_error() {
    let mut shelf = Shelf::in_file(tempfile::tempfile().unwrap(), ROWS, 4, GROUPS);
    assert!(
        shelf.take(0..2, &Progress::new()).is_err()
            && shelf.view([5]).is_err()
            && shelf.read(2, &Progress::new()).is_err()
    );
    assert!(shelf.for_each_stretch(&Progress::new(), |_, _, _| {}).is_err());
}

/// A thread that waits for a part of what it reads may be given another column to read.
#[test]
fn many_threads_read_columns_at_once() {
    let [_, in_file] = shelves();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(6).build().unwrap();
    let ends: Vec<f32> = pool.install(|| {
        (0..900_usize)
            .into_par_iter()
            .with_max_len(1)
            .map(|k| {
                let (read, place) = in_file.read(k % 9, &Progress::new()).unwrap();
                read.columns().row(ROWS - 1)[place]
            })
            .collect()
    });
    assert!(ends.iter().enumerate().all(|(k, end)| end.to_bits() == entry(ROWS - 1, k % 9).to_bits()));
}
