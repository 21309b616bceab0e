//! The macro that declares enums of words.

/// Declares an enum whose variants are words of the interface: each stands once, as its variant.
///
/// ```text
/// words! {
///     /// How something is done.
///     #[derive(Default)]
///     pub enum Way {
///         /// In the usual way: `as-usual`.
///         #[default]
///         AsUsual,
///         /// In another one; its word is not the name of the variant.
///         Other = "otherwise",
///     }
/// }
/// ```
///
/// Words are kebab-case: in queries, JSON, on the command line and in the OpenAPI document.
macro_rules! words {
    (
        $(#[$meta:meta])*
        $vis:vis enum $enum:ident {
            $( $(#[$variant_meta:meta])* $variant:ident $(= $word:literal)?, )+
        }
    ) => {
        $(#[$meta])*
        #[derive(
            Debug,
            Clone,
            Copy,
            PartialEq,
            Eq,
            Hash,
            serde::Serialize,
            serde::Deserialize,
            strum::EnumString,
            strum::IntoStaticStr,
            strum::VariantNames,
        )]
        #[cfg_attr(feature = "server", derive(utoipa::ToSchema))]
        #[strum(serialize_all = "kebab-case")]
        #[serde(rename_all = "kebab-case")]
        $vis enum $enum {
            $(
                $(#[$variant_meta])*
                $( #[strum(serialize = $word)] #[serde(rename = $word)] )?
                $variant,
            )+
        }

        #[allow(dead_code)] // not every enum is listed, named and read
        impl $enum {
            /// All of them, in the order in which they are documented.
            $vis const ALL: [Self; <Self as strum::VariantNames>::VARIANTS.len()] = [ $( Self::$variant, )+ ];

            /// Its word in the interface.
            #[must_use]
            $vis const fn name(self) -> &'static str {
                <Self as strum::VariantNames>::VARIANTS[self as usize]
            }

            /// The one with this [`Self::name`], in any case.
            #[must_use]
            $vis fn from_name(name: &str) -> Option<Self> {
                name.to_ascii_lowercase().parse().ok()
            }
        }
    };
}
pub(crate) use words;

#[cfg(test)]
mod tests {
    words! {
        /// Of a sentence.
        #[derive(Default)]
        enum Way {
            /// Two words.
            #[default]
            ByFoot,
            /// A digit.
            Line2,
            /// Another word than the variant's.
            Else = "otherwise",
        }
    }

    #[test]
    fn a_word_is_the_same_wherever_it_is_written_or_read() {
        assert_eq!(Way::ALL.map(Way::name), ["by-foot", "line2", "otherwise"]);
        for way in Way::ALL {
            assert_eq!(<&str>::from(way), way.name());
            assert_eq!(Way::from_name(&way.name().to_uppercase()), Some(way));
            let read = <Way as serde::Deserialize>::deserialize(serde::de::value::StrDeserializer::<
                serde::de::value::Error,
            >::new(way.name()));
            assert_eq!(read, Ok(way));
        }
        assert_eq!(Way::from_name("Else"), None);
        assert_eq!(Way::default(), Way::ByFoot);
    }
}
