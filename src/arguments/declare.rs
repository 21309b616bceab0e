//! The macros that declare arguments.

/// Declares a struct of arguments. The documentation of a field is the argument's meaning wherever it is shown.
///
/// ```text
/// arguments! {
///     /// How something is done.
///     #[derive(Debug, Clone)]
///     pub struct How {
///         /// Width of the transition, as a share of the frequency.
///         taper: f64 = range(0.0, 1.0), default 0.0;
///         /// Which of them.
///         #[name = "which"]
///         #[alias = "kind"]
///         #[short = 'k']
///         kind: Kind = word(Kind), default Kind::First;
///         /// Time, in squared units of the cloud.
///         time: Option<f64> = positive, absent "from the cut-off";
///     }
/// }
/// ```
///
/// Kinds of values: `integer(least, most)` (usize), `positive`, `nonnegative`, `range(low, high)` (f64), `switch` (bool),
/// `word(T)` (T is declared by `words!`), `id(T)` (T reads a UUID), `text` (String), `names` (`Vec<String>`). An argument has a `default`, or is an `Option` (or names)
/// and says in words what holds when it is `absent`.
macro_rules! arguments {
    (
        $(#[$meta:meta])*
        $vis:vis struct $struct:ident {
            $(
                $(#[doc = $doc:literal])+
                $(#[name = $name:literal])?
                $(#[alias = $alias:literal])?
                $(#[short = $short:literal])?
                $field:ident: $type:ty = $kind:ident $(($($bound:tt)*))? $(, default $default:expr)? $(, absent $absent:literal)?;
            )*
        }
    ) => {
        $(#[$meta])*
        $vis struct $struct {
            $( $(#[doc = $doc])+ pub $field: $type, )*
        }

        impl Default for $struct {
            fn default() -> Self {
                Self { $( $field: $crate::arguments::arguments!(@default $($default)?), )* }
            }
        }

        #[allow(clippy::useless_conversion, unused_variables)] // an Option or the value itself; no arguments at all
        impl $crate::arguments::Arguments for $struct {
            fn table() -> Vec<$crate::arguments::Argument> {
                vec![ $( $crate::arguments::Argument {
                    name: $crate::arguments::arguments!(@name $field $($name)?),
                    alias: $crate::arguments::arguments!(@optional $($alias)?),
                    short: $crate::arguments::arguments!(@optional $($short)?),
                    accepts: $crate::arguments::arguments!(@accepts $kind $($($bound)*)?),
                    absent: $crate::arguments::arguments!(@absent $kind $(default $default)? $(absent $absent)?),
                    meaning: concat!($($doc),+).trim_ascii(),
                }, )* ]
            }

            fn set(&mut self, name: &str, value: &$crate::arguments::Value) -> bool {
                $( if name == $crate::arguments::arguments!(@name $field $($name)?) {
                    return $crate::arguments::arguments!(@take value $kind $($($bound)*)?)
                        .map(|value| self.$field = value.into())
                        .is_some();
                } )*
                false
            }
        }

        #[allow(clippy::useless_conversion)] // an Option or the number itself
        impl $crate::arguments::Ranges for $struct {
            fn out_of_range(&self) -> Option<$crate::arguments::Argument> {
                let numbers: Vec<Option<$crate::arguments::Value>> =
                    vec![ $( $crate::arguments::arguments!(@number self.$field, $kind) ),* ];
                let table = <Self as $crate::arguments::Arguments>::table();
                let refused = |argument: &$crate::arguments::Argument, number: Option<$crate::arguments::Value>| {
                    number.is_some_and(|number| !argument.accepts.holds(&number))
                };
                table.into_iter().zip(numbers).find_map(|(argument, number)| refused(&argument, number).then_some(argument))
            }
        }
    };

    (@number $value:expr, integer) => { Option::<usize>::from($value).map($crate::arguments::Value::Integer) };
    (@number $value:expr, positive) => { Option::<f64>::from($value).map($crate::arguments::Value::Number) };
    (@number $value:expr, nonnegative) => { Option::<f64>::from($value).map($crate::arguments::Value::Number) };
    (@number $value:expr, range) => { Option::<f64>::from($value).map($crate::arguments::Value::Number) };
    (@number $value:expr, $other:ident) => { None };

    (@default $default:expr) => { $default };
    (@default) => { Default::default() };
    (@name $field:ident $name:literal) => { $name };
    (@name $field:ident) => { stringify!($field) };
    (@optional $value:literal) => { Some($value) };
    (@optional) => { None };

    (@accepts integer $least:expr, $most:expr) => { $crate::arguments::Accepts::Integer($least, $most) };
    (@accepts positive) => { $crate::arguments::Accepts::Positive };
    (@accepts nonnegative) => { $crate::arguments::Accepts::NonNegative };
    (@accepts range $low:expr, $high:expr) => { $crate::arguments::Accepts::Range($low, $high) };
    (@accepts switch) => { $crate::arguments::Accepts::Switch };
    (@accepts word $word:ty) => { $crate::arguments::Accepts::Word(<$word as strum::VariantNames>::VARIANTS) };
    (@accepts text) => { $crate::arguments::Accepts::Text };
    (@accepts names) => { $crate::arguments::Accepts::Names };
    (@accepts id $id:ty) => { $crate::arguments::Accepts::Id };

    (@take $value:ident integer $($bound:tt)*) => { $value.integer() };
    (@take $value:ident positive) => { $value.number() };
    (@take $value:ident nonnegative) => { $value.number() };
    (@take $value:ident range $($bound:tt)*) => { $value.number() };
    (@take $value:ident switch) => { $value.switch() };
    (@take $value:ident text) => { $value.text().map(str::to_owned) };
    (@take $value:ident names) => { $value.names() };
    (@take $value:ident word $word:ty) => { $value.text().and_then(|text| text.parse::<$word>().ok()) };
    (@take $value:ident id $id:ty) => { $value.text().and_then(|text| text.parse::<$id>().ok()) };

    (@absent $kind:ident absent $words:literal) => { $crate::arguments::Absent::Words(|| $words.to_owned()) };
    (@absent word default $default:expr) => {
        $crate::arguments::Absent::Value(|| <&'static str>::from($default).to_owned())
    };
    (@absent integer default $default:expr) => { $crate::arguments::Absent::Value(|| $default.to_string()) };
    (@absent switch default $default:expr) => { $crate::arguments::Absent::Value(|| $default.to_string()) };
    (@absent $number:ident default $default:expr) => {
        $crate::arguments::Absent::Value(|| $crate::arguments::number_in_words($default))
    };
}
pub(crate) use arguments;

/// Declares a struct of several structs of arguments, whose arguments are taken together.
#[cfg(any(feature = "server", test))]
macro_rules! groups {
    (
        $(#[$meta:meta])*
        $vis:vis struct $struct:ident $(<$of:ident> where $bounded:ident: $bound:ident)? {
            $( $(#[doc = $doc:literal])+ $field:ident: $type:ty, )+
        }
    ) => {
        $(#[$meta])*
        #[derive(Default)]
        $vis struct $struct $(<$of>)? {
            $( $(#[doc = $doc])+ pub $field: $type, )+
        }

        impl $(<$of: $bound>)? $crate::arguments::Arguments for $struct $(<$of>)? {
            fn table() -> Vec<$crate::arguments::Argument> {
                [ $( <$type as $crate::arguments::Arguments>::table() ),+ ].concat()
            }

            fn set(&mut self, name: &str, value: &$crate::arguments::Value) -> bool {
                $( if <$type as $crate::arguments::Arguments>::table().iter().any(|a| a.name == name) {
                    return $crate::arguments::Arguments::set(&mut self.$field, name, value);
                } )+
                false
            }
        }
    };
}
#[cfg(feature = "server")]
pub(crate) use groups;

#[cfg(test)]
mod tests {
    use crate::arguments::{Absent, Accepts, Arguments, Ranges, Value, words};

    words! {
        enum Way {
            OneWay,
            Other,
        }
    }

    arguments! {
        /// Of everything.
        #[derive(Debug, Clone, PartialEq)]
        struct All {
            /// How many,
            /// at most.
            #[alias = "number"]
            #[short = 'n']
            count: usize = integer(1, 10), default 5;
            /// Share.
            taper: f64 = range(0.0, 1.0), default 1e-4;
            /// Time.
            time: Option<f64> = positive, absent "from the cut-off";
            /// Which way.
            #[name = "by"]
            way: Way = word(Way), default Way::OneWay;
            /// Whether.
            on: Option<bool> = switch, absent "not paper";
            /// Which.
            field: Vec<String> = names, absent "all";
        }
    }

    arguments! {
        #[derive(Debug, Clone, PartialEq)]
        struct More {
            /// Where.
            from: usize = integer(0, usize::MAX), default 0;
        }
    }

    groups! {
        #[derive(Debug, PartialEq)]
        struct Both {
            /// These.
            all: All,
            /// And those.
            more: More,
        }
    }

    #[test]
    fn the_table_has_what_the_declaration_says() {
        let table = All::table();
        let count = table[0];
        assert_eq!((count.name, count.alias, count.short), ("count", Some("number"), Some('n')));
        assert_eq!(count.meaning, "How many, at most.");
        assert_eq!(count.accepts, Accepts::Integer(1, 10));
        assert_eq!(table[3].name, "by");
        assert_eq!(table[3].accepts, Accepts::Word(&["one-way", "other"]));
        let absent: Vec<_> = table.iter().map(|argument| argument.absent.in_words()).collect();
        assert_eq!(absent, ["5", "1e-4", "from the cut-off", "one-way", "not paper", "all"]);
        assert_eq!(Both::table().len(), table.len() + 1);
    }

    #[test]
    fn the_default_of_the_struct_is_what_the_table_documents() {
        for argument in All::table() {
            let mut set = All::default();
            if let Absent::Value(shown) = argument.absent {
                let value = argument.accepts.read(&shown()).unwrap();
                assert!(set.set(argument.name, &value));
            }
            assert_eq!(set, All::default(), "{}", argument.name);
        }
    }

    #[test]
    fn numbers_that_no_caller_may_give_are_found_in_structs_too() {
        assert!(All::default().out_of_range().is_none());
        let all = |time, taper| All { taper, time, ..All::default() };
        assert_eq!(all(Some(0.0), 0.0).out_of_range().unwrap().name, "time");
        assert_eq!(all(Some(1.0), f64::NAN).out_of_range().unwrap().name, "taper");
        assert!(More { from: usize::MAX }.out_of_range().is_none());
    }

    #[test]
    fn values_reach_their_fields_also_in_groups() {
        let mut both = Both::default();
        assert!(both.set("by", &Value::Text("other".into())));
        assert!(both.set("time", &Value::Integer(2)));
        assert!(both.set("field", &Value::Text("a, b,".into())));
        assert!(both.set("from", &Value::Integer(7)));
        assert!(!both.set("by", &Value::Text("neither".into())));
        assert!(!both.set("on", &Value::Integer(1)));
        let expected =
            All { way: Way::Other, time: Some(2.0), field: vec!["a".into(), "b".into()], ..All::default() };
        assert_eq!(both, Both { all: expected, more: More { from: 7 } });
    }
}
