//! Sets of named flags in one number, as records and archives carry them.

/// Defines a set of flags: a number on the wire, names joined by `|` in tables.
macro_rules! flags {
    ($(#[$doc:meta])* $set:ident { $($(#[$flag_doc:meta])* $flag:ident = $name:literal,)* }) => {
        $(#[$doc])*
        #[repr(C)]
        #[derive(Clone, Copy, PartialEq, Eq, Hash, Default, ZeroCopySend)]
        pub struct $set(u32);

        #[expect(non_camel_case_types, clippy::upper_case_acronyms, reason = "places of the bits, named as the flags")]
        enum Place { $($flag,)* }

        impl $set {
            $($(#[$flag_doc])* pub const $flag: Self = Self(1 << Place::$flag as u32);)*

            /// Every flag there is, with its name, in the order of the bits.
            pub const ALL: &'static [(Self, &'static str)] = &[$((Self::$flag, $name),)*];

            /// Whether no flag is set.
            pub fn is_clean(self) -> bool {
                self.0 == 0
            }

            /// Whether every flag of `other` is set.
            pub fn contains(self, other: Self) -> bool {
                self.0 & other.0 == other.0
            }

            /// Adds the flags of `other`.
            pub fn insert(&mut self, other: Self) {
                self.0 |= other.0;
            }

            /// The flags as a number, as the archive stores them.
            pub fn bits(self) -> u32 {
                self.0
            }

            /// The flags that `bits` stands for.
            pub fn from_bits(bits: u32) -> Self {
                Self(bits)
            }
        }

        impl fmt::Display for $set {
            /// The names of the flags that are set, joined by `|`.
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                let set = Self::ALL.iter().filter(|(flag, _)| self.contains(*flag));
                f.write_str(&set.map(|(_, name)| *name).collect::<Vec<_>>().join("|"))
            }
        }

        impl fmt::Debug for $set {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "{}({self})", stringify!($set))
            }
        }
    };
}

pub(crate) use flags;

#[cfg(test)]
mod tests {
    use crate::{Quality, Reasons};

    /// Archives hold the numbers and tables the names: neither may change.
    #[test]
    fn numbers_and_names_are_kept() {
        let mut quality = Quality::NO_FORCE;
        assert_eq!((quality.bits(), quality.to_string().as_str()), (4, "no_force"));
        quality.insert(Quality::NON_FINITE);
        assert_eq!((quality.bits(), quality.to_string().as_str()), (6, "non_finite|no_force"));
        assert!(quality.contains(Quality::NO_FORCE) && !quality.contains(Quality::NO_BAND) && !quality.is_clean());
        assert_eq!((Quality::NO_BAND.bits(), Quality::default().to_string().as_str()), (128, ""));
        assert_eq!((Quality::CLIPPED.bits(), Quality::RATE_IMPLAUSIBLE.bits()), (1 << 9, 1 << 17));
        let reasons = Reasons::from_bits(1 | 128);
        assert_eq!(format!("{reasons:?}"), "Reasons(damage|self_reference)");
    }
}
