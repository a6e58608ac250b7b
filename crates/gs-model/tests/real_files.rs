//! The readers on real files: see `../shared` beside the workspace.

mod common;

use common::{share_in_view, shared};
use gs_model::dataset::{Dataset, Kind};
use gs_model::{Error, colmap, ply};

#[test]
fn scenes_open_as_colmap_projects() {
    for (name, views, held_out, gaussians, size) in
        [("fox", 50, 7, 119_980, (265, 474)), ("bonsai", 148, 19, 179_918, (400, 266))]
    {
        let Some(dir) = shared(&format!("scenes/{name}")) else { return };
        let dataset = Dataset::open(&dir).unwrap();
        assert_eq!(dataset.kind, Kind::Colmap);
        assert_eq!(dataset.views.len(), views, "{name}");
        assert_eq!(dataset.held_out().len(), held_out, "{name}");
        assert_eq!(dataset.training().count(), views - held_out, "{name}");
        assert_eq!(dataset.held_out().next(), dataset.views.first());
        assert!(dataset.views.is_sorted_by(|a, b| a.camera.name < b.camera.name));
        assert!(dataset.views.iter().all(|v| v.has_photo()), "{name}");
        assert!(dataset.views.iter().all(|v| (v.camera.width, v.camera.height) == size), "{name}");

        let points = colmap::read_points(dir.join("sparse/0")).unwrap();
        let points: Vec<[f64; 3]> = points.iter().map(|p| p.position).collect();
        let share: f64 =
            dataset.views.iter().map(|v| share_in_view(&v.camera, &points)).sum::<f64>()
                / views as f64;
        println!("{name}: {} points, {share:.3} of them in an average view", points.len());
        assert!(share > 0.3, "{name}: {share}");

        let (scene, report) = ply::read(&dataset.model_path).unwrap();
        assert_eq!((scene.len(), scene.sh_degree), (gaussians, 3));
        assert_eq!(report.unknown_properties, [""; 0]);
        assert_eq!(report.trailing_bytes, 0);
    }
}

#[test]
fn models_are_read() {
    for (name, gaussians, unknown) in [
        ("leica-sofort-top8192.ply", 8192, &[][..]),
        ("kacy_7000.ply", 9080, &[]),
        ("fruit_drops_minimal.ply", 4721, &["transform"]),
    ] {
        let Some(path) = shared(&format!("models/{name}")) else { return };
        let (scene, report) = ply::read(&path).unwrap();
        assert_eq!((scene.len(), scene.sh_degree), (gaussians, 3), "{name}");
        assert_eq!(report.unknown_properties, unknown, "{name}");
        let mut bytes = Vec::new();
        ply::write_to(&mut bytes, &scene).unwrap();
        assert_eq!(ply::read_bytes(&bytes).unwrap().0, scene, "{name}");
    }
}

#[test]
fn other_ply_files_are_refused_by_name() {
    let Some(path) = shared("models/biker.compressed.ply") else { return };
    let error = ply::read(&path).unwrap_err();
    assert!(matches!(error, Error::PlyCompressed { .. }), "{error}");
    assert!(error.to_string().contains("compressed PLY"), "{error}");
    let Some(path) = shared("scenes/cameras/playroom/points.ply") else { return };
    let error = ply::read(&path).unwrap_err();
    assert!(matches!(error, Error::PlyMissingProperty { .. }), "{error}");
    println!("{error}");
}
