//! One typed array, written a block at a time.

use js_sys::{Array, Float32Array, Function, Object, Reflect, Uint32Array};
use wasm_bindgen::{JsCast, JsValue};

/// A number that a typed array holds.
pub(crate) trait Number: Copy {
    /// The typed array.
    type Array: JsCast;
    /// An array of zeros.
    ///
    /// # Errors
    /// If the engine has no memory for it, or no array is that long.
    fn zeros(len: f64) -> Result<Self::Array, JsValue>;
    /// How many numbers an array holds.
    fn len(array: &Self::Array) -> usize;
    /// Copies values to a place of the array.
    fn copy(array: &Self::Array, at: usize, values: &[Self]);
}

macro_rules! element {
    ($number:ty, $array:ty) => {
        impl Number for $number {
            type Array = $array;
            fn zeros(len: f64) -> Result<$array, JsValue> {
                let class = Reflect::get(&js_sys::global(), &stringify!($array).into())?;
                let class: Function = class.dyn_into()?;
                Reflect::construct(&class, &Array::of1(&len.into()))?.dyn_into()
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
    ///
    /// # Errors
    /// An object with `message` and `code` if there is no memory.
    pub(crate) fn of(
        object: &Object,
        name: &str,
        width: usize,
        capacity: usize,
    ) -> Result<Self, JsValue> {
        let there = Reflect::get(object, &name.into()).and_then(JsValue::dyn_into::<T::Array>).ok();
        // Of 32 bits each, so the product needs more.
        let len = width as f64 * capacity as f64;
        let array = match there.filter(|a| T::len(a) as f64 >= len) {
            Some(array) => array,
            None => {
                let message = format!("no memory for {capacity} Gaussians");
                let array = T::zeros(len).map_err(|_| crate::error::object(&message, "memory"))?;
                crate::error::set(object, name, array.as_ref());
                array
            }
        };
        Ok(Self { width, array, block: Vec::new() })
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
