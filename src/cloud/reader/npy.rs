//! NumPy arrays: n×d, n numbers, h×w×c, n records with names, and archives of arrays.
//!
//! npyz parses the types; the header's three entries are picked out here, because npyz 0.9.1 multiplies the shape
//! without a check (a panic in builds that check arithmetic), allocates what the header's length field says,
//! and its grammar recurses once per bracket. The tests hold both readers against each other.

mod archive;
mod header;

use self::header::Header;
use super::columns::{Column, Columns, leading_dimension};
use super::container::Container;
use super::decode::Place;
use super::number::{self, Source};
use super::{Format, ReadError, ReadOptions, names};
use crate::cloud::PointCloud;

const FORMAT: Format = Format::Npy;

pub(super) fn read(bytes: &[u8], options: &ReadOptions) -> Result<PointCloud, ReadError> {
    if Container::of(bytes) == Some(Container::Zip) {
        return archive::read(bytes, options);
    }
    let header = Header::parse(bytes)?;
    options.limits.points(header.rows)?;
    let block = header.block(bytes)?;
    let mut columns = header.columns(options)?;
    columns.zeroed(header.rows)?;
    let sources: Vec<Source> = (0..header.columns.len()).map(|index| header.source(block, index)).collect();
    number::fill(&mut columns, &sources);
    columns.into_cloud(Vec::new(), options)
}

/// Reads an array of `n × m` or n numbers as its columns.
///
/// # Errors
/// [`ReadError`].
pub fn read_columns(bytes: &[u8]) -> Result<Vec<Vec<f64>>, ReadError> {
    let header = Header::parse(bytes)?;
    let block = header.block(bytes)?;
    let column = |index| {
        let mut values = vec![0.0; header.rows];
        header.source(block, index).decode(Place::packed(&mut values));
        values
    };
    Ok((0..header.columns.len()).map(column).collect())
}

impl Header {
    /// Coordinates by their names, where there are any; else the leading columns, as of tables in text: what stands behind
    /// x, y and z is more likely a color or a normal than a fourth dimension.
    fn columns(&self, options: &ReadOptions) -> Result<Columns, ReadError> {
        let width = self.columns.len();
        let kind = |index: usize| self.columns[index].number.scalar_type();
        let named: Vec<Column> = (0..width)
            .map(|index| match &self.columns[index].name {
                Some(name) => Column { name: name.clone(), kind: kind(index) },
                None => Column { kind: kind(index), ..Column::unnamed(index) },
            })
            .collect();
        if self.has_names && options.dimension.is_none() {
            let all: Vec<String> = named.iter().map(|column| column.name.clone()).collect();
            if let Some(axes) = names::axes(&all) {
                let mut columns = Columns::new(&named, &axes.of_column, &options.limits)?;
                columns.notes.extend(axes.note);
                columns.notes.extend(self.left_out());
                return Ok(columns);
            }
            if !self.begins_with_triple {
                return Err(ReadError::NoAxes { format: FORMAT, names: all.join(", ") });
            }
        }
        let dimension = leading_dimension(width, options);
        if dimension > options.limits.dimension_max {
            return Err(ReadError::Dimension { dimension, dimension_max: options.limits.dimension_max });
        }
        let mut columns = Columns::leading(&named, dimension, &options.limits).map_err(|error| match error {
            ReadError::TooManyFields { .. } if !self.has_names && self.rows <= 3 => {
                let message = format!(
                    "the array has {} rows of {width} numbers; one of {width} points is to be transposed, as `array.T`",
                    self.rows
                );
                ReadError::byte(FORMAT, 0, message)
            }
            error => error,
        })?;
        let is_ambiguous = options.dimension.is_none() && !self.has_names && width > dimension;
        if is_ambiguous {
            let all = if width <= crate::cloud::DIMENSION_MAX {
                format!("; coordinates={width} takes them all as coordinates")
            } else {
                String::new()
            };
            columns.notes.push(format!(
                "the array has {width} columns: the first {dimension} are coordinates, the others fields{all}"
            ));
        }
        columns.notes.extend(self.left_out());
        Ok(columns)
    }

    fn left_out(&self) -> impl Iterator<Item = String> {
        self.left_out.iter().map(|name| format!("the member `{name}` holds no real numbers and was left out"))
    }
}

#[cfg(test)]
mod tests {
    use npyz::WriterBuilder;

    use super::*;
    use crate::cloud::ScalarType;

