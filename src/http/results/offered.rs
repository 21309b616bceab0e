//! What has several formats: the formats on offer, and the argument that chooses among them.

use crate::arguments::{Absent, Accepts, Argument, Arguments, Value};
use crate::http::wire::accept::Offer;
use crate::picture::View;

/// A request for a resource in several formats: its arguments, and the format.
pub(crate) trait Resource: Arguments + Send + Sync + 'static {
    /// Formats, the default first.
    const OFFERS: &'static [Offer];
    /// Their names.
    const NAMES: &'static [&'static str];
    /// What each holds, to document `?format=`.
    const FORMATS: &'static str;

    /// How a picture is taken, where there is one on offer.
    fn view(&self) -> View {
        View::default()
    }
}

/// Says in which formats the resource of some arguments is offered.
macro_rules! offered {
    ($arguments:ty: [$($offer:expr),+ $(,)?] $(by $($view:ident).+)?, $formats:literal) => {
        impl $crate::http::results::offered::Resource for $arguments {
            const OFFERS: &'static [$crate::http::wire::accept::Offer] = &[$($offer),+];
            const NAMES: &'static [&'static str] = &[$($offer.name),+];
            const FORMATS: &'static str = $formats;

            $(fn view(&self) -> $crate::picture::View {
                self.$($view).+
            })?
        }
    };
}
pub(crate) use offered;

/// The arguments of a resource, and `?format=`.
#[derive(Debug, Default)]
pub(crate) struct Offered<R> {
    /// Those of the resource.
    pub arguments: R,
    /// The format that is named.
    pub format: Option<Offer>,
}

impl<R: Resource> Offered<R> {
    /// `?format=`.
    fn format() -> Argument {
        Argument {
            name: "format",
            alias: None,
            short: None,
            accepts: Accepts::Word(R::NAMES),
            absent: Absent::Words(|| format!("by Accept, else {}", R::OFFERS[0].name)),
            meaning: R::FORMATS,
        }
    }
}

impl<R: Resource> Arguments for Offered<R> {
    fn table() -> Vec<Argument> {
        let mut table = R::table();
        if R::OFFERS.len() > 1 {
            table.push(Self::format());
        }
        table
    }

    fn set(&mut self, name: &str, value: &Value) -> bool {
        if name != "format" {
            return self.arguments.set(name, value);
        }
        self.format = R::OFFERS.iter().find(|offer| value.text() == Some(offer.name)).copied();
        self.format.is_some()
    }
}
