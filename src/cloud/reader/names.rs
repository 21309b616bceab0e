//! Finds the columns that are coordinates by the names that programs give them.

use super::columns::axis;

/// Words that stand before or behind the letter of an axis: `POINT_X` of `ArcGIS`, `Points:0` of `ParaView`, `cartesianX`
/// of E57, `pos_x`.
const STEMS: [&str; 25] = [
    "points_m_xyz",
    "field",
    "points",
    "point",
    "positions",
    "position",
    "pos",
    "coordinates",
    "coordinate",
    "coords",
    "coord",
    "cartesian",
    "location",
    "loc",
    "world",
    "local",
    "scan",
    "global",
    "utm",
    "vertex",
    "vertices",
    "center",
    "centre",
    "xyz",
    "p",
];
/// Lengths that stand behind a name without brackets: `X/m`, `x_mm`, `x, ft`.
const UNITS: [&str; 8] = ["m", "mm", "cm", "km", "ft", "usft", "meter", "meters"];
const EAST: [&str; 8] = ["easting", "east", "e", "rechtswert", "utm_e", "utm_east", "e_coord", "eastings"];
const NORTH: [&str; 8] = ["northing", "north", "n", "hochwert", "utm_n", "utm_north", "n_coord", "northings"];
const LONGITUDE: [&str; 3] = ["longitude", "lon", "lng"];
const LATITUDE: [&str; 2] = ["latitude", "lat"];
const HEIGHT: [&str; 12] = [
    "height",
    "elevation",
    "elev",
    "altitude",
    "alt",
    "z",
    "z_coord",
    "up",
    "orthoheight",
    "hoehe",
    "höhe",
    "h",
];

/// Where the coordinates stand among named columns.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Axes {
    /// The axis of every column; `None` for the others.
    pub(super) of_column: Vec<Option<usize>>,
    /// What the caller should know of the choice.
    pub(super) note: Option<String>,
}

