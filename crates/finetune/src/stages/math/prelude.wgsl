// The functions of the shared text in WGSL. F, B, I and U are aliases that the host writes: f32,
// bool, i32 and u32, or the vec4 of each.

fn round_even(x: F) -> F {
    return round(x);
}

fn power_of_two(n: F) -> F {
    return bitcast<F>((I(n) + I(127)) << U(23u));
}

fn exponent_of(x: F) -> F {
    return F(bitcast<I>(bitcast<U>(x) - U(0x3f3504f3u)) >> U(23u));
}

fn mantissa_of(x: F) -> F {
    let offset = bitcast<U>(x) - U(0x3f3504f3u);
    return bitcast<F>((offset & U(0x007fffffu)) + U(0x3f3504f3u));
}

// On the exponent's bits: a compiler may assume that NaN and infinity do not occur.
fn finite(x: F) -> B {
    return (bitcast<U>(x) & U(0x7f800000u)) != U(0x7f800000u);
}
