//! A place that is empty or holds a value, and whose empty state is all zeros.
//!
//! [`Option`] may say "none" with a value that its content cannot have, which is seldom zero. One such byte puts the whole
//! static that it is in, with its 105 KiB of buffers, into the image's initialised data. A [`Slot`] keeps it in `.bss`.

/// An [`Option`] with a tag of its own.
#[derive(Debug, Clone, Default)]
#[repr(u8)]
pub enum Slot<T> {
    /// Nothing.
    #[default]
    Empty = 0,
    /// A value.
    Full(T) = 1,
}

impl<T> Slot<T> {
    /// The value, if there is one.
    pub fn as_ref(&self) -> Option<&T> {
        match self {
            Self::Empty => None,
            Self::Full(value) => Some(value),
        }
    }

    /// The value, if there is one.
    pub fn as_mut(&mut self) -> Option<&mut T> {
        match self {
            Self::Empty => None,
            Self::Full(value) => Some(value),
        }
    }

    /// Takes the value out.
    pub fn take(&mut self) -> Option<T> {
        match core::mem::take(self) {
            Self::Empty => None,
            Self::Full(value) => Some(value),
        }
    }
}
