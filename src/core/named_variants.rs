//! Names of enum variants on the command line and in reports.

/// Implements `ALL`, `name` and `from_name` of a field-less enum from one table of all its variants
/// and their names. A name may be followed by aliases, which `from_name` accepts as well.
///
/// ```
/// #[derive(Clone, Copy, Debug, PartialEq)]
/// enum Filter {
///     Nearest,
///     Bilinear,
/// }
/// headbox_core::named_variants!(Filter { Bilinear => "bilinear" | "linear", Nearest => "nearest" });
///
/// assert_eq!(Filter::ALL.map(Filter::name), ["bilinear", "nearest"]);
/// assert_eq!(Filter::from_name("nearest"), Some(Filter::Nearest));
/// assert_eq!(Filter::from_name("linear"), Some(Filter::Bilinear));
/// assert_eq!(Filter::from_name("Nearest"), None);
/// ```
#[macro_export]
macro_rules! named_variants {
    ($type:ident { $($variant:ident => $name:literal $(| $alias:literal)*),+ $(,)? }) => {
        #[allow(dead_code, reason = "not every enum needs all of them")]
        impl $type {
            /// All variants, in the order in which they are listed for users.
            pub const ALL: [Self; [$($name),+].len()] = [$(Self::$variant),+];

            /// Name on the command line and in reports.
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$variant => $name,)+
                }
            }

            /// Returns the variant of a name.
            pub fn from_name(name: &str) -> Option<Self> {
                match name {
                    $($name $(| $alias)* => Some(Self::$variant),)+
                    _ => None,
                }
            }
        }
    };
}
