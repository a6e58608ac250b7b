//! One typed array, written a block at a time.

use js_sys::{Float32Array, Object, Reflect, Uint32Array};
use wasm_bindgen::{JsCast, JsValue};

/// A number that a typed array holds.
pub(crate) trait Number: Copy {
    /// The typed array.
    type Array: JsCast;
    /// An array of zeros.
    fn zeros(len: usize) -> Self::Array;
    /// How many numbers an array holds.
    fn len(array: &Self::Array) -> usize;
    /// Copies values to a place of the array.
    fn copy(array: &Self::Array, at: usize, values: &[Self]);
}

macro_rules! element {
    ($number:ty, $array:ty) => {
        impl Number for $number {
            type Array = $array;
            fn zeros(len: usize) -> $array {
                <$array>::new_with_length(len as u32)
            }
            fn len(array: &$array) -> usize {
                array.length() as usize
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
pub(crate) struct Column<T: Number> {
    width: usize,
    array: T::Array,
    /// The numbers of the block that is being written.
    pub(crate) block: Vec<T>,
}

impl<T: Number> Column<T> {
    /// The array of that name in `object`. One that is not there, or has no room, is made.
    pub(crate) fn of(object: &Object, name: &str, width: usize, capacity: usize) -> Self {
        let there = Reflect::get(object, &name.into()).and_then(JsValue::dyn_into::<T::Array>).ok();
        let len = width * capacity;
        let array = there.filter(|a| T::len(a) >= len).unwrap_or_else(|| {
            let array = T::zeros(len);
            crate::error::set(object, name, array.as_ref());
            array
        });
        Self { width, array, block: Vec::new() }
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
}
