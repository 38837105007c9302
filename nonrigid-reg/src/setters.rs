//! The setters of all options are written by one macro.

/// `setters! { Options { with_scale scale: f64 } }` writes `Options::with_scale`, which sets that field and keeps the others.
macro_rules! setters {
    ($kind:ty { $($with:ident $field:ident: $type:ty),* $(,)? }) => {
        impl $kind {
            $(
                #[doc = concat!("Sets [`", stringify!($field), "`](Self::", stringify!($field), ").")]
                #[must_use] pub fn $with(self, $field: $type) -> Self { Self { $field, ..self } }
            )*
        }
    };
}

pub(crate) use setters;
