//! Whose a cloud or job is.

use std::sync::Arc;

/// Whom clouds and jobs belong to: a name, or nobody where no key is asked for. Nobody is an owner like any other:
/// what was stored without a key is out of reach of every key, and the other way round.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct Owner(Arc<str>);

impl Owner {
    /// The owner of what is stored where no key is asked for.
    #[must_use]
    pub fn nobody() -> Self {
        Self::named("")
    }

    /// The owner of this name.
    #[must_use]
    pub fn named(name: &str) -> Self {
        Self(name.into())
    }

    pub(super) fn name(&self) -> &str {
        &self.0
    }
}
