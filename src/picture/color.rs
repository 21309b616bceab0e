//! Color maps, even to the eye and safe for the color-blind.
//!
//! Both are curves in Oklab [Ottosson 2020, "A perceptual color space for image processing"] through a few colors, cut
//! into steps of equal length. The diverging map follows `vik` [Crameri 2018, "Scientific color maps"]: blue and
//! orange, which no common deficiency confuses, equally dark at equal distance from a pale zero. The sequential map
//! follows cividis [Nuñez, Anderton, Renslow 2018, PLOS ONE 13(7)]: dark blue to yellow, ever brighter. Tests hold
//! evenness, and distances as seen with deficiencies.

/// Red, green and blue, linear in light, 0 to 1.
pub type Rgb = [f32; 3];

/// Points without a function.
pub const PLAIN: Rgb = [0.62, 0.62, 0.60];
/// Points without a value.
pub const ABSENT: Rgb = [0.21, 0.21, 0.21];
/// Feature points: a red that neither map has.
pub const MARK: Rgb = [0.75, 0.02, 0.10];

/// Colors of a map.
const STEPS: usize = 256;
/// Points of the curve that are measured to cut it evenly.
const MEASURED: usize = 2048;

/// Lightness, and the coordinates green–red and blue–yellow.
type Lab = [f64; 3];

/// The negative half of the diverging map, from zero outwards, and the positive one.
const NEGATIVE: [Lab; 3] = [[0.95, 0.0, 0.0], [0.66, -0.045, -0.105], [0.36, -0.02, -0.12]];
const POSITIVE: [Lab; 3] = [[0.95, 0.0, 0.0], [0.66, 0.085, 0.085], [0.36, 0.09, 0.05]];
const SEQUENTIAL: [Lab; 4] =
    [[0.27, -0.01, -0.085], [0.48, -0.005, -0.02], [0.69, 0.0, 0.055], [0.9, -0.02, 0.145]];

/// A table of colors from 0 to 1.
#[derive(Debug, Clone)]
pub struct Map(Vec<Rgb>);

impl Map {
    /// Blue, pale, orange: for numbers about zero, which is at 0.5.
    #[must_use]
    pub fn diverging() -> Self {
        let half = STEPS / 2;
        let mut colors: Vec<Rgb> = even(&NEGATIVE, half).into_iter().rev().map(to_rgb).collect();
        colors.extend(even(&POSITIVE, half).into_iter().map(to_rgb));
        Self(colors)
    }

    /// Dark blue to yellow: for numbers from least to greatest.
    #[must_use]
    pub fn sequential() -> Self {
        Self(even(&SEQUENTIAL, STEPS).into_iter().map(to_rgb).collect())
    }

    /// The color of a share from 0 to 1; beyond, the last one.
    #[must_use]
    pub fn at(&self, share: f64) -> Rgb {
        let last = self.0.len() - 1;
        self.0[((share * last as f64).round().max(0.0) as usize).min(last)]
    }

    /// All colors from 0 to 1, as screens take them.
    #[must_use]
    pub fn srgb(&self) -> Vec<[u8; 3]> {
        self.0.iter().map(|&color| srgb(color)).collect()
    }
}

/// `count` colors at equal distances along the smooth curve through some.
fn even(through: &[Lab], count: usize) -> Vec<Lab> {
    let curve: Vec<Lab> = (0..=MEASURED).map(|i| spline(through, i as f64 / MEASURED as f64)).collect();
    let mut traveled = vec![0.0];
    for pair in curve.windows(2) {
        traveled.push(traveled[traveled.len() - 1] + distance(pair[0], pair[1]));
    }
    let whole = traveled[MEASURED];
    let at = |step: usize| {
        let wanted = whole * step as f64 / (count - 1) as f64;
        curve[traveled.partition_point(|&length| length < wanted).min(MEASURED)]
    };
    (0..count).map(at).collect()
}

/// Catmull–Rom through the colors, the ends doubled.
fn spline(through: &[Lab], share: f64) -> Lab {
    let along = share * (through.len() - 1) as f64;
    let segment = (along as usize).min(through.len() - 2);
    let t = along - segment as f64;
    let point = |offset: usize| {
        let index = (segment + offset).saturating_sub(1).min(through.len() - 1);
        through[index]
    };
    let [a, b, c, d] = [0, 1, 2, 3].map(point);
    [0, 1, 2].map(|i| {
        let (a, b, c, d) = (a[i], b[i], c[i], d[i]);
        b + 0.5 * t * (c - a + t * (2.0 * a - 5.0 * b + 4.0 * c - d + t * (3.0 * (b - c) + d - a)))
    })
}

fn distance(a: Lab, b: Lab) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

/// Oklab to linear sRGB, with the matrices of Ottosson's reference.
fn to_rgb([l, a, b]: Lab) -> Rgb {
    let cube = |x: f64| x * x * x;
    let [l, m, s] = [
        cube(l + 0.396_337_777_4 * a + 0.215_803_757_3 * b),
        cube(l - 0.105_561_345_8 * a - 0.063_854_172_8 * b),
        cube(l - 0.089_484_177_5 * a - 1.291_485_548_0 * b),
    ];
    [
        4.076_741_662_1 * l - 3.307_711_591_3 * m + 0.230_969_929_2 * s,
        -1.268_438_004_6 * l + 2.609_757_401_1 * m - 0.341_319_396_5 * s,
        -0.004_196_086_3 * l - 0.703_418_614_7 * m + 1.707_614_701_0 * s,
    ]
    .map(|x| x.clamp(0.0, 1.0) as f32)
}

