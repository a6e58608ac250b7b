//! [`order`]: which Gaussians share a chunk. A chunk's steps follow from its extent, so those of a chunk are near each
//! other, and the few that lie far out coarsen no others.

use super::CHUNK;
use crate::order::morton_order;
use crate::scene::Scene;

/// So many times the median distance from the middle is far out. The next shells end at eight times that, and so on.
const FAR: f64 = 32.0;
const LOG2_OF_SHELLS: f64 = 3.0;

/// The indices of all Gaussians in the order of the file: shell by shell, each along a Morton curve. Chunks are full but
/// for the last, so those that show least fill the chunks of outer shells.
pub(super) fn order(scene: &Scene) -> Vec<usize> {
    let mut shells = shells(&scene.means);
    let mut near = if shells.is_empty() { Vec::new() } else { shells.remove(0) };
    let full = |n: usize, shell: &[usize]| (n + CHUNK - shell.len() % CHUNK) % CHUNK;
    let room = |(k, shell): (usize, &Vec<usize>)| {
        full(if k + 1 == shells.len() { scene.len() % CHUNK } else { 0 }, shell)
    };
    let rooms: Vec<usize> = shells.iter().enumerate().map(room).collect();
    let mut fill = least(scene, &near, rooms.iter().sum());
    near.retain(|i| fill.binary_search(i).is_err());
    let mut all = along_a_curve(scene, near);
    for (mut shell, room) in shells.into_iter().zip(rooms) {
        shell.extend(fill.drain(..room.min(fill.len())));
        all.extend(along_a_curve(scene, shell));
    }
    all
}

fn along_a_curve(scene: &Scene, members: Vec<usize>) -> Vec<usize> {
    let means: Vec<[f32; 3]> = members.iter().map(|&i| scene.means[i]).collect();
    morton_order(&means).into_iter().map(|k| members[k]).collect()
}

/// The means by how far out they lie: almost all are in the first shell.
fn shells(means: &[[f32; 3]]) -> Vec<Vec<usize>> {
    let middle_of = |mut values: Vec<f64>| {
        let middle = values.len() / 2;
        *values.select_nth_unstable_by(middle, f64::total_cmp).1
    };
    if means.is_empty() {
        return Vec::new();
    }
    let middle = [0, 1, 2].map(|k| middle_of(means.iter().map(|m| m[k].into()).collect()));
    let distance =
        |m: &[f32; 3]| (0..3).map(|k| (f64::from(m[k]) - middle[k]).abs()).fold(0.0, f64::max);
    let far = FAR * middle_of(means.iter().map(distance).collect());
    let shell = |m: &[f32; 3]| match distance(m) {
        d if d <= far || far == 0.0 => 0,
        d => 1 + (libm::log2(d / far) / LOG2_OF_SHELLS) as u32,
    };
    let mut shells = std::collections::BTreeMap::from([(0, Vec::new())]);
    for (i, mean) in means.iter().enumerate() {
        shells.entry(shell(mean)).or_insert_with(Vec::new).push(i);
    }
    shells.into_values().collect()
}

/// The `n` of these Gaussians that show least, by opacity and area, ascending; none if there are fewer.
fn least(scene: &Scene, of: &[usize], n: usize) -> Vec<usize> {
    if n == 0 || n > of.len() {
        return Vec::new();
    }
    let mut by_show: Vec<(f64, usize)> = of.iter().map(|&i| (scene.log_prominence(i), i)).collect();
    by_show.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let mut least: Vec<usize> = by_show[..n].iter().map(|&(_, i)| i).collect();
    least.sort_unstable();
    least
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 1,000 Gaussians within a unit, and some far out.
    fn scene(far: &[f32]) -> Scene {
        let mut scene = Scene::zeros(1000 + far.len(), 0);
        for i in 0..1000 {
            scene.means[i] = [i % 10, i / 10 % 10, i / 100].map(|v| 0.1 * v as f32);
            scene.log_scales[i] = [-(i as f32) / 100.0; 3];
        }
        far.iter().enumerate().for_each(|(i, &x)| scene.means[1000 + i][0] = x);
        scene
    }

    #[test]
    fn without_far_gaussians_the_order_is_that_of_the_curve() {
        let scene = scene(&[]);
        assert_eq!(order(&scene), morton_order(&scene.means));
        assert!(order(&Scene::default()).is_empty());
    }

    #[test]
    fn far_gaussians_share_chunks_with_what_shows_least() {
        let scene = scene(&[60_000.0, 200.0, 201.0, -60_100.0]);
        let order = order(&scene);
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert!(sorted.into_iter().eq(0..1004));
        let chunk_of = |i: usize| order.iter().position(|&k| k == i).unwrap() / CHUNK;
        assert_eq!([1000, 1001, 1002, 1003].map(chunk_of), [3, 2, 2, 3]);
        // The larger half of the others.
        assert!((0..500).all(|i| chunk_of(i) < 2));
    }
}
