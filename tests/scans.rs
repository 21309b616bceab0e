//! Real scans are read whole, where they are at hand: `cargo test --test scans -- --ignored`.
#![allow(clippy::unwrap_used, missing_docs)] // a test that cannot go on has failed

use std::path::Path;

use chladni::cloud::PointCloud;
use chladni::cloud::reader::{Format, ReadOptions, read};

fn scan(name: &str) -> PointCloud {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data").join(name);
    let bytes = std::fs::read(&path).unwrap();
    let format = Format::sniff(&bytes);
    assert_eq!(format, path.extension().and_then(|extension| Format::from_extension(extension.to_str()?)));
    read(&bytes, format.unwrap(), &ReadOptions::default()).unwrap()
}

/// V − E + F of a closed or open triangle mesh, counted over the vertices that faces use.
fn euler_characteristic(cloud: &PointCloud) -> i64 {
    let mut edges: Vec<[u32; 2]> = cloud
        .faces()
        .iter()
        .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
        .map(|[a, b]| [a.min(b), a.max(b)])
        .collect();
    edges.sort_unstable();
    edges.dedup();
    let mut corners: Vec<u32> = cloud.faces().iter().flatten().copied().collect();
    corners.sort_unstable();
    corners.dedup();
    let [v, e, f] = [corners.len(), edges.len(), cloud.faces().len()].map(|n| i64::try_from(n).unwrap());
    v - e + f
}

#[test]
#[ignore = "needs the scans in ../shared/data: run with --ignored where they are"]
fn the_strips_of_igea_close_to_a_sphere() {
    // Igea is a closed head: 134,345 vertices, and by Euler's formula 2·134,345 − 4 triangles.
    let cloud = scan("igea.ply");
    assert_eq!((cloud.len(), cloud.faces().len()), (134_345, 268_686));
    assert_eq!(euler_characteristic(&cloud), 2);
}

#[test]
#[ignore = "needs the scans in ../shared/data: run with --ignored where they are"]
fn the_meshes_in_obj_have_their_counts_and_topology() {
    // Vertices and faces as `grep -c '^v '` and `'^f '` count them. The bunny has five holes: χ = 2 − 5.
    for (name, points, faces, characteristic) in
        [("bunny.obj", 35_947, 69_451, -3), ("spot.obj", 2_930, 5_856, 2), ("fandisk.obj", 6_475, 12_946, 2)]
    {
        let cloud = scan(name);
        assert_eq!((cloud.len(), cloud.faces().len()), (points, faces), "{name}");
        assert_eq!(euler_characteristic(&cloud), characteristic, "{name}");
    }
}

#[test]
#[ignore = "needs the scans in ../shared/data: run with --ignored where they are"]
fn the_csv_of_a_sphere_lies_on_the_sphere() {
    let cloud = scan("sphere48.csv");
    assert_eq!((cloud.len(), cloud.dimension()), (48, 3));
    for point in cloud.coordinates().chunks_exact(3) {
        let radius = point.iter().map(|x| x * x).sum::<f64>().sqrt();
        assert!((radius - 1.0).abs() < 1e-9, "{radius}");
    }
}
