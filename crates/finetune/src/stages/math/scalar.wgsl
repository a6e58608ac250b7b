// Elementary functions. This text is valid WGSL and a valid Rust module body; see ../mod.rs.
// Every product has a name and every statement at most one addition, so that no compiler can
// reassociate or contract: the Rust and the WGSL instance then agree to the bit on
// implementations that round + - * / correctly.

// exp(x) for x in [-87, 88]; the caller clamps. Cody-Waite reduction, Horner to degree 7.
// At most 1 ulp from the correctly rounded value on [-5.6, 0].
fn exp_polynomial(x: F) -> F {
    let scaled = x * 1.44269504;
    let n = round_even(scaled);
    let high = n * 0.693359375;
    let r0 = x - high;
    let low = n * -2.12194440e-4;
    let r = r0 - low;
    let m6 = r * 1.9841270e-4;
    let p6 = m6 + 1.3888889e-3;
    let m5 = p6 * r;
    let p5 = m5 + 8.3333333e-3;
    let m4 = p5 * r;
    let p4 = m4 + 4.1666667e-2;
    let m3 = p4 * r;
    let p3 = m3 + 1.6666667e-1;
    let m2 = p3 * r;
    let p2 = m2 + 0.5;
    let m1 = p2 * r;
    let p1 = m1 + 1.0;
    let m0 = p1 * r;
    let p0 = m0 + 1.0;
    return p0 * power_of_two(n);
}

// ln(x) for a positive normal x: Cephes' polynomial around 1, exponent from the bits.
fn ln_polynomial(x: F) -> F {
    let e = exponent_of(x);
    let m = mantissa_of(x);
    let z = m - 1.0;
    let m8 = z * 7.0376836292e-2;
    let p8 = m8 - 1.1514610310e-1;
    let m7 = p8 * z;
    let p7 = m7 + 1.1676998740e-1;
    let m6 = p7 * z;
    let p6 = m6 - 1.2420140846e-1;
    let m5 = p6 * z;
    let p5 = m5 + 1.4249322787e-1;
    let m4 = p5 * z;
    let p4 = m4 - 1.6668057665e-1;
    let m3 = p4 * z;
    let p3 = m3 + 2.0000714765e-1;
    let m2 = p3 * z;
    let p2 = m2 - 2.4999993993e-1;
    let m1 = p2 * z;
    let p1 = m1 + 3.3333331174e-1;
    let zz = z * z;
    let zzz = zz * z;
    let tail = zzz * p1;
    let elow = e * -2.12194440e-4;
    let t1 = tail + elow;
    let half = zz * 0.5;
    let t2 = t1 - half;
    let t3 = t2 + z;
    let ehigh = e * 0.693359375;
    return t3 + ehigh;
}

// 1 / (1 + exp(-l)), without overflow at either end.
fn sigmoid(l: F) -> F {
    let magnitude = min(abs(l), F(80.0));
    let e = exp_polynomial(-magnitude);
    let top = select(e, F(1.0), l >= F(0.0));
    let bottom = e + 1.0;
    return top / bottom;
}
