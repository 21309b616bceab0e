//! The viewer: a page that shows clouds and their modes in a browser.
//!
//! The files beside this one are ES modules, a style sheet and a page, written by hand and compiled in. The modules are
//! joined into one script when the page is first asked for (`join.rs`): a browser fetches three files
//! instead of thirty. Their addresses carry a digest of all of them, so that browsers may keep them forever.

mod join;

use std::fmt::Write as _;
use std::sync::LazyLock;

use sha2::{Digest, Sha256};

use crate::picture;

/// Name and text of a module of this folder.
macro_rules! modules {
    ($($name:literal),* $(,)?) => {
        [$(($name, include_str!(concat!($name, ".js")))),*]
    };
}

/// What draws, in the order of imports: also part of a page that a user saves.
const KERNEL: [(&str, &str); 4] = modules!["camera", "colors", "shaders", "scene"];
/// Turns a saved page into a view.
const SAVED: [(&str, &str); 1] = modules!["page"];
/// The rest of the viewer, in the order of imports.
const VIEWER: [(&str, &str); 21] = modules![
    "dom", "state", "api", "npy", "cloud", "modes", "filter", "legend", "coloring", "keep", "fallback",
    "surface", "point", "sample", "upload", "list", "follow", "gestures", "controls", "spectrum", "render",
];
/// What begins.
const MAIN: [(&str, &str); 2] = modules!["session", "main"];

/// Where the files are, before their digest.
pub const FOLDER: &str = "/viewer";

/// A file of the page.
#[derive(Debug)]
pub struct Asset {
    /// Last part of its address.
    pub name: &'static str,
    /// What it is.
    pub media_type: &'static str,
    /// Its text.
    pub text: String,
}

/// The page and its files.
#[derive(Debug)]
pub struct Viewer {
    /// Part of the address of every file: changes with any of them.
    pub digest: String,
    /// What the page loads.
    pub assets: Vec<Asset>,
    page: String,
}

/// The viewer of this version.
pub static CURRENT: LazyLock<Viewer> = LazyLock::new(Viewer::build);

impl Viewer {
    fn build() -> Self {
        let palette = palette();
        let palette = [("palette", palette.as_str())];
        let script = |parts: &[&[(&str, &str)]]| join::script(&[&palette, &KERNEL[..]], parts);
        let asset = |name, media_type, text| Asset { name, media_type, text };
        let javascript = "text/javascript";
        let assets = vec![
            asset("main.js", javascript, script(&[&VIEWER, &MAIN])),
            asset("page.js", javascript, script(&[&SAVED])),
            asset("neighbors.js", javascript, join::lean(include_str!("neighbors.js"))),
            asset("style.css", "text/css", join::lean(include_str!("style.css"))),
            asset("icon.svg", "image/svg+xml", include_str!("icon.svg").to_owned()),
        ];
        let mut digest = Sha256::new();
        for Asset { name, text, .. } in &assets {
            digest.update(name);
            digest.update(text);
        }
        let digest = hexadecimal(&digest.finalize()[..8]);
        let page = join::lean(include_str!("index.html")).replace("ASSETS", &format!("{FOLDER}/{digest}"));
        Self { digest, assets, page }
    }

    /// The file of this name in the folder of this digest.
    #[must_use]
    pub fn asset(&self, digest: &str, name: &str) -> Option<&Asset> {
        self.assets.iter().find(|asset| digest == self.digest && asset.name == name)
    }

    /// The page, with what browsers without scripts show.
    #[must_use]
    pub fn page(&self, without_scripts: &str) -> String {
        self.page.replace("NOSCRIPT", without_scripts)
    }
}

/// The colors of the service's pictures as a module.
fn palette() -> String {
    let table = |map: picture::Map| hexadecimal(map.srgb().as_flattened());
    let mut text = String::from("export const PALETTE = {\n");
    let colors = [
        ("diverging", table(picture::Map::diverging())),
        ("sequential", table(picture::Map::sequential())),
        ("plain", hexadecimal(&picture::srgb(picture::PLAIN))),
        ("absent", hexadecimal(&picture::srgb(picture::ABSENT))),
        ("mark", hexadecimal(&picture::srgb(picture::MARK))),
    ];
    for (name, digits) in colors {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{name}: '{digits}',");
    }
    text + "};\n"
}

fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use super::*;

    fn compressed(text: &str) -> usize {
        let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
        encoder.write_all(text.as_bytes()).unwrap();
        encoder.finish().unwrap().len()
    }

    #[test]
    fn the_page_and_its_files_are_at_most_40_kilobytes_compressed() {
        // The part of saved pages is fetched when one is saved.
        let files: usize = CURRENT
            .assets
            .iter()
            .filter(|file| file.name != "page.js")
            .map(|file| compressed(&file.text))
            .sum();
        let size = files + compressed(&CURRENT.page(""));
        println!("the viewer has {size} bytes compressed by gzip");
        assert!(size <= 40_000, "{size}");
    }

    #[test]
    fn every_file_of_the_folder_is_part_of_the_viewer() {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("src/viewer");
        let known: Vec<&str> = KERNEL
            .iter()
            .chain(&SAVED)
            .chain(&VIEWER)
            .chain(&MAIN)
            .map(|(name, _)| *name)
            .chain(["neighbors"])
            .collect();
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_some_and(|extension| extension == "js") {
                let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
                assert!(known.contains(&name.as_str()), "{name}.js is not in the lists of modules");
            }
        }
    }

    #[test]
    fn the_page_names_its_files_by_their_digest_and_nothing_from_elsewhere() {
        let page = CURRENT.page("");
        assert!(page.contains(&format!("src=\"/viewer/{}/main.js\"", CURRENT.digest)), "{page}");
        assert!(CURRENT.asset(&CURRENT.digest, "style.css").is_some());
        assert!(CURRENT.asset("0000", "style.css").is_none());
        for text in CURRENT.assets.iter().map(|asset| asset.text.as_str()).chain([page.as_str()]) {
            let outside = text.replace("http://www.w3.org/2000/svg", "");
            assert!(!outside.contains("http://") && !outside.contains("https://"), "{text}");
            assert!(!text.contains("innerHTML"), "text of files is never read as HTML");
        }
    }

    #[test]
    fn the_colors_are_those_of_the_pictures() {
        let palette = palette();
        let (first, last) = (picture::Map::diverging().srgb()[0], picture::Map::diverging().srgb()[255]);
        assert!(palette.contains(&format!("diverging: '{}", hexadecimal(&first))), "{palette}");
        assert!(palette.contains(&format!("{}',\nsequential", hexadecimal(&last))), "{palette}");
    }
}
