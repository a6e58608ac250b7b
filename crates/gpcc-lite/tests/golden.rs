//! The same bytes and values on every machine: FNV-1a of what a known cloud gives.

mod common;

use common::{any_weights, channel, octree_from, rows_of};
use gpcc_lite::attribute::{self, Quantisation};
use gpcc_lite::coder::RansEncoder;
use gpcc_lite::paper::predict::{Neighbours, encode_lossless};
use gpcc_lite::paper::rlgr;
use gpcc_lite::raht::RahtPlan;
use gpcc_lite::{Leaf, Octree, geometry};

fn hash(bytes: impl IntoIterator<Item = u8>) -> u64 {
    bytes
        .into_iter()
        .fold(0xcbf2_9ce4_8422_2325, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3))
}

/// Leaves of several depths.
fn cloud() -> Octree {
    let codes: Vec<(u64, u8)> =
        (0..5000u64).map(|i| ((i * i).wrapping_mul(7919) % (1 << 36), 6 + (i % 7) as u8)).collect();
    octree_from(&codes, 12)
}

#[test]
fn geometry_has_one_result() {
    let mixed = cloud();
    let uniform = mixed.leaves().iter().map(|l| Leaf { depth: 12, ..*l }).collect();
    let uniform = Octree::of_points(12, uniform).unwrap();
    let hashes = [mixed, uniform].map(|tree| hash(geometry::encode(&tree).unwrap()));
    assert_eq!(hashes, [11_327_565_538_243_235_329, 8_261_662_417_673_644_604]);
}

#[test]
fn attributes_have_one_result() {
    let tree = cloud();
    let plan = RahtPlan::new(tree.clone()).weighted(&any_weights(tree.len(), 3)).unwrap();
    let hashes = [1, 3, 6, 9, 15, 21].map(|channels| {
        let mut rows = rows_of(tree.len(), channels, 5, 1);
        let mut coder = RansEncoder::default();
        let steps = vec![3.5; channels];
        attribute::encode(&mut coder, &plan, &Quantisation::new(&steps), &mut rows).unwrap();
        let values = (0..tree.len()).flat_map(|i| rows.row(i).to_vec());
        hash(coder.finish().into_iter().chain(values.flat_map(f32::to_le_bytes)))
    });
    assert_eq!(
        hashes,
        [
            12_068_722_872_015_672_287,
            2_151_218_160_645_101_592,
            16_600_060_239_398_702_517,
            18_419_713_675_791_201_261,
            2_987_961_982_136_769_620,
            16_765_644_882_428_110_828,
        ]
    );
}

#[test]
fn tools_have_one_result() {
    let tree = cloud();
    let near = Neighbours::new(&tree);
    // A channel for each mode: a histogram, plain bits, a palette, what neighbours predict.
    let narrow = channel(tree.len(), 9, 1);
    let gaps: Vec<i32> = narrow.iter().map(|v| v % 9 * 70_001).collect();
    let smooth: Vec<i32> = (tree.leaves().iter().zip(&narrow))
        .map(|(leaf, v)| (leaf.morton >> 12) as i32 % 900_000 + v / 20)
        .collect();
    let plain: Vec<i32> = channel(tree.len(), 9, 2).iter().map(|v| v >> 16).collect();
    let channels = [narrow.clone(), plain, gaps, smooth];
    let coded = channels.map(|c| encode_lossless(&near, &[&c]).unwrap());
    // The mode stands behind the number of channels and the length of the first.
    assert_eq!([0, 1, 2, 3].map(|c| coded[c][3]), [2, 0, 6, 1]);
    assert_eq!(
        coded.map(hash),
        [
            8_741_104_672_352_335_038,
            10_891_187_927_814_553_801,
            932_073_155_459_749_630,
            11_081_722_660_061_695_174,
        ]
    );
    assert_eq!(hash(rlgr::encode(&narrow)), 3_522_733_997_063_804_764);
}
