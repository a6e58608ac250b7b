// The page that a dispatch works on: `count` Gaussians from number `first` on. Arrays of parameters, moments and
// derivatives have a buffer per page, so that no binding passes 128 MiB.
struct Page {
    first: u32,
    count: u32,
    pad0: u32,
    pad1: u32,
}

@group(0) @binding(10) var<uniform> page: Page;
