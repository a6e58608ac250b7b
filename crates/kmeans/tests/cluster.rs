//! Clusters as their users see them.
#![allow(missing_docs, reason = "a test")]

use kmeans::{Clusters, SplitMix64, cluster};

type Point = [f32; 9];

/// Points of which many are near zero and some far out, with weights.
fn cloud(n: usize, seed: u64) -> (Vec<Point>, Vec<f32>) {
    let mut rng = SplitMix64::new(seed);
    let mut number = move || {
        let u = rng.unit() as f32 - 0.5;
        u * u * u
    };
    let points = (0..n).map(|_| std::array::from_fn(|_| number())).collect();
    (points, (0..n).map(|_| 0.1 + number().abs()).collect())
}

fn squared_distance(a: &Point, b: &Point) -> f64 {
    a.iter().zip(b).map(|(a, b)| f64::from(a - b) * f64::from(a - b)).sum()
}

fn cost(points: &[Point], weights: &[f32], clusters: &Clusters<9>) -> f64 {
    let of = |i: usize| &clusters.centres[clusters.of_point[i] as usize];
    (0..points.len()).map(|i| f64::from(weights[i]) * squared_distance(&points[i], of(i))).sum()
}

/// Ten turns of plain k-means from points that are drawn at random.
fn lloyd(points: &[Point], weights: &[f32], count: usize) -> Clusters<9> {
    let mut rng = SplitMix64::new(3);
    let mut centres: Vec<Point> = (0..count).map(|_| points[rng.below(points.len())]).collect();
    let mut of_point = vec![0; points.len()];
    for _ in 0..10 {
        for (point, own) in points.iter().zip(&mut of_point) {
            let d = |&c: &u32| squared_distance(point, &centres[c as usize]);
            *own = (0..count as u32).min_by(|a, b| d(a).total_cmp(&d(b))).unwrap();
        }
        for c in 0..count {
            let own = || (0..points.len()).filter(|&i| of_point[i] == c as u32);
            let mass: f32 = own().map(|i| weights[i]).sum();
            let sum = |k: usize| own().map(|i| weights[i] * points[i][k]).sum::<f32>();
            if mass > 0.0 {
                centres[c] = std::array::from_fn(|k| sum(k) / mass);
            }
        }
    }
    Clusters { centres, of_point }
}

#[test]
fn clusters_cost_as_little_as_those_of_plain_k_means() {
    let (points, weights) = cloud(3000, 1);
    for count in [8, 90, 700] {
        let clusters = cluster(&points, &weights, count);
        assert_eq!(clusters.centres.len(), count);
        let [ours, plain] =
            [clusters, lloyd(&points, &weights, count)].map(|c| cost(&points, &weights, &c));
        assert!(ours < 1.01 * plain, "{count}: {ours} {plain}");
    }
}

#[test]
fn a_centre_is_the_weighted_mean_of_its_points() {
    let (points, weights) = cloud(2000, 2);
    let clusters = cluster(&points, &weights, 50);
    for (c, centre) in (0u32..).zip(&clusters.centres) {
        let own = || (0..points.len()).filter(|&i| clusters.of_point[i] == c);
        let mass: f64 = own().map(|i| f64::from(weights[i])).sum();
        for k in 0..9 {
            let sum: f64 = own().map(|i| f64::from(weights[i]) * f64::from(points[i][k])).sum();
            assert!((f64::from(centre[k]) - sum / mass).abs() < 1e-6);
        }
    }
}

#[test]
fn any_number_of_threads_gives_the_same_clusters() {
    let (points, weights) = cloud(20_000, 3);
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| cluster(&points, &weights, 1000))
    };
    let one = run(1);
    assert_eq!(one, run(2));
    assert_eq!(one, run(8));
}

#[test]
fn there_are_no_more_clusters_than_distinct_points() {
    let (mut points, weights) = cloud(300, 4);
    for i in 0..200 {
        points[i] = points[i % 7];
    }
    let clusters = cluster(&points, &weights, 1000);
    assert_eq!(clusters.centres.len(), 107);
    assert!(cost(&points, &weights, &clusters) < 1e-9);
    assert_eq!(cluster(&points[..1], &weights[..1], 8).centres, points[..1]);
    assert_eq!(cluster::<9>(&[], &[], 8).centres.len(), 0);
    assert_eq!(cluster(&points, &weights, 0).centres.len(), 0);
}
