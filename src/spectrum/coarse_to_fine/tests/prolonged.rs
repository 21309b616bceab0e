//! Bases of thinned samples beside those of all points.

use super::*;
use crate::spectrum::MissedCheck;
use crate::spectrum::solver;
use crate::spectrum::vectors::single::gram_pair;
use crate::spectrum::vectors::sparse_product::Matrix;

const COUNT: usize = 20;

impl Surface {
    fn thinned(&self, solved_max: usize, progress: &Progress) -> Result<Solution, SpectrumError> {
        let all = self.request(COUNT, 1e-4);
        let request = Request { solved_max, ..all };
        solver::solve(&self.problem, &request, progress)
    }

    fn exact(&self) -> Vec<f64> {
        let request = self.request(COUNT + 8, 1e-9);
        let symbolic =
            Symbolic::by_position(&self.problem.matrix, &request.position, &Progress::new()).unwrap();
        direct::solve(&self.problem, &symbolic, &request, &Progress::new()).unwrap().values
    }

    /// Values as near as `error`, the error bounded by ρ, vectors orthonormal, the rest as the method has it.
    fn check_thinned(&self, solved_max: usize, error: f64) -> Solution {
        let found = self.thinned(solved_max, &Progress::new()).unwrap();
        assert_eq!(
            (found.method, found.certificates.missed_check),
            (Method::Prolonged, MissedCheck::Thinned)
        );
        assert!(found.solved_points <= solved_max && found.solved_points > solved_max / 20);
        assert_eq!((found.certificates.missed, found.values.len()), (Some(0), COUNT));
        assert!(found.certificates.orthogonality < 1e-5, "{}", found.certificates.orthogonality);
        let (exact, shift) = (self.exact(), self.problem.shift);
        let dual = found.dual_residuals.as_ref().unwrap();
        for (j, value) in found.values.iter().enumerate() {
            let off = |lambda: &f64| (lambda - value).abs() / (lambda + shift);
            let nearest = exact.iter().map(off).fold(f64::INFINITY, f64::min);
            assert!(nearest <= dual[j] + 1e-9, "{j}: {nearest} {}", dual[j]);
            assert!(
                (value - exact[j]).abs() <= error * (exact[j] + 1e-3 * shift),
                "{j}: {value} {}",
                exact[j]
            );
        }
        found
    }
}

#[test]
fn values_of_a_sample_are_those_of_all_points_within_their_bounds() {
    let even = Surface::of(sampled(Shape::BumpySphere, 40_000, Sampling::Uniform), false);
    let found = even.check_thinned(5_000, 1e-4);
    assert!(found.certificates.dual_residual.unwrap() < 0.01, "{:?}", found.certificates);
    // twice thinned
    let found = even.check_thinned(2_000, 1e-3);
    assert!(found.solved_points < 600);
    let iid = Surface::of(sampled(Shape::BumpySphere, 20_000, Sampling::Iid), false);
    iid.check_thinned(5_000, 1e-3);
    let kernel = Surface::of(sampled(Shape::Torus, 20_000, Sampling::Uniform), true);
    kernel.check_thinned(5_000, 1e-3);
}

/// Two spheres of radii that differ by less than a fifth of the spacing of the sample: a weight across would couple them.
#[test]
fn nothing_comes_from_another_sheet() {
    let sphere = sampled(Shape::Sphere, 12_000, Sampling::Uniform);
    let inside = sphere.chunks_exact(3).flat_map(|p| [0.98 * p[0], 0.98 * p[1], 0.98 * p[2]]);
    let both = Surface::of(sphere.iter().copied().chain(inside).collect(), false);
    assert_eq!(both.problem.zero_modes(), 2);
    let level = coarser(
        &both.problem,
        &both.problem.matrix,
        |i: u32| both.points.point(i as usize),
        both.weyl.first,
        &Progress::new(),
    );
    let level = level.unwrap().unwrap();
    let is_inside = |p: &[f64]| p.iter().map(|x| x * x).sum::<f64>().sqrt() < 0.99;
    let rows = &level.weights;
    for i in 0..both.problem.size() {
        for &c in rows.row(i).0 {
            let coarse = &level.positions[c as usize];
            assert_eq!(is_inside(coarse), is_inside(both.points.point(i)), "{i}");
        }
    }
    both.check_thinned(4_000, 2e-3);
}

#[test]
fn functions_are_orthonormal_in_the_mass_and_constants_are_constant() {
    let surface = Surface::of(sampled(Shape::BumpySphere, 12_000, Sampling::Uniform), false);
    let found = surface.thinned(3_000, &Progress::new()).unwrap();
    let Vectors::Single(functions) = &found.vectors else { panic!("in double precision") };
    let (read, _) = functions.read(0, &Progress::new()).unwrap();
    let constant = read.columns();
    assert!((0..12_000).all(|i| constant.row(i)[0].to_bits() == constant.row(0)[0].to_bits()));
    let scale = &surface.problem.root_mass;
    let [gram, image] = gram_pair(Some(&surface.problem.matrix), functions, scale, &Progress::new()).unwrap();
    for j in 0..COUNT {
        for i in 0..COUNT {
            let expected = if i == j { [1.0, found.values[j]] } else { [0.0, 0.0] };
            assert!((gram[(i, j)] - expected[0]).abs() < 1e-6);
            assert!((image[(i, j)] - expected[1]).abs() < 1e-5 * found.values[COUNT - 1]);
        }
    }
}

fn has_the_rows_of(one: &Vectors, other: &Vectors) -> bool {
    let rows = |of: &Vectors, i: usize| {
        let mut row = vec![0.0; COUNT];
        of.write_row(i, 1.0, &mut row);
        row
    };
    (0..12_000).all(|i| rows(one, i) == rows(other, i))
}

#[test]
fn what_has_no_room_in_memory_goes_to_a_file_and_has_the_same_bits() {
    let surface = Surface::of(sampled(Shape::BumpySphere, 12_000, Sampling::Uniform), false);
    let folder = tempfile::tempdir().unwrap();
    let short = Progress::new().within(1_000_000).scratch_in(folder.path());
    let [memory, file] = [&Progress::new(), &short].map(|progress| surface.thinned(3_000, progress).unwrap());
    assert_eq!((memory.values, memory.dual_residuals), (file.values, file.dual_residuals));
    assert!(has_the_rows_of(&memory.vectors, &file.vectors));
    // the sample's bases are in one too
    let twice = surface.thinned(1_000, &Progress::new().within(0).scratch_in(folder.path())).unwrap();
    assert!(twice.certificates.dual_residual.unwrap() < 0.02, "{:?}", twice.certificates);
    assert!(std::fs::read_dir(folder.path()).unwrap().next().is_none(), "files without names");
    let none = Progress::new().within(0).scratch_in(folder.path().join("none"));
    assert!(matches!(surface.thinned(3_000, &none).err(), Some(SpectrumError::Scratch(_))));
}

#[test]
fn a_samples_bits_do_not_depend_on_the_number_of_threads_and_a_cancellation_ends_it() {
    let surface = Surface::of(sampled(Shape::BumpySphere, 12_000, Sampling::Uniform), false);
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| surface.thinned(3_000, &Progress::new()).unwrap())
    };
    let (one, three) = (on(1), on(3));
    assert_eq!((one.values, one.dual_residuals), (three.values, three.dual_residuals));
    assert!(has_the_rows_of(&one.vectors, &three.vectors));
    let canceled = Progress::new();
    canceled.cancel();
    let ended = surface.thinned(3_000, &canceled);
    assert!(matches!(ended.err(), Some(SpectrumError::Canceled(Canceled))));
}
