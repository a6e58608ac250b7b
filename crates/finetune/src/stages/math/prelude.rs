// The shared text in Rust, for any F: structs are `Copy` and have positional constructors, as in
// WGSL.
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
    Shape { p: F, q: F, r: F, cov_xx: F, cov_yy: F, gram: F, det_over_m: F, m: F }
    Band2 { b0: F, b1: F, b2: F, b3: F, b4: F }
    Band3 { b0: F, b1: F, b2: F, b3: F, b4: F, b5: F, b6: F }
    Gate { og: F, alpha: F, w: F, t: F, counts: B }
    Replay { w: F, t: F, rg: F, v_sigma: F }
    Sym2 { xx: F, xy: F, yy: F }
    Cols { a0: F, b0: F, a1: F, b1: F, a2: F, b2: F }
    Sight { w0: V3, w1: V3, w2: V3, m: V3, inv_z: F, u: F, v: F, jx: F, jy: F }
    ShGradient {
        g1: V3, g2: V3, g3: V3, g4: V3, g5: V3, g6: V3, g7: V3, g8: V3,
        g9: V3, g10: V3, g11: V3, g12: V3, g13: V3, g14: V3, g15: V3
    }
    Q4 { w: F, x: F, y: F, z: F }
}
impl std::fmt::Debug for V3 {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "({}, {}, {})", self.x, self.y, self.z)
    }
}
