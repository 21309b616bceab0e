//! What a picture shows.

#![allow(clippy::float_cmp)] // to the last digit

use super::*;
use crate::cloud::NonFinite;
use crate::cloud::shapes::{SampleRequest, Shape, sample};

fn sphere() -> PointCloud {
    sample(&SampleRequest::new(Shape::Sphere, 3_000)).unwrap()
}

fn pixel(picture: &Picture, x: usize, y: usize) -> [u8; 4] {
    let at = 4 * (y * picture.width + x);
    [0, 1, 2, 3].map(|channel| picture.pixels[at + channel])
}

/// From the front, x to the right and z up.
fn front() -> View {
    View { azimuth: -90.0, elevation: 0.0, width: 200, height: 100, ..View::default() }
}

#[test]
fn a_sphere_is_a_disc_without_holes_on_white() {
    let picture = Picture::draw(&sphere(), &Paint::Plain, &[], &front());
    assert_eq!((picture.width, picture.height, picture.pixels.len()), (200, 100, 80_000));
    for y in 0..100 {
        for x in 0..200 {
            let distance = f64::hypot(x as f64 + 0.5 - 100.0, y as f64 + 0.5 - 50.0);
            let [r, g, b, alpha] = pixel(&picture, x, y);
            assert_eq!(alpha, 255);
            if distance > 51.0 {
                assert_eq!([r, g, b], [255; 3], "{x} {y}");
            } else if distance < 44.0 {
                assert!(r < 250, "a hole at {x} {y}: {r} {g} {b}");
            }
        }
    }
}

#[test]
fn light_comes_from_the_upper_left() {
    let picture = Picture::draw(&sphere(), &Paint::Plain, &[], &front());
    let [lit, turned] = [pixel(&picture, 82, 32), pixel(&picture, 128, 78)].map(|[red, ..]| i32::from(red));
    assert!(lit > turned + 40, "{lit} {turned}");
}

#[test]
fn signs_are_blue_and_orange_and_the_absent_is_gray() {
    let sphere = sphere();
    let mut values: Vec<f64> = (0..sphere.len()).map(|row| sphere.point(row)[0]).collect();
    let picture = Picture::draw(&sphere, &Paint::Diverging(&values), &[], &front());
    let [left, right] = [pixel(&picture, 65, 50), pixel(&picture, 135, 50)];
    assert!(left[2] > left[0] + 40, "{left:?} is blue");
    assert!(right[0] > right[2] + 40, "{right:?} is orange");
    values.fill(f64::NAN);
    let [r, g, b, _] = pixel(&Picture::draw(&sphere, &Paint::Diverging(&values), &[], &front()), 100, 50);
    assert!(r == g && g == b && r < 200);
}

#[test]
fn what_is_behind_is_hidden() {
    // Two squares of points, the one behind twice as large.
    let square = |depth: f64, size: f64| {
        (0..900)
            .flat_map(move |i| {
                [f64::from(i % 30) / 29.0 - 0.5, f64::from(i / 30) / 29.0 - 0.5].map(|x| x * size)
            })
            .collect::<Vec<_>>()
            .chunks(2)
            .flat_map(|p| [p[0], depth, p[1]])
            .collect::<Vec<_>>()
    };
    let points = [square(1.0, 2.0), square(-1.0, 1.0)].concat();
    let cloud = PointCloud::new(3, points, NonFinite::Reject).unwrap();
    let value: Vec<f64> = (0..1800).map(|row| if row < 900 { 1.0 } else { -1.0 }).collect();
    let picture = Picture::draw(&cloud, &Paint::Diverging(&value), &[], &front());
    let [middle, beside] = [pixel(&picture, 100, 50), pixel(&picture, 65, 50)];
    assert!(middle[2] > middle[0], "{middle:?} is of the square in front");
    assert!(beside[0] > beside[2], "{beside:?} is of the one behind");
}

#[test]
fn feature_points_are_marked_where_they_are_seen() {
    let sphere = sphere();
    let nearest = |target: [f64; 3]| {
        let distance =
            |row: usize| sphere.point(row).iter().zip(target).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
        (0..sphere.len()).min_by(|&a, &b| distance(a).total_cmp(&distance(b))).unwrap()
    };
    let is_red = |row: usize| {
        let picture = Picture::draw(&sphere, &Paint::Plain, &[row], &front());
        // The nearest point lies a few pixels off the middle.
        let mut around = (45..55).flat_map(|y| (95..105).map(move |x| (x, y)));
        around.any(|(x, y)| {
            let [r, g, _, _] = pixel(&picture, x, y).map(i32::from);
            r > g + 80
        })
    };
    assert!(is_red(nearest([0.0, -1.0, 0.0])), "in front");
    assert!(!is_red(nearest([0.0, 1.0, 0.0])), "behind");
}

/// A square of `side × side` points at a depth, seen from the front, and the value of each.
fn square(side: u32, depth: f64, size: f64) -> Vec<f64> {
    let place = |i: u32| (f64::from(i) / f64::from(side - 1) - 0.5) * size;
    (0..side * side).flat_map(|i| [place(i % side), depth, place(i / side)]).collect()
}

#[test]
fn a_sparse_surface_hides_a_dense_one_behind_it() {
    let points = [square(24, -1.0, 2.0), square(150, 1.0, 2.0)].concat();
    let cloud = PointCloud::new(3, points, NonFinite::Reject).unwrap();
    let values: Vec<f64> = (0..cloud.len()).map(|row| if row < 24 * 24 { 1.0 } else { -1.0 }).collect();
    let picture = Picture::draw(&cloud, &Paint::Diverging(&values), &[], &front());
    let view = front();
    for y in 8..view.height - 8 {
        for x in 58..142 {
            let [r, _, b, _] = pixel(&picture, x, y);
            assert!(r > b, "the far side shows through at {x} {y}");
        }
    }
}

