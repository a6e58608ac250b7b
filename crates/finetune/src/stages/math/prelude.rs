// What the shared text needs in Rust whatever F is: structs are `Copy` and have positional
// constructors, as in WGSL.
macro_rules! positional {
    ($($name:ident { $($field:ident : $ty:ty),* })*) => {$(
        impl Clone for $name {
            #[inline(always)]
            fn clone(&self) -> Self {
                *self
            }
        }
        impl Copy for $name {}
        #[inline(always)]
        fn $name($($field: $ty),*) -> $name {
            $name { $($field),* }
        }
    )*};
}
positional! {
    V3 { x: F, y: F, z: F }
    Rot { c0: V3, c1: V3, c2: V3 }
    Ewa { t0: V3, t1: V3 }
    Shape { p: F, q: F, r: F, cov_xx: F, cov_xy: F, cov_yy: F, det_over_m: F, m: F }
    Band2 { b0: F, b1: F, b2: F, b3: F, b4: F }
    Band3 { b0: F, b1: F, b2: F, b3: F, b4: F, b5: F, b6: F }
    Step { w: F, t: F }
}