/// A way to name axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Family {
    /// `x`, `y`, `z`, `coordinate_3`…
    Plain,
    /// The same with a unit behind them.
    Measured,
    /// A stem of [`STEMS`] and a letter.
    Lettered(&'static str),
    /// A stem of [`STEMS`] and a number from 0.
    Numbered(&'static str),
    /// East, north.
    Grid,
    /// Longitude, latitude.
    Degrees,
}

/// The columns that are coordinates. Of names that repeat the first counts. `None` when no columns are named as
/// coordinates are.
pub(super) fn axes(names: &[String]) -> Option<Axes> {
    let words: Vec<String> = names.iter().map(|name| plain(name)).collect();
    let found: Vec<Option<(Family, usize)>> = words.iter().map(|word| family(word)).collect();
    let mut families: Vec<Family> = Vec::new();
    for (family, _) in found.iter().flatten() {
        if !families.contains(family) {
            families.push(*family);
        }
    }
    families.sort_by_key(|family| *family != Family::Plain);
    families.into_iter().find_map(|family| {
        let mut of_column = vec![None; names.len()];
        let mut taken = Vec::new();
        for (place, axis) in found.iter().enumerate().filter_map(|(i, f)| f.map(|(_, axis)| (i, axis))) {
            if found[place].is_some_and(|(of, _)| of == family) && !taken.contains(&axis) {
                taken.push(axis);
                of_column[place] = Some(axis);
            }
        }
        let mut note = None;
        if taken.contains(&0) && taken.contains(&1) && !taken.contains(&2) {
            let height = height(&words, &of_column, family);
            if let Some(place) = height {
                of_column[place] = Some(2);
                taken.push(2);
                if family == Family::Plain {
                    note = Some(format!("the column `{}` was taken as z", names[place].trim()));
                }
            }
        }
        if family == Family::Degrees {
            note = Some(
                "longitude and latitude were taken as x and y as they are; degrees are not lengths, project them first"
                    .to_owned(),
            );
        }
        taken.sort_unstable();
        let is_whole = !taken.is_empty() && taken.iter().enumerate().all(|(i, &axis)| i == axis);
        // One column alone is a cloud on a line only if it is called x.
        (is_whole && (taken.len() > 1 || family == Family::Plain)).then_some(Axes { of_column, note })
    })
}

/// The column of heights beside two named axes.
fn height(words: &[String], of_column: &[Option<usize>], family: Family) -> Option<usize> {
    // Beside x and y, `h` may be anything.
    let names = if family == Family::Plain { &HEIGHT[..5] } else { &HEIGHT };
    names.iter().find_map(|name| (0..words.len()).find(|&i| of_column[i].is_none() && words[i] == *name))
}

/// A name in lower case, without quotes, comment marks and a unit in brackets.
fn plain(name: &str) -> String {
    let name = name.trim().trim_start_matches(['#', '/']).trim().trim_matches('"').trim_matches('\'').trim();
    let (before, within) = match name.rfind(['[', '(', '{']) {
        Some(start) if start > 0 && name.ends_with([']', ')', '}']) => {
            (name[..start].trim_end(), &name[start + 1..name.len() - 1])
        }
        _ => (name, ""),
    };
    // Of the path of a message in ROS, `field.pose.position.x`, the last two steps.
    let start = before.rmatch_indices('.').nth(1).map_or(0, |(at, _)| at + 1);
    let plain = before[start..].to_lowercase().replace([' ', '-', '.'], "_");
    // `position[0]` is a place and no unit.
    if matches!(within, "0" | "1" | "2") { format!("{plain}:{within}") } else { plain }
}

/// The name before a unit, if it has one.
fn without_unit(word: &str) -> Option<&str> {
    let (name, unit) = word.rsplit_once(['/', ',', '_'])?;
    UNITS.contains(&unit).then(|| name.trim_end_matches([',', '_']))
}

fn family(word: &str) -> Option<(Family, usize)> {
    if let Some(axis) = axis(word) {
        return Some((Family::Plain, axis));
    }
    if let Some(named) = without_unit(word) {
        return family(named).map(|(family, axis)| match family {
            Family::Plain => (Family::Measured, axis),
            other => (other, axis),
        });
    }
    for (names, found) in [
        (EAST.as_slice(), (Family::Grid, 0)),
        (&NORTH, (Family::Grid, 1)),
        (&LONGITUDE, (Family::Degrees, 0)),
        (&LATITUDE, (Family::Degrees, 1)),
    ] {
        if names.contains(&word) {
            return Some(found);
        }
    }
    STEMS.iter().find_map(|stem| {
        let rest = word.strip_prefix(stem).or_else(|| word.strip_suffix(stem))?;
        match rest.trim_matches(['_', ':']) {
            "x" => Some((Family::Lettered(stem), 0)),
            "y" => Some((Family::Lettered(stem), 1)),
            "z" => Some((Family::Lettered(stem), 2)),
            "0" if word.len() > stem.len() => Some((Family::Numbered(stem), 0)),
            "1" => Some((Family::Numbered(stem), 1)),
            "2" => Some((Family::Numbered(stem), 2)),
            _ => None,
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(header: &str) -> Option<Vec<Option<usize>>> {
        let names: Vec<String> = header.split(',').map(str::to_owned).collect();
        axes(&names).map(|axes| axes.of_column)
    }

    #[test]
    fn the_names_of_many_programs_are_known() {
        let behind_id = Some(vec![None, Some(0), Some(1), Some(2)]);
        for header in [
            "id,x,y,z",
            "id,X [m],Y [m],Z [m]",
            "id,\"X (ft)\",\"Y (ft)\",\"Z (ft)\"",
            "id,easting,northing,height",
            "id,Easting,Northing,Elevation",
            "id,E,N,H",
            "id,X/m,Y/m,Z/m",
            "id,x_mm,y_mm,z_mm",
            "id,Easting_m,Northing_m,height",
            "%time,field.point.x,field.point.y,field.point.z",
            "%time,field.x,field.y,field.z",
            "id,position[0],position[1],position[2]",
            "t,Points_m_XYZ:0,Points_m_XYZ:1,Points_m_XYZ:2",
            "id,Rechtswert,Hochwert,Höhe",
            "OBJECTID,POINT_X,POINT_Y,POINT_Z",
            "class,Points:0,Points:1,Points:2",
            "class,Points_0,Points_1,Points_2",
            "intensity,cartesianX,cartesianY,cartesianZ",
            "id,pos.x,pos.y,pos.z",
            "id,X-Coord,Y-Coord,Z-Coord",
            "id,x_coordinate,y_coordinate,z_coordinate",
            "id,lon,lat,height",
            "id,x,y,elevation",
        ] {
            assert_eq!(found(header), behind_id, "{header}");
        }
    }

    #[test]
    fn the_first_of_a_name_counts_and_x_goes_before_easting() {
        assert_eq!(found("x,y,z,x"), Some(vec![Some(0), Some(1), Some(2), None]));
        assert_eq!(found("easting,northing,x,y,z"), Some(vec![None, None, Some(0), Some(1), Some(2)]));
        assert_eq!(found("x,value"), Some(vec![Some(0), None]));
    }

    #[test]
    fn other_names_are_not_guessed_at() {
        for header in ["a,b,c", "id,shot,time", "y,z", "east,value", "nx,ny,nz", "0,1,2", "x1,x2,x3"] {
            assert_eq!(found(header), None, "{header}");
        }
    }

    #[test]
    fn degrees_are_told_of() {
        let names = ["lon", "lat", "height"].map(str::to_owned);
        assert!(axes(&names).and_then(|axes| axes.note).is_some_and(|note| note.contains("degrees")));
    }
}
