//! What a cloud is called in listings: a name that the client gives, or that of its file.

use crate::arguments::arguments;
use crate::http::wire::problem::Problem;

arguments! {
    /// What the cloud is called in listings.
    #[derive(Debug, Clone)]
    pub(crate) struct Naming {
        /// Name of the cloud in listings, 200 characters at most. Content that is there already keeps its name.
        #[alias = "file_name"]
        name: Option<String> = text, absent "the file's name, from the path or the multipart part";
    }
}

/// Characters of a name.
const NAME_LENGTH_MAX: usize = 200;

/// The name that is asked for, else that of the file without folders.
///
/// # Errors
/// A problem: too long, or with characters that cannot be shown.
pub(crate) fn of(asked: Option<&str>, file: Option<&str>) -> Result<Option<String>, Problem> {
    let is_shown = |name: &str| {
        !name.is_empty()
            && name.chars().count() <= NAME_LENGTH_MAX
            && !name.contains(|c: char| c.is_control())
    };
    match asked {
        Some(name) if is_shown(name) => Ok(Some(name.to_owned())),
        Some(_) => {
            let told = format!("`name` must be 1 to {NAME_LENGTH_MAX} printable characters");
            Err(Problem::invalid("name", told))
        }
        None => Ok(file
            .and_then(|file| file.rsplit(['/', '\\']).next())
            .filter(|name| is_shown(name))
            .map(str::to_owned)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::http::wire::problem::Kind;

    #[test]
    fn a_cloud_is_called_like_its_file_unless_it_is_told_otherwise() {
        let named = |asked, file| of(asked, file).map_err(|problem| problem.kind());
        assert_eq!(named(None, Some("scans/head.ply")), Ok(Some("head.ply".to_owned())));
        assert_eq!(named(None, Some("C:\\scans\\head.ply")), Ok(Some("head.ply".to_owned())));
        assert_eq!(named(Some("the bust"), Some("head.ply")), Ok(Some("the bust".to_owned())));
        assert_eq!(named(None, None), Ok(None));
        // A file's name is not the client's choice of words: what cannot be shown is left out.
        assert_eq!(named(None, Some("a\nb")), Ok(None));
        for refused in ["", "a\nb", &"x".repeat(NAME_LENGTH_MAX + 1)] {
            assert_eq!(named(Some(refused), None), Err(Kind::InvalidParameter), "{refused:?}");
        }
    }
}
