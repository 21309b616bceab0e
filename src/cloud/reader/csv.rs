//! CSV: a point per line, columns separated by commas, semicolons, tabs, or blanks.
//!
//! A first line without any number is a header. Coordinates are the columns named x, y, z wherever they stand;
//! without such names, the leading columns.

use super::table::{self, Dialect};
use super::text::Lines;
use super::{Format, ReadError, ReadOptions};
use crate::cloud::PointCloud;

pub(super) fn read(bytes: &[u8], options: &ReadOptions) -> Result<PointCloud, ReadError> {
    let mut lines = Lines::new(bytes);
    let (first, dialect, before) = loop {
        let before = lines.clone();
        let line = lines.next().ok_or(ReadError::Empty)?;
        let dialect = Dialect { format: Format::Csv, separator: separator(line.text) };
        let text = dialect.content(&line);
        if !text.is_empty() {
            break (text, dialect, before);
        }
    };
    match dialect.names(first) {
        Some(names) => table::read(dialect, Some(&names), None, lines, options),
        None => table::read(dialect, None, None, before, options),
    }
}

/// A semicolon separates before a comma does: where commas are decimal marks, semicolons separate. Where nothing else
/// does, blanks separate.
fn separator(line: &[u8]) -> Option<u8> {
    [b';', b'\t', b','].into_iter().find(|mark| line.contains(mark))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::reader::Location;

    fn csv(text: &str) -> Result<PointCloud, ReadError> {
        read(text.as_bytes(), &ReadOptions::default())
    }

    #[test]
    fn commas_semicolons_tabs_and_blanks_separate() {
        for text in [
            "x y z\n1 2 3\n4 5 6\n",
            "1,2,3\n4,5,6\n",
            "1;2;3\n4;5;6",
            "1\t2\t3\r\n4\t5\t6\r\n",
            "\"1\", 2 ,3\n4,5,6",
        ] {
            assert_eq!(csv(text).unwrap().coordinates(), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0], "{text}");
        }
    }

    #[test]
    fn coordinates_are_found_by_name() {
        let cloud = csv("id,\"y\",x,z,class of point\n7,2,1,3,8\n").unwrap();
        assert_eq!(cloud.coordinates(), [1.0, 2.0, 3.0]);
        let names: Vec<_> = cloud.fields().iter().map(|field| field.name.as_str()).collect();
        assert_eq!(names, ["id", "class of point"]);
    }

    #[test]
    fn a_header_without_x_names_the_columns_by_position() {
        let cloud = csv("lon,lat,height,class\n1,2,3,4\n").unwrap();
        assert_eq!((cloud.dimension(), cloud.fields()[0].name.as_str()), (3, "class"));
    }

    #[test]
    fn two_fields_of_the_same_name_are_told_apart() {
        let cloud = csv("x,y,z,a,a\n1,2,3,4,5\n").unwrap();
        assert_eq!(cloud.fields()[1].name, "a_2");
    }

    #[test]
    fn a_table_of_two_columns_is_a_plane() {
        assert_eq!(csv("1,2\n3,4\n").unwrap().dimension(), 2);
        assert_eq!(csv("x,y\n3,4\n").unwrap().dimension(), 2);
    }

    #[test]
    fn a_first_row_with_one_word_is_no_header() {
        let error = csv("1.0,abc,3\n1,2,3\n").unwrap_err();
        assert_eq!(
            error.to_string(),
            "CSV, line 1: `abc` is no number; decimal numbers such as -1.5e-3 are accepted"
        );
    }

    #[test]
    fn decimal_commas_are_explained() {
        assert!(csv("0,5;0,25;1\n").unwrap_err().to_string().contains("has a decimal comma; write 0.5"));
    }

    #[test]
    fn an_empty_cell_is_refused_with_its_column() {
        assert_eq!(
            csv("1,2,3,\n").unwrap_err().to_string(),
            "CSV, line 1: column 4 is empty; write nan for a missing value"
        );
    }

    #[test]
    fn a_header_of_another_width_is_refused() {
        assert!(csv("x,y,z\n1,2\n").unwrap_err().to_string().contains("the header names 3 columns"));
    }

    #[test]
    fn an_incomplete_last_line_is_refused_by_its_number() {
        let error = csv("x,y,z\n1,2,3\n4,5").unwrap_err();
        assert!(matches!(error, ReadError::Truncated { location: Location::Line(3), .. }), "{error}");
    }
}
