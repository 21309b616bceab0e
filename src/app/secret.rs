//! A setting that is not to be seen in logs and messages.

use std::convert::Infallible;
use std::fmt;
use std::str::FromStr;

/// A text that shows itself only when asked to.
#[derive(Clone)]
pub struct Secret(String);

impl Secret {
    pub(super) fn reveal(&self) -> &str {
        &self.0
    }
}

impl FromStr for Secret {
    type Err = Infallible;

    fn from_str(text: &str) -> Result<Self, Infallible> {
        Ok(Self(text.to_owned()))
    }
}

impl fmt::Debug for Secret {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Secret(…)")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_secret_is_not_shown() {
        let Ok(secret) = Secret::from_str("alpha");
        assert_eq!(secret.reveal(), "alpha");
        assert!(!format!("{secret:?}").contains("alpha"));
    }
}