    fn npy<T: npyz::AutoSerialize>(values: &[T], shape: &[u64], order: npyz::Order) -> Vec<u8> {
        let mut bytes = Vec::new();
        let options = npyz::WriteOptions::new().default_dtype().shape(shape).order(order);
        let mut writer = options.writer(&mut bytes).begin_nd().unwrap();
        writer.extend(values).unwrap();
        writer.finish().unwrap();
        bytes
    }

    fn with_header(header: &str, body: &[u8]) -> Vec<u8> {
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend(u16::try_from(header.len()).unwrap().to_le_bytes());
        bytes.extend(header.as_bytes());
        bytes.extend(body);
        bytes
    }

    fn message(bytes: &[u8]) -> String {
        read(bytes, &ReadOptions::default()).unwrap_err().to_string()
    }

    #[test]
    fn arrays_that_npyz_writes_are_read_in_both_orders() {
        let options = ReadOptions::default();
        let cloud = read(&npy(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], &[2, 3], npyz::Order::C), &options).unwrap();
        assert_eq!(cloud.coordinates(), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        let fortran = npy(&[1.0_f32, 4.0, 2.0, 5.0, 3.0, 6.0], &[2, 3], npyz::Order::Fortran);
        let cloud = read(&fortran, &options).unwrap();
        assert_eq!(cloud.coordinates(), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        assert_eq!(cloud.coordinate_type(), ScalarType::Float32);
        let integers = npy(&[-1_i64, 2, 3, 4], &[2, 2], npyz::Order::C);
        assert_eq!(read(&integers, &options).unwrap().coordinates(), [-1.0, 2.0, 3.0, 4.0]);
        assert_eq!(read(&npy(&[7_u8, 8], &[2], npyz::Order::C), &options).unwrap().dimension(), 1);
    }

    #[test]
    fn an_array_is_read_by_columns_whatever_its_order_and_its_width() {
        let columns = [[1.0, 3.0, 5.0].to_vec(), [2.0, 4.0, 6.0].to_vec()];
        let rows = npy(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], &[3, 2], npyz::Order::C);
        assert_eq!(read_columns(&rows).unwrap(), columns);
        let fortran = npy(&[1.0, 3.0, 5.0, 2.0, 4.0, 6.0], &[3, 2], npyz::Order::Fortran);
        assert_eq!(read_columns(&fortran).unwrap(), columns);
        assert_eq!(read_columns(&npy(&[0_u8; 40], &[2, 20], npyz::Order::C)).unwrap().len(), 20);
        assert!(read_columns(&rows[..rows.len() - 1]).is_err());
    }

    #[test]
    fn big_endian_arrays_are_read() {
        let header = "{'descr': '>f4', 'fortran_order': False, 'shape': (1, 2), }\n";
        let body: Vec<u8> = [1.5_f32, -2.0].iter().flat_map(|x| x.to_be_bytes()).collect();
        let cloud = read(&with_header(header, &body), &ReadOptions::default()).unwrap();
        assert_eq!(cloud.coordinates(), [1.5, -2.0]);
    }

    #[test]
    fn the_caller_chooses_the_dimension_and_keeps_the_other_columns() {
        let bytes = npy(&[1.0; 12], &[2, 6], npyz::Order::C);
        let cloud = read(&bytes, &ReadOptions::default()).unwrap();
        assert_eq!((cloud.dimension(), cloud.fields().len()), (3, 3), "as a table in text");
        assert_eq!(cloud.fields()[0].name, "column4");
        assert!(cloud.notes()[0].contains("coordinates=6"), "{:?}", cloud.notes());
        let options = ReadOptions { dimension: Some(6), ..ReadOptions::default() };
        let cloud = read(&bytes, &options).unwrap();
        assert_eq!((cloud.dimension(), cloud.fields().len(), cloud.notes().len()), (6, 0, 0));
    }