#[test]
fn triangles_are_filled_and_their_colors_change_linearly() {
    let corners = vec![-1.0, 0.0, -1.0, 1.0, 0.0, -1.0, 0.0, 0.0, 1.0];
    let cloud = PointCloud::new(3, corners, NonFinite::Reject).unwrap().with_faces(vec![[0, 1, 2]]).unwrap();
    let values = [-1.0, 1.0, 0.0];
    let picture = Picture::draw(&cloud, &Paint::Diverging(&values), &[], &front());
    let light = Picture::draw(&cloud, &Paint::Plain, &[], &front());
    // The plane faces the viewer: its light is the same everywhere.
    assert_eq!(pixel(&light, 100, 50), pixel(&light, 90, 80));
    let [left, middle, right] = [70, 100, 130].map(|x| pixel(&picture, x, 85).map(i32::from));
    assert!(left[2] > left[0] + 60 && right[0] > right[2] + 60, "{left:?} {right:?}");
    assert!((middle[0] - middle[2]).abs() < 12, "{middle:?} is about zero");
    assert_eq!(pixel(&picture, 60, 20), [255; 4], "beside the triangle there is nothing");
}

#[test]
fn a_mark_near_the_rim_is_whole_and_numbered() {
    let view = View { width: 800, height: 600, ..front() };
    let sphere = sphere();
    // 20° from where the sphere is seen from aside.
    let (sin, cos) = 20_f64.to_radians().sin_cos();
    let along = |row: usize| cos * sphere.point(row)[0] - sin * sphere.point(row)[1];
    let rim = (0..sphere.len()).max_by(|&a, &b| along(a).total_cmp(&along(b))).unwrap();
    let picture = Picture::draw(&sphere, &Paint::Plain, &[rim], &view);
    let red = |x: usize, y: usize| {
        let [r, g, b, _] = pixel(&picture, x, y).map(i32::from);
        r > g + 80 && r > b + 60
    };
    let found: Vec<(usize, usize)> =
        (0..600).flat_map(|y| (500..800).map(move |x| (x, y))).filter(|&(x, y)| red(x, y)).collect();
    // A disc of 9.6 pixels less its rim and its number.
    assert!((110..230).contains(&found.len()), "{}", found.len());
    let extent = |pick: fn(&(usize, usize)) -> usize| {
        found.iter().map(pick).max().unwrap() - found.iter().map(pick).min().unwrap()
    };
    assert!(extent(|p| p.0).abs_diff(extent(|p| p.1)) <= 2, "it is round");
    let unnumbered = std::f64::consts::PI * 0.66 * 9.6 * 9.6;
    assert!((found.len() as f64) < unnumbered - 8.0, "the number covers a part of it");
}

#[test]
fn the_background_is_chosen() {
    for (background, expected) in [
        (Background::White, [255, 255, 255, 255]),
        (Background::Black, [0, 0, 0, 255]),
        (Background::Transparent, [0, 0, 0, 0]),
    ] {
        let picture = Picture::draw(&sphere(), &Paint::Plain, &[], &View { background, ..front() });
        assert_eq!(pixel(&picture, 0, 0), expected);
    }
}

#[test]
fn a_picture_is_the_same_however_many_threads_draw_it() {
    let draw = || Picture::draw(&sphere(), &Paint::Plain, &[7], &front());
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap().install(draw);
    let many = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap().install(draw);
    assert_eq!(alone, many);
}

#[test]
fn the_file_is_a_png_of_the_picture_with_its_title() {
    let picture = Picture::draw(&sphere(), &Paint::Plain, &[], &front());
    let bytes = picture.to_png("Kügelchen").unwrap();
    let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut pixels).unwrap();
    assert_eq!(pixels, picture.pixels);
    assert_eq!(reader.info().utf8_text[0].get_text().unwrap(), "Kügelchen");
}

#[test]
fn a_few_peaks_do_not_leave_everything_else_pale() {
    let mut values = vec![1.0; 1000];
    values[3] = -1e6;
    values[4] = f64::NAN;
    assert_eq!(magnitude(&values), 1.0);
    assert_eq!(magnitude(&[]), 1.0);
    assert_eq!(extent(&values), (1.0, 1.0));
    assert_eq!(extent(&[f64::NAN]), (0.0, 1.0));
}

#[test]
fn clouds_of_every_dimension_are_drawn() {
    for dimension in [1, 2, 4, 6] {
        let points = (0..dimension * 50).map(|i| (i as f64 * 0.37).sin()).collect();
        let cloud = PointCloud::new(dimension, points, NonFinite::Reject).unwrap();
        let picture = Picture::draw(&cloud, &Paint::Plain, &[], &View::default());
        assert!(picture.pixels.chunks(4).any(|pixel| pixel[0] < 250), "{dimension}");
    }
}

#[test]
fn a_picture_that_nobody_waits_for_is_not_drawn_to_its_end() {
    let looks = std::cell::Cell::new(0);
    let draw = |patience: usize| {
        looks.set(0);
        let is_wanted = || {
            looks.set(looks.get() + 1);
            looks.get() <= patience
        };
        Picture::draw_while(&sphere(), &Paint::Plain, &[], &front(), is_wanted)
    };
    assert_eq!(draw(usize::MAX), Some(Picture::draw(&sphere(), &Paint::Plain, &[], &front())));
    let stages = looks.get();
    for patience in 0..stages {
        assert_eq!(draw(patience), None);
        assert_eq!(looks.get(), patience + 1, "it goes on all the same");
    }
}
