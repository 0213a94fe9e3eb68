//! Axes by number, and one value for each of them in a fixed array.
//!
//! Invariant: a [`PerAxis`] never allocates and only shows the axes the machine has.

use std::fmt;
use std::ops::{Index, IndexMut};

/// Most axes one cycle can move.
pub const AXES_MAX: usize = 3;

/// Which axis: 0 is the first of the machine file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct AxisId(u8);

impl AxisId {
    /// The first axis, `X` of a circular test.
    pub const X: Self = Self(0);
    /// The second axis, `Y` of a circular test.
    pub const Y: Self = Self(1);

    /// From a position in the machine file.
    ///
    /// # Panics
    /// When `index` is [`AXES_MAX`] or more.
    pub const fn new(index: usize) -> Self {
        assert!(index < AXES_MAX, "more axes than AXES_MAX");
        Self(index as u8)
    }
    /// Position in the machine file.
    pub const fn index(self) -> usize {
        self.0 as usize
    }
}

impl fmt::Display for AxisId {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(["x", "y", "z"][self.index()])
    }
}

/// One `T` for each axis of the machine.
#[derive(Clone, Copy)]
pub struct PerAxis<T> {
    items: [T; AXES_MAX],
    count: u8,
}

impl<T: Copy> PerAxis<T> {
    /// The same value for each of `count` axes.
    ///
    /// # Panics
    /// When `count` is above [`AXES_MAX`].
    pub const fn filled(count: usize, value: T) -> Self {
        assert!(count <= AXES_MAX, "more axes than AXES_MAX");
        Self { items: [value; AXES_MAX], count: count as u8 }
    }
}

impl<T> PerAxis<T> {
    /// One value for each of `count` axes, made from its axis.
    ///
    /// # Panics
    /// When `count` is above [`AXES_MAX`].
    pub fn from_fn(count: usize, mut make: impl FnMut(AxisId) -> T) -> Self {
        assert!(count <= AXES_MAX, "more axes than AXES_MAX");
        // Slots past `count` are made from the last axis and never shown.
        let last = count.saturating_sub(1);
        Self { items: std::array::from_fn(|i| make(AxisId(i.min(last) as u8))), count: count as u8 }
    }
    /// How many axes.
    pub const fn count(&self) -> usize {
        self.count as usize
    }
    /// The axes, in order.
    pub fn axes(&self) -> impl ExactSizeIterator<Item = AxisId> + use<T> {
        (0..self.count).map(AxisId)
    }
    /// The values, in order of the axes.
    pub fn as_slice(&self) -> &[T] {
        &self.items[..self.count()]
    }
    /// The values, in order of the axes.
    pub fn as_mut_slice(&mut self) -> &mut [T] {
        &mut self.items[..usize::from(self.count)]
    }
    /// Each axis with its value.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (AxisId, &T)> {
        self.axes().zip(self.as_slice())
    }
    /// Each axis with its value.
    pub fn iter_mut(&mut self) -> impl ExactSizeIterator<Item = (AxisId, &mut T)> {
        self.axes().zip(self.as_mut_slice())
    }
    /// A value made from each.
    pub fn map<'a, U>(&'a self, mut make: impl FnMut(AxisId, &'a T) -> U) -> PerAxis<U> {
        PerAxis::from_fn(self.count(), |axis| make(axis, &self.items[axis.index()]))
    }
}

impl<T: PartialEq> PartialEq for PerAxis<T> {
    fn eq(&self, other: &Self) -> bool {
        self.as_slice() == other.as_slice()
    }
}
impl<T: fmt::Debug> fmt::Debug for PerAxis<T> {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.debug_list().entries(self.as_slice()).finish()
    }
}
impl<T> Index<AxisId> for PerAxis<T> {
    type Output = T;
    fn index(&self, axis: AxisId) -> &T {
        &self.as_slice()[axis.index()]
    }
}
impl<T> IndexMut<AxisId> for PerAxis<T> {
    fn index_mut(&mut self, axis: AxisId) -> &mut T {
        &mut self.as_mut_slice()[axis.index()]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_axes_of_the_machine_are_seen() {
        let mut places = PerAxis::filled(2, 0);
        places[AxisId::Y] = 7;
        assert_eq!(places.as_slice(), [0, 7]);
        assert_eq!(places.map(|axis, value| axis.index() + value).as_slice(), [0, 8]);
        // What is left in the slots of no axis depends on how the value was made.
        assert_eq!(places, PerAxis::from_fn(2, |axis| [0, 7][axis.index()]));
        assert_ne!(places, PerAxis::filled(2, 0));
        assert_eq!(format!("{places:?}"), "[0, 7]");
    }
}
