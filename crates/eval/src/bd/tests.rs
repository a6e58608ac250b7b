use super::*;
use crate::published;

fn points(list: &[(f64, f64)]) -> Vec<Point> {
    list.iter().map(|&(rate, psnr_db)| Point { rate, psnr_db }).collect()
}

/// All points of the lists whose name starts with `prefix`, both covariance modes.
fn paper(scene: &str, prefix: &str) -> Vec<Point> {
    let scenes = published::read().unwrap();
    let lists = &scenes[scene].lists;
    let chosen = lists.iter().filter(|l| l.name.starts_with(prefix));
    chosen.flat_map(|l| l.points.iter().map(|&[rate, psnr_db]| Point { rate, psnr_db })).collect()
}

/// Table 1 of the paper, from the points its authors published.
#[test]
fn the_papers_table_1() {
    for (scene, rate, gain) in [("playroom", -13.42, 0.08), ("truck", -12.64, 0.19)] {
        let (anchor, test) = (paper(scene, "paper, uniform"), paper(scene, "paper, adaptive"));
        let got = bd_rate(&anchor, &test, Method::Cubic).unwrap();
        assert!((got - rate).abs() < 0.01, "{scene}: {got}");
        let got = bd_psnr(&anchor, &test, Method::Cubic).unwrap();
        assert!((got - gain).abs() < 0.005, "{scene}: {got}");
    }
}

/// The same on the convex hulls: figures of the reference notes, computed with NumPy and SciPy.
#[test]
fn the_papers_curves_by_hull() {
    for (scene, method, rate, gain) in [
        ("playroom", Method::Cubic, -13.03, 0.101),
        ("playroom", Method::Pchip, -13.05, 0.112),
        ("truck", Method::Cubic, -13.73, 0.250),
        ("truck", Method::Pchip, -12.00, 0.233),
    ] {
        let anchor = hull(&paper(scene, "paper, uniform"));
        let test = hull(&paper(scene, "paper, adaptive"));
        let got = bd_rate(&anchor, &test, method).unwrap();
        assert!((got - rate).abs() < 0.01, "{scene} {method:?}: {got}");
        let got = bd_psnr(&anchor, &test, method).unwrap();
        assert!((got - gain).abs() < 0.001, "{scene} {method:?}: {got}");
    }
}

#[test]
fn half_the_rate_is_minus_fifty_per_cent() {
    let anchor = points(&[(10.0, 30.0), (20.0, 32.0), (40.0, 33.5), (80.0, 34.5)]);
    let test: Vec<Point> = anchor.iter().map(|p| Point { rate: p.rate / 2.0, ..*p }).collect();
    for method in [Method::Cubic, Method::Pchip] {
        assert!((bd_rate(&anchor, &test, method).unwrap() + 50.0).abs() < 1e-9);
        assert!(bd_rate(&anchor, &anchor, method).unwrap().abs() < 1e-9);
    }
}

#[test]
fn a_constant_lift_is_the_bd_psnr() {
    let anchor = points(&[(10.0, 30.0), (20.0, 32.0), (40.0, 33.5), (80.0, 34.5)]);
    let test: Vec<Point> =
        anchor.iter().map(|p| Point { psnr_db: p.psnr_db + 0.7, ..*p }).collect();
    for method in [Method::Cubic, Method::Pchip] {
        assert!((bd_psnr(&anchor, &test, method).unwrap() - 0.7).abs() < 1e-9);
    }
}

#[test]
fn no_overlap_and_too_few_points_are_none() {
    let low = points(&[(1.0, 20.0), (2.0, 21.0), (3.0, 22.0), (4.0, 23.0)]);
    let high = points(&[(1.0, 30.0), (2.0, 31.0), (3.0, 32.0), (4.0, 33.0)]);
    assert_eq!(bd_rate(&low, &high, Method::Cubic), None);
    assert_eq!(bd_rate(&low[..3], &low, Method::Cubic), None);
    assert_eq!(bd_rate(&low[..1], &low, Method::Pchip), None);
}

#[test]
fn hull_drops_what_a_mixture_beats() {
    let all = points(&[(1.0, 20.0), (2.0, 21.0), (3.0, 26.0), (4.0, 25.0), (5.0, 28.0)]);
    assert_eq!(hull(&all), points(&[(1.0, 20.0), (3.0, 26.0), (5.0, 28.0)]));
}

#[test]
fn a_rate_is_read_off_between_points() {
    let curve = points(&[(100.0, 20.0), (200.0, 30.0), (400.0, 32.0)]);
    assert_eq!(rate_at(&curve, 25.0), Some(150.0));
    assert_eq!(rate_at(&curve, 32.0), Some(400.0));
    assert_eq!((rate_at(&curve, 33.0), rate_at(&curve, 19.0)), (None, None));
}
