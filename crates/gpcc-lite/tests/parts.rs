//! Morton codes.

use gpcc_lite::morton;

#[test]
fn morton_codes_invert() {
    for p in [[0, 0, 0], [1, 2, 4], [(1 << 21) - 1; 3], [1 << 20, 5, 77]] {
        assert_eq!(morton::decode(morton::encode(p)), p);
    }
    assert_eq!(morton::encode([1, 0, 0]), 4);
}
