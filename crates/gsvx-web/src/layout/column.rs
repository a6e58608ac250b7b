//! One typed array, written a block at a time.

use js_sys::{Float32Array, Object, Uint32Array};
use wasm_bindgen::JsValue;

/// A number that a typed array holds.
pub(crate) trait Element: Copy {
    /// The typed array.
    type Array: Into<JsValue>;
    /// An array of zeros.
    fn zeros(len: usize) -> Self::Array;
    /// Copies values to a place of the array.
    fn copy(array: &Self::Array, at: usize, values: &[Self]);
}

macro_rules! element {
    ($number:ty, $array:ty) => {
        impl Element for $number {
            type Array = $array;
            fn zeros(len: usize) -> $array {
                <$array>::new_with_length(len as u32)
            }
            fn copy(array: &$array, at: usize, values: &[$number]) {
                array.subarray(at as u32, (at + values.len()) as u32).copy_from(values);
            }
        }
    };
}

element!(f32, Float32Array);
element!(u32, Uint32Array);

/// A typed array of so many numbers for each Gaussian.
pub(crate) struct Column<T: Element> {
    name: &'static str,
    width: usize,
    array: T::Array,
    /// The numbers of the block that is being written.
    pub(crate) block: Vec<T>,
}

impl<T: Element> Column<T> {
    pub(crate) fn new(name: &'static str, width: usize, capacity: usize) -> Self {
        Self { name, width, array: T::zeros(width * capacity), block: Vec::new() }
    }

    /// Copies the block to where Gaussian `first` is.
    pub(crate) fn flush(&mut self, first: usize) {
        T::copy(&self.array, first * self.width, &self.block);
        self.block.clear();
    }

    /// Copies values that lie side by side already.
    pub(crate) fn copy(&self, first: usize, values: &[T]) {
        T::copy(&self.array, first * self.width, values);
    }

    /// Makes the array a property of `object`.
    pub(crate) fn finish(self, object: &Object) {
        crate::error::set(object, self.name, &self.array.into());
    }
}
