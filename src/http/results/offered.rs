//! What has several formats: the formats on offer, and the argument that chooses among them.

use crate::arguments::{Absent, Accepts, Argument, Arguments, Value, arguments, words};
use crate::cloud::ScalarType;
use crate::http::wire::accept::{NPY, Offer, PLY};
use crate::picture::View;

words! {
    /// Type of numbers in files.
    pub(crate) enum Precision {
        /// Eight bytes.
        F64,
        /// Four bytes.
        F32,
    }
}

arguments! {
    /// Of resources that are offered as arrays.
    #[derive(Debug, Clone, Copy)]
    pub(crate) struct ArrayType {
        /// Type of the numbers in npy, and of results beside the points in npz and ply.
        dtype: Option<Precision> = word(Precision), absent "f64 for npy and npz, f32 for ply";
    }
}

impl ArrayType {
    /// The type of the numbers of an answer in this format.
    pub(crate) fn kind(self, offer: Offer) -> ScalarType {
        match (self.dtype, offer) {
            (Some(Precision::F32), _) | (None, PLY) => ScalarType::Float32,
            _ => ScalarType::Float64,
        }
    }

    /// The tag of an answer in this format: numbers of another type than usual are other bytes.
    pub(crate) fn tagged(self, tag: String, offer: Offer) -> String {
        let kind = self.kind(offer);
        if kind == Self::default().kind(offer) { tag } else { format!("{tag}-{}", kind.ply_name()) }
    }
}

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
    ($arguments:ty as $other:ident $(by $($view:ident).+)?, $formats:literal) => {
        impl $crate::http::results::offered::Resource for $arguments {
            const OFFERS: &'static [$crate::http::wire::accept::Offer] = $other::OFFERS;
            const NAMES: &'static [&'static str] = $other::NAMES;
            const FORMATS: &'static str = $formats;

            $(fn view(&self) -> $crate::picture::View {
                self.$($view).+
            })?
        }
    };
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

/// The arguments of a resource, and the type of numbers where it is offered as an array.
#[derive(Debug, Default)]
pub(crate) struct Typed<R> {
    /// Those of the resource.
    pub arguments: R,
    /// Of its numbers.
    pub array: ArrayType,
}

impl<R: Resource> Arguments for Typed<R> {
    fn table() -> Vec<Argument> {
        let mut table = R::table();
        if R::OFFERS.contains(&NPY) {
            table.extend(ArrayType::table());
        }
        table
    }

    fn set(&mut self, name: &str, value: &Value) -> bool {
        if ArrayType::table().iter().any(|argument| argument.name == name) {
            return self.array.set(name, value);
        }
        self.arguments.set(name, value)
    }
}

/// The same, and `?format=`.
#[derive(Debug, Default)]
pub(crate) struct Offered<R> {
    /// All but the format.
    pub typed: Typed<R>,
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
        let mut table = Typed::<R>::table();
        if R::OFFERS.len() > 1 {
            table.push(Self::format());
        }
        table
    }

    fn set(&mut self, name: &str, value: &Value) -> bool {
        if name != "format" {
            return self.typed.set(name, value);
        }
        self.format = R::OFFERS.iter().find(|offer| value.text() == Some(offer.name)).copied();
        self.format.is_some()
    }
}