/// The bytes of a color as screens take them.
#[must_use]
pub fn srgb(color: Rgb) -> [u8; 3] {
    color.map(to_srgb)
}

/// A byte of sRGB [IEC 61966-2-1].
pub(super) fn to_srgb(linear: f32) -> u8 {
    let linear = linear.clamp(0.0, 1.0);
    let encoded = if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 };
    (encoded * 255.0).round() as u8
}

#[cfg(test)]
#[allow(clippy::float_cmp)] // the same color, to the bit
mod tests {
    use super::*;

    /// Linear sRGB to Oklab [Ottosson 2020].
    fn to_lab([r, g, b]: [f64; 3]) -> Lab {
        let l = (0.412_221_470_8 * r + 0.536_332_536_3 * g + 0.051_445_992_9 * b).cbrt();
        let m = (0.211_903_498_2 * r + 0.680_699_545_1 * g + 0.107_396_956_6 * b).cbrt();
        let s = (0.088_302_461_9 * r + 0.281_718_837_6 * g + 0.629_978_700_5 * b).cbrt();
        [
            0.210_454_255_3 * l + 0.793_617_785_0 * m - 0.004_072_046_8 * s,
            1.977_998_495_1 * l - 2.428_592_205_0 * m + 0.450_593_709_9 * s,
            0.025_904_037_1 * l + 0.782_771_766_2 * m - 0.808_675_766_0 * s,
        ]
    }

    /// Colors as seen without one kind of cone: the matrices for severity 1 of Machado, Oliveira, Fernandes 2009,
    /// "A physiologically-based model for simulation of color vision deficiency", table 1.
    #[allow(clippy::unreadable_literal)] // as in the table
    const DEFICIENCIES: [(&str, [[f64; 3]; 3]); 3] = [
        (
            "protan",
            [
                [0.152286, 1.052583, -0.204868],
                [0.114503, 0.786281, 0.099216],
                [-0.003882, -0.048116, 1.051998],
            ],
        ),
        (
            "deutan",
            [
                [0.367322, 0.860646, -0.227968],
                [0.280085, 0.672501, 0.047413],
                [-0.011820, 0.042940, 0.968881],
            ],
        ),
        (
            "tritan",
            [
                [1.255528, -0.076749, -0.178779],
                [-0.078411, 0.930809, 0.147602],
                [0.004733, 0.691367, 0.303900],
            ],
        ),
    ];

    fn seen(rgb: Rgb, matrix: &[[f64; 3]; 3]) -> Lab {
        let rgb = rgb.map(f64::from);
        to_lab(matrix.map(|row| row.iter().zip(rgb).map(|(m, x)| m * x).sum::<f64>().clamp(0.0, 1.0)))
    }

    fn lab(rgb: Rgb) -> Lab {
        to_lab(rgb.map(f64::from))
    }

    #[test]
    fn no_color_of_either_map_lies_outside_of_what_screens_show() {
        for through in [&NEGATIVE[..], &POSITIVE, &SEQUENTIAL] {
            for color in even(through, 64) {
                assert!(
                    distance(lab(to_rgb(color)), color) < 2e-3,
                    "{color:?} is cut to {:?}",
                    to_rgb(color)
                );
            }
        }
    }

    #[test]
    fn steps_are_even() {
        for map in [Map::diverging(), Map::sequential()] {
            let steps: Vec<f64> = map
                .0
                .windows(2)
                .map(|pair| distance(lab(pair[0]), lab(pair[1])))
                .filter(|&d| d > 1e-6)
                .collect();
            let mean = steps.iter().sum::<f64>() / steps.len() as f64;
            assert!(steps.iter().all(|step| (step / mean - 1.0).abs() < 0.25), "{steps:?}");
        }
    }

    #[test]
    fn the_signs_are_equally_dark_and_told_apart_with_every_deficiency() {
        let map = Map::diverging();
        for (name, matrix) in DEFICIENCIES {
            for share in [0.25, 0.5, 1.0] {
                let [negative, positive] = [0.5 - share / 2.0, 0.5 + share / 2.0].map(|at| map.at(at));
                let darkness = lab(negative)[0] - lab(positive)[0];
                assert!(darkness.abs() < 0.02, "{share}: {darkness}");
                let apart = distance(seen(negative, &matrix), seen(positive, &matrix));
                // 0.02 in Oklab is about what the eye just tells apart side by side.
                assert!(apart > 0.06, "{name}, {share}: {apart}");
            }
        }
    }

    #[test]
    fn the_sequential_map_grows_brighter_with_every_deficiency() {
        let map = Map::sequential();
        for (name, matrix) in DEFICIENCIES {
            let lightness: Vec<f64> = map.0.iter().map(|&color| seen(color, &matrix)[0]).collect();
            let grows = lightness.windows(2).all(|pair| pair[1] > pair[0] - 1e-3);
            assert!(grows && lightness[STEPS - 1] - lightness[0] > 0.5, "{name}");
        }
    }

    #[test]
    fn shares_beyond_the_ends_have_the_last_color() {
        let map = Map::sequential();
        assert_eq!(map.at(-3.0), map.at(0.0));
        assert_eq!(map.at(7.0), map.at(1.0));
        assert_eq!((to_srgb(0.0), to_srgb(1.0), to_srgb(0.214)), (0, 255, 127));
    }
}
