//! What a cloud is made of: its digest and its parts, cut into chunks. No SQL here.

use sha2::{Digest, Sha256};

use super::arrays::{Checksum, Number, read_exactly, write_exactly};
use super::rows::{hex, to_json, word};
use super::{CHUNK_POINTS, StoreError};
use crate::cloud::{PointCloud, ScalarType};

/// Prefix of what is hashed; another order or width of the parts gets another number.
const DIGEST_VERSION: &[u8] = b"chladni cloud 2\0";
/// The prefix of before, when the type of the coordinates, their grids and their origin were left out.
const DIGEST_VERSION_1: &[u8] = b"chladni cloud 1\0";

/// SHA-256 over all that is kept of a cloud: dimension, coordinates, fields and faces, each with its length before it and
/// numbers by their bits; what makes polygons of the triangles, where there are any; the coordinates' type and grids, and
/// what the file said beside its points.
///
/// Two uploads of the same numbers are one cloud only if they are written alike, too: neither gets the other's types.
pub(super) fn digest(cloud: &PointCloud) -> Result<Checksum, StoreError> {
    let mut hash = hash_of(cloud, DIGEST_VERSION)?;
    add_text(&mut hash, &word(&cloud.coordinate_type())?);
    add_text(&mut hash, &to_json(&cloud.grids())?);
    add_text(&mut hash, &to_json(cloud.origin())?);
    Ok(hash.finalize().into())
}

/// Whether a digest is the cloud's, by today's rule or, for clouds stored before it, by the first.
pub(super) fn has_digest(cloud: &PointCloud, expected: &str) -> Result<bool, StoreError> {
    if hex(&digest(cloud)?) == expected {
        return Ok(true);
    }
    let first: Checksum = hash_of(cloud, DIGEST_VERSION_1)?.finalize().into();
    Ok(hex(&first) == expected)
}

fn hash_of(cloud: &PointCloud, version: &[u8]) -> Result<Sha256, StoreError> {
    let mut hash = Sha256::new();
    hash.update(version);
    add_count(&mut hash, cloud.dimension());
    add_numbers(&mut hash, cloud.coordinates());
    add_count(&mut hash, cloud.fields().len());
    for field in cloud.fields() {
        add_text(&mut hash, &field.name);
        add_text(&mut hash, &word(&field.kind)?);
        add_numbers(&mut hash, &field.values);
    }
    add_numbers(&mut hash, cloud.faces().as_flattened());
    if !cloud.continued().is_empty() {
        add_numbers(&mut hash, cloud.continued());
    }
    Ok(hash)
}

fn add_count(hash: &mut Sha256, count: usize) {
    hash.update((count as u64).to_le_bytes());
}

fn add_text(hash: &mut Sha256, text: &str) {
    add_count(hash, text.len());
    hash.update(text);
}

fn add_numbers<T: Number>(hash: &mut Sha256, values: &[T]) {
    add_count(hash, values.len());
    for values in values.chunks(CHUNK_POINTS) {
        hash.update(T::write(values));
    }
}

/// One array of a cloud.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Part {
    Coordinates,
    Faces,
    /// Which triangles continue the polygon of the one before.
    Polygons,
    Field(usize),
}

impl Part {
    /// The parts of a cloud with this many fields.
    pub(super) fn all(fields: usize) -> impl Iterator<Item = Self> {
        [Self::Coordinates, Self::Faces, Self::Polygons].into_iter().chain((0..fields).map(Self::Field))
    }

    pub(super) fn name(self) -> String {
        match self {
            Self::Coordinates => "coordinates".to_owned(),
            Self::Faces => "faces".to_owned(),
            Self::Polygons => "polygons".to_owned(),
            Self::Field(field) => format!("field/{field}"),
        }
    }

    /// Chunk `chunk` of this part as bytes, and their type; `None` past its end.
    pub(super) fn chunk(self, cloud: &PointCloud, chunk: usize) -> Option<(ScalarType, Vec<u8>)> {
        match self {
            Self::Coordinates => {
                let values = piece(cloud.coordinates(), chunk, CHUNK_POINTS * cloud.dimension())?;
                Some(write_exactly(values, cloud.coordinate_type()))
            }
            Self::Faces => {
                let faces = piece(cloud.faces(), chunk, CHUNK_POINTS)?;
                Some((ScalarType::Uint32, u32::write(faces.as_flattened())))
            }
            Self::Polygons => {
                let continued = piece(cloud.continued(), chunk, CHUNK_POINTS)?;
                Some((ScalarType::Uint32, u32::write(continued)))
            }
            Self::Field(field) => {
                let field = cloud.fields().get(field)?;
                Some(write_exactly(piece(&field.values, chunk, CHUNK_POINTS)?, field.kind))
            }
        }
    }
}

fn piece<T>(values: &[T], chunk: usize, length: usize) -> Option<&[T]> {
    values.chunks(length).nth(chunk)
}

/// Appends the triangles of a chunk; false when the bytes do not divide into triangles.
pub(super) fn read_faces(bytes: &[u8], faces: &mut Vec<[u32; 3]>) -> bool {
    let mut corners: Vec<u32> = Vec::new();
    let whole = u32::read(bytes, &mut corners);
    let (triangles, rest) = corners.as_chunks::<3>();
    faces.extend_from_slice(triangles);
    whole && rest.is_empty()
}