    #[test]
    fn a_shape_beyond_the_file_is_refused() {
        for shape in ["(4000000, 3)", "(3, 18446744073709551615)"] {
            let header = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}}}");
            let message = message(&with_header(&header, &[0; 24]));
            assert!(message.contains("is announced, 24 bytes follow"), "{message}");
        }
        let header = "{'descr': '<f8', 'fortran_order': False, 'shape': (99999999999999999999999, 3)}";
        assert!(message(&with_header(header, &[])).contains("not a tuple of whole numbers"));
    }

    #[test]
    fn what_is_no_table_of_real_numbers_is_refused() {
        let refusal = |descr: &str, shape: &str| {
            let header = format!("{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}}}");
            message(&with_header(&header, &[0; 64]))
        };
        assert!(refusal("'<c16'", "(2, 2)").contains("gives the type `'<c16'`"));
        assert!(refusal("[('x', '|O')]", "(2,)").contains("gives the type"));
        assert!(refusal("'<f8'", "(2, 2, 2, 2)").contains("an array of 4 axes"));
        assert!(refusal("'<f8'", "()").contains("0 axes"));
        assert!(refusal("'<f8'", "(0, 3)").contains("no points"));
        assert!(message(b"\x93NUMPX").contains("does not begin"));
        assert!(message(b"\x93NUMPY\x09\x00").contains("versions 1.0"));
        assert!(message(b"\x93NUMPY\x01\x00\xff").contains("length of the header"));
        assert!(message(b"\x93NUMPY\x02\x00\xff\xff\xff\xff{}").contains("header is incomplete"));
        assert!(message(&with_header("{'descr': '<f8'}", &[])).contains("no entry 'fortran_order'"));
    }

    #[test]
    fn records_have_their_coordinates_by_name() {
        let header = "{'descr': [('id', '<u2'), ('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('rgb', '|u1', (3,)), \
                      ('', '|V1')], 'fortran_order': False, 'shape': (2,), }";
        let record = |id: u16, x: f32| {
            let mut bytes = id.to_le_bytes().to_vec();
            bytes.extend([x, 2.0, 3.0].iter().flat_map(|x| x.to_le_bytes()));
            bytes.extend([7, 8, 9, 0]);
            bytes
        };
        let bytes = with_header(header, &[record(5, 1.0), record(6, 4.0)].concat());
        let cloud = read(&bytes, &ReadOptions::default()).unwrap();
        assert_eq!(cloud.coordinates(), [1.0, 2.0, 3.0, 4.0, 2.0, 3.0]);
        let found: Vec<_> = cloud.fields().iter().map(|f| (f.name.as_str(), f.values[1])).collect();
        assert_eq!(found, [("id", 6.0), ("rgb_0", 7.0), ("rgb_1", 8.0), ("rgb_2", 9.0)]);
        let header =
            "{'descr': [('position', '<f8', (3,)), ('i', '<f8')], 'fortran_order': False, 'shape': (1,)}";
        let body: Vec<u8> = [1.0_f64, 2.0, 3.0, 4.0].iter().flat_map(|x| x.to_le_bytes()).collect();
        let cloud = read(&with_header(header, &body), &ReadOptions::default()).unwrap();
        assert_eq!((cloud.dimension(), cloud.fields()[0].values[0]), (3, 4.0));
        let header = "{'descr': [('name', '<U1'), ('x', '<f8'), ('y', '<f8'), ('at', '<M8[s]'), ('h', '<f2')], \
                      'fortran_order': False, 'shape': (1,)}";
        let texts = [&[0; 4][..], &body[..16], &[0; 10]].concat();
        let cloud = read(&with_header(header, &texts), &ReadOptions::default()).unwrap();
        assert_eq!((cloud.coordinates(), cloud.fields().len()), (&[1.0, 2.0][..], 0));
        let left_out = ["name", "at", "h"]
            .map(|name| format!("the member `{name}` holds no real numbers and was left out"));
        assert_eq!(cloud.notes(), left_out);
        let header = "{'descr': [('a', '<f8'), ('b', '<f8')], 'fortran_order': False, 'shape': (2,)}";
        assert!(message(&with_header(header, &body)).contains("the header names a, b"));
    }

    #[test]
    fn an_array_of_three_rows_may_be_one_that_is_to_be_transposed() {
        let message = message(&npy(&[1.0; 300], &[3, 100], npyz::Order::C));
        assert!(message.contains("as `array.T`"), "{message}");
        let cloud = read(&npy(&[1.0; 30], &[3, 10], npyz::Order::C), &ReadOptions::default()).unwrap();
        assert!(cloud.notes()[0].contains("the array has 10 columns"), "{:?}", cloud.notes());
    }

    #[test]
    fn integers_that_doubles_round_are_told_of() {
        let cloud = |large: i64| {
            let bytes = npy(&[1, 2, 3, large], &[1, 4], npyz::Order::C);
            read(&bytes, &ReadOptions::default()).unwrap().notes().join("\n")
        };
        assert!(cloud((1 << 60) + 1).contains("`column4` has integers of more than 53 bits"));
        assert!(!cloud(1 << 53).contains("bits"));
    }

    #[test]
    fn a_picture_of_points_is_read_row_by_row() {
        let bytes =
            npy(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0], &[2, 2, 3], npyz::Order::C);
        let cloud = read(&bytes, &ReadOptions::default()).unwrap();
        assert_eq!((cloud.len(), cloud.point(3)), (4, &[10.0, 11.0, 12.0][..]));
    }
}
