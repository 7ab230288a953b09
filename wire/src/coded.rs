//! Numbers and names for the variants of an enum, and the reverse mappings, from one table.

/// Gives the enum `$of` a number for each variant: `code` and `from_code`.
#[macro_export]
macro_rules! coded {
    ($of:ident: $number:ty, $($variant:ident = $code:literal),+ $(,)?) => {
        impl $of {
            /// Its number on the wire and in archives.
            pub fn code(self) -> $number {
                match self {
                    $(Self::$variant => $code,)+
                }
            }

            /// The variant with the number `code`.
            pub fn from_code(code: $number) -> Option<Self> {
                match code {
                    $($code => Some(Self::$variant),)+
                    _ => None,
                }
            }
        }
    };
}

/// Gives the enum `$of` a name for each variant: `name` and `from_name`.
#[macro_export]
macro_rules! named {
    ($of:ident, $($variant:ident = $name:literal),+ $(,)?) => {
        impl $of {
            /// Name in configurations, archives and tables.
            pub fn name(self) -> &'static str {
                match self {
                    $(Self::$variant => $name,)+
                }
            }

            /// The one of this name.
            pub fn from_name(name: &str) -> Option<Self> {
                match name {
                    $($name => Some(Self::$variant),)+
                    _ => None,
                }
            }
        }
    };
}
