//! CSV: a point per line, columns separated by commas, semicolons, tabs, or blanks.
//!
//! Not by the crate `csv`, which must be told the separator and knows no decimal commas, comments or counts of rows.

use super::{Format, ReadError, ReadOptions, table};
use crate::cloud::PointCloud;

pub(super) fn read(bytes: &[u8], options: &ReadOptions) -> Result<PointCloud, ReadError> {
    table::read(bytes, Format::Csv, options)
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
    fn a_header_that_names_no_coordinates_is_refused_unless_the_caller_says_where_they_are() {
        let text = b"shot,time,value,class\n1,2,3,4\n";
        let error = read(text, &ReadOptions::default()).unwrap_err().to_string();
        assert!(
            error.contains("`shot`, `time`, `value`, `class`") && error.contains("coordinates=3"),
            "{error}"
        );
        let options = ReadOptions { dimension: Some(3), ..ReadOptions::default() };
        let cloud = read(text, &options).unwrap();
        assert_eq!((cloud.dimension(), cloud.fields()[0].name.as_str()), (3, "class"));
    }

    #[test]
    fn a_field_is_never_called_as_an_axis_is() {
        let cloud = csv("x,y,z,x\n1,2,3,4\n").unwrap();
        assert_eq!((cloud.coordinates(), cloud.fields()[0].name.as_str()), (&[1.0, 2.0, 3.0][..], "x_2"));
    }

    #[test]
    fn the_separator_that_excel_is_told_counts() {
        for text in ["sep=;\nx;y;z\n0,5;1;2,25\n", "\"sep=;\"\r\n0,5;1;2,25\r\n"] {
            let cloud = csv(text).unwrap();
            assert_eq!(cloud.coordinates(), [0.5, 1.0, 2.25]);
            assert!(cloud.notes()[0].contains("decimal commas"));
        }
    }

    #[test]
    fn columns_of_text_are_left_out_and_told_of() {
        let cloud = csv("name,x,y,z,class\nP1,0.25,0,1,7\n\"P, 2\",1.5,0,2,tree\n").unwrap();
        assert_eq!(cloud.coordinates(), [0.25, 0.0, 1.0, 1.5, 0.0, 2.0]);
        assert!(cloud.fields().is_empty());
        assert!(
            cloud.notes()[0].contains("`name`") && cloud.notes()[1].contains("`class`"),
            "{:?}",
            cloud.notes()
        );
        let cloud = csv("P1,1,2,3,4,tree\nP2,5,6,7,8,rock\n").unwrap();
        assert_eq!(cloud.coordinates(), [1.0, 2.0, 3.0, 5.0, 6.0, 7.0]);
        assert_eq!((cloud.fields().len(), cloud.notes().len()), (1, 2));
        let error = csv("x,y,z\n1,2,3\n1,tree,3\n").unwrap_err().to_string();
        assert!(error.contains("line 3: `tree` is not a number"), "{error}");
    }

    #[test]
    fn empty_cells_and_words_for_them_are_missing_values() {
        let cloud = csv("x,y,z,i,j\n1,2,3,,NA\n4,5,6,7,null\n").unwrap();
        assert!(cloud.fields()[0].values[0].is_nan() && cloud.fields()[1].values[1].is_nan());
        assert_eq!(cloud.fields()[0].values[1].to_bits(), 7.0_f64.to_bits());
        let error = csv("x,y,z\n1,2,3\n1,,3\n").unwrap_err().to_string();
        assert!(error.contains("point 1"), "{error}");
    }

    #[test]
    fn a_separator_may_stand_behind_the_last_cell() {
        for text in [
            "x,y,z,\n1,2,3,\n4,5,6,\n",
            "1;2;3;\n4;5;6;\n",
            "x,y,z\n1,2,3,\n4,5,6\n",
            "x,y,z,\n1,2,3\n4,5,6,",
        ] {
            let cloud = csv(text).unwrap();
            assert_eq!(cloud.coordinates(), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0], "{text}");
            assert!(cloud.fields().is_empty(), "{text}");
        }
        assert_eq!(csv("1,2,3,\n4,5,6,7\n").unwrap().fields()[0].values[1].to_bits(), 7.0_f64.to_bits());
    }

    #[test]
    fn lines_of_prose_before_the_rows_are_passed_over_and_told_of() {
        let cloud = csv("measured by hand\nx,y,z\n1,2,3\n").unwrap();
        assert_eq!(cloud.coordinates(), [1.0, 2.0, 3.0]);
        assert!(cloud.notes()[0].contains("`measured by hand`"), "{:?}", cloud.notes());
        assert!(csv("nothing\nbut\nprose\n").unwrap_err().to_string().contains("no row of numbers"));
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
            "CSV, line 1: `abc` is not a number; decimal numbers such as -1.5e-3 are accepted"
        );
    }

    #[test]
    fn decimal_commas_are_read_where_commas_do_not_separate() {
        for text in ["0,5;0,25;1\n", "x\ty\tz\n0,5\t0,25\t1\n", "0,5 0,25 1\n"] {
            assert_eq!(csv(text).unwrap().coordinates(), [0.5, 0.25, 1.0], "{text}");
        }
        assert!(csv("1.000,5;2;3\n").unwrap_err().to_string().contains("`1.000,5` is not a number"));
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
