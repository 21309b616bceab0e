//! XYZ, TXT and PTS: a point per line, columns separated by blanks, or by what CSV has.
//!
//! `#` and `//` begin comments. A line with a single whole number before the first row is the number of points
//! (PTS). Column names may stand in a line of their own or in the last comment before the first row, as
//! CloudCompare writes them (`//X Y Z Intensity`).

use super::table::{self, Dialect};
use super::text::{Lines, count_at};
use super::{Format, Location, ReadError, ReadOptions, csv};
use crate::cloud::PointCloud;

const DIALECT: Dialect = Dialect { format: Format::Xyz, separator: None };

pub(super) fn read(bytes: &[u8], options: &ReadOptions) -> Result<PointCloud, ReadError> {
    let mut suggested = None;
    let mut lines = Lines::new(bytes);
    let (first, after) = loop {
        let before = lines.clone();
        let line = lines.next().ok_or(ReadError::Empty)?;
        let text = DIALECT.content(&line);
        if !text.is_empty() {
            break (text, before);
        }
        let comment = line.text.trim_ascii_start();
        let comment = comment.strip_prefix(b"//").or_else(|| comment.strip_prefix(b"#")).unwrap_or_default();
        suggested = DIALECT.names(comment).filter(|names| names.iter().any(|n| n.eq_ignore_ascii_case("x")));
    };
    // A .txt may be a table of any kind.
    if first.iter().any(|mark| matches!(mark, b',' | b';')) {
        return csv::read(bytes, options);
    }
    if let Some(names) = DIALECT.names(first) {
        return table::read(DIALECT, Some(&names), None, lines, options);
    }
    match announced(first, &lines) {
        Some(points) => {
            options.limits.points(points)?;
            let last = lines.clone().map(|line| line.number).last().unwrap_or(lines.number());
            let names = suggested.or_else(|| scanned(&lines));
            let cloud = table::read(DIALECT, None, names.as_deref(), lines, options)?;
            check_count(cloud, points, last)
        }
        None => table::read(DIALECT, None, suggested.as_deref(), after, options),
    }
}

/// The number of points, if the first line is one: it stands alone in its line, and the next row has more.
fn announced(first: &[u8], lines: &Lines<'_>) -> Option<usize> {
    let next = lines.clone().map(|line| DIALECT.content(&line)).find(|text| !text.is_empty())?;
    let alone = DIALECT.split(first).len() == 1 && DIALECT.split(next).len() > 1;
    if alone { count_at(first, "number of points", Format::Xyz, 1).ok() } else { None }
}

/// Names of the columns that PTS files of scanners have behind their number of points: intensity, colour, or both.
fn scanned(lines: &Lines<'_>) -> Option<Vec<String>> {
    let row = lines.clone().map(|line| DIALECT.content(&line)).find(|text| !text.is_empty())?;
    let names: &[&str] = match DIALECT.split(row).len() {
        4 => &["x", "y", "z", "intensity"],
        6 => &["x", "y", "z", "red", "green", "blue"],
        7 => &["x", "y", "z", "intensity", "red", "green", "blue"],
        _ => return None,
    };
    Some(names.iter().map(|&name| name.to_owned()).collect())
}

fn check_count(cloud: PointCloud, announced: usize, last: usize) -> Result<PointCloud, ReadError> {
    let found = cloud.len();
    let message = format!("the first line announces {announced} points, {found} follow");
    match found.cmp(&announced) {
        std::cmp::Ordering::Equal => Ok(cloud),
        std::cmp::Ordering::Less => {
            Err(ReadError::Truncated { format: Format::Xyz, location: Location::Line(last), message })
        }
        std::cmp::Ordering::Greater => Err(ReadError::line(Format::Xyz, last, message)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
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
    fn the_count_of_a_pts_file_is_held_against_its_rows() {
        assert_eq!(xyz("2\n1 2 3\n4 5 6\n").unwrap().len(), 2);
        let error = xyz("3\n1 2 3\n4 5 6\n").unwrap_err();
        assert_eq!(
            error.to_string(),
            "XYZ, line 3: the file ends too early: the first line announces 3 points, 2 follow"
        );
        assert!(matches!(xyz("1\n1 2 3\n4 5 6\n").unwrap_err(), ReadError::Malformed { .. }));
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
        assert_eq!(xyz("# nothing\n\n").unwrap_err(), ReadError::Empty);
    }
}
