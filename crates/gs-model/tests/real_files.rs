//! The readers on real files: one of `fixtures`, and those of `../shared` beside the workspace.

mod common;

use common::{fixture, says, share_in_view, shared, written};
use gs_model::dataset::Dataset;
use gs_model::{ReadOptions, model, ply};

#[test]
fn scenes_open_as_colmap_projects() {
    for (name, views, held_out, gaussians, size) in
        [("fox", 50, 7, 119_980, (265, 474)), ("bonsai", 148, 19, 179_918, (400, 266))]
    {
        let Some(dir) = shared(&format!("scenes/{name}")) else { return };
        let dataset = Dataset::open(&dir).unwrap();
        assert_eq!(dataset.views.len(), views, "{name}");
        assert_eq!(dataset.held_out().len(), held_out, "{name}");
        assert_eq!(dataset.training().count(), views - held_out, "{name}");
        assert_eq!(dataset.held_out().next(), dataset.views.first());
        assert!(dataset.views.is_sorted_by(|a, b| a.camera.name < b.camera.name));
        assert!(dataset.views.iter().all(|v| v.has_photo()), "{name}");
        assert!(dataset.views.iter().all(|v| (v.camera.width, v.camera.height) == size), "{name}");

        let (scene, report) = ply::read(&dataset.model_path).unwrap();
        assert_eq!((scene.len(), scene.sh_degree), (gaussians, 3));
        assert!(report.notes.is_empty(), "{name}: {:?}", report.notes);
        let points: Vec<[f64; 3]> = scene.means.iter().map(|p| p.map(f64::from)).collect();
        let share: f64 =
            dataset.views.iter().map(|v| share_in_view(&v.camera, &points)).sum::<f64>()
                / views as f64;
        println!("{name}: {} points, {share:.3} of them in an average view", points.len());
        assert!(share > 0.3, "{name}: {share}");
    }
}

#[test]
fn models_are_read() {
    let shared = [("kacy_7000.ply", 9080), ("fruit_drops_minimal.ply", 4721)]
        .into_iter()
        .filter_map(|(name, gaussians)| Some((shared(&format!("models/{name}"))?, gaussians)));
    for (path, gaussians) in [(fixture("leica/point_cloud.ply"), 2048)].into_iter().chain(shared) {
        let (scene, _) = ply::read(&path).unwrap();
        let name = path.display();
        assert_eq!((scene.len(), scene.sh_degree), (gaussians, 3), "{name}");
        assert_eq!(ply::read_bytes(&written("ply", &scene)).unwrap().0, scene, "{name}");
    }
}

#[test]
fn other_ply_files_are_told_apart() {
    let Some(path) = shared("models/biker.compressed.ply") else { return };
    let (scene, report) = ply::read(&path).unwrap();
    assert_eq!((report.format, scene.len()), ("compressed-ply", 152_746));
    let Some(path) = shared("scenes/cameras/playroom/points.ply") else { return };
    says(ply::read(&path), "it is a plain point cloud");
}

/// SOG of version 1, as public repositories hold it.
#[test]
fn a_sog_of_version_1_is_read() {
    let Some(path) = shared("models/la_fontaine/meta.json") else { return };
    let (scene, report) = model::read(&path, &ReadOptions::default()).unwrap();
    assert_eq!((&report.form[..], scene.len(), scene.sh_degree), ("SOG, version 1", 1_136_356, 3));
    let share = |count: usize| count as f64 / scene.len() as f64;
    // The bounds of means that meta.json states, undone: sign(v) (exp(|v|) - 1).
    let most = |k: usize| scene.means.iter().map(|m| m[k]).fold(f32::MIN, f32::max);
    for (k, bound) in [0.184_994_22f32, 0.176_853_02, 0.188_970_55].into_iter().enumerate() {
        assert!((most(k) - libm::expm1f(bound)).abs() < 1e-5, "{k}: {}", most(k));
    }
    // Another order of the bytes would leave no plausible sizes, opacities and colours.
    let logs = scene.log_scales.as_flattened().iter().filter(|l| (-12.0..-3.0).contains(*l));
    let opaque = scene.opacity_logits.iter().filter(|&&l| l > 0.0).count();
    let dark =
        (0..scene.len()).filter(|&i| scene.sh_of(i)[0].iter().all(|v| v.abs() < 2.5)).count();
    let small = scene.sh.iter().filter(|v| v.iter().all(|v| v.abs() < 0.52)).count();
    let shares = [share(logs.count()) / 3.0, share(opaque), share(dark), share(small) / 16.0];
    println!("log-scales from -12 to -3, opaque, colours, small SH: {shares:?}");
    assert!(shares[0] > 0.97 && (0.2..0.9).contains(&shares[1]), "{shares:?}");
    assert!(shares[2] > 0.97 && shares[3] > 0.95, "{shares:?}");
    let norm = |q: &[f32; 4]| q.iter().map(|v| v * v).sum::<f32>();
    assert!(scene.rotations.iter().all(|q| (0.999..1.51).contains(&norm(q))));
}
