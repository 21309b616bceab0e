//! XYZ, TXT and PTS, and what else comes as text: a point per line, columns separated by blanks, or by what CSV has.
//!
//! `#`, `//` and `%` begin comments. A line with a single whole number before the first row is the number of points; PTS
//! files of several scans have one before each. Column names may stand in a line of their own or in a comment before
//! the first row, as CloudCompare writes them (`//X Y Z Intensity`).
//!
//! Written here: no crate at hand reads what programs mean by XYZ within limits on memory, naming the line of an error.

use super::{Format, ReadError, ReadOptions, colmap, ptx, table};
use crate::cloud::PointCloud;

pub(super) fn read(bytes: &[u8], options: &ReadOptions) -> Result<PointCloud, ReadError> {
    if ptx::is_ptx(bytes) {
        return ptx::read(bytes, options);
    }
    if colmap::is_points(bytes) {
        return colmap::read(bytes, options);
    }
    table::read(bytes, Format::Xyz, options)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::reader::Location;
    use crate::cloud::{CloudError, NonFinite};

    fn xyz(text: &str) -> Result<PointCloud, ReadError> {
        read(text.as_bytes(), &ReadOptions::default())
    }

    fn names(cloud: &PointCloud) -> Vec<&str> {
        cloud.fields().iter().map(|field| field.name.as_str()).collect()
    }

    #[test]
    fn columns_beyond_the_third_become_fields() {
        let cloud = xyz("# made by hand\n1 2 3 40 50\r\n\n4\t5  6 70 80 # last\n").unwrap();
        assert_eq!(cloud.coordinates(), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        assert_eq!(names(&cloud), ["column4", "column5"]);
        assert_eq!(cloud.fields()[1].values, [50.0, 80.0]);
    }

    #[test]
    fn a_header_line_or_comment_names_the_columns() {
        for text in
            ["//X Y Z Intensity\n1 2 3 9\n", "# x y z Intensity\n1 2 3 9", "x y z Intensity\n1 2 3 9\n"]
        {
            let cloud = xyz(text).unwrap();
            assert_eq!((cloud.dimension(), names(&cloud)), (3, vec!["Intensity"]), "{text}");
        }
        let cloud = xyz("intensity z y x\n9 3 2 1\n").unwrap();
        assert_eq!(cloud.coordinates(), [1.0, 2.0, 3.0]);
    }

    #[test]
    fn a_comment_that_names_other_things_is_only_a_comment() {
        let cloud = xyz("# scanned on a monday\n1 2 3 4\n").unwrap();
        assert_eq!(names(&cloud), ["column4"]);
    }

    #[test]
    fn a_count_that_is_wrong_is_told_of() {
        assert!(xyz("2\n1 2 3\n4 5 6\n").unwrap().notes().is_empty());
        for count in [1, 3] {
            let cloud = xyz(&format!("{count}\n1 2 3\n4 5 6\n")).unwrap();
            let told = format!("the first line announces {count} points; 2 follow and were read");
            assert_eq!((cloud.len(), cloud.notes()), (2, &[told][..]));
        }
    }

    #[test]
    fn a_file_of_several_scans_has_a_field_of_them() {
        let cloud = xyz("2\n0 0 1 -5 1 2 3\n1 0 2 -6 4 5 6\n1\n1 1 3 -7 7 8 9\n").unwrap();
        assert_eq!(names(&cloud), ["intensity", "red", "green", "blue", "scan"]);
        assert_eq!(cloud.fields()[4].values, [0.0, 0.0, 1.0]);
        assert_eq!(cloud.coordinates(), [0.0, 0.0, 1.0, 1.0, 0.0, 2.0, 1.0, 1.0, 3.0]);
        assert!(xyz("0 0 1\n7\n1 1 3\n").is_err(), "only where the first line is a number of points");
    }

    #[test]
    fn the_columns_of_a_pts_file_are_named_as_scanners_write_them() {
        let cloud = xyz("1\n1 2 3 -700 10 20 30\n").unwrap();
        assert_eq!(names(&cloud), ["intensity", "red", "green", "blue"]);
        assert_eq!(names(&xyz("1\n1 2 3 10 20 30\n").unwrap()), ["red", "green", "blue"]);
        assert_eq!(names(&xyz("1\n1 2 3 9\n").unwrap()), ["intensity"]);
        assert_eq!(names(&xyz("1\n1 2 3 9 9\n").unwrap()), ["column4", "column5"]);
    }

    #[test]
    fn commas_and_semicolons_separate_where_they_stand() {
        for text in ["1,2,3,4\n5,6,7,8\n", "# a comment\nx;y;z;column4\n1;2;3;4\n5;6;7;8"] {
            assert_eq!(xyz(text).unwrap(), xyz("1 2 3 4\n5 6 7 8\n").unwrap());
        }
    }

    #[test]
    fn a_single_column_is_a_cloud_on_a_line() {
        let cloud = xyz("3\n1\n2\n").unwrap();
        assert_eq!((cloud.dimension(), cloud.len()), (1, 3));
    }

    #[test]
    fn the_caller_chooses_the_dimension() {
        let options = ReadOptions { dimension: Some(4), ..ReadOptions::default() };
        let cloud = read(b"x y z w i\n1 2 3 4 5\n", &options).unwrap();
        assert_eq!((cloud.dimension(), names(&cloud)), (4, vec!["i"]));
        let error = read(b"1 2 3\n", &options).unwrap_err();
        assert_eq!(error, ReadError::DimensionColumns { dimension: 4, columns: 3 });
        let options = ReadOptions { dimension: Some(9), ..ReadOptions::default() };
        let error = read(b"1 2 3 4 5 6 7 8 9\n", &options).unwrap_err();
        assert_eq!(error, ReadError::Dimension { dimension: 9, dimension_max: 8 });
    }

    #[test]
    fn an_incomplete_last_line_is_refused_by_its_number() {
        let error = xyz("1 2 3\n4 5 6\n7 8").unwrap_err();
        assert!(matches!(error, ReadError::Truncated { location: Location::Line(3), .. }), "{error}");
        let error = xyz("1 2 3\n4 5\n7 8 9").unwrap_err();
        assert!(matches!(error, ReadError::Malformed { location: Location::Line(2), .. }), "{error}");
    }

    #[test]
    fn non_finite_words_are_left_to_the_policy() {
        assert_eq!(xyz("1 2 3\n1 nan 3\n").unwrap_err(), CloudError::NonFinite { row: 1 }.into());
        let options = ReadOptions { policy: NonFinite::Drop, ..ReadOptions::default() };
        let cloud = read(b"1 2 3\n1 -inf 3\n", &options).unwrap();
        assert_eq!((cloud.len(), cloud.nonfinite()), (2, 1));
    }

    #[test]
    fn every_limit_is_held() {
        let limits = super::super::Limits { points_max: 2, fields_max: 1, ..super::super::Limits::default() };
        let options = ReadOptions { limits, ..ReadOptions::default() };
        assert_eq!(
            read(b"1 2 3\n1 2 3\n1 2 3\n", &options).unwrap_err(),
            ReadError::TooManyPoints { points: 3, points_max: 2 }
        );
        assert_eq!(
            read(b"1 2 3 4 5\n", &options).unwrap_err(),
            ReadError::TooManyFields { fields: 2, fields_max: 1 }
        );
        assert!(matches!(read(b"9\n1 2 3\n", &options).unwrap_err(), ReadError::TooManyPoints { .. }));
    }

    #[test]
    fn a_file_of_comments_is_empty() {
        assert_eq!(xyz("# nothing\n\n").unwrap_err(), ReadError::NoRows { format: Format::Xyz });
    }
}