/// Appends the triangles' places of a chunk; false when the bytes do not divide into numbers.
pub(super) fn read_polygons(bytes: &[u8], continued: &mut Vec<u32>) -> bool {
    u32::read(bytes, continued)
}

/// Appends the numbers of a chunk of coordinates or of a field.
pub(super) fn read_numbers(
    encoding: ScalarType,
    bytes: &[u8],
    values: &mut Vec<f64>,
) -> Result<(), StoreError> {
    if read_exactly(encoding, bytes, values) {
        return Ok(());
    }
    Err(StoreError::Damaged("a chunk of a cloud has a broken length".to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::{Grid, NonFinite, ScalarField};

    fn cloud(coordinates: &[f64]) -> PointCloud {
        PointCloud::new(2, coordinates.to_vec(), NonFinite::Drop).unwrap()
    }

    #[test]
    fn the_digest_tells_every_part_of_a_cloud_apart() {
        let plain = cloud(&[0.0, 1.0, 2.0, 3.0, 4.0, 5.0]);
        let field = |name: &str, kind, values: [f64; 3]| {
            let field = ScalarField { name: name.to_owned(), kind, values: values.to_vec().into() };
            plain.clone().with_fields(vec![field]).unwrap()
        };
        let clouds = [
            plain.clone(),
            cloud(&[0.0, 1.0, 2.0, 3.0, 4.0, 5.5]),
            cloud(&[-0.0, 1.0, 2.0, 3.0, 4.0, 5.0]),
            cloud(&[0.0, 1.0, 2.0, 3.0]),
            PointCloud::new(3, plain.coordinates().to_vec(), NonFinite::Reject).unwrap(),
            field("a", ScalarType::Uint8, [1.0, 2.0, 3.0]),
            field("b", ScalarType::Uint8, [1.0, 2.0, 3.0]),
            field("a", ScalarType::Int8, [1.0, 2.0, 3.0]),
            field("a", ScalarType::Uint8, [1.0, 2.0, 4.0]),
            plain.clone().with_faces(vec![[0, 1, 2]]).unwrap(),
            plain.clone().with_faces(vec![[0, 2, 1]]).unwrap(),
            plain.clone().with_faces(vec![[0, 1, 2], [0, 2, 1]]).unwrap(),
            plain.clone().with_faces(vec![[0, 1, 2], [0, 2, 1]]).unwrap().with_polygons(vec![1]).unwrap(),
        ];
        let digests: std::collections::HashSet<Checksum> =
            clouds.iter().map(|cloud| digest(cloud).unwrap()).collect();
        assert_eq!(digests.len(), clouds.len());
    }

    #[test]
    fn the_digest_tells_types_grids_and_origins_apart() {
        let wide = cloud(&[0.5, 1.0]);
        let grid = Grid { scale: 0.5, offset: 0.0 };
        let clouds = [
            wide.clone(),
            wide.clone().with_coordinate_type(ScalarType::Float32),
            wide.clone().with_grids(Some([grid; 3])),
            wide.clone().with_notes(["something was left out".to_owned()]),
        ];
        let digests: std::collections::HashSet<Checksum> =
            clouds.iter().map(|cloud| digest(cloud).unwrap()).collect();
        assert_eq!(digests.len(), clouds.len());
    }

    #[test]
    fn clouds_stored_by_the_first_version_are_recognized() {
        // sha256 of the first version's layout: prefix, d = 2, two numbers, no fields, no faces.
        let mut first = Sha256::new();
        first.update(b"chladni cloud 1\0");
        first.update([2_u64.to_le_bytes(), 2_u64.to_le_bytes()].concat());
        first.update([0.5_f64.to_le_bytes(), 1.0_f64.to_le_bytes()].concat());
        first.update([0_u64.to_le_bytes(), 0_u64.to_le_bytes()].concat());
        let first: Checksum = first.finalize().into();
        let narrow = cloud(&[0.5, 1.0]).with_coordinate_type(ScalarType::Float32);
        assert!(has_digest(&narrow, &hex(&first)).unwrap());
        assert!(has_digest(&narrow, &hex(&digest(&narrow).unwrap())).unwrap());
        assert!(!has_digest(&cloud(&[0.5, 2.0]), &hex(&first)).unwrap());
    }

    #[test]
    fn chunks_are_cut_at_whole_points_and_end_with_the_cloud() {
        let numbers: Vec<f64> = (0..2 * (CHUNK_POINTS + 1)).map(|i| i as f64).collect();
        let cloud = cloud(&numbers);
        assert_eq!(Part::Coordinates.chunk(&cloud, 0).unwrap().1.len(), CHUNK_POINTS * 16);
        assert_eq!(Part::Coordinates.chunk(&cloud, 1).unwrap().1.len(), 16);
        assert!(Part::Coordinates.chunk(&cloud, 2).is_none());
        assert!(Part::Faces.chunk(&cloud, 0).is_none());
    }

    #[test]
    fn half_a_triangle_is_refused() {
        let mut faces = Vec::new();
        assert!(read_faces(&u32::write(&[0, 1, 2]), &mut faces));
        assert!(!read_faces(&u32::write(&[0, 1]), &mut faces));
        assert!(!read_faces(&[0; 11], &mut faces));
    }
}
